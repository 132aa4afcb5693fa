//! Estimated parameters and their uncertainty.

use adaptive_fmu_identification::marquardt::Fit;
use nalgebra::DMatrix;

use super::objective::Simulated;
use super::uncertainty::Weighted;

/// A parameter that was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// Name in the FMU.
    pub name: String,
    /// Unit of measurement.
    pub unit: String,
    /// The record whose value it is, from 0; none for a parameter of all.
    pub record: Option<usize>,
    /// The value.
    pub value: f64,
    /// Standard error; NaN if the records don't depend on it, as at an end of a range.
    pub error: f64,
    /// Size of its start value, or 1.
    pub scale: f64,
    /// True if it is at an end of its range.
    pub is_at_end: bool,
}

/// The result of an estimation.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The parameters.
    pub parameters: Vec<Estimated>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Condition number of the information with unit diagonal: beyond 1e8 parameters can't be distinguished.
    pub condition: f64,
    /// Root mean square of each output's residual.
    pub noise: Vec<f64>,
    /// Fit of each output to held-out data, %; NaN for an output that hardly moves there, empty without held-out data.
    pub held_out: Vec<f64>,
    /// The part that noise leaves, %.
    pub ceiling: Vec<f64>,
    /// Simulated outputs of each record, with constant errors of sensors: rows are outputs, columns rows of the record.
    pub simulated: Vec<DMatrix<f64>>,
    /// Rows of each record that the parameters are estimated from.
    pub seen: Vec<usize>,
}

/// Least held-out motion that shows anything, in parts of the noise.
const LEAST_MOTION: f64 = 2.0;
/// Distance from an end of its range, in parts of it, within which a value is at the end.
const AT_END: f64 = 1e-3;

impl Simulated<'_> {
    /// The parameters of a fit; `None` if simulations nearby fail.
    pub(super) fn found(&self, fit: &Fit) -> Option<Found> {
        let point = &fit.unknowns;
        let (residuals, derivatives) = (self.residuals(point)?, self.derivatives(point)?);
        let weights = fit.value.weights();
        let mut weighted = Weighted { derivatives: Vec::new(), residuals: Vec::new() };
        for (record, e) in residuals.iter().enumerate() {
            for row in 0..e.ncols() {
                let of = |i: usize, k: usize| derivatives[k][record][(i, row)] * weights[i];
                weighted.derivatives.push(DMatrix::from_fn(e.nrows(), point.len(), of));
                weighted.residuals.push(DMatrix::from_fn(e.nrows(), 1, |i, _| e[(i, row)] * weights[i]));
            }
        }
        let is_seen = |k: &usize| weighted.derivatives.iter().any(|row| row.column(*k).amax() > 0.0);
        let seen: Vec<_> = (0..point.len()).filter(is_seen).collect();
        let (of_seen, condition) = weighted.of(&seen).covariance()?;
        let slopes: Vec<_> = self.unknowns.iter().zip(point).map(|(unknown, q)| unknown.slope(*q)).collect();
        let mut covariance = DMatrix::zeros(point.len(), point.len());
        for (i, j) in (0..seen.len()).flat_map(|i| (0..seen.len()).map(move |j| (i, j))) {
            covariance[(seen[i], seen[j])] = of_seen[(i, j)] * slopes[seen[i]] * slopes[seen[j]];
        }
        let parameters = self.unknowns.iter().zip(point).enumerate().map(|(k, (unknown, q))| {
            let value = unknown.value(*q);
            let is_at_end = unknown.range.is_some_and(|[low, high]| {
                let least = AT_END * (high - low);
                value - low < least || high - value < least
            });
            let (name, unit) = (unknown.name.clone(), unknown.unit.clone());
            let error = if seen.contains(&k) { covariance[(k, k)].sqrt() } else { f64::NAN };
            Estimated { name, unit, record: unknown.record, value, error, scale: unknown.scale(), is_at_end }
        });
        let simulated = self.simulated(point)?;
        let (held_out, ceiling) = self.held_out(&simulated, &fit.value.rms);
        Some(Found {
            parameters: parameters.collect(),
            covariance,
            condition,
            noise: fit.value.rms.clone(),
            held_out,
            ceiling,
            simulated,
            seen: self.seen.clone(),
        })
    }

    /// Outputs at a point, with the constant errors of the rows that it is estimated from.
    fn simulated(&self, point: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        let mut courses = self.outputs_at(point).ok()?;
        for (record, course) in courses.iter_mut().enumerate().filter(|_| self.task.has_offsets) {
            let e = self.differences(record, course);
            for i in 0..course.nrows() {
                let seen: Vec<_> = (0..self.seen[record]).filter(|&row| self.counts(record, i, row)).collect();
                let offset = seen.iter().map(|&row| e[(i, row)]).sum::<f64>() / seen.len().max(1) as f64;
                course.row_mut(i).add_scalar_mut(-offset);
            }
        }
        Some(courses)
    }

    /// Fits to data that the search didn't use, and those of a perfect simulation with the same noise.
    fn held_out(&self, simulated: &[DMatrix<f64>], rms: &[f64]) -> (Vec<f64>, Vec<f64>) {
        if self.task.hold_out == 0.0 {
            return (Vec::new(), Vec::new());
        }
        let mut fits = (Vec::new(), Vec::new());
        for (i, noise) in rms.iter().enumerate() {
            let (mut off, mut motion, mut count) = (0.0, 0.0, 0);
            for (record, of) in simulated.iter().enumerate() {
                let e = self.differences(record, of);
                let measured = &self.task.records[record].outputs[i];
                let rows: Vec<_> = (self.seen[record]..e.ncols()).filter(|&row| measured[row].is_finite()).collect();
                let middle = rows.iter().map(|&row| measured[row]).sum::<f64>() / rows.len().max(1) as f64;
                off += rows.iter().map(|&row| e[(i, row)].powi(2)).sum::<f64>();
                motion += rows.iter().map(|&row| (measured[row] - middle).powi(2)).sum::<f64>();
                count += rows.len();
            }
            let deviation = (motion / count.max(1) as f64).sqrt();
            let moves = deviation > LEAST_MOTION * noise;
            fits.0.push(if moves { 100.0 * (1.0 - (off / motion).sqrt()) } else { f64::NAN });
            fits.1.push(100.0 * (1.0 - noise / deviation));
        }
        fits
    }
}
