//! Figures of its nominal loop in the text of a first design.
#![allow(non_snake_case)] // W and M_s have the names of the field

use crate::design::nominal::Nominal;
use crate::design::search::{Found, Law};
use crate::design::step::{Entry, Step, step};
use crate::design::{digits, percent};
use crate::template::{Plant, Text, list};

/// The steps of all references in the nominal loop of a design.
pub fn steps<G>(plant: &Nominal, found: &Found<G>, entry: &Entry) -> Vec<Step> {
    // A pole that doesn't show much may be far slower than the step.
    let rate = found.has.merit.rate.clamp(0.05 * found.speed, found.speed);
    (0..plant.channels()).map(|i| step(plant, &found.controller, entry, i, rate)).collect()
}

/// Writes what the nominal loop has, and notes where it isn't what was asked for.
pub fn tell<L: Law>(
    text: &mut Text,
    (plant, nominal): (&Plant, &Nominal),
    found: &Found<L::Gains>,
    steps: &[Step],
    reference: f64,
) {
    let (W, v) = (nominal.bandwidth, found.speed * nominal.bandwidth);
    let overshoot = steps.iter().map(|step| 100.0 * step.overshoot).fold(0.0, f64::max);
    let settling = steps.iter().map(|step| step.settling.map(|time| time / W)).collect::<Option<Vec<_>>>();
    let settles = settling.map_or(String::new(), |times| {
        format!("settles to 2 % in {} s, ", digits(times.into_iter().fold(0.0, f64::max)))
    });
    let each = if nominal.channels() > 1 { " (one reference steps at a time)" } else { "" };
    text.comment(&format!(
        "Nominal loop: {settles}overshoot {} %{each}, maximum sensitivity M_s {}.",
        percent(overshoot),
        digits(found.has.modulus)
    ));
    if found.speed < 1.0 {
        text.note(&format!(
            "{} rad/s was asked for. The fastest design with stability margins that was found is for {} rad/s.",
            digits(W),
            digits(v)
        ));
    } else if found.speed > 1.0 {
        text.note(&format!(
            "{} rad/s was asked for. No slower design stabilises this plant with margins: this one is for {} rad/s.",
            digits(W),
            digits(v)
        ));
    }
    if found.has.modulus > L::MODULUS[0] * if nominal.channels() > 1 { 1.1 } else { 1.0 } {
        text.note(&format!(
            "The margins are small: the maximum sensitivity M_s is {}, where {} is usual. No design was found that has more.",
            digits(found.has.modulus),
            L::MODULUS[0]
        ));
    }
    tell_limits(text, plant, steps, reference);
}

/// Notes which steps the limits of the controls allow.
fn tell_limits(text: &mut Text, plant: &Plant, steps: &[Step], reference: f64) {
    let Some([min, max]) = &plant.limits else { return };
    let mut allowed = f64::INFINITY;
    let mut peaks = vec![0.0_f64; min.len()];
    for step in steps {
        for (j, &[lowest, highest]) in step.control.iter().enumerate() {
            // A bound of 0 forbids steps down, and no size of a step up.
            let within = |bound: f64, peak: f64| if bound * peak > 0.0 { bound / peak } else { f64::INFINITY };
            allowed = allowed.min(within(max[j], highest)).min(within(min[j], lowest));
            peaks[j] = peaks[j].max(highest * reference).max(-lowest * reference);
        }
    }
    if allowed < reference {
        let peaks: Vec<_> = peaks.iter().map(|&peak| crate::template::three_digits(peak)).collect();
        text.note(&format!(
            "A step of the reference to {} needs controls of up to {}, beyond u_min and u_max. A step to {} stays within them.",
            digits(reference),
            list(&peaks),
            digits(allowed)
        ));
    }
}
