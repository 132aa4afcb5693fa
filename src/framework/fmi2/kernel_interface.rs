//! The C side of functions beside the standard's: an instance tells a host what its equations are compiled from, and is handed
//! what came of it.

use std::ffi::{CString, c_void};

use super::instance::Instance;
use super::interface::Reply;
use super::types::{Boolean, Component, FALSE, TRUE};
use super::{describe, floating_point, panics};
use crate::kernel::Kernel;

/// Replies what a kernel of an instance's equations is compiled from; whether it did.
///
/// # Safety
/// The instance is alive and in no other call; `reply` may be called with `context`.
pub unsafe fn kernel_functions(c: Component, reply: Option<Reply>, context: *mut c_void) -> Boolean {
    // SAFETY: as this function asks of its caller.
    let instance = unsafe { c.cast::<Instance>().as_mut() };
    let Some((instance, reply)) = instance.zip(reply) else { return FALSE };
    // Nothing of the instance is changed by it.
    let Ok(text) = panics::contain(|| describe::kernel(instance.kernel_functions())) else { return FALSE };
    let Ok(text) = CString::new(text) else { return FALSE };
    // SAFETY: the caller's own function, with its own context; the text lives until it returns.
    floating_point::as_the_host(|| unsafe { reply(context, text.as_ptr()) });
    TRUE
}

/// Has an instance evaluate its equations by a kernel from now on; whether that is one of its model.
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
