//! Angles in the limit of an L1 law, which has no predictor: ψ is read nearest to its origin, ψ_l = wrap(ψ − c). As the origin moves
//! with the reference, that is right while ψ is within 3π/4 of it.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::L1Limit;
use crate::controllers::angles::{Angles, Jumps};
use crate::controllers::origins::Angle;
use crate::system::{Declaration, Invalid, Point, Scalar, Values};

/// Refuses angles whose origin must stay: without a predictor their turn isn't known.
pub(super) fn require_moving(angles: &[Angle]) -> Result<(), Invalid> {
    match angles.iter().find(|angle| !angle.moves) {
        Some(angle) => {
            let allowed = "must be a state that nothing in the nominal dynamics follows from (a column of zeros in A), with a baseline";
            Err(Invalid::new("angles", angle.state + 1, allowed))
        }
        None => Ok(()),
    }
}

impl L1Limit {
    /// Watches angles that aren't declared.
    pub(super) fn watching(self, units: &[&'static str], angles: &Angles, d: &mut Declaration) -> Self {
        let jumps = Jumps::declare(d, self.x, units, angles);
        L1Limit { jumps, ..self }
    }

    /// True if an output is an angle.
    pub(super) fn is_angle(&self, channel: usize) -> bool {
        self.origins.iter().flat_map(|origins| origins.angles()).any(|angle| angle.channel == channel)
    }

    /// An element of the state, angles counted from their origins.
    pub(super) fn state<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        let x = v[self.x][k];
        self.origins.as_ref().map_or(x, |origins| origins.local(k, x, S::from(0.0), v))
    }

    /// A reference, counted as its output is.
    pub(super) fn reference<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let r = v[self.r][channel];
        self.origins.as_ref().map_or(r, |origins| origins.local_reference(channel, r, |k| self.state(k, v), v))
    }

    /// Begins to count angles, and to watch the others.
    pub(super) fn start_origins<S: Scalar>(&self, v: &mut Point<S>) {
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let (psi, r) = (v[self.x][angle.state], v[self.r][angle.channel]);
            origins.start(angle, psi + (r - psi).wrap(), &[psi, r], v);
        }
    }

    pub(super) fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = &self.origins {
            origins.event_indicators(|angle| self.reference(angle.channel, v), v, z);
        }
    }

    /// Moves origins to references that are far from them: f stays, but for u_ad −= K_m[:, ψ] Δ.
    pub(super) fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(origins) = &self.origins {
            origins.event(|angle, v| self.reference(angle.channel, v), |angle, by, v| self.move_along(angle, by, v), v);
        }
    }

    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let (Some(origins), Some(K_m)) = (&self.origins, self.dynamics.gain()) else { return };
        for k in 0..self.w.len() {
            let of_state = v[self.L_in_force.at(k, angle.state)];
            v[self.w][k] += of_state * by;
        }
        let order = self.filter.order();
        for i in 0..self.u.len() {
            let feedback = v[K_m.at(i, angle.state)] * by;
            for (place, &rest) in self.filter_at_rest.iter().enumerate() {
                v[self.w][i * order + place] -= feedback * rest;
            }
        }
        origins.shift(angle, by, v);
    }
}
