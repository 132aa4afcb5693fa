//! The loop that an L1 adaptive law closes through its filter, and the norm that its stability rests on.
//!
//! C. Cao and N. Hovakimyan, Design and analysis of a novel L1 adaptive control architecture with guaranteed transient
//! performance, IEEE Trans. Automatic Control 53 (2008) 586–591.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use crate::control::filter::Filter;
use crate::control::l1_norm::{Bounds, l1_norm};
use crate::control::lyapunov::require_hurwitz;
use crate::error::Invalid;

/// Points at most of a grid over the bounds of the input gain.
const GRID: usize = 128;

/// Entries of the input gain at most whose every corner is tried.
const ENTRIES: usize = 10;

/// Points of the grid of frequencies in a decade.
const PER_DECADE: f64 = 40.0;

/// The L1 law u = −K D(s)(η̂ − K_g r) for x' = A_m x + B (ω u + …), with ω between bounds, entry by entry.
#[derive(Debug, Clone, Copy)]
pub struct L1Design<'a> {
    /// n × n, Hurwitz.
    pub A_m: &'a DMatrix<f64>,
    /// n × m.
    pub B: &'a DMatrix<f64>,
    /// m × m.
    pub K: &'a DMatrix<f64>,
    /// D(s), the same on every channel.
    pub filter: &'a Filter,
    /// m × m.
    pub omega_min: &'a DMatrix<f64>,
    /// m × m.
    pub omega_max: &'a DMatrix<f64>,
}

/// The input gain with the largest norm among those tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Worst {
    /// The norm there, infinite where the loop isn't stable.
    pub norm: Bounds,
    /// The input gain.
    pub omega: DMatrix<f64>,
    /// How many input gains were tried.
    pub points: usize,
    /// Whether every corner of the bounds was among them. If not, only some were, and a larger norm is more likely to
    /// have been missed.
    pub every_corner: bool,
}

/// Frequencies, rad/s, up to which the filtered control follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bandwidth {
    /// Where the slowest direction has fallen to 1/√2.
    pub slowest: f64,
    /// Where the fastest one has.
    pub fastest: f64,
}

impl L1Design<'_> {
    /// Matrix of the loop ωK D(s), whose eigenvalues are the poles of C(s).
    pub fn loop_matrix(&self, omega: &DMatrix<f64>) -> DMatrix<f64> {
        let Filter { A_f, B_f, C_f } = self.filter;
        DMatrix::identity(self.K.nrows(), self.K.nrows()).kronecker(A_f) - (omega * self.K).kronecker(&(B_f * C_f))
    }

    /// Whether the loop ωK D(s) is stable.
    pub fn is_stable(&self, omega: &DMatrix<f64>) -> bool {
        self.loop_matrix(omega).complex_eigenvalues().iter().all(|lambda| lambda.re < 0.0)
    }

    /// ‖G‖ in the L1 sense, G(s) = (sI − A_m)⁻¹ B (I − C(s)), C(s) = ωK D(s) (I + ωK D(s))⁻¹; infinite when the loop
    /// isn't stable.
    ///
    /// The L1-norm condition is ‖G‖ L < 1 with the Lipschitz constant L of the uncertainty.
    ///
    /// # Errors
    /// [`Invalid`] when A_m isn't Hurwitz, or the system too badly scaled.
    pub fn norm(&self, omega: &DMatrix<f64>) -> Result<Bounds, Invalid> {
        require_hurwitz("A_m", self.A_m)?;
        if !self.is_stable(omega) {
            return Ok(Bounds::INFINITE);
        }
        let (n, m) = self.B.shape();
        let states = m * self.filter.order();
        let identity = DMatrix::identity(m, m);
        // z = (I − C) v is what the filter's channels take in: z = v − ωK y, y = D z.
        let mut A = DMatrix::zeros(n + states, n + states);
        A.view_mut((0, 0), (n, n)).copy_from(self.A_m);
        let fed_back = self.B * omega * self.K * identity.kronecker(&self.filter.C_f);
        A.view_mut((0, n), (n, states)).copy_from(&-fed_back);
        A.view_mut((n, n), (states, states)).copy_from(&self.loop_matrix(omega));
        let mut B = DMatrix::zeros(n + states, m);
        B.view_mut((0, 0), (n, m)).copy_from(self.B);
        B.view_mut((n, 0), (states, m)).copy_from(&identity.kronecker(&self.filter.B_f));
        l1_norm(&A, &B, &DMatrix::identity(n, n + states))
    }

    /// The largest norm over ω: on a grid of its bounds for up to four entries with distinct bounds, at the corners and
    /// the centre for up to ten, at 1024 corners spread over all and the centre for more.
    ///
    /// Between the points it may be larger; corners and centre are where it is usually largest.
    ///
    /// # Errors
    /// [`Invalid`] as of [`L1Design::norm`].
    pub fn worst(&self) -> Result<Worst, Invalid> {
        let gains = self.gains();
        let mut worst: Option<(Bounds, &DMatrix<f64>)> = None;
        for omega in &gains {
            let norm = self.norm(omega)?;
            if worst.is_none_or(|(largest, _)| norm.upper > largest.upper) {
                worst = Some((norm, omega));
            }
        }
        let (norm, omega) = worst.ok_or_else(|| Invalid::because("omega_min, omega_max: no input gain to try"))?;
        Ok(Worst { norm, omega: omega.clone(), points: gains.len(), every_corner: self.free().len() <= ENTRIES })
    }

    /// Entries of ω whose bounds differ.
    fn free(&self) -> Vec<usize> {
        (0..self.omega_min.len()).filter(|&k| self.omega_min[k] < self.omega_max[k]).collect()
    }

    /// The input gains to try.
    fn gains(&self) -> Vec<DMatrix<f64>> {
        let free = self.free();
        let at = |place: &dyn Fn(usize) -> f64| {
            let mut omega = self.omega_min.clone();
            for (k, &entry) in free.iter().enumerate() {
                omega[entry] += place(k) * (self.omega_max[entry] - self.omega_min[entry]);
            }
            omega
        };
        let power = |levels: usize| u32::try_from(free.len()).ok().and_then(|k| levels.checked_pow(k));
        // An odd number of levels has the centre among them.
        if let Some(levels) = [9, 5, 3].into_iter().find(|&levels| power(levels).is_some_and(|count| count <= GRID)) {
            let count = power(levels).unwrap_or(1);
            let digit = |point: usize, k: usize| point / levels.pow(k as u32) % levels;
            return (0..count).map(|point| at(&|k| digit(point, k) as f64 / (levels - 1) as f64)).collect();
        }
        let corners = 1 << free.len().min(ENTRIES);
        let corner = |point: usize, k: usize| {
            if free.len() <= ENTRIES {
                return f64::from(u8::from(point >> k & 1 == 1));
            }
            // Beyond: the parity of a few bits of the point, others for each entry, as in an orthogonal array.
            let mask = (k + 1).wrapping_mul(0x9E37_79B9) >> 7 & (corners - 1) | 1;
            f64::from((point & mask).count_ones() & 1)
        };
        let mut gains: Vec<_> = (0..corners).map(|point| at(&|k| corner(point, k))).collect();
        gains.push(at(&|_| 0.5));
        gains
    }

    /// C(s) = ωK D(s) (I + ωK D(s))⁻¹. `None` at a pole.
    pub fn low_pass(&self, omega: &DMatrix<f64>, s: Complex<f64>) -> Option<DMatrix<Complex<f64>>> {
        let d = self.filter.at(s);
        let gain = (omega * self.K).map(Complex::from);
        let m = gain.nrows();
        // With D = 1/q: C = ωK (q I + ωK)⁻¹, which holds at the integrator's pole too.
        let q = if d.is_finite() { d.inv() } else { Complex::from(0.0) };
        (DMatrix::identity(m, m) * q + &gain).try_inverse().map(|inverse| gain * inverse)
    }

    /// C(0), the identity as D(s) has an integrator; `None` when ωK is singular and the control can't cancel all
    /// constant uncertainty.
    pub fn dc_gain(&self, omega: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        self.low_pass(omega, Complex::from(0.0)).map(|gain| gain.map(|entry| entry.re))
    }

    /// Where the singular values of C(jω) have first fallen to 1/√2. `None` when the loop isn't stable.
    pub fn bandwidth(&self, omega: &DMatrix<f64>) -> Option<Bandwidth> {
        if !self.is_stable(omega) {
            return None;
        }
        let poles = self.loop_matrix(omega).complex_eigenvalues().map(Complex::norm);
        let (lowest, decades) = (1e-4 * poles.min(), (1e8 * poles.max() / poles.min()).log10());
        let values = |w: f64| self.low_pass(omega, Complex::new(0.0, w)).map(|C| C.singular_values());
        let falls = |value: &dyn Fn(f64) -> Option<f64>| {
            let grid = (0..(decades * PER_DECADE) as usize).map(|k| lowest * 10_f64.powf(k as f64 / PER_DECADE));
            let mut below = lowest;
            for w in grid {
                if value(w)? < std::f64::consts::FRAC_1_SQRT_2 {
                    return bisect(below, w, value);
                }
                below = w;
            }
            None
        };
        Some(Bandwidth {
            slowest: falls(&|w| values(w).map(|singular| singular.min()))?,
            fastest: falls(&|w| values(w).map(|singular| singular.max()))?,
        })
    }
}

/// Where a value that is above 1/√2 at `low` and below it at `high` is that.
fn bisect(mut low: f64, mut high: f64, value: &dyn Fn(f64) -> Option<f64>) -> Option<f64> {
    for _ in 0..60 {
        let middle = (low * high).sqrt();
        if value(middle)? < std::f64::consts::FRAC_1_SQRT_2 { high = middle } else { low = middle }
    }
    Some(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::filter::FilterDescription;
    use crate::control::pole_placement::place;

    struct Example {
        A_m: DMatrix<f64>,
        B: DMatrix<f64>,
        K: DMatrix<f64>,
        filter: Filter,
        omega_min: DMatrix<f64>,
        omega_max: DMatrix<f64>,
    }

    impl Example {
        fn design(&self) -> L1Design<'_> {
            let Example { A_m, B, K, filter, omega_min, omega_max } = self;
            L1Design { A_m, B, K, filter, omega_min, omega_max }
        }
    }

    fn filter(factors: &[&[f64]]) -> Filter {
        let denominator = factors.iter().map(|factor| factor.to_vec()).collect();
        Filter::new(&FilterDescription { denominator, ..FilterDescription::default() }).unwrap()
    }

    fn fifth_order() -> Filter {
        filter(&[&[1.0, 0.0], &[0.04, 1.0], &[1.0 / 70.0, 1.0], &[6.25e-4, 0.045, 1.0]])
    }

    fn scalar(x: f64) -> DMatrix<f64> {
        DMatrix::from_element(1, 1, x)
    }

    /// One input, D = 1/s.
    fn siso() -> Example {
        Example {
            A_m: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, -1.4]),
            B: DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
            K: scalar(20.0),
            filter: filter(&[&[1.0, 0.0]]),
            omega_min: scalar(0.5),
            omega_max: scalar(3.0),
        }
    }

    /// Three coupled states, two inputs.
    fn mimo(filter: Filter) -> Example {
        let omega = DMatrix::from_row_slice(2, 2, &[1.2, 0.3, -0.2, 0.8]);
        Example {
            A_m: DMatrix::from_row_slice(3, 3, &[-3.0, 1.0, 0.0, 0.0, -4.0, 2.0, -1.0, 0.0, -5.0]),
            B: DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.3, 1.0, 0.0, 0.5]),
            K: DMatrix::from_row_slice(2, 2, &[8.0, 1.0, 0.0, 6.0]),
            filter,
            omega_min: omega.clone(),
            omega_max: omega,
        }
    }

    #[track_caller]
    fn assert_is(found: Bounds, expected: f64) {
        let close = |bound: f64| (bound - expected).abs() < 2e-7 * expected;
        assert!(close(found.lower) && close(found.upper), "{found:?}, expected {expected}");
    }

    #[test]
    fn the_norm_is_that_of_the_impulse_responses() {
        // By numpy: modes of the impulse responses, their zeros by scipy.optimize.brentq, exact antiderivatives.
        let one = siso();
        assert_is(one.design().norm(&scalar(0.5)).unwrap(), 0.18711177630525086);
        assert_is(one.design().norm(&scalar(1.0)).unwrap(), 0.10340149026047432);
        assert_is(one.design().norm(&scalar(3.0)).unwrap(), 0.03777799631596649);
        let two = mimo(filter(&[&[1.0, 0.0]]));
        assert_is(two.design().norm(&two.omega_min).unwrap(), 0.22349492422692355);
        let two = mimo(filter(&[&[1.0, 0.0], &[0.04, 1.0]]));
        assert_is(two.design().norm(&two.omega_min).unwrap(), 0.25123878793363624);
    }

    /// Double integrators with one pair of poles each, and K.
    fn chains(pairs: &[(f64, f64)], k: f64) -> Example {
        let m = pairs.len();
        let mut A = DMatrix::zeros(2 * m, 2 * m);
        A.view_mut((0, m), (m, m)).fill_with_identity();
        let mut B = DMatrix::zeros(2 * m, m);
        B.view_mut((m, 0), (m, m)).fill_with_identity();
        let pair = |&(re, im): &(f64, f64)| [Complex::new(re, im), Complex::new(re, -im)];
        let poles: Vec<_> = pairs.iter().flat_map(pair).collect();
        let A_m = &A - &B * place(&A, &B, &poles).unwrap();
        Example { A_m, B, K: DMatrix::from_diagonal_element(m, m, k), ..siso() }
    }

    #[test]
    fn the_norms_of_a_quadrotor_a_robot_and_a_filter_of_fifth_order_are_right() {
        // By numpy as above; the last with the modes in mpmath to 40 digits.
        let quadrotor = chains(&[(-30.0, 0.5), (-35.0, 0.5), (-40.0, 0.5)], 30.0);
        let uniform = |omega| DMatrix::from_diagonal_element(3, 3, omega);
        assert_is(quadrotor.design().norm(&uniform(0.5)).unwrap(), 0.02454826205067584);
        assert_is(quadrotor.design().norm(&uniform(10.0)).unwrap(), 0.005310001824164684);
        let robot = chains(&[(-300.0, 5.0), (-400.0, 5.0)], 30.0);
        let omega = DMatrix::from_row_slice(2, 2, &[0.5, -0.3, -0.3, 0.5]);
        assert_is(robot.design().norm(&omega).unwrap(), 0.0027395491790482237);
        let unmatched = Example {
            A_m: DMatrix::from_row_slice(3, 3, &[-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, -1.8]),
            B: DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.0, 0.0, 1.0, 1.0]),
            K: DMatrix::from_diagonal_element(2, 2, 4.0),
            filter: fifth_order(),
            ..siso()
        };
        let omega = DMatrix::from_row_slice(2, 2, &[0.8, -0.2, 0.2, 1.2]);
        assert_is(unmatched.design().norm(&omega).unwrap(), 0.790884781598942);
    }

    #[test]
    fn bounds_that_let_the_input_gain_lose_its_sign_leave_no_guarantee() {
        let mut robot = chains(&[(-30.0, 0.5), (-40.0, 0.5)], 30.0);
        robot.omega_min = DMatrix::from_row_slice(2, 2, &[0.5, -2.0, -2.0, 0.5]);
        robot.omega_max = DMatrix::from_row_slice(2, 2, &[10.0, 2.0, 2.0, 10.0]);
        let worst = robot.design().worst().unwrap();
        assert_eq!(worst.norm, Bounds::INFINITE);
        assert!(worst.omega.determinant() < 0.0 && worst.every_corner, "{}", worst.omega);
    }

    #[test]
    fn without_a_fast_filter_little_is_gained() {
        // (1/(s + 2)) (1 − 1/(s + 1)): ∫|2e^−2t − e^−t| = 1/2 by hand, which is the norm of 1/(s + 2) alone.
        let mut example = siso();
        (example.A_m, example.B) = (scalar(-2.0), scalar(1.0));
        example.K = scalar(1.0);
        assert_is(example.design().norm(&scalar(1.0)).unwrap(), 0.5);
    }

    #[test]
    fn the_worst_input_gain_is_found_on_its_bounds() {
        let example = siso();
        let worst = example.design().worst().unwrap();
        assert_is(worst.norm, 0.18711177630525086);
        assert_eq!((worst.omega[0], worst.points, worst.every_corner), (0.5, 9, true));
    }

    #[test]
    fn an_unstable_loop_has_an_infinite_norm_at_the_gain_that_makes_it_so() {
        // k/(s (s + 1)(s + 2)) is stable below k = 6 (Routh).
        let mut example = siso();
        example.filter = filter(&[&[1.0, 0.0], &[1.0, 1.0], &[1.0, 2.0]]);
        example.K = scalar(1.0);
        (example.omega_min, example.omega_max) = (scalar(1.0), scalar(5.99));
        assert!(example.design().worst().unwrap().norm.upper.is_finite());
        example.omega_max = scalar(6.01);
        let worst = example.design().worst().unwrap();
        assert_eq!((worst.norm, worst.omega[0]), (Bounds::INFINITE, 6.01));
        assert!(example.design().bandwidth(&scalar(6.01)).is_none());
    }

    #[test]
    fn a_model_that_is_not_stable_is_refused() {
        let mut example = siso();
        example.A_m[(1, 0)] = 1.0;
        assert!(example.design().worst().unwrap_err().to_string().contains("eigenvalues of A_m"));
    }

    #[test]
    fn every_corner_is_tried_up_to_ten_entries() {
        let corners = |m: usize, free: usize| {
            let K = DMatrix::identity(m, m);
            let (low, mut high) = (DMatrix::from_element(m, m, 1.0), DMatrix::from_element(m, m, 1.0));
            (0..free).for_each(|k| high[k] = 2.0);
            let example = Example { K, omega_min: low, omega_max: high, ..siso() };
            let gains = example.design().gains();
            let mut corners: Vec<Vec<u8>> = gains
                .iter()
                .filter(|omega| omega.iter().all(|&entry| entry == 1.0 || entry == 2.0))
                .map(|omega| omega.iter().map(|&entry| entry as u8).collect())
                .collect();
            corners.sort();
            corners.dedup();
            let centred = gains.iter().any(|omega| (0..free).all(|k| omega[k] == 1.5));
            assert!(centred && gains.len() <= (1 << ENTRIES) + 1);
            corners.len()
        };
        for free in 0..=10 {
            assert_eq!(corners(4, free), 1 << free, "{free} entries");
        }
        // Beyond, many different ones.
        assert!(corners(4, 16) > 900, "{}", corners(4, 16));
        assert!(corners(6, 36) > 900, "{}", corners(6, 36));
    }

    #[test]
    fn the_control_follows_up_to_its_bandwidth() {
        let one = siso();
        // ωK/(s + ωK).
        let bandwidth = one.design().bandwidth(&scalar(1.5)).unwrap();
        assert!((bandwidth.slowest - 30.0).abs() < 1e-9 && (bandwidth.fastest - 30.0).abs() < 1e-9, "{bandwidth:?}");
        // Two channels apart: 8 and 40 rad/s.
        let two = Example { K: DMatrix::from_diagonal_element(2, 2, 8.0), ..siso() };
        let omega = DMatrix::from_row_slice(2, 2, &[5.0, 0.0, 0.0, 1.0]);
        let bandwidth = two.design().bandwidth(&omega).unwrap();
        assert!((bandwidth.slowest - 8.0).abs() < 1e-9 && (bandwidth.fastest - 40.0).abs() < 1e-9, "{bandwidth:?}");
        // A filter of fifth order, by python-control's frequency response and scipy.optimize.brentq.
        let high = Example { filter: fifth_order(), ..siso() };
        for (gain, expected) in [(0.1, 2.5377694793235825), (0.25, 9.228656562051807)] {
            let found = high.design().bandwidth(&scalar(gain)).unwrap().slowest;
            assert!((found - expected).abs() < 1e-8 * expected, "{found}, expected {expected}");
        }
    }

    #[test]
    fn constant_uncertainty_is_cancelled_fully() {
        let two = mimo(filter(&[&[1.0, 0.0], &[0.04, 1.0]]));
        let gain = two.design().dc_gain(&two.omega_min).unwrap();
        assert!((gain - DMatrix::<f64>::identity(2, 2)).amax() < 1e-14);
        assert!(two.design().dc_gain(&DMatrix::from_element(2, 2, 1.0)).is_none(), "singular");
    }
}
