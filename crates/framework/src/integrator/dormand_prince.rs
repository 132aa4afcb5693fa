//! The explicit Runge–Kutta method of order 5 with an embedded one of order 4.
//!
//! Dormand and Prince, A family of embedded Runge–Kutta formulae, J. Comput. Appl. Math. 6 (1980) 19–26, table 2.
//!
//! Where a rate has a kink (an absolute value, a limit, a projection), both solutions are wrong in almost the same way:
//! their difference is much less than the error, and at some places of the kink in a step it is nothing. So a step
//! whose difference is not far below what is tolerated must agree with Simpson's rule as well, which takes one more
//! evaluation, in the middle, where the state is known from the stages (Shampine, Some practical Runge–Kutta formulas,
//! Math. Comp. 46 (1986) 135–150). With it, an error above ten times the tolerance remains at few places
//! (`crates/framework/tests/equations/integration.rs` counts them). Smooth rates agree with it within about that difference, so that they take no
//! shorter steps for it.

use std::ops::Range;

use nalgebra::Complex;

use super::dense::hermite;
use super::tableau::{A2, A3, A4, A5, A6, A7, E, STAGES};
use super::{Coefficients, OneStepMethod, Problem, Start, Tolerance};
use crate::system::{ErrorEstimate, Section, Variables};

/// Weights of the stages in the solution of order 4 in the middle of a step.
const MIDDLE: [f64; STAGES] = [
    6025192743.0 / 60171106304.0,
    0.0,
    51252292925.0 / 130801643196.0,
    -2691868925.0 / 90256659456.0,
    187940372067.0 / 3189068634112.0,
    -1776094331.0 / 39487288512.0,
    11237099.0 / 470086768.0,
];
/// Weights of the stages in c₄ of the polynomial of order 4 between the ends (Shampine).
const BETWEEN: [f64; STAGES] = [
    -12715105075.0 / 11282082432.0,
    0.0,
    87487479700.0 / 32700410799.0,
    -10690763975.0 / 1880347072.0,
    701980252875.0 / 199316789632.0,
    -1453857185.0 / 822651844.0,
    69997945.0 / 29380423.0,
];
/// Scaled error below which kinks are not looked for: what a kink hides is tolerated too.
const CLOSE: f64 = 1e-3;
/// Ratio of the disagreement with Simpson's rule to the error of a step with a kink, about.
const DISAGREEMENT: f64 = 2.0;

/// Factor by which one substep multiplies the solution of x' = λ x, for z = λh.
pub fn stability(z: Complex<f64>) -> Complex<f64> {
    let coefficients = [1.0 / 600.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    coefficients.iter().fold(Complex::new(0.0, 0.0), |sum, &coefficient| sum * z + coefficient)
}

/// The method's workspace.
#[derive(Debug)]
pub struct DormandPrince {
    /// Derivatives at the stages, one row a state: what is summed lies together.
    k: Vec<[f64; STAGES]>,
    /// Values of an evaluation at a step's end.
    end: Vec<f64>,
    errors: Vec<f64>,
}

impl DormandPrince {
    /// A workspace for a system.
    pub fn new(variables: &Variables) -> Self {
        let n = variables.states();
        let end = vec![0.0; evaluated(variables).len()];
        DormandPrince { k: vec![[0.0; STAGES]; n], end, errors: vec![0.0; n] }
    }

    /// Takes over the derivatives of stage N, which the problem holds, and evaluates stage N + 1 at node c. (N is known
    /// when compiling, so that the sums are unrolled.)
    fn stage<const N: usize>(&mut self, problem: &mut Problem, start: &Start, h: f64, c: f64, weights: &[f64; N]) {
        let (states, rates) = problem.states_and_rates();
        for (((x, x0), k), &rate) in states.iter_mut().zip(&start.states).zip(&mut self.k).zip(rates) {
            *x = x0 + h * sum(weights, k, rate);
            k[N - 1] = rate;
        }
        problem.evaluate(start.time + c * h);
    }

    /// Error according to Simpson's rule, right after the last stage, and the state that has it.
    fn against_simpson(&mut self, problem: &mut Problem, start: &Start, h: f64, tolerance: Tolerance) -> (f64, usize) {
        let evaluated = evaluated(problem.variables);
        self.end.copy_from_slice(&problem.reals[evaluated.clone()]);
        let (states, rates) = problem.states_and_rates();
        for (((x, x0), k), &rate) in states.iter_mut().zip(&start.states).zip(&mut self.k).zip(rates) {
            *x = x0 + h * sum(&MIDDLE, k, rate);
            k[STAGES - 1] = rate;
        }
        problem.evaluate(start.time + 0.5 * h);
        let first = problem.variables.reals(Section::State).start - evaluated.start;
        let end = &self.end[first..][..start.states.len()];
        let parts = start.states.iter().zip(end).zip(&self.k).zip(problem.rates());
        let errors = parts.map(|(((x0, x1), k), middle)| {
            let simpson = h / 6.0 * (k[0] + 4.0 * middle + k[STAGES - 1]);
            (x1 - x0 - simpson) / DISAGREEMENT
        });
        let seen = tolerance.scaled(errors, &start.states, end);
        problem.reals[evaluated].copy_from_slice(&self.end);
        seen
    }
}

/// Everything that an evaluation writes, with the states between.
fn evaluated(variables: &Variables) -> Range<usize> {
    variables.reals(Section::Input).start..variables.reals(Section::Derivative).end
}

/// Weighted sum of N stages, of which the last is `newest`: it is added last, since the others are known before it.
#[inline]
pub(super) fn sum<const N: usize, const STORED: usize>(weights: &[f64; N], k: &[f64; STORED], newest: f64) -> f64 {
    let mut sum = 0.0;
    for j in 0..N - 1 {
        sum += weights[j] * k[j];
    }
    sum + weights[N - 1] * newest
}

impl OneStepMethod for DormandPrince {
    fn attempt(
        &mut self,
        problem: &mut Problem,
        start: &Start,
        h: f64,
        tolerance: Tolerance,
    ) -> (ErrorEstimate, usize) {
        problem.rates_mut().copy_from_slice(&start.rates);
        self.stage(problem, start, h, 1.0 / 5.0, &A2);
        self.stage(problem, start, h, 3.0 / 10.0, &A3);
        self.stage(problem, start, h, 4.0 / 5.0, &A4);
        self.stage(problem, start, h, 8.0 / 9.0, &A5);
        self.stage(problem, start, h, 1.0, &A6);
        self.stage(problem, start, h, 1.0, &A7);
        let (states, rates) = problem.states_and_rates();
        for ((error, k), &rate) in self.errors.iter_mut().zip(&self.k).zip(rates) {
            *error = h * sum(&E, k, rate);
        }
        let (mut scaled, mut state) = tolerance.scaled(self.errors.iter().copied(), &start.states, states);
        if (CLOSE..=1.0).contains(&scaled) {
            let seen = self.against_simpson(problem, start, h, tolerance);
            if seen.0 > scaled || seen.0.is_nan() {
                (scaled, state) = seen;
            }
        }
        (ErrorEstimate { scaled, order: 5 }, state)
    }

    fn errors(&self) -> &[f64] {
        &self.errors
    }

    fn between(&mut self, problem: &mut Problem, start: &Start, h: f64, rows: &mut [Coefficients]) {
        hermite(problem, start, h, rows);
        for ((row, k), &rate) in rows.iter_mut().zip(&self.k).zip(problem.rates()) {
            row[3] = h * sum(&BETWEEN, k, rate);
        }
    }
}
