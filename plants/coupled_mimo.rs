//! Coupled system of three states and three inputs: examples 6.5.1 and 6.5.2.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, Input, Invalid, MatrixOf, NoStructure, Parameter, Point, Rates, Scalar, Signal, Signals,
    State, System, Values, VectorOf, boolean, matrix, vector,
};

/// x' = A x + B u + θ(t)ᵀ x + Δf(x, u) + d(t), y = x.
#[derive(Debug)]
pub struct CoupledMimo {
    x0: VectorOf<Parameter>,
    a: MatrixOf<Parameter>,
    b: MatrixOf<Parameter>,
    theta_factor: MatrixOf<Parameter>,
    coefficient: VectorOf<Parameter>,
    nonaffine: BooleanOf<Parameter>,
    nonaffine_coefficient: VectorOf<Parameter>,
    /// Mean of d, and its amplitudes of sin t and cos t.
    disturbance: [VectorOf<Parameter>; 3],
    u: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<Signal>,
}

impl System for CoupledMimo {
    type Structure = NoStructure;
    const NAME: &'static str = "coupled-mimo";
    const DOCUMENTATION: &'static str = pages::COUPLED_MIMO.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let terms = ["x3^2, in x1'", "sin x1, in x1'", "x1 x3, in x2'", "x1 cos x3, in x2'", "x1 x2, in x3'"]
            .map(|term| format!("coefficient of {term}"));
        let mut disturbance =
            |name: &str, text: &str, starts: &[f64]| d.parameter(vector(name, 3, text).unit("1/s").starts(starts));
        let disturbance = [
            disturbance("d_mean", "mean of the disturbance d", &[1.0, 1.2, -1.0]),
            disturbance("d_sine", "amplitude of sin t in the disturbance d", &[1.0, 0.0, 1.0]),
            disturbance("d_cosine", "amplitude of cos t in the disturbance d", &[0.0, 1.0, 1.0]),
        ];
        let a = [-36.0, 0.0, 0.0, 36.0, 20.0, 0.0, 0.0, 0.0, -3.0];
        Ok(CoupledMimo {
            x0: d.parameter(vector("x0", 3, "initial state").fixed()),
            a: d.parameter(matrix("A", 3, 3, "state matrix").starts(&a).unit("1/s")),
            b: d.parameter(matrix("B", 3, 3, "input matrix").identity().unit("1/s")),
            theta_factor: d.parameter(
                matrix("theta_factor", 3, 3, "factor of this element of theta(t); 1: as in the example").start(1.0),
            ),
            coefficient: d.parameter(
                vector("coefficient", 5, "")
                    .each(&terms.each_ref().map(String::as_str))
                    .unit("1/s")
                    .starts(&[1.0, 0.2, -1.0, -0.2, 1.0]),
            ),
            nonaffine: d.parameter(boolean("nonaffine", "whether the control acts nonlinearly too (example 6.5.2)")),
            nonaffine_coefficient: d.parameter(
                vector("nonaffine_coefficient", 2, "")
                    .each(&["coefficient of u3 cos u1, in x1'", "coefficient of u3^2, in x2'"])
                    .unit("1/s")
                    .starts(&[-2.5, 0.7]),
            ),
            disturbance,
            u: d.input(vector("u", 3, "control")),
            x: d.state(vector("x", 3, "state").output().source("Hashim, example 6.5.1")),
            y: d.output(vector("y", 3, "tracked output, the state")),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y.set(self.y, &v[self.x]);
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (x, u) = (v.array::<_, 3>(self.x), v.array::<_, 3>(self.u));
        let (a, b, factor) = (v.matrix(self.a), v.matrix(self.b), v.matrix(self.theta_factor));
        let (theta, delta_f, d) = (theta(t), self.delta_f(x, u, v), self.disturbance(t, v));
        let rate: [S; 3] = std::array::from_fn(|i| {
            let term = |j: usize| (a[(i, j)] + factor[(j, i)] * theta[j][i]) * x[j] + b[(i, j)] * u[j];
            term(0) + term(1) + term(2) + delta_f[i] + d[i]
        });
        dx.set(self.x, rate);
    }
}

impl CoupledMimo {
    fn delta_f<S: Scalar>(&self, [x1, x2, x3]: [S; 3], [u1, _, u3]: [S; 3], v: &Values<S>) -> [S; 3] {
        let [c1, c2, c3, c4, c5] = v.array(self.coefficient);
        let f = [c1 * x3 * x3 + c2 * x1.sin(), c3 * x1 * x3 + c4 * x3.cos() * x1, c5 * x1 * x2];
        let with_control = || {
            let [n1, n2] = v.array(self.nonaffine_coefficient);
            [f[0] + n1 * u3 * u1.cos(), f[1] + n2 * u3 * u3, f[2]]
        };
        S::branch(v.get(self.nonaffine), with_control, || f)
    }

    fn disturbance<S: Scalar>(&self, t: S, v: &Values<S>) -> [S; 3] {
        let [mean, sine, cosine] = self.disturbance.map(|part| v.array::<_, 3>(part));
        std::array::from_fn(|i| mean[i] + sine[i] * t.sin() + cosine[i] * t.cos())
    }
}

/// θ(t), by rows as printed.
fn theta<S: Scalar>(t: S) -> [[S; 3]; 3] {
    let (sin, cos) = (|omega: f64| (t * omega).sin(), |omega: f64| (t * omega).cos());
    [
        [sin(0.5) * 3.0, sin(0.4) * cos(0.3) * 2.0, sin(0.2) * 0.7],
        [sin(0.2) * 0.9, sin(0.3) * 2.5 + cos(1.0) * 0.3, sin(0.1)],
        [sin(0.13) * 0.5, cos(0.15) * 0.6, cos(0.7) * 1.5 + sin(0.3) * 1.6],
    ]
}

impl Catalogued for CoupledMimo {
    const PAGE: Page = pages::COUPLED_MIMO;
}
