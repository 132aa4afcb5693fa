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
    /// A description (NAME.toml), or an FMU of this package
    name: String,
    /// Shared library that holds the model, instead of the one built with this program
    #[arg(long)]
    library: Option<PathBuf>,
    /// As JSON
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
        let report =
            json!({ "name": unit.name, "verdict": verdict, "sound": sound, "step": step, "findings": findings });
        say!("{report}");
    } else {
        print(&unit.name, &unit.report);
    }
    Ok(if unit.report.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(3) })
}

fn print(name: &str, report: &DesignReport) {
    if report.findings.is_empty() {
        say!("{name}: nothing to check beyond the description's own limits, which it keeps");
        return;
    }
    say!("{name}: {}", report.verdict().text());
    let mut section = None;
    for finding in &report.findings {
        if section != Some(&finding.section) {
            say!("\n{}", finding.section);
            section = Some(&finding.section);
        }
        print_finding(finding);
    }
}

fn print_finding(Finding { name, value, unit, verdict, note, .. }: &Finding) {
    let lines = value.lines();
    for (k, line) in lines.iter().enumerate() {
        let name = if k == 0 { name.as_str() } else { "" };
        let value = format!("{line} {unit}");
        let beside = if k == 0 && *verdict == Verdict::Ok { note.as_str() } else { "" };
        say!("{}", format!("  {name:NAME$} {value:VALUE$} {beside}").trim_end());
    }
    if *verdict != Verdict::Ok {
        say!("    {}: {note}", verdict.text());
    }
}
