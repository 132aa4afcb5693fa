//! Angles in a robust MRAC. ψ and its reference are read nearest to the reference model's angle, e = wrap(ψ − x_m,ψ).
//! The controller uses only differences from x_m. The regressor x of θ̂ grows with turns: it counts ψ from an origin,
//! which moves to the reference, and I takes over the loss of θ̂ᵀx.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::MracPpf;
use crate::controllers::angles::Angles;
use crate::controllers::origins::Angle;
use crate::system::{Point, Scalar, Values};

/// The angles of a state whose elements have channels of their own.
pub(super) fn turning(angles: &Angles, A: &DMatrix<f64>) -> Vec<Angle> {
    let moves = |state: usize| A.column(state).iter().all(|entry| *entry == 0.0);
    angles.each().map(|state| Angle { state, channel: state, moves: moves(state) }).collect()
}

impl MracPpf {
    /// e of a channel.
    pub(super) fn error<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.angles.difference(i, v.difference(self.e, i))
    }

    /// A reference: of an angle, the one nearest to the reference model's.
    pub(super) fn reference<S: Scalar>(&self, j: usize, v: &Values<S>) -> S {
        self.angles.nearest(j, v[self.r][j], v[self.x_m][j])
    }

    /// An element of the measured state: of an angle, nearest to the reference model's, and counted from its origin.
    pub(super) fn state<S: Scalar>(&self, j: usize, v: &Values<S>) -> S {
        let x = v[self.x][j];
        self.origins.as_ref().map_or(x, |origins| origins.local(j, x, v[self.x_m][j] - origins.of_state(j, v), v))
    }

    /// Begins to count angles, from 0, or from their reference where they or that are far from 0, and to watch the others.
    pub(super) fn start_origins<S: Scalar>(&self, v: &mut Point<S>) {
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let (values, near) = (v.values(), v[self.x_m][angle.state]);
            let psi = self.angles.nearest(angle.state, v[self.x][angle.state], near);
            let there = self.reference(angle.channel, &values);
            origins.start(angle, there, &[psi, there], v);
        }
    }

    /// The angle that its origin goes by: the reference.
    fn counts<S: Scalar>(&self, angle: Angle, v: &Values<S>) -> S {
        let origin = self.origins.as_ref().map_or(S::from(0.0), |origins| origins.of_state(angle.state, v));
        self.reference(angle.channel, v) - origin
    }

    pub(super) fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = &self.origins {
            origins.event_indicators(|angle| self.counts(angle, v), v, z);
        }
    }

    /// Moves origins to references that are far from them.
    pub(super) fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(origins) = &self.origins {
            origins.event(|angle, v| self.counts(angle, v), |angle, by, v| self.move_along(angle, by, v), v);
        }
    }

    /// I_:,i += ψ θ̂_ji Δ/|ψ|² with the regressor ψ of σ̂: σ̂ᵀψ gives what θ̂ᵀx loses, so far as there is a ψ.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        origins.shift(angle, by, v);
        let (n, none) = (self.x.len(), S::from(0.0));
        let square = v[self.psi].iter().fold(none, |sum, &psi| sum + psi * psi);
        let part = S::branch(square.above(none), || by / square, || none);
        for i in 0..n {
            let lost = v[self.theta_hat.at(angle.state, i)] * part;
            for j in 0..n {
                let psi = v[self.psi][j];
                v[self.integral.at(j, i)] += psi * lost;
            }
        }
    }
}
