//! The parameters of an L1 controller, and matrices that are designed from them.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::{Complex, DMatrix, DMatrixView};

use super::squared;
use super::structure::{Baseline, Commands, DesiredDynamics, L1Structure, PlantMatrices, Regressor, Symbols};
use super::tracking::{self, BY_GAIN};
use crate::mathematics::{feedforward, lyapunov, pole_placement};
use crate::system::{
    Declaration, Invalid, MatrixOf, Parameter, Point, Prepared, Scalar, ScalarOf, Values, VectorOf, diagonal, matrix,
    scalar, vector,
};

/// After so many time constants 2 % are left.
pub(in crate::controllers) const SETTLED: f64 = 4.0;

/// Parameters of the controller, and numbers that follow from them.
#[derive(Debug)]
pub(super) struct Design {
    pub adaptation_gain: ScalarOf<Parameter>,
    pub feedback_gain: MatrixOf<Parameter>,
    dynamics: Dynamics,
    pub Q: MatrixOf<Parameter>,
    pub omega_min: VectorOf<Parameter>,
    pub omega_max: VectorOf<Parameter>,
    /// Bounds of the elements of θ, by columns, or those of its rows, which are then the same in each column.
    pub theta_bound: VectorOf<Parameter>,
    pub sigma_bound: VectorOf<Parameter>,
    pub projection_tolerance: ScalarOf<Parameter>,
    /// Conditions of a closed-form step, and its accuracy; none if there is no closed form.
    pub closed_form: Option<ClosedForm>,
    pub step_phase_limit: ScalarOf<Parameter>,
    /// T_t, with which u_ad follows what the limits leave.
    pub tracking_time: VectorOf<Parameter>,
    /// Factor from commanded accelerations to the control, if they are commanded.
    inertia: Option<VectorOf<Parameter>>,
    pub P: MatrixOf<Prepared>,
    pub K_g: MatrixOf<Prepared>,
    /// P (B B_um)
    pub PB: MatrixOf<Prepared>,
    /// Largest eigenvalue of Bᵀ P B, and of B_umᵀ P B_um (zero without such).
    pub lambda_max: ScalarOf<Prepared>,
    pub lambda_max_unmatched: ScalarOf<Prepared>,
    /// Rate at which the adaptive control follows the manual one while the controller is not enabled.
    pub follow_rate: ScalarOf<Prepared>,
    /// In which the slowest of the desired dynamics has decayed to 2 %, s.
    pub settling_time: ScalarOf<Prepared>,
}

/// The numbers of the closed-form step.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClosedForm {
    pub tolerance: ScalarOf<Parameter>,
    pub phase: ScalarOf<Parameter>,
}

/// Source of the desired dynamics.
#[derive(Debug)]
pub(in crate::controllers) enum Dynamics {
    /// They are given; there is no baseline.
    Given(MatrixOf<Parameter>),
    /// They are given, and the baseline's gain K_m brings them about.
    Matched { A_m: MatrixOf<Parameter>, K_m: MatrixOf<Prepared> },
    /// Placed poles, by the baseline's gain K_m.
    Placed {
        pole_real: VectorOf<Parameter>,
        pole_imag: VectorOf<Parameter>,
        A_m: MatrixOf<Prepared>,
        K_m: MatrixOf<Prepared>,
    },
}

impl Dynamics {
    pub fn declare(d: &mut Declaration, plant: &PlantMatrices, structure: &L1Structure) -> Self {
        let (n, m) = plant.B.shape();
        let text = "desired closed-loop dynamics";
        let given = matrix("A_m", n, n, &format!("{text}; must be Hurwitz")).unit("1/s");
        let K_m = matrix("K_m", m, n, "gain of the baseline, the static state feedback");
        match (structure.baseline, structure.desired_dynamics) {
            (Baseline::None, _) => {
                let start = plant.A.as_ref().map_or(vec![0.0], |A| A.as_slice().to_vec());
                return Dynamics::Given(d.parameter(given.starts(&start)));
            }
            (_, DesiredDynamics::Matrix) => {
                return Dynamics::Matched { A_m: d.parameter(given), K_m: d.prepared(K_m) };
            }
            (_, DesiredDynamics::Poles) => {}
        }
        let order = "in the order of the inputs, conjugates side by side";
        let real = format!("real part of a desired closed-loop pole, {order}");
        let imag = format!("imaginary part of a desired closed-loop pole, {order}");
        Dynamics::Placed {
            pole_real: d.parameter(vector("pole_real", n, &real).unit("1/s").start(-1.0)),
            pole_imag: d.parameter(vector("pole_imag", n, &imag).unit("rad/s").in_own_unit()),
            A_m: d.prepared(matrix("A_m", n, n, text).unit("1/s")),
            K_m: d.prepared(K_m),
        }
    }

    /// The desired dynamics.
    pub fn A_m<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        match self {
            Dynamics::Given(A_m) | Dynamics::Matched { A_m, .. } => v.matrix(*A_m),
            Dynamics::Placed { A_m, .. } => v.matrix(*A_m),
        }
    }

    /// The name of the desired dynamics, for a text.
    pub fn name_of_A_m(&self, v: &Values<f64>) -> String {
        match self {
            Dynamics::Given(A_m) | Dynamics::Matched { A_m, .. } => v.name(*A_m),
            Dynamics::Placed { A_m, .. } => v.name(*A_m),
        }
    }

    /// The gain of the baseline, where there is one.
    pub fn gain(&self) -> Option<MatrixOf<Prepared>> {
        match self {
            Dynamics::Given(_) => None,
            Dynamics::Matched { K_m, .. } | Dynamics::Placed { K_m, .. } => Some(*K_m),
        }
    }

    /// The poles that are to be placed, where they are.
    pub fn poles(&self, v: &Values<f64>) -> Option<Vec<Complex<f64>>> {
        let Dynamics::Placed { pole_real, pole_imag, .. } = self else { return None };
        Some(v[*pole_real].iter().zip(&v[*pole_imag]).map(|(&re, &im)| Complex::new(re, im)).collect())
    }

    /// Computes K_m if there is a baseline, and A_m if poles are to be placed.
    ///
    /// # Errors
    /// [`Invalid`] where no feedback leads there.
    pub fn prepare(&self, plant: &PlantMatrices, v: &mut Point) -> Result<(), Invalid> {
        let Some(A) = &plant.A else { return Ok(()) };
        match self {
            Dynamics::Given(_) => {}
            Dynamics::Matched { A_m, K_m } => {
                let gain = matching_gain(A, &plant.B, (&v.name(*A_m), &v.matrix(*A_m).into_owned()))?;
                v.matrix_mut(*K_m).copy_from(&gain);
            }
            Dynamics::Placed { A_m, K_m, .. } => {
                let poles = self.poles(&v.values()).unwrap_or_default();
                let gain = pole_placement::place(A, &plant.B, &poles)?;
                v.matrix_mut(*A_m).copy_from(&(A - &plant.B * &gain));
                v.matrix_mut(*K_m).copy_from(&gain);
            }
        }
        Ok(())
    }
}

impl Design {
    pub fn declare(
        d: &mut Declaration,
        plant: &PlantMatrices,
        structure: &L1Structure,
        units: &Symbols,
        has_closed_form: bool,
    ) -> Result<Self, Invalid> {
        let ((n, m), k) = (plant.B.shape(), plant.B_um.ncols());
        let full = structure.is_full();
        let mut omega_bound = |name: &str, text: &str| {
            if full { d.parameter(matrix(name, m, m, text)).elements() } else { d.parameter(diagonal(name, m, text)) }
        };
        let (omega_min, omega_max) = (
            omega_bound("omega_min", "lower bound of the input gain omega"),
            omega_bound("omega_max", "upper bound of the input gain omega"),
        );
        let tolerance = "error tolerated in each closed-form step of the adaptation in co-simulation, relative to a \
                         value's magnitude or nominal value, where that is less than relative_tolerance or a master's";
        let phase =
            "angle through which the adaptation may turn in a communication step; check advises steps that keep to it";
        let closed_form = "angle through which the adaptation turns in a step from which on the closed form is taken, in \
                           co-simulation, for a tolerance of 1e-6; below, a general method is less work";
        let tracking = "time constant with which u_ad tracks the limited control (anti-windup); \
                        -1 s: 1/K, 0: off";
        let inertia = "nominal inertia that turns a commanded acceleration into the control";
        Ok(Design {
            adaptation_gain: d
                .parameter(scalar("adaptation_gain", "adaptation gain Gamma").start(1e5).positive().nominal(1e5)),
            feedback_gain: d.parameter(
                matrix("feedback_gain", m, m, "feedback gain K of the filter K D(s)").unit("1/s").identity(),
            ),
            dynamics: Dynamics::declare(d, plant, structure),
            Q: d.parameter(
                matrix("Q", n, n, "right-hand side of the Lyapunov equation A_m' P + P A_m = -Q").identity(),
            ),
            omega_min,
            omega_max,
            theta_bound: theta_bound(d, (m, n), structure.regressor)?,
            sigma_bound: d.parameter(vector("sigma_bound", m, "bound on the magnitude of sigma").min(0.0)),
            projection_tolerance: d.parameter(
                scalar("projection_tolerance", "width of the layer at the bounds in which projection acts")
                    .start(0.1)
                    .positive()
                    .max(10.0),
            ),
            closed_form: has_closed_form.then(|| ClosedForm {
                tolerance: d
                    .parameter(scalar("adaptation_tolerance", tolerance).start(1e-3).min(1e-9).max(1.0).nominal(1e-3)),
                phase: d
                    .parameter(scalar("closed_form_phase", closed_form).unit("rad").in_own_unit().start(10.0).min(0.0)),
            }),
            step_phase_limit: d
                .parameter(scalar("step_phase_limit", phase).unit("rad").in_own_unit().start(10.0).positive()),
            tracking_time: d.parameter(vector("tracking_time", m, tracking).unit("s").start(BY_GAIN).min(BY_GAIN)),
            inertia: (structure.commands == Commands::Acceleration).then(|| {
                d.parameter(vector("nominal_inertia", m, inertia).units(&units.inertia).start(1.0).positive())
            }),
            P: d.prepared(matrix("P", n, n, "solution of the Lyapunov equation")),
            K_g: d.prepared(matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")),
            PB: d.prepared(matrix("#PB", n, m + k, "").hidden()),
            lambda_max: d.prepared(scalar("#lambda_max", "").hidden()),
            lambda_max_unmatched: d.prepared(scalar("#lambda_max, unmatched", "").hidden()),
            follow_rate: d.prepared(scalar("#follow rate", "").hidden()),
            settling_time: d.prepared(scalar("#settling time", "").hidden()),
        })
    }

    /// The bounds on the magnitudes of the elements of a column of θ.
    pub fn theta_bounds<'a, S: Scalar>(&self, column: usize, v: &'a Values<S>) -> &'a [S] {
        let (all, m) = (&v[self.theta_bound], self.sigma_bound.len());
        &all[column * m % all.len()..][..m]
    }

    /// The desired dynamics.
    pub fn A_m<'a, S: Scalar>(&self, v: &Values<'a, S>) -> DMatrixView<'a, S> {
        self.dynamics.A_m(v)
    }

    /// The name of the desired dynamics, for a text.
    pub fn name_of_A_m(&self, v: &Values<f64>) -> String {
        self.dynamics.name_of_A_m(v)
    }

    /// The name of the baseline's gain, where there is a baseline.
    pub fn name_of_K_m(&self, v: &Values<f64>) -> Option<String> {
        self.dynamics.gain().map(|K_m| v.name(K_m))
    }

    /// The baseline's gain, where there is a baseline.
    pub fn K_m<'a, S: Scalar>(&self, v: &Values<'a, S>) -> Option<DMatrixView<'a, S>> {
        self.dynamics.gain().map(|K_m| v.matrix(K_m))
    }

    /// Factor from the command of a channel to its control.
    pub fn inertia<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        self.inertias(v).get(channel).copied().unwrap_or(S::from(1.0))
    }

    /// The same of all channels; none where each is 1.
    pub fn inertias<'a, S: Scalar>(&self, v: &'a Values<S>) -> &'a [S] {
        self.inertia.map_or(&[], |inertia| &v[inertia])
    }

    /// Poles, P, K_g and what follows from them.
    pub fn prepare(&self, plant: &PlantMatrices, v: &mut Point) -> Result<(), Invalid> {
        self.dynamics.prepare(plant, v)?;
        self.prepare_laws(plant, v)
    }

    /// Bounds and times, and numbers that follow from K only.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        for k in 0..self.omega_min.len() {
            v.require_at_most(self.omega_min.at(k), self.omega_max.at(k));
        }
        tracking::check(self.tracking_time, v);
        let channels = self.feedback_gain.shape().0 as f64;
        v[self.follow_rate] = squared(&v[self.feedback_gain.elements()]).sqrt() / channels.sqrt();
    }

    /// P, K_g and what follows from them.
    fn prepare_laws(&self, plant: &PlantMatrices, v: &mut Point) -> Result<(), Invalid> {
        let A_m = self.A_m(&v.values()).into_owned();
        let names = [self.name_of_A_m(&v.values()), v.name(self.Q)];
        let Q = v.matrix(self.Q).into_owned();
        let (P, decay) = lyapunov::solve_with_decay((&A_m, &Q), names.each_ref().map(String::as_str))?;
        let K_g = feedforward::gain(&A_m, &plant.B, &plant.C, &names[0])?;
        let largest = |B: &DMatrix<f64>| {
            let BPB = B.transpose() * &P * B;
            if B.ncols() == 0 {
                Ok(0.0)
            } else if BPB.norm_squared().is_finite() {
                Ok(BPB.symmetric_eigenvalues().max())
            } else {
                let [A_m, Q] = [self.name_of_A_m(&v.values()), v.name(self.Q)];
                let text = format!("{A_m}, {Q} and B are too large or too badly scaled: B' P B must be finite");
                Err(Invalid::because(text))
            }
        };
        let (matched, unmatched) = (largest(&plant.B)?, largest(&plant.B_um)?);
        (v[self.lambda_max], v[self.lambda_max_unmatched]) = (matched, unmatched);
        v.matrix_mut(self.K_g).copy_from(&K_g);
        v.matrix_mut(self.P).copy_from(&P);
        v.matrix_mut(self.PB).copy_from(&(P * plant.all_directions()));
        v[self.settling_time] = (SETTLED / decay).min(f64::MAX);
        Ok(())
    }
}

/// The bounds on θ, m × n where it multiplies the state: of each element where a description gives a matrix, else of rows.
///
/// # Errors
/// A matrix where θ multiplies the norm.
fn theta_bound(
    d: &mut Declaration,
    (m, n): (usize, usize),
    regressor: Regressor,
) -> Result<VectorOf<Parameter>, Invalid> {
    const NAME: &str = "theta_bound";
    if !d.starts_as_matrix(NAME) {
        let text = "bound on the magnitude of each element of this row of theta";
        return Ok(d.parameter(vector(NAME, m, text).min(0.0)));
    }
    if regressor == Regressor::InfinityNorm {
        let allowed = format!(
            "must be a list of {m} numbers with regressor = \"infinity_norm\", where theta has one element for each input. \
             Use regressor = \"state\" to bound each element of theta"
        );
        return Err(Invalid::new(format!("[start] {NAME}"), "a matrix", allowed));
    }
    Ok(d.parameter(matrix(NAME, m, n, "bound on the magnitude of this element of theta").min(0.0)).elements())
}

/// K_m with A − B K_m = A_m, which messages call by a name.
fn matching_gain(
    A: &DMatrix<f64>,
    B: &DMatrix<f64>,
    (name, A_m): (&str, &DMatrix<f64>),
) -> Result<DMatrix<f64>, Invalid> {
    let wanted = A - A_m;
    let gain = B.clone().svd(true, true).solve(&wanted, 0.0).map_err(Invalid::because)?;
    let left = (B * &gain - &wanted).amax();
    if left <= 1e-9 * wanted.amax() {
        return Ok(gain);
    }
    let allowed =
        format!("state feedback can only change what the inputs reach: A - {name} must lie in the range of B");
    Err(Invalid::new(format!("{name}: what no feedback changes in A - {name}"), format!("{left:.3e}"), allowed))
}
