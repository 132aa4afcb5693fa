//! The error of what a user reads: outputs multiply the errors of states, by gains of thousands in a controller.

use std::ops::Range;

use super::{Problem, Tolerance};
use crate::system::{Section, Variables};

/// Factor beyond which an output amplifies rounding: there the error of states is controlled, and that of the output
/// isn't worth the effort.
const MOST_AMPLIFIED: f64 = 1e4;
/// An output's error in a substep may be this part of what is tolerated: an error of the control stays until the loop has
/// answered it, and those of many substeps add up.
const PART: f64 = 0.1;
/// A control before its limits counts in the magnitude that it has within them, up to this multiple of it.
const FAR: f64 = 10.0;
/// Factor on the error estimate of a substep in which a control reaches or leaves a limit: rates have a kink there, and the
/// difference of the two solutions doesn't show it.
const KINK: f64 = 6.0;
/// Smallest relative accuracy of states that is asked for the sake of outputs.
const ROUNDING: f64 = 1e-13;

/// Continuous outputs that aren't states, and what counts as such: a control before its limits cut it. With storage for them.
#[derive(Debug)]
pub struct Outputs {
    /// Everything that an evaluation of signals writes.
    written: Range<usize>,
    saved: Vec<f64>,
    states: Vec<f64>,
    /// The outputs among that: what is looked at, the output in whose magnitude it counts, and that one's nominal value.
    places: Vec<(usize, usize, f64)>,
    /// Values of these outputs where the substep begins.
    before: Vec<f64>,
    /// True for each of them that a limit cuts there.
    cut: Vec<bool>,
}

impl Outputs {
    /// The outputs of a system.
    pub fn new(variables: &Variables) -> Self {
        let written = variables.reals(Section::Connected).start..variables.reals(Section::Signal).end;
        let here = |(place, output, nominal)| (place - written.start, output - written.start, nominal);
        let places: Vec<_> = variables.controlled().map(here).collect();
        Outputs {
            saved: vec![0.0; written.len()],
            states: vec![0.0; variables.states()],
            before: vec![0.0; places.len()],
            cut: vec![false; places.len()],
            places,
            written,
        }
    }

    /// Takes over the values at the start of a substep, with the problem evaluated there.
    pub fn begin(&mut self, problem: &Problem) {
        let values = &problem.reals[self.written.clone()];
        for ((before, cut), &(place, output, _)) in self.before.iter_mut().zip(&mut self.cut).zip(&self.places) {
            (*before, *cut) = (values[output], values[place] != values[output]);
        }
    }

    /// True if a control reached or left a limit since the substep began.
    fn has_kink(&self, problem: &Problem) -> bool {
        let values = &problem.reals[self.written.clone()];
        self.places.iter().zip(&self.cut).any(|(&(place, output, _), &cut)| cut != (values[place] != values[output]))
    }

    /// The largest error of an output in units of what is tolerated, right after an attempt to t, from `errors` of the
    /// states, whose own largest is `scaled`. The problem is unchanged afterwards.
    pub fn error(&mut self, problem: &mut Problem, t: f64, errors: &[f64], scaled: f64, tolerance: Tolerance) -> f64 {
        let scaled = scaled * if self.has_kink(problem) { KINK } else { 1.0 };
        let amplified = (tolerance.relative / ROUNDING).clamp(1.0, MOST_AMPLIFIED);
        if self.places.is_empty() || scaled * amplified <= 1.0 {
            return scaled;
        }
        self.saved.copy_from_slice(&problem.reals[self.written.clone()]);
        self.states.copy_from_slice(problem.states());
        problem.states().iter_mut().zip(errors).for_each(|(x, error)| *x -= error);
        problem.evaluate_signals(t);
        let mut worst = 0.0_f64;
        let values = &problem.reals[self.written.clone()];
        for (&(place, output, nominal), before) in self.places.iter().zip(&self.before) {
            let far = self.saved[place].abs() / FAR;
            let magnitude = nominal.max(before.abs()).max(self.saved[output].abs()).max(far);
            // If the other solution is no number, the distance to it means nothing.
            worst = worst.max((values[place] - self.saved[place]).abs() / (PART * tolerance.relative * magnitude));
        }
        problem.states().copy_from_slice(&self.states);
        problem.reals[self.written.clone()].copy_from_slice(&self.saved);
        scaled.max(worst.min(scaled * amplified))
    }
}
