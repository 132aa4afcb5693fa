//! Angles in a plain MRAC: ψ is read nearest to the reference model's, and counted from an origin that moves to the reference.
//!
//! ψ_l = x_m,ψ + wrap(ψ − c − x_m,ψ) with the origin c takes the place of ψ, r_l = ψ_l + wrap(r − c − ψ_l) that of its reference.
//! Where |r_l| is beyond the range, c += r_l, x_m,ψ −= r_l, and σ̂ takes over what θ̂ φ(x) loses: the control doesn't jump.
#![allow(non_snake_case)] // matrices have the names of the field

use super::Mrac;
use crate::controllers::l1::{Regressor, infinity_norm};
use crate::controllers::origins::Angle;
use crate::mathematics::limits::within;
use crate::system::{Point, Scalar, Values};

impl Mrac {
    /// True if an output is an angle.
    pub(super) fn is_angle(&self, channel: usize) -> bool {
        self.origins.iter().flat_map(|origins| origins.angles()).any(|angle| angle.channel == channel)
    }

    /// An element of the measured state, angles counted from their origins.
    pub(super) fn state<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        let x = v[self.x][k];
        self.origins.as_ref().map_or(x, |origins| origins.local(k, x, v[self.x_m][k], v))
    }

    /// The measured state, angles counted from their origins.
    pub(super) fn states<'a, S: Scalar>(&'a self, v: &'a Values<'a, S>) -> impl Iterator<Item = S> + 'a {
        (0..self.x.len()).map(move |k| self.state(k, v))
    }

    /// A reference, counted as its output is.
    pub(super) fn reference<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let r = v[self.r][channel];
        self.origins.as_ref().map_or(r, |origins| origins.local_reference(channel, r, |k| self.state(k, v), v))
    }

    /// The reference model starts where the plant is. Angles are counted from 0, or from their reference where they or that are far
    /// from 0.
    pub(super) fn start_model<S: Scalar>(&self, v: &mut Point<S>) {
        v.copy(self.x, self.x_m);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let psi = v[self.x][angle.state].wrap();
            let there = psi + (v[self.r][angle.channel] - psi).wrap();
            origins.start(angle, there, &[psi, there], v);
            let origin = origins.of_state(angle.state, &v.values());
            v[self.x_m][angle.state] = psi - origin;
        }
    }

    /// Puts the reference model where the plant is.
    pub(super) fn put_model<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.x.len() {
            let x = self.state(k, &v.values());
            v[self.x_m][k] = x;
        }
    }

    pub(super) fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = &self.origins {
            origins.event_indicators(|angle| self.reference(angle.channel, v), v, z);
        }
    }

    /// Moves origins to references that are far from them.
    pub(super) fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(origins) = &self.origins {
            origins.event(|angle, v| self.reference(angle.channel, v), |angle, by, v| self.move_along(angle, by, v), v);
        }
    }

    /// x_m,ψ −= Δ and σ̂ += θ̂ (φ(x) − φ(x − Δ)), as far as its bound allows.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        let norm = |v: &Point<S>| infinity_norm(self.states(&v.values()));
        let before = norm(v);
        origins.shift(angle, by, v);
        v[self.x_m][angle.state] -= by;
        v[self.samples.x_m_before][angle.state] -= by;
        let (column, lost) = match self.regressor {
            Regressor::State => (angle.state, self.regressor_gains.get(angle.state).map_or(by, |&gain| by * gain)),
            Regressor::InfinityNorm => (0, before - norm(v)),
        };
        for i in 0..self.u.len() {
            let (theta, bound) = (v[self.theta_hat.at(i, column)], v[self.design.sigma_bound][i]);
            v[self.sigma_hat][i] = within(v[self.sigma_hat][i] + theta * lost, -bound, bound);
        }
    }
}
