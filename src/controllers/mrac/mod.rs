//! Model reference adaptive control by state feedback.
//!
//! K. S. Narendra, A. M. Annaswamy, Stable adaptive systems, Prentice Hall 1989; E. Lavretsky, K. A. Wise, Robust and adaptive
//! control, Springer 2013; at limits of the control S. P. Karason, A. M. Annaswamy, Adaptive control in the presence of input
//! constraints, IEEE Trans. Automatic Control 39 (1994) 2325–2330. The sampled form is this package's.
#![allow(non_snake_case)] // matrices have the names of the field

mod design;
mod estimates;
mod report;
mod sampled;
mod structure;
mod supervision;
mod template;
mod turning;

use super::angles::Jumps;
use super::at_limit::{Limited, manual, unlimited};
use super::in_command::InCommand;
use super::l1::{InputGain, PlantMatrices, Regressor, dot, infinity_norm, product, squared};
use super::origins::{Origins, Turning as _};
use super::sampling::Evaluation;
use super::supervised::Supervised;
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits::{self, within};
use crate::mathematics::projection::projection;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, ChoiceOf, Declaration, DesignReport, Discrete, Input, IntegerOf, Invalid, MatrixOf, Memory, Parameter,
    Point, Rates, Scalar, ScalarOf, Signal, Signals, State, System, Values, VectorOf, Warning, diagonal, integer,
    matrix, scalar, vector,
};
use crate::template::{Sizes, Template};
use design::Design;
use estimates::Factor;
use sampled::Samples;
pub use structure::PlainMracStructure;

/// u = u_b − κ̂ u_b − θ̂ φ(x) − σ̂ with u_b = K_g r − K_m x, for x' = A x + B Λ (u + θ φ(x) + σ), A − B K_m = A_m, where a diagonal
/// Λ > 0, θ and σ aren't known. The estimates move with s = Bᵀ P (x − x_m).
#[derive(Debug)]
pub struct Mrac {
    plant: PlantMatrices,
    regressor: Regressor,
    /// Factors of x in φ(x) = x; empty if there are none.
    regressor_gains: Vec<f64>,
    design: Design,
    law: ChoiceOf<Parameter, Evaluation>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    r: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    x: VectorOf<Input>,
    in_command: InCommand,
    x_m: VectorOf<State>,
    kappa_hat: VectorOf<State>,
    /// Row and column of each estimated entry of κ.
    entries: Vec<(usize, usize)>,
    theta_hat: MatrixOf<State>,
    sigma_hat: VectorOf<State>,
    e: VectorOf<Signal>,
    /// Bᵀ P e
    s: VectorOf<Signal>,
    /// K_g r, K_g r − K_m x, φ(x)
    command: VectorOf<Signal>,
    u_b: VectorOf<Signal>,
    phi: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    adaptation_frequency: ScalarOf<Signal>,
    samples: Samples,
    /// True if the unit is stepped by a master of co-simulation.
    is_stepped: BooleanOf<Memory>,
    projection_active: IntegerOf<Discrete>,
    at_bounds: Warning,
    supervised: Supervised,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
}

impl Tracking for Mrac {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_r.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_r.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let error = v[self.r][channel] - self.plant.output(channel, &v[self.x]);
        if self.origins.as_ref().is_some_and(|origins| origins.has(channel)) { error.wrap() } else { error }
    }
}

impl System for Mrac {
    type Structure = PlainMracStructure;
    const NAME: &'static str = "mrac";
    const DOCUMENTATION: &'static str = pages::MRAC.text;

    fn declare(structure: PlainMracStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let of_l1 = &structure.of_l1;
        let plant = of_l1.plant()?;
        let (n, m) = plant.B.shape();
        let units = of_l1.units((n, m))?;
        let (angles, turning) = of_l1.angles(&plant, &units.x)?;
        let columns = if of_l1.regressor == Regressor::State { n } else { 1 };
        let is_full = of_l1.input_gain == InputGain::Full;
        let design = Design::declare(d, &plant, of_l1, columns);
        let (of_r, of_x, of_u) = (&units.of_r, &units.of_x, &units.of_u);
        let r = d.input(vector("r", m, "reference").about(of_r, "reference of {}").units(&units.r));
        let x = d.input(vector("x", n, "measured state of the plant").about(of_x, "measured {}").units(&units.x));
        let in_command = InCommand::declare(d, "it takes over without a jump", manual(&units.u, of_u));
        let text = "that the actuator can give; the reference model knows of it";
        let limited = Limited::declare(d, (&units.u, of_u), text, "Lavretsky and Wise (2013), chapter 9");
        let unlimited = unlimited(d, m);
        let supervised = Supervised::declare(d, limited);
        let kappa = "estimate of kappa, the part of the control that is lost";
        let hidden = |name: &str, len: usize| vector(name, len, "").hidden();
        Ok(Mrac {
            regressor: of_l1.regressor,
            regressor_gains: of_l1.regressor_gains(n)?,
            law: d.parameter(Evaluation::parameter("when the control is computed").type_name("PlainMracLaw")),
            x_m: d.state(
                vector("x_m", n, "state of the reference model")
                    .about(of_x, "{} of the reference model")
                    .units(&units.x),
            ),
            kappa_hat: if is_full {
                d.state(matrix("kappa_hat", m, m, kappa)).elements()
            } else {
                d.state(diagonal("kappa_hat", m, kappa))
            },
            entries: if is_full {
                (0..m * m).map(|k| (k % m, k / m)).collect()
            } else {
                (0..m).map(|i| (i, i)).collect()
            },
            theta_hat: d.state(matrix(
                "theta_hat",
                m,
                columns,
                "estimate of theta, the uncertainty's dependence on the state",
            )),
            sigma_hat: d.state(
                vector("sigma_hat", m, "estimate of the disturbance sigma, as a control")
                    .about(of_u, "estimate of the disturbance, as such a {}")
                    .units(&units.u),
            ),
            e: d.local(
                vector("e", n, "error x - x_m of the reference model")
                    .about(of_x, "error of the reference model's {}")
                    .units(&units.x),
            ),
            s: d.local(hidden("#s", m)),
            command: d.local(hidden("#K_g r", m)),
            u_b: d.local(hidden("#u_b", m)),
            phi: d.local(hidden("#phi", columns)),
            adaptation_frequency: {
                let text = "frequency at which estimates and plant oscillate about their values";
                d.local(scalar("adaptation_frequency", text).unit("rad/s").in_own_unit())
            },
            samples: Samples::declare(d, (n, m), columns),
            is_stepped: supervised.is_stepped(),
            projection_active: d.discrete(
                integer("projection_active", "number of estimates that projection keeps within their bounds").output(),
            ),
            at_bounds: d.warning("logProjection", "estimates at their bounds"),
            supervised,
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            origins: Origins::declare(d, turning, "a reference"),
            jumps: Jumps::declare(d, x, &units.x, &angles),
            units_of_r: units.r,
            of_r: units.of_r,
            plant,
            design,
            r,
            x,
            in_command,
            unlimited,
        })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.design.prepare(&self.plant, v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.design.relate(v);
        self.samples.sampling.relate(v);
    }

    /// The reference model starts where the plant is; the estimates at 0.
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        Evaluation::require_steps(self.law, self.is_stepped, v);
        self.in_command.begin(v);
        self.start_model(v);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        for states in [self.kappa_hat, self.theta_hat.elements(), self.sigma_hat] {
            v[states].fill(S::from(0.0));
        }
        self.begin_sampling(t, v);
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.discretise(v);
    }

    /// e, s, u_b, φ(x), and u: the adaptive control, constant between samples, or the manual one, within the limits.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let (active, is_sampled) = (self.in_command.is_active(v), self.is_sampled(v));
        for i in 0..self.x.len() {
            y[self.e.at(i)] = self.state(i, v) - v[self.x_m][i];
        }
        for (i, column) in v.matrix(self.design.PB).column_iter().enumerate() {
            y[self.s.at(i)] = dot(column.iter(), &y[self.e]);
        }
        (0..self.phi.len()).for_each(|j| y[self.phi.at(j)] = self.regressor(j, v));
        for i in 0..self.u.len() {
            y[self.command.at(i)] = self.command(i, v);
            y[self.u_b.at(i)] = self.nominal_control(i, v);
        }
        for i in 0..self.u.len() {
            let law = || {
                self.adapted(i, v, |factor| match factor {
                    Factor::Control(j) => y[self.u_b][j],
                    Factor::Regressor(j) => y[self.phi][j],
                    Factor::One => S::from(1.0),
                })
            };
            let of_law = S::branch(is_sampled, || v[self.samples.control][i], law);
            let wanted = S::branch(active, || of_law, || v[self.in_command.u_manual][i]);
            y[self.unlimited.at(i)] = wanted;
            y[self.u.at(i)] = within(wanted, v[self.u_min][i], v[self.u_max][i]);
        }
        let signals = squared(&y[self.u_b]) + squared(&y[self.phi]) + 1.0;
        y[self.adaptation_frequency] = self.design.frequency(signals, v);
    }

    /// x_m' = A_m x_m + B (K_g r + what the limits have taken from u); of each estimate Γ Proj(·, s_i · what it multiplies − υ |e| ·).
    /// Under manual control the model follows the plant, and the estimates rest.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let active = self.in_command.is_active(v);
        let A_m = self.design.dynamics.A_m(v);
        for i in 0..self.x.len() {
            let row = A_m.row(i);
            let of_model = || {
                let driven = |j: usize| v[self.command][j] + v[self.u][j] - v[self.unlimited][j];
                (0..self.u.len()).fold(dot(row.iter(), &v[self.x_m]), |sum, j| sum + driven(j) * self.plant.B[(i, j)])
            };
            let following = || -dot(row.iter(), &v[self.e]);
            dx[self.x_m.at(i)] = S::branch(active, of_model, following);
        }
        let adapts = active & !self.is_sampled(v);
        let leaks = v[self.design.leakage] * magnitude(&v[self.e]);
        for k in 0..self.estimates() {
            let (place, channel, factor) = self.estimate(k);
            let rate = || {
                let multiplies = match factor {
                    Factor::Control(j) => v[self.u_b][j],
                    Factor::Regressor(j) => v[self.phi][j],
                    Factor::One => S::from(1.0),
                };
                let ((lo, hi), tolerance) = (self.bounds(k, v), v[self.design.projection_tolerance]);
                let free = v[self.s][channel] * multiplies - leaks * v[place];
                v[self.design.adaptation_gain] * projection(v[place], free, lo, hi, tolerance)
            };
            dx[place] = S::branch(adapts, rate, || S::from(0.0));
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.samples.sampling.clock.next(v)
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
        self.origin_indicators(v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed; moves origins; takes a sample that is due.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| self.take_over(v));
        self.move_origins(v);
        let is_due = self.samples.sampling.clock.next(&v.values()).at_most(t);
        v.when(is_due, |v| self.sample(v));
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.supervise((t, step), v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

impl Mrac {
    fn is_sampled<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.is_stepped) & !v.get(self.law).is(Evaluation::Continuous)
    }

    /// φ_j(x)
    fn regressor<S: Scalar>(&self, j: usize, v: &Values<S>) -> S {
        match self.regressor {
            Regressor::State => self.regressor_gains.get(j).map_or(self.state(j, v), |&gain| self.state(j, v) * gain),
            Regressor::InfinityNorm => infinity_norm(self.states(v)),
        }
    }

    /// K_g r of a control.
    fn command<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        product(v.matrix(self.design.K_g).row(i).iter(), self.references(v))
    }

    /// K_g r − K_m x
    fn nominal_control<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let command = self.command(i, v);
        match self.design.dynamics.gain() {
            Some(K_m) => command - product(v.matrix(K_m).row(i).iter(), self.states(v)),
            None => command,
        }
    }

    /// The model where the plant is, and σ̂ by which the control stays where the manual one is, as far as its bound allows.
    fn take_over<S: Scalar>(&self, v: &mut Point<S>) {
        self.put_model(v);
        v.copy(self.x_m, self.samples.x_m_before);
        self.look(v);
        for i in 0..self.u.len() {
            let by_hand = within(v[self.in_command.u_manual][i], v[self.u_min][i], v[self.u_max][i]);
            let total = v[self.sigma_hat][i] + self.sampled_law(i, &v.values());
            let bound = v[self.design.sigma_bound][i];
            v[self.sigma_hat][i] = within(total - by_hand, -bound, bound);
        }
        self.hold(v);
    }
}

/// |e|, whose derivative at 0 counts as 0.
fn magnitude<S: Scalar>(e: &[S]) -> S {
    let square = squared(e);
    S::branch(square.above(S::from(0.0)), || square.sqrt(), || S::from(0.0))
}

impl Catalogued for Mrac {
    const PAGE: Page = pages::MRAC;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(3, 1), Sizes::plant(4, 2), Sizes::plant(6, 3)],
    });
    const TRIAL: Trial = Trial {
        // Without an error nothing adapts.
        steady: "x = 0.0",
        smooth: "law = 'continuous'",
        ..Trial::NONE
    };
}
