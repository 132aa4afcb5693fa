//! Angles in an L1 law, and the reading of their references.
//!
//! ψ_l = x̂_ψ + wrap(ψ − c − x̂_ψ) with the origin c takes the place of ψ, r_l = ψ_l + wrap(r − c − ψ_l) that of its
//! reference. If |r_l| exceeds the range, c += r_l, x̂_ψ −= r_l and u_ad −= K_m[:, ψ] r_l: the control doesn't jump.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::infinity_norm;
use super::law::Law;
use super::structure::{Baseline, L1Structure, PlantMatrices};
use crate::controllers::angles::Angles;
use crate::controllers::origins::{self, Angle};
use crate::system::{DesignReport, Invalid, Point, Scalar, Values};

impl L1Structure {
    /// The states that are angles, by the units of all states.
    ///
    /// # Errors
    /// A state that can't be one.
    pub(in crate::controllers) fn angles(
        &self,
        plant: &PlantMatrices,
        units: &[&'static str],
    ) -> Result<(Angles, Vec<Angle>), Invalid> {
        let angles = Angles::of(self.named_angles(), "x", units)?;
        let has_feedback = self.baseline != Baseline::None;
        // Elsewhere the desired dynamics aren't those of an angle about another origin.
        let moves =
            |k: usize| has_feedback && plant.A.as_ref().is_some_and(|A| A.column(k).iter().all(|entry| *entry == 0.0));
        let turning = origins::shown(&angles, &plant.C, moves)?;
        Ok((angles, turning))
    }
}

impl Law {
    /// An element of the measured state, angles counted from their origins.
    pub fn x<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        self.counted(k, v[self.ports.x][k], v)
    }

    /// The measured state, angles counted from their origins.
    pub fn state<'a, S: Scalar>(&'a self, v: &'a Values<'a, S>) -> impl Iterator<Item = S> + 'a {
        (0..self.x_hat.len()).map(move |k| self.x(k, v))
    }

    /// The reference of a channel, counted as its output is.
    pub(super) fn reference<S: Scalar>(&self, channel: usize, r: S, v: &Values<S>) -> S {
        let psi = |state: usize| self.x(state, v);
        self.origins.as_ref().map_or(r, |origins| origins.local_reference(channel, r, psi, v))
    }

    /// References, counted as their outputs are.
    pub fn references<'a, S: Scalar>(&'a self, r: &'a [S], v: &'a Values<'a, S>) -> impl Iterator<Item = S> + 'a {
        r.iter().enumerate().map(move |(channel, &r)| self.reference(channel, r, v))
    }

    /// e = r − C x of a channel, within half a turn where that is an angle.
    pub fn error<S: Scalar>(&self, channel: usize, r: S, v: &Values<S>) -> S {
        let error = r - self.output(channel, v);
        let is_angle = self.origins.iter().flat_map(|origins| origins.angles()).any(|angle| angle.channel == channel);
        if is_angle { error.wrap() } else { error }
    }

    /// The predictor starts at the measured state. Angles are counted from 0, or from their reference where they or that are far
    /// from 0.
    pub fn start_predictor<S: Scalar>(&self, v: &mut Point<S>) {
        v.copy(self.ports.x, self.x_hat);
        if let Some(jumps) = &self.jumps {
            jumps.begin(v);
        }
        let Some(origins) = &self.origins else { return };
        for angle in origins.angles() {
            let (psi, r) = (v[self.ports.x][angle.state], v[self.ports.r][angle.channel]);
            let there = psi + (r - psi).wrap();
            origins.start(angle, there, &[psi, r], v);
            let origin = origins.of_state(angle.state, &v.values());
            v[self.x_hat][angle.state] = psi - origin;
        }
    }

    /// Puts the predictor at the measured state, for a take-over.
    pub(super) fn put_predictor<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.x_hat.len() {
            let x = self.x(k, &v.values());
            v[self.x_hat][k] = x;
        }
    }

    /// The angle that its origin goes by: the reference.
    fn counts<S: Scalar>(&self, angle: Angle, v: &Values<S>) -> S {
        self.reference(angle.channel, v[self.ports.r][angle.channel], v)
    }

    pub(super) fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = &self.origins {
            origins.event_indicators(|angle| self.counts(angle, v), v, z);
        }
    }

    /// Moves origins to references that are far from them, with what a unit has besides.
    pub(super) fn move_origins<S: Scalar>(&self, other: impl Fn(Angle, S, &mut Point<S>), v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        let move_along = |angle: Angle, by: S, v: &mut Point<S>| {
            self.move_along(angle, by, v);
            other(angle, by, v);
        };
        origins.event(|angle, v| self.counts(angle, v), move_along, v);
    }

    /// A value of a state, counted as the measured one is: of an angle, the one nearest to the predicted one.
    pub fn counted<S: Scalar>(&self, k: usize, value: S, v: &Values<S>) -> S {
        self.origins.as_ref().map_or(value, |origins| origins.local(k, value, v[self.x_hat][k], v))
    }

    /// Reports how angles are counted.
    pub fn report_angles(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.origins.iter().for_each(|origins| origins.report(self.ports.x, v, report));
    }

    /// x̂_ψ −= Δ and u_ad −= K_m[:, ψ] Δ.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        let Some(origins) = &self.origins else { return };
        for i in 0..self.u_ad.len() {
            let at_once = self.at_once_of_estimates(i, &v.values());
            self.add_to_filter(i, at_once, v);
        }
        origins.shift(angle, by, v);
        v[self.x_hat][angle.state] -= by;
        for i in 0..self.u_ad.len() {
            let values = v.values();
            let feedback = self.design.K_m(&values).map_or(S::from(0.0), |K_m| K_m[(i, angle.state)] * by);
            let at_once = self.at_once_of_estimates(i, &values);
            self.add_to_filter(i, -(feedback + at_once), v);
        }
    }

    /// The direct part of η̂_2 in u_ad of a channel, by the estimates as they are.
    fn at_once_of_estimates<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let norm = infinity_norm(self.state(v));
        self.at_once(i, v, |unmatched, k| unmatched.estimate(k, norm, v))
    }

    /// Adds to what the filter of a channel gives, along the state in which it rests: it goes on as if it had always given that.
    fn add_to_filter<S: Scalar>(&self, i: usize, added: S, v: &mut Point<S>) {
        for (k, &rest) in self.filter_at_rest.iter().enumerate() {
            v[self.f][i * self.filter.order() + k] += added * rest;
        }
    }
}
