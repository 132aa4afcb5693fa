//! Figures of its nominal loop in the text of a first design.
#![allow(non_snake_case)] // W and M_s have the names of the field

use nalgebra::DMatrix;

use crate::design::controller::Controller;
use crate::design::nominal::{Nominal, poles_of};
use crate::design::robustness::bounds::Bounds;
use crate::design::robustness::feedback::STEPS;
use crate::design::robustness::linear::{LinearLaw, OutputFeedback};
use crate::design::robustness::margins::margins;
use crate::design::robustness::uncertain::Uncertain;
use crate::design::search::{Found, Law, factor, search};
use crate::design::step::{Entry, Step, step};
use crate::design::{digits, limits, percent, reasons};
use crate::error::Invalid;
use crate::template::{Plant, Text, one_or_each, round_down, three_digits};

/// The steps of all references in the nominal loop of a design.
///
/// # Errors
/// Numbers that are too large for them.
pub fn steps<G>(plant: &Nominal, found: &Found<G>, entry: &Entry) -> Result<Vec<Step>, Invalid> {
    // A pole that doesn't show much may be far slower than the step.
    let rate = found.has.merit.rate.clamp(0.05 * found.speed, found.speed);
    let steps = (0..plant.channels()).map(|i| step(plant, &found.controller, entry, i, rate));
    let extreme = || Invalid::because("the entries of A, B and C differ by too many powers of ten");
    steps.collect::<Option<Vec<_>>>().ok_or_else(extreme)
}

/// Writes what the nominal loop has, and notes where it isn't what was asked for.
pub fn describe<L: Law>(
    text: &mut Text,
    (plant, nominal): (&Plant, &Nominal),
    found: &Found<L::Gains>,
    steps: &[Step],
    references: &[f64],
) {
    let (W, v) = (nominal.bandwidth, found.speed * nominal.bandwidth);
    describe_steps(text, W, steps, &format!(", maximum sensitivity M_s {}", digits(found.has.modulus)));
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
    if found.has.modulus > L::MODULUS[0] * factor(nominal) {
        text.note(&format!(
            "The margins are small: the maximum sensitivity M_s is {}, where at most {} is usual. No design with larger margins was \
             found.",
            digits(found.has.modulus),
            digits(L::MODULUS[0] * factor(nominal))
        ));
    }
    describe_limits(text, plant, steps, references);
}

/// Writes what the steps of all references do, with W, rad/s, and what else the nominal loop has.
pub fn describe_steps(text: &mut Text, W: f64, steps: &[Step], further: &str) {
    let overshoot = steps.iter().map(|step| 100.0 * step.overshoot).fold(0.0, f64::max);
    let settling = steps.iter().map(|step| step.settling.map(|time| time / W)).collect::<Option<Vec<_>>>();
    let settles = settling.map_or(String::new(), |times| {
        format!("settles to 2 % in {} s, ", digits(times.into_iter().fold(0.0, f64::max)))
    });
    let each = if steps.len() > 1 { " (one reference steps at a time)" } else { "" };
    text.comment(&format!("Nominal loop: {settles}overshoot {} %{each}{further}.", percent(overshoot)));
}

/// Notes which steps of references of these sizes the limits of the controls allow.
pub fn describe_limits(text: &mut Text, plant: &Plant, steps: &[Step], references: &[f64]) {
    let Some([min, max]) = &plant.limits else { return };
    let mut extremes = vec![[0.0_f64; 2]; min.len()];
    for (step, size) in steps.iter().zip(references) {
        for (extremes, control) in extremes.iter_mut().zip(&step.control) {
            *extremes = [extremes[0].min(control[0] * size), extremes[1].max(control[1] * size)];
        }
    }
    let Some(needed) = beyond_limits(plant, &extremes) else { return };
    let of = |(j, extremes): (usize, &[f64; 2])| limits::allowed(*extremes, [min[j], max[j]]);
    let allowed = extremes.iter().enumerate().map(of).fold(f64::INFINITY, f64::min);
    let within = |size: &f64| {
        let rounded = three_digits(size * allowed);
        if rounded > size * allowed { three_digits(0.995 * size * allowed) } else { rounded }
    };
    let stays = if allowed > 0.0 {
        format!("A step to {} stays within them.", one_or_each(&references.iter().map(within).collect::<Vec<_>>()))
    } else {
        "No step stays within them: use a lower --bandwidth.".to_owned()
    };
    text.note(&format!(
        "A step of the reference to {} needs controls {needed}, beyond u_min and u_max. {stays}",
        one_or_each(references)
    ));
}

/// The range of each control, in words, where one of them goes beyond the plant's limits.
pub fn beyond_limits(plant: &Plant, extremes: &[[f64; 2]]) -> Option<String> {
    let [min, max] = plant.limits.as_ref()?;
    let is_beyond = extremes.iter().enumerate().any(|(j, extremes)| limits::is_beyond(*extremes, [min[j], max[j]]));
    let range = |extremes: &[f64; 2]| {
        let [lowest, highest] = limits::without_rounding(*extremes);
        format!("from {} to {}", digits(lowest), digits(highest))
    };
    is_beyond.then(|| extremes.iter().map(range).collect::<Vec<_>>().join(", "))
}

/// The step, s, or a shorter one, whose delay the loop tolerates.
pub fn step_within_margin(plant: &Plant, W: f64, controller: &Controller, step: f64) -> f64 {
    let longest = || {
        let ((n, m, _), k) = (plant.sizes(), controller.A.nrows());
        let certain = Uncertain::new([&plant.A, &plant.B, &plant.C], &Bounds::none((n, m)), &plant.delays(), W)?;
        let entry = Entry { B: DMatrix::zeros(k, m), D: DMatrix::zeros(m, m) };
        let law = OutputFeedback { controller: controller.clone(), entry, C: certain.C.clone() };
        let poles = poles_of(&law.parts().delayed(&certain.delays).closed(&certain.A, &certain.B))?;
        Some(margins(&certain, &law, &poles)?.delay? / W / STEPS)
    };
    // A little shorter: the gains are rounded.
    longest().filter(|longest| *longest < 1.1 * step).map_or(step, |longest| round_down(longest / 1.1))
}

/// The design of a law, or why there is none.
///
/// # Errors
/// The reason, for a law of this name that can stabilise so many poles at 0.
pub fn find<L: Law>(nominal: &Nominal, name: &str, integrators: usize) -> Result<Found<L::Gains>, Invalid> {
    let refuse = |reason: String| {
        let searched = reasons::searched(nominal);
        Invalid::because(format!("no {name} with stability margins was found for {searched}: {reason}"))
    };
    match reasons::at_once(nominal, L::MODULUS[1]) {
        Some(reason) => Err(refuse(reason)),
        None => search::<L>(nominal).ok_or_else(|| refuse(reasons::of_failure::<L>(nominal, integrators))),
    }
}
