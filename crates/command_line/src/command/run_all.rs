//! `run --all`: every closed loop of this package.

use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::parallel;
use adaptive_fmu::results::{Row, Verdict, table};
use adaptive_fmu::structure::LoopFiles;
use serde_json::{Value, json};

use super::progress::{self, Bars};
use super::ready;
use super::run::{Arguments, exit_code, run};

/// A loop's row, and all that is known of it.
struct Tried {
    row: Row,
    json: Value,
}

/// Runs the loops on all cores, each as `run` does, and prints a table of them.
pub fn execute(options: &Arguments) -> ExitCode {
    let tried = on_all_cores(options);
    let (rows, output): (Vec<Row>, Vec<Value>) = tried.into_iter().map(|tried| (tried.row, tried.json)).unzip();
    if options.json {
        print_line!("{}", json!({ "loops": output }));
    } else {
        print_line!("{}", table(&rows));
        aside!("results of each loop: {}/LOOP", options.out().display());
    }
    exit_code(rows.iter().map(|row| row.verdict).max().unwrap_or(Verdict::Holds))
}

fn on_all_cores(options: &Arguments) -> Vec<Tried> {
    let (loops, bars) = (exporter::loops(), Bars::new(options.json));
    // Created once for all loops. If that fails, each loop reports the reason.
    let _units = ready::units();
    let effort = |name: &str| Ok::<_, Error>(options.options.effort(&LoopFiles::find(name)?.structure()?));
    let efforts: Vec<f64> = loops.iter().map(|(name, _)| effort(name).unwrap_or_default()).collect();
    let workers = vec![(); parallel::cores()];
    parallel::longest_first(&workers, &efforts, |(), place| attempt(options, loops[place].0, &bars))
}

/// Runs a loop; a failure is reported, and the others go on.
fn attempt(options: &Arguments, name: &str, bars: &Bars) -> Tried {
    if progress::is_interrupted() {
        return without_run(Row::without_run(name, Verdict::Interrupted, "not started"), "not started");
    }
    let failed = |error: Error| {
        bars.print(&format!("error: {name}: {error}"));
        without_run(Row::without_run(name, Verdict::Failed, "could not be run"), &error.to_string())
    };
    let done = match run(options, name, bars) {
        Ok(done) => done,
        Err(error) => return failed(error),
    };
    let row = Row::new(name, &done.report(), done.took);
    let mut output = done.to_json();
    output["verdict"] = json!(row.verdict.word());
    if let Some(error) = &done.failure {
        output["error"] = json!(error.to_string());
        if row.verdict == Verdict::Failed {
            bars.print(&format!("error: {name}: {error}"));
        }
    }
    Tried { row, json: output }
}

fn without_run(row: Row, reason: &str) -> Tried {
    let output = json!({ "loop": row.name, "verdict": row.verdict.word(), "metrics": [], "error": reason });
    Tried { row, json: output }
}
