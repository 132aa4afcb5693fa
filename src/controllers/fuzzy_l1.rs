//! L1 adaptive control with a fuzzy feedback gain (thesis, chapter 4), of one channel or several.

mod structure;
mod template;

use super::fuzzy_gain::{Channels, FuzzyGain, Held};
use super::l1::{Law, Ports, enters_rates};
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::limits;
use crate::pages::{self, Page};
use crate::system::{
    Declaration, DesignReport, ErrorEstimate, Input, Invalid, OwnStep, Point, Rates, Scalar, Signals, Stride, System,
    Unit, Values, VectorOf, vector,
};
use crate::template::{Sizes, Template};
pub use structure::FuzzyL1Structure;

/// The L1 law with a feedback gain that follows from the tracking error and its rate.
#[derive(Debug)]
pub struct FuzzyL1 {
    r: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    /// None where no output's rate is known.
    dr: Option<VectorOf<Input>>,
    ports: Ports,
    law: Law,
    gain: FuzzyGain,
}

impl Tracking for FuzzyL1 {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_r.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_r.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.error(channel, v)
    }
}

impl FuzzyL1 {
    /// e = r − y of a channel.
    fn error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.law.error(channel, v[self.r][channel], v)
    }

    /// e' = r' − y' of a channel; 0 where no rate is known.
    fn error_rate<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.dr.map_or(S::from(0.0), |dr| v[dr][channel] - self.law.output_rate(channel, v))
    }

    fn choose_gains<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.r.len() {
            let e = self.error(i, &v.values());
            self.gain.choose(i, e, v);
        }
    }
}

impl System for FuzzyL1 {
    type Structure = FuzzyL1Structure;
    const NAME: &'static str = "fuzzy-l1";
    const DOCUMENTATION: &'static str = pages::FUZZY_L1.text;

    fn declare(structure: FuzzyL1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let FuzzyL1Structure { sharing, of_l1: structure } = structure;
        let plant = structure.plant()?;
        let units = structure.units(plant.B.shape())?;
        let rates: Vec<_> = units.r.iter().map(|unit| Unit::per_second(unit)).collect();
        let has_rate: Vec<_> = enters_rates(&plant.B, &plant.C).iter().map(|entered| !entered).collect();
        let m = units.r.len();
        let r = d.input(vector("r", m, "reference").about(&units.of_r, "reference of {}").units(&units.r));
        // Channels that share their weights have a rate each, or none is allowed.
        let needs_rate = sharing.weights == Held::Shared || has_rate.contains(&true);
        let dr = || vector("dr", m, "time derivative of the reference");
        let dr = needs_rate
            .then(|| d.input(dr().about(&units.of_r, "time derivative of the reference of {}").units(&rates)));
        let ports = Ports::declare(d, r, &units);
        let law = Law::declare(&structure, ports, d)?;
        law.allows_scheduling()?;
        if sharing.weights == Held::Shared {
            structure::require_rates(&plant)?;
        }
        let channels = Channels { units: &units.r, quantities: &units.of_r, has_rate: &has_rate };
        let gain = FuzzyGain::declare(d, sharing, channels);
        Ok(FuzzyL1 { r, units_of_r: units.r, of_r: units.of_r, dr, ports, law, gain })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.law.prepare(v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.ports.u_min, self.ports.u_max, v);
        self.gain.relate(self.law.feedback_gain(), v);
        self.law.relate(v);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.choose_gains(v);
        self.law.initialise(v);
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.law.clip_estimates(v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        self.law.outputs(&v[self.r], v, y);
        let errors = |i: usize| [self.error(i, v), self.error_rate(i, v)];
        self.gain.outputs(self.law.feedback_gain(), errors, v, y);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.law.derivatives(v.matrix(self.gain.K), v, dx);
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.law.event_indicators(v, z);
        self.gain.event_indicators(|i| self.error(i, v), v, z);
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.law.event(v);
        self.choose_gains(v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.law.step_completed(t, step, v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.law.report(&self.gain.range(self.law.feedback_gain(), v), v, report);
    }

    fn own_step(&self) -> Option<&dyn OwnStep> {
        Some(self)
    }
}

impl OwnStep for FuzzyL1 {
    fn workspace(&self) -> usize {
        self.law.closed_form_workspace()
    }

    fn pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        self.law.closed_form_pays(h, relative_tolerance, v)
    }

    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        self.law.closed_form(self.r, self.gain.K, stride, v)
    }

    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        self.law.conclude(whole, tolerance, v)
    }
}

impl Catalogued for FuzzyL1 {
    const PAGE: Page = pages::FUZZY_L1;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[
            Sizes::plant(1, 1),
            Sizes::plant(2, 1),
            Sizes::plant(2, 2),
            Sizes::plant(4, 2),
            Sizes::plant(3, 1),
            Sizes::plant(3, 2),
            Sizes::plant(9, 3),
        ],
    });
}
