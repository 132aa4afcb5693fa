//! `run`: a closed loop through its FMUs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use adaptive_fmu::error::Error;
use adaptive_fmu::figures::{Diagram, terminal};
use adaptive_fmu::output;
use adaptive_fmu::results::{
    Ended, Ending, METRICS, Measured, Provenance, Recorder, Report, TABLE, TablePlace, Tabled, Thinned, UnitMark,
    Verdict, four_digits,
};
use adaptive_fmu::simulation::Recording;
use adaptive_fmu::structure::{LoopFiles, Settings, Structure};
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::open::OpenOption;
use super::progress::{self, Bars, Progress};
use super::results::{NAMES, PAGE, PLOT, TableOptions, tag, write_results};
use super::{again, run_all, serve};
use crate::console;

/// A metric beyond its limit.
const BEYOND_LIMIT: u8 = 3;
pub const RESULTS: &str = "results";

#[derive(clap::Args)]
pub struct Arguments {
    /// Loop of this package, or SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP", required_unless_present_any = ["all", "again"])]
    pub name: Option<String>,
    /// Repeat an earlier run with the settings stored in its results, and report the differences.
    ///
    /// Results go to LOOP@again next to the earlier ones, unless --tag or --out is given.
    #[arg(long, value_name = "RESULTS", conflicts_with_all = ["name", "all", "case", "set", "event", "composite", "fmus", "step",
        "until", "order", "accept_algebraic_loops", "in_process", "patience"])]
    pub again: Option<PathBuf>,
    /// Run all loops of this package and print a table of them
    #[arg(long, conflicts_with_all = ["name", "case", "set", "event", "open"])]
    pub all: bool,
    /// Structure in an .ssp archive with several of them, NAME.ssd [default: SystemStructure.ssd, or else the only one]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["all", "again"])]
    pub variant: Option<String>,
    /// Folder for results [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Store the results in LOOP@NAME, next to those of other runs
    #[arg(long, value_name = "NAME", value_parser = tag)]
    pub tag: Option<String>,
    #[command(flatten)]
    pub tables: TableOptions,
    #[command(flatten)]
    pub options: LoopOptions,
    #[command(flatten)]
    pub open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    pub json: bool,
}

impl Arguments {
    /// A loop as it is, through the FMUs in a folder.
    pub fn of(name: &str, fmus: &Path, json: bool) -> Self {
        let options = LoopOptions { fmus: Some(fmus.to_owned()), ..LoopOptions::default() };
        Self::with(name, &options, None, None, json)
    }

    /// A loop with options, its results in a folder, under a tag.
    pub fn with(name: &str, options: &LoopOptions, out: Option<&Path>, tag: Option<String>, json: bool) -> Self {
        let (name, out, options) = (Some(name.to_owned()), out.map(Path::to_owned), options.clone());
        let (tables, open) = (TableOptions::default(), OpenOption::default());
        Arguments { name, again: None, all: false, variant: None, out, tag, tables, options, open, json }
    }

    /// Folder of the results.
    pub fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(RESULTS))
    }
}

/// Runs a closed loop, or all, and prints the results.
pub fn execute(options: &Arguments) -> Result<ExitCode, Error> {
    if let Some(folder) = &options.again {
        return again::execute(options, folder);
    }
    let Some(name) = &options.name else { return Ok(run_all::execute(options)) };
    let variant = options.variant.as_ref().map(|variant| format!("{name}/{}.ssd", variant.trim_end_matches(".ssd")));
    let name = variant.as_ref().unwrap_or(name);
    finish(run(options, name, &Bars::new(options.json))?, options.json, options.open, None)
}

/// Prints the results of a run, with something further in its JSON.
pub fn finish(done: Run, json: bool, open: OpenOption, further: Option<(&str, Value)>) -> Result<ExitCode, Error> {
    if console::serves() {
        serve::send(&done.recording, about(&done.report(), done.folder.as_deref()));
    }
    if let Some(error) = done.failure {
        if let Some(folder) = &done.folder {
            error_line!("results until then are in {}", folder.display());
        }
        return Err(error);
    }
    print(&done, json, further).map_err(|reason| Error::Loop { file: done.structure.file.clone(), reason })?;
    if let Some(folder) = &done.folder {
        open.show(&folder.join(PAGE));
    }
    Ok(exit_code(done.report().verdict()))
}

pub fn exit_code(verdict: Verdict) -> ExitCode {
    match verdict {
        Verdict::Holds => ExitCode::SUCCESS,
        Verdict::Beyond => ExitCode::from(BEYOND_LIMIT),
        Verdict::Failed => ExitCode::FAILURE,
        Verdict::Interrupted => ExitCode::from(progress::INTERRUPTED),
    }
}

/// A run whose results are written.
pub struct Run {
    /// Origin of its numbers.
    pub provenance: Provenance,
    structure: Structure,
    settings: Settings,
    whole: bool,
    recording: Recording,
    measured: Vec<Measured>,
    ending: Ending,
    /// Recorded points and table of a run too long for the memory.
    thinned: Option<Thinned>,
    tabled: Option<Tabled>,
    /// Folder of its results, if it has any.
    pub folder: Option<PathBuf>,
    /// Reason why it did not reach its end.
    pub failure: Option<Error>,
    /// Duration of the simulation.
    pub took: Duration,
}

impl Run {
    pub fn report(&self) -> Report<'_> {
        let Run { structure, settings, whole, recording, measured, ending, thinned, .. } = self;
        Report { structure, settings: *settings, whole: *whole, recording, measured, ending, thinned: *thinned }
    }

    /// JSON for scripts.
    pub fn to_json(&self) -> Value {
        json!({ "loop": self.structure.name, "ended": self.ending.word(), "metrics": self.measured,
                "warnings": self.recording.warnings, "results": self.folder.as_deref().map(console::path), "seconds": self.took.as_secs_f64() })
    }
}

/// JSON about a run for a program that is served: settings, results and diagrams.
pub fn about(report: &Report, results: Option<&Path>) -> Value {
    let Report { structure, settings, whole, measured, ending, .. } = report;
    let (Settings { start_time, stop_time, step }, order) = (settings, structure.order);
    let plots: Vec<Value> = report.diagrams().unwrap_or_default().iter().map(Diagram::without_points).collect();
    json!({ "name": structure.name, "description": structure.description, "ended": ending.word(),
            "metrics": measured, "results": results.map(console::path), "plots": plots,
            "settings": { "start_time": start_time, "stop_time": stop_time, "step": step,
                          "order": (!whole).then(|| order.to_string()), "composite": whole,
                          "values": structure.all_values() } })
}

/// Runs a closed loop and writes its results, also if an FMU's failure ended the run. A run without a step has no
/// results, and those of an earlier run stay. If a run is too long for the memory, only the points to be drawn stay in
/// memory.
pub fn run(arguments: &Arguments, name: &str, bars: &Bars) -> Result<Run, Error> {
    // A program that is served is sent all points.
    written(arguments, name, bars, !console::serves())
}

/// The same, with all points in memory however long the run is.
pub fn run_whole(arguments: &Arguments, name: &str, bars: &Bars) -> Result<Run, Error> {
    written(arguments, name, bars, false)
}

fn written(arguments: &Arguments, name: &str, bars: &Bars, in_blocks: bool) -> Result<Run, Error> {
    let Arguments { tables, tag, .. } = arguments;
    let out = serve::folder(arguments.out.as_deref(), RESULTS);
    let results = Results { out, tag: tag.as_deref(), tables: in_blocks.then_some(tables) };
    let mut done = simulated(&arguments.options, name, results, &[], bars)?;
    if let Some(out) = out.filter(|_| done.recording.times.len() > 1) {
        let tabled = done.tabled.take();
        write_results(&done.report(), Some(&done.provenance), tables, out, tabled)?;
        done.folder = Some(out.join(&done.structure.name));
    }
    Ok(done)
}

/// Folder for the results of a run, which is not run.
pub fn place(arguments: &Arguments, name: &str) -> Result<PathBuf, Error> {
    Ok(place_of(arguments, &LoopFiles::find(name)?.structure()?))
}

/// Folder for the results of a run of this loop.
pub fn place_of(arguments: &Arguments, structure: &Structure) -> PathBuf {
    arguments.out().join(own_name(structure, arguments.options.composite, arguments.tag.as_deref()))
}

/// The name of a run's results.
fn own_name(structure: &Structure, whole: bool, tag: Option<&str>) -> String {
    let (form, tag) = (if whole { "-composite" } else { "" }, tag.map(|tag| format!("@{tag}")));
    format!("{}{form}{}", structure.name, tag.unwrap_or_default())
}

/// Destination of a run's results.
#[derive(Clone, Copy, Default)]
pub struct Results<'a> {
    /// The folder for the results of all loops.
    pub out: Option<&'a Path>,
    /// Tag of this run's results.
    pub tag: Option<&'a str>,
    /// Options for the table of a run that is too long for the memory; none if all its points stay in memory.
    pub tables: Option<&'a TableOptions>,
}

/// Runs a closed loop; further signals are recorded in addition to those that it names. It writes no results, but
/// refuses a folder that can't take them before it runs.
pub fn simulated(
    options: &LoopOptions,
    name: &str,
    results: Results,
    further: &[&str],
    bars: &Bars,
) -> Result<Run, Error> {
    let Results { out, tag, tables } = results;
    let files = LoopFiles::find(name)?;
    let mut structure = options.structure(&files)?;
    let settings = options.settings(&structure)?;
    let whole = options.composite;
    let own_name = own_name(&structure, whole, tag);
    if let Some(out) = out {
        output::check(out, &own_name, &NAMES)?;
    }
    let loaded = options.units(&structure)?.load(&structure, &options.hosting.hosting()?)?;
    let loaded = loaded.recording(further.iter().copied());
    structure.order = loaded.order();
    let Settings { start_time, stop_time, step } = settings;
    let order = if whole { "as a single FMU".to_owned() } else { structure.order.to_string() };
    detail!("{}: from {start_time} s to {stop_time} s in steps of {step} s, {order}", structure.name);
    let origins = loaded.origins();
    origins.iter().for_each(|unit| detail!("{}: {unit}", structure.name));
    let mut provenance = options.provenance(name, &files, &structure, settings, &loaded)?;
    let closed = loaded.instantiate(&[])?;
    let place = |(out, tables): (_, &TableOptions)| {
        let TableOptions { every, parquet } = *tables;
        TablePlace { out, below: &own_name, every, parquet }
    };
    let mut recorder = Recorder::new(&structure, settings, closed.names().len(), out.zip(tables).map(place));
    let begun = Instant::now();
    let (mut recording, ending, failure) = Progress::new(bars, name, settings)
        .watch(|go_on| closed.run_in_blocks(settings, recorder.block(), |block| recorder.take(block), go_on));
    let took = begun.elapsed().saturating_sub(recorder.took());
    UnitMark::note_evaluated(&mut provenance.units, &loaded);
    let news = loaded.origins().into_iter().filter(|unit| !origins.contains(unit));
    news.for_each(|unit| detail!("{}: {unit}", structure.name));
    recording.details.iter().for_each(|text| detail!("{}: {text}", structure.name));
    let Ended { measured, thinned, table: tabled } = recorder.end(&mut recording)?;
    structure.name = own_name;
    let folder = None;
    Ok(Run {
        provenance,
        structure,
        settings,
        whole,
        recording,
        measured,
        ending,
        thinned,
        tabled,
        folder,
        failure,
        took,
    })
}

fn print(done: &Run, json: bool, further: Option<(&str, Value)>) -> Result<(), String> {
    let Run { structure, recording, measured, folder, .. } = done;
    if let Some(shortfall) = done.report().shortfall() {
        let place = folder.as_ref().map(|folder| format!("; results until then are in {}", folder.display()));
        error_line!("the run {shortfall}{}", place.unwrap_or_default());
    }
    if json {
        let mut output = done.to_json();
        further.into_iter().for_each(|(key, value)| output[key] = value);
        print_line!("{output}");
        return Ok(());
    }
    if let Some(plot) = structure.plots.first().filter(|_| console::is_seen()) {
        print_line!("{}", terminal(plot, recording)?);
    }
    print_line!("{:44} {:>12} {:>10}", structure.name, "measured", "limit");
    for Measured { label, value, limit } in measured {
        let value = value.map_or("–".to_owned(), four_digits);
        print_line!("{label:44} {value:>12} {:>10}", limit.map_or(String::new(), |limit| format!("{limit}")));
    }
    recording.warnings.iter().for_each(|warning| aside!("warning: {warning}"));
    if let Some(folder) = folder {
        aside!("{PAGE} (the report), {TABLE}, {METRICS} and {PLOT} are in {}", folder.display());
    }
    Ok(())
}
