//! The C side of the functions of model exchange.

use super::boundary::{array, array_mut, call, null, ok};
use super::calls::Answer;
use super::calls::Function;
use super::instance::Instance;
use super::types::{Boolean, Component, EventInfo, FALSE, Status};

/// fmi2EnterEventMode
pub fn enter_event_mode(c: Component) -> Status {
    call(c, Function::EnterEventMode, |instance| {
        instance.enter_event_mode();
        Ok(Status::Ok)
    })
}

/// fmi2NewDiscreteStates
///
/// # Safety
/// `info` is NULL or that of an event information.
pub unsafe fn new_discrete_states(c: Component, info: *mut EventInfo) -> Status {
    call(c, Function::NewDiscreteStates, |instance| {
        // SAFETY: as this function asks of its caller.
        let info = unsafe { info.as_mut() }.ok_or_else(|| null(instance, Function::NewDiscreteStates))?;
        *info = instance.new_discrete_states()?;
        Ok(Status::Ok)
    })
}

/// fmi2EnterContinuousTimeMode
pub fn enter_continuous_time_mode(c: Component) -> Status {
    call(c, Function::EnterContinuousTimeMode, |instance| ok(instance.enter_continuous_time_mode()))
}

/// fmi2CompletedIntegratorStep: a unit never asks to end the simulation.
///
/// # Safety
/// Both pointers are NULL or those of a Boolean.
pub unsafe fn completed_integrator_step(
    c: Component,
    enter_event_mode: *mut Boolean,
    terminate_simulation: *mut Boolean,
) -> Status {
    call(c, Function::CompletedIntegratorStep, |instance| {
        // SAFETY: as this function asks of its caller.
        let (enter, terminate) = unsafe { enter_event_mode.as_mut().zip(terminate_simulation.as_mut()) }
            .ok_or_else(|| null(instance, Function::CompletedIntegratorStep))?;
        (*enter, *terminate) = (Boolean::from(instance.completed_integrator_step()?), FALSE);
        Ok(Status::Ok)
    })
}

/// fmi2SetTime
pub fn set_time(c: Component, time: f64) -> Status {
    call(c, Function::SetTime, |instance| ok(instance.set_time(time)))
}

/// fmi2SetContinuousStates
///
/// # Safety
/// `states` is that of `count` numbers.
pub unsafe fn set_continuous_states(c: Component, states: *const f64, count: usize) -> Status {
    call(c, Function::SetContinuousStates, |instance| {
        // SAFETY: as this function asks of its caller.
        let states = unsafe { array(states, count) }.ok_or_else(|| null(instance, Function::SetContinuousStates))?;
        ok(instance.set_continuous_states(states))
    })
}

/// A function that writes numbers.
///
/// # Safety
/// `values` is that of `count` numbers.
unsafe fn get(
    c: Component,
    function: Function,
    values: *mut f64,
    count: usize,
    body: impl FnOnce(&mut Instance, &mut [f64]) -> Answer<Status>,
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let values = unsafe { array_mut(values, count) }.ok_or_else(|| null(instance, function))?;
        body(instance, values)
    })
}

/// fmi2GetDerivatives
///
/// # Safety
/// `derivatives` is that of `count` numbers.
pub unsafe fn get_derivatives(c: Component, derivatives: *mut f64, count: usize) -> Status {
    // SAFETY: as this function asks of its caller.
    unsafe { get(c, Function::GetDerivatives, derivatives, count, Instance::get_derivatives) }
}

/// fmi2GetEventIndicators
///
/// # Safety
/// `indicators` is that of `count` numbers.
pub unsafe fn get_event_indicators(c: Component, indicators: *mut f64, count: usize) -> Status {
    // SAFETY: as this function asks of its caller.
    unsafe { get(c, Function::GetEventIndicators, indicators, count, Instance::get_event_indicators) }
}

/// fmi2GetContinuousStates
///
/// # Safety
/// `states` is that of `count` numbers.
pub unsafe fn get_continuous_states(c: Component, states: *mut f64, count: usize) -> Status {
    // SAFETY: as this function asks of its caller.
    unsafe { get(c, Function::GetContinuousStates, states, count, Instance::get_continuous_states) }
}

/// fmi2GetNominalsOfContinuousStates
///
/// # Safety
/// `nominals` is that of `count` numbers.
pub unsafe fn get_nominals_of_continuous_states(c: Component, nominals: *mut f64, count: usize) -> Status {
    // SAFETY: as this function asks of its caller.
    unsafe { get(c, Function::GetNominalsOfContinuousStates, nominals, count, Instance::get_nominals) }
}
