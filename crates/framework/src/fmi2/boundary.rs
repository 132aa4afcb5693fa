//! Shared parts of all functions of the C side: a call into an instance, and C pointers as slices and texts.

use std::ffi::CStr;
use std::slice;

use super::calls::{Answer, Function, Refused};
use super::instance::Instance;
use super::logger::ERROR;
use super::panics;
use super::types::{Component, Status, StringPointer};

/// Calls into an instance: the table of allowed calls, panics, messages and status, in one place.
pub(crate) fn call(
    component: Component,
    function: Function,
    body: impl FnOnce(&mut Instance) -> Answer<Status>,
) -> Status {
    if component.is_null() {
        return Status::Error;
    }
    let (status, outbox) = {
        // SAFETY: the standard obliges the master to pass what fmi2Instantiate returned and fmi2FreeInstance has not
        // freed, and not to call one instance from two threads simultaneously. It may call from its logger: messages
        // are sent when this reference has ended.
        let instance = unsafe { &mut *component.cast::<Instance>() };
        let status = answer(instance, function, body);
        (status, instance.logger.outbox())
    };
    if let Some(outbox) = outbox {
        outbox.send();
    }
    status
}

fn answer(instance: &mut Instance, function: Function, body: impl FnOnce(&mut Instance) -> Answer<Status>) -> Status {
    if let Err(Refused(reason)) = instance.check(function) {
        instance.logger.log(Status::Error, ERROR, &reason);
        return Status::Error;
    }
    match panics::contain(|| body(instance)) {
        Ok(Ok(status)) => {
            instance.flush_log();
            status
        }
        Ok(Err(Refused(reason))) => {
            instance.flush_log();
            instance.logger.log(Status::Error, ERROR, &reason);
            Status::Error
        }
        Err(fault) => {
            instance.poison();
            let reason =
                format!("{}: internal fault, please report it: {fault}. Free the instance", instance.called(function));
            instance.logger.log(Status::Error, ERROR, &reason);
            Status::Error
        }
    }
}

pub(crate) fn ok(answer: Answer) -> Answer<Status> {
    answer.map(|()| Status::Ok)
}

/// A C array; `None` for NULL with elements.
///
/// # Safety
/// A pointer that isn't NULL points to `len` elements.
pub(crate) unsafe fn array<'a, T>(pointer: *const T, len: usize) -> Option<&'a [T]> {
    match (pointer.is_null(), len) {
        (_, 0) => Some(&[]),
        (true, _) => None,
        // SAFETY: as this function asks of its caller.
        (false, _) => Some(unsafe { slice::from_raw_parts(pointer, len) }),
    }
}

/// A C array to write; `None` for NULL with elements.
///
/// # Safety
/// As [`array`], and nothing else may refer to it.
pub(crate) unsafe fn array_mut<'a, T>(pointer: *mut T, len: usize) -> Option<&'a mut [T]> {
    match (pointer.is_null(), len) {
        (_, 0) => Some(&mut []),
        (true, _) => None,
        // SAFETY: as this function asks of its caller.
        (false, _) => Some(unsafe { slice::from_raw_parts_mut(pointer, len) }),
    }
}

/// A C string; `None` for NULL.
///
/// # Safety
/// A pointer that isn't NULL must be that of a string with its end.
pub(crate) unsafe fn string<'a>(pointer: StringPointer) -> Option<&'a CStr> {
    // SAFETY: as this function asks of its caller.
    (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) })
}

pub(crate) fn null(instance: &Instance, function: Function) -> Refused {
    Refused(format!("{}: a pointer is NULL", instance.called(function)))
}
