//! C side of functions in addition to the standard's: an instance gives a host the functions to compile, and gets back
//! the compiled ones; and it takes several communication steps in one call.

use std::ffi::{CString, c_void};

use super::boundary::{array, array_mut, call};
use super::calls::Function;
use super::instance::Instance;
use super::types::{Boolean, Component, FALSE, Reply, Status, TRUE, ValueReference};
use super::{describe, floating_point, panics};
use crate::kernel::Kernel;

/// Replies with the functions to compile for a kernel of an instance's equations: for any parameters, or for those that
/// it has in common with another instance, or with itself, at present. Returns true if it did.
///
/// # Safety
/// The instance is alive and in no other call, and so is the other one, if it isn't NULL; `reply` may be called with
/// `context`.
pub unsafe fn kernel_functions(c: Component, other: Component, reply: Option<Reply>, context: *mut c_void) -> Boolean {
    // SAFETY: as this function asks of its caller.
    let (instance, other) = unsafe { (c.cast::<Instance>().as_ref(), other.cast::<Instance>().as_ref()) };
    let Some((instance, reply)) = instance.zip(reply) else { return FALSE };
    let Ok(text) = panics::contain(|| describe::kernel(instance.kernel_functions(other))) else {
        return FALSE;
    };
    let Ok(text) = CString::new(text) else { return FALSE };
    // SAFETY: the caller's own function, with its own context; the text lives until it returns.
    floating_point::as_the_host(|| unsafe { reply(context, text.as_ptr()) });
    TRUE
}

/// Has an instance evaluate its equations by a kernel from now on. Returns false if the kernel isn't one of its model
/// or is for other parameters. The instance drops a kernel when a parameter changes that it is for.
///
/// # Safety
/// The instance is alive and in no other call. The kernel is NULL or what was compiled from what an instance of this model
/// replied, by this very library, and stays in memory as long as the instance lives.
pub unsafe fn take_kernel(c: Component, kernel: *const Kernel) -> Boolean {
    // SAFETY: as this function asks of its caller.
    let (instance, kernel) = unsafe { (c.cast::<Instance>().as_mut(), kernel.as_ref()) };
    let taken = |(instance, kernel): (&mut Instance, &Kernel)| {
        // Before a panic nothing is taken; the generic equations stay.
        panics::contain(|| instance.take_kernel(*kernel)).unwrap_or(false)
    };
    if instance.zip(kernel).is_some_and(taken) { TRUE } else { FALSE }
}

/// True if an instance evaluates its equations by a kernel.
///
/// # Safety
/// The instance is alive and in no other call.
pub unsafe fn has_kernel(c: Component) -> Boolean {
    // SAFETY: as this function asks of its caller.
    let instance = unsafe { c.cast::<Instance>().as_ref() };
    if instance.is_some_and(Instance::has_kernel) { TRUE } else { FALSE }
}

/// Takes communication steps from the first of `count` times to the last, and writes `width` values of any type but texts
/// behind each, one row a step. Returns the number of steps that were taken. For what isn't taken, the message of an
/// ordinary step gives the reason.
///
/// # Safety
/// The instance is alive and in no other call. All pointers are those of as many elements as there are: times, references, and
/// `width` times the number of steps.
pub unsafe fn do_steps(
    c: Component,
    times: *const f64,
    count: usize,
    references: *const ValueReference,
    width: usize,
    rows: *mut f64,
) -> usize {
    let mut taken = 0;
    call(c, Function::DoStep, |instance| {
        let Some(values) = count.saturating_sub(1).checked_mul(width) else { return Ok(Status::Ok) };
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(times, count).zip(array(references, width)).zip(array_mut(rows, values)) };
        if let Some(((times, references), rows)) = arrays {
            taken = instance.do_steps(times, references, rows);
        }
        Ok(Status::Ok)
    });
    taken
}
