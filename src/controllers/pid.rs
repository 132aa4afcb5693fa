//! PID control in two degrees of freedom (Åström and Hägglund).
#![allow(non_snake_case)] // gains have the names of the field

mod report;
mod template;
mod units;

use serde::Deserialize;

use super::angles::{Angles, Jumps};
use super::at_limit::{Limited, achieved, manual, unlimited};
use super::in_command::InCommand;
use super::inverse;
use super::l1::dot;
use super::supervised::Supervised;
use super::units::{Quantities, check_channels};
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus, Trial};
use crate::mathematics::limits::{self, within};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, DesignReport, Input, Invalid, MatrixOf, Number, Parameter, Point, Prepared, Rates, Scalar, Signal,
    Signals, State, System, Values, VectorOf, matrix, vector,
};
use crate::template::{Needs, Sizes, Template};
use units::{Symbols, Units};

/// Value of `tracking_time` if it follows from the gains.
const BY_GAINS: f64 = -1.0;
/// The least time that is given, s.
const LEAST_TIME: f64 = 1e-9;

/// The description of a PID controller's structure.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PidStructure {
    /// Number of tracked variables, each with a control of its own.
    channels: usize,
    /// Channels whose output is an angle, counted from 1: values that differ by whole turns are the same. Their unit is rad.
    #[serde(default)]
    angles: Vec<usize>,
    /// True if what the actuators achieve of the control is an input, `u_achieved`: where they limit several controls together.
    #[serde(default)]
    achieved: bool,
    /// Units of the signals.
    #[serde(default)]
    units: Units,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// v = K_p (b r − y) + I + K_d N ((c r − y) − w) in each channel, and u = S v within its limits.
#[derive(Debug)]
pub struct Pid {
    K_p: VectorOf<Parameter>,
    K_i: VectorOf<Parameter>,
    K_d: VectorOf<Parameter>,
    b: VectorOf<Parameter>,
    c: VectorOf<Parameter>,
    N: VectorOf<Parameter>,
    S: MatrixOf<Parameter>,
    S_inverse: MatrixOf<Prepared>,
    tracking_time: VectorOf<Parameter>,
    /// `tracking_time` in force; 0 without tracking.
    T_t: VectorOf<Prepared>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    r: VectorOf<Input>,
    y: VectorOf<Input>,
    units_of_y: Vec<&'static str>,
    of_y: Vec<String>,
    angles: Angles,
    jumps: Option<Jumps>,
    in_command: InCommand,
    /// The part of u that the actuators achieve, where that is known.
    u_achieved: Option<VectorOf<Input>>,
    I: VectorOf<State>,
    w: VectorOf<State>,
    P: VectorOf<Signal>,
    D: VectorOf<Signal>,
    v: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    /// u − S v
    cut: VectorOf<Signal>,
    supervised: Supervised,
}

impl Tracking for Pid {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_y.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_y.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.angles.difference(channel, v[self.r][channel] - v[self.y][channel])
    }
}

impl System for Pid {
    type Structure = PidStructure;
    const NAME: &'static str = "pid";
    const DOCUMENTATION: &'static str = pages::PID.text;

    fn declare(structure: PidStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let m = structure.channels;
        check_channels(m)?;
        let units = structure.units.symbols(m)?;
        let Symbols { y, v, u, .. } = &units;
        let angles = Angles::of(&structure.angles, "y", y)?;
        let gain = |name: &str, text: &str| vector(name, m, text).min(0.0);
        let weight = |name: &str, text: &str| vector(name, m, text).start(1.0);
        let [of_y, of_u] = structure.quantities.of_signals(m)?;
        let tracking = "time constant with which the integral tracks the limited control (anti-windup); -1 s: by \
                        the gains, 0: off";
        let limited = Limited::declare(d, (u, &of_u), "that the actuator can give", "");
        let unlimited = unlimited(d, m);
        let measured = vector("y", m, "measured output of the plant").about(&of_y, "measured {}").units(y);
        Ok(Pid {
            K_p: d.parameter(gain("K_p", "proportional gain").start(1.0).units(&units.K_p)),
            K_i: d.parameter(gain("K_i", "integral gain").units(&units.K_i)),
            K_d: d.parameter(gain("K_d", "derivative gain").units(&units.K_d)),
            b: d.parameter(weight("b", "weight of the reference in the proportional part")),
            c: d.parameter(weight("c", "weight of the reference in the derivative part; 0 where it jumps")),
            N: d.parameter(
                vector("N", m, "rate of the derivative's filter, its bandwidth")
                    .unit("rad/s")
                    .in_own_unit()
                    .start(100.0)
                    .positive(),
            ),
            S: d.parameter(
                matrix("S", m, m, "decoupling: from the channels' demands to the controls; must have an inverse")
                    .identity()
                    .units(&units.S),
            ),
            S_inverse: d.prepared(matrix("#inverse of S", m, m, "").hidden()),
            tracking_time: d.parameter(vector("tracking_time", m, tracking).unit("s").start(BY_GAINS).min(BY_GAINS)),
            T_t: d.prepared(vector("T_t", m, "tracking time in force; 0 where the integral doesn't track").unit("s")),
            r: d.input(vector("r", m, "reference").about(&of_y, "reference of {}").units(y)),
            y: d.input(measured),
            in_command: InCommand::declare(d, "it takes over without a jump", manual(u, &of_u)),
            u_achieved: achieved(d, structure.achieved, (u, &of_u)),
            I: d.state(vector("I", m, "integral part").units(v)),
            w: d.state(vector("w", m, "c r - y behind the derivative's filter").units(y)),
            P: d.local(vector("P", m, "proportional part").units(v)),
            D: d.local(vector("D", m, "derivative part").units(v)),
            v: d.local(vector("v", m, "demand of the channel, P + I + D").units(v)),
            cut: d.local(vector("#u - S v", m, "").hidden()),
            unlimited,
            supervised: Supervised::declare(d, limited),
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            units_of_y: units.y,
            of_y,
            jumps: None,
            angles,
        }
        .watching(d))
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        inverse::prepare(self.S, self.S_inverse, v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        for i in 0..self.I.len() {
            self.check_time(i, v);
            self.check_weights(i, v);
            v[self.T_t][i] = self.time_in_force(i, &v.values());
        }
    }

    /// I = 0, and the filter at rest: the derivative begins without a kick.
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.in_command.begin(v);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        for i in 0..self.I.len() {
            v[self.I][i] = S::from(0.0);
            v[self.w][i] = self.weighted(self.c, i, &v.values());
        }
    }

    /// v = P + I + D in each channel; u = S v, or the manual control, within the limits.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.v.len() {
            let [P, D] = self.parts(i, v);
            (y[self.P][i], y[self.D][i], y[self.v][i]) = (P, D, P + v[self.I][i] + D);
        }
        let active = self.in_command.is_active(v);
        for j in 0..self.u.len() {
            let wanted = dot(v.matrix(self.S).row(j).iter(), &y[self.v]);
            let wanted = S::select(active, wanted, v[self.in_command.u_manual][j]);
            let u = within(wanted, v[self.u_min][j], v[self.u_max][j]);
            (y[self.unlimited][j], y[self.u][j], y[self.cut][j]) = (wanted, u, u - wanted);
        }
    }

    /// I' = K_i (r − y) + [S⁻¹ (u − S v)]_i/T_t, or 0 under manual control; w' = N ((c r − y) − w) always.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let active = self.in_command.is_active(v);
        for i in 0..self.I.len() {
            let integral = || v[self.K_i][i] * self.tracking_error(i, v) + self.tracked(i, v);
            dx[self.I][i] = S::branch(active, integral, || S::from(0.0));
            dx[self.w][i] = v[self.N][i] * self.unfiltered(i, v);
        }
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed.
    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| self.take_over(v));
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        // Without desired dynamics there is no settling time: the time at the limit is reported, without a warning.
        let active = self.in_command.is_active(&v.values());
        self.supervised.look((t, step), S::from(f64::INFINITY), active, v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

impl Pid {
    /// Watches angles that aren't declared.
    fn watching(self, d: &mut Declaration) -> Self {
        let jumps = Jumps::declare(d, self.y, &self.units_of_y, &self.angles);
        Pid { jumps, ..self }
    }

    /// The reference with a weight, minus the output.
    fn weighted<S: Scalar>(&self, weight: VectorOf<Parameter>, i: usize, v: &Values<S>) -> S {
        v[weight][i] * v[self.r][i] - v[self.y][i]
    }

    /// (c r − y) − w; of an angle, with the c r − y nearest to w.
    fn unfiltered<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.angles.difference(i, self.weighted(self.c, i, v) - v[self.w][i])
    }

    /// P and D of a channel. P of an angle follows from the error within half a turn, b being 1.
    fn parts<S: Scalar>(&self, i: usize, v: &Values<S>) -> [S; 2] {
        let P = v[self.K_p][i] * self.angles.difference(i, self.weighted(self.b, i, v));
        let D = v[self.K_d][i] * v[self.N][i] * self.unfiltered(i, v);
        [P, D]
    }

    /// [S⁻¹ (u − S v)]_i/T_t: exactly 0 within the limits. u is what the actuators achieve of it, where that is known.
    fn tracked<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let time = v[self.T_t][i];
        let shares = v.matrix(self.S_inverse);
        let further = |u: VectorOf<Input>| {
            let cut = |j: usize| shares[(i, j)] * (v[u][j] - v[self.u][j]);
            (0..self.u.len()).fold(S::from(0.0), |sum, j| sum + cut(j))
        };
        let left = || {
            let by_own_limits = dot(shares.row(i).iter(), &v[self.cut]);
            self.u_achieved.map_or(by_own_limits, |u| by_own_limits + further(u)) / time
        };
        S::branch(time.above(S::from(0.0)), left, || S::from(0.0))
    }

    /// I := S⁻¹ u − P − D: the control stays where the manual one is, within the limits.
    fn take_over<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.I.len() {
            let values = v.values();
            let [P, D] = self.parts(i, &values);
            let manual = |j: usize| within(v[self.in_command.u_manual][j], v[self.u_min][j], v[self.u_max][j]);
            let shares = (0..self.u.len()).map(|j| v[self.S_inverse.at(i, j)] * manual(j));
            v[self.I][i] = shares.fold(S::from(0.0), |sum, share| sum + share) - P - D;
        }
    }

    /// T_t of a channel: √(K_d/K_i) unless given; K_p/K_i without derivative, and 1/N with the integral only. It is 0
    /// without back-calculation or integral part.
    fn time_in_force<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let [K_p, K_i, K_d] = [self.K_p, self.K_i, self.K_d].map(|gain| v[gain][i]);
        let (given, none) = (v[self.tracking_time][i], S::from(0.0));
        let without_derivative = || S::branch(K_p.above(none), || K_p / K_i, || v[self.N][i].recip());
        let by_gains = || S::branch(K_d.above(none), || (K_d / K_i).sqrt(), without_derivative);
        let in_force = || S::branch(given.equals(S::from(BY_GAINS)), by_gains, || given);
        S::branch(K_i.equals(none), || none, in_force)
    }

    /// Refuses weights of an angle's reference: parts of an angle aren't the same for angles that differ by whole turns.
    fn check_weights<S: Scalar>(&self, i: usize, v: &mut Point<S>) {
        if !self.angles.has(i) {
            return;
        }
        let (b, c, one) = (v[self.b][i], v[self.c][i], S::from(1.0));
        let why = format!("channel {} is an angle (angles)", i + 1);
        v.refuse(!b.equals(one), |v| Invalid::new(v.name(self.b.at(i)), b.to_text(), format!("must be 1: {why}")));
        v.refuse(!(c.equals(S::from(0.0)) | c.equals(one)), |v| {
            Invalid::new(v.name(self.c.at(i)), c.to_text(), format!("must be 0 or 1: {why}"))
        });
    }

    /// Refuses a given tracking time that is none.
    fn check_time<S: Scalar>(&self, i: usize, v: &mut Point<S>) {
        let time = v[self.tracking_time][i];
        let is_known = time.equals(S::from(BY_GAINS)) | time.equals(S::from(0.0));
        v.refuse(!is_known & time.below(S::from(LEAST_TIME)), |v| {
            let allowed = format!("must be {BY_GAINS} (by the gains), 0 (off), or at least {} s", Number(LEAST_TIME));
            Invalid::new(v.name(self.tracking_time.at(i)), time.to_text(), allowed)
        });
    }
}

impl Catalogued for Pid {
    const PAGE: Page = pages::PID;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: Some(Needs::Outputs),
        tried: &[Sizes::inputs(3), Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(3, 2), Sizes::plant(6, 3)],
    });
    const TRIAL: Trial = Trial {
        // An error, which a description may start with, is integrated for ever.
        steady: "y = 0.0",
        ..Trial::NONE
    };
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "r",
        stimulus: Stimulus::Step,
        constant_inputs: &["y"],
        output: "u",
        shows_all: false,
        scale: |of, stop_time| {
            let (K_p, K_i) = (of("K_p"), of("K_i"));
            // Until the integral is as large as what is proportional.
            let duration = if K_p > 0.0 && K_i > 0.0 { stop_time.min(K_p / K_i) } else { stop_time };
            Some(Scale { about: 0.0, size: 1.0, duration })
        },
        example: "",
    });
}
