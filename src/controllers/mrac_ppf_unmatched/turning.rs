//! Angles in an MRAC for unmatched uncertainty: ψ is read nearest to the reference model's, and counted from an origin that moves to
//! the reference.
//!
//! ψ_l = x_m,ψ + wrap(ψ − c − x_m,ψ) with the origin c takes the place of ψ, r_l = ψ_l + wrap(r − c − ψ_l) that of its reference.
//! Where |r_l| is beyond the range, c += r_l, x_m,ψ −= r_l, and σ̂_i += θ̂_ψ,i r_l: neither α nor the control jumps.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::MracPpfUnmatched;
use super::structure::{PlantMatrices, UnmatchedStructure};
use crate::controllers::angles::{Angles, Jumps};
use crate::controllers::origins::{self, Angle, Origins};
use crate::mathematics::limits::within;
use crate::system::{Declaration, Invalid, Point, Scalar, Values};

impl UnmatchedStructure {
    /// The states that are angles, by the units of all states.
    ///
    /// # Errors
    /// A state that can't be one.
    pub(super) fn angles(
        &self,
        plant: &PlantMatrices,
        units: &[&'static str],
    ) -> Result<(Angles, Vec<Angle>), Invalid> {
        let angles = Angles::of(&self.angles, "x", units)?;
        if let Some(driven) = plant.unmatched.iter().find(|driven| angles.has(driven.by)) {
            let allowed =
                format!("must not drive an unmatched row: a turn of it is no turn for row {}", driven.row + 1);
            return Err(Invalid::new("angles", driven.by + 1, allowed));
        }
        let moves = |state: usize| plant.A.column(state).iter().all(|entry| *entry == 0.0);
        let turning = origins::shown(&angles, &plant.C, moves)?;
        Ok((angles, turning))
    }
}

impl MracPpfUnmatched {
    /// With origins of its angles, and a watch on those that aren't declared.
    pub(super) fn turning(
        self,
        (turning, angles): (Vec<Angle>, Angles),
        units: &[&'static str],
        d: &mut Declaration,
    ) -> Self {
        let origins = Origins::declare(d, turning, "a reference");
        let jumps = Jumps::declare(d, self.x, units, &angles);
        MracPpfUnmatched { origins, jumps, ..self }
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

    /// Begins to count angles, from 0, or from their reference where they or that are far from 0, and to watch the others.
    pub(super) fn start_origins<S: Scalar>(&self, v: &mut Point<S>) {
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

    /// Puts the reference model where it is given: an angle nearest to the plant's, where the model was put before.
    pub(super) fn give_model<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.x.len() {
            let (values, given, psi) = (v.values(), v[self.x_m0][k], v[self.x_m][k]);
            let place = self.origins.as_ref().map_or(given, |origins| origins.local(k, given, psi, &values));
            v[self.x_m][k] = place;
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

    /// x_m,ψ −= Δ and σ̂_i += θ̂_ψ,i Δ, as far as its bound allows.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        origins.shift(angle, by, v);
        v[self.x_m][angle.state] -= by;
        for i in 0..self.x.len() {
            let (lost, bound) = (v[self.theta_hat.at(angle.state, i)] * by, v[self.sigma_bound][i]);
            v[self.sigma_hat][i] = within(v[self.sigma_hat][i] + lost, -bound, bound);
        }
    }
}
