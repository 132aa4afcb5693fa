//! Parts of a model as a file has them.

use crate::checks::Estimates;
use crate::faults::Names;
use crate::layout::Place;
use crate::model::{Free, RecordOf, Units};
use crate::options::Estimated;
use crate::record::Record;

/// An unknown in a file.
pub(crate) fn free(place: Place) -> Free {
    match place {
        Place::A(i, j) => Free("A".to_owned(), i + 1, j + 1),
        Place::B(i, j) => Free("B".to_owned(), i + 1, j + 1),
        Place::D(i, record) => Free("d".to_owned(), i + 1, record + 1),
    }
}

/// The unknowns of an estimate in units of the data.
pub(crate) fn estimated(estimates: &Estimates) -> Vec<Estimated> {
    let errors = estimates.uncertainty.errors();
    let of = |k: usize| Estimated {
        entry: free(estimates.layout.unknowns[k].place),
        value: estimates.unknowns[k] * estimates.factors[k],
        error: errors[k] * estimates.factors[k],
        kappa: estimates.uncertainty.kappa[k],
    };
    (0..estimates.layout.count()).map(of).collect()
}

/// Units of the signals; none where none is known.
pub(crate) fn units(names: &Names) -> Option<Units> {
    let all = names.input_units.iter().chain(&names.measured_units);
    if all.clone().all(String::is_empty) {
        return None;
    }
    let [x, u] = [names.measured_units.clone(), names.input_units.clone()];
    Some(Units { y: x.clone(), x, u })
}

/// A record in a file.
pub(crate) fn record_of(record: &Record) -> RecordOf {
    let (from, to) = (record.time[0], record.time[record.len() - 1]);
    RecordOf { file: record.name.clone(), sha256: None, rows: record.len(), from, to }
}
