//! Event indicators: their sides, when they leave them, and how often.
//!
//! An event is just behind a zero of its indicator. If it turned the motion back, its distance is stored as the
//! indicator's *overshoot*: until the indicator is back on its side, only a deeper value counts as another crossing.

use std::ops::Range;

use super::{Problem, Start};
use crate::system::{Section, Variables};

/// Precision of an event's time, from a master's times and the solution, relative to the time.
const EVENT_PRECISION: f64 = 1e-11;
/// Largest number of events of one indicator within the rounding of time.
pub(super) const MOST_CLOSE: f64 = 100.0;
/// An event that leaves less than this part of an indicator's rate has stopped it.
const STOPPED: f64 = 1e-6;
/// An indicator is looked at within a substep where its bow could be this many times as large as estimated and reach zero.
const CAUTION: f64 = 4.0;

/// State of the event indicators.
pub(super) struct Indicators {
    /// Five vectors over the indicators, one after the other: the last known value (its sign is the side), the
    /// overshoot, the time of the last event, the number of events close together, and the number of all events. They
    /// are in the instance's block between calls.
    pub stored: Vec<f64>,
    /// Values where a substep ends, and between.
    pub after: Vec<f64>,
    pub between: Vec<f64>,
    /// True for those that changed sides at the present event; and the sides where they were.
    pub crossed: Vec<bool>,
    pub came_from: Vec<f64>,
    /// True for crossed ones that never came back to their sides after the event before.
    pub never_back: Vec<bool>,
    /// True for those that an event left as they were, or put to zero.
    pub untouched: Vec<bool>,
    /// Changes along the tangents of the motion that an event met and of the one that it left.
    pub approach: Vec<f64>,
    pub leaving: Vec<f64>,
    /// The length of the substep in which the last event was located, s.
    pub span: f64,
    /// Mean rates in the last substep, and its length; no numbers where nothing was before.
    pub slopes: Vec<f64>,
    pub substep: f64,
    /// States behind an event, and all that evaluations write at the end of a substep.
    pub states: Vec<f64>,
    pub end: Vec<f64>,
    /// Discrete values that an event met.
    pub discrete: Vec<f64>,
    pub discrete_integers: Vec<i32>,
}

impl Indicators {
    const STORED_VECTORS: usize = 5;

    /// Length of the stored state.
    pub const fn stored_len(indicators: usize) -> usize {
        Self::STORED_VECTORS * indicators
    }

    pub fn new(indicators: usize, variables: &Variables) -> Self {
        let values = vec![0.0; indicators];
        Indicators {
            stored: vec![0.0; Self::stored_len(indicators)],
            after: values.clone(),
            between: values.clone(),
            crossed: vec![false; indicators],
            came_from: values.clone(),
            never_back: vec![false; indicators],
            untouched: vec![false; indicators],
            approach: values.clone(),
            leaving: values.clone(),
            span: 0.0,
            slopes: values,
            substep: 0.0,
            states: vec![0.0; variables.states()],
            discrete: vec![0.0; variables.reals(Section::Discrete).len()],
            discrete_integers: vec![0; variables.integers(Section::Discrete).len()],
            end: vec![0.0; evaluated(variables).len()],
        }
    }

    pub fn is_empty(&self) -> bool {
        self.after.is_empty()
    }

    pub fn of(&self, which: usize) -> &[f64] {
        &self.stored[which * self.after.len()..][..self.after.len()]
    }

    pub fn sides(&self) -> &[f64] {
        self.of(0)
    }

    pub fn overshoots(&self) -> &[f64] {
        self.of(1)
    }

    /// One stored number of indicator i.
    pub fn at(&mut self, which: usize, i: usize) -> &mut f64 {
        &mut self.stored[which * self.after.len() + i]
    }

    pub fn has_left(&self, i: usize, value: f64) -> bool {
        crossed(self.sides()[i], self.overshoots()[i], value)
    }

    pub fn any_left(&self, values: &[f64]) -> bool {
        let stored = self.sides().iter().zip(self.overshoots());
        stored.zip(values).any(|((&side, &overshoot), &value)| crossed(side, overshoot, value))
    }

    /// Takes over the values in `after` of those that are on their sides.
    pub fn take_over(&mut self) {
        for i in 0..self.after.len() {
            let (value, side, overshoot) = (self.after[i], self.sides()[i], self.overshoots()[i]);
            let arrived = value != 0.0 && (side == 0.0 || value.signum() == side.signum());
            if !crossed(side, overshoot, value) && (arrived || overshoot == 0.0) {
                self.put(i, value, 0.0);
            }
        }
    }

    pub fn put(&mut self, i: usize, side: f64, overshoot: f64) {
        *self.at(0, i) = side;
        *self.at(1, i) = overshoot;
    }

    /// Has an indicator behind its event on the side from which it came.
    pub fn stay(&mut self, i: usize) {
        let (side, depth) = (self.came_from[i], self.after[i].abs());
        self.put(i, side * f64::MIN_POSITIVE, depth.max(f64::MIN_POSITIVE));
    }

    /// Keeps the problem's discrete values as an event meets them.
    pub fn keep_discrete(&mut self, problem: &Problem) {
        self.discrete.copy_from_slice(&problem.reals[problem.variables.reals(Section::Discrete)]);
        self.discrete_integers.copy_from_slice(&problem.integers[problem.variables.integers(Section::Discrete)]);
    }

    /// Exchanges the problem's discrete values with the stored ones.
    pub fn swap_discrete(&mut self, problem: &mut Problem) {
        self.discrete.swap_with_slice(&mut problem.reals[problem.variables.reals(Section::Discrete)]);
        let integers = problem.variables.integers(Section::Discrete);
        self.discrete_integers.swap_with_slice(&mut problem.integers[integers]);
    }

    /// Puts indicators at zero on their sides in `between`. While rounding keeps one at zero, it has not come back
    /// there.
    pub fn leave_zero(&mut self) {
        for i in 0..self.after.len() {
            let value = self.between[i];
            if self.sides()[i] == 0.0 && value != 0.0 {
                self.put(i, value, f64::MIN_POSITIVE);
            }
        }
    }

    /// Notes which have changed sides on the way to `after`. Returns true if any has.
    pub fn note_crossed(&mut self) -> bool {
        for i in 0..self.after.len() {
            self.crossed[i] = self.has_left(i, self.after[i]);
            self.came_from[i] = self.sides()[i].signum();
            self.never_back[i] = self.overshoots()[i] > 0.0;
        }
        self.crossed.contains(&true)
    }

    /// Counts the events that were noted, at t; the indicator whose events accumulate, if one's do: there is no time
    /// between them, or what is between is lost in the rounding of the indicator.
    pub fn count(&mut self, t: f64) -> Option<usize> {
        for i in 0..self.after.len() {
            if self.crossed[i] {
                let gap = t - *self.at(2, i);
                let is_short = *self.at(4, i) > 0.0 && gap > 0.0 && gap <= rounding(t);
                let is_close = is_short || self.never_back[i];
                *self.at(3, i) = if is_close { *self.at(3, i) + 1.0 } else { 0.0 };
                *self.at(2, i) = t;
                *self.at(4, i) += 1.0;
            }
        }
        let close = &self.stored[3 * self.after.len()..][..self.after.len()];
        self.crossed.iter().zip(close).position(|(&crossed, &close)| crossed && close > MOST_CLOSE)
    }

    /// Forgets how fast they went: what comes may be another motion.
    pub fn restart(&mut self) {
        self.substep = 0.0;
    }
}

/// Effect of an event that has changed states on an indicator's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Outcome {
    TurnedBack,
    Stopped,
    /// It went on, or the event brought the indicator elsewhere, or didn't act on it.
    Other,
}

/// Motion of the indicators at an event and within a substep.
impl Indicators {
    pub fn outcome(&self, i: usize) -> Outcome {
        let side = self.came_from[i];
        let [z, approach, leaving] = [&self.after, &self.approach, &self.leaving].map(|values| values[i] * side);
        let went_on = self.crossed[i] && approach < 0.0 && z <= 0.0;
        if !went_on || leaving < STOPPED * approach {
            Outcome::Other
        } else if leaving <= -STOPPED * approach {
            Outcome::Stopped
        } else if self.untouched[i] {
            Outcome::TurnedBack
        } else {
            Outcome::Other
        }
    }

    /// `take_over` of the values in `between`.
    pub fn swapped_take_over(&mut self) {
        std::mem::swap(&mut self.after, &mut self.between);
        self.take_over();
        std::mem::swap(&mut self.after, &mut self.between);
    }

    /// Earliest zero of the indicators that changed sign, as a part of the way, if they were linear; the middle for one
    /// that is still on its way back to its side.
    pub fn first_crossing(&self) -> f64 {
        let zero = |i: usize| {
            let (before, after) = (self.sides()[i], self.after[i]);
            if self.overshoots()[i] > 0.0 { 0.5 } else { before / (before - after) }
        };
        (0..self.after.len()).filter(|&i| self.has_left(i, self.after[i])).map(zero).fold(1.0, f64::min)
    }

    /// True if an indicator that is on its side at both ends of an accepted substep h may have left it between: where
    /// nothing is known of its bow, or where that is large for how far it is from zero.
    pub fn may_leave(&self, h: f64) -> bool {
        let unknown = self.substep == 0.0;
        unknown
            || (0..self.after.len()).any(|i| {
                let (before, after) = (self.sides()[i], self.after[i]);
                let bend = ((after - before) / h - self.slopes[i]).abs();
                let bow = bend * h * h / (4.0 * (h + self.substep));
                CAUTION * bow > before.abs().min(after.abs())
            })
    }

    pub fn note_slopes(&mut self, h: f64) {
        for i in 0..self.after.len() {
            self.slopes[i] = (self.after[i] - self.sides()[i]) / h;
        }
        self.substep = h;
    }

    /// A part of the accepted substep h at which an indicator has left its side, as the states' cubic interpolation has
    /// it: in the middle, or where a parabola through both ends and the middle comes closest to zero.
    pub fn leaves_within(&mut self, problem: &mut Problem, start: &Start, h: f64) -> Option<f64> {
        const MIDDLE: f64 = 0.5;
        self.interpolate(problem, start, h, MIDDLE);
        if self.any_left(&self.between) {
            return Some(MIDDLE);
        }
        for i in 0..self.after.len() {
            let side = if self.overshoots()[i] > 0.0 { 0.0 } else { self.sides()[i] };
            let (middle, end) = (self.between[i], self.after[i]);
            let (slope, curvature) = (4.0 * middle - 3.0 * side - end, 2.0 * (side - 2.0 * middle + end));
            if curvature == 0.0 {
                continue;
            }
            let part = -slope / (2.0 * curvature);
            let value = side + part * (slope + part * curvature);
            // A parabola is not quite the curve: what comes near is looked at.
            let near = value * middle <= 0.25 * (value - middle).abs() * middle.abs();
            if part > 0.0 && part < 1.0 && near {
                self.interpolate(problem, start, h, part);
                if self.any_left(&self.between) {
                    return Some(part);
                }
                self.interpolate(problem, start, h, MIDDLE);
            }
        }
        None
    }

    /// Leaves in `between` the indicators at a part of the substep h, by Hermite's interpolation of the states between
    /// `start` and `end`.
    pub fn interpolate(&mut self, problem: &mut Problem, start: &Start, h: f64, part: f64) {
        let (states, rates) = (problem.variables.reals(Section::State), problem.variables.reals(Section::Derivative));
        let first = evaluated(problem.variables).start;
        let (ends, end_rates) = (&self.end[states.start - first..], &self.end[rates.start - first..]);
        let rest = 1.0 - part;
        for (i, x) in problem.reals[states].iter_mut().enumerate() {
            let (x0, x1) = (start.states[i], ends[i]);
            let chord = x0 + part * (x1 - x0);
            let [early, late] = [h * start.rates[i] - (x1 - x0), h * end_rates[i] - (x1 - x0)];
            *x = chord + part * rest * (rest * early - part * late);
        }
        let t = start.time + part * h;
        problem.evaluate_signals(t);
        problem.event_indicators(t, &mut self.between);
    }
}

/// Largest distance of t before a time event that it is meant to be: a master rounds.
pub(super) fn rounding(t: f64) -> f64 {
    EVENT_PRECISION * t.abs()
}

/// True if an indicator left the side on which it was; one that was exactly zero had none. One that is on its way back
/// from an overshoot has not left.
fn crossed(side: f64, overshoot: f64, value: f64) -> bool {
    let elsewhere = side != 0.0 && (value == 0.0 || side.signum() != value.signum());
    elsewhere && (overshoot == 0.0 || value.abs() > overshoot)
}

/// Everything that an evaluation writes, with the states between.
pub(super) fn evaluated(variables: &Variables) -> Range<usize> {
    variables.reals(Section::Input).start..variables.reals(Section::Derivative).end
}
