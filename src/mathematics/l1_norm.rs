//! The L1 norm of a linear system: the largest peak of an output that inputs within ±1 can cause.
#![allow(non_snake_case)] // matrices have the names of the field

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector, RowDVector};

use crate::eigenvalues::complex as eigenvalues;
use crate::error::Invalid;
use crate::mathematics::lyapunov::{gramian, require_hurwitz};
use crate::report::Value;

/// Bound on the truncated rest of an impulse response, relative to the bound at its start.
const TAIL: f64 = 1e-10;

/// Most halvings of the first interval, of length about 1/‖A‖.
const HALVINGS: i32 = 24;

/// Doublings of the first interval after which the rest is left to its bound.
const DOUBLINGS: i32 = 100;

/// Intervals after which refining ends, whatever the distance of the bounds.
const INTERVALS: usize = 200_000;

/// Bounds on a norm, which hold but for rounding.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Bounds {
    /// Not above the norm.
    pub lower: f64,
    /// Not below the norm.
    pub upper: f64,
}

impl Bounds {
    /// The norm of a system that isn't stable.
    pub const INFINITE: Bounds = Bounds { lower: f64::INFINITY, upper: f64::INFINITY };

    /// The larger lower and the larger upper bound: those of the larger norm.
    pub fn max(self, other: Bounds) -> Bounds {
        Bounds { lower: self.lower.max(other.lower), upper: self.upper.max(other.upper) }
    }

    /// Times a positive number.
    pub fn times(self, factor: f64) -> Bounds {
        Bounds { lower: self.lower * factor, upper: self.upper * factor }
    }

    /// Bounds of a sum.
    pub fn plus(self, other: Bounds) -> Bounds {
        Bounds { lower: self.lower + other.lower, upper: self.upper + other.upper }
    }
}

impl From<Bounds> for Value {
    fn from(Bounds { lower, upper }: Bounds) -> Self {
        // A sum of both is a number only where both are.
        let both = lower + upper;
        if both.is_finite() { Value::Between { lower, upper } } else { both.into() }
    }
}

/// L1 norms, and the impulse responses integrated for them: systems of many channels have few that differ.
#[derive(Debug)]
pub struct L1Norms {
    /// Relative distance of the two bounds of an impulse response's integral at which refining ends.
    tolerance: f64,
    integrated: HashMap<Vec<u64>, Bounds>,
}

impl L1Norms {
    /// With bounds as close as this, relative.
    pub fn within(tolerance: f64) -> Self {
        L1Norms { tolerance, integrated: HashMap::new() }
    }

    /// ‖C (sI − A)⁻¹ B‖ in the L1 sense: the integral of the magnitude of each impulse response, summed over the inputs,
    /// the largest over the outputs.
    ///
    /// # Errors
    /// [`Invalid`] when A isn't Hurwitz, or too badly scaled for this precision.
    pub fn of(&mut self, A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> Result<Bounds, Invalid> {
        let mut norm = Bounds { lower: 0.0, upper: 0.0 };
        if B.is_empty() {
            return Ok(norm);
        }
        require_hurwitz("A", A)?;
        let reached: Vec<_> = B.column_iter().map(|b| spread(A, b.iter(), |i, j| A[(i, j)] != 0.0)).collect();
        for c in C.row_iter() {
            let seen = spread(A, c.iter(), |i, j| A[(j, i)] != 0.0);
            let mut row = Bounds { lower: 0.0, upper: 0.0 };
            for (b, reached) in B.column_iter().zip(&reached) {
                // Only states between input and output count, so that decoupled channels are integrated separately.
                let between: Vec<_> = (0..A.nrows()).filter(|&i| reached[i] && seen[i]).collect();
                row = row.plus(self.entry(A, &b.into_owned(), &c.into_owned(), &between)?);
            }
            norm = norm.max(row);
        }
        Ok(norm)
    }

    /// Integral of |g(t)|, g(t) = c e^(At) b, over all t ≥ 0, which only these states take part in.
    fn entry(
        &mut self,
        A: &DMatrix<f64>,
        b: &DVector<f64>,
        c: &RowDVector<f64>,
        between: &[usize],
    ) -> Result<Bounds, Invalid> {
        if between.is_empty() {
            return Ok(Bounds { lower: 0.0, upper: 0.0 });
        }
        let A = A.select_rows(between).select_columns(between);
        let (b, c) = (b.select_rows(between), c.select_columns(between));
        let key = A.iter().chain(b.iter()).chain(c.iter()).map(|entry| entry.to_bits()).collect();
        if let Some(&known) = self.integrated.get(&key) {
            return Ok(known);
        }
        let tail = Tail::of(&A, &c)
            .ok_or_else(|| Invalid::because("an L1 norm: the system is too badly scaled for double precision"))?;
        let integral = Response::new(&A, b, &c, &tail).integral(self.tolerance);
        self.integrated.insert(key, integral);
        Ok(integral)
    }
}

/// States that an input reaches, or an output sees: those with an entry of its own, and all that these act on.
fn spread<'a>(A: &DMatrix<f64>, own: impl Iterator<Item = &'a f64>, acts: impl Fn(usize, usize) -> bool) -> Vec<bool> {
    let mut marked: Vec<bool> = own.map(|&entry| entry != 0.0).collect();
    let mut ahead: Vec<usize> = (0..A.nrows()).filter(|&i| marked[i]).collect();
    while let Some(j) = ahead.pop() {
        for (i, marked) in marked.iter_mut().enumerate() {
            if !*marked && acts(i, j) {
                *marked = true;
                ahead.push(i);
            }
        }
    }
    marked
}

/// Bound on what follows a state x: ∫|g| ≤ √(∫e^(−2αt) ∫e^(2αt) g²) = √(xᵀ W x / 2α), for α within the stability
/// margin.
struct Tail {
    alpha: f64,
    W: DMatrix<f64>,
}

impl Tail {
    fn of(A: &DMatrix<f64>, c: &RowDVector<f64>) -> Option<Self> {
        let margin = eigenvalues(A)?.iter().map(|lambda| -lambda.re).fold(f64::INFINITY, f64::min);
        let alpha = margin / 2.0;
        let shifted = A + DMatrix::identity(A.nrows(), A.nrows()) * alpha;
        Some(Tail { alpha, W: gramian(&shifted, &(c.transpose() * c))? })
    }

    fn after(&self, x: &DVector<f64>) -> f64 {
        (quadratic(&self.W, x) / (2.0 * self.alpha)).sqrt()
    }
}

fn quadratic(W: &DMatrix<f64>, x: &DVector<f64>) -> f64 {
    // Rounding may leave a semidefinite form below zero.
    x.dot(&(W * x)).max(0.0)
}

/// An exact step of length h: x(h) = e^(Ah) x, ∫g = r x, ∫g'² = xᵀ W x.
struct Step {
    h: f64,
    transition: DMatrix<f64>,
    integral: RowDVector<f64>,
    variation: DMatrix<f64>,
}

impl Step {
    /// Uses a Taylor series, for h ‖A‖ ≤ 1/2.
    fn short(A: &DMatrix<f64>, c: &RowDVector<f64>, h: f64) -> Self {
        let n = A.nrows();
        let g_rate = c * A;
        let (mut power, mut row, mut form) = (DMatrix::identity(n, n), c * h, g_rate.transpose() * &g_rate * h);
        let mut step = Step { h, transition: power.clone(), integral: row.clone(), variation: form.clone() };
        for k in 1..=25 {
            let k = f64::from(k);
            power = &power * A * (h / k);
            row = &row * A * (h / (k + 1.0));
            form = (A.transpose() * &form + &form * A) * (h / (k + 1.0));
            step.transition += &power;
            step.integral += &row;
            step.variation += &form;
        }
        step
    }

    fn doubled(&self) -> Self {
        let E = &self.transition;
        Step {
            h: 2.0 * self.h,
            transition: E * E,
            integral: &self.integral + &self.integral * E,
            variation: &self.variation + E.transpose() * &self.variation * E,
        }
    }
}

/// A stretch of the impulse response, from the state x on.
struct Interval {
    /// Its length is 2 to this power times that of the first interval.
    level: i32,
    x: DVector<f64>,
    bounds: Bounds,
}

impl Interval {
    fn gap(&self) -> f64 {
        self.bounds.upper - self.bounds.lower
    }

    fn divisible(&self) -> bool {
        self.gap() > 0.0 && self.level > -HALVINGS
    }
}

/// An impulse response in intervals, on which its integral is known exactly where it surely keeps its sign and
/// bounded elsewhere; those are halved until the bounds are close.
struct Response<'a> {
    A: &'a DMatrix<f64>,
    c: &'a RowDVector<f64>,
    /// Steps of levels 0, 1, 2, …
    long: Vec<Step>,
    /// Steps of levels −1, −2, …, as far as needed.
    short: Vec<Step>,
    intervals: Vec<Interval>,
    tail: f64,
}

impl<'a> Response<'a> {
    /// Intervals [0, h], [h, 2h], [2h, 4h], … until the rest is negligible.
    fn new(A: &'a DMatrix<f64>, b: DVector<f64>, c: &'a RowDVector<f64>, tail: &Tail) -> Self {
        let first = Step::short(A, c, 0.5 / A.norm());
        let mut response = Response { A, c, long: vec![first], short: vec![], intervals: vec![], tail: 0.0 };
        let negligible = TAIL * tail.after(&b);
        let mut x = response.push(0, b);
        for level in 0..DOUBLINGS {
            response.tail = tail.after(&x);
            if response.tail <= negligible {
                break;
            }
            x = response.push(level, x);
            let longer = response.step(level).doubled();
            response.long.push(longer);
        }
        response
    }

    fn step(&mut self, level: i32) -> &Step {
        let below = usize::try_from(-level).unwrap_or(0);
        while self.short.len() < below {
            let h = self.short.last().map_or(self.long[0].h, |shorter| shorter.h) / 2.0;
            self.short.push(Step::short(self.A, self.c, h));
        }
        if below > 0 { &self.short[below - 1] } else { &self.long[level as usize] }
    }

    /// Appends the interval that starts at x; gives the state at its end.
    ///
    /// By Cauchy and Schwarz, g changes by no more than √(h ∫g'²) within the interval.
    fn push(&mut self, level: i32, x: DVector<f64>) -> DVector<f64> {
        let start = (self.c * &x)[0].abs();
        let step = self.step(level);
        let change = (step.h * quadratic(&step.variation, &x)).sqrt();
        let lower = (&step.integral * &x)[0].abs();
        let upper = if start >= change { lower } else { lower.max(step.h * (start + change)) };
        let end = &step.transition * &x;
        self.intervals.push(Interval { level, x, bounds: Bounds { lower, upper } });
        end
    }

    fn integral(mut self, tolerance: f64) -> Bounds {
        loop {
            let sum = self.intervals.iter().fold(Bounds { lower: 0.0, upper: self.tail }, |sum, i| sum.plus(i.bounds));
            let allowed = tolerance * sum.lower;
            let open = self.intervals.iter().filter(|interval| interval.divisible()).count();
            if open == 0 || sum.upper - sum.lower - self.tail <= allowed || self.intervals.len() > INTERVALS {
                return sum;
            }
            let worth_halving = allowed / (2 * open) as f64;
            for interval in std::mem::take(&mut self.intervals) {
                if interval.divisible() && interval.gap() > worth_halving {
                    let middle = self.push(interval.level - 1, interval.x);
                    self.push(interval.level - 1, middle);
                } else {
                    self.intervals.push(interval);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn norm(A: &[f64], B: &[f64], C: &[f64]) -> Bounds {
        let n = (A.len() as f64).sqrt() as usize;
        let A = DMatrix::from_row_slice(n, n, A);
        let B = DMatrix::from_row_slice(n, B.len() / n, B);
        L1Norms::within(1e-7).of(&A, &B, &DMatrix::from_row_slice(C.len() / n, n, C)).unwrap()
    }

    /// Both bounds at the true value, and in their order.
    #[track_caller]
    fn assert_is(found: Bounds, expected: f64, tolerance: f64) {
        let close = |bound: f64| (bound - expected).abs() <= tolerance * expected;
        assert!(close(found.lower) && close(found.upper), "{found:?}, expected {expected}");
        assert!(found.lower <= found.upper && found.lower <= expected * (1.0 + 1e-12), "{found:?}");
        assert!(found.upper >= expected * (1.0 - 1e-12), "{found:?}");
    }

    #[test]
    fn a_lag_has_the_norm_of_its_static_gain() {
        for a in [1e-6, 0.3, 1.0, 7e5] {
            assert_is(norm(&[-a], &[1.0], &[1.0]), 1.0 / a, 1e-9);
        }
        // Lags in a row never change sign either: 1/((s + 1)(s + 1e4)).
        assert_is(norm(&[-1.0, 1.0, 0.0, -1e4], &[0.0, 1.0], &[1.0, 0.0]), 1e-4, 2e-7);
    }

    #[test]
    fn an_oscillator_has_the_norm_of_its_closed_form() {
        // 1/(s² + 2ζω s + ω²): coth(πζ / (2√(1 − ζ²))) / ω².
        for (zeta, omega) in [(0.1_f64, 3.0_f64), (0.7, 2.0), (0.5, 4e3), (0.002, 1.0)] {
            let A = [0.0, 1.0, -omega * omega, -2.0 * zeta * omega];
            let exponent = std::f64::consts::FRAC_PI_2 * zeta / (1.0 - zeta * zeta).sqrt();
            assert_is(norm(&A, &[0.0, 1.0], &[1.0, 0.0]), 1.0 / (exponent.tanh() * omega * omega), 2e-7);
        }
    }

    #[test]
    fn a_response_that_changes_its_sign_once_is_split_there() {
        // s/((s + 1)(s + 2)): 2 e^−2t − e^−t is zero at ln 2; the integral is 1/4 + 1/4 by hand.
        assert_is(norm(&[0.0, 1.0, -2.0, -3.0], &[0.0, 1.0], &[0.0, 1.0]), 0.5, 2e-7);
        // The same with rates 1 and 1e6, from near rest: e^−at a/(a − b) − e^−bt b/(a − b).
        let (a, b) = (1e6_f64, 1.0);
        let zero = (a / b).ln() / (a - b);
        let position = ((-b * zero).exp() - (-a * zero).exp()) / (a - b);
        assert_is(norm(&[0.0, 1.0, -a * b, -a - b], &[0.0, 1.0], &[0.0, 1.0]), 2.0 * position, 2e-7);
    }

    #[test]
    fn rows_are_summed_and_the_largest_counts() {
        let A = [-1.0, 0.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.0, -5.0];
        let B = [2.0, 0.0, 0.0, -4.0, 0.0, 1.0];
        let C = [1.0, 0.0, 1.0, 1.0, 1.0, 0.0];
        // Outputs: x1 + x3 (2 and 1/5), x1 + x2 (2 and 1).
        assert_is(norm(&A, &B, &C), 3.0, 1e-9);
        assert_is(norm(&A, &B, &[0.0, 0.0, 1.0]), 0.2, 1e-9);
        assert_eq!(norm(&[-1.0, 0.0, 0.0, -4.0], &[1.0, 0.0], &[0.0, 1.0]), Bounds { lower: 0.0, upper: 0.0 });
    }

    #[test]
    fn a_system_that_is_not_stable_has_no_norm() {
        let A = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, 0.0]);
        let message =
            L1Norms::within(1e-7).of(&A, &DMatrix::identity(2, 2), &DMatrix::identity(2, 2)).unwrap_err().to_string();
        assert!(message.contains("eigenvalues of A") && message.contains("Hurwitz"), "{message}");
    }

    #[test]
    fn a_report_shows_both_bounds_or_states_that_there_are_none() {
        assert_eq!(Value::from(Bounds { lower: 0.1, upper: 0.2 }), Value::Between { lower: 0.1, upper: 0.2 });
        assert_eq!(Value::from(Bounds::INFINITE).lines(), ["infinite"]);
        assert_eq!(Value::from(Bounds { lower: f64::NAN, upper: 1.0 }).lines(), ["not a number"]);
    }
}
