//! The estimates of an L1 controller, one by one, with their bounds.

use super::law::Law;
use crate::mathematics::limits::within;
use crate::mathematics::projection;
use crate::system::{Point, Scalar, ScalarOf, State, Values};

/// An estimate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimate<S> {
    pub place: ScalarOf<State>,
    pub bounds: (S, S),
    /// The channel to whose η̂ it adds: of the control, then of the unmatched directions.
    pub channel: usize,
    /// Its factor there.
    pub factor: S,
}

impl<S: Scalar> Estimate<S> {
    /// True if its bounds leave it nowhere to go.
    pub fn is_frozen(&self) -> S::Flag {
        self.bounds.0.equals(self.bounds.1)
    }
}

impl Law {
    /// Number of channels with uncertainty: of the control, and of unmatched directions.
    pub(super) fn channels(&self) -> usize {
        self.directions.ncols()
    }

    /// η̂ of a channel.
    pub(super) fn uncertainty_of(&self, channel: usize, v: &Values<f64>) -> f64 {
        let m = self.eta_hat.len();
        match &self.unmatched {
            Some(unmatched) if channel >= m => v[unmatched.eta_hat][channel - m],
            _ => v[self.eta_hat][channel],
        }
    }

    /// Factor of an element of x in φ(x); none if there is none.
    pub(super) fn regressor_gain(&self, j: usize) -> Option<f64> {
        self.regressor_gains.get(j).copied()
    }

    /// Number of estimates.
    pub(super) fn estimates(&self) -> usize {
        let (m, columns) = self.theta_hat.shape();
        self.omega_entries.len() + m * columns + m + 2 * (self.channels() - m)
    }

    /// One of them: of ω̂, then of θ̂ by columns, then of σ̂, then of θ̂_2 and σ̂_2.
    pub(super) fn estimate<S: Scalar>(&self, k: usize, v: &Values<S>) -> Estimate<S> {
        let (m, columns) = self.theta_hat.shape();
        if let Some(&(channel, j)) = self.omega_entries.get(k) {
            let bounds = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            return Estimate { place: self.omega_hat.at(k), bounds, channel, factor: v[self.v][j] };
        }
        let k = k - self.omega_entries.len();
        let within = |place, bound: S, channel, factor| Estimate { place, bounds: (-bound, bound), channel, factor };
        let channel = k % m;
        if k < m * columns {
            let place = self.theta_hat.at(channel, k / m);
            return within(place, self.design.theta_bounds(k / m, v)[channel], channel, v[self.phi][k / m]);
        }
        let k = k - m * columns;
        match &self.unmatched {
            Some(unmatched) if k >= m => {
                let (of_sigma, i) = ((k - m) / (self.channels() - m), (k - m) % (self.channels() - m));
                if of_sigma == 0 {
                    within(unmatched.theta_hat.at(i), v[unmatched.theta_bound][i], m + i, v[unmatched.norm])
                } else {
                    within(unmatched.sigma_hat.at(i), v[unmatched.sigma_bound][i], m + i, S::from(1.0))
                }
            }
            _ => within(self.sigma_hat.at(channel), v[self.design.sigma_bound][channel], channel, S::from(1.0)),
        }
    }

    /// Sum of the magnitudes of the terms of η̂ in a channel.
    pub(super) fn magnitude(&self, channel: usize, v: &Values<f64>) -> f64 {
        let estimates = (0..self.estimates()).map(|k| self.estimate(k, v)).filter(|e| e.channel == channel);
        estimates.map(|estimate| (v[estimate.place] * estimate.factor).abs()).sum()
    }

    /// Number of estimates in the layer at their bounds in which projection acts.
    pub(super) fn projections<S: Scalar>(&self, v: &Values<S>) -> S {
        let epsilon = v[self.design.projection_tolerance];
        (0..self.estimates()).fold(S::from(0.0), |count, k| {
            let Estimate { place, bounds: (lo, hi), .. } = self.estimate(k, v);
            count + S::from_flag(projection::is_in_layer(v[place], lo, hi, epsilon))
        })
    }

    /// Brings estimates back to tightened bounds, and logs it.
    pub(in crate::controllers) fn clip_estimates<S: Scalar>(&self, v: &mut Point<S>) {
        let clipped = self.bring_within_bounds(v);
        v.when(clipped.above(S::from(0.0)), |v| {
            let text = |_: &Values<S>| {
                format!("{} estimates were outside the new bounds and were moved to them", clipped.to_text())
            };
            v.warn_each_time(self.at_bounds, text);
        });
    }

    /// Number of estimates that lay outside their bounds, and no longer do.
    pub(super) fn bring_within_bounds<S: Scalar>(&self, v: &mut Point<S>) -> S {
        (0..self.estimates()).fold(S::from(0.0), |clipped, k| {
            let Estimate { place, bounds: (lo, hi), .. } = self.estimate(k, &v.values());
            let (before, after) = (v[place], within(v[place], lo, hi));
            v[place] = after;
            clipped + S::from_flag(!after.equals(before))
        })
    }
}
