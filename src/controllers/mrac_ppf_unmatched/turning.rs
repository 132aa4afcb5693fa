//! Angles in an MRAC for unmatched uncertainty: where a reference is beyond the range of its origin, the origin moves there, x_m,ψ with
//! it, and σ̂_i takes over what θ̂ᵀx loses: neither α nor the control jumps.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::MracPpfUnmatched;
use super::structure::{PlantMatrices, UnmatchedStructure};
use crate::controllers::angles::{Angles, Jumps};
use crate::controllers::origins::{self, Angle, Origins, Turning};
use crate::mathematics::limits::within;
use crate::system::{Declaration, Input, Invalid, Point, Scalar, State, VectorOf};

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
    /// Declares origins of its angles, and watches those that aren't declared.
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

    /// Puts the reference model where it is given: an angle nearest to the plant's, where the model was put before.
    pub(super) fn give_model<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.x.len() {
            let (values, given, psi) = (v.values(), v[self.x_m0][k], v[self.x_m][k]);
            let place = self.origins.as_ref().map_or(given, |origins| origins.local(k, given, psi, &values));
            v[self.x_m][k] = place;
        }
    }
}

impl Turning for MracPpfUnmatched {
    fn origins(&self) -> Option<&Origins> {
        self.origins.as_ref()
    }

    fn inputs(&self) -> [VectorOf<Input>; 2] {
        [self.x, self.r]
    }

    fn model(&self) -> VectorOf<State> {
        self.x_m
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
