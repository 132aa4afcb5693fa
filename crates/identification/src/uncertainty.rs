//! Covariance of an estimate.

use nalgebra::{DMatrix, DVector};

use crate::layout::{Layout, Place};
use crate::linear::{self, symmetric};
use crate::marquardt::{Fit, Objective, weighted};
use crate::problem::Problem;

/// Blocks of consecutive rows, from which the robust covariance is computed.
const BLOCKS: usize = 24;
/// Distance, in standard errors, at which the objective is compared with its quadratic form.
const FAR: f64 = 2.5;
/// The objective must grow by at least this part of that of the quadratic form.
const LEAST_GROWTH: f64 = 0.5;
/// Directions that are looked at, the least certain ones.
const DIRECTIONS: usize = 3;
/// A standard error isn't enlarged by more.
const MOST_ENLARGED: f64 = 1e3;

/// Uncertainty of the unknowns (A, B, d) of an estimate, scaled.
#[derive(Debug, Clone)]
pub(crate) struct Uncertainty {
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Factors by which blocks of rows enlarge each standard error: coloured residuals.
    pub kappa: Vec<f64>,
    /// The condition number of the information with unit diagonal.
    pub condition: f64,
}

/// Sums that both covariances need.
struct Sums {
    information: DMatrix<f64>,
    /// Σ J_kᵀ S J_k.
    middle: DMatrix<f64>,
    /// JᵀR of each block.
    blocks: Vec<DVector<f64>>,
}

impl Uncertainty {
    /// Uncertainty of a fit. `None` where its derivatives aren't finite.
    pub fn of(problem: &Problem, fit: &Fit) -> Option<Self> {
        let count = problem.layout.count();
        let sums = Sums::of(problem, fit)?;
        let (inverse, condition) = inverse(&sums.information);
        let uncentring = problem.data.uncentring(problem.layout, sums.information.nrows());
        let inverse = &uncentring * inverse;
        let whole = around(&inverse, &sums.middle);
        let mut covariance = whole.view((0, 0), (count, count)).into_owned();
        let robust = sums.robust(&inverse);
        if condition < 1e12 {
            widen(problem, fit, (&whole, &uncentring), &mut covariance);
        }
        let ratio = |k: usize| {
            let plain = whole[(k, k)];
            if plain > 0.0 { (robust[(k, k)] / plain).max(1.0).sqrt() } else { 1.0 }
        };
        let kappa: Vec<f64> = (0..count).map(ratio).collect();
        for i in 0..count {
            for j in 0..count {
                covariance[(i, j)] *= kappa[i] * kappa[j];
            }
        }
        Some(Uncertainty { covariance, kappa, condition })
    }

    /// Standard errors of the unknowns.
    pub fn errors(&self) -> Vec<f64> {
        self.covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect()
    }

    /// The entries in the least certain direction, where it has most of the variance of an entry: the largest.
    pub fn combination(&self, entry: usize, share: f64) -> Option<Vec<(f64, usize)>> {
        let (values, vectors) = symmetric(&self.covariance);
        let whole = self.covariance[(entry, entry)];
        let place = (0..values.len()).find(|k| values[*k] * vectors[(entry, *k)].powi(2) > share * whole)?;
        let v = vectors.column(place);
        let all = v.iter().enumerate().filter(|(_, part)| part.abs() > 0.3 * v.amax());
        let all: Vec<(f64, usize)> = all.map(|(k, part)| (*part / v[entry], k)).collect();
        (all.len() > 1).then_some(all)
    }
}

impl Sums {
    fn of(problem: &Problem, fit: &Fit) -> Option<Self> {
        let (n, count) = (problem.data.n, problem.count());
        let weights = fit.value.weights();
        let rows: usize = problem.windows.iter().map(|window| window.len).sum();
        let noise = noise(problem, fit, rows)?;
        let root = square_root(&noise).transpose();
        let mut sums = Sums {
            information: DMatrix::zeros(count, count),
            middle: DMatrix::zeros(count, count),
            blocks: vec![DVector::zeros(count); BLOCKS],
        };
        let mut before = 0;
        problem.for_each_jacobian(&fit.unknowns, &weights, |window, prediction, jacobian| {
            sums.information += linear::information(jacobian);
            let mut turned = jacobian.clone();
            for k in 0..window.len {
                let row = jacobian.columns(k * n, n) * &root;
                turned.columns_mut(k * n, n).copy_from(&row);
            }
            sums.middle += linear::information(&turned);
            let residual = weighted(&prediction.e, &weights);
            for k in 0..window.len {
                let block = (before + k) * BLOCKS / rows;
                let part = jacobian.columns(k * n, n) * residual.rows(k * n, n);
                sums.blocks[block] += part;
            }
            before += window.len;
        })?;
        Some(sums)
    }

    /// (JᵀJ)⁻¹ (Σ g gᵀ) (B/(B − 1)) (JᵀJ)⁻¹ over blocks of consecutive rows.
    fn robust(&self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        let mut middle = DMatrix::zeros(inverse.nrows(), inverse.ncols());
        for block in &self.blocks {
            middle.ger(1.0, block, block, 1.0);
        }
        let count = BLOCKS as f64;
        around(inverse, &middle) * (count / (count - 1.0))
    }
}

/// H⁻¹ M H⁻¹ as a product with its transpose: no variance is negative.
fn around(inverse: &DMatrix<f64>, middle: &DMatrix<f64>) -> DMatrix<f64> {
    // With unit diagonal, since units of unknowns differ.
    let length: Vec<f64> = middle.diagonal().iter().map(|entry| entry.max(f64::MIN_POSITIVE).sqrt()).collect();
    let size = length.len();
    let unit = DMatrix::from_fn(size, size, |i, j| middle[(i, j)] / (length[i] * length[j]));
    let (values, mut half) = symmetric(&unit);
    for (mut column, value) in half.column_iter_mut().zip(&values) {
        column.scale_mut(value.max(0.0).sqrt());
    }
    for (mut row, length) in half.row_iter_mut().zip(&length) {
        row.scale_mut(*length);
    }
    let half = inverse * half;
    &half * half.transpose()
}

/// Covariance of the weighted residuals of a row: Σ r rᵀ/(N − q/n), q the number of all unknowns.
fn noise(problem: &Problem, fit: &Fit, rows: usize) -> Option<DMatrix<f64>> {
    let n = problem.data.n;
    let weights = fit.value.weights();
    let predictor = problem.predictor(&fit.unknowns, false)?;
    let mut sum = DMatrix::zeros(n, n);
    for window in &problem.windows {
        let mut e = predictor.predict(*window, &weights).e;
        for (mut row, weight) in e.row_iter_mut().zip(&weights) {
            row.scale_mut(*weight);
        }
        sum += &e * e.transpose();
    }
    let unknowns = problem.count() + problem.data.projected() * problem.windows.len();
    Some(sum / (rows as f64 - unknowns as f64 / n as f64).max(1.0))
}

/// R with RᵀR a covariance.
fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let (values, vectors) = symmetric(covariance);
    let mut root = vectors.transpose();
    for (mut row, value) in root.row_iter_mut().zip(values) {
        row.scale_mut(value.max(0.0).sqrt());
    }
    root
}

/// The inverse of an information matrix, and its condition number with unit diagonal. What can't be determined is very uncertain.
fn inverse(information: &DMatrix<f64>) -> (DMatrix<f64>, f64) {
    let length: Vec<f64> = information.diagonal().iter().map(|entry| entry.max(f64::MIN_POSITIVE).sqrt()).collect();
    let size = length.len();
    let unit = DMatrix::from_fn(size, size, |i, j| information[(i, j)] / (length[i] * length[j]));
    let (values, vectors) = symmetric(&unit);
    let most = values.first().copied().unwrap_or(1.0);
    let least = values.last().copied().unwrap_or(1.0);
    // Smaller eigenvalues are rounding.
    let floor = most * 1e-17;
    let condition = most / least.max(floor);
    let mut half = vectors;
    for (mut column, value) in half.column_iter_mut().zip(&values) {
        column.unscale_mut(value.max(floor).sqrt());
    }
    for (mut row, length) in half.row_iter_mut().zip(&length) {
        row.unscale_mut(*length);
    }
    (&half * half.transpose(), condition)
}

/// Enlarges the standard errors along the least certain directions until the objective grows there as it should.
fn widen(
    problem: &Problem,
    fit: &Fit,
    (whole, uncentring): (&DMatrix<f64>, &DMatrix<f64>),
    covariance: &mut DMatrix<f64>,
) {
    let count = problem.layout.count();
    let (values, vectors) = symmetric(covariance);
    let wanted = LEAST_GROWTH * FAR * FAR;
    for (variance, direction) in values.into_iter().zip(vectors.column_iter()).take(DIRECTIONS) {
        if variance <= 0.0 {
            continue;
        }
        // What isn't of (A, B, d) goes along as it does with this direction.
        let along = whole.columns(0, count) * direction / variance.sqrt();
        // The fit is of centred data; constants depend only on the entries, so that this is the inverse.
        let along = &along * 2.0 - uncentring * along;
        let growth = |times: f64| {
            let at = |sign: f64| {
                let moved: Vec<f64> =
                    fit.unknowns.iter().zip(along.iter()).map(|(p, d)| p + sign * times * d).collect();
                let value = problem.value(&moved, &fit.value.weights());
                value.map_or(f64::INFINITY, |value| value.loss - fit.value.loss)
            };
            at(FAR).min(at(-FAR))
        };
        let factor = factor_until(wanted, growth);
        let outer = direction * direction.transpose();
        *covariance += outer * (variance * (factor * factor - 1.0));
    }
}

/// The least factor, from 1 on, at which a function reaches a value.
fn factor_until(wanted: f64, growth: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (1.0, 1.0);
    while growth(high) < wanted {
        low = high;
        high *= 2.0;
        if high > MOST_ENLARGED {
            return MOST_ENLARGED;
        }
    }
    if high == 1.0 {
        return 1.0;
    }
    for _ in 0..6 {
        let middle = f64::sqrt(low * high);
        if growth(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// The covariance in units of the data.
pub(crate) fn physical(covariance: &DMatrix<f64>, layout: &Layout, factor: impl Fn(Place) -> f64) -> DMatrix<f64> {
    let factors: Vec<f64> = layout.unknowns.iter().map(|unknown| factor(unknown.place)).collect();
    DMatrix::from_fn(factors.len(), factors.len(), |i, j| covariance[(i, j)] * factors[i] * factors[j])
}
