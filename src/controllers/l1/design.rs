//! The numbers of an L1 controller, and what is designed from them.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{Complex, DMatrix, DMatrixView};

use super::structure::{Baseline, L1Structure, Plant};
use crate::control::limits::{self, UNLIMITED};
use crate::control::{feedforward, lyapunov, pole_placement};
use crate::system::{
    Declaration, Invalid, MatrixOf, Parameter, Point, Prepared, Scalar, ScalarOf, Values, VectorOf, diagonal, matrix,
    scalar, vector,
};

/// The numbers of the law, and what follows from them.
#[derive(Debug)]
pub(super) struct Design {
    pub adaptation_gain: ScalarOf<Parameter>,
    pub feedback_gain: MatrixOf<Parameter>,
    dynamics: Dynamics,
    Q: MatrixOf<Parameter>,
    pub omega_min: VectorOf<Parameter>,
    pub omega_max: VectorOf<Parameter>,
    pub theta_bound: VectorOf<Parameter>,
    pub sigma_bound: VectorOf<Parameter>,
    pub projection_tolerance: ScalarOf<Parameter>,
    pub adaptation_tolerance: ScalarOf<Parameter>,
    pub closed_form_phase: ScalarOf<Parameter>,
    pub step_phase_limit: ScalarOf<Parameter>,
    pub u_min: VectorOf<Parameter>,
    pub u_max: VectorOf<Parameter>,
    P: MatrixOf<Prepared>,
    pub K_g: MatrixOf<Prepared>,
    pub PB: MatrixOf<Prepared>,
    /// Largest eigenvalue of Bᵀ P B.
    pub lambda_max: ScalarOf<Prepared>,
    /// Rate at which the adaptive control follows the manual one while the controller is not enabled.
    pub follow_rate: ScalarOf<Prepared>,
}

/// Where the desired dynamics come from.
#[derive(Debug)]
enum Dynamics {
    /// They are given; there is no baseline.
    Given(MatrixOf<Parameter>),
    /// Of poles, by the baseline's gain K_m.
    Placed {
        pole_real: VectorOf<Parameter>,
        pole_imag: VectorOf<Parameter>,
        A_m: MatrixOf<Prepared>,
        K_m: MatrixOf<Prepared>,
    },
}

impl Dynamics {
    fn declare(d: &mut Declaration, n: usize, m: usize, baseline: Baseline) -> Self {
        let text = "desired closed-loop dynamics";
        if baseline == Baseline::None {
            return Dynamics::Given(d.parameter(matrix("A_m", n, n, &format!("{text}; must be Hurwitz")).unit("1/s")));
        }
        let order = "in the order of the inputs, conjugates side by side";
        let real = format!("real part of a desired closed-loop pole, {order}");
        let imag = format!("imaginary part of a desired closed-loop pole, {order}");
        Dynamics::Placed {
            pole_real: d.parameter(vector("pole_real", n, &real).unit("1/s").start(-1.0)),
            pole_imag: d.parameter(vector("pole_imag", n, &imag).unit("rad/s")),
            A_m: d.prepared(matrix("A_m", n, n, text).unit("1/s")),
            K_m: d.prepared(matrix("K_m", m, n, "gain of the baseline, the static state feedback")),
        }
    }

    /// Where poles are to be placed, sets A_m and K_m.
    fn prepare(&self, plant: &Plant, v: &mut Point) -> Result<(), Invalid> {
        let Dynamics::Placed { pole_real, pole_imag, A_m, K_m } = self else { return Ok(()) };
        let poles: Vec<_> = v[*pole_real].iter().zip(&v[*pole_imag]).map(|(&re, &im)| Complex::new(re, im)).collect();
        let gain = pole_placement::place(&plant.A, &plant.B, &poles)?;
        v.matrix_mut(*A_m).copy_from(&(&plant.A - &plant.B * &gain));
        v.matrix_mut(*K_m).copy_from(&gain);
        Ok(())
    }
}

impl Design {
    pub fn declare(
        d: &mut Declaration,
        (n, m): (usize, usize),
        structure: &L1Structure,
        of_control: &[&'static str],
    ) -> Self {
        let full = structure.is_full();
        let mut omega_bound = |name: &str, text: &str| {
            if full { d.parameter(matrix(name, m, m, text)).elements() } else { d.parameter(diagonal(name, m, text)) }
        };
        let (omega_min, omega_max) = (
            omega_bound("omega_min", "lower bound of the input gain omega"),
            omega_bound("omega_max", "upper bound of the input gain omega"),
        );
        let tolerance = "error tolerated in each closed-form step of the adaptation in co-simulation, relative to a \
                         value's magnitude or nominal value";
        let phase = "angle through which the adaptation may turn in a communication step before the step is called too \
                     long";
        let closed_form = "angle through which the adaptation turns in a step from which on the closed form is taken, in \
                           co-simulation; below, a general method is less work";
        let limit = "control that the actuator can give; the predictor knows of it. 1e15 is no limit";
        Design {
            adaptation_gain: d
                .parameter(scalar("adaptation_gain", "adaptation gain Gamma").start(1e5).positive().nominal(1e5)),
            feedback_gain: d.parameter(
                matrix("feedback_gain", m, m, "feedback gain K of the filter K D(s)").unit("1/s").identity(),
            ),
            dynamics: Dynamics::declare(d, n, m, structure.baseline),
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
            adaptation_tolerance: d
                .parameter(scalar("adaptation_tolerance", tolerance).start(1e-3).min(1e-9).max(1.0).nominal(1e-3)),
            closed_form_phase: d.parameter(scalar("closed_form_phase", closed_form).unit("rad").start(10.0).min(0.0)),
            step_phase_limit: d.parameter(scalar("step_phase_limit", phase).unit("rad").start(10.0).positive()),
            u_min: d.parameter(vector("u_min", m, &format!("smallest {limit}")).start(-UNLIMITED).units(of_control)),
            u_max: d.parameter(vector("u_max", m, &format!("largest {limit}")).start(UNLIMITED).units(of_control)),
            P: d.prepared(matrix("P", n, n, "solution of the Lyapunov equation")),
            K_g: d.prepared(matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")),
            PB: d.prepared(matrix("#PB", n, m, "").hidden()),
            lambda_max: d.prepared(scalar("#lambda_max", "").hidden()),
            follow_rate: d.prepared(scalar("#follow rate", "").hidden()),
        }
    }

    /// The desired dynamics.
    pub fn A_m<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        match &self.dynamics {
            Dynamics::Given(A_m) => v.matrix(*A_m),
            Dynamics::Placed { A_m, .. } => v.matrix(*A_m),
        }
    }

    /// The baseline's gain, where there is a baseline.
    pub fn K_m<'a, S: Scalar>(&self, v: &Values<'a, S>) -> Option<DMatrixView<'a, S>> {
        match &self.dynamics {
            Dynamics::Given(_) => None,
            Dynamics::Placed { K_m, .. } => Some(v.matrix(*K_m)),
        }
    }

    /// Poles, P, K_g and what follows from them.
    pub fn prepare(&self, plant: &Plant, entries: &[(usize, usize)], v: &mut Point) -> Result<(), Invalid> {
        let mut invalid = self.check_bounds(entries, v);
        let designed = self.dynamics.prepare(plant, v).and_then(|()| {
            let A_m = self.A_m(&v.values()).into_owned();
            let P = lyapunov::solve(&A_m, &v.matrix(self.Q).into_owned())?;
            Ok((P, feedforward::gain(&A_m, &plant.B, &plant.C)?))
        });
        match designed {
            Err(reasons) => invalid.and(reasons),
            Ok((P, K_g)) => {
                let PB = &P * &plant.B;
                let BPB = plant.B.transpose() * &PB;
                if !BPB.norm_squared().is_finite() {
                    let text = "A_m, Q and B are too large or too badly scaled: B' P B must be finite";
                    invalid.and(Invalid::because(text));
                    return Err(invalid);
                }
                v[self.lambda_max] = BPB.symmetric_eigenvalues().max();
                v.matrix_mut(self.K_g).copy_from(&K_g);
                v.matrix_mut(self.P).copy_from(&P);
                v.matrix_mut(self.PB).copy_from(&PB);
                let K: DMatrix<f64> = v.matrix(self.feedback_gain).into_owned();
                v[self.follow_rate] = K.norm() / (K.nrows() as f64).sqrt();
            }
        }
        invalid.into_result()
    }

    fn check_bounds(&self, entries: &[(usize, usize)], v: &Point) -> Invalid {
        let mut invalid = Invalid::none();
        for (k, &(i, j)) in entries.iter().enumerate() {
            let (lo, hi) = (v[self.omega_min][k], v[self.omega_max][k]);
            if lo > hi {
                let allowed = format!("must not be above omega_max[{0},{1}] = {hi}", i + 1, j + 1);
                invalid.and(Invalid::new(format!("omega_min[{},{}]", i + 1, j + 1), lo, allowed));
            }
        }
        invalid.and(limits::check(&v[self.u_min], &v[self.u_max]));
        invalid
    }
}
