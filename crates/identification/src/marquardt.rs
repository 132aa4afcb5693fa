//! Maximum likelihood by the method of Levenberg and Marquardt, with weights that follow the residuals.

use nalgebra::{Cholesky, DMatrix, DVector};

/// The root mean square of a residual isn't taken to be below this part of the signal's standard deviation.
const LEAST_RMS: f64 = 1e-10;
/// The growth over a window, of errors in an initial state, that output error allows.
pub(crate) const MOST_GROWTH: f64 = 1e8;
const FIRST_DAMPING: f64 = 1e-3;
/// Failed steps in a row after which a search ends.
const FAILURES: usize = 8;
/// A search ends when a step gains less in the objective.
const LEAST_GAIN: f64 = 1e-6;

/// Residuals at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Root mean square of each signal's residual.
    pub rms: Vec<f64>,
    /// −2 ln likelihood of Gaussian noise of unknown variances, up to a constant.
    pub loss: f64,
}

/// A point of a search, with its residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The point.
    pub unknowns: Vec<f64>,
    /// Its residuals.
    pub value: Value,
}

impl Value {
    /// Weight of each signal's residual: the inverse of its root mean square.
    pub fn weights(&self) -> Vec<f64> {
        self.rms.iter().map(|rms| 1.0 / rms.max(LEAST_RMS)).collect()
    }
}

/// −2 ln likelihood as a function of unknowns, by its residuals.
pub trait Objective {
    /// The number of signals with residuals.
    fn signals(&self) -> usize;

    /// 1 or −1 for an unknown with a sign, else 0.
    fn sign(&self, unknown: usize) -> f64;

    /// The least damping, with which directions that do nothing stay still.
    fn least_damping(&self) -> f64 {
        1e-12
    }

    /// Residuals at a point, with what is linear best by these weights; `None` where the point isn't allowed.
    fn value(&self, unknowns: &[f64], weights: &[f64]) -> Option<Value>;

    /// Normal equations at a point: JᵀJ, Jᵀr, and the residuals.
    fn normal_equations(&self, unknowns: &[f64], weights: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>, Value)>;
}

/// Searches from a point in at most `steps` steps. `None` if the point itself isn't allowed, or no derivatives are
/// found.
pub fn search(objective: &impl Objective, start: &[f64], steps: usize) -> Option<Fit> {
    let mut weights = objective.value(start, &vec![1.0; objective.signals()])?.weights();
    let mut fit = Fit { unknowns: start.to_vec(), value: objective.value(start, &weights)? };
    let mut damping = FIRST_DAMPING;
    for _ in 0..steps {
        weights = fit.value.weights();
        let (information, gradient, value) = objective.normal_equations(&fit.unknowns, &weights)?;
        fit.value = value;
        let Some(next) = step(objective, &fit, &weights, (&information, &gradient), &mut damping) else { break };
        let gain = fit.value.loss - next.value.loss;
        fit = next;
        if gain < LEAST_GAIN {
            break;
        }
    }
    Some(fit)
}

/// The next point, which is better; `None` where none is found.
fn step(
    objective: &impl Objective,
    fit: &Fit,
    weights: &[f64],
    (information, gradient): (&DMatrix<f64>, &DVector<f64>),
    damping: &mut f64,
) -> Option<Fit> {
    for _ in 0..FAILURES {
        let trial = trial(objective, &fit.unknowns, information, gradient, *damping);
        let better = trial.and_then(|unknowns| {
            let value = objective.value(&unknowns, weights).filter(|value| value.loss < fit.value.loss)?;
            Some(Fit { unknowns, value })
        });
        if better.is_some() {
            *damping = (*damping / 10.0).max(objective.least_damping());
            return better;
        }
        *damping *= 10.0;
    }
    None
}

/// A damped step, cut where an unknown with a sign would cross 0.
fn trial(
    objective: &impl Objective,
    at: &[f64],
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    damping: f64,
) -> Option<Vec<f64>> {
    let sign = |k: usize| objective.sign(k);
    let mut is_fixed = vec![false; at.len()];
    loop {
        let step = damped(information, gradient, damping, &is_fixed)?;
        let outward = (0..at.len()).filter(|&k| !is_fixed[k] && at[k] == 0.0 && sign(k) * step[k] < 0.0);
        let outward: Vec<usize> = outward.collect();
        if outward.is_empty() {
            let moved = (0..at.len()).map(|k| {
                let value = at[k] + step[k];
                if sign(k) * value < 0.0 { 0.0 } else { value }
            });
            return Some(moved.collect());
        }
        outward.into_iter().for_each(|k| is_fixed[k] = true);
    }
}

/// −(JᵀJ + μ diag) ⁻¹ Jᵀr, 0 for what stays where it is.
fn damped(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    damping: f64,
    is_fixed: &[bool],
) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..is_fixed.len()).filter(|k| !is_fixed[*k] && information[(*k, *k)] > 0.0).collect();
    let length: Vec<f64> = free.iter().map(|k| information[(*k, *k)].sqrt()).collect();
    let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        information[(free[i], free[j])] / (length[i] * length[j]) + if i == j { damping } else { 0.0 }
    });
    let right = DVector::from_fn(free.len(), |i, _| -gradient[free[i]] / length[i]);
    let solution = Cholesky::new(matrix)?.solve(&right);
    let mut step = DVector::zeros(is_fixed.len());
    free.iter().enumerate().for_each(|(i, k)| step[*k] = solution[i] / length[i]);
    step.iter().all(|entry| entry.is_finite()).then_some(step)
}

/// A residual, weighted, row after row.
pub(crate) fn weighted(e: &DMatrix<f64>, weights: &[f64]) -> DVector<f64> {
    DVector::from_iterator(e.len(), e.iter().enumerate().map(|(k, value)| value * weights[k % e.nrows()]))
}

/// Sums of squares of residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Sums {
    squares: Vec<f64>,
    counts: Vec<f64>,
}

impl Sums {
    /// Returns it without residuals, for this number of signals.
    pub fn new(signals: usize) -> Self {
        Sums { squares: vec![0.0; signals], counts: vec![0.0; signals] }
    }

    /// Adds residuals, a column a row of the record; the mask is 1 where they count.
    pub fn add(&mut self, e: &DMatrix<f64>, mask: &DMatrix<f64>) {
        for i in 0..self.squares.len() {
            self.squares[i] += e.row(i).norm_squared();
            self.counts[i] += mask.row(i).sum();
        }
    }

    /// Root mean squares and objective; `None` where they aren't finite.
    pub fn value(&self) -> Option<Value> {
        let all = self.squares.iter().zip(&self.counts);
        let rms: Vec<f64> = all.map(|(square, count)| (square / count.max(1.0)).sqrt()).collect();
        let loss = rms.iter().zip(&self.counts).map(|(rms, count)| 2.0 * count * rms.max(LEAST_RMS).ln()).sum();
        rms.iter().all(|rms| rms.is_finite()).then_some(Value { rms, loss })
    }
}
