//! L1 adaptive controller for matched uncertainty (thesis, sections 3.2 and 3.3).
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;
use serde::Deserialize;

use crate::control::{lyapunov, projection::projection};
use crate::system::{
    Declaration, Input, Invalid, MatrixOf, Parameter, Point, Prepared, Rates, Scalar, ScalarOf, Signal, Signals, State,
    System, Values, VectorOf, Warning, diagonal, matrix, scalar, vector,
};

/// What multiplies the estimates θ̂.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Regressor {
    /// φ(x) = x: θ̂ is m × n.
    State,
    /// φ(x) = ‖x‖∞: θ̂ is m × 1.
    InfinityNorm,
}

/// Which entries of the input gain ω are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum InputGain {
    Full,
    Diagonal,
}

/// Sizes follow from the nominal input and output matrices.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct L1Structure {
    /// Input matrix B, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Output matrix C, m rows of n numbers.
    C: Vec<Vec<f64>>,
    regressor: Regressor,
    input_gain: InputGain,
}

/// L1 adaptive controller with D(s) = 1/s, for a plant x' = A_m x + B (ω u + θ φ(x) + σ).
#[derive(Debug)]
pub struct L1 {
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    regressor: Regressor,
    design: Design,
    r: VectorOf<Input>,
    x: VectorOf<Input>,
    x_hat: VectorOf<State>,
    omega_hat: VectorOf<State>,
    theta_hat: MatrixOf<State>,
    sigma_hat: VectorOf<State>,
    u_ad: VectorOf<State>,
    u: VectorOf<Signal>,
    eta_hat: VectorOf<Signal>,
    adaptation_frequency: ScalarOf<Signal>,
    /// φ(x)
    phi: VectorOf<Signal>,
    /// s = −Bᵀ P x̃
    s: VectorOf<Signal>,
    /// Row and column of each estimated entry of ω̂.
    omega_entries: Vec<(usize, usize)>,
    estimates_clipped: Warning,
}

/// The numbers of the law, and what follows from them.
#[derive(Debug)]
struct Design {
    adaptation_gain: ScalarOf<Parameter>,
    feedback_gain: MatrixOf<Parameter>,
    A_m: MatrixOf<Parameter>,
    Q: MatrixOf<Parameter>,
    omega_min: VectorOf<Parameter>,
    omega_max: VectorOf<Parameter>,
    theta_bound: VectorOf<Parameter>,
    sigma_bound: VectorOf<Parameter>,
    projection_tolerance: ScalarOf<Parameter>,
    P: MatrixOf<Prepared>,
    K_g: MatrixOf<Prepared>,
    PB: MatrixOf<Prepared>,
    /// Largest eigenvalue of Bᵀ P B.
    lambda_max: ScalarOf<Prepared>,
}

impl Design {
    fn declare(d: &mut Declaration, n: usize, m: usize, full: bool) -> Self {
        let mut omega_bound = |name: &str, text: &str| {
            if full { d.parameter(matrix(name, m, m, text)).elements() } else { d.parameter(diagonal(name, m, text)) }
        };
        let (omega_min, omega_max) = (
            omega_bound("omega_min", "lower bound of the input gain omega"),
            omega_bound("omega_max", "upper bound of the input gain omega"),
        );
        Design {
            adaptation_gain: d
                .parameter(scalar("adaptation_gain", "adaptation gain Gamma").start(1e5).positive().nominal(1e5)),
            feedback_gain: d.parameter(
                matrix("feedback_gain", m, m, "feedback gain K of the filter K D(s)").unit("1/s").identity(),
            ),
            A_m: d.parameter(matrix("A_m", n, n, "desired closed-loop dynamics; must be Hurwitz").unit("1/s")),
            Q: d.parameter(
                matrix("Q", n, n, "right-hand side of the Lyapunov equation A_m' P + P A_m = -Q").identity(),
            ),
            omega_min,
            omega_max,
            theta_bound: d.parameter(
                vector("theta_bound", m, "bound on the magnitude of each element of this row of theta").min(0.0),
            ),
            sigma_bound: d.parameter(vector("sigma_bound", m, "bound on the magnitude of sigma").min(0.0)),
            projection_tolerance: d.parameter(
                scalar("projection_tolerance", "width of the layer at the bounds in which projection acts")
                    .start(0.1)
                    .positive()
                    .max(10.0),
            ),
            P: d.prepared(matrix("P", n, n, "solution of the Lyapunov equation")),
            K_g: d.prepared(matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")),
            PB: d.prepared(matrix("#PB", n, m, "").hidden()),
            lambda_max: d.prepared(scalar("#lambda_max", "").hidden()),
        }
    }
}

impl System for L1 {
    type Structure = L1Structure;
    const NAME: &'static str = "l1";
    const DOCUMENTATION: &'static str = include_str!("../../docs/controllers/l1.md");

    fn declare(structure: L1Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let B = rows("B", &structure.B)?;
        let C = rows("C", &structure.C)?;
        let (n, m) = B.shape();
        if C.shape() != (m, n) {
            let (rows, columns) = C.shape();
            return Err(Invalid::new(
                "C",
                format!("{rows} x {columns}"),
                format!("must be {m} x {n}, as B is {n} x {m}"),
            ));
        }
        let full = structure.input_gain == InputGain::Full;
        let omega_entries: Vec<_> =
            if full { (0..m * m).map(|k| (k % m, k / m)).collect() } else { (0..m).map(|i| (i, i)).collect() };
        let omega_hat = "estimate of the input gain omega";
        let columns = if structure.regressor == Regressor::State { n } else { 1 };
        let l1 = L1 {
            regressor: structure.regressor,
            design: Design::declare(d, n, m, full),
            r: d.input(vector("r", m, "reference")),
            x: d.input(vector("x", n, "measured state of the plant")),
            x_hat: d.state(vector("x_hat", n, "state of the predictor")),
            omega_hat: if full {
                d.state(matrix("omega_hat", m, m, omega_hat)).elements()
            } else {
                d.state(diagonal("omega_hat", m, omega_hat))
            },
            theta_hat: d.state(matrix(
                "theta_hat",
                m,
                columns,
                "estimate of theta, the uncertainty's dependence on the state",
            )),
            sigma_hat: d.state(vector("sigma_hat", m, "estimate of the disturbance sigma")),
            u_ad: d.state(vector("u_ad", m, "adaptive control, the filtered estimate")),
            u: d.output(vector("u", m, "control")),
            eta_hat: d.local(vector("eta_hat", m, "estimate of the matched uncertainty with the control's own effect")),
            adaptation_frequency: d.local(
                scalar("adaptation_frequency", "frequency at which the estimates oscillate about their values")
                    .unit("rad/s"),
            ),
            phi: d.local(vector("#phi", columns, "").hidden()),
            s: d.local(vector("#s", m, "").hidden()),
            omega_entries,
            estimates_clipped: d.warning("logProjection", "estimates brought back to tightened bounds"),
            B,
            C,
        };
        l1.declare_dependence(d);
        Ok(l1)
    }

    /// P, K_g and what follows from them.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        let mut invalid = Invalid::none();
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            if lo > hi {
                let allowed = format!("must not be above omega_max[{0},{1}] = {hi}", i + 1, j + 1);
                invalid.and(Invalid::new(format!("omega_min[{},{}]", i + 1, j + 1), lo, allowed));
            }
        }
        let A_m = v.matrix(self.design.A_m).into_owned();
        match lyapunov::solve(&A_m, &v.matrix(self.design.Q).into_owned()) {
            Err(reasons) => invalid.and(reasons),
            Ok(P) => {
                let PB = &P * &self.B;
                let lambda_max = (self.B.transpose() * &PB).symmetric_eigenvalues().max();
                // A Hurwitz matrix is regular.
                let dc_gain = A_m.lu().solve(&self.B).map(|x| -(&self.C * x));
                match dc_gain.and_then(|gain| gain.try_inverse()) {
                    Some(K_g) => v.matrix_mut(self.design.K_g).copy_from(&K_g),
                    None => {
                        invalid.and(Invalid::because("C A_m^-1 B is singular: the output has no static gain to scale"))
                    }
                }
                v.matrix_mut(self.design.P).copy_from(&P);
                v.matrix_mut(self.design.PB).copy_from(&PB);
                v[self.design.lambda_max] = lambda_max;
            }
        }
        invalid.into_result()
    }

    /// The predictor starts at the measured state; ω̂ at the identity, which its bounds must hold, the other estimates
    /// at zero.
    fn initialise(&self, _t: f64, v: &mut Point) -> Result<(), Invalid> {
        v.copy(self.x, self.x_hat);
        let mut invalid = Invalid::none();
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi, start) = (v[self.design.omega_min][k], v[self.design.omega_max][k], identity(i, j));
            if !(lo..=hi).contains(&start) {
                let name = format!("omega_min[{0},{1}] … omega_max[{0},{1}]", i + 1, j + 1);
                let allowed = format!("must hold the start value {start} of the estimate omega_hat");
                invalid.and(Invalid::new(name, format!("{lo} … {hi}"), allowed));
            }
            v[self.omega_hat][k] = start;
        }
        invalid.into_result()
    }

    fn parameters_changed(&self, _t: f64, v: &mut Point) {
        let mut clipped = 0;
        let mut clip = |v: &mut Point, estimate: ScalarOf<State>, lo: f64, hi: f64| {
            let within = v[estimate].clamp(lo, hi);
            clipped += usize::from(within != v[estimate]);
            v[estimate] = within;
        };
        for k in 0..self.omega_entries.len() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            clip(v, self.omega_hat.at(k), lo, hi);
        }
        let (m, columns) = self.theta_hat.shape();
        for i in 0..m {
            let (theta, sigma) = (v[self.design.theta_bound][i], v[self.design.sigma_bound][i]);
            (0..columns).for_each(|j| clip(v, self.theta_hat.at(i, j), -theta, theta));
            clip(v, self.sigma_hat.at(i), -sigma, sigma);
        }
        if clipped > 0 {
            v.say(
                self.estimates_clipped,
                format!("{clipped} estimates lay outside the new bounds and were brought to them"),
            );
        }
    }

    /// η̂ = ω̂ u + θ̂ φ(x) + σ̂, with u = u_ad; s = −Bᵀ P x̃.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let (x, x_hat, u) = (&v[self.x], &v[self.x_hat], &v[self.u_ad]);
        y.set(self.u, u);
        match self.regressor {
            Regressor::State => y.set(self.phi, x),
            Regressor::InfinityNorm => y.set(self.phi, [infinity_norm(x)]),
        }
        y.set(self.eta_hat, &v[self.sigma_hat]);
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            y[self.eta_hat][i] += v[self.omega_hat][k] * u[j];
        }
        let theta_hat = v.matrix(self.theta_hat);
        let PB = v.matrix(self.design.PB);
        for i in 0..u.len() {
            for j in 0..self.phi.len() {
                let term = theta_hat[(i, j)] * y[self.phi][j];
                y[self.eta_hat][i] += term;
            }
            let x_tilde = x_hat.iter().zip(x).map(|(&x_hat, &x)| x_hat - x);
            y[self.s][i] = -x_tilde.zip(PB.column(i).iter()).fold(S::from(0.0), |sum, (x, &p)| sum + x * p);
        }
        let excitation = squared(u) + squared(&y[self.phi]) + 1.0;
        y[self.adaptation_frequency] = (v[self.design.adaptation_gain] * v[self.design.lambda_max] * excitation).sqrt();
    }

    /// State predictor, adaptive laws with projection, and the control law u_ad = −K D(s) (η̂ − K_g r), D(s) = 1/s.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (r, x_hat, u) = (&v[self.r], &v[self.x_hat], &v[self.u_ad]);
        let (eta_hat, phi, s) = (&v[self.eta_hat], &v[self.phi], &v[self.s]);
        let A_m = v.matrix(self.design.A_m);
        for i in 0..x_hat.len() {
            let mut rate = dot(A_m.row(i).iter(), x_hat);
            for (j, &eta) in eta_hat.iter().enumerate() {
                rate += eta * self.B[(i, j)];
            }
            dx[self.x_hat][i] = rate;
        }

        let (gamma, epsilon) = (v[self.design.adaptation_gain], v[self.design.projection_tolerance]);
        for (k, &(i, j)) in self.omega_entries.iter().enumerate() {
            let (lo, hi) = (v[self.design.omega_min][k], v[self.design.omega_max][k]);
            dx[self.omega_hat][k] = gamma * projection(v[self.omega_hat][k], s[i] * u[j], lo, hi, epsilon);
        }
        for i in 0..u.len() {
            let (theta, sigma) = (v[self.design.theta_bound][i], v[self.design.sigma_bound][i]);
            for (j, &phi) in phi.iter().enumerate() {
                let entry = self.theta_hat.at(i, j);
                dx[entry] = gamma * projection(v[entry], s[i] * phi, -theta, theta, epsilon);
            }
            dx[self.sigma_hat][i] = gamma * projection(v[self.sigma_hat][i], s[i], -sigma, sigma, epsilon);
        }

        let (K, K_g) = (v.matrix(self.design.feedback_gain), v.matrix(self.design.K_g));
        for i in 0..u.len() {
            let error = |j: usize| eta_hat[j] - dot(K_g.row(j).iter(), r);
            dx[self.u_ad][i] = -(0..u.len()).fold(S::from(0.0), |sum, j| sum + K[(i, j)] * error(j));
        }
    }
}

impl L1 {
    fn declare_dependence(&self, d: &mut Declaration) {
        let estimates: [&dyn crate::system::Handle; 4] =
            [&self.omega_hat, &self.theta_hat, &self.sigma_hat, &self.u_ad];
        d.depends(self.u, &[&self.u_ad]);
        d.depends(self.eta_hat, &[&estimates[..], &[&self.x]].concat());
        d.depends(self.adaptation_frequency, &[&self.x, &self.u_ad]);
        d.depends(self.x_hat.rate(), &[&estimates[..], &[&self.x, &self.x_hat]].concat());
        d.depends(self.omega_hat.rate(), &[&self.x, &self.x_hat, &self.u_ad, &self.omega_hat]);
        d.depends(self.theta_hat.rate(), &[&self.x, &self.x_hat, &self.theta_hat]);
        d.depends(self.sigma_hat.rate(), &[&self.x, &self.x_hat, &self.sigma_hat]);
        d.depends(self.u_ad.rate(), &[&estimates[..], &[&self.x, &self.r]].concat());
    }
}

fn identity(i: usize, j: usize) -> f64 {
    f64::from(u8::from(i == j))
}

fn dot<'a, S: Scalar>(row: impl Iterator<Item = &'a S>, column: &[S]) -> S {
    row.zip(column).fold(S::from(0.0), |sum, (&a, &b)| sum + a * b)
}

fn squared<S: Scalar>(x: &[S]) -> S {
    dot(x.iter(), x)
}

fn infinity_norm<S: Scalar>(x: &[S]) -> S {
    x.iter().map(|x| x.abs()).fold(S::from(0.0), |largest, x| if x > largest { x } else { largest })
}

/// A matrix from the rows of a description.
fn rows(name: &str, rows: &[Vec<f64>]) -> Result<DMatrix<f64>, Invalid> {
    let columns = rows.first().map_or(0, Vec::len);
    if columns == 0 || rows.iter().any(|row| row.len() != columns) {
        return Err(Invalid::new(name, format!("{rows:?}"), "must be rows of equally many numbers"));
    }
    if rows.iter().flatten().any(|entry| !entry.is_finite()) {
        return Err(Invalid::new(name, format!("{rows:?}"), "must be finite numbers"));
    }
    Ok(DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j]))
}
