//! `compare`: several closed loops on one page.

use std::path::PathBuf;
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::parallel;
use adaptive_fmu::simulation::{Comparison, Verdict};
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::progress::Bars;
use super::run::{self, Run, exit_code};

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
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Runs the loops on all cores, each as it is run alone, and writes a page of what all of them measure.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { names, out, options, json } = arguments;
    let bars = Bars::new(*json);
    let one = |place: usize| run::run(&run::Arguments::with(&names[place], options, out, *json), &names[place], &bars);
    let runs = parallel::each(&vec![(); parallel::cores()], names.len(), |(), place| one(place));
    let runs = runs.into_iter().collect::<Result<Vec<Run>, Error>>()?;
    let comparison = Comparison { runs: runs.iter().map(Run::report).collect() };
    let folder = out.join("comparison");
    std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
    let page = folder.join("index.html");
    let html = comparison.html().map_err(|reason| Error::Loop { file: folder.clone(), reason })?;
    std::fs::write(&page, html).map_err(Error::file(&page))?;
    if *json {
        let told: Vec<Value> = runs.iter().map(Run::told).collect();
        println!("{}", json!({ "loops": told, "page": page }));
    } else {
        print!("{}", comparison.table());
        println!("the page with the diagrams of all is {}", page.display());
    }
    for report in &comparison.runs {
        if let Some(shortfall) = report.shortfall() {
            eprintln!("{} {shortfall}", report.structure.name);
        }
    }
    let verdicts = comparison.runs.iter().map(adaptive_fmu::simulation::Report::verdict);
    Ok(exit_code(verdicts.max().unwrap_or(Verdict::Holds)))
}
