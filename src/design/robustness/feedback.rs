//! Design report of a law that feeds outputs back, with the plant that it was designed for.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::Complex;

use super::linear::{LinearLaw, OutputFeedback};
use super::margins::{Margins, margins};
use super::region::Region;
use super::report::{Described, Unit};
use crate::design::criteria::{Unmoved, damping};
use crate::design::nominal::poles_of;
use crate::system::{DesignReport, Verdict};
use crate::template::three_digits;

/// M_s above which a loop isn't sound, and above which it is worth a warning; of several channels.
const MODULUS: [f64; 2] = [3.0, 2.0];
const OF_SEVERAL: f64 = 2.2;
/// Damping likewise.
const DAMPING: [f64; 2] = [0.1, 0.3];
/// Slowest pole, in W.
const SLOWEST: f64 = 0.2;
/// Steps that a delay margin has at least.
pub const STEPS: f64 = 1.5;

/// Reports on the loop of a law with the plant of the description, where it has one: `law` makes it for that plant.
pub fn report_robustness(
    channels: usize,
    law: impl Fn(&Described) -> OutputFeedback,
    unit: &Unit,
    report: &mut DesignReport,
) {
    let Some(described) = report.nominal().and_then(|nominal| Described::new(nominal, channels)) else { return };
    let law = law(&described);
    let plant = &described.plant;
    let H = unit.step * plant.bandwidth;
    let region = Region::new(plant, &law, described.drawn);
    described.report(&law, &region, unit, report);
    if described.assumed.is_known() {
        report_region(&described, &law, &region, H, report);
    }
    let closed = law.parts().delayed(&plant.delays).closed(&plant.A, &plant.B);
    let Some(poles) = poles_of(&closed).filter(|poles| poles.iter().all(|pole| pole.re < 0.0)) else { return };
    report.section("Margins");
    let Some(margins) = margins(plant, &law, &poles) else {
        return report.judge("maximum sensitivity", "not found", "", Verdict::Warning, "the loop is too badly scaled");
    };
    report_margins(&margins, plant.bandwidth, unit, report);
    report_poles(&poles, &margins, plant.bandwidth, report);
}

fn report_region(described: &Described, law: &OutputFeedback, region: &Region, H: f64, report: &mut DesignReport) {
    let plant = &described.plant;
    let assumed = &described.assumed;
    let asked = assumed.whole();
    let stable = region.largest_share(plant, law, H, assumed.most());
    if region.is_stable(plant, law, H) {
        let others = assumed.others(region.likely());
        let note = format!("uncertainty up to which all plants tried are stable; asked for: {asked}.{others}");
        return report.add("stable up to", assumed.share(stable), "", &note);
    }
    let note = format!("with {asked} some plants are not stable. Use another bandwidth, or a smaller uncertainty");
    report.judge("stable up to", assumed.share(stable), "", Verdict::NotSound, note);
}

fn report_margins(margins: &Margins, W: f64, unit: &Unit, report: &mut DesignReport) {
    let [bad, usual] = MODULUS;
    let usual = if unit.controls.len() > 1 { OF_SEVERAL } else { usual };
    let at = match margins.frequency {
        f64::INFINITY => "at high frequencies".to_owned(),
        frequency => format!("at {} rad/s", three_digits(frequency * W)),
    };
    let note = format!("largest gain from a disturbance at the outputs to the outputs, {at}");
    let verdict = match margins.modulus {
        modulus if modulus > bad => Verdict::NotSound,
        modulus if modulus > usual => Verdict::Warning,
        _ => Verdict::Ok,
    };
    let note =
        if verdict == Verdict::Ok { note } else { format!("{note}: at most {usual} is usual. Use another bandwidth") };
    report.judge("maximum sensitivity M_s", three_digits(margins.modulus), "", verdict, note);
    let [less, more] = margins.gains;
    let others = if unit.controls.len() > 1 { ", the other channels closed" } else { "" };
    match more {
        Some(more) => report.add(
            "gain margin",
            three_digits(more),
            "",
            &format!("factor of the gain up to which the loop is stable{others}"),
        ),
        None => report.add_unlimited("gain margin", "", "any larger gain is stable"),
    }
    if let Some(less) = less {
        report.add(
            "least gain",
            three_digits(less),
            "",
            &format!("factor of the gain down to which the loop is stable{others}"),
        );
    }
    match margins.phase {
        Some(phase) => {
            report.add("phase margin", three_digits(phase.to_degrees()), "deg", &format!("at a gain of 1{others}"))
        }
        None => report.add_unlimited("phase margin", "deg", "the loop gain does not cross 1"),
    }
    let least = STEPS * unit.step;
    match margins.delay.map(|delay| delay / W) {
        Some(delay) if delay < least => {
            let note = format!(
                "a communication step of {} s may delay by {} s already. Use a shorter step",
                unit.step,
                three_digits(least)
            );
            report.judge("delay margin", three_digits(delay), "s", Verdict::NotSound, note);
        }
        Some(delay) => report.add(
            "delay margin",
            three_digits(delay),
            "s",
            "further dead time at the controls with which the loop is stable",
        ),
        None => report.add_unlimited("delay margin", "s", "the loop gain does not cross 1"),
    }
    match margins.bandwidth {
        f64::INFINITY => report.add_unlimited("bandwidth", "rad/s", "all outputs follow at all frequencies"),
        band => report.add("bandwidth", three_digits(band * W), "rad/s", "up to which all outputs follow (-3 dB)"),
    }
    report.add("noise gain", three_digits(margins.noise), "", "largest gain from measurement noise to the controls");
    if !margins.zeros.is_empty() {
        let zeros: Vec<_> = margins.zeros.iter().map(|zero| crate::design::complex(zero * W)).collect();
        report.add("zeros of the plant", zeros.join(", "), "1/s", "those on the right limit the bandwidth");
    }
}

fn report_poles(poles: &[Complex<f64>], margins: &Margins, W: f64, report: &mut DesignReport) {
    let unmoved = Unmoved::new(&margins.poles, &margins.zeros);
    let own: Vec<_> = poles.iter().filter(|pole| !unmoved.is_mode(pole)).collect();
    let Some(damped) = own.iter().map(|pole| damping(pole)).reduce(f64::min) else { return };
    let [bad, usual] = DAMPING;
    let verdict = match damped {
        damped if damped < bad => Verdict::NotSound,
        damped if damped < usual => Verdict::Warning,
        _ => Verdict::Ok,
    };
    let note = "of the poles that feedback moves";
    let note = if verdict == Verdict::Ok {
        note.to_owned()
    } else {
        format!("{note}: below {usual} the loop rings. Use another bandwidth")
    };
    report.judge("least damping", three_digits(damped), "", verdict, note);
    let slowest = own.iter().filter(|pole| !unmoved.is_hidden(pole)).map(|pole| -pole.re).fold(f64::INFINITY, f64::min);
    if slowest < SLOWEST {
        let note = format!(
            "slower than {SLOWEST} of the bandwidth that the design is for, {} rad/s: an error lasts long",
            three_digits(W)
        );
        report.judge("slowest pole", three_digits(slowest * W), "rad/s", Verdict::Warning, note);
    }
}
