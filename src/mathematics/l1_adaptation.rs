//! The adaptation of an L1 law at rest: how fast it turns, and which K it tolerates.
//!
//! With x̃ the prediction error, w = L_P x̃, L_P = (Bᵀ P B)⁻¹ Bᵀ P, and all else at rest, the estimates move by
//! w'' − (L_P ΔB K + L_P A_m B) w' + Γ N Bᵀ P B w = 0, where ΔB = B (ω − I) is what the control does beyond its nominal effect,
//! K is that of u_ad' = −K η̂, and the diagonal N ≥ I grows with the magnitudes of the signals. A mode r of N Bᵀ P B
//! decays where rᵀ Bᵀ P ΔB K r < ½ rᵀ Bᵀ Q B r, whatever Γ is.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use crate::mathematics::matrices::cholesky;

/// Ratio of the adaptation's frequency to the filter's at which its own motion doesn't show.
const FASTER: f64 = 10.0;

/// Ratios of the speeds of estimates in different channels, due to the magnitudes of signals.
const SHARES: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];

/// Matrices N that are tried at most.
const MOST_SHARES: usize = 256;

/// The adaptation of a law with P and Q of its Lyapunov equation.
#[derive(Debug, Clone)]
pub struct L1Adaptation {
    /// Bᵀ P B, m × m.
    pub BPB: DMatrix<f64>,
    /// Bᵀ Q B, m × m.
    pub BQB: DMatrix<f64>,
    /// Γ.
    pub gain: f64,
}

impl L1Adaptation {
    /// Angular frequency of the slowest direction, rad/s.
    pub fn slowest(&self) -> f64 {
        (self.gain * self.least()).sqrt()
    }

    fn least(&self) -> f64 {
        self.BPB.symmetric_eigenvalues().min().max(0.0)
    }

    /// Its largest damping: of s² + α s + Γ μ, α. `None` where columns of B depend on each other.
    fn damping(&self) -> Option<f64> {
        let L = cholesky(self.BPB.clone())?.l();
        let half = L.solve_lower_triangular(&self.BQB)?;
        let whole = L.solve_lower_triangular(&half.transpose())?;
        Some(0.5 * whole.symmetric_eigenvalues().max())
    }

    /// The Γ with which each direction turns fast enough for a filter of this bandwidth, rad/s, not to see it.
    pub fn needed(&self, bandwidth: f64) -> Option<f64> {
        let fast = FASTER * bandwidth;
        Some(fast * (fast + self.damping()?) / self.least()).filter(|gain| gain.is_finite())
    }

    /// Factor by which K may grow, or has to shrink, for the adaptation at rest to decay at each of these input gains;
    /// infinite if any may be. With `is_full` all estimates of the input gain share each signal, and N = I.
    pub fn tolerated(&self, K: &DMatrix<f64>, omegas: &[DMatrix<f64>], is_full: bool) -> f64 {
        let m = K.nrows();
        let excess: Vec<_> = omegas.iter().map(|omega| &self.BPB * (omega - DMatrix::identity(m, m)) * K).collect();
        let modes = shares(m, is_full).into_iter().flat_map(|share| self.modes(&share));
        let factor = |r: DVector<f64>| {
            let (damped, least) = (0.5 * (&self.BQB * &r).dot(&r), f64::INFINITY);
            excess.iter().map(|excess| damped / (excess * &r).dot(&r).max(0.0)).fold(least, f64::min)
        };
        modes.map(factor).fold(f64::INFINITY, f64::min)
    }

    /// The largest k of K = k I with which the adaptation at rest decays for each ΔB within bounds by element, given P B; infinite
    /// where any may be. Rows count, too, that B doesn't enter.
    pub fn largest_gain(&self, PB: &DMatrix<f64>, bounds: &DMatrix<f64>, is_full: bool) -> f64 {
        let modes = shares(PB.ncols(), is_full).into_iter().flat_map(|share| self.modes(&share));
        // The corner of ΔB that is worst for a mode.
        let grows = |r: &DVector<f64>| (PB * r).abs().dot(&(bounds * r.abs()));
        modes.map(|r| 0.5 * (&self.BQB * &r).dot(&r) / grows(&r)).fold(f64::INFINITY, f64::min)
    }

    /// Eigenvectors of N Bᵀ P B.
    fn modes(&self, share: &DVector<f64>) -> Vec<DVector<f64>> {
        let root = share.map(f64::sqrt);
        let scaled = DMatrix::from_fn(root.len(), root.len(), |i, j| root[i] * self.BPB[(i, j)] * root[j]);
        scaled.symmetric_eigen().eigenvectors.column_iter().map(|mode| mode.component_mul(&root)).collect()
    }
}

/// The diagonals of N to try: all combinations of the shares; fewer of them if there are many channels, and single fast
/// channels beyond that.
fn shares(m: usize, is_full: bool) -> Vec<DVector<f64>> {
    let equal = DVector::from_element(m, 1.0);
    if is_full || m == 1 {
        return vec![equal];
    }
    let power = |levels: usize| u32::try_from(m).ok().and_then(|m| levels.checked_pow(m));
    let all = [1, 3].into_iter().find_map(|stride: usize| {
        let levels: Vec<_> = SHARES.iter().step_by(stride).copied().collect();
        power(levels.len()).filter(|&count| count <= MOST_SHARES).map(|count| (levels, count))
    });
    match all {
        Some((levels, count)) => {
            let digit = |point: usize, k: usize| levels[point / levels.len().pow(k as u32) % levels.len()];
            (0..count).map(|point| DVector::from_fn(m, |k, _| digit(point, k))).collect()
        }
        None => {
            let one = |fast: usize| DVector::from_fn(m, |k, _| if k == fast { SHARES[3] } else { 1.0 });
            std::iter::once(equal).chain((0..m).map(one)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Complex;

    use super::*;
    use crate::eigenvalues::complex as eigenvalues;
    use crate::mathematics::lyapunov;

    /// A third-order plant, x' = A_m x + B (ω u_ad + …), poles −4.7, −5.7, −6.8, Q = I.
    fn third() -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        let A_m = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -182.172, -97.51, -17.2]);
        let B = DMatrix::from_column_slice(3, 1, &[0.0, 0.0, 0.6]);
        let P = lyapunov::solve(&A_m, &DMatrix::identity(3, 3)).unwrap();
        (A_m, B, P)
    }

    fn adaptation(B: &DMatrix<f64>, P: &DMatrix<f64>, gain: f64) -> L1Adaptation {
        L1Adaptation { BPB: B.transpose() * P * B, BQB: B.transpose() * B, gain }
    }

    /// The largest real part of the linear loop at rest: x, x̃, σ̂, u_ad, with ω̂ = I and θ̂ = 0.
    fn growth(
        (A_m, B, P): (&DMatrix<f64>, &DMatrix<f64>, &DMatrix<f64>),
        omega: &DMatrix<f64>,
        K: &DMatrix<f64>,
        gain: f64,
    ) -> f64 {
        let (n, m) = B.shape();
        let mut A = DMatrix::zeros(2 * n + 2 * m, 2 * n + 2 * m);
        let (error, sigma, u) = (n, 2 * n, 2 * n + m);
        A.view_mut((0, 0), (n, n)).copy_from(A_m);
        A.view_mut((0, u), (n, m)).copy_from(&(B * omega));
        A.view_mut((error, error), (n, n)).copy_from(A_m);
        A.view_mut((error, sigma), (n, m)).copy_from(B);
        A.view_mut((error, u), (n, m)).copy_from(&(B * (DMatrix::identity(m, m) - omega)));
        A.view_mut((sigma, error), (m, n)).copy_from(&(B.transpose() * P * -gain));
        A.view_mut((u, sigma), (m, m)).copy_from(&-K);
        A.view_mut((u, u), (m, m)).copy_from(&-K);
        eigenvalues(&A).unwrap().iter().map(|pole: &Complex<f64>| pole.re).fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn the_adaptation_at_rest_decays_just_below_the_tolerated_gain_and_grows_just_above() {
        let (A_m, B, P) = third();
        let K = DMatrix::from_element(1, 1, 100.0);
        for omega in [2.0, 3.0] {
            let omega = DMatrix::from_element(1, 1, omega);
            let factor = adaptation(&B, &P, 1e8).tolerated(&K, std::slice::from_ref(&omega), false);
            let grows = |part: f64| growth((&A_m, &B, &P), &omega, &(&K * (factor * part)), 1e8) > 1e-3;
            assert!(!grows(0.98) && grows(1.02), "{factor}");
        }
        let at_three = adaptation(&B, &P, 5e3).tolerated(&K, &[DMatrix::from_element(1, 1, 3.0)], false);
        // A thirteenth.
        assert!((1.0 / at_three - 13.19).abs() < 0.02, "{at_three}");
        assert_eq!(adaptation(&B, &P, 5e3).tolerated(&K, &[DMatrix::from_element(1, 1, 0.3)], false), f64::INFINITY);
    }

    #[test]
    fn with_two_channels_it_is_the_worst_of_their_modes() {
        let A_m = DMatrix::from_row_slice(3, 3, &[-2.0, 1.0, 0.0, -1.0, -3.0, 0.5, 0.3, 0.0, -4.0]);
        let B = DMatrix::from_row_slice(3, 2, &[1.0, 0.2, 0.0, 2.0, 0.7, -0.4]);
        let P = lyapunov::solve(&A_m, &DMatrix::identity(3, 3)).unwrap();
        let (K, omega) =
            (DMatrix::from_diagonal_element(2, 2, 5.0), DMatrix::from_row_slice(2, 2, &[1.8, 0.3, -0.2, 1.4]));
        let factor = adaptation(&B, &P, 1e9).tolerated(&K, std::slice::from_ref(&omega), true);
        let grows = |part: f64| growth((&A_m, &B, &P), &omega, &(&K * (factor * part)), 1e9) > 1e-3;
        assert!(!grows(0.98) && grows(1.02), "{factor}");
        // Signals that make one channel faster than the other make no mode better than the worst that is looked at.
        assert!(adaptation(&B, &P, 1e9).tolerated(&K, &[omega], false) <= factor);
    }

    #[test]
    fn the_needed_gain_turns_ten_times_as_fast_as_the_filter() {
        let (_, B, P) = third();
        let needed = adaptation(&B, &P, 1.0).needed(300.0).unwrap();
        let turns = adaptation(&B, &P, needed).slowest();
        // s² + α s + Γ μ with α = 15.16 and 3000 rad/s.
        assert!((turns / (3000.0_f64 * 3015.16).sqrt() - 1.0).abs() < 1e-5, "{turns}");
    }

    #[test]
    fn shares_are_combinations_as_long_as_there_are_few_channels() {
        for (m, count) in [(1, 1), (2, 16), (4, 256), (6, 64), (8, 256), (50, 51)] {
            let all = shares(m, false);
            assert_eq!((all.len(), shares(m, true).len()), (count, 1), "{m}");
            assert!(all.iter().all(|share| share.len() == m && share.max() <= 1000.0));
        }
    }
}
