//! Parameters of the controller, and matrices that are designed from them.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::controllers::l1::{Dynamics, InputGain, L1Structure, PlantMatrices, SETTLED};
use crate::mathematics::{feedforward, lyapunov};
use crate::system::{
    Declaration, Invalid, MatrixOf, Parameter, Point, Prepared, Scalar, ScalarOf, Values, VectorOf, matrix, scalar,
    smaller, vector,
};

/// Angle through which estimates and plant may turn in a step where the plant is stepped first: from 1.5 on they chatter.
const ANGLE: f64 = 0.2;
/// Dead time that a step may be where all FMUs are stepped simultaneously, in parts of the tolerated one.
pub(super) const OF_DEAD_TIME: f64 = 0.5;

/// Parameters, and what follows from them.
#[derive(Debug)]
pub(super) struct Design {
    pub adaptation_gain: ScalarOf<Parameter>,
    pub dynamics: Dynamics,
    pub Q: MatrixOf<Parameter>,
    pub omega_min: VectorOf<Parameter>,
    pub omega_max: VectorOf<Parameter>,
    /// Bound of the entries of κ off its diagonal, where they are estimated.
    pub kappa_coupling: Option<ScalarOf<Parameter>>,
    pub theta_bound: MatrixOf<Parameter>,
    pub sigma_bound: VectorOf<Parameter>,
    /// υ
    pub leakage: ScalarOf<Parameter>,
    pub projection_tolerance: ScalarOf<Parameter>,
    pub P: MatrixOf<Prepared>,
    pub K_g: MatrixOf<Prepared>,
    pub PB: MatrixOf<Prepared>,
    /// −A_m⁻¹ B: where the model rests for a control of 1.
    pub at_rest: MatrixOf<Prepared>,
    /// Largest eigenvalue of Bᵀ P B.
    pub lambda_max: ScalarOf<Prepared>,
    /// d, the damping of the oscillation of estimates and plant, 1/s.
    pub damping: ScalarOf<Prepared>,
    pub settling_time: ScalarOf<Prepared>,
}

impl Design {
    /// Parameters for a regressor of so many elements.
    pub fn declare(d: &mut Declaration, plant: &PlantMatrices, structure: &L1Structure, columns: usize) -> Self {
        let (n, m) = plant.B.shape();
        let gain = "adaptation gain Gamma; the dead time that the loop tolerates falls as 1/Gamma";
        let coupling = "bound on the magnitude of the off-diagonal entries of kappa";
        let leakage = "leakage of the estimates, times |e|: it keeps noise from driving them; 0: off";
        let omega = |name: &str, which: &str| {
            vector(name, m, &format!("{which} bound of the input gain, in parts of B")).start(1.0).positive()
        };
        let is_full = structure.input_gain == InputGain::Full;
        Design {
            adaptation_gain: d.parameter(scalar("adaptation_gain", gain).start(100.0).positive().nominal(100.0)),
            dynamics: Dynamics::declare(d, plant, structure),
            Q: d.parameter(
                matrix("Q", n, n, "right-hand side of the Lyapunov equation A_m' P + P A_m = -Q").identity(),
            ),
            omega_min: d.parameter(omega("omega_min", "lower")),
            omega_max: d.parameter(omega("omega_max", "upper")),
            kappa_coupling: is_full.then(|| d.parameter(scalar("kappa_coupling", coupling).min(0.0))),
            theta_bound: d.parameter(
                matrix("theta_bound", m, columns, "bound on the magnitude of this element of theta").min(0.0),
            ),
            sigma_bound: d.parameter(vector("sigma_bound", m, "bound on the magnitude of sigma").min(0.0)),
            leakage: d.parameter(scalar("leakage", leakage).min(0.0)),
            projection_tolerance: d.parameter(
                scalar("projection_tolerance", "width of the layer at the bounds in which projection acts")
                    .start(0.1)
                    .positive()
                    .max(10.0),
            ),
            P: d.prepared(matrix("P", n, n, "solution of the Lyapunov equation")),
            K_g: d.prepared(matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")),
            PB: d.prepared(matrix("#PB", n, m, "").hidden()),
            at_rest: d.prepared(matrix("#-A_m^-1 B", n, m, "").hidden()),
            lambda_max: d.prepared(scalar("#lambda_max", "").hidden()),
            damping: d.prepared(scalar("#damping", "").hidden()),
            settling_time: d.prepared(scalar("#settling time", "").hidden()),
        }
    }

    /// Bounds that the start of κ̂, at 0, lies within: those of an input gain of 1.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        for i in 0..self.omega_min.len() {
            let one = S::from(1.0);
            for (bound, holds, side) in [
                (self.omega_min, v[self.omega_min][i].at_most(one), "at most"),
                (self.omega_max, v[self.omega_max][i].at_least(one), "at least"),
            ] {
                v.refuse(!holds, |v| {
                    let allowed = format!("must be {side} 1, the nominal input gain, from which the estimate starts");
                    Invalid::new(v.name(bound.at(i)), v[bound][i].to_text(), allowed)
                });
            }
        }
    }

    /// Poles, P, K_g and what follows from them.
    pub fn prepare(&self, plant: &PlantMatrices, v: &mut Point) -> Result<(), Invalid> {
        self.dynamics.prepare(plant, v)?;
        let A_m = self.dynamics.A_m(&v.values()).into_owned();
        let names = [self.dynamics.name_of_A_m(&v.values()), v.name(self.Q)];
        let Q = v.matrix(self.Q).into_owned();
        let (P, decay) = lyapunov::solve_with_decay((&A_m, &Q), names.each_ref().map(String::as_str))?;
        let K_g = feedforward::gain(&A_m, &plant.B, &plant.C, &names[0])?;
        let singular = || Invalid::because(format!("{} is singular", names[0]));
        let at_rest = -A_m.try_inverse().ok_or_else(singular)? * &plant.B;
        let [BPB, BQB] = Self::weights(&plant.B, &P, &Q);
        if !(BPB.norm_squared().is_finite() && BQB.norm_squared().is_finite() && at_rest.norm_squared().is_finite()) {
            let text =
                format!("{}, {} and B are too large or too badly scaled: B' P B must be finite", names[0], names[1]);
            return Err(Invalid::because(text));
        }
        let largest = BPB.symmetric_eigenvalues().max();
        v[self.lambda_max] = largest;
        v[self.damping] = if largest > 0.0 { BQB.symmetric_eigenvalues().min().max(0.0) / largest } else { 0.0 };
        v[self.settling_time] = (SETTLED / decay).min(f64::MAX);
        v.matrix_mut(self.PB).copy_from(&(&P * &plant.B));
        v.matrix_mut(self.P).copy_from(&P);
        v.matrix_mut(self.K_g).copy_from(&K_g);
        v.matrix_mut(self.at_rest).copy_from(&at_rest);
        Ok(())
    }

    /// ω_a for |u_b|² + |φ|² + 1.
    pub fn frequency<S: Scalar>(&self, signals: S, v: &Values<S>) -> S {
        (v[self.adaptation_gain] * v[self.lambda_max] * signals).sqrt()
    }

    /// The dead time that the oscillation of this frequency tolerates, s.
    pub fn dead_time<S: Scalar>(&self, frequency: S, v: &Values<S>) -> S {
        v[self.damping] / (frequency * frequency)
    }

    /// The longest steps for an oscillation of this frequency, s: where the plant is stepped before the controller, and where
    /// all FMUs are stepped simultaneously.
    pub fn longest_steps<S: Scalar>(&self, frequency: S, v: &Values<S>) -> [S; 2] {
        let first = frequency.recip() * ANGLE;
        [first, smaller(first, self.dead_time(frequency, v) * OF_DEAD_TIME)]
    }

    /// Bᵀ P B and Bᵀ Q B.
    pub fn weights(B: &DMatrix<f64>, P: &DMatrix<f64>, Q: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        [P, Q].map(|weight| B.transpose() * weight * B)
    }
}
