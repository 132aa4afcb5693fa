//! `run`: a closed loop through its FMUs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use adaptive_fmu::error::Error;
use adaptive_fmu::output::{self, Files};
use adaptive_fmu::simulation::{Diagram, Ending, LoopFiles, Measured, Recording, Report, Settings, Structure, Verdict};
use adaptive_fmu::simulation::{measure, svg, terminal};
use adaptive_fmu::text_file::csv_field;
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::open::OpenOption;
use super::progress::{self, Bars, Progress};
use super::{run_all, serve};
use crate::console;

/// A metric beyond its limit.
const BEYOND_LIMIT: u8 = 3;
pub const RESULTS: &str = "results";
pub const TABLE: &str = "result.csv";
pub const METRICS: &str = "metrics.json";
pub const PLOT: &str = "plot.svg";
pub const PAGE: &str = "index.html";

#[derive(clap::Args)]
pub struct Arguments {
    /// A loop of this package, or an SSP: a folder with a SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP", required_unless_present = "all")]
    name: Option<String>,
    /// All loops of this package, and a table of them
    #[arg(long, conflicts_with_all = ["name", "case", "set", "open"])]
    all: bool,
    /// Folder for results [default: results]
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    options: LoopOptions,
    #[command(flatten)]
    open: OpenOption,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

impl Arguments {
    /// A loop as it is, through the FMUs in a folder.
    pub fn of(name: &str, fmus: &Path, json: bool) -> Self {
        let options = LoopOptions { fmus: Some(fmus.to_owned()), ..LoopOptions::default() };
        Arguments { name: Some(name.to_owned()), all: false, out: None, options, open: OpenOption::default(), json }
    }

    /// A loop with options, its results in a folder.
    pub fn with(name: &str, options: &LoopOptions, out: &Path, json: bool) -> Self {
        let (out, options, open) = (Some(out.to_owned()), options.clone(), OpenOption::default());
        Arguments { name: Some(name.to_owned()), all: false, out, options, open, json }
    }

    /// Where results go.
    pub fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(RESULTS))
    }
}

/// Runs a closed loop, or all, and prints what it came to.
pub fn execute(options: &Arguments) -> Result<ExitCode, Error> {
    let Some(name) = &options.name else { return Ok(run_all::execute(options)) };
    let done = run(options, name, &Bars::new(options.json))?;
    if console::serves() {
        serve::send(&done.recording, about(&done.report(), done.folder.as_deref()));
    }
    if let Some(error) = done.failure {
        if let Some(folder) = &done.folder {
            tell!("what was computed until then is in {}", folder.display());
        }
        return Err(error);
    }
    print(&done, options.json).map_err(|reason| Error::Loop { file: done.structure.file.clone(), reason })?;
    if let Some(folder) = &done.folder {
        options.open.show(&folder.join(PAGE));
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
    structure: Structure,
    settings: Settings,
    whole: bool,
    recording: Recording,
    measured: Vec<Measured>,
    ending: Ending,
    /// Where its results are, where it has any.
    pub folder: Option<PathBuf>,
    /// Why it did not come to its end.
    pub failure: Option<Error>,
    /// How long the simulation took.
    pub took: Duration,
}

impl Run {
    pub fn report(&self) -> Report<'_> {
        let Run { structure, settings, whole, recording, measured, ending, .. } = self;
        Report { structure, settings: *settings, whole: *whole, recording, measured, ending }
    }

    /// What a script wants of it.
    pub fn told(&self) -> Value {
        json!({ "loop": self.structure.name, "ended": self.ending.word(), "metrics": self.measured,
                "warnings": self.recording.warnings, "results": self.folder, "seconds": self.took.as_secs_f64() })
    }
}

/// A run as a program that is served wants it: how it was run, what came of it, and how it is to be drawn.
pub fn about(report: &Report, results: Option<&Path>) -> Value {
    let Report { structure, settings, whole, measured, ending, .. } = report;
    let Settings { start_time, stop_time, step, order } = settings;
    let plots: Vec<Value> = report.diagrams().unwrap_or_default().iter().map(Diagram::without_points).collect();
    json!({ "name": structure.name, "description": structure.description, "ended": ending.word(),
            "metrics": measured, "results": results, "plots": plots,
            "settings": { "start_time": start_time, "stop_time": stop_time, "step": step,
                          "order": (!whole).then(|| order.to_string()), "composite": whole,
                          "values": structure.all_values() } })
}

/// Runs a closed loop and writes its results, also those of a run that a unit's failure ended. One that made no step has
/// none: what an earlier run left stays.
pub fn run(arguments: &Arguments, name: &str, bars: &Bars) -> Result<Run, Error> {
    let out = serve::folder(arguments.out.as_deref(), RESULTS);
    let mut done = simulated(&arguments.options, name, out, &[], bars)?;
    if let Some(out) = out.filter(|_| done.recording.times.len() > 1) {
        write_results(&done.report(), out)?;
        done.folder = Some(out.join(&done.structure.name));
    }
    Ok(done)
}

/// Runs a closed loop; further signals are recorded beside those that it names. Nothing is written; but where results are
/// to be, a folder that can't take them is refused at once.
pub fn simulated(
    options: &LoopOptions,
    name: &str,
    out: Option<&Path>,
    further: &[&str],
    bars: &Bars,
) -> Result<Run, Error> {
    let files = LoopFiles::find(name)?;
    let mut structure = options.structure(&files)?;
    let settings = options.settings(&structure)?;
    let whole = options.composite;
    let own_name = format!("{}{}", structure.name, if whole { "-composite" } else { "" });
    if let Some(out) = out {
        output::check(out, &own_name, &[TABLE, METRICS, PLOT, PAGE])?;
    }
    let loaded = options.units(&structure)?.load(&structure, &options.hosting.hosting()?)?;
    let loaded = loaded.recording(further.iter().copied());
    let Settings { start_time, stop_time, step, order } = settings;
    detail!("{}: from {start_time} s to {stop_time} s in steps of {step} s, {order}", structure.name);
    loaded.told().iter().for_each(|unit| detail!("{}: {unit}", structure.name));
    let closed = loaded.instantiate(&[])?;
    let begun = Instant::now();
    let (mut recording, ending, failure) =
        Progress::new(bars, name, settings).watch(|go_on| closed.run(settings, go_on));
    let took = begun.elapsed();
    let wrong = |reason| Error::Loop { file: structure.file.clone(), reason };
    let measured = measure(&structure, &mut recording).map_err(wrong)?;
    structure.name = own_name;
    Ok(Run { structure, settings, whole, recording, measured, ending, folder: None, failure, took })
}

pub fn write_results(report: &Report, out: &Path) -> Result<(), Error> {
    let Report { structure, recording, measured, ending, .. } = report;
    let mut files = Files::within(out, &structure.name)?;
    let names: Vec<_> = recording.names.iter().map(|name| csv_field(name)).collect();
    let mut csv = format!("time,{}\n", names.join(","));
    for (k, time) in recording.times.iter().enumerate() {
        let values: Vec<_> = recording.columns.iter().map(|column| column[k].to_string()).collect();
        csv.push_str(&format!("{time},{}\n", values.join(",")));
    }
    files.add(TABLE, csv)?;
    let told = json!({ "loop": structure.name, "ended": ending.word(), "metrics": measured });
    files.add(METRICS, told.to_string())?;
    let wrong = |reason| Error::Loop { file: out.join(&structure.name), reason };
    files.add(PLOT, svg(&structure.description, &report.diagrams().map_err(wrong)?))?;
    files.add(PAGE, report.html().map_err(wrong)?)?;
    files.place()
}

fn print(done: &Run, json: bool) -> Result<(), String> {
    let Run { structure, recording, measured, folder, .. } = done;
    if let Some(shortfall) = done.report().shortfall() {
        let kept = folder.as_ref().map(|folder| format!("; what was computed until then is in {}", folder.display()));
        tell!("the run {shortfall}{}", kept.unwrap_or_default());
    }
    if json {
        say!("{}", done.told());
        return Ok(());
    }
    if let Some(plot) = structure.plots.first().filter(|_| console::is_seen()) {
        say!("{}", terminal(plot, recording)?);
    }
    say!("{:44} {:>12} {:>10}", structure.name, "measured", "limit");
    for Measured { label, value, limit } in measured {
        let value = value.map_or("–".to_owned(), |value| format!("{value:.5}"));
        say!("{label:44} {value:>12} {:>10}", limit.map_or(String::new(), |limit| format!("{limit}")));
    }
    recording.warnings.iter().for_each(|warning| aside!("warning: {warning}"));
    if let Some(folder) = folder {
        aside!("{PAGE} (the report), {TABLE}, {METRICS} and {PLOT} are in {}", folder.display());
    }
    Ok(())
}
