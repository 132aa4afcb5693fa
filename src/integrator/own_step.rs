//! A system's own way through a step, its error controlled by step doubling.

use super::{OneStepMethod, Problem, Start, Tolerance};
use crate::system::{DynSystem, ErrorEstimate, Section, Stride, Values, Variables};

/// Two strides of the system's `advance`, compared with one of twice the length.
#[derive(Debug)]
pub struct OwnStep {
    workspace: Vec<f64>,
    /// The states to which one stride leads, and all values there.
    states: Vec<f64>,
    whole: Vec<f64>,
}

impl OwnStep {
    /// For a system that steps itself.
    pub fn new(system: &dyn DynSystem, variables: &Variables) -> Self {
        OwnStep {
            workspace: vec![0.0; system.workspace()],
            states: vec![0.0; variables.states()],
            whole: vec![0.0; variables.reals(Section::Memory).end],
        }
    }

    /// One stride from where the problem stands.
    fn stride(&mut self, problem: &mut Problem, time: f64, length: f64) {
        let (whole, workspace) = (&mut self.states, &mut self.workspace);
        let stride = Stride { time, length, slopes: problem.ramp.slopes, whole, workspace };
        problem.system.advance(stride, &mut problem.point());
    }
}

impl OneStepMethod for OwnStep {
    fn attempt(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        tolerance: Tolerance,
    ) -> (ErrorEstimate, usize) {
        problem.states().copy_from_slice(&start.states);
        problem.evaluate_signals(start.time);
        let (middle, end) = (start.time + 0.5 * h, start.time + h);
        self.stride(problem, start.time, 0.5 * h);
        // The whole stride's end is evaluated first, while the half's states wait in its place.
        problem.states().swap_with_slice(&mut self.states);
        problem.evaluate_signals(end);
        self.whole.copy_from_slice(problem.reals);
        problem.states().copy_from_slice(&self.states);
        problem.evaluate_signals(middle);
        self.stride(problem, middle, 0.5 * h);
        problem.evaluate(end);
        let whole = Values::new(&self.whole, problem.integers, problem.variables.offsets());
        (problem.system.step_error(&whole, &problem.values(), tolerance.nominals), 0)
    }
}
