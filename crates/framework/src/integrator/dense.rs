//! Values between the ends of a substep: where a master asks for values at many times, no substep has to end at them.
//!
//! With the part s of a substep and r = 1 − s, a state is
//! x₀ + s(c₁ + r(c₂ + s(c₃ + r(c₄ + s(c₅ + r(c₆ + s c₇)))))), the form of Hairer, Nørsett and Wanner, Solving Ordinary
//! Differential Equations I, 2nd ed. (Springer 1993), II.6. c₁ is the difference of the ends' states, and c₂ and c₃ follow
//! from the rates at both ends (Hermite's polynomial of degree 3); the others are the method's own.

use std::ops::Range;

use super::driver::Driver;
use super::{Pace, Problem, Start};
use crate::error::StepError;
use crate::system::Section;

/// c₁ to c₇ of one state.
pub type Coefficients = [f64; 7];

/// Receives the problem with states and signals at a communication point, by its number. Rates are those of another time.
pub type AtPoint<'a> = dyn FnMut(&mut Problem, usize) -> Result<(), StepError> + 'a;

/// The polynomials of a substep. Takes no memory before it is needed.
#[derive(Debug, Default)]
pub(super) struct Dense {
    rows: Vec<Coefficients>,
    /// Inputs, states, signals and rates at the substep's end.
    end: Vec<f64>,
    /// Event indicators at a point.
    indicators: Vec<f64>,
}

impl Dense {
    /// Stores what interpolation overwrites.
    fn store(&mut self, problem: &Problem) {
        self.end.clear();
        written(problem).into_iter().for_each(|range| self.end.extend_from_slice(&problem.reals[range]));
    }

    /// Restores what was stored. What the ends of communication steps have changed stays.
    fn restore(&self, problem: &mut Problem) {
        let mut stored = &self.end[..];
        for range in written(problem) {
            let (first, rest) = stored.split_at(range.len());
            problem.reals[range].copy_from_slice(first);
            stored = rest;
        }
    }

    /// Puts the states to those at a time within the substep h.
    fn states(&self, problem: &mut Problem, start: &Start, h: f64, time: f64) {
        let s = (time - start.time) / h;
        let states = problem.states().iter_mut().zip(&start.states).zip(&self.rows);
        states.for_each(|((x, &x0), &row)| *x = at(x0, row, s));
    }
}

/// Values that a substep writes: inputs and states, and what follows from them. Discrete values lie in between.
fn written(problem: &Problem) -> [Range<usize>; 2] {
    let of = |section| problem.variables.reals(section);
    [of(Section::Input).start..of(Section::State).end, of(Section::Connected).start..of(Section::Derivative).end]
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
    /// `passed` is the number of points that are done. At a state event, the values at its time are those after it. Returns
    /// false if an indicator isn't on its side at one of them: it was back at the substep's end.
    pub(super) fn pass(
        &mut self,
        problem: &mut Problem,
        (times, passed): (&[f64], &mut usize),
        (t, is_event): (f64, bool),
        pace: &Pace,
        at_point: &mut AtPoint,
    ) -> Result<bool, StepError> {
        let last = times.len() - 1;
        let is_next = |k: usize| k < last && (times[k] < t || (times[k] == t && !is_event));
        if !is_next(*passed + 1) {
            return Ok(true);
        }
        let h = t - self.start.time;
        self.dense.rows.resize(self.start.states.len(), [0.0; 7]);
        self.dense.store(problem);
        self.methods.in_force(pace).between(problem, &self.start, h, &mut self.dense.rows);
        while is_next(*passed + 1) {
            let time = times[*passed + 1];
            self.dense.states(problem, &self.start, h, time);
            problem.evaluate_signals(time);
            self.work += self.methods.evaluation();
            if self.has_left(problem, time) {
                return Ok(false);
            }
            *passed += 1;
            at_point(problem, *passed)?;
        }
        self.dense.restore(problem);
        self.work_before = self.work;
        Ok(true)
    }

    /// True if an indicator isn't on its side at the problem's signals. Where single steps might see it otherwise, as at a zero
    /// that it rests at, that is no harm: they are taken then.
    fn has_left(&mut self, problem: &Problem, time: f64) -> bool {
        if self.indicators.is_empty() {
            return false;
        }
        self.dense.indicators.resize(problem.variables.indicators().len(), 0.0);
        problem.event_indicators(time, &mut self.dense.indicators);
        self.indicators.any_left(&self.dense.indicators)
    }
}
