//! `validate`: whether an FMU is what the standard asks for.

use std::path::PathBuf;
use std::process::ExitCode;

use adaptive_fmu::error::{Error, one_line};
use adaptive_fmu::related::{Deviation, Replayed, short};
use adaptive_fmu::validation::{self, Report, Severity, Trial};
use serde_json::json;

use super::hosting::HostingOptions;

/// It was checked, and isn't sound.
const UNSOUND: u8 = 3;

#[derive(clap::Args)]
pub struct Arguments {
    /// FMU archive
    fmu: PathBuf,
    /// Check only what can be seen without running the FMU
    #[arg(long)]
    no_run: bool,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Prints a line for each finding; the exit code is 3 if one is an error.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let hosting = Some(arguments.hosting.hosting()?);
    let report = validation::validate(&arguments.fmu, hosting.as_ref().filter(|_| !arguments.no_run))?;
    let (errors, warnings) = (report.findings.count(Severity::Error), report.findings.count(Severity::Warning));
    if arguments.json {
        let output = json!({ "sound": report.is_sound(), "errors": errors, "warnings": warnings,
                           "findings": report.findings.listed(), "run": ran(&report.trial), "experiments": report.replayed });
        print_line!("{output}");
    } else {
        print(&arguments.fmu.display().to_string(), &report, errors, warnings);
    }
    Ok(if report.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(UNSOUND) })
}

fn print(fmu: &str, report: &Report, errors: usize, warnings: usize) {
    let listed = report.findings.listed();
    listed.iter().for_each(|finding| print_line!("{finding}"));
    if errors + warnings > listed.len() {
        print_line!("… and {} more", errors + warnings - listed.len());
    }
    for Replayed { experiment, tolerance, outputs } in &report.replayed {
        let allowed = tolerance.map_or(String::new(), |tolerance| format!(" of {tolerance:e} allowed"));
        for Deviation { output, largest, time, .. } in outputs {
            let largest = short(*largest);
            let line = format!("experiment {experiment}: {output} deviates by {largest}{allowed}, at {time} s");
            print_line!("{}", one_line(&line));
        }
    }
    let verdict = if report.is_sound() { "sound" } else { "not sound" };
    let ran = one_line(&ran(&report.trial));
    print_line!("{}: {verdict}, errors: {errors}, warnings: {warnings}; {ran}", one_line(fmu));
}

fn ran(trial: &Trial) -> String {
    match trial {
        Trial::Ran(steps) => format!("run for {steps} steps"),
        Trial::NotAskedFor => "not run".to_owned(),
        Trial::Unsound => "not run, because it is not sound".to_owned(),
        Trial::Impossible(reason) => format!("not run: {reason}"),
    }
}
