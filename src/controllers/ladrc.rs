//! Linear active disturbance rejection control (Gao 2003; Herbst 2013).
//!
//! Z. Gao, Scaling and bandwidth-parameterization based controller tuning, American Control Conference 2003, 4989–4996.
//! G. Herbst, A simulative study on active disturbance rejection control (ADRC) as a control tool for practitioners,
//! Electronics 2 (2013) 246–279, arXiv 1908.04596.
#![allow(non_snake_case)] // matrices have the names of the field

mod report;
mod template;

use serde::{Deserialize, Serialize};

use super::angles::{Angles, Jumps};
use super::at_limit::{Limited, achieved, manual, unlimited};
use super::in_command::InCommand;
use super::inverse;
use super::l1::dot;
use super::supervised::Supervised;
use super::units::{OutputUnits, Quantities, check_channels, of_matrix, with_derivatives};
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::limits::{self, within};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, DesignReport, Input, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar, Signal, Signals,
    State, System, Values, VectorOf, matrix, vector,
};
use crate::template::{Needs, Sizes, Template};

/// Largest order of a channel.
const MOST_ORDER: usize = 3;
/// Value of `omega_o` if it follows from `omega_c`, and its ratio to that.
const BY_CONTROLLER: f64 = -1.0;
const FASTER: f64 = 10.0;

/// Knowledge of the reference in addition to its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Feedforward {
    /// Nothing: it counts as constant.
    #[default]
    None,
    /// Its derivatives, which are inputs.
    Given,
}

/// The description of the structure of an active disturbance rejection controller.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LadrcStructure {
    /// Number of tracked variables, each with a control of its own.
    channels: usize,
    /// After how many derivatives of a tracked variable the control shows: 1, 2 or 3.
    #[schemars(range(min = 1, max = MOST_ORDER))]
    order: usize,
    /// Knowledge of the reference in addition to its value.
    #[serde(default)]
    feedforward: Feedforward,
    /// Channels whose output is an angle, counted from 1: values that differ by whole turns are the same. Their unit is rad.
    #[serde(default)]
    angles: Vec<usize>,
    /// True if what the actuators achieve of the control is an input, `u_achieved`: where they limit several controls together.
    #[serde(default)]
    achieved: bool,
    /// Units of the signals.
    #[serde(default)]
    units: OutputUnits,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// u = B_0⁻¹ (u_0 − z_{n+1}) + u_b within its limits, for y^(n) = f + B_0 u with an f that nobody knows: z_{n+1} estimates
/// it.
#[derive(Debug)]
pub struct Ladrc {
    /// n
    order: usize,
    omega_c: VectorOf<Parameter>,
    omega_o: VectorOf<Parameter>,
    /// `omega_o` in force.
    omega_o_in_force: VectorOf<Prepared>,
    B_0: MatrixOf<Parameter>,
    B_0_inverse: MatrixOf<Prepared>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    /// r and its derivatives, as far as they are given.
    r: Vec<VectorOf<Input>>,
    y: VectorOf<Input>,
    units_of_y: Vec<&'static str>,
    of_y: Vec<String>,
    angles: Angles,
    jumps: Option<Jumps>,
    in_command: InCommand,
    /// The part of u that the actuators achieve, where that is known.
    u_achieved: Option<VectorOf<Input>>,
    /// Estimates of y and its derivatives, and of f: a row a channel.
    z: MatrixOf<State>,
    u_b: VectorOf<State>,
    u_0: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    supervised: Supervised,
}

impl Tracking for Ladrc {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_y.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_y.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.angles.difference(channel, v[self.r[0]][channel] - v[self.y][channel])
    }
}

impl System for Ladrc {
    type Structure = LadrcStructure;
    const NAME: &'static str = "ladrc";
    const DOCUMENTATION: &'static str = pages::LADRC.text;

    fn declare(structure: LadrcStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let LadrcStructure { channels: m, order: n, feedforward, angles, achieved: is_known, units, quantities } =
            structure;
        check_channels(m)?;
        if !(1..=MOST_ORDER).contains(&n) {
            return Err(Invalid::new("order", n, format!("must be within 1 … {MOST_ORDER}")));
        }
        let ([y, u], [of_y, of_u]) = (units.symbols(m)?, quantities.of_signals(m)?);
        let angles = Angles::of(&angles, "y", &y)?;
        let derivatives = with_derivatives(&y, n);
        let highest = &derivatives[n];
        let of_gain = of_matrix(highest, &u)?;
        let limited = Limited::declare(d, (&u, &of_u), "that the actuator can give", "Herbst, section 2");
        let unlimited = unlimited(d, m);
        let bandwidth = |name: &str, text: &str| vector(name, m, text).unit("rad/s").in_own_unit();
        let poles = "controller bandwidth: the poles that the loop is to have, as -omega_c";
        let omega_c = d.parameter(bandwidth("omega_c", poles).start(1.0).positive());
        let text = "observer bandwidth: the observer's poles, as -omega_o; -1 rad/s: ten times omega_c";
        Ok(Ladrc {
            order: n,
            omega_c,
            omega_o: d.parameter(bandwidth("omega_o", text).start(BY_CONTROLLER).min(BY_CONTROLLER)),
            omega_o_in_force: d.prepared(bandwidth("omega_o_in_force", "observer bandwidth in force")),
            B_0: d.parameter(
                matrix(
                    "B_0",
                    m,
                    m,
                    "nominal input gain: from the control to the last derivative; must have an inverse",
                )
                .identity()
                .units(&of_gain),
            ),
            B_0_inverse: d.prepared(matrix("#inverse of B_0", m, m, "").hidden()),
            r: {
                let names = ["r", "dr", "ddr", "dddr"];
                let texts = [
                    "reference",
                    "rate of the reference",
                    "second derivative of the reference",
                    "third derivative of the reference",
                ];
                let known = if feedforward == Feedforward::Given { n + 1 } else { 1 };
                let inputs = names.into_iter().zip(texts).zip(&derivatives).take(known);
                inputs
                    .map(|((name, text), units)| {
                        d.input(vector(name, m, text).about(&of_y, &format!("{text} of {{}}")).units(units))
                    })
                    .collect()
            },
            y: d.input(vector("y", m, "measured output of the plant").about(&of_y, "measured {}").units(&y)),
            in_command: InCommand::declare(d, "it takes over without a jump", manual(&u, &of_u)),
            u_achieved: achieved(d, is_known, (&u, &of_u)),
            z: d.state(
                matrix("z", m, n + 1, "estimates of the output, its derivatives, and the total disturbance")
                    .units(&derivatives.concat())
                    .source("Herbst, section 2"),
            ),
            u_b: d.state(vector("u_b", m, "the control's offset after a take-over without a jump").units(&u)),
            u_0: d.local(
                vector("u_0", m, "demand for the last derivative of y").units(highest).source("Herbst, section 2"),
            ),
            unlimited,
            supervised: Supervised::declare(d, limited),
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            units_of_y: y,
            of_y,
            jumps: None,
            angles,
        }
        .watching(d))
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        inverse::prepare(self.B_0, self.B_0_inverse, v)
    }

    /// ω_o = 10 ω_c, unless it is given.
    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        for i in 0..self.omega_o.len() {
            let (given, omega_c) = (v[self.omega_o][i], v[self.omega_c][i]);
            let by_controller = given.equals(S::from(BY_CONTROLLER));
            v.refuse(!by_controller & given.at_most(S::from(0.0)), |v| {
                let allowed = format!("must be {BY_CONTROLLER} ({FASTER} times omega_c), or above 0 rad/s");
                Invalid::new(v.name(self.omega_o.at(i)), given.to_text(), allowed)
            });
            v[self.omega_o_in_force][i] = S::branch(by_controller, || omega_c * FASTER, || given);
        }
    }

    /// z_1 = y, the others and u_b at 0.
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.in_command.begin(v);
        v[self.z.elements()].fill(S::from(0.0));
        v[self.u_b].fill(S::from(0.0));
        for i in 0..self.u.len() {
            v[self.z.at(i, 0)] = v[self.y][i];
        }
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
    }

    /// u = B_0⁻¹ (u_0 − z_{n+1}) + u_b, or the manual control, within the limits.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.u.len() {
            y[self.u_0][i] = self.wanted(i, v);
        }
        let active = self.in_command.is_active(v);
        for j in 0..self.u.len() {
            let wanted = self.law(j, |ch| y[self.u_0][ch], v) + v[self.u_b][j];
            let wanted = S::select(active, wanted, v[self.in_command.u_manual][j]);
            (y[self.unlimited][j], y[self.u][j]) = (wanted, within(wanted, v[self.u_min][j], v[self.u_max][j]));
        }
    }

    /// z_i' = z_{i+1} + C(n+1, i) ω_o^i (y − z_1), and + (B_0 u) of the channel for i = n;
    /// z_{n+1}' = ω_o^(n+1) (y − z_1); u_b' = −ω_c u_b. u is what the actuators achieve of it, where that is known.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let acting = self.u_achieved.map_or(&v[self.u], |u| &v[u]);
        let (n, z) = (self.order, self.z);
        for ch in 0..self.u.len() {
            let omega_o = v[self.omega_o_in_force][ch];
            let left = self.angles.difference(ch, v[self.y][ch] - v[z.at(ch, 0)]);
            let mut power = S::from(1.0);
            for i in 1..=n {
                power *= omega_o;
                dx[z.at(ch, i - 1)] = v[z.at(ch, i)] + power * left * binomial(n + 1, i);
            }
            dx[z.at(ch, n - 1)] += dot(v.matrix(self.B_0).row(ch).iter(), acting);
            dx[z.at(ch, n)] = power * omega_o * left;
            dx[self.u_b][ch] = -v[self.omega_c][ch] * v[self.u_b][ch];
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

impl Ladrc {
    /// Watches angles that aren't declared.
    fn watching(self, d: &mut Declaration) -> Self {
        let jumps = Jumps::declare(d, self.y, &self.units_of_y, &self.angles);
        Ladrc { jumps, ..self }
    }

    /// u_0 = Σ C(n, i − 1) ω_c^(n−i+1) (r^(i−1) − z_i) + r^(n) of a channel, i = 1 … n; a derivative that isn't given is 0.
    fn wanted<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let (n, omega_c) = (self.order, v[self.omega_c][channel]);
        let r = |derivative: usize| self.r.get(derivative).map_or(S::from(0.0), |&r| v[r][channel]);
        (1..=n)
            .rev()
            .fold((r(n), omega_c), |(sum, power), i| {
                let left = r(i - 1) - v[self.z.at(channel, i - 1)];
                // The reference and the output of an angle are read nearest to z_1: nothing else depends on the turn.
                let left = if i == 1 { self.angles.difference(channel, left) } else { left };
                (sum + power * left * binomial(n, i - 1), power * omega_c)
            })
            .0
    }

    /// B_0⁻¹ (u_0 − z_{n+1}) of a control.
    fn law<S: Scalar>(&self, control: usize, u_0: impl Fn(usize) -> S, v: &Values<S>) -> S {
        (0..self.u.len()).fold(S::from(0.0), |sum, ch| {
            sum + v[self.B_0_inverse.at(control, ch)] * (u_0(ch) - v[self.z.at(ch, self.order)])
        })
    }

    /// u_b := u_manual − B_0⁻¹ (u_0 − z_{n+1}): the control stays where the manual one is, within the limits.
    fn take_over<S: Scalar>(&self, v: &mut Point<S>) {
        for j in 0..self.u.len() {
            let manual = within(v[self.in_command.u_manual][j], v[self.u_min][j], v[self.u_max][j]);
            let values = v.values();
            let law = self.law(j, |ch| self.wanted(ch, &values), &values);
            v[self.u_b][j] = manual - law;
        }
    }
}

/// n over k.
fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |product, i| product * (n - i) as f64 / (i + 1) as f64)
}

impl Catalogued for Ladrc {
    const PAGE: Page = pages::LADRC;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: Some(Needs::Outputs),
        tried: &[
            Sizes::inputs(3),
            Sizes::plant(1, 1),
            Sizes::plant(2, 1),
            Sizes::plant(3, 1),
            Sizes::plant(6, 3),
            Sizes::plant(6, 2),
        ],
    });
}
