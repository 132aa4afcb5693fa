//! Residuals of a fit: what is left in them of themselves and of the inputs.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::marquardt::Fit;
use crate::problem::Problem;

/// Lags at which residuals are looked at.
pub(crate) const LAGS: usize = 20;

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

    /// The largest of the first autocorrelations of each signal, in units of 1/√N.
    pub fn whiteness(&self, n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| {
                let energy: f64 = self.windows.iter().map(|(_, _, e)| e.row(i).norm_squared()).sum();
                let count: usize = self.windows.iter().map(|(_, _, e)| e.ncols()).sum();
                let at = |lag: usize| {
                    let of = |e: &DMatrix<f64>| {
                        let kept = e.ncols().saturating_sub(lag);
                        (0..kept).map(|k| e[(i, k)] * e[(i, k + lag)]).sum::<f64>()
                    };
                    self.windows.iter().map(|(_, _, e)| of(e)).sum::<f64>()
                };
                let largest = (1..=LAGS).map(|lag| at(lag).abs()).fold(0.0, f64::max);
                if energy > 0.0 { largest / energy * (count as f64).sqrt() } else { 0.0 }
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
