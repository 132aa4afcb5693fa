//! The text of a new L1 controller.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::controllers::template::{first, stop_time, write_nominal, write_plant, write_poles};
use crate::design::digits;
use crate::design::l1::assess::Found;
use crate::design::l1::design::{Asked, Design, design, is_full};
use crate::design::l1::desired::Desired;
use crate::design::robustness::assumed::Assumed;
use crate::error::Invalid;
use crate::pages::Page;
use crate::system::Verdict;
use crate::template::{
    Begun, Plant, Request, Text, all, diagonal, list, named, number, rows, three_digits, write_limits,
    write_magnitudes, write_names, write_quantities, write_units,
};

/// Speeds in a decade, and how many slower ones are tried for a plant with a dead time.
const PER_DECADE: f64 = 4.0;
const SPEEDS: i32 = 12;

/// A text to which more can be added, W, rad/s, and the design.
pub struct Started {
    /// The text.
    pub text: Text,
    /// W, rad/s.
    pub bandwidth: f64,
    /// The design.
    pub design: Design,
}

impl Started {
    /// The whole text, with the plant that it is for.
    pub fn finish(mut self, request: &Request) -> Begun {
        let Design { theta_bound, sigma_bound, references, .. } = &self.design;
        write_magnitudes(&mut self.text, request.plant.as_ref(), (references, self.bandwidth), |of| {
            let estimates = [("theta_hat", theta_bound.into()), ("sigma_hat", sigma_bound.into())];
            let others = [("x_hat", (&of.x).into()), ("u_ad", (&of.u).into()), ("u", (&of.u).into())];
            estimates.into_iter().chain(others).collect()
        });
        write_nominal(&mut self.text, request, self.bandwidth, &request.uncertainty_or_usual());
        self.text.finish()
    }
}

/// The design of an L1 law, whose gain of the filter varies between these parts of K while it adapts.
///
/// # Errors
/// Why there is no design for the plant.
pub fn found(request: &Request, plant: &Plant, adapts: bool, varies: [f64; 2]) -> Result<(Design, f64), Invalid> {
    let (asked, references) = (request.speed(plant)?, request.references(plant.sizes().2)?);
    let uncertainty = request.uncertainty_or_usual();
    let at = |bandwidth: f64| {
        let (references, uncertainty) = (&references[..], &uncertainty);
        design(plant, &Asked { bandwidth, references, uncertainty, adapts, varies })
    };
    if plant.delay.is_empty() {
        return Ok((at(asked)?, asked));
    }
    // A dead time allows only so much: the first slower design whose uncertain plants are stable, else the fastest one.
    let mut fastest = None;
    for speed in (0..=SPEEDS).map(|k| three_digits(asked * 10_f64.powf(-f64::from(k) / PER_DECADE))) {
        match at(speed) {
            Ok(design) if design.found.is_stable => return Ok((design, speed)),
            Ok(design) => fastest = fastest.or(Some((design, speed))),
            Err(_) => {}
        }
    }
    fastest.map_or_else(|| Ok((at(asked)?, asked)), Ok)
}

/// The text of a law with this page, with these further keys of its structure, their values and what these are.
///
/// # Errors
/// Why there is no design for the plant.
pub fn begin(request: &Request, page: &Page, varies: [f64; 2], keys: &[[&str; 3]]) -> Result<Started, Invalid> {
    let plant = request.plant(true)?;
    let (_, m, _) = plant.sizes();
    let (design, bandwidth) = found(request, &plant, true, varies)?;
    let mut text = request.begin(page, stop_time(bandwidth), design.step);
    write_structure(&mut text, &plant, &design.desired, |text| {
        text.set("regressor", "\"state\"", "theta multiplies x; \"infinity_norm\": its largest element");
        let scale = list(&design.peaks);
        text.set("state_scale", scale, "usual magnitudes of x: theta multiplies x/state_scale");
        let full = is_full(&spread(&design));
        let entries = if full { "\"full\"" } else { "\"diagonal\"" };
        text.set("input_gain", entries, "omega; \"full\" where inputs act on each other's channels");
        keys.iter().for_each(|[key, value, what]| text.set(key, value, what));
    });
    text.table("start");
    describe(&mut text, (&plant, bandwidth), &design, request);
    write_dynamics(&mut text, &design);
    text.set("feedback_gain", diagonal(design.feedback_gain, m), "1/s, K: bandwidth of the adaptive control");
    text.set("adaptation_gain", number(design.adaptation_gain), "Gamma: larger is faster, and more work");
    text.set(
        "Q",
        rows(&DMatrix::from_diagonal(&design.Q.clone().into())),
        "1/(peak of x)^2 in a step of the reference",
    );
    let [min, max] = &design.omega;
    let bound = |omega: &DMatrix<f64>| {
        if is_full(&spread(&design)) { rows(omega) } else { list(omega.diagonal().as_slice()) }
    };
    text.set("omega_min", bound(min), "input gain, in parts of B, at least");
    text.set("omega_max", bound(max), "and at most");
    text.set("theta_bound", rows(&design.theta_bound), "of each element of theta, in the unit of u");
    text.set("sigma_bound", list(&design.sigma_bound), "of the disturbance, in the unit of u");
    write_limits(&mut text, Some(&plant), m);
    text.set("tracking_time", all(-1.0, m), "s, u_ad tracks the limited control; -1: 1/K, 0: off, it winds up");
    Ok(Started { text, bandwidth, design })
}

/// Deviation of the input gain.
fn spread(design: &Design) -> DMatrix<f64> {
    (&design.omega[1] - &design.omega[0]) * 0.5
}

/// The structure of a law with a baseline, with further keys of its own, and the names of its signals.
pub fn write_structure(text: &mut Text, plant: &Plant, desired: &Desired, further: impl FnOnce(&mut Text)) {
    let (n, m, _) = plant.sizes();
    text.table("structure");
    write_plant(text, plant, "outputs that follow the reference");
    match desired {
        Desired::Own => text.set("baseline", "\"none\"", "the plant moves as desired by itself: A_m is A"),
        Desired::Poles(_) => {
            text.set("baseline", "\"outside\"", "-K_m x moves the poles of A to those of pole_real, pole_imag")
        }
        Desired::Decoupled(_) => {
            text.set("baseline", "\"outside\"", "-K_m x makes A_m of A");
            text.set("desired_dynamics", "\"matrix\"", "A_m: channels that don't act on each other");
        }
    }
    further(text);
    write_units(text, &[("r", &plant.y, m), ("x", &plant.x, n), ("u", &plant.u, m)]);
    write_quantities(text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (r, x, u) = (named(&plant.y, "_reference"), named(&plant.x, ""), named(&plant.u, ""));
    write_names(text, &[("r", r), ("x", x), ("u", u)]);
}

/// Poles, or A_m, of the desired dynamics.
pub fn write_dynamics(text: &mut Text, design: &Design) {
    match &design.desired {
        Desired::Own => {}
        Desired::Poles(poles) => write_poles(text, "", poles, "1/s, poles of A_m, how the controlled plant is to move"),
        Desired::Decoupled(_) => text.set("A_m", rows(&design.A_m), "how the controlled plant is to move"),
    }
}

/// Writes what the nominal loop does and what holds for uncertain plants, and notes what can't be done.
pub fn describe(text: &mut Text, (plant, bandwidth): (&Plant, f64), design: &Design, request: &Request) {
    let Found { lambda, .. } = design.found;
    let of_lambda = lambda.map_or(String::new(), |lambda| format!(", λ* {}", digits(lambda)));
    first::describe_steps(text, bandwidth, &design.steps, &of_lambda);
    if let Some(asked) = request.bandwidth.filter(|asked| bandwidth < 0.999 * asked) {
        text.note(&format!(
            "{} rad/s was asked for. With the dead time of the plant this design is for {} rad/s.",
            digits(asked),
            digits(bandwidth)
        ));
    }
    let assumed = Assumed::new(&plant.A, &plant.B, &request.uncertainty_or_usual());
    let (verdict, reason) = design.found.verdict(&assumed);
    match (verdict, design.found.proved) {
        (Verdict::Ok, Some(proved)) => text.comment(&format!(
            "Uncertain plants, {}: each of {} is stable; proved while they change within {}.",
            assumed.whole(),
            design.found.plants,
            assumed.share(proved)
        )),
        (Verdict::Ok, None) => text.comment(&format!("Uncertain plants: {reason}.")),
        (Verdict::Warning, _) => text.note(&format!("Warning: {reason}")),
        // `new` reports this itself, as `check` does.
        (Verdict::NotSound, _) => text.comment(&format!("Not sound: {reason}.")),
    }
    if let Some(reason) = design.found.at_rest() {
        text.note(&reason);
    }
    first::describe_limits(text, plant, &design.steps, &design.references);
}
