//! System with two inputs and uncertainty that they don't reach directly: example 3.4.1.

use crate::catalogue::Catalogued;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Declaration, Input, Invalid, MatrixOf, NoStructure, Parameter, Point, Rates, Scalar, ScalarOf, Signal,
    Signals, State, System, Values, VectorOf, boolean, matrix, scalar, vector,
};

/// x' = (A_m + A_Δ) x + B_m ω u + f_Δ(x, z, t), y = (x1, x2), with unmodeled dynamics z.
#[derive(Debug)]
pub struct UnmatchedMimo {
    x0: VectorOf<Parameter>,
    a_m: MatrixOf<Parameter>,
    a_delta: MatrixOf<Parameter>,
    b_m: MatrixOf<Parameter>,
    omega: MatrixOf<Parameter>,
    k: VectorOf<Parameter>,
    lambda: ScalarOf<Parameter>,
    omega_u: ScalarOf<Parameter>,
    use_secant: BooleanOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    oscillator: Oscillator,
    filter: Filter,
    y: VectorOf<Signal>,
    z: ScalarOf<Signal>,
}

/// Van der Pol oscillator x_z1' = x_z2, x_z2' = −x_z1 + damping (1 − x_z1²) x_z2.
#[derive(Debug)]
struct Oscillator {
    x0: VectorOf<Parameter>,
    damping: ScalarOf<Parameter>,
    /// That of x_z1 − x_z2 in z.
    gain: ScalarOf<Parameter>,
    x: VectorOf<State>,
}

/// z_u = (−T_n s + 1)/(T² s² + 2 D T s + 1) w·x, in observer form: its output is its first state.
#[derive(Debug)]
struct Filter {
    z0: VectorOf<Parameter>,
    weight: VectorOf<Parameter>,
    zero_time: ScalarOf<Parameter>,
    time_constant: ScalarOf<Parameter>,
    damping: ScalarOf<Parameter>,
    z: VectorOf<State>,
}

impl System for UnmatchedMimo {
    type Structure = NoStructure;
    const NAME: &'static str = "unmatched-mimo";
    const DOCUMENTATION: &'static str = pages::UNMATCHED_MIMO.text;

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let mut matrix_of = |name: &str, columns, text: &str, unit, starts: &[f64]| {
            d.parameter(matrix(name, starts.len() / columns, columns, text).unit(unit).starts(starts))
        };
        let a_m = matrix_of(
            "A_m",
            3,
            "nominal state matrix",
            "1/s",
            &[-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, -1.8], // by columns
        );
        let a_delta = matrix_of(
            "A_Delta",
            3,
            "deviation of the state matrix from the nominal one",
            "1/s",
            &[0.2, -0.2, -0.1, -0.2, -0.2, 0.0, -0.3, 0.6, -0.9],
        );
        let b_m = matrix_of("B_m", 2, "nominal input matrix", "1/s", &[1.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let omega = matrix_of("omega", 2, "input gain", "1", &[0.6, 0.2, -0.2, 1.2]);
        Ok(UnmatchedMimo {
            x0: d.parameter(vector("x0", 3, "initial state").fixed()),
            a_m,
            a_delta,
            b_m,
            omega,
            k: d.parameter(coefficients()),
            lambda: d.parameter(scalar("lambda", "rate at which k6 comes in").unit("1/s").start(0.3).min(0.0)),
            omega_u: d.parameter(
                scalar("omega_u", "angular frequency of the term of k8").unit("rad/s").in_own_unit().start(5.0),
            ),
            use_secant: d.parameter(boolean(
                "use_secant",
                "whether sec x2 replaces sech x2, as printed; the motion then ends where x2 reaches +-pi/2",
            )),
            u: d.input(vector("u", 2, "control")),
            x: d.state(vector("x", 3, "state").output().source("Hashim, example 3.4.1")),
            oscillator: Oscillator::declare(d),
            filter: Filter::declare(d),
            y: d.output(vector("y", 2, "").each(&["tracked output, x1", "tracked output, x2"])),
            z: d.local(scalar("z", "output of the unmodeled dynamics")),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
        v.copy(self.oscillator.x0, self.oscillator.x);
        v.copy(self.filter.z0, self.filter.z);
        let x2 = v[self.x.at(1)];
        v.refuse(v.get(self.use_secant) & x2.cos().at_most(S::from(0.0)), |v| {
            let secant = v.name(self.use_secant);
            let allowed = format!("must have a positive cosine: with {secant} = true the motion ends at +-pi/2");
            Invalid::new(v.name(self.x0.at(1)), x2.to_text(), allowed)
        });
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [x1, x2, _] = v.array(self.x);
        let [x_z1, x_z2] = v.array(self.oscillator.x);
        y.set(self.y, [x1, x2]);
        y[self.z] = v[self.oscillator.gain] * (x_z1 - x_z2) + v[self.filter.z.at(0)];
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (x, [u1, u2]) = (v.array::<_, 3>(self.x), v.array(self.u));
        let (a_m, a_delta, b, omega) =
            (v.matrix(self.a_m), v.matrix(self.a_delta), v.matrix(self.b_m), v.matrix(self.omega));
        let w: [S; 2] = std::array::from_fn(|i| omega[(i, 0)] * u1 + omega[(i, 1)] * u2);
        let f = self.f_delta(t, x, v);
        let rate: [S; 3] = std::array::from_fn(|i| {
            let linear = |j: usize| (a_m[(i, j)] + a_delta[(i, j)]) * x[j];
            linear(0) + linear(1) + linear(2) + b[(i, 0)] * w[0] + b[(i, 1)] * w[1] + f[i]
        });
        dx.set(self.x, rate);
        self.oscillator.derivatives(v, dx);
        self.filter.derivatives(x, v, dx);
    }
}

impl UnmatchedMimo {
    fn f_delta<S: Scalar>(&self, t: S, [x1, x2, x3]: [S; 3], v: &Values<S>) -> [S; 3] {
        let [k1, k2, k3, k4, k5, k6, k7, k8, k9] = v.array(self.k);
        let z = v[self.z];
        [
            k1 / 3.0 * (x1 * x1 + x2 * x2 + x3 * x3) + (k2 / 2.0 * x1).tanh() * x1 + k3 * z,
            k4 / 2.0 * self.secant(x2, v) * x2
                + k5 / 5.0 * x3 * x3
                + k6 * (-(-v[self.lambda] * t).exp() + 1.0)
                + k7 / 2.0 * z,
            k8 * x3 * (v[self.omega_u] * t).cos() + k9 * z * z,
        ]
    }

    /// sech x2. The thesis prints sec x2, whose poles at ±π/2 the motion can't pass: from there on it is no number, which
    /// ends the step.
    fn secant<S: Scalar>(&self, x2: S, v: &Values<S>) -> S {
        let secant = || {
            let cos = x2.cos();
            S::branch(cos.above(S::from(0.0)), || cos.recip(), || S::from(f64::NAN))
        };
        S::branch(v.get(self.use_secant), secant, || x2.cosh().recip())
    }
}

/// k1 … k9.
fn coefficients() -> crate::system::Spec<crate::system::Many> {
    vector("k", 9, "")
        .each(&[
            "k1, three times the coefficient of x'x, in x1'",
            "k2, twice the slope in tanh(k2 x1/2) x1, in x1'",
            "k3, coefficient of z, in x1'",
            "k4, twice the coefficient of sech(x2) x2, in x2'",
            "k5, five times the coefficient of x3^2, in x2'",
            "k6, the constant that comes in with time, in x2'",
            "k7, twice the coefficient of z, in x2'",
            "k8, coefficient of x3 cos(omega_u t), in x3'",
            "k9, coefficient of z^2, in x3'",
        ])
        .units(&["1/s", "1", "1/s", "1/s", "1/s", "1/s", "1/s", "1/s", "1/s"])
        .starts(&[-1.0, 1.0, 0.0, 1.0, 0.0, 0.2, 1.0, 0.6, -0.7])
}

impl Oscillator {
    fn declare(d: &mut Declaration) -> Self {
        Oscillator {
            x0: d.parameter(vector("x_z0", 2, "initial state of the Van der Pol oscillator").start(1.0).fixed()),
            damping: d.parameter(
                scalar("van_der_pol_damping", "damping of the Van der Pol oscillator").unit("1/s").start(0.8),
            ),
            gain: d.parameter(scalar("van_der_pol_gain", "gain of the Van der Pol oscillator in z").start(0.1)),
            x: d.state(
                vector("x_z", 2, "state of the Van der Pol oscillator in the unmodeled dynamics")
                    .source("Hashim, example 3.4.1"),
            ),
        }
    }

    fn derivatives<S: Scalar>(&self, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        dx.set(self.x, [x2, -x1 + v[self.damping] * (-x1 * x1 + 1.0) * x2]);
    }
}

impl Filter {
    fn declare(d: &mut Declaration) -> Self {
        let units = ["1", "1/s"];
        let seconds = |name: &str, text: &str, start| scalar(name, text).unit("s").start(start);
        Filter {
            z0: d.parameter(vector("z_u0", 2, "initial state of the filter z_u(s)").units(&units).fixed()),
            weight: d
                .parameter(vector("z_u_weight", 3, "weight of x in the excitation of z_u").starts(&[1.0, -2.0, 1.0])),
            zero_time: d.parameter(seconds("z_u_zero_time", "time constant of the zero of z_u(s), on the right", 1.0)),
            time_constant: d.parameter(
                seconds("z_u_time_constant", "time constant of z_u(s), the inverse of its natural frequency", 10.0)
                    .positive(),
            ),
            damping: d.parameter(scalar("z_u_damping", "damping ratio of z_u(s)").start(0.4)),
            z: d.state(
                vector("z_u", 2, "")
                    .each(&["z_u, the filtered part of the unmodeled dynamics", "second state of the filter z_u(s)"])
                    .units(&units)
                    .nominals(&[1.0, 0.1])
                    .source("Hashim, example 3.4.1"),
            ),
        }
    }

    fn derivatives<S: Scalar>(&self, [x1, x2, x3]: [S; 3], v: &Values<S>, dx: &mut Rates<S>) {
        let ([z1, z2], [w1, w2, w3]) = (v.array(self.z), v.array(self.weight));
        let excitation = w1 * x1 + w2 * x2 + w3 * x3;
        let (time, square) = (v[self.time_constant], v[self.time_constant] * v[self.time_constant]);
        let first = z2 - v[self.damping] * z1 * 2.0 / time - v[self.zero_time] * excitation / square;
        dx.set(self.z, [first, (excitation - z1) / square]);
    }
}

impl Catalogued for UnmatchedMimo {
    const PAGE: Page = pages::UNMATCHED_MIMO;
}
