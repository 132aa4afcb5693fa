//! L1 adaptive controller (thesis, sections 3.2 to 3.4).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod adaptation;
mod angles;
mod closed_form;
mod control;
mod design;
mod estimates;
mod law;
pub(super) mod plants;
mod ports;
mod report;
mod sizes;
mod structure;
mod supervision;
pub(super) mod template;
pub(super) mod tracking;
mod unmatched;

use nalgebra::DMatrixView;

use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::limits;
use crate::pages::{self, Page};
use crate::system::{
    Choice, Declaration, DesignReport, ErrorEstimate, Input, Invalid, OwnStep, Point, Rates, Scalar, Signals, Size,
    Stride, System, Values, VectorOf, larger, vector,
};
use crate::template::{Begun, Needs, Request, Sizes, Template};
pub(super) use design::{Dynamics, SETTLED};
pub(super) use law::{AddedControl, Goal, Law};
pub(super) use ports::Ports;
pub(super) use report::{controllability, report_delay_margin};
pub use structure::{Baseline, Commands, DesiredDynamics, InputGain, L1Structure, Regressor};
pub(super) use structure::{
    PlantMatrices, Quantities, Symbols, Units, enters_rates, input_and_output, nominal_dynamics, of_motion,
    orthogonal_complement,
};
pub(super) use unmatched::{Cancellation, Form, Zeros};

/// Start of the adaptive control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AdaptiveStart {
    Zero,
    Bumpless,
}

impl Choice for AdaptiveStart {
    const TYPE: &'static str = "AdaptiveStart";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Zero, "zero", "u_ad starts at zero"),
        (Self::Bumpless, "bumpless", "u_ad starts such that the control starts at u_manual"),
    ];
}

/// L1 adaptive controller for a plant x' = A_m x + B (ω v + θ φ(x) + σ), and + B_um (θ_2 ‖x‖∞ + σ_2) where unmatched
/// uncertainty is estimated too.
#[derive(Debug)]
pub struct L1 {
    r: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    law: Law,
}

impl Tracking for L1 {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_r.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_r.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.law.error(channel, v[self.r][channel], v)
    }
}

impl System for L1 {
    type Structure = L1Structure;
    const NAME: &'static str = "l1";
    const DOCUMENTATION: &'static str = pages::L1.text;

    fn declare(structure: L1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let plant = structure.plant()?;
        let units = structure.units(plant.B.shape())?;
        let r = d.input(vector("r", units.r.len(), "reference").about(&units.of_r, "reference of {}").units(&units.r));
        let law = Law::declare(&structure, Ports::declare(d, r, &units), d)?;
        Ok(L1 { r, units_of_r: units.r, of_r: units.of_r, law })
    }

    fn sizes(structure: &L1Structure) -> Vec<Size> {
        structure.sizes()
    }

    fn resize(structure: &mut L1Structure, sizes: &[usize]) -> toml::Table {
        structure.resize(sizes)
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.law.prepare(v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.law.ports.u_min, self.law.ports.u_max, v);
        self.law.relate(v);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.law.initialise(v);
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.law.clip_estimates(v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        self.law.outputs(&v[self.r], v, y);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.law.derivatives(v.matrix(self.law.feedback_gain()), v, dx);
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.law.event_indicators(v, z);
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.law.event(v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.law.step_completed(t, step, v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.law.report(&[("", v.matrix(self.law.feedback_gain()).into_owned())], v, report);
    }

    fn own_step(&self) -> Option<&dyn OwnStep> {
        Some(self)
    }
}

impl OwnStep for L1 {
    fn workspace(&self) -> usize {
        self.law.closed_form_workspace()
    }

    /// Not while an estimate is at a bound, nor where a general method needs few steps.
    fn pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        self.law.closed_form_pays(h, relative_tolerance, v)
    }

    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        self.law.closed_form(self.r, self.law.feedback_gain(), stride, v)
    }

    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        self.law.conclude(whole, tolerance, v)
    }
}

pub(super) fn dot<'a, S: Scalar>(row: impl Iterator<Item = &'a S>, column: &[S]) -> S {
    product(row, column.iter().copied())
}

/// A row times a column that is computed element by element.
pub(super) fn product<'a, S: Scalar>(row: impl Iterator<Item = &'a S>, column: impl Iterator<Item = S>) -> S {
    row.zip(column).fold(S::from(0.0), |sum, (&a, b)| sum + a * b)
}

/// Adds A x to `sums`, column by column, as A is stored.
pub(super) fn add_product<S: Scalar>(sums: &mut [S], A: DMatrixView<S>, x: impl Iterator<Item = S>) {
    for (column, x) in A.column_iter().zip(x) {
        sums.iter_mut().zip(column.as_slice()).for_each(|(sum, &a)| *sum += a * x);
    }
}

/// u_ad − K_m x, and the addition of an FMU.
fn commanded<S: Scalar>(u_ad: S, feedback: S, added: Option<S>) -> S {
    added.map_or(u_ad - feedback, |added| u_ad - feedback + added)
}

pub(super) fn squared<S: Scalar>(x: &[S]) -> S {
    dot(x.iter(), x)
}

pub(super) fn infinity_norm<S: Scalar>(mut x: impl Iterator<Item = S>) -> S {
    let first = x.next().map_or(S::from(0.0), |x| x.abs());
    x.fold(first, |norm, x| larger(norm, x.abs()))
}

/// The place of the element of the largest magnitude, and that.
fn largest(x: impl Iterator<Item = f64>) -> (usize, f64) {
    let larger = |best: (usize, f64), other: (usize, f64)| if other.1.abs() > best.1.abs() { other } else { best };
    x.enumerate().reduce(larger).unwrap_or((0, 0.0))
}

impl Catalogued for L1 {
    const PAGE: Page = pages::L1;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: begun,
        is_uncertain: true,
        needs: Some(Needs::States),
        tried: &[
            Sizes::plant(1, 1),
            Sizes::plant(2, 1),
            Sizes::plant(2, 2),
            Sizes::plant(3, 1),
            Sizes::plant(5, 2),
            Sizes::plant(6, 3),
            Sizes::plant(8, 1),
        ],
    });
}

fn begun(request: &Request) -> Result<Begun, Invalid> {
    Ok(template::begin(request, &L1::PAGE, [1.0, 1.0], &[])?.finish(request))
}
