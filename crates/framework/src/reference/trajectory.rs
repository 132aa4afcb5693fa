//! A model along its stimuli, integrated by extrapolation as a master of model exchange does: with events at their times.

use std::sync::Arc;

use super::extrapolation::{Extrapolation, Rates, Stuck};
use super::stimuli::{Plan, rounded, set_inputs, set_start};
use crate::execution::Execution;
use crate::integrator::Work;
use crate::model::Model;
use crate::system::Section;

/// An event is located this closely, relative to its step.
const CLOSE: f64 = 1e-12;
/// Updates of the discrete variables at an event, at most.
const MOST_UPDATES: usize = 100;

/// The outputs at the plan's rows, and the times of the events.
pub(super) struct Trajectory {
    /// Values of the outputs, row by row.
    pub rows: Vec<Vec<f64>>,
    /// Times, s.
    pub events: Vec<f64>,
}

/// Accuracy and work of a trajectory.
#[derive(Debug, Clone, Copy)]
pub(super) struct Accuracy {
    /// Bound on the error of each step, relative to state or magnitude.
    pub tolerance: f64,
    /// Change of the states at the start, relative to state or magnitude.
    pub change: f64,
    /// Work that it may take, in elementary operations.
    pub work: f64,
}

/// The reason why there is no trajectory.
pub(super) struct Missing {
    /// In words.
    pub reason: String,
    /// The time until which the work sufficed, s, if it did not for the whole.
    pub reached: Option<f64>,
}

impl From<String> for Missing {
    fn from(reason: String) -> Self {
        Missing { reason, reached: None }
    }
}

/// The trajectory of a model.
///
/// # Errors
/// The reason why there is none.
pub(super) fn trajectory(model: &Arc<Model>, plan: &Plan, accuracy: Accuracy) -> Result<Trajectory, Missing> {
    let mut master = Master::begin(model, plan, accuracy)?;
    let mut rows = Vec::with_capacity(plan.rows.len());
    let points = plan.rows.iter().chain(plan.changes.keys());
    let mut points: Vec<usize> = points.copied().collect();
    points.sort_unstable();
    points.dedup();
    for point in points {
        master.advance(plan.time(point))?;
        if plan.rows.contains(&point) {
            master.equations.execution.evaluate();
            let reals = &master.equations.execution.block().reals;
            rows.push(plan.outputs.iter().map(|output| reals[output.place]).collect());
        }
        if plan.changes.contains_key(&point) {
            set_inputs(&mut master.equations.execution, plan, point);
            master.event()?;
        }
    }
    Ok(Trajectory { rows, events: master.events })
}

/// The equations, and how much work is left for them.
struct Equations {
    execution: Execution,
    evaluation: f64,
    left: f64,
}

impl Rates for Equations {
    fn rates(&mut self, t: f64, states: &[f64], rates: &mut [f64]) -> bool {
        self.left -= self.evaluation;
        self.execution.set_time(t);
        self.execution.set_states(states);
        rates.copy_from_slice(self.execution.derivatives());
        self.left > 0.0
    }
}

impl Equations {
    /// The sides of the event indicators at a time and states.
    fn sides(&mut self, t: f64, states: &[f64], sides: &mut Vec<bool>) {
        self.left -= self.evaluation;
        self.execution.set_time(t);
        self.execution.set_states(states);
        sides.clear();
        sides.extend(self.execution.event_indicators().iter().map(|z| *z > 0.0));
    }
}

struct Master {
    equations: Equations,
    method: Extrapolation,
    time: f64,
    states: Vec<f64>,
    sides: Vec<bool>,
    next_event: Option<f64>,
    events: Vec<f64>,
}

impl Master {
    fn begin(model: &Arc<Model>, plan: &Plan, accuracy: Accuracy) -> Result<Self, String> {
        let mut execution = Execution::new(Arc::clone(model));
        execution.hand_over_integration();
        execution.set_time(0.0);
        set_start(&mut execution, plan);
        execution.initialise().map_err(|error| error.to_string())?;
        execution.begin_model_exchange().map_err(|error| error.to_string())?;
        let method = Extrapolation::new(execution.nominals(), accuracy.tolerance);
        let evaluation = Work::of(model.variables()).evaluation;
        let mut master = Master {
            equations: Equations { execution, evaluation, left: accuracy.work },
            method,
            time: 0.0,
            states: vec![0.0; model.variables().reals(Section::State).len()],
            sides: Vec::new(),
            next_event: None,
            events: Vec::new(),
        };
        master.event()?;
        master.events.clear();
        for (state, nominal) in master.states.iter_mut().zip(master.equations.execution.nominals()) {
            *state += accuracy.change * state.abs().max(*nominal);
        }
        master.equations.sides(0.0, &master.states, &mut master.sides);
        Ok(master)
    }

    /// Goes on to a time, through the events until then.
    fn advance(&mut self, target: f64) -> Result<(), Missing> {
        loop {
            // The end of a step may have been an event already, so that another is next.
            match self.next_event {
                Some(event) if event <= self.time => self.event()?,
                _ if self.time >= target => return Ok(()),
                next => self.step(next.map_or(target, |event| event.min(target)))?,
            }
        }
    }

    /// Takes one step, to an event of an indicator if one is on its way.
    fn step(&mut self, end: f64) -> Result<(), Missing> {
        let (begun, most) = (self.time, end - self.time);
        let before = self.states.clone();
        let length = self
            .method
            .step(&mut self.equations, begun, most, &mut self.states)
            .map_err(|stuck| missing(begun, stuck))?;
        let mut ends = if length >= most { end } else { begun + length };
        let mut sides = Vec::with_capacity(self.sides.len());
        self.equations.sides(ends, &self.states, &mut sides);
        let crossed = sides != self.sides;
        if crossed {
            ends = begun + self.located(begun, ends - begun, &before)?;
        }
        self.time = ends;
        self.equations.execution.set_time(ends);
        self.equations.execution.set_states(&self.states);
        let pending = self.equations.execution.complete_step().map_err(|error| error.to_string())?;
        if crossed || pending { Ok(self.event()?) } else { Ok(()) }
    }

    /// The length of the part of a step behind whose end the first indicator has changed sides; the states are those there then.
    fn located(&mut self, begun: f64, length: f64, before: &[f64]) -> Result<f64, Missing> {
        let (mut low, mut high, mut sides) = (0.0, length, Vec::with_capacity(self.sides.len()));
        while high - low > CLOSE * length && high - low > 2.0 * f64::EPSILON * begun.abs() {
            let middle = 0.5 * (low + high);
            self.part(begun, middle, before)?;
            self.equations.sides(begun + middle, &self.states, &mut sides);
            if sides == self.sides { low = middle } else { high = middle }
        }
        self.part(begun, high, before)?;
        Ok(high)
    }

    fn part(&mut self, begun: f64, length: f64, before: &[f64]) -> Result<(), Missing> {
        self.states.copy_from_slice(before);
        let taken = self.method.part(&mut self.equations, begun, length, &mut self.states);
        taken.map_err(|stuck| missing(begun, stuck))
    }

    /// Handles the event at the present time.
    fn event(&mut self) -> Result<(), String> {
        self.events.push(self.time);
        let execution = &mut self.equations.execution;
        execution.begin_event();
        for updates in 0.. {
            let update = execution.update_discrete().map_err(|error| error.to_string())?;
            self.next_event = update.next_time_event;
            if !update.changed {
                break;
            }
            if updates == MOST_UPDATES {
                return Err(format!("its events at {} s don't end", self.time));
            }
        }
        execution.end_event();
        self.states.copy_from_slice(execution.states());
        self.sides.clear();
        self.sides.extend(execution.event_indicators().iter().map(|z| *z > 0.0));
        self.method.restart();
        Ok(())
    }
}

/// The reason why there is no step.
fn missing(time: f64, stuck: Stuck) -> Missing {
    let shown = rounded(time, 3);
    let reason = match stuck {
        Stuck::Work => format!("a more exact integration takes too long beyond {shown} s"),
        Stuck::Short => format!("a more exact integration finds no step at {shown} s"),
    };
    Missing { reason, reached: (stuck == Stuck::Work).then_some(time) }
}
