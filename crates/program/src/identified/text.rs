//! An identification as text: its model, and what was found.

use adaptive_fmu_identification::{Finding, Free, Identified, Kind, Model, Verdict};

use crate::error::{Error, Invalid};
use crate::report::{self, number};

/// Options that help where something was found.
fn of_kind(kind: Kind) -> Option<&'static str> {
    match kind {
        Kind::Delay => Some("--delay gives dead times"),
        Kind::Unseen | Kind::ShortRecord | Kind::Kinematics => Some("--structure gives known entries"),
        _ => None,
    }
}

/// The text of a model's file.
pub fn text_of(model: &Model) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(model).map_err(|error| Error::Argument(Invalid::because(error)))?;
    Ok(format!("{text}\n"))
}

/// Fits, entries, poles and findings of an identification, a line each; with options of `identify` that help, if wanted.
pub fn lines(found: &Identified, with_options: bool) -> Vec<String> {
    let model = &found.model;
    let mut lines = Vec::new();
    let mut add = |line: String| lines.push(line);
    let measured = if model.outputs.is_empty() { &model.states } else { &model.outputs };
    add(format!("{:24} {:>10} {:>10} {:>12}", "fit of the held-out part", "whole, %", "windows, %", "noise"));
    for (k, name) in measured.iter().enumerate() {
        let of = |fits: &[f64]| {
            fits.get(k)
                .filter(|fit| !fit.is_nan())
                .map_or("–".to_owned(), |fit| report::number((fit * 10.0).round() / 10.0))
        };
        let noise = model.noise.get(k).map_or("–".to_owned(), |noise| number(*noise));
        add(format!("{name:24} {:>10} {:>10} {noise:>12}", of(&model.fit.held_out), of(&model.fit.windows)));
    }
    add(format!("\n{:24} {:>14} {:>14}", "entry", "value", "std. error"));
    for entry in &found.entries {
        let place = format!("{}  {}", written(&entry.entry), meaning(&entry.entry, model));
        add(format!("{place:24} {:>14} {:>14}", number(entry.value), number(entry.error)));
    }
    add(format!("\n{:24} {:>14} {:>14}", "pole, 1/s", "", "std. error"));
    for pole in found.poles.iter().filter(|pole| pole.imaginary >= 0.0) {
        let imaginary = if pole.imaginary > 0.0 { format!(" ± {}j", number(pole.imaginary)) } else { String::new() };
        add(format!("{:39} {:>14}", format!("{}{imaginary}", number(pole.real)), number(pole.error())));
    }
    if !model.disturbance.is_empty() {
        add(format!("\n{:24} {:>14}", "beyond the model", "at most"));
        model
            .inputs
            .iter()
            .zip(&model.disturbance)
            .for_each(|(name, most)| add(format!("as {name:21} {:>14}", number(*most))));
        let rates = model.states.iter().zip(&found.unmatched).filter(|(_, most)| **most > 0.0);
        rates.for_each(|(name, most)| add(format!("{:24} {:>14}", format!("{name}', by no input"), number(*most))));
    }
    add(format!("\nmethod: {}", model.method));
    found.findings.iter().for_each(|finding| add(finding_text(finding, with_options)));
    lines
}

/// A finding in words.
pub fn finding_text(finding: &Finding, with_options: bool) -> String {
    let verdict = match finding.verdict {
        Verdict::Note => "note",
        Verdict::Warning => "warning",
        Verdict::NotSound => "not sound",
    };
    let advice = of_kind(finding.kind).filter(|_| with_options).map_or(String::new(), |advice| format!(" ({advice})"));
    format!("{verdict}: {}{advice}", finding.text)
}

/// The name of an entry, `A[1,2]`.
pub fn written(Free(matrix, row, column): &Free) -> String {
    format!("{matrix}[{row},{column}]")
}

/// Names of the signals that an entry relates, as `speed' / current`.
pub fn meaning(Free(matrix, row, column): &Free, model: &Model) -> String {
    let name = |names: &[String], place: usize| names.get(place - 1).cloned().unwrap_or_default();
    let (state, from) = (name(&model.states, *row), if matrix == "A" { &model.states } else { &model.inputs });
    match matrix.as_str() {
        "A" | "B" if !state.is_empty() => format!("{state}' / {}", name(from, *column)),
        _ if !state.is_empty() => format!("{state}' in record {column}"),
        _ => String::new(),
    }
}
