//! Prescribed performance: functions of time that bound an error, and the error transformed so that it has no bounds.
//!
//! C. P. Bechlioulis and G. A. Rovithakis, Robust adaptive control of feedback linearizable MIMO nonlinear systems with
//! prescribed performance, IEEE Trans. Automatic Control 53 (2008) 2090–2099; chapters 5 and 6 of the thesis, where the
//! transformation is printed of ρ/e in place of e/ρ.
#![allow(non_snake_case)] // R is the thesis' name

use nalgebra::DMatrix;

use crate::report::DesignReport;
use crate::system::{Parameter, Scalar, Values, VectorOf};

/// A performance function ρ(t) = (ρ_0 − ρ_∞) e^(−l t) + ρ_∞ at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Performance<T> {
    /// ρ
    pub rho: T,
    /// ρ'
    pub rate: T,
    /// ρ''
    pub second_rate: T,
}

impl<T: Scalar> Performance<T> {
    /// At the time t after it was ρ_0.
    pub fn at(t: T, rho_0: T, rho_inf: T, decay_rate: T) -> Self {
        let above = (rho_0 - rho_inf) * (-decay_rate * t).exp();
        let rate = -decay_rate * above;
        Performance { rho: above + rho_inf, rate, second_rate: -decay_rate * rate }
    }
}

/// Reports the funnels of all channels: ρ_0, ρ_∞ and l.
pub fn report(parameters: [VectorOf<Parameter>; 3], v: &Values<f64>, report: &mut DesignReport) {
    let [rho_0, rho_inf, decay_rate] = parameters.map(|parameter| &v[parameter]);
    let names = parameters.map(|parameter| v.name(parameter));
    let row = |values: &dyn Fn(usize) -> f64| DMatrix::from_fn(1, rho_0.len(), |_, i| values(i));
    report.add(&names[0], &row(&|i| rho_0[i]), "", "bound of each error at the start, in the error's own unit");
    report.add(&names[1], &row(&|i| rho_inf[i]), "", "final bound");
    report.add(&names[2], &row(&|i| decay_rate[i]), "1/s", "");
    let steepest = row(&|i| decay_rate[i] * (rho_0[i] - rho_inf[i]));
    report.add("steepest slope", &steepest, "", "at the start: an error that decays more slowly leaves the funnel");
    let narrow = |i: usize| ((rho_0[i] - rho_inf[i]) / (NARROW * rho_inf[i])).max(1.0).ln() / decay_rate[i];
    let slowest = (0..rho_0.len()).map(narrow).fold(0.0, f64::max);
    report.add("narrow from", slowest, "s", &format!("all bounds are within 5 % of {}", names[1]));
}

/// Part of ρ_∞ within which a funnel counts as narrow.
const NARROW: f64 = 0.05;

/// An error within a bound ρ, by the transformed error ε: functions of that, and their derivatives to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transformed<T> {
    /// z = S(ε)
    pub z: T,
    /// dz/dε
    pub dz: T,
    /// R = 1/(ρ S'(ε))
    pub R: T,
    /// dR/dε
    pub dR: T,
}

/// Beyond this ε the transformation is flat in every digit.
const FLAT: f64 = 300.0;

/// Beyond this ε, R is computed without a reciprocal.
const FAR: f64 = 100.0;

/// Bounds −δ_lo < z < δ_up of the error in parts of ρ, z = e/ρ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<T> {
    /// δ_lo
    pub lower: T,
    /// δ_up
    pub upper: T,
}

impl<T: Scalar> Bounds<T> {
    /// True if z is between them.
    pub fn hold(&self, z: T) -> T::Flag {
        z.above(-self.lower) & z.below(self.upper)
    }

    /// Distance of z from the nearer one; negative outside.
    pub fn margin(&self, z: T) -> T {
        let (below, above) = (z + self.lower, self.upper - z);
        T::select(below.below(above), below, above)
    }

    /// ε(z) = ½ ln((δ_lo + z)/(δ_up − z)), the transformed error; no number outside.
    pub fn transformed(&self, z: T) -> T {
        let Bounds { lower, upper } = *self;
        let zero = T::from(0.0);
        // Where z is tiny, as sharp as z itself.
        let sharp = || ((z / lower).ln_1p() - (-z / upper).ln_1p() + (lower / upper).ln()) * 0.5;
        T::branch(lower.above(zero) & upper.above(zero), sharp, || ((z + lower) / (upper - z)).ln() * 0.5)
    }

    /// dε/dz = ½ (1/(δ_lo + z) + 1/(δ_up − z))
    pub fn slope(&self, z: T) -> T {
        ((z + self.lower).recip() + (self.upper - z).recip()) * 0.5
    }

    /// d²ε/dz²
    pub fn second_slope(&self, z: T) -> T {
        ((self.upper - z).powi(-2) - (z + self.lower).powi(-2)) * 0.5
    }

    /// z = S(ε), the inverse of [`Bounds::transformed`].
    pub fn inverse(&self, epsilon: T) -> T {
        // With the exponential that is at most 1, so that nothing overflows.
        let above = || {
            let small = (-epsilon * 2.0).exp();
            (self.upper - self.lower * small) / (small + 1.0)
        };
        let below = || {
            let small = (epsilon * 2.0).exp();
            (self.upper * small - self.lower) / (small + 1.0)
        };
        T::branch(epsilon.at_least(T::from(0.0)), above, below)
    }

    /// Values that belong to ε within the bound ρ.
    pub fn at(&self, epsilon: T, rho: T) -> Transformed<T> {
        let (zero, sign) = (T::from(0.0), epsilon.signum());
        let is_flat = epsilon.abs().above(T::from(FLAT));
        let limited = T::select(is_flat, sign * FLAT, epsilon);
        let small = (-limited.abs() * 2.0).exp();
        let slope = small * ((self.lower + self.upper) * 2.0) / (small + 1.0).powi(2);
        // The derivative of a reciprocal has the square of what it is of, which would be 0 far out.
        let far = || (limited.abs() * 2.0).exp() * (small + 1.0).powi(2) / ((self.lower + self.upper) * 2.0 * rho);
        let R = T::branch(limited.abs().above(T::from(FAR)), far, || (slope * rho).recip());
        // With tanh ε: the slope's derivative is −2 tanh ε of it.
        let steeper = || R * sign * ((-small + 1.0) / (small + 1.0)) * 2.0;
        Transformed {
            z: self.inverse(limited),
            dz: T::select(is_flat, zero, slope),
            R,
            dR: T::branch(is_flat, || zero, steeper),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{Recorded, slopes};

    /// Bounds as numbers of a recording.
    fn recorded(lower: f64, upper: f64) -> Bounds<Recorded> {
        Bounds { lower: lower.into(), upper: upper.into() }
    }

    const BOUNDS: [(f64, f64); 4] = [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.3, 1.0)];

    #[test]
    fn the_transformation_takes_the_funnel_to_all_numbers_and_back() {
        for (lower, upper) in BOUNDS {
            let bounds = Bounds { lower, upper };
            for part in [1e-6_f64, 0.1, 0.5, 0.77, 1.0 - 1e-6] {
                let z = -lower + part * (lower + upper);
                let epsilon = bounds.transformed(z);
                assert!((bounds.inverse(epsilon) - z).abs() < 1e-12, "{bounds:?}: {z} became {epsilon}");
                assert!((epsilon - 0.5 * (part / (1.0 - part)).ln()).abs() < 1e-9);
            }
            assert!((bounds.inverse(-800.0) + lower).abs() < 1e-300 && bounds.inverse(800.0) == upper);
            assert!(!bounds.transformed(upper + 0.1).is_finite() && !bounds.transformed(-lower).is_finite());
        }
    }

    #[test]
    fn the_inverse_has_the_slope_of_the_inverse_everywhere() {
        for epsilon in [-3.0, -1e-9, 0.0, 1e-9, 0.4] {
            let [(z, slope)] = slopes(|epsilon| [recorded(0.3, 1.0).inverse(epsilon)], epsilon);
            let of = Bounds { lower: 0.3, upper: 1.0 }.slope(z);
            assert!((slope * of - 1.0).abs() < 1e-12, "at {epsilon}: {slope}");
        }
    }

    #[test]
    fn what_belongs_to_a_transformed_error_has_the_derivatives_of_the_equations() {
        for (lower, upper) in BOUNDS {
            let functions = |epsilon| {
                let at = recorded(lower, upper).at(epsilon, 0.3.into());
                [at.z, at.dz, at.R, at.dR]
            };
            for epsilon in [-299.0, -180.0, -100.0, -20.0, -1.0, -0.003, 1e-9, 0.02, 0.7, 5.0, 101.0, 250.0] {
                let [z, dz, R, dR] = slopes(functions, epsilon);
                for ((value, exact), (slope, _)) in [(z, dz), (R, dR)] {
                    let size = slope.abs() + 1e-3 * value.abs();
                    assert!((exact - slope).abs() <= 1e-12 * size, "at {epsilon}: {slope}");
                }
            }
        }
    }

    #[test]
    fn where_the_transformation_is_flat_all_that_belongs_to_it_stays_as_it_is() {
        let bounds = Bounds { lower: 1.0, upper: 1.0 };
        let (edge, beyond) = (bounds.at(300.0, 0.3), bounds.at(1e9, 0.3));
        assert_eq!((beyond.z, beyond.R, beyond.dz, beyond.dR), (edge.z, edge.R, 0.0, 0.0));
        assert!(beyond.R.is_finite() && bounds.at(-1e9, 0.3).z == -beyond.z);
        let slopes = slopes(|epsilon| [recorded(1.0, 1.0).at(epsilon, 0.3.into()).R], 500.0);
        assert_eq!(slopes, [(beyond.R, 0.0)], "a derivative that is a number");
        let near = [100.0_f64, 100.0 * (1.0 + f64::EPSILON)].map(|epsilon| bounds.at(epsilon, 0.3).R);
        assert!((near[1] / near[0] - 1.0).abs() < 1e-12, "{near:?}");
    }

    #[test]
    fn a_tiny_error_keeps_its_digits() {
        let bounds = Bounds { lower: 1.0, upper: 1.0 };
        let z = 1.234_567_89e-12_f64;
        assert!((bounds.transformed(z) / z - 1.0).abs() < 1e-14);
    }

    #[test]
    fn slopes_are_derivatives() {
        for (lower, upper) in BOUNDS {
            let bounds = Bounds { lower, upper };
            let z = -lower + 0.3 * (lower + upper);
            let of = |z| [recorded(lower, upper).transformed(z), recorded(lower, upper).slope(z)];
            let [(_, first), (_, second)] = slopes(of, z);
            assert!((first / bounds.slope(z) - 1.0).abs() < 1e-13);
            assert!((second - bounds.second_slope(z)).abs() < 1e-12 * second.abs());
        }
    }

    #[test]
    fn a_performance_function_falls_from_its_start_to_its_end() {
        let at = |t| Performance::at(t, 1.1, 0.005, 2.0);
        assert_eq!((at(0.0).rho, at(1e9).rho), (1.1, 0.005));
        let of = |t| [Performance::at(t, 1.1.into(), 0.005.into(), 2.0.into()).rho];
        let [(rho, rate)] = slopes(of, 0.7);
        assert!((rho - at(0.7).rho).abs() < 1e-15 && (rate - at(0.7).rate).abs() < 1e-15);
        assert!((at(0.7).second_rate - 4.0 * 1.095 * (-1.4_f64).exp()).abs() < 1e-14);
    }
}
