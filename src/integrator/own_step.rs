//! A system's own way through a step.

use super::{OneStepMethod, Problem, Start, Tolerance};
use crate::system::ErrorEstimate;

/// Calls the system's `advance` and evaluates the problem where it arrives.
#[derive(Debug)]
pub struct OwnStep;

impl OwnStep {
    /// Needs no workspace.
    pub fn new() -> Self {
        OwnStep
    }
}

impl OneStepMethod for OwnStep {
    fn attempt(&mut self, problem: &mut Problem, start: &Start, h: f64, _: Tolerance) -> (ErrorEstimate, usize) {
        problem.states().copy_from_slice(&start.states);
        problem.evaluate(start.time);
        let slopes = problem.ramp.slopes;
        let estimate = problem.system.advance(start.time, h, slopes, &mut problem.point());
        problem.evaluate(start.time + h);
        (estimate, 0)
    }
}
