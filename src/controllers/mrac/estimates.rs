//! The estimates, one by one, with their bounds: of κ̂, then of θ̂ by columns, then of σ̂.

use super::Mrac;
use crate::mathematics::projection::{is_in_layer, projected};
use crate::system::{Point, Scalar, ScalarOf, State, Values};

/// The signal that an estimate is multiplied by in the control.
#[derive(Debug, Clone, Copy)]
pub(super) enum Factor {
    /// An element of u_b.
    Control(usize),
    /// An element of φ(x).
    Regressor(usize),
    /// Nothing.
    One,
}

impl Mrac {
    /// Number of estimates.
    pub(super) fn estimates(&self) -> usize {
        self.entries.len() + self.theta_hat.elements().len() + self.sigma_hat.len()
    }

    /// Its place, the control that it belongs to, and what it is multiplied by.
    pub(super) fn estimate(&self, k: usize) -> (ScalarOf<State>, usize, Factor) {
        if let Some(&(channel, j)) = self.entries.get(k) {
            return (self.kappa_hat.at(k), channel, Factor::Control(j));
        }
        let (k, m) = (k - self.entries.len(), self.sigma_hat.len());
        let of_theta = self.theta_hat.elements();
        if k < of_theta.len() {
            return (of_theta.at(k), k % m, Factor::Regressor(k / m));
        }
        (self.sigma_hat.at(k - of_theta.len()), k - of_theta.len(), Factor::One)
    }

    /// Its bounds. κ = 1 − 1/ω on the diagonal.
    pub(super) fn bounds<S: Scalar>(&self, k: usize, v: &Values<S>) -> (S, S) {
        let about = |bound: S| (-bound, bound);
        if let Some(&(i, j)) = self.entries.get(k) {
            let coupling = || self.design.kappa_coupling.map_or(S::from(0.0), |coupling| v[coupling]);
            let kappa = |omega: S| -omega.recip() + 1.0;
            let of_diagonal = || (kappa(v[self.design.omega_min][i]), kappa(v[self.design.omega_max][i]));
            return if i == j { of_diagonal() } else { about(coupling()) };
        }
        let (k, of_theta) = (k - self.entries.len(), self.design.theta_bound.elements());
        about(if k < of_theta.len() { v[of_theta][k] } else { v[self.design.sigma_bound][k - of_theta.len()] })
    }

    /// u_b − κ̂ u_b − θ̂ φ − σ̂ of a control, by what these are.
    pub(super) fn adapted<S: Scalar>(&self, i: usize, v: &Values<S>, of: impl Fn(Factor) -> S) -> S {
        let all = (0..self.estimates()).map(|k| self.estimate(k)).filter(|(_, channel, _)| *channel == i);
        all.fold(of(Factor::Control(i)), |u, (place, _, factor)| u - v[place] * of(factor))
    }

    /// An estimate after Γ times this integral of s times what it multiplies, and this leak over the same time, which is taken
    /// at its end.
    pub(super) fn after<S: Scalar>(&self, k: usize, driven: S, leak: S, v: &Values<S>) -> S {
        let (place, ..) = self.estimate(k);
        let ((lo, hi), tolerance) = (self.bounds(k, v), v[self.design.projection_tolerance]);
        projected(v[place], (driven - leak * v[place]) / (leak + 1.0), lo, hi, tolerance)
    }

    /// Counts estimates at their bounds, and warns of them.
    pub(super) fn count_projections<S: Scalar>(&self, v: &mut Point<S>) {
        let count = (0..self.estimates()).fold(S::from(0.0), |count, k| {
            let ((place, ..), (lo, hi)) = (self.estimate(k), self.bounds(k, &v.values()));
            count + S::from_flag(is_in_layer(v[place], lo, hi, v[self.design.projection_tolerance]))
        });
        v.put(self.projection_active, count.to_integer());
        v.when(count.above(S::from(0.0)), |v| {
            v.warn(self.at_bounds, |v| {
                let design = &self.design;
                let [omega_min, omega_max, sigma_bound] =
                    [design.omega_min, design.omega_max, design.sigma_bound].map(|it| v.name(it));
                format!(
                    "estimates at a bound: {}. If they stay there, the plant is outside the assumed uncertainty, or noise drives \
                     them. Widen {omega_min} … {omega_max}, {} or {sigma_bound} if tracking suffers; against noise use {}",
                    count.to_text(),
                    v.name(design.theta_bound),
                    v.name(design.leakage)
                )
            });
        });
    }
}
