//! The estimates of an L1 controller, one by one, with their bounds.

use super::L1;
use crate::control::projection;
use crate::system::{Point, ScalarOf, State, Values};

/// An estimate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimate {
    pub place: ScalarOf<State>,
    pub bounds: (f64, f64),
    /// The channel to whose η̂ it adds.
    pub channel: usize,
    /// What it is multiplied by there.
    pub factor: f64,
}

impl L1 {
    /// Number of estimates.
    pub(super) fn estimates(&self) -> usize {
        let (m, columns) = self.theta_hat.shape();
        self.omega_entries.len() + m * columns + m
    }

    /// One of them: of ω̂, then of θ̂ by columns, then of σ̂.
    pub(super) fn estimate(&self, k: usize, v: &Values<f64>) -> Estimate {
        let (m, columns) = self.theta_hat.shape();
        if let Some(&(channel, j)) = self.omega_entries.get(k) {
            let bounds = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            return Estimate { place: self.omega_hat.at(k), bounds, channel, factor: v[self.v][j] };
        }
        let k = k - self.omega_entries.len();
        let channel = k % m;
        if k < m * columns {
            let (bound, column) = (v[self.design.theta_bound][channel], k / m);
            let place = self.theta_hat.at(channel, column);
            return Estimate { place, bounds: (-bound, bound), channel, factor: v[self.phi][column] };
        }
        let bound = v[self.design.sigma_bound][channel];
        Estimate { place: self.sigma_hat.at(channel), bounds: (-bound, bound), channel, factor: 1.0 }
    }

    /// Sum of the magnitudes of what η̂ is made of in a channel.
    pub(super) fn magnitude(&self, channel: usize, v: &Values<f64>) -> f64 {
        let estimates = (0..self.estimates()).map(|k| self.estimate(k, v)).filter(|e| e.channel == channel);
        estimates.map(|estimate| (v[estimate.place] * estimate.factor).abs()).sum()
    }

    /// How many estimates are in the layer at their bounds in which projection acts.
    pub(super) fn projections(&self, v: &Values<f64>) -> usize {
        let epsilon = v[self.design.projection_tolerance];
        let held = |k: &usize| {
            let Estimate { place, bounds: (lo, hi), .. } = self.estimate(*k, v);
            projection::is_in_layer(v[place], lo, hi, epsilon)
        };
        (0..self.estimates()).filter(held).count()
    }

    /// Brings estimates back to tightened bounds, and says so.
    pub(super) fn clip_estimates(&self, v: &mut Point) {
        let clipped = self.bring_within_bounds(v);
        if clipped > 0 {
            let text = format!("{clipped} estimates lay outside the new bounds and were brought to them");
            v.say(self.at_bounds, text);
        }
    }

    /// How many estimates lay outside their bounds, and no longer do.
    pub(super) fn bring_within_bounds(&self, v: &mut Point) -> usize {
        let mut clipped = 0;
        for k in 0..self.estimates() {
            let Estimate { place, bounds: (lo, hi), .. } = self.estimate(k, &v.values());
            let within = v[place].clamp(lo, hi);
            clipped += usize::from(within != v[place]);
            v[place] = within;
        }
        clipped
    }
}
