//! The page of `identify`.

use std::path::{Path, PathBuf};

use adaptive_fmu::begun;
use adaptive_fmu::error::Error;
use adaptive_fmu::estimation;
use adaptive_fmu::identified::{FindingText, Report, Table};
use adaptive_fmu::identified::{finding_text, meaning, written};
use adaptive_fmu::output;
use adaptive_fmu::report::number;
use adaptive_fmu_identification::{Identified, Model, Pole, SimulatedCourse, Verdict, poles_of};
use nalgebra::DMatrix;

use super::{Arguments, Read};
use crate::command::names::Names;

/// Writes the page, if it is wanted; its file.
pub fn write(arguments: &Arguments, html: impl FnOnce() -> String) -> Result<Option<PathBuf>, Error> {
    let Some(file) = arguments.page_file() else { return Ok(None) };
    let folder = begun::path(file.parent().unwrap_or(Path::new("")));
    std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
    output::write(&file, html())?;
    Ok(Some(file))
}

/// The page of a model whose entries were estimated.
pub fn of_identified<'a>(found: &'a Identified, arguments: &'a Arguments) -> Report<'a> {
    let model = &found.model;
    let measured = if model.outputs.is_empty() { &model.states } else { &model.outputs };
    let unit = |k: usize| model.units.as_ref().and_then(|units| units.y.get(k)).cloned().unwrap_or_default();
    let signals: Vec<_> = measured.iter().enumerate().map(|(k, name)| (name.clone(), unit(k))).collect();
    let entries = found.entries.iter().map(|entry| {
        let place = format!("{}  {}", written(&entry.entry), meaning(&entry.entry, model));
        vec![place, short(entry.value), short(entry.error), percent_of(entry.error, entry.value), rounded(entry.kappa)]
    });
    let entries = Table {
        title: "Entries".to_owned(),
        heads: vec!["entry", "value", "std. error", "error, %", "κ, for coloured residuals"],
        rows: entries.collect(),
    };
    Report {
        name: name_of(arguments),
        about: about(model),
        courses: &found.courses,
        tables: vec![fits(&signals, model, &found.ceiling), entries],
        signals,
        findings: found
            .findings
            .iter()
            .map(|finding| FindingText {
                is_bad: finding.verdict == Verdict::NotSound,
                text: finding_text(finding, true),
            })
            .collect(),
        model: Some(model),
        poles: &found.poles,
        correlations: Some(&found.correlations),
        disturbance: &found.disturbance_over_time,
    }
}

/// Simulated records and poles for the page of parameters of an FMU.
pub struct OfParameters {
    courses: Vec<SimulatedCourse>,
    poles: Vec<Pole>,
}

impl OfParameters {
    /// Courses of records, and poles of the linear model that follows.
    pub fn new(found: &estimation::Found, records: &[Read], measured: &[&[Vec<f64>]], model: Option<&Model>) -> Self {
        let mut courses = Vec::new();
        for (k, (read, simulated)) in records.iter().zip(&found.simulated).enumerate() {
            let (rows, seen) = (read.record.time.len(), found.seen[k]);
            for (from, until) in [(0, seen), (seen, rows)].into_iter().filter(|(from, until)| from < until) {
                courses.push(SimulatedCourse {
                    record: read.record.name.clone(),
                    is_held_out: from > 0,
                    time: read.record.time[from..until].to_vec(),
                    measured: DMatrix::from_fn(simulated.nrows(), until - from, |i, row| measured[k][i][from + row]),
                    simulated: simulated.columns(from, until - from).into_owned(),
                });
            }
        }
        OfParameters { courses, poles: model.map_or_else(Vec::new, poles_of) }
    }

    /// The page of parameters of an FMU.
    pub fn report<'a>(
        &'a self,
        found: &estimation::Found,
        (model, findings): (Option<&'a Model>, &[String]),
        units: &[String],
        arguments: &'a Arguments,
    ) -> Report<'a> {
        let names = arguments.outputs.iter().flat_map(|Names(names)| names).cloned();
        let signals: Vec<_> = names.zip(units.iter().cloned()).collect();
        let parameters = found.parameters.iter().map(|parameter| {
            let record = parameter.record.map_or(String::new(), |record| format!(" in record {}", record + 1));
            let (value, error) = (parameter.value, parameter.error);
            vec![
                format!("{}{record}", parameter.name),
                short(value),
                short(error),
                percent_of(error, value),
                parameter.unit.clone(),
            ]
        });
        let parameters = Table {
            title: "Parameters".to_owned(),
            heads: vec!["parameter", "value", "std. error", "error, %", "unit"],
            rows: parameters.collect(),
        };
        let about = model.map_or_else(|| "There is no linear model.".to_owned(), about);
        let of = Model {
            noise: found.noise.clone(),
            fit: adaptive_fmu_identification::Fits { held_out: found.held_out.clone(), windows: Vec::new() },
            ..Model::default()
        };
        Report {
            name: name_of(arguments),
            about,
            courses: &self.courses,
            tables: vec![fits(&signals, &of, &found.ceiling), parameters],
            signals,
            findings: findings
                .iter()
                .map(|text| FindingText { is_bad: true, text: format!("not sound: {text}") })
                .collect(),
            model,
            poles: &self.poles,
            correlations: None,
            disturbance: &[],
        }
    }
}

fn name_of(arguments: &Arguments) -> &str {
    arguments.out.file_stem().and_then(|stem| stem.to_str()).unwrap_or("model")
}

fn about(model: &Model) -> String {
    let of = |record: &adaptive_fmu_identification::RecordOf| {
        format!("{} ({} rows, {} … {} s)", record.file, record.rows, number(record.from), number(record.to))
    };
    let records: Vec<_> = model.records.iter().map(of).collect();
    format!("Method: {}. Records: {}.", model.method, records.join(", "))
}

/// The table of fits.
fn fits(signals: &[(String, String)], model: &Model, ceiling: &[f64]) -> Table {
    let of =
        |values: &[f64], k: usize| values.get(k).filter(|fit| fit.is_finite()).map_or_else(none, |fit| rounded(*fit));
    let row = |(k, (name, unit)): (usize, &(String, String))| {
        let noise = model.noise.get(k).map_or_else(none, |noise| format!("{} {unit}", short(*noise)));
        let [whole, windows] = [&model.fit.held_out, &model.fit.windows].map(|fits| of(fits, k));
        vec![name.clone(), whole, windows, of(ceiling, k), noise.trim_end().to_owned()]
    };
    Table {
        title: "Fit of the held-out part".to_owned(),
        heads: vec!["signal", "whole, %", "windows, %", "about what noise allows, %", "noise"],
        rows: signals.iter().enumerate().map(row).collect(),
    }
}

fn none() -> String {
    "–".to_owned()
}

fn rounded(value: f64) -> String {
    number((value * 10.0).round() / 10.0)
}

/// A number with five digits.
fn short(value: f64) -> String {
    number(format!("{value:.*e}", 4).parse().unwrap_or(value))
}

fn percent_of(error: f64, value: f64) -> String {
    let percent = 100.0 * error / value.abs();
    if percent.is_finite() { format!("{percent:.*}", 2) } else { none() }
}
