//! Angles in the sampled L1 law: ψ is read nearest to what it was at the last sample, and origins move at samples.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::L1Sampled;
use super::filter::SampledFilter;
use crate::controllers::angles::{Angles, Jumps};
use crate::controllers::origins::Angle;
use crate::system::{Declaration, Point, Scalar, Values};

impl L1Sampled {
    /// Watches angles that aren't declared.
    pub(super) fn watching(self, units: &[&'static str], angles: &Angles, d: &mut Declaration) -> Self {
        let jumps = Jumps::declare(d, self.x, units, angles);
        L1Sampled { jumps, ..self }
    }

    /// True if an output is an angle.
    pub(super) fn is_angle(&self, channel: usize) -> bool {
        self.origins.iter().flat_map(|origins| origins.angles()).any(|angle| angle.channel == channel)
    }

    /// An element of the measured state, angles counted from their origins.
    pub(super) fn state<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        let x = v[self.x][k];
        self.origins.as_ref().map_or(x, |origins| origins.local(k, x, v[self.x_before][k], v))
    }

    /// A reference, counted as its output was at the last sample.
    pub(super) fn reference<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let (r, near) = (v[self.r][channel], |k: usize| v[self.x_before][k]);
        self.origins.as_ref().map_or(r, |origins| origins.local_reference(channel, r, near, v))
    }

    /// The measured state at the start, angles counted from origins where they or their references are far from 0.
    pub(super) fn start_state<S: Scalar>(&self, v: &mut Point<S>) {
        v.copy(self.x, self.x_before);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let (psi, r) = (v[self.x][angle.state], v[self.r][angle.channel]);
            origins.start(angle, psi + (r - psi).wrap(), &[psi, r], v);
            let origin = origins.of_state(angle.state, &v.values());
            v[self.x_before][angle.state] = psi - origin;
        }
    }

    /// The measured state, for the next sample.
    pub(super) fn keep_state<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.x.len() {
            let x = self.state(k, &v.values());
            v[self.x_before][k] = x;
        }
    }

    /// Moves origins to references that are far from them.
    pub(super) fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(origins) = &self.origins {
            origins.event(|angle, v| self.reference(angle.channel, v), |angle, by, v| self.move_along(angle, by, v), v);
        }
    }

    /// x_{k−1} and x̂ less Δ, and ζ −= K_d[:, ψ] Δ: the control stays.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        origins.shift(angle, by, v);
        v[self.x_before][angle.state] -= by;
        if let Some(predictor) = &self.predictor {
            v[predictor.x_hat][angle.state] -= by;
        }
        for i in 0..self.zeta.len() {
            let feedback = v[self.K_d.at(i, angle.state)] * by;
            v[self.zeta][i] -= feedback;
            if let SampledFilter::General(filter) = &self.filter {
                filter.add(i, -feedback, v);
            }
        }
    }
}
