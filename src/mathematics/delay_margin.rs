//! The delay at the plant's input that makes a loop unstable.
#![allow(non_snake_case)] // matrices have the names of the field

use std::f64::consts::{PI, TAU};

use nalgebra::linalg::Schur;
use nalgebra::{Complex, DMatrix};

use crate::eigenvalues::complex as eigenvalues;
use crate::mathematics::filter::Filter;

/// Points of the grid of frequencies in a decade.
const PER_DECADE: f64 = 60.0;

/// Decades below the slowest pole, and above the fastest one, to which the grid is widened at most.
const WIDENED: i32 = 8;

/// Sections that narrow a crossing down to rounding, and an extremum to the limit of its flatness.
const BISECTIONS: usize = 44;
const SECTIONS: usize = 40;

/// Distance from 1, as the logarithm of the magnitude, within which extrema between points of the grid count.
const NEAR: f64 = 0.5;

/// Iterations for the eigenvalues of a loop matrix.
const ITERATIONS: usize = 10_000;

/// The loop of an L1 law with its nominal plant x' = A x + B u, ω = I, broken at the plant's input, as the adaptation gets
/// fast: L(s) = (I + K D(s)) (I + K_m (sI − A)⁻¹ B) − I.
///
/// Then η̂ = u + K_m x whatever delays u, as it is what moves the predictor like the plant; so u = −K D(s)(u + K_m x) − K_m x
/// for what comes back of it.
#[derive(Debug, Clone)]
pub struct NominalLoop {
    /// n × n: of the plant, or of the desired dynamics where there is no baseline.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × n, zero where there is no baseline.
    pub K_m: DMatrix<f64>,
    /// m × m.
    pub K: DMatrix<f64>,
    /// D(s).
    pub filter: Filter,
}

/// A frequency at which an eigenvalue of the loop has magnitude 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// rad/s.
    pub frequency: f64,
    /// Phase that may still be lost, rad, within 0 … 2π.
    pub phase: f64,
    /// The delay that takes it, s.
    pub delay: f64,
}

impl NominalLoop {
    /// Crossings of its eigenvalues with magnitude 1. `None` when they can't be found.
    ///
    /// A delay τ in all channels puts a pole onto the imaginary axis where det(I + L(jω) e^(−jωτ)) = 0: where an
    /// eigenvalue of L(jω) has magnitude 1 and ωτ more lag turns it to −1. The least delay of all crossings is the margin of
    /// a loop that is stable without delay; without a crossing it is infinite.
    pub fn crossings(&self) -> Option<Vec<Crossing>> {
        let grid = self.grid()?;
        let values = grid.iter().map(|&w| self.eigenvalues(w)).collect::<Option<Vec<_>>>()?;
        let level = |k: usize, i: usize| values[k][i].norm().ln();
        let mut crossings = Vec::new();
        for i in 0..self.K.nrows() {
            for k in 0..grid.len() - 1 {
                if level(k, i) * level(k + 1, i) <= 0.0 {
                    crossings.push(self.crossing(grid[k], grid[k + 1], i)?);
                } else if k > 0 && self.turns_near_one([k - 1, k, k + 1].map(|k| level(k, i))) {
                    let turn = self.extremum(grid[k - 1], grid[k + 1], i, level(k, i).signum())?;
                    if self.level(turn, i)? * level(k, i) < 0.0 {
                        crossings.push(self.crossing(grid[k - 1], turn, i)?);
                        crossings.push(self.crossing(turn, grid[k + 1], i)?);
                    }
                }
            }
        }
        crossings.sort_by(|a, b| a.delay.total_cmp(&b.delay));
        Some(crossings)
    }

    /// True if the middle of three levels on one side of 0 is nearer to it than both others, and near.
    fn turns_near_one(&self, [before, here, after]: [f64; 3]) -> bool {
        let same_side = before * here > 0.0 && here * after > 0.0;
        same_side && here.abs() <= before.abs().min(after.abs()) && here.abs() < NEAR
    }

    /// Eigenvalues of L(jω), the largest first.
    fn eigenvalues(&self, w: f64) -> Option<Vec<Complex<f64>>> {
        let (n, m) = self.B.shape();
        let s = Complex::new(0.0, w);
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        let identity = DMatrix::<Complex<f64>>::identity(m, m);
        let mut L = &identity + complex(&self.K) * self.filter.at(s);
        if self.K_m.amax() > 0.0 {
            let shifted = DMatrix::identity(n, n) * s - complex(&self.A);
            L *= &identity + complex(&self.K_m) * shifted.lu().solve(&complex(&self.B))?;
        }
        L -= identity;
        let mut found = if m == 1 {
            vec![L[(0, 0)]]
        } else {
            let (_, triangular) = Schur::try_new(L, f64::EPSILON, ITERATIONS)?.unpack();
            triangular.diagonal().iter().copied().collect()
        };
        found.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
        found.iter().all(|value| value.norm() > 0.0 && value.norm().is_finite()).then_some(found)
    }

    fn level(&self, w: f64, i: usize) -> Option<f64> {
        Some(self.eigenvalues(w)?[i].norm().ln())
    }

    /// Frequencies from where all eigenvalues are large to where all are small, with those of the poles.
    fn grid(&self) -> Option<Vec<f64>> {
        let poles =
            [eigenvalues(&self.A)?, eigenvalues(&(&self.A - &self.B * &self.K_m))?, eigenvalues(&self.filter.A_f)?];
        let mut corners: Vec<f64> = poles.iter().flatten().map(|pole| pole.norm()).filter(|w| *w > 0.0).collect();
        corners.push((self.K.amax() * self.filter.C_f.amax()).max(f64::MIN_POSITIVE));
        let (mut low, mut high) = corners.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), &w| (l.min(w), h.max(w)));
        let widen = |from: f64, factor: f64, done: &dyn Fn(f64) -> Option<bool>| {
            let mut at = from * factor;
            for _ in 0..WIDENED {
                if done(at)? {
                    break;
                }
                at *= factor;
            }
            Some(at)
        };
        low = widen(low, 0.1, &|w| Some(self.eigenvalues(w)?.last()?.norm() > 2.0))?;
        high = widen(high, 10.0, &|w| Some(self.eigenvalues(w)?[0].norm() < 0.5))?;
        let points = ((high / low).log10() * PER_DECADE).ceil() as usize;
        let mut grid: Vec<f64> = (0..=points).map(|k| low * (high / low).powf(k as f64 / points as f64)).collect();
        // A lightly damped mode is narrower than the grid.
        grid.extend(corners.iter().flat_map(|w| [0.99, 0.999, 0.9999, 1.0001, 1.001, 1.01].map(|factor| factor * w)));
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        Some(grid)
    }

    fn crossing(&self, mut low: f64, mut high: f64, i: usize) -> Option<Crossing> {
        let begins_above = self.level(low, i)? > 0.0;
        for _ in 0..BISECTIONS {
            let middle = (low * high).sqrt();
            if (self.level(middle, i)? > 0.0) == begins_above { low = middle } else { high = middle }
        }
        let phase = (self.eigenvalues(high)?[i].arg() + PI).rem_euclid(TAU);
        Some(Crossing { frequency: high, phase, delay: phase / high })
    }

    /// Frequency at which a level on this side of 0 is nearest to 0, or beyond it.
    fn extremum(&self, mut low: f64, mut high: f64, i: usize, side: f64) -> Option<f64> {
        for _ in 0..SECTIONS {
            let ratio = (high / low).powf(1.0 / 3.0);
            let (first, second) = (low * ratio, high / ratio);
            if side * self.level(first, i)? < side * self.level(second, i)? { high = second } else { low = first }
        }
        Some((low * high).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mathematics::filter::FilterDescription;

    fn scalar(x: f64) -> DMatrix<f64> {
        DMatrix::from_element(1, 1, x)
    }

    fn integrator() -> Filter {
        Filter::new(&FilterDescription::default()).unwrap()
    }

    #[test]
    fn an_integrating_loop_tolerates_a_quarter_of_a_turn() {
        // K/s: crosses at K with 90° to spare.
        let plain = NominalLoop {
            A: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, -1.4]),
            B: DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
            K_m: DMatrix::zeros(1, 2),
            K: scalar(20.0),
            filter: integrator(),
        };
        let crossings = plain.crossings().unwrap();
        assert_eq!(crossings.len(), 1);
        assert!((crossings[0].frequency - 20.0).abs() < 1e-9 && (crossings[0].phase - PI / 2.0).abs() < 1e-9);
        assert!((crossings[0].delay - PI / 40.0).abs() < 1e-11);
    }

    #[test]
    fn channels_apart_have_the_margin_of_the_faster_one() {
        let two = NominalLoop {
            A: DMatrix::from_diagonal_element(2, 2, -1.0),
            B: DMatrix::identity(2, 2),
            K_m: DMatrix::zeros(2, 2),
            K: DMatrix::from_row_slice(2, 2, &[5.0, 0.0, 0.0, 50.0]),
            filter: integrator(),
        };
        let delays: Vec<_> = two.crossings().unwrap().iter().map(|crossing| crossing.delay).collect();
        assert!((delays[0] - PI / 100.0).abs() < 1e-11 && (delays[1] - PI / 10.0).abs() < 1e-10, "{delays:?}");
    }

    #[test]
    fn a_baseline_takes_its_part_of_the_margin() {
        // x' = u with K_m = k: (1 + K/s)(1 + k/s) − 1 = (s (K + k) + K k)/s². At the margin, by a root of the
        // characteristic equation s² + ((K + k) s + K k) e^(−sτ) = 0 on the imaginary axis: w⁴ = (K + k)² w² + K² k².
        let (K, k) = (20.0_f64, 8.0_f64);
        let one = NominalLoop { A: scalar(0.0), B: scalar(1.0), K_m: scalar(k), K: scalar(K), filter: integrator() };
        let sum = (K + k).powi(2);
        let w = (0.5 * (sum + (sum * sum + 4.0 * (K * k).powi(2)).sqrt())).sqrt();
        let delay = (((K + k) * w).atan2(K * k)) / w;
        let found = one.crossings().unwrap()[0];
        assert!((found.frequency - w).abs() < 1e-9 && (found.delay - delay).abs() < 1e-11, "{found:?}, {w}, {delay}");
    }

    #[test]
    fn a_resonance_narrower_than_the_grid_is_not_missed() {
        // A lightly damped mode of the plant at 100 rad/s, far above the filter's crossing.
        let narrow = NominalLoop {
            A: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1e4, -2e-2]),
            B: DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
            K_m: DMatrix::from_row_slice(1, 2, &[0.0, 0.5]),
            K: scalar(0.1),
            filter: integrator(),
        };
        let near = narrow.crossings().unwrap();
        assert!(near.iter().filter(|crossing| (crossing.frequency - 100.0).abs() < 1.0).count() == 2, "{near:?}");
    }
}
