//! The linear loop that an L1 law becomes as its adaptation gets fast.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::design::robustness::linear::{LinearLaw, Parts, late, zero_order_hold};
use crate::design::robustness::uncertain::Uncertain;
use crate::design::step::exponential;

/// Numbers of an L1 law with D(s) = 1/s for an uncertain plant, in its coordinates.
#[derive(Debug, Clone)]
pub struct Law {
    /// A − B K_m, n × n.
    pub A_m: DMatrix<f64>,
    /// Gain of the baseline, m × n; 0 where there is none.
    pub K_m: DMatrix<f64>,
    /// Gain of the filter, m × m.
    pub K: DMatrix<f64>,
    /// Gain of the reference, m × m.
    pub K_g: DMatrix<f64>,
    /// Matched part of a rate, m × n: B⁺, or (Bᵀ P B)⁻¹ Bᵀ P of a law that adapts.
    pub L: DMatrix<f64>,
    /// I − B L.
    pub M: DMatrix<f64>,
    /// Basis of where x̃ of a law that adapts stays: Bᵀ P x̃ = 0; else without columns.
    pub free: DMatrix<f64>,
    /// True for a law that adapts: its predictor remembers what isn't matched.
    adapts: bool,
}

impl Law {
    /// A law with exact estimates.
    pub fn limit(plant: &Uncertain, K_m: &DMatrix<f64>, A_m: &DMatrix<f64>, K: &DMatrix<f64>) -> Option<Self> {
        Self::with(plant, K_m, A_m, K, plant.inverse.clone(), false)
    }

    /// A law that adapts fast, with P of its Lyapunov equation.
    pub fn adaptive(
        plant: &Uncertain,
        K_m: &DMatrix<f64>,
        A_m: &DMatrix<f64>,
        K: &DMatrix<f64>,
        P: &DMatrix<f64>,
    ) -> Option<Self> {
        let BP = plant.B.transpose() * P;
        let L = (&BP * &plant.B).try_inverse()? * BP;
        Self::with(plant, K_m, A_m, K, L, true)
    }

    fn with(
        plant: &Uncertain,
        K_m: &DMatrix<f64>,
        A_m: &DMatrix<f64>,
        K: &DMatrix<f64>,
        L: DMatrix<f64>,
        adapts: bool,
    ) -> Option<Self> {
        let n = plant.A.nrows();
        if !L.norm_squared().is_finite() {
            return None;
        }
        let at_rest = A_m.clone().lu().solve(&plant.B)?;
        let K_g = -(&plant.C * at_rest).try_inverse()?;
        let M = DMatrix::identity(n, n) - &plant.B * &L;
        let free = if adapts { kernel(&L) } else { DMatrix::zeros(n, 0) };
        Some(Law { A_m: A_m.clone(), K_m: K_m.clone(), K: K.clone(), K_g, L, M, free, adapts })
    }

    /// The same with another K.
    pub fn with_gain(&self, K: DMatrix<f64>) -> Self {
        Law { K, ..self.clone() }
    }
}

impl LinearLaw for Law {
    /// States are x, x̃ in the basis of where it stays, and w = u_ad + K L x.
    fn parts(&self) -> Parts {
        let ((m, n), k) = (self.K_m.shape(), self.free.ncols());
        let N = n + k + m;
        let matched = &self.K * &self.L;
        let towards = &matched * &self.A_m;
        let mut parts = Parts {
            own: DMatrix::zeros(N, N),
            entry: DMatrix::zeros(N, n),
            control: DMatrix::zeros(m, N),
            reference: DMatrix::zeros(N, m),
            direct: DMatrix::zeros(m, m),
        };
        parts.entry.view_mut((0, 0), (n, n)).fill_with_identity();
        parts.own.view_mut((n + k, 0), (m, n)).copy_from(&towards);
        if k > 0 {
            let unmatched = self.free.transpose() * &self.M;
            let towards_x = &unmatched * &self.A_m;
            parts.own.view_mut((n, 0), (k, n)).copy_from(&towards_x);
            parts.own.view_mut((n, n), (k, k)).copy_from(&(towards_x * &self.free));
            parts.own.view_mut((n + k, n), (m, k)).copy_from(&(&towards * &self.free));
            parts.entry.view_mut((n, 0), (k, n)).copy_from(&-unmatched);
        }
        parts.control.view_mut((0, 0), (m, n)).copy_from(&-(&self.K_m + matched));
        parts.control.view_mut((0, n + k), (m, m)).fill_with_identity();
        parts.reference.view_mut((n + k, 0), (m, m)).copy_from(&(&self.K * &self.K_g));
        parts
    }

    fn sampled(&self, plant: &Uncertain, A_t: &DMatrix<f64>, B_t: &DMatrix<f64>, H: f64) -> Option<DMatrix<f64>> {
        let (m, n) = self.K_m.shape();
        let (registers, own) = (late(plant.delay, H)? * m, if self.adapts { n } else { 0 });
        let N = n + own + m + registers;
        let (w, waiting) = (n + own, n + own + m);
        let [over_x, over_u] = zero_order_hold(A_t, B_t, H)?;
        let mut step = DMatrix::zeros(N, N);
        step.view_mut((0, 0), (n, n)).copy_from(&over_x);
        // The oldest control acts, the others move on.
        step.view_mut((0, waiting), (n, m)).copy_from(&over_u);
        for k in 0..registers - m {
            step[(waiting + k, waiting + k + m)] = 1.0;
        }
        let newest = N - m;
        let matched = &self.K * &self.L;
        if !self.adapts {
            step.view_mut((w, 0), (m, n)).copy_from(&(&matched * &self.A_m * H));
            step.view_mut((w, w), (m, m)).fill_with_identity();
            let u = step.rows(w, m).into_owned();
            step.rows_mut(newest, m).copy_from(&u);
            let mut of_x = step.view_mut((newest, 0), (m, n));
            of_x -= &self.K_m + matched;
            return Some(step);
        }
        // At the sample x̂ takes what of x is matched, then both run on.
        let mut between = DMatrix::zeros(n + m, n + m);
        between.view_mut((0, 0), (n, n)).copy_from(&(&self.M * &self.A_m * H));
        between.view_mut((n, 0), (m, n)).copy_from(&(&matched * &self.A_m * H));
        let between = exponential(between)?;
        let mut sample = DMatrix::zeros(n + m, N);
        sample.view_mut((0, 0), (n, n)).copy_from(&(&plant.B * &self.L));
        sample.view_mut((0, n), (n, n)).copy_from(&self.M);
        sample.view_mut((n, 0), (m, n)).copy_from(&-&matched);
        sample.view_mut((n, n), (m, n)).copy_from(&matched);
        sample.view_mut((n, w), (m, m)).fill_with_identity();
        step.rows_mut(n, n + m).copy_from(&(between * sample));
        let u = step.rows(w, m).into_owned();
        step.rows_mut(newest, m).copy_from(&u);
        let mut of_x = step.view_mut((newest, 0), (m, n));
        of_x -= &self.K_m;
        Some(step)
    }
}

/// An orthonormal basis of the vectors that L takes to 0.
fn kernel(L: &DMatrix<f64>) -> DMatrix<f64> {
    let (m, n) = L.shape();
    let eigen = (L.transpose() * L).symmetric_eigen();
    let mut order: Vec<_> = (0..n).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    eigen.eigenvectors.select_columns(&order[..n - m])
}
