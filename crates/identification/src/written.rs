//! Parts of a model as a file has them.

use nalgebra::DMatrix;

use crate::checks::Estimates;
use crate::data::Data;
use crate::faults::Names;
use crate::finding::Finding;
use crate::layout::{Continuous, Layout, Place, factor};
use crate::model::{Fits, Free, Model, RecordOf, Units, rows};
use crate::options::{Estimated, Identified, Options};
use crate::record::Record;
use crate::results::Results;
use crate::simulated::{SimulatedCourse, courses};
use crate::structure::Entries;
use crate::uncertainty::physical;

/// Parts that a file is written from.
pub(crate) struct Parts<'a> {
    pub data: &'a Data,
    pub layout: &'a Layout,
    pub names: &'a Names<'a>,
    pub options: &'a Options,
    pub records: &'a [&'a Record],
    pub entries: &'a Entries,
    /// Scaled.
    pub model: &'a Continuous,
    pub results: &'a Results,
    /// Root mean square of each signal's residual, scaled.
    pub rms: &'a [f64],
    pub method: &'a str,
    /// The held-out part, with its records.
    pub tested: Option<(&'a Data, &'a [&'a Record])>,
}

/// Results of an identification that those of states and of outputs have.
pub(crate) fn identified(parts: Parts, estimates: &Estimates, findings: Vec<Finding>) -> Identified {
    let results = parts.results;
    let courses = courses_of(&parts);
    Identified {
        model: file(parts),
        findings,
        entries: estimated(estimates),
        poles: results.poles.clone(),
        condition: results.uncertainty.condition,
        ceiling: results.fits.as_ref().map_or_else(Vec::new, |fits| fits.ceiling.clone()),
        unmatched: results.disturbed.unmatched.clone(),
        disturbance_over_time: Vec::new(),
        losses: [None; 2],
        gain: None,
        wrong_cells: Vec::new(),
        orders: Vec::new(),
        correlations: results.correlations.clone(),
        courses,
    }
}

fn courses_of(parts: &Parts) -> Vec<SimulatedCourse> {
    let (names, results) = (&parts.names.signals.measured, parts.results);
    let own = results.own.iter().flat_map(|own| courses(parts.data, parts.records, names, own, false));
    let tested = parts.tested.zip(results.fits.as_ref());
    own.chain(tested.into_iter().flat_map(|((data, records), fits)| courses(data, records, names, fits, true)))
        .collect()
}

/// A model with measured states, for a file.
fn file(parts: Parts) -> Model {
    let Parts { data, layout, results, names: Names { signals, .. }, .. } = parts;
    let Results { uncertainty, fits, .. } = results;
    let scaling = data.state_scaling();
    let mut model = parts.model.physical(scaling);
    parts.entries.restore(&mut model.a, &mut model.b);
    Model {
        A: rows(&model.a),
        B: rows(&model.b),
        C: rows(&DMatrix::identity(data.n, data.n)),
        states: signals.measured.clone(),
        inputs: signals.inputs.clone(),
        outputs: signals.measured.clone(),
        units: units(parts.names),
        delay: parts.options.delays.clone(),
        sample_time: data.scaling.h,
        offset: rows(&model.d.transpose()),
        free: layout.unknowns.iter().map(|unknown| free(unknown.place)).collect(),
        covariance: rows(&physical(&uncertainty.covariance, layout, |place| factor(place, scaling))),
        kappa: uncertainty.kappa.clone(),
        noise: parts.rms.iter().zip(&data.scaling.x).map(|(rms, scale)| rms * scale).collect(),
        disturbance: results.disturbed.matched.clone(),
        level: parts.options.level,
        fit: fits.as_ref().map_or_else(Fits::default, |fits| Fits {
            held_out: fits.whole.clone().unwrap_or_default(),
            windows: fits.windows.clone(),
        }),
        whiteness: results.whiteness.clone(),
        records: parts.records.iter().copied().map(record_of).collect(),
        method: parts.method.to_owned(),
        ..Model::default()
    }
}

/// An unknown in a file.
fn free(place: Place) -> Free {
    match place {
        Place::A(i, j) => Free("A".to_owned(), i + 1, j + 1),
        Place::B(i, j) => Free("B".to_owned(), i + 1, j + 1),
        Place::D(i, record) => Free("d".to_owned(), i + 1, record + 1),
    }
}

/// The unknowns of an estimate in units of the data.
fn estimated(estimates: &Estimates) -> Vec<Estimated> {
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
fn units(names: &Names) -> Option<Units> {
    let all = names.input_units.iter().chain(&names.measured_units);
    if all.clone().all(String::is_empty) {
        return None;
    }
    let [x, u] = [names.measured_units.clone(), names.input_units.clone()];
    Some(Units { y: x.clone(), x, u })
}

/// A record in a file.
fn record_of(record: &Record) -> RecordOf {
    let (from, to) = (record.time[0], record.time[record.len() - 1]);
    RecordOf { file: record.name.clone(), sha256: None, rows: record.len(), from, to }
}
