//! Operating points: where an FMU is linearised, how it is reached, and which method finds the matrices.

use serde::Serialize;

use crate::error::Error;
use crate::fmu::{Fmu, Instance, set_starts};

/// The most communication steps for which an input is changed, and for which it has returned.
pub(super) const STEPS: usize = 250;
/// The most communication steps of an experiment.
pub(super) const LONGEST: usize = 2 * STEPS + 1;

/// Operating point at which an FMU is linearised.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OperatingPoint {
    /// Time, s [default: the start time].
    pub time: Option<f64>,
    /// True to find states with zero derivatives at `time`, which free inputs and wanted values imply. Otherwise the
    /// states are those of a simulation until `time`.
    pub steady_state: bool,
    /// Inputs whose values are sought, too.
    pub free: Vec<String>,
    /// Wanted values of outputs, local variables and derivatives; derivatives not listed are zero.
    pub want: Vec<(String, f64)>,
    /// States that keep their start values.
    pub hold: Vec<String>,
    /// Start values of parameters and inputs; inputs keep them.
    pub start: Vec<(String, String)>,
    /// Names of the states, if the description names none [default: all Real outputs].
    pub states: Vec<String>,
    /// Communication step of simulations and experiments, s [default: that of the FMU].
    pub step: Option<f64>,
}

impl OperatingPoint {
    /// True if an operating point is searched for, not simulated.
    pub fn is_sought(&self) -> bool {
        self.steady_state || !self.is_plain()
    }

    /// True if zero derivatives are all that is wanted.
    pub(super) fn is_plain(&self) -> bool {
        self.free.is_empty() && self.want.is_empty() && self.hold.is_empty()
    }

    /// Communication step of simulations and experiments, s.
    pub(super) fn step_of(&self, fmu: &Fmu) -> f64 {
        self.step.unwrap_or_else(|| fmu.step())
    }
}

/// Method that found the matrices.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "by")]
pub enum Method {
    /// The FMU's own derivatives.
    Derivatives,
    /// Central differences of its equations, in model exchange.
    Differences {
        /// Change of each value, in parts of its magnitude.
        part: f64,
    },
    /// Responses to small changes of its inputs, and of start values of its states, in co-simulation.
    Responses {
        /// Change of each of these, in parts of its magnitude or range.
        part: f64,
        /// Number of states whose start values were changed.
        starts: usize,
        /// Communication step, s.
        step: f64,
        /// The largest difference from the linear system's own responses, relative to them.
        misfit: f64,
        /// The largest difference between two extrapolations to no change at all, relative to the largest entry.
        difference: f64,
    },
}

/// An initialised instance with its start values.
pub(super) fn prepared(
    mut instance: Instance,
    point: &OperatingPoint,
    start: f64,
    time: f64,
) -> Result<Instance, Error> {
    set_starts(&instance, &point.start)?;
    // A stop time must be after the start, and no step may go beyond it.
    let span = LONGEST as f64 * point.step_of(instance.fmu());
    instance.enter_initialization(start, time.max(start + 1.0).max(time + span))?;
    instance.exit_initialization()?;
    Ok(instance)
}

/// The instance, stepped to a time.
pub(super) fn simulated(mut instance: Instance, start: f64, time: f64, step: f64) -> Result<Instance, Error> {
    let steps = ((time - start) / step - 1e-6).ceil().max(0.0) as usize;
    let time_of = |k: usize| if k == steps { time } else { start + k as f64 * step };
    for k in 0..steps {
        instance.do_step(time_of(k), time_of(k + 1) - time_of(k))?;
    }
    Ok(instance)
}
