//! Step-size control and events: from one communication point to the next.

use std::sync::Arc;

use super::dense::{AtPoint, Dense};
use super::events::EventCount;
use super::fixed::RungeKutta;
use super::indicators::Indicators;
use super::methods::Methods;
use super::outputs::Outputs;
use super::{Chosen, IntegrationMethod, Pace, Problem, Settings, Sparsity, Start, Tolerance};
use crate::error::{Invalid, StepError};
use crate::system::{Causality, DynSystem, ErrorEstimate, Section, Variables};

/// A new substep is this much smaller than the one that would just meet the tolerance.
const SAFETY: f64 = 0.9;
/// The largest change of the substep, down and up.
const SHRINK: f64 = 0.2;
const GROW: f64 = 5.0;
/// A substep that would leave less than this part of the way is stretched to the end.
const STRETCH: f64 = 1.001;
/// Growth within a communication step from which a mode that keeps the step from being finished counts as escaping.
const ESCAPES: f64 = 1e6;
/// Several communication steps in one go end after this work: a master looks at time and values now and then.
pub const SPELL: f64 = 3e7;
/// Number of doublings of the shortest step in the search for the place where the equations cease to hold.
const LOOK_AHEAD: i32 = 12;
/// Shorter substeps can't be halved: their lengths are subnormal numbers.
pub(super) const SHORTEST: f64 = f64::MIN_POSITIVE;

/// Integrates one instance; holds its workspace, and nothing that a continuation depends on.
pub struct Driver {
    pub(super) methods: Methods,
    pub(super) runge_kutta: RungeKutta,
    pub(super) nominals: Vec<f64>,
    pub(super) start: Start,
    outputs: Outputs,
    pub(super) indicators: Indicators,
    pub(super) dense: Dense,
    /// Work so far, in elementary operations, and what of it was before the present communication step.
    pub(super) work: f64,
    pub(super) work_before: f64,
}

impl std::fmt::Debug for Driver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Driver").field("nominals", &self.nominals).finish_non_exhaustive()
    }
}

impl Driver {
    /// A driver for a system whose Jacobian has this pattern.
    pub fn new(system: &dyn DynSystem, variables: &Variables, sparsity: &Arc<Sparsity>) -> Self {
        let states = variables.states();
        let nominal = |k| variables.real_at(Section::State, k).map_or(1.0, |element| element.nominal());
        let nominals: Vec<_> = (0..states).map(nominal).collect();
        Driver {
            methods: Methods::new(system, variables, sparsity, nominals.clone()),
            runge_kutta: RungeKutta::new(states),
            nominals,
            outputs: Outputs::new(variables),
            start: Start { time: 0.0, states: vec![0.0; states], rates: vec![0.0; states] },
            indicators: Indicators::new(variables.indicators().len(), variables),
            dense: Dense::default(),
            work: 0.0,
            work_before: 0.0,
        }
    }

    /// Takes what steps of a problem need, before the first.
    pub fn prepare(&mut self, problem: &Problem, settings: &Settings) {
        if settings.method != IntegrationMethod::Fixed {
            self.methods.prepare(problem);
        }
    }

    /// Takes storage for the kernel that problems come with from now on.
    pub fn take_kernel(&mut self, kernel: &crate::kernel::Kernel) {
        self.methods.take_kernel(kernel);
    }

    /// The present integration method, if it has changed since the last call.
    pub fn news(&mut self) -> Option<Chosen> {
        self.methods.news()
    }

    /// Restarts the reports of the integration method.
    pub fn forget_choices(&mut self) {
        self.methods.forget_choices();
    }

    /// Work of the last advance, in elementary operations.
    pub fn work(&self) -> f64 {
        self.work
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
        self.advance_through(problem, &[t0, t1], settings, pace, &mut |_, _| Ok(())).map(drop)
    }

    /// Advances a problem from the first of these times as far as it goes without a stop at each: to the last, to the first
    /// that isn't before an event, or to one after [`SPELL`]. Returns the place of that time; `at_point` gets the problem at those
    /// before it. More than one step is limited to that work, too. Returns 0 if an event lies so between points that single
    /// steps are needed to locate it; the problem is then anywhere in between.
    ///
    /// # Errors
    /// As [`Driver::advance`].
    pub fn advance_through(
        &mut self,
        problem: &mut Problem,
        times: &[f64],
        settings: &Settings,
        pace: &mut Pace,
        at_point: &mut AtPoint,
    ) -> Result<usize, StepError> {
        let reached = match settings.method {
            IntegrationMethod::Fixed => self.integrate_fixed(problem, (times[0], times[1]), settings).map(|()| 1),
            _ => self.integrate(problem, times, settings, pace, at_point),
        };
        reached.map_err(|error| {
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

    /// True if the equations hold where a substep begins that can't be finished, and a little ahead along its tangent:
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
        times: &[f64],
        settings: &Settings,
        pace: &mut Pace,
        at_point: &mut AtPoint,
    ) -> Result<usize, StepError> {
        let mut events = EventCount::new((times[0], times[1]), settings);
        let (mut t, mut substeps, mut passed) = (times[0], 0, 0);
        let most_work = if times.len() > 2 { settings.most_work.min(SPELL) } else { settings.most_work };
        self.methods.restart();
        (self.work, self.work_before) = (0.0, 0.0);
        self.indicators.restart();
        if self.jumped(problem, t) {
            self.handle_events(problem, (t, times[1]), &mut events, false)?;
        }
        let mut end = events.end_of_way(problem, times);
        self.sides_of_zeros(problem, t, times[end], settings);
        while t < times[end] {
            let t1 = times[end];
            let target = match problem.next_time_event() {
                event if event < t1 - events.slack() => event.max(t),
                _ => t1,
            };
            let state_event = target > t
                && if self.is_at_rest() {
                    self.wait(problem, &mut t, target)
                } else {
                    self.substep(problem, &mut t, target, settings, pace)?
                };
            substeps += 1;
            if self.work - self.work_before > most_work {
                let step = times[1] - times[0];
                return Err(self.overworked(problem, t, step, (events.total(), substeps), pace));
            }
            check_divergence(problem, t, settings.divergence_limit)?;
            if !self.pass(problem, (&times[..=end], &mut passed), (t, state_event), pace, at_point)? {
                return Ok(0);
            }
            if self.work > SPELL {
                end = passed + 1;
            }
            let is_left = settings.leaves_end && t >= t1 && !state_event;
            if !is_left && (state_event || events.time_event_due(problem, t, t1)) {
                // What comes behind an event may be other events.
                end = passed + 1;
                self.handle_events(problem, (t, times[end]), &mut events, state_event)?;
                if t < times[end] {
                    self.sides_of_zeros(problem, t, times[end], settings);
                }
            }
        }
        Ok(end)
    }

    /// Reason why a step of this length reaches only `time` with these events and substeps.
    fn overworked(
        &self,
        problem: &mut Problem,
        time: f64,
        step: f64,
        (events, substeps): (usize, usize),
        pace: &Pace,
    ) -> StepError {
        let followed = self.methods.followed(pace);
        if followed.is_none_or(|mode| mode.growth * step < ESCAPES) {
            let followed = followed.map_or(String::new(), |mode| mode.followed());
            return StepError::TooMuchWork { events, substeps, time, step, followed };
        }
        let sizes = problem.states().iter().zip(&self.nominals).map(|(x, nominal)| x.abs() / nominal);
        let largest = sizes.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(place, _)| place);
        StepError::Diverged { variable: state_name(problem, largest), value: problem.states()[largest], time }
    }

    /// Takes one accepted substep towards `target`. Returns true if it ended at a state event.
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
            let suggested = self.methods.suggested(pace);
            if estimate.scaled <= 1.0 {
                let whole = h == way;
                // The length of a substep that was cut short is no limit for the next, unless it was the limit itself.
                if suggested == 0.0 || h >= suggested {
                    self.methods.suggest(h * growth(estimate.scaled, estimate.order), pace);
                }
                if settings.method == IntegrationMethod::Automatic {
                    self.methods.judge((h, whole), pace);
                }
                let end = if whole { target } else { *t + h };
                return self.locate_event(problem, t, end, settings, pace);
            }
            h *= if estimate.scaled.is_finite() { growth(estimate.scaled, estimate.order).min(SAFETY) } else { SHRINK };
            if self.own_step_ends(problem, *t, (h, settings.relative_tolerance), estimate.scaled) {
                // An impossible substep gives no length for the next.
                if estimate.scaled.is_finite() {
                    pace.own_substep = h;
                }
                self.methods.give_up_own_step();
                self.begin(problem, *t, way, settings, pace)?;
                h = self.first_substep(pace, way, smallest);
                continue;
            }
            self.methods.suggest(h, pace);
            if h <= smallest {
                let (variable, value) = (state_name(problem, state), self.start.states[state]);
                let tolerance = settings.relative_tolerance;
                return Err(StepError::StepTooSmall { time: *t, step: h, tolerance, variable, value });
            }
        }
    }

    /// The substep to try first: the suggested one, limited by the way left and by the eigenvalues.
    fn first_substep(&self, pace: &mut Pace, way: f64, smallest: f64) -> f64 {
        let suggested = self.methods.suggested(pace);
        let longest = self.methods.longest(pace).max(smallest);
        let h = if suggested > 0.0 { suggested.min(longest) } else { longest };
        if h * STRETCH < way { h } else { way }
    }

    /// Attempts a substep, as [`Driver::attempt`]; the error includes that of outputs.
    fn controlled(
        &mut self,
        problem: &mut Problem,
        h: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> (ErrorEstimate, usize) {
        let (mut estimate, state) = self.attempt(problem, h, settings, pace);
        if estimate.scaled <= 1.0 && !self.methods.by_itself() {
            let tolerance = Tolerance { relative: self.tolerated(problem, settings, pace), nominals: &self.nominals };
            let (errors, end) = (self.methods.in_force(pace).errors(), self.start.time + h);
            estimate.scaled = self.outputs.error(problem, end, errors, estimate.scaled, tolerance);
        }
        (estimate, state)
    }

    /// Tries a substep of length h by the method in force, from where the last one ended: its error, and the state that
    /// has it.
    pub(super) fn attempt(
        &mut self,
        problem: &mut Problem,
        h: f64,
        settings: &Settings,
        pace: &mut Pace,
    ) -> (ErrorEstimate, usize) {
        self.work += self.methods.work(pace);
        pace.until_look -= self.methods.typical_work(pace);
        let tolerance = Tolerance { relative: self.tolerated(problem, settings, pace), nominals: &self.nominals };
        self.methods.in_force(pace).attempt(problem, &self.start, h, tolerance)
    }

    /// The error that a substep may have: for a general method, an oscillation that is hardly damped adds up those of many.
    /// Where inputs move, what a master holds or extrapolates errs by more than that.
    fn tolerated(&self, problem: &Problem, settings: &Settings, pace: &Pace) -> f64 {
        let relative = settings.relative_tolerance;
        if problem.moved || self.methods.by_itself() { relative } else { pace.limits.tolerated(relative) }
    }

    /// Chooses the method of a substep from the problem's present point.
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
        self.methods.note(settings.method, t, pace);
        Ok(())
    }

    /// True if the system's own step is impossible after an attempt, or no longer pays for the length h that is left.
    /// The problem is then at the substep's start.
    fn own_step_ends(&self, problem: &mut Problem, t: f64, (h, relative_tolerance): (f64, f64), error: f64) -> bool {
        if !self.methods.by_itself() {
            return false;
        }
        problem.states().copy_from_slice(&self.start.states);
        problem.evaluate(t);
        !error.is_finite()
            || !problem.system.own_step().is_some_and(|own| own.pays(h, relative_tolerance, &problem.values()))
    }
}

/// Factor to the next substep from a scaled error.
fn growth(scaled: f64, order: i32) -> f64 {
    // Below this error the factor is at its limit: no power to take.
    if scaled < 1e-6 { GROW } else { (SAFETY * scaled.powf(-1.0 / f64::from(order))).clamp(SHRINK, GROW) }
}

/// Every state and signal must be a number; every output within the limit.
pub(crate) fn check_values(variables: &Variables, reals: &[f64], time: f64, limit: f64) -> Result<(), StepError> {
    for section in [Section::State, Section::Signal] {
        let values = &reals[variables.reals(section)];
        // At every point of a run: without a branch for each value, it takes a third of the instructions.
        if values.iter().fold(true, |all, value| all & (value.abs() <= limit.min(f64::MAX))) {
            continue;
        }
        let values = values.iter().enumerate();
        for (place, &value) in values.filter(|(_, value)| !value.is_finite() || value.abs() > limit) {
            let Some(element) = variables.real_at(section, place) else { continue };
            if !value.is_finite() || element.variable.causality == Causality::Output {
                return Err(StepError::Diverged { variable: element.name(), value, time });
            }
        }
    }
    Ok(())
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
