//! Events: where they lie, where they leave an indicator, and when they never end.
//!
//! An event of an indicator is located just behind its zero. Where it turns the motion back by a jump of states (a
//! bounce), the indicator is from then on on the side where it was: coming back over its zero is no second event, however
//! the event was written, and no contact is lost to rounding, however low the bounces are. An event that lets the motion
//! through is as good as any other, unless it has stopped it: then something was to hold that isn't in the equations.

use super::driver::{Driver, SHORTEST};
use super::indicators::{Indicators, MOST_CLOSE, Outcome, evaluated, rounding};
use super::{Pace, Problem, Settings, Tolerance};
use crate::error::StepError;

/// A rate is found along a tangent on which states change by about this part of their magnitudes, and no longer than
/// this part of the last substep.
const TANGENT: f64 = 1e-4;
const TANGENT_TIME: f64 = 1e-3;
/// An event is located to the rounding of its time, but no finer than this part of its substep.
const FINEST: f64 = 1e-18;

/// Counts the events of a communication step: those that have no time between them, and all time events.
pub(super) struct EventCount {
    /// A time event still belongs to the step's end if it lies at most this far behind it, and no other came before.
    slack: f64,
    limit: usize,
    count: usize,
    last: f64,
    /// Numbers of time events and of all events in the step.
    clock: f64,
    total: usize,
}

impl EventCount {
    /// Counter for the step from t0 to t1.
    pub fn new((t0, t1): (f64, f64), settings: &Settings) -> Self {
        EventCount::near(t0, settings.event_slack * (t1 - t0), settings)
    }

    /// Counter for the events at t, and for time events at most `slack` after it.
    pub fn near(t: f64, slack: f64, settings: &Settings) -> Self {
        EventCount { slack, limit: settings.max_events, count: 0, last: t, clock: 0.0, total: 0 }
    }

    /// Place of the last of these times that can be reached without a time event before it: at the event, or first behind it. The
    /// first, where the event's time is no number: it is refused there.
    pub fn end_of_way(&self, problem: &Problem, times: &[f64]) -> usize {
        let event = problem.next_time_event();
        let is_end = |&time: &f64| event.is_nan() || event <= time + self.slack();
        times[1..].iter().position(is_end).map_or(times.len() - 1, |before| before + 1)
    }

    fn another(&mut self, t: f64, is_clock: bool) -> Result<(), StepError> {
        self.count = if t - self.last > 4.0 * f64::EPSILON * t.abs() { 1 } else { self.count + 1 };
        self.last = t;
        self.total += 1;
        self.clock += f64::from(u8::from(is_clock));
        if self.count > self.limit { Err(StepError::TooManyEvents { events: self.limit, time: t }) } else { Ok(()) }
    }

    /// Number of events.
    pub fn total(&self) -> usize {
        self.total
    }

    /// Largest distance behind the step's end of a time event that is handled there: a part of the time between two of
    /// them.
    pub fn slack(&self) -> f64 {
        self.slack / (self.clock + 1.0)
    }

    pub fn time_event_due(&self, problem: &Problem, t: f64, t1: f64) -> bool {
        let event = problem.next_time_event();
        event <= t || (t == t1 && event <= t1 + self.slack())
    }
}

/// Detection of events.
impl Driver {
    /// True if nothing moves between time events: there are no states, and no indicators.
    pub(super) fn is_at_rest(&self) -> bool {
        self.nominals.is_empty() && self.indicators.is_empty()
    }

    /// Goes on to `target` where nothing moves; no state event is on the way.
    pub(super) fn wait(&mut self, problem: &mut Problem, t: &mut f64, target: f64) -> bool {
        problem.evaluate(target);
        self.work += self.methods.evaluation();
        *t = target;
        false
    }

    /// Evaluates the problem at t and notes which indicators changed sides since they were last known. Returns true if
    /// any did. Inputs, parameters and states that were set may have taken an indicator across.
    pub(super) fn jumped(&mut self, problem: &mut Problem, t: f64) -> bool {
        problem.evaluate(t);
        self.crossed(problem, t)
    }

    /// The same for an evaluated problem.
    pub(super) fn crossed(&mut self, problem: &Problem, t: f64) -> bool {
        problem.event_indicators(t, &mut self.indicators.after);
        let crossed = self.indicators.note_crossed();
        self.indicators.take_over();
        crossed
    }

    /// Handles the state event that was noted, and time events until none is due. `moved`: the motion has brought it,
    /// and no value that was set.
    pub(super) fn handle_events(
        &mut self,
        problem: &mut Problem,
        (t, t1): (f64, f64),
        events: &mut EventCount,
        moved: bool,
    ) -> Result<(), StepError> {
        self.indicators.restart();
        if moved && let Some(i) = self.indicators.count(t) {
            return Err(self.endless(problem, i, t));
        }
        loop {
            let due = events.time_event_due(problem, t, t1);
            events.another(t, due)?;
            self.work += self.methods.evaluation();
            // If rounding has the step end a little before a time event, the system gets the event's own time.
            let time = if due { t.max(problem.next_time_event()) } else { t };
            self.start.set(problem, t);
            self.indicators.keep_discrete(problem);
            problem.event(time, &self.indicators.crossed);
            problem.evaluate(t);
            self.sides_behind(problem, t, moved)?;
            self.indicators.crossed.fill(false);
            if !events.time_event_due(problem, t, t1) {
                return Ok(());
            }
        }
    }

    /// Handles the events at t: of indicators that changed sides since they were last known, and time events that are
    /// due or at most the slack after it. The problem is then evaluated. Returns true if there were any.
    ///
    /// # Errors
    /// When they don't end.
    pub fn events_at(
        &mut self,
        problem: &mut Problem,
        (t, slack): (f64, f64),
        settings: &Settings,
    ) -> Result<bool, StepError> {
        let mut events = EventCount::near(t, slack.max(rounding(t)), settings);
        let any = self.jumped(problem, t) || events.time_event_due(problem, t, t);
        if any {
            self.handle_events(problem, (t, t), &mut events, true)?;
        }
        Ok(any)
    }

    /// Takes over the sides of the indicators of an evaluated problem at t. One that changed sides keeps its old side,
    /// for the coming event. Returns true if there is one, or a time event is due.
    pub fn event_pending(&mut self, problem: &Problem, t: f64) -> bool {
        problem.event_indicators(t, &mut self.indicators.after);
        self.indicators.take_over();
        self.indicators.any_left(&self.indicators.after) || problem.next_time_event() <= t + rounding(t)
    }

    /// State of the event indicators, stored in the instance's block between calls.
    pub fn indicators(&self) -> &[f64] {
        &self.indicators.stored
    }

    /// Takes over what is known of the event indicators.
    pub fn set_indicators(&mut self, stored: &[f64]) {
        self.indicators.stored.copy_from_slice(stored);
    }

    /// Length of that state for a number of event indicators.
    pub const fn stored_of(indicators: usize) -> usize {
        Indicators::stored_len(indicators)
    }

    /// Handles events that are due at t, before anything is integrated.
    ///
    /// # Errors
    /// When they don't end.
    pub fn settle(&mut self, problem: &mut Problem, t: f64, settings: &Settings) -> Result<(), StepError> {
        // Nothing was known before, so nothing has crossed.
        self.indicators.stored.fill(0.0);
        self.events_at(problem, (t, 0.0), settings).map(|_| ())
    }

    /// Finds the side to which an indicator at exactly zero leaves: by a step of rounding's length towards t1 or, if
    /// that is lost in the indicator's own rounding, along the tangent. The problem is evaluated at t, before and
    /// after.
    pub fn sides_of_zeros(&mut self, problem: &mut Problem, t: f64, t1: f64, settings: &Settings) {
        if !self.indicators.sides().contains(&0.0) {
            return;
        }
        let h = (64.0 * f64::EPSILON * t.abs().max(t1.abs())).min(t1 - t);
        self.start.set(problem, t);
        self.try_explicitly(problem, h, settings.relative_tolerance);
        self.indicators.leave_zero();
        let length = self.tangent(problem).min(t1 - t);
        if length.is_finite() && self.indicators.sides().contains(&0.0) {
            ahead(problem, t, length, &mut self.indicators.between);
            problem.states().copy_from_slice(&self.start.states);
            problem.evaluate(t);
            self.indicators.leave_zero();
        }
    }

    /// Leaves in `between` the indicators after a step h of the explicit method: it is so short that it is no harder
    /// for one method than for another. The problem is evaluated at the start, before and after.
    fn try_explicitly(&mut self, problem: &mut Problem, h: f64, relative: f64) {
        let t = self.start.time;
        let tolerance = Tolerance { relative, nominals: &self.nominals };
        self.methods.explicit().attempt(problem, &self.start, h, tolerance);
        problem.event_indicators(t + h, &mut self.indicators.between);
        problem.states().copy_from_slice(&self.start.states);
        problem.evaluate(t);
    }

    /// Takes over the values of the indicators after an event at t, with the problem evaluated; `start` has the states
    /// before the event, and `after` the indicators. `moved`: the motion has caused it.
    ///
    /// # Errors
    /// When the event stopped a motion that goes on nevertheless.
    fn sides_behind(&mut self, problem: &mut Problem, t: f64, moved: bool) -> Result<(), StepError> {
        let known = &mut self.indicators;
        if known.is_empty() {
            return Ok(());
        }
        std::mem::swap(&mut known.after, &mut known.between);
        problem.event_indicators(t, &mut known.after);
        for i in 0..known.after.len() {
            let value = known.after[i];
            known.untouched[i] = value == known.between[i] || value == 0.0;
            if known.crossed[i] || known.has_left(i, value) {
                known.put(i, value, 0.0);
            }
        }
        known.take_over();
        let jumped = known.crossed.contains(&true) && problem.states() != self.start.states;
        if moved && jumped { self.turned_back(problem, t) } else { Ok(()) }
    }

    /// Finds the crossed indicators that were turned back by a jump of states: the motion would have gone on with the
    /// states before the event, and goes back with those after it.
    fn turned_back(&mut self, problem: &mut Problem, t: f64) -> Result<(), StepError> {
        let length = self.tangent(problem);
        if length == 0.0 || !length.is_finite() {
            return Ok(());
        }
        let known = &mut self.indicators;
        known.states.copy_from_slice(problem.states());
        ahead(problem, t, length, &mut known.between);
        known.leaving.iter_mut().zip(&known.between).zip(&known.after).for_each(|((l, ahead), z)| *l = ahead - z);
        problem.states().copy_from_slice(&self.start.states);
        problem.evaluate(t);
        problem.event_indicators(t, &mut known.approach);
        ahead(problem, t, length, &mut known.between);
        known.approach.iter_mut().zip(&known.between).for_each(|(z, ahead)| *z = ahead - *z);
        problem.states().copy_from_slice(&known.states);
        problem.evaluate(t);
        let mut any_stopped = false;
        for i in 0..known.after.len() {
            match known.outcome(i) {
                Outcome::TurnedBack => known.stay(i),
                Outcome::Stopped => any_stopped = true,
                Outcome::Other => {}
            }
        }
        if any_stopped { self.stay_stopped(problem, t, length) } else { Ok(()) }
    }

    /// Checks the indicators that an event has stopped; an error if they go through within h nevertheless. If nothing
    /// moves them now, but no equation reads what the event has set either, they count as on the side from which they
    /// came: pushed through later, they have another event.
    fn stay_stopped(&mut self, problem: &mut Problem, t: f64, h: f64) -> Result<(), StepError> {
        self.start.set(problem, t);
        self.try_explicitly(problem, h, Settings::default().relative_tolerance);
        let known = &mut self.indicators;
        let stopped = |known: &Indicators, i| known.outcome(i) == Outcome::Stopped;
        let through = |i: &usize| (known.between[*i] - known.after[*i]) * known.came_from[*i] < 0.0;
        if let Some(i) = (0..known.after.len()).filter(|&i| stopped(known, i)).find(through) {
            let (indicator, events) = (indicator(problem, i), *known.at(4, i) as u64);
            return Err(StepError::GoesThrough { indicator, time: t, events });
        }
        known.swap_discrete(problem);
        problem.evaluate(t);
        let has_changed = problem.rates() != self.start.rates;
        known.swap_discrete(problem);
        problem.evaluate(t);
        for i in (0..known.after.len()).filter(|_| !has_changed) {
            if stopped(known, i) {
                known.stay(i);
            }
        }
        Ok(())
    }

    /// The length of a tangent along which states change by a small part of their magnitudes, before an event and at
    /// the present point after it.
    fn tangent(&self, problem: &mut Problem) -> f64 {
        let longest = if self.indicators.span > 0.0 { TANGENT_TIME * self.indicators.span } else { f64::INFINITY };
        let (states, rates) = problem.states_and_rates();
        let behind = states.iter().zip(rates);
        let before = self.start.states.iter().zip(&self.start.rates);
        let nominals = self.nominals.iter().chain(&self.nominals);
        let moving = before.chain(behind).zip(nominals).filter(|((_, rate), _)| **rate != 0.0);
        let lengths = moving.map(|((x, rate), nominal)| TANGENT * nominal.max(x.abs()) / rate.abs());
        lengths.fold(longest, f64::min)
    }

    fn endless(&mut self, problem: &Problem, i: usize, time: f64) -> StepError {
        let (events, close) = (*self.indicators.at(4, i) as u64, MOST_CLOSE as u64);
        StepError::Accumulation { indicator: indicator(problem, i), events, close, time }
    }

    /// Moves to the end of an accepted substep, or to the first event indicator that changes its sign before. The
    /// substep is repeated with the lengths of a bracketing search: regula falsi, and a bisection whenever that
    /// fails to halve the bracket. So an event is as accurate as the method itself, whichever it is.
    pub(super) fn locate_event(
        &mut self,
        problem: &mut Problem,
        t: &mut f64,
        end: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> Result<bool, StepError> {
        if self.indicators.is_empty() {
            *t = end;
            return Ok(false);
        }
        let mut high = end - *t;
        problem.event_indicators(end, &mut self.indicators.after);
        if !self.indicators.any_left(&self.indicators.after) {
            let Some(within) = self.within(problem, end, settings, pace) else {
                self.indicators.note_slopes(high);
                self.indicators.take_over();
                *t = end;
                return Ok(false);
            };
            high = within;
        }
        self.indicators.span = end - *t;
        let (mut low, mut bisect) = (0.0, false);
        let shortest = (FINEST * high).max(SHORTEST);
        while high - low > shortest.max(4.0 * f64::EPSILON * (self.start.time + high).abs()) {
            let width = shortest.max(4.0 * f64::EPSILON * (self.start.time + high).abs());
            let gap = high - low;
            let part = if bisect { 0.5 } else { self.indicators.first_crossing() };
            let h = (low + gap * part).clamp(low + 0.25 * width, high - 0.25 * width);
            self.attempt(problem, h, settings, pace);
            let known = &mut self.indicators;
            problem.event_indicators(self.start.time + h, &mut known.between);
            let beyond = known.any_left(&known.between);
            if beyond {
                high = h;
                std::mem::swap(&mut known.after, &mut known.between);
            } else {
                low = h;
                known.swapped_take_over();
            }
            bisect = high - low > 0.5 * gap;
        }
        self.attempt(problem, high, settings, pace);
        // The indicators at the bracket's end are in `after`.
        self.indicators.note_crossed();
        *t = self.start.time + high;
        Ok(true)
    }

    /// Looks for an indicator that has left its side within the substep that was just accepted, and is back on it at
    /// the end; returns a length within which it leaves. If there is none, the problem is again at the end.
    fn within(&mut self, problem: &mut Problem, end: f64, settings: &Settings, pace: &mut Pace) -> Option<f64> {
        let h = end - self.start.time;
        if !self.indicators.may_leave(h) {
            return None;
        }
        let known = &mut self.indicators;
        let range = evaluated(problem.variables);
        known.end.copy_from_slice(&problem.reals[range.clone()]);
        let part = known.leaves_within(problem, &self.start, h);
        problem.reals[range].copy_from_slice(&known.end);
        // What an interpolation shows, the solution must show as well.
        let h_within = part? * h;
        self.attempt(problem, h_within, settings, pace);
        problem.event_indicators(self.start.time + h_within, &mut self.indicators.between);
        let known = &mut self.indicators;
        if known.any_left(&known.between) {
            std::mem::swap(&mut known.after, &mut known.between);
            return Some(h_within);
        }
        self.attempt(problem, h, settings, pace);
        problem.event_indicators(end, &mut self.indicators.after);
        None
    }
}

/// The indicators a little ahead on the tangent of a problem that is evaluated at t.
fn ahead(problem: &mut Problem, t: f64, length: f64, z: &mut [f64]) {
    let (states, rates) = problem.states_and_rates();
    states.iter_mut().zip(rates).for_each(|(x, rate)| *x += length * rate);
    problem.evaluate_signals(t + length);
    problem.event_indicators(t + length, z);
}

/// An indicator in the words of a message: its number, and its name where it has one.
fn indicator(problem: &Problem, i: usize) -> String {
    match &problem.variables.indicators()[i] {
        name if name.is_empty() => format!("event indicator {}", i + 1),
        name => format!("event indicator {} ({name})", i + 1),
    }
}
