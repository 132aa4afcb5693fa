//! Angles in an observer: y is read nearest to the estimate, ỹ = wrap(C x̆ − y), and the estimate is counted from an origin that
//! moves along: β_l and δ grow with y and x̆, not with the turns.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;

use super::Observer;
use crate::controllers::angles::{Angles, Jumps};
use crate::controllers::origins::{Angle, Origins};
use crate::mathematics::angle;
use crate::system::{Declaration, Invalid, Point, Scalar, Signals, Values};

/// The states that measured angles are.
///
/// # Errors
/// An output that isn't a state.
pub(super) fn turning(
    angles: &Angles,
    A: &DMatrix<f64>,
    C: &DMatrix<f64>,
    units: &[&'static str],
) -> Result<Vec<Angle>, Invalid> {
    let of = |channel: usize| {
        let row = C.row(channel);
        let state = (0..row.len()).find(|&k| row[k] == 1.0);
        let is_alone = row.iter().filter(|entry| **entry != 0.0).count() == 1;
        let refused = |allowed: &str| Invalid::new("angles", channel + 1, allowed);
        let state = state.filter(|_| is_alone).ok_or_else(|| {
            refused("must be an output that is one of the states: a row of C with 1 there, and 0 elsewhere")
        })?;
        if units[state] != "rad" {
            return Err(refused("must be an output whose state has the unit rad, too"));
        }
        let moves = A.column(state).iter().all(|entry| *entry == 0.0);
        Ok(Angle { state, channel, moves })
    };
    angles.each().map(of).collect()
}

impl Observer {
    /// Watches angles that aren't declared.
    pub(super) fn watching(self, units: &[&'static str], angles: &Angles, d: &mut Declaration) -> Self {
        let jumps = Jumps::declare(d, self.y, units, angles);
        Observer { jumps, ..self }
    }

    /// An element of y: of an angle, what is nearest to the estimate, counted as that is.
    pub(super) fn measured<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let y = v[self.y][channel];
        let angle = self
            .origins
            .as_ref()
            .and_then(|origins| origins.angles().find(|angle| angle.channel == channel).map(|angle| (origins, angle)));
        angle.map_or(y, |(origins, Angle { state, .. })| {
            angle::nearest(y - origins.of_state(state, v), v[self.x_obs][state])
        })
    }

    /// The estimate starts at `x_obs0`; angles far from 0 are counted from there.
    pub(super) fn start_estimate<S: Scalar>(&self, v: &mut Point<S>) {
        v.copy(self.x_obs0, self.x_obs);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let there = v[self.x_obs0][angle.state];
            origins.start(angle, there, &[there], v);
            let origin = origins.of_state(angle.state, &v.values());
            v[self.x_obs][angle.state] = there - origin;
        }
    }

    /// x̆ + c
    pub(super) fn put_out<S: Scalar>(&self, v: &Values<S>, y: &mut Signals<S>) {
        let (Some(whole), Some(origins)) = (self.whole, &self.origins) else { return };
        for k in 0..whole.len() {
            y[whole][k] = v[self.x_obs][k] + origins.of_state(k, v);
        }
    }

    pub(super) fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = &self.origins {
            origins.event_indicators(|angle| v[self.x_obs][angle.state], v, z);
        }
    }

    /// Moves origins to estimates that are far from them.
    pub(super) fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        let move_along = |origins: &Origins, angle: Angle, by: S, v: &mut Point<S>| {
            origins.shift(angle, by, v);
            v[self.x_obs][angle.state] -= by;
        };
        origins.event(|angle, v| v[self.x_obs][angle.state], |angle, by, v| move_along(origins, angle, by, v), v);
    }
}
