//! Step-size control and events: from one communication point to the next.

use super::{OneStepMethod, Problem, Settings, Start, Tolerance, method_for};
use crate::error::StepError;
use crate::system::{DynSystem, Section, Variables};

/// A new substep is this much smaller than the one that would just meet the tolerance.
const SAFETY: f64 = 0.9;
/// The largest change of the substep, down and up.
const SHRINK: f64 = 0.2;
const GROW: f64 = 5.0;
/// A substep that would leave less than this part of the way is stretched to the end.
const STRETCH: f64 = 1.001;
/// Relative width of the bracket in which an event is located.
const EVENT_PRECISION: f64 = 1e-11;

/// Integrates one instance; holds its workspace, and nothing that a continuation depends on.
pub struct Driver {
    method: Box<dyn OneStepMethod>,
    nominals: Vec<f64>,
    start: Start,
    /// Event indicators where a substep begins, where it ends, and between.
    indicators: [Vec<f64>; 3],
}

impl std::fmt::Debug for Driver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Driver").field("nominals", &self.nominals).finish_non_exhaustive()
    }
}

impl Driver {
    /// A driver for a system.
    pub fn new(system: &dyn DynSystem, variables: &Variables) -> Self {
        let states = variables.states();
        let nominal = |k| variables.real_at(Section::State, k).map_or(1.0, |element| element.nominal());
        let indicators = vec![0.0; system.indicators()];
        Driver {
            method: method_for(system, states),
            nominals: (0..states).map(nominal).collect(),
            start: Start { time: 0.0, states: vec![0.0; states], rates: vec![0.0; states] },
            indicators: [indicators.clone(), indicators.clone(), indicators],
        }
    }

    /// Advances a problem from t0 to t1. `substep` is the substep to begin with (0: none known yet) and is left as
    /// the one to go on with.
    ///
    /// # Errors
    /// [`StepError`]; the problem is then anywhere in between.
    pub fn advance(
        &mut self,
        problem: &mut Problem,
        t0: f64,
        t1: f64,
        settings: &Settings,
        substep: &mut f64,
    ) -> Result<(), StepError> {
        let slack = settings.event_slack * (t1 - t0);
        let mut t = t0;
        let (mut substeps, mut events, mut last_event) = (0, 0, t0);
        problem.evaluate(t);
        problem.event_indicators(t, &mut self.indicators[0]);
        self.sides_of_zeros(problem, t, t1, settings);
        while t < t1 {
            let target = match problem.next_time_event() {
                event if event < t1 - slack => event.max(t),
                _ => t1,
            };
            let event_inside = target > t && self.substep(problem, &mut t, target, settings, substep)?;
            substeps += 1;
            if substeps > settings.max_substeps {
                return Err(StepError::TooManySubsteps { substeps, time: t, step: t1 - t0 });
            }
            check_divergence(problem, t, settings.divergence_limit)?;
            let time_event_due = |problem: &Problem| {
                let event = problem.next_time_event();
                event <= t || (t == t1 && event <= t1 + slack)
            };
            let mut event_due = event_inside || time_event_due(problem);
            while event_due {
                // Only events without time between them are too many.
                events = if t - last_event > slack { 1 } else { events + 1 };
                last_event = t;
                if events > settings.max_events {
                    return Err(StepError::TooManyEvents { events, time: t });
                }
                problem.event(t);
                event_due = time_event_due(problem);
                problem.evaluate(t);
                problem.event_indicators(t, &mut self.indicators[0]);
                if t < t1 && !event_due {
                    self.sides_of_zeros(problem, t, t1, settings);
                }
            }
        }
        Ok(())
    }

    /// An indicator that stands at exactly zero has the side to which it leaves: found by a step of rounding's length.
    fn sides_of_zeros(&mut self, problem: &mut Problem, t: f64, t1: f64, settings: &Settings) {
        if !self.indicators[0].contains(&0.0) {
            return;
        }
        let h = (64.0 * f64::EPSILON * t.abs().max(t1.abs())).min(t1 - t);
        let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
        self.start.time = t;
        self.start.states.copy_from_slice(problem.states());
        self.start.rates.copy_from_slice(problem.rates());
        self.method.attempt(problem, &self.start, h, tolerance);
        let [before, after, _] = &mut self.indicators;
        problem.event_indicators(t + h, after);
        for (before, after) in before.iter_mut().zip(after) {
            if *before == 0.0 {
                *before = *after;
            }
        }
        problem.states().copy_from_slice(&self.start.states);
        problem.evaluate(t);
    }

    /// Handles events that are due at t, before anything is integrated.
    ///
    /// # Errors
    /// When they don't end.
    pub fn settle(&mut self, problem: &mut Problem, t: f64, settings: &Settings) -> Result<(), StepError> {
        let mut events = 0;
        while problem.next_time_event() <= t {
            events += 1;
            if events > settings.max_events {
                return Err(StepError::TooManyEvents { events, time: t });
            }
            problem.event(t);
        }
        problem.evaluate(t);
        Ok(())
    }

    /// One accepted substep towards `target`; whether it ended at a state event.
    fn substep(
        &mut self,
        problem: &mut Problem,
        t: &mut f64,
        target: f64,
        settings: &Settings,
        suggested: &mut f64,
    ) -> Result<bool, StepError> {
        let start = &mut self.start;
        start.time = *t;
        start.states.copy_from_slice(problem.states());
        start.rates.copy_from_slice(problem.rates());
        let way = target - *t;
        let smallest = 16.0 * f64::EPSILON * t.abs().max(target.abs());
        let mut h = if *suggested > 0.0 && *suggested * STRETCH < way { *suggested } else { way };
        loop {
            let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
            let (estimate, state) = self.method.attempt(problem, &self.start, h, tolerance);
            if estimate.scaled <= 1.0 {
                let whole = h == way;
                // A substep that was cut short says nothing about how long the next may be, unless it was the limit.
                if *suggested == 0.0 || h >= *suggested {
                    *suggested = h * growth(estimate.scaled, estimate.order);
                }
                let end = if whole { target } else { *t + h };
                return self.locate_event(problem, t, end, settings);
            }
            h *= if estimate.scaled.is_finite() { growth(estimate.scaled, estimate.order).min(SAFETY) } else { SHRINK };
            *suggested = h;
            if h <= smallest {
                let variable = problem.variables.real_at(Section::State, state).map_or(String::new(), |e| e.name());
                let tolerance = settings.relative_tolerance;
                return Err(StepError::StepTooSmall { time: *t, step: h, tolerance, variable });
            }
        }
    }

    /// Moves to the end of an accepted substep, or to the first event indicator that changes its sign before. The
    /// substep is repeated with the lengths of a bracketing search: regula falsi, and a bisection whenever that
    /// fails to halve the bracket. So an event is as accurate as the method itself, whichever it is.
    fn locate_event(
        &mut self,
        problem: &mut Problem,
        t: &mut f64,
        end: f64,
        settings: &Settings,
    ) -> Result<bool, StepError> {
        let [before, after, between] = &mut self.indicators;
        problem.event_indicators(end, after);
        if !any_crossed(before, after) {
            std::mem::swap(before, after);
            *t = end;
            return Ok(false);
        }
        let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
        let (mut low, mut high) = (0.0, end - *t);
        let width = (EVENT_PRECISION * high).max(4.0 * f64::EPSILON * end.abs());
        let mut bisect = false;
        while high - low > width {
            let gap = high - low;
            let part = if bisect { 0.5 } else { first_crossing(before, after) };
            let h = (low + gap * part).clamp(low + 0.25 * width, high - 0.25 * width);
            self.method.attempt(problem, &self.start, h, tolerance);
            problem.event_indicators(self.start.time + h, between);
            if any_crossed(before, between) {
                high = h;
                std::mem::swap(after, between);
            } else {
                low = h;
                std::mem::swap(before, between);
            }
            bisect = high - low > 0.5 * gap;
        }
        self.method.attempt(problem, &self.start, high, tolerance);
        *t = self.start.time + high;
        Ok(true)
    }
}

/// Factor to the next substep from a scaled error.
fn growth(scaled: f64, order: i32) -> f64 {
    // Below this error the factor is at its limit: no power to take.
    if scaled < 1e-6 { GROW } else { (SAFETY * scaled.powf(-1.0 / f64::from(order))).clamp(SHRINK, GROW) }
}

/// Whether an indicator left the side on which it was; one that was exactly zero had none.
fn crossed(before: f64, after: f64) -> bool {
    before != 0.0 && (after == 0.0 || before.signum() != after.signum())
}

fn any_crossed(before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).any(|(&a, &b)| crossed(a, b))
}

/// Where, as a part of the way, the first of the indicators that changed sign would be zero if it were linear.
fn first_crossing(before: &[f64], after: &[f64]) -> f64 {
    let zero = |(a, b): (&f64, &f64)| crossed(*a, *b).then(|| a / (a - b));
    before.iter().zip(after).filter_map(zero).fold(1.0, f64::min)
}

fn check_divergence(problem: &mut Problem, time: f64, limit: f64) -> Result<(), StepError> {
    let offender = problem.states().iter().position(|x| x.is_nan() || x.abs() > limit);
    let Some(place) = offender else { return Ok(()) };
    let value = problem.states()[place];
    let variable = problem.variables.real_at(Section::State, place).map_or(String::new(), |element| element.name());
    Err(StepError::Diverged { variable, value, time })
}
