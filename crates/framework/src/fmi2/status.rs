//! The status functions: steps are never asynchronous, so there is little to report.

use std::ffi::c_int;

use super::boundary::{call, null};
use super::calls::Function;
use super::types::{Boolean, Component, Status, status_kind};

/// fmi2GetStatus: nothing is ever pending.
pub fn get_status(c: Component) -> Status {
    call(c, Function::GetStatus, |_| Ok(Status::Discard))
}

/// fmi2GetRealStatus
///
/// # Safety
/// `value` is NULL or that of a number.
pub unsafe fn get_real_status(c: Component, kind: c_int, value: *mut f64) -> Status {
    call(c, Function::GetRealStatus, |instance| {
        // SAFETY: as this function asks of its caller.
        let value = unsafe { value.as_mut() }.ok_or_else(|| null(instance, Function::GetRealStatus))?;
        if kind != status_kind::LAST_SUCCESSFUL_TIME {
            return Ok(Status::Discard);
        }
        Ok(instance.last_successful_time(value))
    })
}

/// fmi2GetIntegerStatus: there is no such status.
pub fn get_integer_status(c: Component) -> Status {
    call(c, Function::GetIntegerStatus, |_| Ok(Status::Discard))
}

/// fmi2GetBooleanStatus: a unit never asks to end the simulation.
///
/// # Safety
/// `value` is NULL or that of a Boolean.
pub unsafe fn get_boolean_status(c: Component, kind: c_int, value: *mut Boolean) -> Status {
    call(c, Function::GetBooleanStatus, |instance| {
        // SAFETY: as this function asks of its caller.
        let value = unsafe { value.as_mut() }.ok_or_else(|| null(instance, Function::GetBooleanStatus))?;
        if kind != status_kind::TERMINATED {
            return Ok(Status::Discard);
        }
        *value = Boolean::from(false);
        Ok(Status::Ok)
    })
}

/// fmi2GetStringStatus: nothing is ever pending.
pub fn get_string_status(c: Component) -> Status {
    call(c, Function::GetStringStatus, |_| Ok(Status::Discard))
}
