//! Steps of fixed length by the classical Runge–Kutta method of order 4, for targets that must know beforehand what a
//! communication step takes. There is no error control.
//!
//! A communication step from t0 to t1 has n substeps of the length h = (t1 − t0)/n. Substep k = 0, 1, … begins at
//! t0 + (t1 − t0) k/n, and the last ends at t1 exactly. In a substep from t, with k1 from the rates where it begins,
//!
//! k2 = f(t + h/2, x + h/2 k1), k3 = f(t + h/2, x + h/2 k2), k4 = f(t + h, x + h k3),
//! x_new = x + h/6 (((k1 + 2 k2) + 2 k3) + k4),
//!
//! in this order of operations, and the equations are then evaluated at its end. So a substep takes four evaluations.
//!
//! Events don't change these formulas. Events that are due at t0, or caused by values that were set, are handled there
//! before the first substep. All others are handled at the end of the substep in which they fall due or in which an
//! indicator has changed sides, one after the other: first the indicators with the first time event that is due, then
//! each further time event. A time event is due at an end that is at most 1e-6 h before it (of the second and later
//! ones at that end a half, a third, …), and the system gets the later of both times. An indicator that changes sides
//! twice within a substep has no event. Contacts are judged as with the other methods, and so are indicators at zero
//! when a communication step begins or an event was: that may take a substep of the explicit method in addition to the
//! n.

use super::driver::{Driver, check_divergence};
use super::events::EventCount;
use super::{Pace, Problem, Settings, Start};
use crate::error::StepError;

/// The method's workspace.
#[derive(Debug)]
pub(super) struct RungeKutta {
    /// Weighted sum of the stages' rates.
    sum: Vec<f64>,
}

impl RungeKutta {
    pub fn new(states: usize) -> Self {
        RungeKutta { sum: vec![0.0; states] }
    }

    /// Advances the states by h from `start`, with the problem evaluated there, and evaluates it at `end`.
    fn step(&mut self, problem: &mut Problem, start: &Start, h: f64, end: f64) {
        self.sum.copy_from_slice(&start.rates);
        for (length, weight) in [(0.5 * h, 2.0), (0.5 * h, 2.0), (h, 1.0)] {
            let (states, rates) = problem.states_and_rates();
            states.iter_mut().zip(&start.states).zip(rates).for_each(|((x, x0), rate)| *x = x0 + length * rate);
            problem.evaluate(start.time + length);
            self.sum.iter_mut().zip(problem.rates()).for_each(|(sum, rate)| *sum += weight * rate);
        }
        let parts = start.states.iter().zip(&self.sum);
        problem.states().iter_mut().zip(parts).for_each(|(x, (x0, sum))| *x = x0 + h / 6.0 * sum);
        problem.evaluate(end);
    }
}

impl Driver {
    /// Advances a problem from t0 to t1 by a fixed number of substeps.
    pub(super) fn integrate_fixed(
        &mut self,
        problem: &mut Problem,
        (t0, t1): (f64, f64),
        settings: &Settings,
    ) -> Result<(), StepError> {
        self.methods.note(settings.method, t0, &Pace::default());
        let steps = settings.fixed_steps;
        let h = (t1 - t0) / f64::from(steps);
        let mut begun = EventCount::near(t0, 0.0, settings);
        self.indicators.restart();
        self.indicators.span = h;
        if self.jumped(problem, t0) || begun.time_event_due(problem, t0, t0) {
            self.handle_events(problem, (t0, t0), &mut begun, false)?;
        }
        self.sides_of_zeros(problem, t0, t1, settings);
        let mut t = t0;
        for step in 1..=steps {
            let end = if step == steps { t1 } else { t0 + (t1 - t0) * f64::from(step) / f64::from(steps) };
            self.start.set(problem, t);
            self.runge_kutta.step(problem, &self.start, h, end);
            check_divergence(problem, end, settings.divergence_limit)?;
            self.end_substep(problem, (end, t1), h, settings)?;
            t = end;
        }
        Ok(())
    }

    /// Handles what a substep h has brought about, at its end.
    fn end_substep(
        &mut self,
        problem: &mut Problem,
        (end, t1): (f64, f64),
        h: f64,
        settings: &Settings,
    ) -> Result<(), StepError> {
        let mut events = EventCount::near(end, settings.event_slack * h, settings);
        let crossed = self.crossed(problem, end);
        let is_left = settings.leaves_end && end >= t1 && !crossed;
        if !is_left && (crossed || events.time_event_due(problem, end, end)) {
            self.handle_events(problem, (end, end), &mut events, crossed)?;
            if end < t1 {
                self.sides_of_zeros(problem, end, t1, settings);
            }
        }
        Ok(())
    }
}
