//! `identify --plan`: how long a further record must be for entries to be known well enough.

use std::path::{Path, PathBuf};

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::identified::{meaning, written};
use adaptive_fmu::report::{self, number};
use adaptive_fmu::{begun, text_file};
use adaptive_fmu_identification::{Free, Model};
use serde_json::json;

use crate::command::number::part;

/// Heading of these options in the help.
const HEADING: &str = "Length of a further record";
/// Number of standard errors from 0 within which the size of a value is unknown.
const NEAR_ZERO: f64 = 3.0;

#[derive(clap::Args)]
pub struct PlanOptions {
    /// Identified model: print how long a record must be for each entry's standard error to fall below --target
    ///
    /// Standard errors fall with the square root of the length of the record, if its inputs move as they did in the model's records.
    #[arg(long, value_name = "MODEL.json", conflicts_with_all = ["records", "inputs", "states", "outputs"], help_heading = HEADING)]
    pub plan: Option<PathBuf>,
    /// Standard error that each entry of A and B may have, as a part of it
    #[arg(long, value_name = "PART", requires = "plan", default_value = "10%", value_parser = target, help_heading = HEADING)]
    target: f64,
}

fn target(text: &str) -> Result<f64, String> {
    match part(text)? {
        0.0 => Err("must be above 0 and below 100 %, as 10% or 0.1".to_owned()),
        part => Ok(part),
    }
}

/// An entry, and the length of a record that shows it well enough.
struct Planned<'a> {
    entry: &'a Free,
    value: f64,
    error: f64,
    /// s.
    length: f64,
}

impl Planned<'_> {
    fn is_near_zero(&self) -> bool {
        self.value.abs() < NEAR_ZERO * self.error
    }
}

/// Prints the lengths by entry, and the largest.
pub fn execute(file: &Path, options: &PlanOptions, as_json: bool) -> Result<(), Error> {
    let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
    let text = text_file::read(&begun::path(file)).map_err(Error::file(file))?;
    let model: Model =
        serde_json::from_str(&text).map_err(|error| refuse(format!("is no model of identify: {error}")))?;
    let present = model.records.iter().map(|of| of.to - of.from).sum::<f64>();
    let planned = planned(&model, present, options.target).map_err(|invalid| refuse(invalid.to_string()))?;
    let sure = planned.iter().filter(|of| !of.is_near_zero()).map(|of| of.length).reduce(f64::max);
    if as_json {
        print_line!("{}", in_json(&planned, (present, options.target), sure));
        return Ok(());
    }
    let places: Vec<_> =
        planned.iter().map(|of| format!("{}  {}", written(of.entry), meaning(of.entry, &model))).collect();
    let width = places.iter().map(|place| place.chars().count()).max().unwrap_or(0).max(24);
    print_line!("{:width$} {:>12} {:>12} {:>10} {:>12}", "entry", "value", "std. error", "share, %", "length, s");
    for (of, place) in planned.iter().zip(places) {
        let share = if of.value == 0.0 { "–".to_owned() } else { digits(100.0 * of.error / of.value.abs()) };
        let length = if of.is_near_zero() { "unknown".to_owned() } else { digits(of.length) };
        print_line!("{place:width$} {:>12} {:>12} {share:>10} {length:>12}", digits(of.value), digits(of.error));
    }
    let percent = digits(100.0 * options.target);
    match sure {
        Some(length) => print_line!(
            "\nA record of {} s ({} rows) brings these standard errors below {percent} %; the records so far have {} s.",
            digits(length),
            digits((length / model.sample_time).ceil()),
            digits(present)
        ),
        None => print_line!("\nNo entry is known well enough for an advice."),
    }
    if planned.iter().any(Planned::is_near_zero) {
        error_line!(
            "Entries of unknown length are within {NEAR_ZERO} standard errors of 0. Fix them in the structure, excite the plant \
             more, or plan again after a longer record."
        );
    }
    Ok(())
}

/// The entries of A and B; a constant of a record belongs to that record.
fn planned(model: &Model, present: f64, target: f64) -> Result<Vec<Planned<'_>>, Invalid> {
    let count = model.free.len();
    if model.covariance.len() != count || model.covariance.iter().any(|row| row.len() != count) {
        let allowed = format!("must be {count} × {count}, as many as `free` has entries");
        return Err(Invalid::new("covariance", format!("{} rows", model.covariance.len()), allowed));
    }
    if !(present > 0.0 && present.is_finite()) {
        return Err(Invalid::new("records", report::number(present), "must have a length above 0 s together"));
    }
    let of_plant = model.free.iter().enumerate().filter(|(_, Free(matrix, ..))| matrix == "A" || matrix == "B");
    of_plant
        .map(|(k, entry)| {
            let Free(matrix, row, column) = entry;
            let rows = if matrix == "A" { &model.A } else { &model.B };
            let found = row.checked_sub(1).zip(column.checked_sub(1));
            let value = found.and_then(|(i, j)| rows.get(i)?.get(j)).copied();
            let variance = model.covariance[k][k];
            let Some(value) = value.filter(|value| value.is_finite() && variance >= 0.0 && variance.is_finite()) else {
                let allowed = "must be an entry with a finite value and a variance that is at least 0";
                return Err(Invalid::new("free", written(entry), allowed));
            };
            let error = variance.sqrt();
            let length = if error == 0.0 { 0.0 } else { present * (error / (target * value)).powi(2) };
            Ok(Planned { entry, value, error, length })
        })
        .collect()
}

fn in_json(planned: &[Planned], (present, target): (f64, f64), sure: Option<f64>) -> serde_json::Value {
    let of = |of: &Planned| {
        let length = Some(of.length).filter(|_| !of.is_near_zero());
        json!({ "entry": of.entry, "value": of.value, "error": of.error, "length": length })
    };
    json!({ "target": target, "present": present, "entries": planned.iter().map(of).collect::<Vec<_>>(), "length": sure })
}

/// A number with four digits, in full.
fn digits(value: f64) -> String {
    number(format!("{value:.3e}").parse().unwrap_or(value))
}
