//! Angles in a plain MRAC: where a reference is beyond the range of its origin, the origin moves there, x_m,ψ with it, and σ̂ takes
//! over what θ̂ φ(x) loses: the control doesn't jump.
#![allow(non_snake_case)] // matrices have the names of the field

use super::Mrac;
use crate::controllers::l1::{Regressor, infinity_norm};
use crate::controllers::origins::{Angle, Origins, Turning};
use crate::mathematics::limits::within;
use crate::system::{Input, Point, Scalar, State, VectorOf};

impl Turning for Mrac {
    fn origins(&self) -> Option<&Origins> {
        self.origins.as_ref()
    }

    fn inputs(&self) -> [VectorOf<Input>; 2] {
        [self.x, self.r]
    }

    fn model(&self) -> VectorOf<State> {
        self.x_m
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
