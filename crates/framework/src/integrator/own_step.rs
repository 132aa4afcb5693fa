//! A system's own way through a step, its error controlled by step doubling.

use super::{OneStepMethod, Problem, Start, Tolerance};
use crate::system::{self, ErrorEstimate, Section, Stride, Values, Variables};

/// Two strides of the system's `advance`, compared with one of twice the length.
#[derive(Debug)]
pub struct OwnStep {
    workspace: Vec<f64>,
    /// The states to which one stride leads, and all values there.
    states: Vec<f64>,
    whole: Vec<f64>,
    integers: Vec<i32>,
}

impl OwnStep {
    /// Storage for a system that steps itself.
    pub fn new(own: &dyn system::OwnStep, variables: &Variables) -> Self {
        OwnStep {
            workspace: vec![0.0; own.workspace()],
            states: vec![0.0; variables.states()],
            whole: vec![0.0; variables.reals(Section::Memory).end],
            integers: vec![0; variables.integers(Section::Memory).end],
        }
    }

    /// Takes one stride from the problem's present point. Returns true if it was possible.
    fn stride(&mut self, problem: &mut Problem, time: f64, length: f64) -> bool {
        let (whole, workspace) = (&mut self.states, &mut self.workspace);
        let stride = Stride { time, length, slopes: problem.ramp.slopes, whole, workspace };
        problem.system.own_step().is_some_and(|own| own.advance(stride, &mut problem.point()))
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
        let impossible = (ErrorEstimate { scaled: f64::INFINITY, order: 1 }, 0);
        if !self.stride(problem, start.time, 0.5 * h) {
            return impossible;
        }
        // The whole stride's end is evaluated first, while the half's states wait in its place.
        problem.states().swap_with_slice(&mut self.states);
        problem.evaluate_signals(end);
        self.whole.copy_from_slice(problem.reals);
        self.integers.copy_from_slice(problem.integers);
        problem.states().copy_from_slice(&self.states);
        problem.evaluate_signals(middle);
        if !self.stride(problem, middle, 0.5 * h) {
            return impossible;
        }
        problem.evaluate_signals(end);
        let whole = Values::new(&self.whole, &self.integers, problem.variables.offsets());
        let Some(own) = problem.system.own_step() else { return impossible };
        let estimate = own.conclude(&whole, (tolerance.nominals, tolerance.relative), &mut problem.point());
        problem.evaluate(end);
        (estimate, 0)
    }
}
