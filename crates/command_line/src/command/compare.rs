//! `compare`: several closed loops on one page.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::results::{Comparison, RecordedRun, Report, Verdict};
use adaptive_fmu::structure::LoopFiles;
use adaptive_fmu::{output, parallel};
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::open::OpenOption;
use super::progress::{self, Bars};
use super::results;
use super::run::{self, Run, exit_code};
use super::specification::{Labelled, Specification};
use crate::console;

/// Folder of the common page.
const FOLDER: &str = "comparison";
const PAGE: &str = "index.html";

#[derive(clap::Args)]
pub struct Arguments {
    /// Two or more of: LOOP, LOOP@FILE.ssv, LOOP:name=value,name=value, folder of earlier results.
    ///
    /// LOOP is a loop of this package or an SSP. @FILE.ssv applies a parameter set. :name=value sets a value of a
    /// component, where name is UNIT.variable. UNIT may be omitted if only one component has such a variable. LABEL=
    /// before any of these names the run in tables and diagrams, as in warm=LOOP:plant.mass=2.
    #[arg(value_name = "RUN", required = true, num_args = 2..)]
    runs: Vec<Labelled>,
    /// Folder for the results of each loop and for the common page in comparison/
    #[arg(long, default_value = "results")]
    out: PathBuf,
    #[command(flatten)]
    options: LoopOptions,
    #[command(flatten)]
    open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A run to be compared.
enum Compared {
    Made(Box<Run>),
    Earlier(Box<RecordedRun>, PathBuf),
}

impl Compared {
    fn report(&self) -> Report<'_> {
        match self {
            Compared::Made(run) => run.report(),
            Compared::Earlier(run, _) => run.report(),
        }
    }

    fn to_json(&self, label: &str) -> Value {
        let mut output = match self {
            Compared::Made(run) => run.to_json(),
            Compared::Earlier(run, folder) => {
                let Report { structure, measured, ending, recording, .. } = run.report();
                json!({ "loop": structure.name, "ended": ending.word(), "metrics": measured,
                        "warnings": recording.warnings, "results": console::path(folder), "seconds": null })
            }
        };
        output["label"] = label.into();
        output
    }
}

/// Runs the loops on all cores, each as `run` does, and writes a page with the measurements of all of them.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { runs, out, options, open, json } = arguments;
    output::check(out, FOLDER, &[PAGE])?;
    let bars = Bars::new(*json);
    // All of them are checked before anything runs.
    let planned = runs.iter().map(|it| it.run.options(options)).collect::<Result<Vec<_>, Error>>()?;
    for (run, options) in runs.iter().zip(&planned) {
        run.run.name().map_or(Ok(()), |name| options.check(name))?;
    }
    require_places_of_their_own(runs, &planned, out)?;
    let labels = runs;
    let one = |place: usize| match &runs[place].run {
        Specification::Results(folder) => {
            Ok(Compared::Earlier(Box::new(results::earlier(folder)?.run()?), folder.clone()))
        }
        Specification::Loop { name, .. } => {
            let arguments = run::Arguments::with(name, &planned[place], Some(out), runs[place].tag(), *json);
            Ok(Compared::Made(Box::new(run::run_whole(&arguments, name, &bars)?)))
        }
    };
    let runs = parallel::each(&vec![(); parallel::cores()], runs.len(), |(), place| one(place));
    let mut runs = runs.into_iter().collect::<Result<Vec<Compared>, Error>>()?;
    // With one that made no step there is nothing to compare, and what an earlier comparison left stays.
    let without = runs.iter_mut().find_map(|run| match run {
        Compared::Made(run) if run.folder.is_none() => Some(run),
        _ => None,
    });
    if let Some(without) = without {
        let interrupted = Ok(ExitCode::from(progress::INTERRUPTED));
        return without.failure.take().map_or(interrupted, Err);
    }
    let label = |(run, Labelled { label, .. }): (&Compared, &Labelled)| {
        label.clone().unwrap_or_else(|| run.report().structure.name.clone())
    };
    let labels: Vec<String> = runs.iter().zip(labels).map(label).collect();
    let comparison = Comparison { runs: runs.iter().map(Compared::report).collect(), labels };
    let page = out.join(FOLDER).join(PAGE);
    let html = comparison.html().map_err(|reason| Error::Loop { file: page.clone(), reason })?;
    let mut files = output::Files::within(out, FOLDER)?;
    files.add(PAGE, html)?;
    files.place()?;
    if *json {
        let loops: Vec<Value> = runs.iter().zip(&comparison.labels).map(|(run, label)| run.to_json(label)).collect();
        print_line!("{}", json!({ "loops": loops, "page": console::path(&page) }));
    } else {
        console::text(&comparison.table());
        aside!("page with all plots: {}", page.display());
    }
    open.show(&page);
    for (report, label) in comparison.runs.iter().zip(&comparison.labels) {
        if let Some(shortfall) = report.shortfall() {
            error_line!("{label} {shortfall}");
        }
    }
    let verdicts = comparison.runs.iter().map(adaptive_fmu::results::Report::verdict);
    Ok(exit_code(verdicts.max().unwrap_or(Verdict::Holds)))
}

/// Refuses runs that would leave their results in the same place, or in that of results that are compared.
fn require_places_of_their_own(runs: &[Labelled], planned: &[LoopOptions], out: &Path) -> Result<(), Error> {
    let (mut places, mut labels) = (HashSet::new(), HashSet::new());
    for (run, options) in runs.iter().zip(planned) {
        if let Some(label) = run.label.as_ref().filter(|label| !labels.insert(label.as_str())) {
            let reason = "two runs have this label. Give each its own".to_owned();
            return Err(Error::Loop { file: label.into(), reason });
        }
        let (shown, place) = match &run.run {
            Specification::Results(folder) => (folder.display().to_string(), folder.clone()),
            Specification::Loop { name, .. } => {
                let structure = LoopFiles::find(name)?.structure()?;
                let arguments = run::Arguments::with(name, options, Some(out), run.tag(), false);
                (name.clone(), run::place_of(&arguments, &structure))
            }
        };
        let place = place.canonicalize().unwrap_or(place);
        if !places.insert(place.clone()) {
            let reason = format!("two runs would have their results in {}. Name each run once", place.display());
            return Err(Error::Loop { file: shown.into(), reason });
        }
    }
    Ok(())
}
