//! Uncertain second-order system behind an actuator: chapter 4 and example 7.5.1.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    Choice, ChoiceOf, Declaration, Input, Invalid, MatrixOf, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf,
    Signal, Signals, State, System, Values, VectorOf, choice, matrix, scalar, vector,
};

/// Unknown part of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Uncertainty {
    /// The first of chapter 4.
    TimeInvariant,
    /// The second of chapter 4.
    TimeVarying,
    /// That of example 7.5.1.
    UnmodeledDynamics,
}

impl Choice for Uncertainty {
    const TYPE: &'static str = "Uncertainty";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::TimeInvariant, "time_invariant", "nonlinear terms with constant coefficients"),
        (
            Self::TimeVarying,
            "time_varying",
            "nonlinear terms with coefficients that vary with time, a disturbance, and unmodeled dynamics",
        ),
        (
            Self::UnmodeledDynamics,
            "unmodeled_dynamics",
            "nonlinear terms with constant coefficients, and unmodeled dynamics",
        ),
    ];
}

/// x1'' = μ + f(x, z, t), with actuator μ and unmodeled dynamics z.
#[derive(Debug)]
pub struct ActuatedSiso {
    x0: VectorOf<Parameter>,
    mu0: ScalarOf<Parameter>,
    z0: VectorOf<Parameter>,
    c: MatrixOf<Parameter>,
    actuator_rate: ScalarOf<Parameter>,
    terms: Terms,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    mu: ScalarOf<State>,
    z: VectorOf<State>,
    y: VectorOf<Signal>,
}

/// Parameters of f.
#[derive(Debug)]
struct Terms {
    uncertainty: ChoiceOf<Parameter, Uncertainty>,
    coefficient: VectorOf<Parameter>,
    z_coefficient: ScalarOf<Parameter>,
    mean: VectorOf<Parameter>,
    amplitude: VectorOf<Parameter>,
}

/// The coefficients of f = a·(x1², x2², x1 sin x1², x2 cos(x2² + φ)) + d + b z².
struct Coefficients<S> {
    a: [S; 4],
    phi: S,
    d: S,
    b: S,
}

impl System for ActuatedSiso {
    type Structure = NoStructure;
    const NAME: &'static str = "actuated-siso";
    const DOCUMENTATION: &'static str = pages::ACTUATED_SISO.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(ActuatedSiso {
            x0: d.parameter(vector("x0", 2, "").each(&["initial x1", "initial x2"]).units(&["1", "1/s"]).fixed()),
            mu0: d.parameter(scalar("mu0", "initial value of the actuator's output").fixed()),
            z0: d.parameter(vector("z0", 2, "initial state of the unmodeled dynamics").fixed()),
            c: d.parameter(matrix("C", 1, 2, "output matrix: y = C x").starts(&[1.0, 0.0]).units(&["1", "s"])),
            actuator_rate: d.parameter(
                scalar("actuator_rate", "rate of the actuator, the negative of its pole")
                    .unit("1/s")
                    .start(75.0)
                    .positive(),
            ),
            terms: Terms::declare(d),
            u: d.input(vector("u", 1, "control, the actuator's command")),
            x: d.state(
                vector("x", 2, "")
                    .each(&["x1", "x2, the rate of x1"])
                    .units(&["1", "1/s"])
                    .output()
                    .source("Hashim, chapter 4"),
            ),
            mu: d.state(scalar("mu", "output of the actuator").source("Hashim, chapter 4")),
            z: d.state(
                vector("z", 2, "")
                    .each(&["output of the unmodeled dynamics", "second state of the unmodeled dynamics"])
                    .source("Hashim, chapter 4"),
            ),
            y: d.output(vector("y", 1, "tracked output, C x")),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
        v.copy(self.mu0, self.mu);
        v.copy(self.z0, self.z);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [x1, x2] = v.array(self.x);
        y.set(self.y, [v[self.c.at(0, 0)] * x1 + v[self.c.at(0, 1)] * x2]);
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        let [z1, z2] = v.array(self.z);
        let ([u], mu) = (v.array(self.u), v[self.mu]);
        let Coefficients { a: [a1, a2, a3, a4], phi, d, b } = self.terms.coefficients(t, v);
        let f =
            a1 * x1 * x1 + a2 * x2 * x2 + a3 * x1 * (x1 * x1).sin() + a4 * x2 * (x2 * x2 + phi).cos() + d + b * z1 * z1;
        dx.set(self.x, [x2, mu + f]);
        dx[self.mu] = v[self.actuator_rate] * (u - mu);
        // z = (s − 1)/(s² + 3s + 2) v, in observer form: its output is its first state.
        let excitation = x1 * (t * 0.2).sin() + x2;
        dx.set(self.z, [z2 - z1 * 3.0 + excitation, -z1 * 2.0 - excitation]);
    }
}

impl Terms {
    fn declare(d: &mut Declaration) -> Self {
        let mut coefficients = |name: &str, kind: &str, starts: &[f64]| {
            let texts =
                ["x1^2", "x2^2", "x1 sin x1^2", "x2 cos x2^2"].map(|term| format!("coefficient of {term}{kind}"));
            let (texts, n) = (texts.each_ref().map(String::as_str), starts.len());
            let units = ["1/s2", "1", "1/s2", "1/s"];
            d.parameter(vector(name, n, "").each(&texts[..n]).units(&units[..n]).starts(starts))
        };
        Terms {
            coefficient: coefficients("coefficient", ", where it is constant", &[2.0, 2.0, 1.0, 1.0]),
            mean: coefficients("coefficient_mean", ": its mean, where it varies", &[1.0, 0.5, 0.3, 0.5]),
            amplitude: coefficients("coefficient_amplitude", ": its amplitude, where it varies", &[1.0, 2.0, 1.0]),
            z_coefficient: d.parameter(scalar("z_coefficient", "coefficient of z^2, where it is constant").start(1.0)),
            uncertainty: d.parameter(choice::<Uncertainty>("uncertainty", "unknown part f of the plant")),
        }
    }

    fn coefficients<S: Scalar>(&self, t: S, v: &Values<S>) -> Coefficients<S> {
        let zero = S::from(0.0);
        let uncertainty = v.get(self.uncertainty);
        let constant = || {
            let b = S::select(uncertainty.is(Uncertainty::UnmodeledDynamics), v[self.z_coefficient], zero);
            (v.array(self.coefficient), [zero, zero, b])
        };
        let varying = || {
            let [m1, m2, m3, m4] = v.array(self.mean);
            let [a1, a2, a3] = v.array(self.amplitude);
            let (sin, cos) = (|omega: f64| (t * omega).sin(), |omega: f64| (t * omega).cos());
            let a = [m1 + a1 * sin(0.4), m2 + a2 * cos(0.35), m3 + a3 * sin(0.3), m4];
            (a, [cos(0.3) * 0.5, sin(0.35) * cos(0.4), sin(0.3) * cos(0.4)])
        };
        let (a, [phi, d, b]) = S::branch(uncertainty.is(Uncertainty::TimeVarying), varying, constant);
        Coefficients { a, phi, d, b }
    }
}

impl Catalogued for ActuatedSiso {
    const PAGE: Page = pages::ACTUATED_SISO;
}
