//! Frequency responses, and the frequencies at which they are looked at.
#![allow(non_snake_case)] // matrices have the names of the field

use std::f64::consts::PI;

use nalgebra::{Complex, DMatrix};

/// Points in a decade.
const PER_DECADE: f64 = 40.0;
/// Decades below the slowest and above the fastest of W, poles and zeros.
const BELOW: f64 = 1e-3;
const ABOVE: f64 = 100.0;
/// Poles and zeros below this part of the fastest one are at rest.
const NEGLIGIBLE: f64 = 1e-6;
/// Frequencies for a mode a ± b j: |b + k|a||.
const ABOUT_MODES: [f64; 13] = [-3.0, -2.0, -1.3, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.3, 2.0, 3.0];
/// Points for a dead time τ, from 0.01/τ to 30/τ.
const FOR_DELAY: usize = 150;

/// Points a sixteenth of a turn of the dead time apart: 25 turns.
const TURNS: i32 = 400;

/// C (s − A)⁻¹ B with a dead time at each input.
#[derive(Debug, Clone)]
pub struct Response {
    A: DMatrix<Complex<f64>>,
    B: DMatrix<Complex<f64>>,
    C: DMatrix<Complex<f64>>,
    delay: Vec<f64>,
}

impl Response {
    /// That of a plant.
    pub fn new(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>, delay: &[f64]) -> Self {
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        Response { A: complex(A), B: complex(B), C: complex(C), delay: delay.to_vec() }
    }

    /// At s = j ω; infinite at a pole.
    pub fn at(&self, omega: f64) -> DMatrix<Complex<f64>> {
        let s = Complex::new(0.0, omega);
        let shifted =
            DMatrix::from_fn(
                self.A.nrows(),
                self.A.ncols(),
                |i, j| {
                    if i == j { s - self.A[(i, j)] } else { -self.A[(i, j)] }
                },
            );
        let Some(states) = shifted.lu().solve(&self.B) else {
            let infinite = Complex::new(f64::INFINITY, 0.0);
            return DMatrix::from_element(self.C.nrows(), self.B.ncols(), infinite);
        };
        let mut response = &self.C * states;
        for (mut column, delay) in response.column_iter_mut().zip(&self.delay) {
            column *= Complex::from_polar(1.0, -omega * delay);
        }
        response
    }
}

/// The frequencies at which a loop with these poles and zeros is looked at, in W, ascending.
pub fn grid(poles: &[Complex<f64>], zeros: &[Complex<f64>], delay: &[f64]) -> Vec<f64> {
    let all = || poles.iter().chain(zeros);
    let fastest = all().map(|value| value.norm()).fold(1.0, f64::max);
    let counted = all().map(|value| value.norm()).filter(|&size| size > NEGLIGIBLE * fastest);
    let slowest = counted.fold(1.0, f64::min);
    let mut frequencies = logarithmic(BELOW * slowest, ABOVE * fastest, 0);
    for value in all().filter(|value| value.im > 0.0) {
        frequencies.extend(ABOUT_MODES.map(|k| (value.im + k * value.re.abs()).abs()));
    }
    for &delay in delay.iter().filter(|&&delay| delay > 0.0) {
        frequencies.extend(logarithmic(0.01 / delay, 30.0 / delay, FOR_DELAY));
        // Beyond, e^(−j ω τ) turns once in 2 π/τ: sixteen points a turn.
        frequencies.extend((10..TURNS).map(|k| f64::from(k) * PI / 8.0 / delay));
    }
    frequencies.retain(|&omega| omega > 0.0);
    frequencies.sort_by(f64::total_cmp);
    frequencies.dedup();
    frequencies
}

/// Points from one number to another, both included; 40 a decade if no number is asked for.
pub fn logarithmic(from: f64, to: f64, points: usize) -> Vec<f64> {
    let decades = (to / from).log10();
    let last = if points > 0 { points - 1 } else { (decades * PER_DECADE).ceil() as usize };
    (0..=last).map(|k| from * 10_f64.powf(decades * k as f64 / last.max(1) as f64)).collect()
}
