//! Angles of a state, counted from origins that move along with them.
//!
//! A vehicle may turn without end, and an angle that is measured may wrap: what differs by whole turns is the same. So an angle is
//! read nearest to a state of the controller, which needs no memory of measurements, and counted from an origin. Norms and feedback
//! grow with an angle. So the origin moves to the reference as soon as that is far from it, and all that depends on the angle
//! moves along.
#![allow(non_snake_case)] // matrices have the names of the thesis

use std::f64::consts::FRAC_PI_4;

use nalgebra::DMatrix;

use super::angles::Angles;
use crate::mathematics::angle;
use crate::system::{
    Declaration, DesignReport, Discrete, Input, Invalid, Parameter, Point, Scalar, ScalarOf, State, Values, VectorOf,
    scalar, vector,
};

/// An event is located to rounding: from here on, in parts of the range, an angle counts as beyond it.
const REACHED: f64 = 1.0 - 1e-9;

/// An angle of a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Angle {
    /// Its place in the state.
    pub state: usize,
    /// The channel of the output, and of its reference, that it is.
    pub channel: usize,
    /// True if its origin may move: where nothing in the nominal dynamics follows from the angle itself.
    pub moves: bool,
}

/// The origins of a state's angles.
#[derive(Debug)]
pub(super) struct Origins {
    angles: Vec<Angle>,
    origin: VectorOf<Discrete>,
    range: ScalarOf<Parameter>,
    /// The first of its event indicators, one an angle.
    indicator: usize,
}

impl Origins {
    /// Origins of these angles, which move by what `of` names, at events of their own; none where there are none.
    pub fn declare(d: &mut Declaration, angles: Vec<Angle>, of: &str) -> Option<Self> {
        Self::sampled(d, angles, of).map(|origins| {
            let names = (1..=origins.angles.len()).map(|k| format!("origin of angle {k}"));
            Origins { indicator: d.indicators(names), ..origins }
        })
    }

    /// The same where they move at samples.
    pub fn sampled(d: &mut Declaration, angles: Vec<Angle>, of: &str) -> Option<Self> {
        let many = angles.len();
        let range = format!("magnitude of {of}, counted from its origin, from which on the origin moves there");
        (many > 0).then(|| Origins {
            range: d.parameter(scalar("origin_range", &range).unit("rad").start(FRAC_PI_4).positive().max(3.0)),
            origin: d.discrete(vector("origin", many, "origin from which an angle is counted").unit("rad")),
            indicator: 0,
            angles,
        })
    }

    fn place(&self, state: usize) -> Option<usize> {
        self.angles.iter().position(|angle| angle.state == state)
    }

    /// An element of the state: of an angle, counted from its origin, the one nearest to a value.
    pub fn local<S: Scalar>(&self, state: usize, x: S, near: S, v: &Values<S>) -> S {
        self.place(state).map_or(x, |k| angle::nearest(x - v[self.origin][k], near))
    }

    /// A reference: of an angle, counted from its origin, the one nearest to that angle.
    pub fn local_reference<S: Scalar>(&self, channel: usize, r: S, psi: impl Fn(usize) -> S, v: &Values<S>) -> S {
        let k = self.angles.iter().position(|angle| angle.channel == channel);
        k.map_or(r, |k| angle::nearest(r - v[self.origin][k], psi(self.angles[k].state)))
    }

    /// The angles.
    pub fn angles(&self) -> impl Iterator<Item = Angle> + '_ {
        self.angles.iter().copied()
    }

    /// True if an output is an angle.
    pub fn has(&self, channel: usize) -> bool {
        self.angles.iter().any(|angle| angle.channel == channel)
    }

    /// Reports how the angles of the measured state x are counted.
    pub fn report(&self, x: VectorOf<Input>, v: &Values<f64>, report: &mut DesignReport) {
        report.section("Angles");
        for angle in &self.angles {
            let name = format!("origin of {}", v.name(x.at(angle.state)));
            if angle.moves {
                let note = format!("it moves to the reference where that is beyond {} from it", v.name(self.range));
                report.add(&name, "moves", "", &note);
            } else {
                let note = "the nominal dynamics follow from the angle itself, or there is no baseline: what the control law \
                            multiplies by the angle grows with its turns";
                report.add(&name, "stays at 0", "", note);
            }
        }
    }

    /// The origin of an angle, 0 of what is none.
    pub fn of_state<S: Scalar>(&self, state: usize, v: &Values<S>) -> S {
        self.place(state).map_or(S::from(0.0), |k| v[self.origin][k])
    }

    /// Starts with the origin of an angle at `there` where that or one of the angles that count is beyond the range, else at 0.
    pub fn start<S: Scalar>(&self, angle: Angle, there: S, counted: &[S], v: &mut Point<S>) {
        let Some(k) = self.place(angle.state) else { return };
        let range = v[self.range];
        let counted = counted.iter().chain([&there]);
        let is_beyond = counted.fold(S::Flag::from(false), |any, angle| any | angle.abs().above(range));
        v[self.origin][k] = S::select(is_beyond & angle.moves.into(), there, S::from(0.0));
    }

    /// Negative where an angle that counts is beyond the range.
    pub fn event_indicators<S: Scalar>(&self, counts: impl Fn(Angle) -> S, v: &Values<S>, z: &mut [S]) {
        for (k, &angle) in self.angles.iter().enumerate() {
            z[self.indicator + k] = if angle.moves { v[self.range] - counts(angle).abs() } else { S::from(1.0) };
        }
    }

    /// Moves the origin of an angle.
    pub fn shift<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>) {
        if let Some(k) = self.place(angle.state) {
            v[self.origin][k] += by;
        }
    }

    /// Has origins move by the angles that count where these are beyond the range, with all that depends on them.
    pub fn event<S: Scalar>(
        &self,
        counts: impl Fn(Angle, &Values<S>) -> S,
        move_along: impl Fn(Angle, S, &mut Point<S>),
        v: &mut Point<S>,
    ) {
        for angle in self.angles().filter(|angle| angle.moves) {
            let by = counts(angle, &v.values());
            v.when(by.abs().at_least(v[self.range] * REACHED), |v| move_along(angle, by, v));
        }
    }
}

/// A law with a reference model: its angles are read nearest to the model's, and counted from origins that move to the references.
///
/// ψ_l = x_m,ψ + wrap(ψ − c − x_m,ψ) with the origin c takes the place of ψ, r_l = ψ_l + wrap(r − c − ψ_l) that of its reference.
pub(super) trait Turning {
    /// The origins, where the state has angles.
    fn origins(&self) -> Option<&Origins>;

    /// The measured state and the references.
    fn inputs(&self) -> [VectorOf<Input>; 2];

    /// The state of the reference model.
    fn model(&self) -> VectorOf<State>;

    /// Moves everything that depends on an angle with its origin.
    fn move_along<S: Scalar>(&self, angle: Angle, by: S, v: &mut Point<S>);

    /// An element of the measured state, angles counted from their origins.
    fn state<S: Scalar>(&self, k: usize, v: &Values<S>) -> S {
        let x = v[self.inputs()[0]][k];
        self.origins().map_or(x, |origins| origins.local(k, x, v[self.model()][k], v))
    }

    /// The measured state, angles counted from their origins.
    fn states<'a, S: Scalar>(&'a self, v: &'a Values<'a, S>) -> impl Iterator<Item = S> + 'a {
        (0..self.model().len()).map(move |k| self.state(k, v))
    }

    /// A reference, counted as its output is.
    fn reference<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let r = v[self.inputs()[1]][channel];
        self.origins().map_or(r, |origins| origins.local_reference(channel, r, |k| self.state(k, v), v))
    }

    /// The references, counted as their outputs are.
    fn references<'a, S: Scalar>(&'a self, v: &'a Values<'a, S>) -> impl Iterator<Item = S> + 'a {
        (0..self.inputs()[1].len()).map(move |channel| self.reference(channel, v))
    }

    /// The reference model starts where the plant is. Angles are counted from 0, or from their reference where they or that are far
    /// from 0.
    fn start_model<S: Scalar>(&self, v: &mut Point<S>) {
        let ([x, r], x_m) = (self.inputs(), self.model());
        v.copy(x, x_m);
        let Some(origins) = self.origins() else { return };
        for angle in origins.angles() {
            let psi = v[x][angle.state].wrap();
            let there = psi + (v[r][angle.channel] - psi).wrap();
            origins.start(angle, there, &[psi, there], v);
            let origin = origins.of_state(angle.state, &v.values());
            v[x_m][angle.state] = psi - origin;
        }
    }

    /// Puts the reference model where the plant is.
    fn put_model<S: Scalar>(&self, v: &mut Point<S>) {
        let x_m = self.model();
        for k in 0..x_m.len() {
            let x = self.state(k, &v.values());
            v[x_m][k] = x;
        }
    }

    fn origin_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        if let Some(origins) = self.origins() {
            origins.event_indicators(|angle| self.reference(angle.channel, v), v, z);
        }
    }

    /// Moves origins to references that are far from them.
    fn move_origins<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(origins) = self.origins() {
            origins.event(|angle, v| self.reference(angle.channel, v), |angle, by, v| self.move_along(angle, by, v), v);
        }
    }
}

/// The angles of a state that outputs C x are, one an output.
///
/// # Errors
/// An angle that is no output.
pub(super) fn shown(named: &Angles, C: &DMatrix<f64>, moves: impl Fn(usize) -> bool) -> Result<Vec<Angle>, Invalid> {
    let of = |state: usize| {
        let is_output = |row: usize| (0..C.ncols()).all(|k| C[(row, k)] == if k == state { 1.0 } else { 0.0 });
        let channel = (0..C.nrows()).find(|&row| is_output(row));
        let is_only = C.column(state).iter().filter(|entry| **entry != 0.0).count() == 1;
        channel.filter(|_| is_only).map(|channel| Angle { state, channel, moves: moves(state) }).ok_or_else(|| {
            let allowed = "must be a state that is one of the outputs: a row of C with 1 there, and 0 in the rest of row and column";
            Invalid::new("angles", state + 1, allowed)
        })
    };
    named.each().map(of).collect()
}
