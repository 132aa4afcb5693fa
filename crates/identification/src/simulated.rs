//! Measured signals of records as a model simulates them.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::held_out::HeldOut;
use crate::record::Record;

/// Rows of a record that a model simulates without correction, from one initial state.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedCourse {
    /// Name of the record.
    pub record: String,
    /// True if the model wasn't estimated from these rows.
    pub is_held_out: bool,
    /// Times, s.
    pub time: Vec<f64>,
    /// Measured values of each signal, a row a signal; NaN where a cell doesn't count.
    pub measured: DMatrix<f64>,
    /// Simulated values; NaN where a cell doesn't count.
    pub simulated: DMatrix<f64>,
}

/// The courses of data by the errors of a simulation, which are scaled. The data are of these records.
pub(crate) fn courses(
    data: &Data,
    records: &[&Record],
    names: &[String],
    found: &HeldOut,
    is_held_out: bool,
) -> Vec<SimulatedCourse> {
    let of = |(window, errors): &(crate::predictor::Window, DMatrix<f64>)| {
        let segment = &data.segments[window.segment];
        let record = records[segment.record];
        let first = segment.first + window.first;
        let columns: Vec<_> = names.iter().map(|name| record.column(name)).collect();
        let measured = DMatrix::from_fn(names.len(), window.len, |i, k| {
            let counts = segment.mask[(i, window.first + k)] != 0.0;
            columns[i].filter(|_| counts).map_or(f64::NAN, |column| column.values[first + k])
        });
        let scale = &data.scaling.x;
        SimulatedCourse {
            record: record.name.clone(),
            is_held_out,
            time: record.time[first..first + window.len].to_vec(),
            simulated: DMatrix::from_fn(names.len(), window.len, |i, k| measured[(i, k)] - errors[(i, k)] * scale[i]),
            measured,
        }
    };
    found.errors.iter().map(of).collect()
}
