//! Robust model reference adaptive control with prescribed performance (thesis, chapter 6).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod bounded;
mod report;
mod sampled;
mod samples;
mod template;
mod turning;

use nalgebra::DMatrix;
use serde::Deserialize;

use super::angles::{Angles, Jumps};
use super::at_limit::unlimited;
use super::funnel::{self, Funnel, Inside};
use super::moves::Moves;
use super::origins::Origins;
use super::sampling::{Evaluation, prediction_steps};
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits::{self, within};
use crate::mathematics::lyapunov;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, ChoiceOf, Declaration, DesignReport, DifferenceOf, Discrete, Input, IntegerOf, Invalid, MatrixOf,
    Memory, Parameter, Point, Rates, Scalar, ScalarOf, Signal, Signals, State, System, Unit, Values, VectorOf, Warning,
    boolean, larger, matrix, quantities, scalar, vector,
};
use crate::template::{Sizes, Template};
use bounded::Bounded;
use samples::Samples;

/// Nominal matrices: n states, of which each is controlled by its channel.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MracStructure {
    /// Nominal dynamics, n rows of n numbers.
    A: Vec<Vec<f64>>,
    /// Input matrix of rank n: n rows of n numbers or more.
    B: Vec<Vec<f64>>,
    /// States that are angles, counted from 1: values that differ by whole turns are the same. Their unit is rad.
    #[serde(default)]
    angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    units: Symbols,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Quantities {
    /// Quantities of the plant's state, of the reference and of its model.
    x: Vec<String>,
    /// Quantities of the control.
    u: Vec<String>,
}

/// Units of the state and the control; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct Symbols {
    /// Units of the plant's state.
    x: Vec<String>,
    /// Units of the control.
    u: Vec<String>,
}

/// u = B⁺(−A x + A_m (x_m − r) + z ρ' − θ̂ᵀx − σ̂ᵀψ − ᾱ tanh(ε/φ) − K_ε ε), channel by channel.
#[derive(Debug)]
pub struct MracPpf {
    A: DMatrix<f64>,
    /// Pseudoinverse of B.
    B_inverse: DMatrix<f64>,
    A_m: MatrixOf<Parameter>,
    gamma_1: VectorOf<Parameter>,
    gamma_2: VectorOf<Parameter>,
    beta: VectorOf<Parameter>,
    upsilon: VectorOf<Parameter>,
    psi: VectorOf<Parameter>,
    alpha_bar: VectorOf<Parameter>,
    K_epsilon: VectorOf<Parameter>,
    switching_width: ScalarOf<Parameter>,
    x_m0: VectorOf<Parameter>,
    law: ChoiceOf<Parameter, Evaluation>,
    prediction_steps: IntegerOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    funnel: Funnel,
    r: VectorOf<Input>,
    x: VectorOf<Input>,
    x_m: VectorOf<State>,
    /// A column a channel.
    theta_hat: MatrixOf<State>,
    /// Integral part of σ̂, a column a channel.
    integral: MatrixOf<State>,
    sigma_hat: MatrixOf<Signal>,
    /// u before its limits, or its last sample.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    /// e = x − x_m
    e: DifferenceOf,
    /// True if the unit is stepped by a master of co-simulation.
    is_stepped: BooleanOf<Memory>,
    /// Clock of the sampled controller, and its values between samples.
    samples: Samples,
    moves: Moves,
    step_too_long: BooleanOf<Discrete>,
    long_step: Warning,
    bounded: Bounded,
    angles: Angles,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
}

/// Nominal magnitude of e in normal operation, relative to x and x_m.
const ERROR_NOMINAL: f64 = 1e-9;

impl System for MracPpf {
    type Structure = MracStructure;
    const NAME: &'static str = "mrac-ppf";
    const DOCUMENTATION: &'static str = pages::MRAC_PPF.text;

    fn declare(structure: MracStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let (A, B_inverse) = structure.matrices()?;
        let (n, m) = (A.nrows(), B_inverse.nrows());
        let unit_x = Unit::symbols("x", &structure.units.x, n)?;
        let unit_u = Unit::symbols("u", &structure.units.u, m)?;
        let gain = |name: &str, text: &str, start: f64| vector(name, n, text).start(start).min(0.0);
        let of_x = quantities("x", &structure.quantities.x, n)?;
        let of_u = quantities("u", &structure.quantities.u, m)?;
        let limit = |name: &str, size: &str| {
            vector(name, m, &format!("{size} control")).about(&of_u, &format!("{size} {{}}")).units(&unit_u)
        };
        let (x, x_m) = (
            d.input(vector("x", n, "measured state of the plant").about(&of_x, "measured {}").units(&unit_x)),
            d.state(
                vector("x_m", n, "state of the reference model")
                    .about(&of_x, "{} of the reference model")
                    .units(&unit_x)
                    .source("Hashim (6.2)"),
            ),
        );
        let is_stepped = d.is_stepped();
        let angles = Angles::of(&structure.angles, "x", &unit_x)?;
        Ok(MracPpf {
            A_m: d.parameter(matrix("A_m", n, n, "state matrix of the reference model").unit("1/s").identity()),
            gamma_1: d.parameter(gain("gamma_1", "adaptation gain of theta_hat", 5e4)),
            gamma_2: d.parameter(gain("gamma_2", "adaptation gain of sigma_hat", 5e4)),
            beta: d.parameter(gain("beta", "proportional part of the adaptation of sigma_hat", 2.0)),
            upsilon: d.parameter(gain("upsilon", "leakage of sigma_hat", 0.05)),
            psi: d.parameter(vector("psi", n, "regressor of sigma_hat").start(2.0)),
            alpha_bar: d.parameter(gain("alpha_bar", "gain of the smoothed sign of epsilon", 10.0)),
            K_epsilon: d.parameter(vector("K_epsilon", n, "gain of epsilon").start(0.1).positive()),
            switching_width: d.parameter(
                scalar("switching_width", "epsilon within which the sign is smoothed, phi").start(0.01).positive(),
            ),
            x_m0: d.parameter(vector("x_m0", n, "initial state of the reference model").units(&unit_x).fixed()),
            law: d.parameter(Evaluation::parameter("evaluation of the control law").type_name("MracLaw")),
            prediction_steps: d.parameter(prediction_steps()),
            u_min: d.parameter(limit("u_min", "smallest").no_lower_limit()),
            u_max: d.parameter(limit("u_max", "largest").no_upper_limit()),
            funnel: Funnel::declare(d, (&unit_x, &of_x), [2.0, 0.05, 1.5]).of_angles(angles.clone()),
            r: d.input(vector("r", n, "reference").about(&of_x, "reference of {}").units(&unit_x)),
            theta_hat: d.state(matrix("theta_hat", n, n, "estimate of theta, a column for each channel").source("Hashim (6.20)")),
            integral: d.state(matrix("sigma_integral", n, n, "integral part of sigma_hat, a column for each channel").source("Hashim (6.21)")),
            sigma_hat: d.local(matrix("sigma_hat", n, n, "estimate of the disturbance's bound, a column for each channel").source("Hashim (6.21)")),
            u: d.output(vector("u", m, "control").about(&of_u, "commanded {}").units(&unit_u).source("Hashim (6.19), (6.24)")),
            unlimited: unlimited(d, m),
            e: d.difference(x, x_m, ERROR_NOMINAL),
            is_stepped,
            moves: Moves::declare(d, m, is_stepped),
            samples: Samples::declare(d, n, m),
            step_too_long: d.discrete(
                boolean(
                    "step_too_long",
                    "whether the communication step is too long for the control law or the control, or longer than the sample time",
                )
                .output(),
            ),
            long_step: d.warning("logStepTooLong", "communication step too long for the control law or the control"),
            bounded: Bounded::declare(d, n),
            origins: Origins::declare(d, turning::turning(&angles, &A), "a reference"),
            jumps: Jumps::declare(d, x, &unit_x, &angles),
            angles,
            A,
            B_inverse,
            x,
            x_m,
        })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        lyapunov::require_hurwitz(&v.name(self.A_m), &v.matrix(self.A_m).into_owned())
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.funnel.relate(v);
        self.samples.sampling.relate(v);
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        Evaluation::require_steps(self.law, self.is_stepped, v);
        v.copy(self.x_m0, self.x_m);
        v[self.theta_hat.elements()].fill(S::from(0.0));
        v[self.integral.elements()].fill(S::from(0.0));
        self.start_origins(v);
        self.funnel.open(t, |i, v| self.error(i, v), v);
        self.begin_sampling(t, v);
        self.hold_nominal_control(t, v);
    }

    fn parameters_changed<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.samples.discretise(self.A_m, v);
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        let n = self.x.len();
        y.slice(self.u).fill(S::from(0.0));
        for i in 0..n {
            let inside = self.inside(i, t, v);
            self.funnel.show(i, &inside, y);
            let mut sigma = S::from(0.0);
            for j in 0..n {
                let estimate = self.sigma_hat(i, j, inside.epsilon, v);
                y[self.sigma_hat.at(j, i)] = estimate;
                sigma += estimate * v[self.psi][j];
            }
            let wanted = self.wanted_rate(i, &inside, sigma, v);
            let parts = y.slice(self.u).iter_mut().zip(self.B_inverse.column(i));
            parts.for_each(|(u, &of_channel)| *u += wanted * of_channel);
        }
        for k in 0..self.u.len() {
            let u = self.u.at(k);
            let (is_sampled, sampled, wanted) = (self.is_sampled(v), v[self.samples.control][k], y[u]);
            y[self.unlimited.at(k)] = S::branch(is_sampled, || sampled, || wanted);
            y[u] = S::branch(is_sampled, || sampled, || within(wanted, v[self.u_min][k], v[self.u_max][k]));
        }
    }

    /// x_m' = A_m (x_m − r); θ̂' = γ_1 Proj(ε R x − υ_θ R |ε| θ̂); I' = γ_2 R (ε ψ − |ε| υ σ̂).
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let n = self.x.len();
        let is_sampled = self.is_sampled(v);
        for i in 0..n {
            dx[self.x_m.at(i)] = self.model_rate(i, v);
            let Inside { epsilon, R, .. } = self.inside(i, t, v);
            for j in 0..n {
                let adaptation = || {
                    let integral = self.integral_rate(i, j, (epsilon, R), v[self.sigma_hat.at(j, i)], v);
                    (self.theta_rate(i, j, (epsilon, R), v), integral)
                };
                let (theta, integral) = S::branch(is_sampled, || (S::from(0.0), S::from(0.0)), adaptation);
                dx[self.theta_hat.at(j, i)] = theta;
                dx[self.integral.at(j, i)] = integral;
            }
        }
    }

    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.funnel.check(t, |i, v| self.error(i, v), v);
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        self.funnel.event_indicators(t, |i, v| self.error(i, v), v, z);
        self.origin_indicators(v, z);
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.samples.sampling.clock.next(v)
    }

    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.move_origins(v);
        self.funnel.event(t, |i, v| self.error(i, v), v);
        let is_due = self.samples.sampling.clock.next(&v.values()).at_most(t);
        v.when(is_due, |v| {
            self.sample(v);
            // x_m is set at a sample: where that takes an error out of its funnel, this is the event of it.
            self.funnel.event(t, |i, v| self.error(i, v), v);
        });
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let is_sampled = self.is_sampled(&v.values());
        let is_continuous = v.get(self.is_stepped) & !is_sampled;
        self.count_projections(v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        v.when(is_sampled, |v| self.keep_to_communication_points(t, step, v));
        v.when(is_continuous, |v| self.warn_of_long_step(step, v));
    }
}

impl MracPpf {
    fn is_sampled<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.is_stepped) & !v.get(self.law).is(Evaluation::Continuous)
    }

    fn inside<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> Inside<S> {
        self.funnel.inside(i, t, self.error(i, v), v)
    }

    /// σ̂ = (I + β γ_2 ε ψ)/(1 + β γ_2 υ |ε|)
    fn sigma_hat<S: Scalar>(&self, i: usize, j: usize, epsilon: S, v: &Values<S>) -> S {
        let gain = v[self.beta][i] * v[self.gamma_2][i];
        (v[self.integral.at(j, i)] + gain * epsilon * v[self.psi][j])
            / (gain * v[self.upsilon][i] * epsilon.abs() + 1.0)
    }

    /// I' of an element.
    fn integral_rate<S: Scalar>(&self, i: usize, j: usize, (epsilon, R): (S, S), sigma_hat: S, v: &Values<S>) -> S {
        let leakage = epsilon.abs() * v[self.upsilon][i] * sigma_hat;
        v[self.gamma_2][i] * R * (epsilon * v[self.psi][j] - leakage)
    }

    /// A_m (x_m − r)
    fn model_rate<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let A_m = v.matrix(self.A_m);
        (0..self.x.len()).fold(S::from(0.0), |sum, j| sum + A_m[(i, j)] * (v[self.x_m][j] - self.reference(j, v)))
    }

    /// −A x
    fn against_nominal<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        (0..self.x.len()).fold(S::from(0.0), |sum, j| sum - self.state(j, v) * self.A[(i, j)])
    }

    /// θ̂ᵀx
    fn estimated<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        (0..self.x.len()).fold(S::from(0.0), |sum, j| sum + v[self.theta_hat.at(j, i)] * self.state(j, v))
    }

    /// B u of a channel, from σ̂ᵀψ.
    fn wanted_rate<S: Scalar>(&self, i: usize, inside: &Inside<S>, sigma: S, v: &Values<S>) -> S {
        let Inside { performance, z, epsilon, .. } = *inside;
        self.against_nominal(i, v) + self.model_rate(i, v) + z * performance.rate
            - self.estimated(i, v)
            - sigma
            - self.robust(i, epsilon, v)
    }

    /// ᾱ tanh(ε/φ) + K_ε ε
    fn robust<S: Scalar>(&self, i: usize, epsilon: S, v: &Values<S>) -> S {
        v[self.alpha_bar][i] * (epsilon / v[self.switching_width]).tanh() + v[self.K_epsilon][i] * epsilon
    }

    /// Fastest decay rate of an error under the continuous controller, in 1/s, for a plant with input gain 1. With a
    /// zero-order hold, the loop of that channel oscillates if the step exceeds 1/s to 2/s, depending on the order in
    /// which components are stepped.
    fn decay<S: Scalar>(&self, v: &Values<S>) -> S {
        let psi = v[self.psi].iter().fold(S::from(0.0), |sum, &psi| sum + psi * psi);
        let rate = (0..self.x.len()).map(|i| {
            let gain = psi * v[self.beta][i] * v[self.gamma_2][i]
                + v[self.alpha_bar][i] / v[self.switching_width]
                + v[self.K_epsilon][i];
            gain / self.funnel.narrowest(i, v)
        });
        rate.fold(S::from(0.0), larger)
    }

    /// The longest communication step for the continuous law, s.
    fn longest_step<S: Scalar>(&self, v: &Values<S>) -> S {
        self.decay(v).recip()
    }

    fn warn_of_long_step<S: Scalar>(&self, step: S, v: &mut Point<S>) {
        let longest = self.longest_step(&v.values());
        let (too_long, moved) = (step.above(longest), self.moves.look(self.u, step, v));
        v.put(self.step_too_long, too_long | moved.flag);
        v.when(too_long, |v| {
            let rate = self.decay(&v.values());
            v.warn(self.long_step, |v| {
                format!(
                    "the communication step {} s is too long for the continuous law with these gains, whose error decays at \
                     {} 1/s where the plant's input gain is 1. Use {} s or less, {} = sampled, or the loop as a single FMU",
                    step.scientific(3),
                    rate.scientific(3),
                    longest.scientific_at_most(1),
                    v.name(self.law)
                )
            });
        });
        v.when(moved.flag & !too_long, |v| v.warn(self.long_step, |_| moved.warning(step, ", or a single FMU")));
    }
}

impl MracStructure {
    /// A, and the pseudoinverse of B.
    fn matrices(&self) -> Result<(DMatrix<f64>, DMatrix<f64>), Invalid> {
        let read = |name: &str, rows: &[Vec<f64>]| {
            let columns = rows.first().map_or(0, Vec::len);
            if columns == 0 || rows.iter().any(|row| row.len() != columns) {
                return Err(Invalid::because(format!("{name} must have rows of one size")));
            }
            Ok(DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j]))
        };
        let (A, B) = (read("A", &self.A)?, read("B", &self.B)?);
        let (n, m) = B.shape();
        if A.shape() != (n, n) {
            let allowed = format!("must be {n} × {n}, as B has {n} rows");
            return Err(Invalid::new("size of A", format!("{} × {}", A.nrows(), A.ncols()), allowed));
        }
        let rank = B.rank(1e-9 * B.amax());
        if rank < n {
            let allowed = format!("must be {n}: each of {n} states needs a control of its own (B is {n} × {m})");
            return Err(Invalid::new("rank of B", rank, allowed));
        }
        let inverse = B.pseudo_inverse(0.0).map_err(|reason| Invalid::because(format!("B: {reason}")))?;
        Ok((A, inverse))
    }
}

impl Catalogued for MracPpf {
    const PAGE: Page = pages::MRAC_PPF;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[Sizes::plant(1, 1), Sizes::plant(3, 3), Sizes::plant(6, 6)],
    });
    const TRIAL: Trial = Trial {
        alone: funnel::OPEN,
        // Without an error nothing adapts.
        steady: "x = 0.0",
        // Not sampled, with gains that no funnel's edge needs.
        smooth: "law = 'continuous'\nswitching_width = 0.5\ngamma_1 = 5.0\ngamma_2 = 5.0\nbeta = 0.2",
        ..Trial::NONE
    };
}
