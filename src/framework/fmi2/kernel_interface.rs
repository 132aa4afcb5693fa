//! The C side of a function beside the standard's: a host hands an instance its compiled equations.

use super::instance::Instance;
use super::panics;
use super::types::{Boolean, Component, FALSE, TRUE};
use crate::kernel::Kernel;

/// Has an instance evaluate its equations by a kernel from now on; whether that is one of its model.
///
/// # Safety
/// The instance is alive and in no other call. The kernel is NULL or what a compiled
/// [`text`](crate::fmi2::source::kernel::text) of this very library returned, which stays loaded as long as the instance lives.
pub unsafe fn take_kernel(c: Component, kernel: *const Kernel) -> Boolean {
    // SAFETY: as this function asks of its caller.
    let (instance, kernel) = unsafe { (c.cast::<Instance>().as_mut(), kernel.as_ref()) };
    let taken = |(instance, kernel): (&mut Instance, &Kernel)| {
        // Before a panic nothing is taken; the generic equations stay.
        panics::contain(|| instance.take_kernel(*kernel)).unwrap_or(false)
    };
    if instance.zip(kernel).is_some_and(taken) { TRUE } else { FALSE }
}
