//! Robust adaptive observer: the state of an uncertain plant from its output (thesis, chapter 7).
#![allow(non_snake_case)] // matrices have the names of the thesis

mod report;
mod turning;

use nalgebra::{Complex, DMatrix, DMatrixView};
use serde::{Deserialize, Serialize};

use super::angles::{Angles, Jumps};
use super::l1::{dot, input_and_output, nominal_dynamics, of_motion, squared};
use super::origins::Origins;
use super::template::{design, stop_time, write_nominal, write_plant, write_poles};
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::{lyapunov, pole_placement};
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, DesignReport, Input, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar,
    ScalarOf, Signal, Signals, State, System, Unit, Values, VectorOf, boolean, matrix, of_outputs, quantities, scalar,
    vector,
};
use crate::template::{
    Begun, Request, Sizes, Template, all, named, round_down, write_magnitudes, write_names, write_quantities,
    write_units,
};

/// Form of the gain k_l.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObserverDynamics {
    /// Given by the poles of A − k_l C.
    #[default]
    Poles,
    /// Given as it is.
    Gain,
}

/// The description of an observer's structure.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObserverStructure {
    /// Nominal dynamics, n rows of n numbers.
    A: Vec<Vec<f64>>,
    /// Nominal input matrix, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Matrix of the measured outputs, m rows of n numbers.
    C: Vec<Vec<f64>>,
    /// Form of the gain.
    #[serde(default)]
    observer_dynamics: ObserverDynamics,
    /// Measured outputs that are angles, counted from 1: values that differ by whole turns are the same. Their unit is rad, and each
    /// is a state.
    #[serde(default)]
    angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    units: Units,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Quantities {
    /// Quantities of the plant's state.
    x: Vec<String>,
    /// Quantities of the measured output; if not given, those of the states that C selects.
    y: Vec<String>,
    /// Quantities of the plant's input.
    u: Vec<String>,
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Units {
    /// Units of the plant's state.
    x: Vec<String>,
    /// Units of the measured output.
    y: Vec<String>,
    /// Units of the plant's input.
    u: Vec<String>,
}

/// k_l.
#[derive(Debug)]
enum Gain {
    Given(MatrixOf<Parameter>),
    Placed { pole_real: VectorOf<Parameter>, pole_imag: VectorOf<Parameter>, k_l: MatrixOf<Prepared> },
}

/// x̆' = A x̆ − k_l ỹ − β̆ β_l B ỹ + g(y, u) with ỹ = C x̆ − y.
#[derive(Debug)]
pub struct Observer {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    k_l: Gain,
    Gamma_l: ScalarOf<Parameter>,
    sigma_l: ScalarOf<Parameter>,
    beta_error_power: ScalarOf<Parameter>,
    lambda_0: ScalarOf<Parameter>,
    d_0: ScalarOf<Parameter>,
    unmodeled_gain: ScalarOf<Parameter>,
    known_input: BooleanOf<Parameter>,
    nominal_inertia: VectorOf<Parameter>,
    x_obs0: VectorOf<Parameter>,
    beta0: ScalarOf<Parameter>,
    delta0: ScalarOf<Parameter>,
    y: VectorOf<Input>,
    u: VectorOf<Input>,
    /// x̆, angles counted from their origins.
    x_obs: VectorOf<State>,
    /// x̆ as it is put out, where it has angles.
    whole: Option<VectorOf<Signal>>,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
    beta: ScalarOf<State>,
    delta: ScalarOf<State>,
    /// ỹ
    y_tilde: VectorOf<Signal>,
    beta_l: ScalarOf<Signal>,
}

impl System for Observer {
    type Structure = ObserverStructure;
    const NAME: &'static str = "observer";
    const DOCUMENTATION: &'static str = pages::OBSERVER.text;

    fn declare(structure: ObserverStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let (B, C) = input_and_output(&structure.B, &structure.C)?;
        let A = nominal_dynamics(&structure.A, &B)?;
        let (n, m) = B.shape();
        let x = Unit::symbols("x", &structure.units.x, n)?;
        let y = Unit::symbols("y", &structure.units.y, m)?;
        let u = Unit::symbols("u", &structure.units.u, m)?;
        let inertia: Vec<_> = u.iter().map(|unit| of_motion(unit).1).collect();
        let of_x = quantities("x", &structure.quantities.x, n)?;
        let of_u = quantities("u", &structure.quantities.u, m)?;
        let of_y = match &structure.quantities.y[..] {
            [] => of_outputs(&C, &of_x),
            given => quantities("y", given, m)?,
        };
        let angles = Angles::of(&structure.angles, "y", &y)?;
        let turning = turning::turning(&angles, &A, &C, &x)?;
        let has_angles = !turning.is_empty();
        let estimate = |name: &str, text: &str| vector(name, n, text).about(&of_x, "estimated {}").units(&x).output();
        let number = |name: &str, text: &str, start: f64| scalar(name, text).start(start).min(0.0);
        let output_error = "error of the estimated {}, estimated minus measured";
        Ok(Observer {
            k_l: Gain::declare(d, structure.observer_dynamics, (n, m)),
            Gamma_l: d.parameter(number("Gamma_l", "adaptation gain of beta", 100.0).unit("1/s")),
            sigma_l: d.parameter(number("sigma_l", "leakage of beta", 1e-4)),
            beta_error_power: d.parameter(
                scalar("beta_error_power", "power of the output error's norm in the adaptation of beta")
                    .start(1.0)
                    .positive(),
            ),
            lambda_0: d.parameter(scalar("lambda_0", "decay rate of delta").unit("1/s").start(2.5).positive()),
            d_0: d.parameter(number("d_0", "constant excitation of delta", 0.625).unit("1/s")),
            unmodeled_gain: d.parameter(number("unmodeled_gain", "gain from |y|^4 to delta", 1.0).unit("1/s")),
            known_input: d.parameter(boolean("known_input", "whether the plant's nominal input is made use of")),
            nominal_inertia: d.parameter(
                vector("nominal_inertia", m, "nominal inertia: the input in parts of it acts through B")
                    .units(&inertia)
                    .start(1.0)
                    .positive(),
            ),
            x_obs0: d.parameter(
                vector("x_obs0", n, "initial estimate of the plant's state")
                    .about(&of_x, "initial estimate of {}")
                    .units(&x)
                    .fixed(),
            ),
            beta0: d.parameter(number("beta0", "initial value of beta", 1.0).fixed()),
            delta0: d.parameter(scalar("delta0", "initial value of delta").start(1.0).positive().fixed()),
            y: d.input(vector("y", m, "measured output of the plant").about(&of_y, "measured {}").units(&y)),
            u: d.input(
                vector("u", m, "input of the plant, used with known_input")
                    .about(&of_u, "commanded {}, used with known_input")
                    .units(&u),
            ),
            x_obs: if has_angles {
                let text = "estimate of the plant's state, angles counted from their origins";
                d.state(vector("x_obs_local", n, text).units(&x).source("Hashim (7.7)"))
            } else {
                d.state(estimate("x_obs", "estimate of the plant's state").source("Hashim (7.7)"))
            },
            whole: has_angles.then(|| d.output(estimate("x_obs", "estimate of the plant's state"))),
            jumps: None,
            origins: Origins::declare(d, turning, "an estimated angle"),
            beta: d.state(scalar("beta", "adaptive gain of the output error").output().source("Hashim (7.9)")),
            delta: d
                .state(scalar("delta", "bound on the effect of unmodeled dynamics").output().source("Hashim (7.11)")),
            y_tilde: d.local(
                vector("y_tilde", m, "output error, estimated minus measured").about(&of_y, output_error).units(&y),
            ),
            beta_l: d.local(
                scalar("beta_l", "growth of the uncertainty with output, estimate and delta").source("Hashim (7.10)"),
            ),
            A,
            B,
            C,
        }
        .watching(&y, &angles, d))
    }

    /// A − k_l C must be Hurwitz.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        if let Gain::Placed { pole_real, pole_imag, k_l } = &self.k_l {
            let poles = v[*pole_real].iter().zip(&v[*pole_imag]).map(|(&re, &im)| Complex::new(re, im));
            let gain = placed(&self.A, &self.C, &poles.collect::<Vec<_>>())?;
            v.matrix_mut(*k_l).copy_from(&gain);
        }
        let closed = &self.A - self.k_l.matrix(&v.values()) * &self.C;
        lyapunov::require_hurwitz(&format!("A - {} C", self.k_l.name(&v.values())), &closed)
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        self.start_estimate(v);
        v.copy(self.beta0, self.beta);
        v.copy(self.delta0, self.delta);
    }

    /// ỹ = C x̆ − y; β_l = 1 + ‖y‖⁴ + ‖x̆‖² ‖y‖⁴ + 2 δ.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let x_obs = &v[self.x_obs];
        for i in 0..self.y.len() {
            y[self.y_tilde][i] = times(&self.C, i, x_obs) - self.measured(i, v);
        }
        y[self.beta_l] = self.fourth_power(v) * (squared(x_obs) + 1.0) + v[self.delta] * 2.0 + 1.0;
        self.put_out(v, y);
    }

    /// x̆' = A x̆ − k_l ỹ − β̆ β_l B ỹ + g(y, u); β̆' = Γ_l ‖ỹ‖^q β_l − Γ_l σ_l β̆; δ' = −λ_0 δ + c ‖y‖⁴ + d_0.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (x_obs, y_tilde, beta, beta_l) = (&v[self.x_obs], &v[self.y_tilde], v[self.beta], v[self.beta_l]);
        let k_l = self.k_l.matrix(v);
        let known = v.get(self.known_input);
        for i in 0..x_obs.len() {
            let g = S::branch(known, || self.nominal_input(i, v), || S::from(0.0));
            let robust = beta * beta_l * times(&self.B, i, y_tilde);
            dx[self.x_obs][i] = times(&self.A, i, x_obs) - dot(k_l.row(i).iter(), y_tilde) - robust + g;
        }
        let error = power(squared(y_tilde), v[self.beta_error_power] * 0.5);
        dx[self.beta] = v[self.Gamma_l] * (error * beta_l - v[self.sigma_l] * beta);
        let delta_l = v[self.unmodeled_gain] * self.fourth_power(v) + v[self.d_0];
        dx[self.delta] = delta_l - v[self.lambda_0] * v[self.delta];
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.origin_indicators(v, z);
    }

    /// Moves origins of angles.
    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.move_origins(v);
    }

    fn step_completed<S: Scalar>(&self, t: S, _step: S, v: &mut Point<S>) {
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
    }
}

impl Observer {
    /// ‖y‖⁴
    fn fourth_power<S: Scalar>(&self, v: &Values<S>) -> S {
        let measured = (0..self.y.len()).map(|i| self.measured(i, v));
        let squared = measured.fold(S::from(0.0), |sum, y| sum + y * y);
        squared * squared
    }

    /// Row i of g(y, u) = B u, with u in parts of the nominal inertia.
    fn nominal_input<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let inputs = v[self.u].iter().zip(&v[self.nominal_inertia]);
        inputs.zip(self.B.row(i).iter()).fold(S::from(0.0), |sum, ((&u, &inertia), &b)| sum + u / inertia * b)
    }
}

impl Gain {
    fn declare(d: &mut Declaration, given: ObserverDynamics, (n, m): (usize, usize)) -> Self {
        let gain = |text: &str| matrix("observer_gain", n, m, text);
        let text = "gain k_l of the output error";
        if given == ObserverDynamics::Gain {
            return Gain::Given(d.parameter(gain(&format!("{text}; A - k_l C must be Hurwitz"))));
        }
        let order = "in the order of the outputs, conjugates side by side";
        let (real, imag) = (format!("real part of an observer pole, {order}"), format!("imaginary part, {order}"));
        Gain::Placed {
            pole_real: d.parameter(vector("observer_pole_real", n, &real).unit("1/s").start(-1.0)),
            pole_imag: d.parameter(vector("observer_pole_imag", n, &imag).unit("rad/s").in_own_unit()),
            k_l: d.prepared(gain(text)),
        }
    }

    fn name(&self, v: &Values<f64>) -> String {
        match self {
            Gain::Given(k_l) => v.name(*k_l),
            Gain::Placed { k_l, .. } => v.name(*k_l),
        }
    }

    fn matrix<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        match self {
            Gain::Given(k_l) => v.matrix(*k_l),
            Gain::Placed { k_l, .. } => v.matrix(*k_l),
        }
    }
}

/// k_l that gives A − k_l C these poles: the dual of state feedback.
fn placed(A: &DMatrix<f64>, C: &DMatrix<f64>, poles: &[Complex<f64>]) -> Result<DMatrix<f64>, Invalid> {
    let (A, C) = (A.transpose(), C.transpose());
    if pole_placement::controllability_indices(&A, &C).is_err() {
        let text = "A, C: the rows of C must be linearly independent, and every state must show in the output (A, C \
                    observable)";
        return Err(Invalid::because(text));
    }
    Ok(pole_placement::place(&A, &C, poles)?.transpose())
}

/// Row i of a constant matrix times a vector.
fn times<S: Scalar>(matrix: &DMatrix<f64>, i: usize, vector: &[S]) -> S {
    matrix.row(i).iter().zip(vector).fold(S::from(0.0), |sum, (&entry, &x)| sum + x * entry)
}

/// base^exponent of a base that isn't negative. At zero the derivative is none for small exponents, and taken as zero.
fn power<S: Scalar>(base: S, exponent: S) -> S {
    S::branch(base.equals(S::from(0.0)), || S::from(0.0), || base.powd(exponent))
}

impl Catalogued for Observer {
    const PAGE: Page = pages::OBSERVER;
    const ROLE: Role = Role::Observer;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template,
        is_uncertain: true,
        needs: None,
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

/// A robust adaptive observer, at first only with its nominal part.
fn template(request: &Request) -> Result<Begun, Invalid> {
    let plant = request.plant(true)?;
    let (n, m, _) = plant.sizes();
    let bandwidth = request.speed(&plant)?;
    // Four times as fast as a controller of that bandwidth.
    let poles = design::poles(&plant.A.transpose(), &plant.C.transpose(), 4.0 * bandwidth).map_err(|_| {
        Invalid::because("A, C: every state must show in the output (A, C observable), through rows of C that differ")
    })?;
    let fastest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    let step = round_down(0.1 / fastest);
    let mut text = request.begin(&Observer::PAGE, stop_time(bandwidth), step);
    text.table("structure");
    write_plant(&mut text, &plant, "measured outputs");
    text.set("observer_dynamics", "\"poles\"", "\"gain\": observer_gain is given in place of poles");
    write_units(&mut text, &[("x", &plant.x, n), ("y", &plant.y, m), ("u", &plant.u, m)]);
    write_quantities(&mut text, &[("x", plant.x.quantities()), ("u", plant.u.quantities())]);
    let (x, y, u) = (named(&plant.x, "_estimate"), named(&plant.y, ""), named(&plant.u, ""));
    write_names(&mut text, &[("x_obs", x), ("y", y), ("u", u)]);
    text.table("start");
    write_poles(&mut text, "observer_", &poles, "1/s, poles of A - k_l C: faster than the controller's");
    text.set("known_input", "true", "whether it makes use of the plant's input u");
    text.comment("The adaptive part has gain 0: it suits signals about 1, and grows with the fourth power of y.");
    text.set("beta0", "0.0", "initial gain of the robust term");
    text.set("Gamma_l", "0.0", "1/s, its adaptation gain, as 10.0");
    text.set("sigma_l", "1e-4", "its leakage");
    text.set("unmodeled_gain", "0.0", "1/s, from |y|^4 to the bound on unmodeled dynamics, as 1.0");
    text.set("x_obs0", all(0.0, n), "estimate at the start");
    let references = request.references(m)?;
    write_magnitudes(&mut text, request.plant.as_ref(), (&references, bandwidth), |of| vec![("x_obs", (&of.x).into())]);
    write_nominal(&mut text, request, bandwidth, &request.uncertainty());
    Ok(text.finish())
}
