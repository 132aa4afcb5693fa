//! Limits of a control.

use crate::error::{Invalid, Number};
use crate::system::Scalar;

/// What is no limit: a control beyond 1e12 counts as divergence before it gets there.
pub const UNLIMITED: f64 = 1e15;

/// A value kept within limits.
pub fn within<S: Scalar>(value: S, min: S, max: S) -> S {
    if value.re() < min.re() {
        min
    } else if value.re() > max.re() {
        max
    } else {
        value
    }
}

/// What is wrong with limits named `u_min` and `u_max`: each of the first must be below that of the second.
pub fn check(u_min: &[f64], u_max: &[f64]) -> Invalid {
    let mut invalid = Invalid::none();
    for (i, (&lo, &hi)) in u_min.iter().zip(u_max).enumerate() {
        if lo >= hi {
            let allowed = format!("must be below u_max[{}] = {}", i + 1, Number(hi));
            invalid.and(Invalid::new(format!("u_min[{}]", i + 1), Number(lo), allowed));
        }
    }
    invalid
}
