//! `check`: what a designer should know of a description before exporting it.

use std::path::PathBuf;
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library};
use adaptive_fmu::report::{DesignReport, Finding, Verdict};
use serde_json::json;

/// Columns of names, and of values where the note stands beside them.
const NAME: usize = 34;
const VALUE: usize = 30;

#[derive(clap::Args)]
pub struct Arguments {
    /// Description file (NAME.toml), or FMU of this package
    name: String,
    /// Shared library that contains the model [default: the one built with this program]
    #[arg(long)]
    library: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints the report; the exit code tells whether the design is sound.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { name, library, json } = arguments;
    let library = library.as_deref().map_or_else(Library::beside_program, Library::open)?;
    let (unit, _) = exporter::describe(&exporter::find_description(name)?, &library)?;
    if *json {
        let DesignReport { step, findings, .. } = &unit.report;
        let (verdict, sound) = (unit.report.verdict(), unit.report.is_sound());
        let report = json!({ "name": unit.name, "verdict": verdict, "sound": sound, "step": step, "findings": findings,
                    "summary": unit.report.summary, "text": told(&unit.name, &unit.report) });
        say!("{report}");
    } else {
        say!("{}", told(&unit.name, &unit.report));
    }
    Ok(exit_code(&unit.report))
}

/// 0 of a sound design, with warnings too; 3 of one that isn't.
pub fn exit_code(report: &DesignReport) -> ExitCode {
    if report.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(3) }
}

/// The report in lines.
fn told(name: &str, report: &DesignReport) -> String {
    if report.findings.is_empty() {
        return format!("{name}: all values are within their limits; there is nothing else to check");
    }
    let reason = report.reason().map_or(String::new(), |reason| format!(": {reason}"));
    // What was tried with a plant is sound, where else nothing speaks against it.
    let verdict = match report.verdict() {
        Verdict::Ok if report.summary.is_some() => "sound",
        verdict => verdict.text(),
    };
    let summary = report.summary.as_ref().map_or(String::new(), |summary| format!(": {summary}"));
    let mut lines = vec![format!("{name}: {verdict}{summary}{reason}")];
    let mut section = None;
    for finding in &report.findings {
        if section != Some(&finding.section) {
            lines.push(format!("\n{}", finding.section));
            section = Some(&finding.section);
        }
        lines.extend(finding_lines(finding));
    }
    lines.join("\n")
}

fn finding_lines(Finding { name, value, unit, verdict, note, .. }: &Finding) -> Vec<String> {
    let lines = value.lines();
    let line = |(k, line): (usize, &String)| {
        let name = if k == 0 { name.as_str() } else { "" };
        let value = format!("{line} {unit}");
        let beside = if k == 0 && *verdict == Verdict::Ok { note.as_str() } else { "" };
        format!("  {name:NAME$} {value:VALUE$} {beside}").trim_end().to_owned()
    };
    let mut told: Vec<_> = lines.iter().enumerate().map(line).collect();
    if *verdict != Verdict::Ok {
        told.push(format!("    {}: {note}", verdict.text()));
    }
    told
}
