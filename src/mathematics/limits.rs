//! Limits of a control.

use crate::error::{Invalid, Number};
use crate::system::{Parameter, Scalar, Values, VectorOf};

/// What is no limit: a control beyond 1e12 counts as divergence before it gets there.
pub const UNLIMITED: f64 = 1e15;

/// A value kept within limits.
pub fn within<S: Scalar>(value: S, min: S, max: S) -> S {
    S::branch(value.below(min), || min, || S::branch(value.above(max), || max, || value))
}

/// What is wrong with limits of a control: each smallest value must be below the largest one.
pub fn check(u_min: VectorOf<Parameter>, u_max: VectorOf<Parameter>, v: &Values<f64>) -> Invalid {
    let mut invalid = Invalid::none();
    for (i, (&lo, &hi)) in v[u_min].iter().zip(&v[u_max]).enumerate() {
        if lo >= hi {
            let allowed = format!("must be below {} = {}", v.name(u_max.at(i)), Number(hi));
            invalid.and(Invalid::new(v.name(u_min.at(i)), Number(lo), allowed));
        }
    }
    invalid
}
