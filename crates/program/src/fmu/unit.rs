//! An FMU's functions as a master calls them, in any process.

use std::ffi::c_int;
use std::fmt;

use super::messages::Messages;
use crate::fmi2::calls::Function;
use crate::fmi2::types::{Component, EventInfo, Status};

/// Status of a call as a number, since another tool's FMU may return any.
pub(super) type Answer = c_int;
pub(super) const OK: Answer = Status::Ok as c_int;
pub(super) const WARNING: Answer = Status::Warning as c_int;
pub(super) const DISCARD: Answer = Status::Discard as c_int;

/// A call of a function, with its arguments and the place of its results.
#[derive(Debug)]
pub(super) enum Call<'a> {
    /// A function that takes the instance only.
    Plain(Function),
    SetupExperiment {
        start: f64,
        stop: f64,
    },
    GetReal(&'a [u32], &'a mut [f64]),
    SetReal(&'a [u32], &'a [f64]),
    /// Integers or Booleans.
    GetWhole(Function, &'a [u32], &'a mut [i32]),
    SetWhole(Function, &'a [u32], &'a [i32]),
    SetString(u32, &'a str),
    DoStep {
        time: f64,
        step: f64,
    },
    DirectionalDerivative {
        unknowns: &'a [u32],
        knowns: &'a [u32],
        seed: &'a [f64],
        result: &'a mut [f64],
    },
    /// States, derivatives, event indicators or nominal values.
    GetNumbers(Function, &'a mut [f64]),
    SetContinuousStates(&'a [f64]),
    SetTime(f64),
    NewDiscreteStates(&'a mut EventInfo),
    /// Nonzero if Event Mode, and if the end of the simulation, is requested.
    CompletedIntegratorStep(&'a mut [i32; 2]),
}

impl Call<'_> {
    /// The function that is called.
    pub fn function(&self) -> Function {
        match self {
            Call::Plain(function)
            | Call::GetWhole(function, ..)
            | Call::SetWhole(function, ..)
            | Call::GetNumbers(function, _) => *function,
            Call::SetupExperiment { .. } => Function::SetupExperiment,
            Call::GetReal(..) => Function::GetReal,
            Call::SetReal(..) => Function::SetReal,
            Call::SetString(..) => Function::SetString,
            Call::DoStep { .. } => Function::DoStep,
            Call::DirectionalDerivative { .. } => Function::GetDirectionalDerivative,
            Call::SetContinuousStates(_) => Function::SetContinuousStates,
            Call::SetTime(_) => Function::SetTime,
            Call::NewDiscreteStates(_) => Function::NewDiscreteStates,
            Call::CompletedIntegratorStep(_) => Function::CompletedIntegratorStep,
        }
    }
}

/// An instance of an FMU, in this process or in a separate one.
pub(super) trait RunningUnit: fmt::Debug {
    /// Calls a function. Returns the reason if there is no answer.
    fn call(&self, call: Call<'_>) -> Result<Answer, String>;

    /// Takes steps to these times from the first of them in one go, and writes the values of references behind each. Returns
    /// the number of steps that were taken; 0 where it can't do that.
    fn do_steps(&self, times: &[f64], references: &[u32], rows: &mut [f64]) -> usize {
        let _ = (times, references, rows);
        0
    }

    /// Messages that it logged or wrote since the last call.
    fn messages(&self) -> Messages;

    /// Its component, if it is in this process.
    fn component(&self) -> Option<Component> {
        None
    }

    /// Frees the instance once. Returns the reason if that fails.
    fn free(&mut self) -> Result<(), String>;
}

/// Event information before an FMU has returned any.
pub(super) fn no_event_info() -> EventInfo {
    EventInfo {
        new_discrete_states_needed: 0,
        terminate_simulation: 0,
        nominals_changed: 0,
        values_changed: 0,
        next_event_time_defined: 0,
        next_event_time: 0.0,
    }
}
