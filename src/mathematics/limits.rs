//! Limits of a control.

use crate::system::{NO_LIMIT, Parameter, Point, Scalar, VectorOf};

/// Value of no limit: a control beyond 1e12 counts as divergence before it gets there.
pub const UNLIMITED: f64 = NO_LIMIT;

/// Saturation of a value to limits.
pub fn within<S: Scalar>(value: S, min: S, max: S) -> S {
    S::branch(value.below(min), || min, || S::branch(value.above(max), || max, || value))
}

/// Refuses limits of a control unless each smallest value is below the largest one.
pub fn require_room<S: Scalar>(u_min: VectorOf<Parameter>, u_max: VectorOf<Parameter>, v: &mut Point<S>) {
    (0..u_min.len()).for_each(|i| v.require_below(u_min.at(i), u_max.at(i)));
}
