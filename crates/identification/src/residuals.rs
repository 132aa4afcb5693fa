//! Residuals of a fit: what is left in them of themselves and of the inputs.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::data::Data;
use crate::marquardt::Fit;
use crate::problem::Problem;

/// Lags at which residuals are looked at.
pub(crate) const LAGS: usize = 20;

/// Correlations of the residuals of a fit. Of white noise that nothing else shows in, 99 % are within ±2.6.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Correlations {
    /// Autocorrelations of each signal's residual at lags of 1 to 20 rows, in units of 1/√N.
    pub own: Vec<Vec<f64>>,
    /// Correlations of each signal's residual with each input -20 to 20 rows earlier, in units of its standard error.
    pub with_inputs: Vec<Vec<Vec<f64>>>,
}

impl Correlations {
    pub(crate) fn of(residuals: &Residuals, data: &Data) -> Self {
        let lags = LAGS as i64;
        let of = |i: usize, j: usize| (-lags..=lags).map(|lag| residuals.correlation(data, i, j, lag)).collect();
        let with_inputs = (0..data.n).map(|i| (0..data.m).map(|j| of(i, j)).collect()).collect();
        Correlations { own: residuals.autocorrelations(data.n), with_inputs }
    }
}

/// Residuals of each window, with the rows that they belong to.
pub(crate) struct Residuals {
    /// Segment, first row, residuals (0 where a cell doesn't count).
    pub windows: Vec<(usize, usize, DMatrix<f64>)>,
}

impl Residuals {
    pub fn of(problem: &Problem, fit: &Fit) -> Option<Self> {
        let predictor = problem.predictor(&fit.unknowns, false)?;
        let weights = fit.value.weights();
        let of =
            |window: &crate::predictor::Window| (window.segment, window.first, predictor.predict(*window, &weights).e);
        Some(Residuals { windows: problem.windows.iter().map(of).collect() })
    }

    /// The first autocorrelations of each signal, in units of 1/√N.
    pub fn autocorrelations(&self, n: usize) -> Vec<Vec<f64>> {
        (0..n)
            .map(|i| {
                let energy: f64 = self.windows.iter().map(|(_, _, e)| e.row(i).norm_squared()).sum();
                let count: usize = self.windows.iter().map(|(_, _, e)| e.ncols()).sum();
                let at = |lag: usize| {
                    let of = |e: &DMatrix<f64>| {
                        let pairs = e.ncols().saturating_sub(lag);
                        (0..pairs).map(|k| e[(i, k)] * e[(i, k + lag)]).sum::<f64>()
                    };
                    self.windows.iter().map(|(_, _, e)| of(e)).sum::<f64>()
                };
                let scale = if energy > 0.0 { (count as f64).sqrt() / energy } else { 0.0 };
                (1..=LAGS).map(|lag| at(lag) * scale).collect()
            })
            .collect()
    }

    /// The correlation of each signal's residual with an input that many rows earlier (later where negative), in units of
    /// its standard error without any.
    pub fn correlation(&self, data: &Data, signal: usize, input: usize, lag: i64) -> f64 {
        let (mut product, mut of_e, mut of_u, mut count) = (0.0, 0.0, 0.0, 0.0);
        let all = data.segments.iter().map(|segment| segment.u.row(input).sum()).sum::<f64>();
        let mean = all / data.rows() as f64;
        for (segment, first, e) in &self.windows {
            let u = &data.segments[*segment].u;
            for k in 0..e.ncols() {
                let row = (first + k) as i64 - lag;
                if row >= 0 && (row as usize) < u.ncols() {
                    let (e, u) = (e[(signal, k)], u[(input, row as usize)] - mean);
                    product += e * u;
                    of_e += e * e;
                    of_u += u * u;
                    count += 1.0;
                }
            }
        }
        if of_e * of_u > 0.0 { product / (of_e * of_u).sqrt() * f64::sqrt(count) } else { 0.0 }
    }
}
