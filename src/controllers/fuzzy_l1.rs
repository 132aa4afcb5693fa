//! L1 adaptive control with a fuzzy feedback gain (thesis, chapter 4).

use super::fuzzy_gain::FuzzyGain;
use super::l1::{self, L1Structure, Law, Ports};
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Guide, Icon, Role, icon};
use crate::mathematics::limits;
use crate::system::{
    Declaration, DesignReport, ErrorEstimate, Input, Invalid, OwnStep, Point, Rates, Scalar, Signals, Stride, System,
    Unit, Values, VectorOf, vector,
};
use crate::template::{Request, Sizes, Template, number, three_digits};

/// The L1 law with a feedback gain that follows from the tracking error and its rate.
#[derive(Debug)]
pub struct FuzzyL1 {
    r: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    dr: VectorOf<Input>,
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
        v[self.r][channel] - self.law.output(channel, v)
    }

    fn choose_gains<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.r.len() {
            let e = self.error(i, &v.values());
            self.gain.choose(i, e, v);
        }
    }
}

impl System for FuzzyL1 {
    type Structure = L1Structure;
    const NAME: &'static str = "fuzzy-l1";
    const DOCUMENTATION: &'static str =
        concat!(include_str!("../../docs/controllers/fuzzy_l1.md"), include_str!("../../docs/controllers/l1.md"));

    fn declare(structure: L1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let size = structure.size()?;
        let units = structure.units(size)?;
        let rates: Vec<_> = units.r.iter().map(|unit| Unit::per_second(unit)).collect();
        let r = d.input(vector("r", size.1, "reference").about(&units.of_r, "reference of {}").units(&units.r));
        let dr = vector("dr", size.1, "time derivative of the reference");
        let dr = d.input(dr.about(&units.of_r, "time derivative of the reference of {}").units(&rates));
        let ports = Ports::declare(d, &units);
        let law = Law::declare(&structure, ports, d)?;
        law.allows_scheduling()?;
        let gain = FuzzyGain::declare(d, size.1);
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
        let errors = |i: usize| [self.error(i, v), v[self.dr][i] - self.law.output_rate(i, v)];
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
    const TITLE: &'static str = "L1 adaptive controller with a fuzzy feedback gain";
    const PAGE: &'static str = "controllers/fuzzy_l1";
    const ICON: Icon = icon!("fuzzy-l1");
    const GUIDE: Guide = Guide {
        purpose: "An L1 adaptive controller whose gain is small where the error is large, for less control \
                  at the start. Take it where the L1 controller's first peak is too large.",
        alone: "With nothing connected it stands still: state and reference are both 0, so there is no error. An error \
                that no plant answers takes its estimates to their bounds, and it warns: connect the plant first.",
        gains: &[
            ("k_e", "Error above which the gain is fuzzy; below it the gain is `feedback_gain`."),
            ("k_p", "Weight of the error's magnitude in the inference: 1/k_p is a very large error."),
            ("k_d", "Weight of the magnitude of its rate."),
            ("feedback_gain", "The gain for small errors: bandwidth of what adaptation may do."),
            ("adaptation_gain", "How fast the estimates follow what is unknown."),
            ("pole_real", "Speed of the desired dynamics."),
        ],
        limits: "- The whole state `x` is measured, and hardly delayed: the margin against a delay \
                  stands in the design report.\n\
                 - What is unknown must lie within its bounds; outside them nothing is proven, and \
                  the estimates stand at them.\n\
                 - The sign of the input gain must be known.\n\
                 - A communication step that is too long for the adaptation takes the loop away from \
                  its design: `step_too_long` tells.\n\
                 - Nothing is proven of the fuzzy gain; a gain of two levels (`fuzzy_output` = \
                  constant) does about as much in the examples.\n\
                 - It needs the reference's rate `dr`, exact: a differentiated one is noisy.",
    };
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template,
        tried: &[Sizes::plant(2, 1), Sizes::plant(4, 2), Sizes::plant(3, 1), Sizes::plant(9, 3)],
    });
}

fn template(request: &Request) -> Result<String, Invalid> {
    let (mut text, bandwidth) = l1::template::begin(request, FuzzyL1::TITLE, FuzzyL1::PAGE)?;
    let reference = request.reference;
    text.set("k_e", number(three_digits(0.1 * reference)), "error above which the gain is fuzzy");
    text.set("k_p", number(three_digits(1.0 / reference)), "factor of |e| in the inference: 1 is `very large`");
    text.set("k_d", number(three_digits(0.5 / (reference * bandwidth))), "s, factor of |e'| in the inference");
    Ok(text.finish())
}
