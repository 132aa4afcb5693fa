//! Projection of θ̂, and a leakage that vanishes with the error: both keep it bounded.
//!
//! θ̂_ji' = γ_1 Proj(θ̂_ji, ε_i R_i x_j − υ_θ R_i |ε_i| θ̂_ji). Without it, noise drives the estimates on and on: ε and the
//! regressor hold the same noise.
#![allow(non_snake_case)] // R has the name of the thesis

use super::MracPpf;
use crate::mathematics::projection::{is_in_layer, projected, projection};
use crate::system::{
    Declaration, Discrete, IntegerOf, Parameter, Point, Scalar, ScalarOf, Values, VectorOf, Warning, integer, scalar,
    vector,
};

/// Bounds and leakage of θ̂, one a channel.
#[derive(Debug)]
pub(super) struct Bounded {
    pub theta_bound: VectorOf<Parameter>,
    /// υ_θ
    pub theta_leakage: VectorOf<Parameter>,
    pub projection_tolerance: ScalarOf<Parameter>,
    projection_active: IntegerOf<Discrete>,
    at_bounds: Warning,
}

impl Bounded {
    /// Parameters of n channels.
    pub fn declare(d: &mut Declaration, n: usize) -> Self {
        let bound = "bound on the magnitude of the estimates theta_hat of a channel; 0 freezes them";
        let leakage = "leakage of theta_hat, which vanishes with the error: it keeps noise from driving the estimates";
        Bounded {
            theta_bound: d.parameter(vector("theta_bound", n, bound).start(1000.0).min(0.0)),
            theta_leakage: d.parameter(vector("theta_leakage", n, leakage).min(0.0)),
            projection_tolerance: d.parameter(
                scalar("projection_tolerance", "width of the layer at the bounds of estimates, in parts of them")
                    .start(0.1)
                    .positive()
                    .max(10.0),
            ),
            projection_active: d.discrete(
                integer("projection_active", "number of estimates that projection keeps within their bounds").output(),
            ),
            at_bounds: d.warning("logProjection", "estimates at their bounds"),
        }
    }
}

impl MracPpf {
    /// γ_1 ε R x_j, and γ_1 υ_θ R |ε|, the rate at which an element of θ̂ leaks.
    fn adapting<S: Scalar>(&self, i: usize, j: usize, (epsilon, R): (S, S), v: &Values<S>) -> (S, S) {
        let gain = v[self.gamma_1][i];
        (gain * epsilon * R * self.state(j, v), gain * R * epsilon.abs() * v[self.bounded.theta_leakage][i])
    }

    /// θ̂' of an element.
    pub(super) fn theta_rate<S: Scalar>(&self, i: usize, j: usize, inside: (S, S), v: &Values<S>) -> S {
        let (theta, (rate, leaks)) = (v[self.theta_hat.at(j, i)], self.adapting(i, j, inside, v));
        let (bound, tolerance) = (v[self.bounded.theta_bound][i], v[self.bounded.projection_tolerance]);
        projection(theta, rate - leaks * theta, -bound, bound, tolerance)
    }

    /// An element of θ̂ a sample time later: what leaks is taken at its end, so that no step is too long for it.
    pub(super) fn theta_after<S: Scalar>(&self, i: usize, j: usize, inside: (S, S), period: S, v: &Values<S>) -> S {
        let (theta, (rate, leaks)) = (v[self.theta_hat.at(j, i)], self.adapting(i, j, inside, v));
        let (bound, tolerance) = (v[self.bounded.theta_bound][i], v[self.bounded.projection_tolerance]);
        let leak = period * leaks;
        projected(theta, (period * rate - leak * theta) / (leak + 1.0), -bound, bound, tolerance)
    }

    /// Counts estimates at their bounds, and warns of them.
    pub(super) fn count_projections<S: Scalar>(&self, v: &mut Point<S>) {
        let Bounded { theta_bound, theta_leakage, projection_tolerance, projection_active, at_bounds } = self.bounded;
        let n = self.x.len();
        let count = (0..n * n).fold(S::from(0.0), |count, k| {
            let (i, j) = (k / n, k % n);
            let bound = v[theta_bound][i];
            let in_layer = is_in_layer(v[self.theta_hat.at(j, i)], -bound, bound, v[projection_tolerance]);
            count + S::from_flag(in_layer)
        });
        v.put(projection_active, count.to_integer());
        v.when(count.above(S::from(0.0)), |v| {
            v.warn(at_bounds, |v| {
                format!(
                    "estimates at their bound: {}. The plant is farther from A than {} allows, or noise drives the estimates: \
                     against noise use {}",
                    count.to_text(),
                    v.name(theta_bound),
                    v.name(theta_leakage)
                )
            });
        });
    }
}
