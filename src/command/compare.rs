//! `compare`: several closed loops on one page.

use std::path::PathBuf;
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::simulation::{Comparison, Verdict};
use adaptive_fmu::{output, parallel};
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::open::OpenOption;
use super::progress::{self, Bars};
use super::run::{self, Run, exit_code};
use crate::console;

/// Where the common page goes.
const FOLDER: &str = "comparison";
const PAGE: &str = "index.html";

#[derive(clap::Args)]
pub struct Arguments {
    /// Loops of this package, or SSPs
    #[arg(value_name = "LOOP", required = true, num_args = 2..)]
    names: Vec<String>,
    /// Folder for results: each loop's own, and the common page in comparison/
    #[arg(long, default_value = "results")]
    out: PathBuf,
    #[command(flatten)]
    options: LoopOptions,
    #[command(flatten)]
    open: OpenOption,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Runs the loops on all cores, each as it is run alone, and writes a page of what all of them measure.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { names, out, options, open, json } = arguments;
    // What is wrong with one of them is found before any of them runs.
    names.iter().try_for_each(|name| options.check(name))?;
    output::check(out, FOLDER, &[PAGE])?;
    let bars = Bars::new(*json);
    let one = |place: usize| run::run(&run::Arguments::with(&names[place], options, out, *json), &names[place], &bars);
    let runs = parallel::each(&vec![(); parallel::cores()], names.len(), |(), place| one(place));
    let mut runs = runs.into_iter().collect::<Result<Vec<Run>, Error>>()?;
    // With one that made no step there is nothing to compare, and what an earlier comparison left stays.
    if let Some(without) = runs.iter_mut().find(|run| run.folder.is_none()) {
        let interrupted = Ok(ExitCode::from(progress::INTERRUPTED));
        return without.failure.take().map_or(interrupted, Err);
    }
    let comparison = Comparison { runs: runs.iter().map(Run::report).collect() };
    let page = out.join(FOLDER).join(PAGE);
    let html = comparison.html().map_err(|reason| Error::Loop { file: page.clone(), reason })?;
    let mut files = output::Files::within(out, FOLDER)?;
    files.add(PAGE, html)?;
    files.place()?;
    if *json {
        let told: Vec<Value> = runs.iter().map(Run::told).collect();
        say!("{}", json!({ "loops": told, "page": page }));
    } else {
        console::text(&comparison.table());
        aside!("the page with the diagrams of all is {}", page.display());
    }
    open.show(&page);
    for report in &comparison.runs {
        if let Some(shortfall) = report.shortfall() {
            tell!("{} {shortfall}", report.structure.name);
        }
    }
    let verdicts = comparison.runs.iter().map(adaptive_fmu::simulation::Report::verdict);
    Ok(exit_code(verdicts.max().unwrap_or(Verdict::Holds)))
}
