//! Covariance of estimated parameters, which is valid for residuals that are correlated with each other and over time.

use nalgebra::DMatrix;

/// Blocks of consecutive rows that reveal coloured residuals.
const BLOCKS: usize = 24;

/// Derivatives and residuals of all records, weighted: rows of all outputs, one record after the other.
pub(super) struct Weighted {
    /// Derivatives of each row, outputs × unknowns.
    pub derivatives: Vec<DMatrix<f64>>,
    /// Residuals of each row, outputs × 1.
    pub residuals: Vec<DMatrix<f64>>,
}

impl Weighted {
    /// The same with some of the unknowns.
    pub fn of(&self, unknowns: &[usize]) -> Self {
        let derivatives = self.derivatives.iter().map(|row| row.select_columns(unknowns)).collect();
        Weighted { derivatives, residuals: self.residuals.clone() }
    }

    /// The covariance of the unknowns, and the condition number of the scaled information. Each standard error is the
    /// larger of those by correlated outputs and by blocks of rows. `None` if the records don't depend on an unknown.
    pub fn covariance(&self) -> Option<(DMatrix<f64>, f64)> {
        let (outputs, p) = self.derivatives.first()?.shape();
        if p == 0 {
            return Some((DMatrix::zeros(0, 0), 1.0));
        }
        let rows = self.derivatives.len();
        let mut information = DMatrix::zeros(p, p);
        self.derivatives.iter().for_each(|row| information += row.tr_mul(row));
        let scales = information.diagonal().map(f64::sqrt);
        if !scales.iter().all(|scale| *scale > 0.0) {
            return None;
        }
        let unit = DMatrix::from_fn(p, p, |i, j| information[(i, j)] / (scales[i] * scales[j]));
        let eigenvalues = unit.symmetric_eigenvalues();
        let condition = eigenvalues.max() / eigenvalues.min().max(f64::MIN_POSITIVE);
        let inverse = information.clone().cholesky()?.inverse();
        let spread = self.residuals.iter().fold(DMatrix::zeros(outputs, outputs), |sum, r| sum + r * r.transpose());
        let spread = spread / (rows as f64 - p as f64 / outputs as f64).max(1.0);
        let together =
            self.derivatives.iter().fold(DMatrix::zeros(p, p), |sum, row| sum + row.tr_mul(&(&spread * row)));
        let mut covariance = &inverse * together * &inverse;
        let block = rows.div_ceil(BLOCKS);
        let mut by_blocks = DMatrix::zeros(p, p);
        for (derivatives, residuals) in self.derivatives.chunks(block).zip(self.residuals.chunks(block)) {
            let all = derivatives.iter().zip(residuals);
            let sum = all.fold(DMatrix::zeros(p, 1), |sum, (row, residual)| sum + row.tr_mul(residual));
            by_blocks += &sum * sum.transpose();
        }
        let by_blocks = &inverse * by_blocks * &inverse * (BLOCKS as f64 / (BLOCKS as f64 - 1.0));
        let larger = |i: usize| (by_blocks[(i, i)] / covariance[(i, i)]).sqrt().max(1.0);
        let factors: Vec<_> = (0..p).map(larger).collect();
        for (i, j) in (0..p).flat_map(|i| (0..p).map(move |j| (i, j))) {
            covariance[(i, j)] *= factors[i] * factors[j];
        }
        covariance.iter().all(|entry| entry.is_finite()).then_some((covariance, condition))
    }
}
