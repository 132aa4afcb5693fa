//! L1 adaptive control with prescribed performance: an L1 controller, and a barrier that confines the error to a
//! funnel.
//!
//! The barrier is that of prescribed performance and of funnel control: C. P. Bechlioulis and G. A. Rovithakis, IEEE
//! Trans. Automatic Control 53 (2008) 2090–2099; A. Ilchmann, E. P. Ryan and C. J. Sangwin, Tracking with prescribed
//! transient behaviour, ESAIM: COCV 7 (2002) 471–493. Its combination with an L1 law whose predictor knows of it is
//! this package's.
#![allow(non_snake_case)] // matrices have the names of the field

mod order;
mod report;
mod sampled;
mod structure;
mod template;

use nalgebra::DMatrix;

use super::angles::Angles;
use super::at_limit::{Guarantee, REOPENED_OR_AT_LIMIT};
use super::funnel::{self, Funnel, Inside};
use super::l1::{AddedControl, Law, Ports};
use super::sampling::Evaluation;
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits;
use crate::pages::{self, Page};
use crate::system::{
    ChoiceOf, Declaration, DesignReport, Input, Invalid, Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals,
    System, Values, VectorOf, larger, scalar, vector,
};
use crate::template::{Sizes, Template};
use order::Order;
use sampled::Samples;
pub use structure::L1PpfStructure;

/// The funnel of the examples of section 6.5: rho_0, rho_inf, decay_rate.
const FUNNEL: [f64; 3] = [2.0, 0.05, 1.5];

/// Parameters of an L1 controller that this one has no use for: it is only integrated by general methods.
const OF_CLOSED_FORM: [&str; 2] = ["adaptation_tolerance", "closed_form_phase"];

/// u = u_ad − K_m x + u_ε: the control of an L1 controller, and u_ε, which grows without limit at the funnel's bounds.
#[derive(Debug)]
pub struct L1Ppf {
    r: VectorOf<Input>,
    order: Order,
    barrier_gain: VectorOf<Parameter>,
    funnel: Funnel,
    /// u_ε, the addition to the L1 control.
    added: AddedControl,
    stiffness: ScalarOf<Signal>,
    ports: Ports,
    law: Law,
    /// From the rates that the channels ask for to controls: the inverse of the nominal input gain.
    inverse: DMatrix<f64>,
    guarantee: Guarantee,
    /// Evaluation of the barrier.
    evaluation: ChoiceOf<Parameter, Evaluation>,
    /// Its samples, where it can be sampled.
    samples: Option<Samples>,
}

impl System for L1Ppf {
    type Structure = L1PpfStructure;
    const NAME: &'static str = "l1-ppf";
    const DOCUMENTATION: &'static str = pages::L1_PPF.text;

    fn declare(structure: L1PpfStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let plant = structure.plant()?;
        let m = plant.B.ncols();
        let is_first = plant.B.nrows() == m;
        let units = structure.of_l1.units(plant.B.shape())?;
        let (_, turning) = structure.of_l1.angles(&plant, &units.x)?;
        let of_errors = turning.iter().map(|angle| if is_first { angle.state } else { angle.channel });
        let angles = Angles::at(of_errors, m);
        let inverse = L1PpfStructure::inverse_gain(&plant)?;
        d.without_effect(OF_CLOSED_FORM);
        let r = d.input(vector("r", m, "reference").about(&units.of_r, "reference of {}").units(&units.r));
        let order = Order::declare(d, plant, &units, angles.clone())?;
        let ports = Ports::declare(d, r, &units);
        let gain = "gain of the barrier, in the square of the error's unit per second; 0: only the L1 law";
        let added = vector("u_barrier", m, "contribution of the barrier to the control").units(&units.command);
        let added = AddedControl {
            now: d.local(added.about(&units.of_u, "contribution of the barrier to the {}")),
            at_takeover: d.discrete(vector("#u_barrier, at the start", m, "").hidden()),
        };
        let errors = if is_first { (&units.x, &units.of_x) } else { (&units.r, &units.of_r) };
        let rate =
            "fastest rate at which the barrier brings an error back where the plant's input gain is the nominal one";
        Ok(L1Ppf {
            r,
            order,
            barrier_gain: d.parameter(vector("barrier_gain", m, gain).start(0.1).min(0.0)),
            guarantee: Guarantee::declare(d, ports.limited, REOPENED_OR_AT_LIMIT),
            funnel: Funnel::declare(d, (errors.0, errors.1), FUNNEL).of_angles(angles),
            added,
            stiffness: d.local(scalar("barrier_stiffness", rate).unit("1/s")),
            ports,
            law: Law::with(&structure.of_l1, ports, Some(added), d)?,
            inverse,
            evaluation: d
                .parameter(Evaluation::parameter("when the barrier is evaluated").start(Evaluation::Continuous)),
            samples: is_first.then(|| Samples::declare(d, m)),
        })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.law.prepare(v)?;
        self.order.prepare(&self.law, &self.inverse, v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.ports.u_min, self.ports.u_max, v);
        self.funnel.relate(v);
        self.law.relate(v);
        match &self.samples {
            Some(samples) => samples.sampling.relate(v),
            None => self.refuse_samples(v),
        }
    }

    /// The funnels open, unless a person is in command.
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        if self.samples.is_some() {
            Evaluation::require_steps(self.evaluation, self.law.is_stepped(), v);
        }
        self.law.start_predictor(v);
        self.order.initialise(&self.law, v);
        self.funnel.open(t, |i, v| self.error(i, v), v);
        self.begin_sampling(t, v);
        self.note_barrier(t, v);
        self.law.initialise(v);
        let active = self.law.is_active(&v.values());
        v.when(!active, |v| {
            self.order.follow(&self.law, v);
            v[self.added.at_takeover].fill(S::from(0.0));
            self.law.take_over(v);
            self.funnel.close(v);
        });
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.law.clip_estimates(v);
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        let (active, none) = (self.law.is_active(v), S::from(0.0));
        y[self.added.now].fill(none);
        y[self.stiffness] = none;
        for i in 0..self.barrier_gain.len() {
            let inside = self.inside(i, t, v);
            self.funnel.show(i, &inside, y);
            let asked = S::branch(active, || self.asked(i, &inside, v), || none);
            for (j, of_channel) in self.reached(i) {
                y[self.added.now][j] += asked * of_channel;
            }
            y[self.stiffness] = larger(y[self.stiffness], self.stiffness_of(i, &inside, v));
        }
        if let Some(samples) = &self.samples {
            for j in 0..self.added.now.len() {
                let sampled = || S::branch(active, || v[samples.control][j], || none);
                let continuous = y[self.added.now][j];
                y[self.added.now][j] = S::branch(self.is_sampled(v), sampled, || continuous);
            }
        }
        let goal = self.order.goal(&self.law, self.r, &self.inverse, v, y);
        self.law.outputs_towards(goal, v, y);
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.law.derivatives(v.matrix(self.law.feedback_gain()), v, dx);
        self.order.derivatives(&self.law, self.r, v, dx);
    }

    /// Reports an error that has left its funnel: the controller is not defined there.
    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.funnel.check_angles(v);
        let active = self.law.is_active(&v.values()) & !self.waits_for_sample(t, &v.values());
        v.when(active, |v| self.funnel.check(t, |i, v| self.error(i, v), v));
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        self.law.event_indicators(v, z);
        self.funnel.event_indicators(t, |i, v| self.error(i, v), v, z);
        if self.samples.is_some() {
            let is_sampled = self.is_sampled(v);
            z[self.funnel.indicators()].iter_mut().for_each(|z| *z = S::select(is_sampled, S::from(1.0), *z));
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.samples.as_ref().map_or(S::from(f64::INFINITY), |samples| samples.sampling.clock.next(v))
    }

    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.law.event_with(|v| self.open_anew(t, v), |angle, by, v| self.order.move_along(angle, by, v), v);
        let active = self.law.is_active(&v.values());
        v.when(!active, |v| self.funnel.close(v));
        let is_continuous = !self.is_sampled(&v.values());
        v.when(is_continuous, |v| self.funnel.event(t, |i, v| self.error(i, v), v));
        self.sample_where_due(t, v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.when_sampled(v, |samples, v| self.keep_to_communication_points(samples, (t, step), v));
        self.law.step_completed(t, step, v);
        let active = self.law.is_active(&v.values());
        let (limit, none) = (S::from(1.0), S::from(0.0));
        // A barrier with nothing to do does no harm.
        let acts = v[self.added.now].iter().fold(none, |sum, u| sum + u.abs()).above(none);
        let is_stiff = active & acts & (step * v[self.stiffness]).above(limit) & !self.is_sampled(&v.values());
        self.law.judge_step_of_added(is_stiff, |v| self.stiffness_warning(step, v), v);
        self.when_sampled(v, |samples, v| self.judge_sampling(samples, step, v));
        v.when(active, |v| self.guarantee.look(t, self.funnel.error(), v));
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
        self.law.report_angles(v, report);
        self.law.report(&[("", v.matrix(self.law.feedback_gain()).into_owned())], v, report);
    }
}

impl L1Ppf {
    /// The error of a channel.
    fn error<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.order.error(i, &self.law, [self.r, self.ports.x], v)
    }

    fn inside<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> Inside<S> {
        let e = self.error(i, v);
        let continuous = || self.funnel.inside(i, t, e, v);
        if self.samples.is_none() {
            return continuous();
        }
        let places = |inside: Inside<S>| [inside.z, inside.epsilon, inside.R];
        let between = || places(self.funnel.inside_between_samples(i, t, e, v));
        let [z, epsilon, R] = S::branch(self.is_sampled(v), between, || places(continuous()));
        let (performance, bounds) = (self.funnel.performance(i, t, v), self.funnel.bounds(i, v));
        Inside { e, performance, bounds, z, epsilon, R }
    }

    /// −K_ε R E of a channel: the rate, of the error or of its rate, that the barrier asks for.
    fn asked<S: Scalar>(&self, i: usize, inside: &Inside<S>, v: &Values<S>) -> S {
        -v[self.barrier_gain][i] * inside.R * self.order.driven(i, inside, &self.law, v)
    }

    /// Rate, in 1/s, at which the barrier by itself brings the error of a channel back, or its rate, for the nominal
    /// input gain.
    fn stiffness_of<S: Scalar>(&self, i: usize, inside: &Inside<S>, v: &Values<S>) -> S {
        v[self.barrier_gain][i] * self.order.slope(inside)
    }

    /// Notes the barrier's output when the controller takes over.
    fn note_barrier<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.added.at_takeover].fill(S::from(0.0));
        for i in 0..self.barrier_gain.len() {
            let asked = self.asked(i, &self.inside(i, t, &v.values()), &v.values());
            for (j, of_channel) in self.reached(i) {
                v[self.added.at_takeover][j] += asked * of_channel;
            }
        }
        // A sampled barrier waits for its next sample.
        self.when_sampled(v, |samples, v| {
            v[samples.control].fill(S::from(0.0));
            v.copy(samples.control, self.added.at_takeover);
        });
    }

    /// The controls that a channel's rate is brought about by, and the part of each.
    fn reached(&self, channel: usize) -> impl Iterator<Item = (usize, f64)> {
        self.inverse.column(channel).into_iter().copied().enumerate().filter(|(_, part)| *part != 0.0)
    }

    /// The funnels open anew, a reference model starts at the measured state.
    fn open_anew<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.order.follow(&self.law, v);
        self.funnel.open_anew(t, |i, v| self.error(i, v), v);
        self.note_barrier(t, v);
    }

    /// Warning text about a step that is too long for the barrier.
    fn stiffness_warning<S: Scalar>(&self, step: S, v: &Values<S>) -> String {
        let rate = v[self.stiffness];
        let sampled =
            if self.samples.is_some() { format!("{} = sampled, ", v.name(self.evaluation)) } else { String::new() };
        format!(
            "the communication step {} s is too long for the barrier, which brings an error back at {} 1/s now. Use {} s or \
             less, {sampled}a smaller {}, a wider funnel, or the loop as a single FMU",
            step.scientific(3),
            rate.scientific(3),
            rate.recip().scientific_at_most(1),
            v.name(self.barrier_gain)
        )
    }
}

impl Catalogued for L1Ppf {
    const PAGE: Page = pages::L1_PPF;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(3, 3), Sizes::plant(6, 3)],
    });
    const TRIAL: Trial = Trial { alone: funnel::OPEN, ..Trial::NONE };
}
