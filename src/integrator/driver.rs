//! Step-size control and events: from one communication point to the next.

use super::methods::Methods;
use super::outputs::Outputs;
use super::{IntegrationMethod, Pace, Problem, Settings, Start, Tolerance};
use crate::error::{Invalid, StepError};
use crate::system::{DynSystem, ErrorEstimate, Section, Variables};

/// A new substep is this much smaller than the one that would just meet the tolerance.
const SAFETY: f64 = 0.9;
/// The largest change of the substep, down and up.
const SHRINK: f64 = 0.2;
const GROW: f64 = 5.0;
/// A substep that would leave less than this part of the way is stretched to the end.
const STRETCH: f64 = 1.001;
/// How often the shortest step is doubled in the search for where the equations cease to hold.
const LOOK_AHEAD: i32 = 12;
/// Relative width of the bracket in which an event is located, and of the rounding of its time.
const EVENT_PRECISION: f64 = 1e-11;
/// Shorter substeps can't be halved: their lengths are subnormal numbers.
const SHORTEST: f64 = f64::MIN_POSITIVE;

/// Integrates one instance; holds its workspace, and nothing that a continuation depends on.
pub struct Driver {
    methods: Methods,
    nominals: Vec<f64>,
    start: Start,
    outputs: Outputs,
    /// Event indicators where a substep begins, where it ends, and between.
    indicators: [Vec<f64>; 3],
    /// Which indicators changed sides at the event that is being handled.
    crossed: Vec<bool>,
    /// Work of the communication step so far, in elementary operations.
    work: f64,
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
        let nominals: Vec<_> = (0..states).map(nominal).collect();
        Driver {
            methods: Methods::new(system, variables, nominals.clone()),
            nominals,
            outputs: Outputs::new(variables),
            start: Start { time: 0.0, states: vec![0.0; states], rates: vec![0.0; states] },
            crossed: vec![false; system.indicators()],
            work: 0.0,
            indicators: [indicators.clone(), indicators.clone(), indicators],
        }
    }

    /// Magnitudes of the states.
    pub fn nominals(&self) -> &[f64] {
        &self.nominals
    }

    /// Advances a problem from t0 to t1, at a pace that is left as the one to go on with.
    ///
    /// # Errors
    /// [`StepError`]; the problem is then anywhere in between.
    pub fn advance(
        &mut self,
        problem: &mut Problem,
        t0: f64,
        t1: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> Result<(), StepError> {
        self.integrate(problem, (t0, t1), settings, pace).map_err(|error| {
            let reason = match error {
                StepError::StepTooSmall { step, .. } => self.check_ahead(problem, step),
                StepError::Diverged { time, .. }
                | StepError::NoJacobian { time, .. }
                | StepError::TooMuchWork { time, .. } => problem.check(time),
                _ => Ok(()),
            };
            reason.err().map_or(error, StepError::Unsound)
        })
    }

    /// Whether the equations hold where a substep begins that can't be finished, and a little ahead along its tangent:
    /// towards a pole, steps shrink as the way to it does, so that none of them reaches it.
    fn check_ahead(&self, problem: &mut Problem, shortest: f64) -> Result<(), Invalid> {
        let Start { time, states, rates } = &self.start;
        problem.states().copy_from_slice(states);
        problem.evaluate_signals(*time);
        problem.check(*time)?;
        if rates.iter().any(|rate| !rate.is_finite()) {
            return Ok(());
        }
        for h in (0..=LOOK_AHEAD).map(|doublings| shortest * 2.0_f64.powi(doublings)) {
            let ahead = states.iter().zip(rates).map(|(x, rate)| x + h * rate);
            problem.states().iter_mut().zip(ahead).for_each(|(x, ahead)| *x = ahead);
            problem.evaluate_signals(time + h);
            problem.check(time + h)?;
        }
        Ok(())
    }

    fn integrate(
        &mut self,
        problem: &mut Problem,
        (t0, t1): (f64, f64),
        settings: &Settings,
        pace: &mut Pace,
    ) -> Result<(), StepError> {
        let mut events =
            EventCount { slack: settings.event_slack * (t1 - t0), limit: settings.max_events, count: 0, last: t0 };
        let (mut t, mut substeps) = (t0, 0);
        self.methods.restart();
        self.work = 0.0;
        if self.jumped(problem, t) {
            self.handle_events(problem, t, t1, &mut events)?;
        }
        self.sides_of_zeros(problem, t, t1, settings);
        while t < t1 {
            let target = match problem.next_time_event() {
                event if event < t1 - events.slack => event.max(t),
                _ => t1,
            };
            let state_event = target > t && self.substep(problem, &mut t, target, settings, pace)?;
            substeps += 1;
            if self.work > settings.most_work {
                let followed = self.methods.followed(pace);
                return Err(StepError::TooMuchWork { substeps, time: t, step: t1 - t0, followed });
            }
            check_divergence(problem, t, settings.divergence_limit)?;
            if state_event || events.time_event_due(problem, t, t1) {
                self.handle_events(problem, t, t1, &mut events)?;
                if t < t1 {
                    self.sides_of_zeros(problem, t, t1, settings);
                }
            }
        }
        Ok(())
    }

    /// Evaluates the problem at t and notes which indicators changed sides since they were last known; whether any
    /// did. Inputs, parameters and states that were set may have taken an indicator across.
    fn jumped(&mut self, problem: &mut Problem, t: f64) -> bool {
        problem.evaluate(t);
        problem.event_indicators(t, &mut self.indicators[1]);
        let jumped = self.note_crossed();
        self.indicators.swap(0, 1);
        jumped
    }

    /// Notes which indicators changed sides between `before` and `after`; whether any did.
    fn note_crossed(&mut self) -> bool {
        let [before, after, _] = &self.indicators;
        let sides = before.iter().zip(after);
        self.crossed.iter_mut().zip(sides).for_each(|(noted, (&before, &after))| *noted = crossed(before, after));
        self.crossed.contains(&true)
    }

    /// Handles the state event that was noted, and time events until none is due.
    fn handle_events(
        &mut self,
        problem: &mut Problem,
        t: f64,
        t1: f64,
        events: &mut EventCount,
    ) -> Result<(), StepError> {
        loop {
            events.another(t)?;
            let due = events.time_event_due(problem, t, t1);
            // Where rounding has the step end a little before a time event, the system is told the event's own time.
            let time = if due { t.max(problem.next_time_event()) } else { t };
            problem.event(time, &self.crossed);
            self.crossed.fill(false);
            problem.evaluate(t);
            problem.event_indicators(t, &mut self.indicators[0]);
            if !events.time_event_due(problem, t, t1) {
                return Ok(());
            }
        }
    }

    /// Handles the events at t: of indicators that changed sides since they were last known, and time events that are
    /// due. The problem then stands evaluated. Whether there were any.
    ///
    /// # Errors
    /// When they don't end.
    pub fn events_at(&mut self, problem: &mut Problem, t: f64, settings: &Settings) -> Result<bool, StepError> {
        let mut events = EventCount { slack: rounding(t), limit: settings.max_events, count: 0, last: t };
        let any = self.jumped(problem, t) || events.time_event_due(problem, t, t);
        if any {
            self.handle_events(problem, t, t, &mut events)?;
        }
        Ok(any)
    }

    /// Takes over the sides on which the indicators of an evaluated problem are at t. One that changed sides keeps the
    /// side where it was, for the event that this is; whether there is such a one, or a time event is due.
    pub fn event_pending(&mut self, problem: &Problem, t: f64) -> bool {
        let [before, after, _] = &mut self.indicators;
        problem.event_indicators(t, after);
        for (before, &after) in before.iter_mut().zip(after.iter()) {
            if !crossed(*before, after) {
                *before = after;
            }
        }
        any_crossed(before, after) || problem.next_time_event() <= t + rounding(t)
    }

    /// The event indicators where they were last known. They lie in the instance's block between calls.
    pub fn indicators(&self) -> &[f64] {
        &self.indicators[0]
    }

    /// Takes over the event indicators from where they were last known.
    pub fn set_indicators(&mut self, indicators: &[f64]) {
        self.indicators[0].copy_from_slice(indicators);
    }

    /// An indicator that stands at exactly zero has the side to which it leaves: found by a step of rounding's length
    /// towards t1. The problem is evaluated at t, before and after.
    pub fn sides_of_zeros(&mut self, problem: &mut Problem, t: f64, t1: f64, settings: &Settings) {
        if !self.indicators[0].contains(&0.0) {
            return;
        }
        let h = (64.0 * f64::EPSILON * t.abs().max(t1.abs())).min(t1 - t);
        let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
        self.start.set(problem, t);
        // So short a step is no harder for one method than for another.
        self.methods.explicit().attempt(problem, &self.start, h, tolerance);
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
        // Nothing was known before, so nothing has crossed.
        self.indicators[0].fill(0.0);
        self.events_at(problem, t, settings).map(|_| ())
    }

    /// One accepted substep towards `target`; whether it ended at a state event.
    fn substep(
        &mut self,
        problem: &mut Problem,
        t: &mut f64,
        target: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> Result<bool, StepError> {
        self.start.set(problem, *t);
        self.outputs.begin(problem);
        let (way, smallest) = (target - *t, (16.0 * f64::EPSILON * t.abs().max(target.abs())).max(SHORTEST));
        self.begin(problem, *t, way, settings, pace)?;
        let mut h = self.first_substep(pace, way, smallest);
        loop {
            let (estimate, state) = self.controlled(problem, h, settings, pace);
            let suggested = pace.substep_of(self.methods.by_itself());
            if estimate.scaled <= 1.0 {
                let whole = h == way;
                // A substep that was cut short says nothing about how long the next may be, unless it was the limit.
                if *suggested == 0.0 || h >= *suggested {
                    *suggested = h * growth(estimate.scaled, estimate.order);
                }
                if settings.method == IntegrationMethod::Automatic {
                    self.methods.judge((h, whole), pace);
                }
                let end = if whole { target } else { *t + h };
                return self.locate_event(problem, t, end, settings, pace);
            }
            h *= if estimate.scaled.is_finite() { growth(estimate.scaled, estimate.order).min(SAFETY) } else { SHRINK };
            if self.own_step_ends(problem, *t, (h, settings.relative_tolerance), estimate.scaled) {
                // One that is impossible says nothing about how long the next may be.
                if estimate.scaled.is_finite() {
                    pace.own_substep = h;
                }
                self.methods.give_up_own_step();
                self.begin(problem, *t, way, settings, pace)?;
                h = self.first_substep(pace, way, smallest);
                continue;
            }
            *suggested = h;
            if h <= smallest {
                let (variable, tolerance) = (state_name(problem, state), settings.relative_tolerance);
                return Err(StepError::StepTooSmall { time: *t, step: h, tolerance, variable });
            }
        }
    }

    /// The substep to try first: the one that is suggested, where there is so long a way to go, and what eigenvalues
    /// allow.
    fn first_substep(&self, pace: &mut Pace, way: f64, smallest: f64) -> f64 {
        let suggested = *pace.substep_of(self.methods.by_itself());
        let longest = self.methods.longest(pace).max(smallest);
        let h = if suggested > 0.0 { suggested.min(longest) } else { longest };
        if h * STRETCH < way { h } else { way }
    }

    /// As [`Driver::attempt`], with the error of what a user reads in it.
    fn controlled(
        &mut self,
        problem: &mut Problem,
        h: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> (ErrorEstimate, usize) {
        let (mut estimate, state) = self.attempt(problem, h, settings, pace);
        if estimate.scaled <= 1.0 && !self.methods.by_itself() {
            let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
            let (errors, end) = (self.methods.in_force(pace).errors(), self.start.time + h);
            estimate.scaled = self.outputs.error(problem, end, errors, estimate.scaled, tolerance);
        }
        (estimate, state)
    }

    /// Tries a substep of length h by the method in force, from where the last one ended: its error, and the state that
    /// has it.
    fn attempt(
        &mut self,
        problem: &mut Problem,
        h: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> (ErrorEstimate, usize) {
        let work = self.methods.work(pace);
        self.work += work;
        pace.until_look -= work;
        let tolerance = Tolerance { relative: settings.relative_tolerance, nominals: &self.nominals };
        self.methods.in_force(pace).attempt(problem, &self.start, h, tolerance)
    }

    /// Chooses the method of a substep that begins where the problem stands.
    fn begin(
        &mut self,
        problem: &Problem,
        t: f64,
        way: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> Result<(), StepError> {
        let asked = (settings.method, way, settings.relative_tolerance);
        let begun = self.methods.begin(problem, &self.start, asked, pace);
        self.work += begun.map_err(|state| StepError::NoJacobian { variable: state_name(problem, state), time: t })?;
        Ok(())
    }

    /// Whether the system's own step is impossible after an attempt, or no longer pays for the length h that is left. The
    /// problem then stands at the substep's start.
    fn own_step_ends(&self, problem: &mut Problem, t: f64, (h, relative_tolerance): (f64, f64), error: f64) -> bool {
        if !self.methods.by_itself() {
            return false;
        }
        problem.states().copy_from_slice(&self.start.states);
        problem.evaluate(t);
        !error.is_finite() || !problem.system.own_step_pays(h, relative_tolerance, &problem.values())
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
        pace: &mut Pace,
    ) -> Result<bool, StepError> {
        let [before, after, _] = &mut self.indicators;
        problem.event_indicators(end, after);
        if !any_crossed(before, after) {
            std::mem::swap(before, after);
            *t = end;
            return Ok(false);
        }
        let (mut low, mut high) = (0.0, end - *t);
        let width = (EVENT_PRECISION * high).max(4.0 * f64::EPSILON * end.abs()).max(SHORTEST);
        let mut bisect = false;
        while high - low > width {
            let gap = high - low;
            let part = if bisect { 0.5 } else { first_crossing(&self.indicators[0], &self.indicators[1]) };
            let h = (low + gap * part).clamp(low + 0.25 * width, high - 0.25 * width);
            self.attempt(problem, h, settings, pace);
            let [before, after, between] = &mut self.indicators;
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
        self.attempt(problem, high, settings, pace);
        // The indicators at the bracket's end are those that stand in `after`.
        self.note_crossed();
        *t = self.start.time + high;
        Ok(true)
    }
}

/// Counts events that have no time between them.
struct EventCount {
    /// Time that counts as none, and how far behind a step's end a time event still belongs to it.
    slack: f64,
    limit: usize,
    count: usize,
    last: f64,
}

impl EventCount {
    fn another(&mut self, t: f64) -> Result<(), StepError> {
        self.count = if t - self.last > self.slack { 1 } else { self.count + 1 };
        self.last = t;
        if self.count > self.limit { Err(StepError::TooManyEvents { events: self.limit, time: t }) } else { Ok(()) }
    }

    fn time_event_due(&self, problem: &Problem, t: f64, t1: f64) -> bool {
        let event = problem.next_time_event();
        event <= t || (t == t1 && event <= t1 + self.slack)
    }
}

/// Factor to the next substep from a scaled error.
fn growth(scaled: f64, order: i32) -> f64 {
    // Below this error the factor is at its limit: no power to take.
    if scaled < 1e-6 { GROW } else { (SAFETY * scaled.powf(-1.0 / f64::from(order))).clamp(SHRINK, GROW) }
}

/// How far t may lie before a time event that it is meant to be: a master rounds.
fn rounding(t: f64) -> f64 {
    EVENT_PRECISION * t.abs()
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

pub(crate) fn check_divergence(problem: &mut Problem, time: f64, limit: f64) -> Result<(), StepError> {
    let offender = problem.states().iter().position(|x| x.is_nan() || x.abs() > limit);
    let Some(place) = offender else { return Ok(()) };
    let value = problem.states()[place];
    Err(StepError::Diverged { variable: state_name(problem, place), value, time })
}

fn state_name(problem: &Problem, place: usize) -> String {
    problem.variables.real_at(Section::State, place).map_or(String::new(), |element| element.name())
}
