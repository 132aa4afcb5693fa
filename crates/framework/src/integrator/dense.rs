//! Values between the ends of a substep: where a master asks for values at many times, no substep has to end at them.
//!
//! With the part s of a substep and r = 1 − s, a state is
//! x₀ + s(c₁ + r(c₂ + s(c₃ + r(c₄ + s(c₅ + r(c₆ + s c₇)))))), the form of Hairer, Nørsett and Wanner, Solving Ordinary
//! Differential Equations I, 2nd ed. (Springer 1993), II.6. c₁ is the difference of the ends' states, and c₂ and c₃ follow
//! from the rates at both ends (Hermite's polynomial of degree 3); the others are the method's own.

use super::driver::Driver;
use super::indicators::evaluated;
use super::{Pace, Problem, Start};
use crate::error::StepError;

/// c₁ to c₇ of one state.
pub type Coefficients = [f64; 7];

/// Receives the problem with the states at a communication point, by its number; it is to be evaluated.
pub type AtPoint<'a> = dyn FnMut(&mut Problem, usize) -> Result<(), StepError> + 'a;

/// The polynomials of a substep. Takes no memory before it is needed.
#[derive(Debug, Default)]
pub(super) struct Dense {
    rows: Vec<Coefficients>,
    /// Values of an evaluation at the substep's end.
    end: Vec<f64>,
}

/// Hermite's polynomials through the ends of a substep h, with the problem evaluated at its end.
pub(super) fn hermite(problem: &mut Problem, start: &Start, h: f64, rows: &mut [Coefficients]) {
    let (states, rates) = problem.states_and_rates();
    let ends = start.states.iter().zip(&start.rates).zip(states.iter().zip(rates));
    for (row, ((x0, rate0), (x1, rate1))) in rows.iter_mut().zip(ends) {
        let (difference, bend) = (x1 - x0, h * rate0 - (x1 - x0));
        *row = [difference, bend, difference - h * rate1 - bend, 0.0, 0.0, 0.0, 0.0];
    }
}

/// The state at a part s of a substep that begins at x0.
#[inline]
fn at(x0: f64, [c1, c2, c3, c4, c5, c6, c7]: Coefficients, s: f64) -> f64 {
    let r = 1.0 - s;
    x0 + s * (c1 + r * (c2 + s * (c3 + r * (c4 + s * (c5 + r * (c6 + s * c7))))))
}

impl Driver {
    /// Gives the problem at the points that the substep to t has passed, but for the last of them, where the step ends.
    /// `passed` is the number of points that are done. At an event, the values at its time are those after it.
    pub(super) fn pass(
        &mut self,
        problem: &mut Problem,
        (times, passed): (&[f64], &mut usize),
        (t, is_event): (f64, bool),
        pace: &Pace,
        at_point: &mut AtPoint,
    ) -> Result<(), StepError> {
        let is_passed = |time: f64| time < t || (time == t && !is_event);
        if !times[*passed + 1..times.len() - 1].first().is_some_and(|&time| is_passed(time)) {
            return Ok(());
        }
        self.work = 0.0;
        let range = evaluated(problem.variables);
        let h = t - self.start.time;
        self.dense.rows.resize(self.start.states.len(), [0.0; 7]);
        self.dense.end.clear();
        self.dense.end.extend_from_slice(&problem.reals[range.clone()]);
        self.methods.in_force(pace).between(problem, &self.start, h, &mut self.dense.rows);
        while let Some(&time) = times[*passed + 1..times.len() - 1].first().filter(|&&time| is_passed(time)) {
            let s = (time - self.start.time) / h;
            let states = problem.states().iter_mut().zip(&self.start.states).zip(&self.dense.rows);
            states.for_each(|((x, &x0), &row)| *x = at(x0, row, s));
            *passed += 1;
            at_point(problem, *passed)?;
        }
        problem.reals[range].copy_from_slice(&self.dense.end);
        Ok(())
    }
}
