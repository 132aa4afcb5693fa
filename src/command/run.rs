//! `run`: a closed loop through its FMUs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::Library;
use adaptive_fmu::simulation::{
    ClosedLoop, Ending, LoopFiles, Measured, Order, Recording, Report, Settings, Structure,
};
use adaptive_fmu::simulation::{measure, svg, terminal};
use serde_json::json;

use super::export::{export_units, export_whole};
use super::parameters::Parameters;
use super::progress::{self, Progress};

/// A metric beyond its limit.
const BEYOND_LIMIT: u8 = 3;
const RESULTS: &str = "results";

#[derive(clap::Args)]
pub struct Arguments {
    /// A loop of this package, or an SSP: a folder with a SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP")]
    name: String,
    /// As one unit, integrated together; the step sets communication points only, results go to LOOP-composite
    #[arg(long, conflicts_with_all = ["order", "fmus"])]
    composite: bool,
    /// Folder with FMUs to use as they are; without it, those in resources/ beside the loop, or this package's, which
    /// are exported anew into fmus/
    #[arg(long)]
    fmus: Option<PathBuf>,
    /// Folder for results
    #[arg(long, default_value = RESULTS)]
    out: PathBuf,
    /// Communication step in s, in place of the loop's own
    #[arg(long, value_parser = positive)]
    step: Option<f64>,
    /// Stop time in s, in place of the loop's own
    #[arg(long, value_parser = positive)]
    until: Option<f64>,
    /// gauss-seidel or jacobi, in place of the loop's own
    #[arg(long)]
    order: Option<Order>,
    #[command(flatten)]
    parameters: Parameters,
    /// As JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// A loop as it is, through the FMUs in a folder.
    pub fn of(name: &str, fmus: &Path, json: bool) -> Self {
        let (fmus, out, parameters) = (Some(fmus.to_owned()), PathBuf::from(RESULTS), Parameters::default());
        let (name, composite, step, until, order) = (name.to_owned(), false, None, None, None);
        Arguments { name, composite, fmus, out, step, until, order, parameters, json }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "must be a finite number above 0".to_owned())
}

/// The units of a loop, connected, or all of it as one.
fn close(options: &Arguments, files: &LoopFiles, structure: &Structure) -> Result<ClosedLoop, Error> {
    if options.composite {
        let folder = tempfile::tempdir().map_err(Error::file("temporary folder"))?;
        let (fmu, notes) = export_whole(structure, &Library::beside_program()?, folder.path())?;
        return ClosedLoop::whole(&structure.name, &fmu, notes);
    }
    if let Some(fmus) = options.fmus.clone().or_else(|| files.fmus()) {
        return ClosedLoop::new(structure, &fmus);
    }
    // A loop must not show the numbers of units that were exported before an equation was changed.
    let fmus = PathBuf::from("fmus");
    export_units(structure, &Library::beside_program()?, &fmus)?;
    ClosedLoop::new(structure, &fmus)
}

/// Runs a closed loop, writes what it recorded and prints its metrics.
pub fn execute(options: &Arguments) -> Result<ExitCode, Error> {
    let files = LoopFiles::find(&options.name)?;
    let mut structure = files.structure()?;
    options.parameters.apply(&mut structure, &files)?;
    let settings = Settings {
        start_time: structure.start_time,
        stop_time: options.until.unwrap_or(structure.stop_time),
        step: options.step.unwrap_or(structure.step),
        order: options.order.unwrap_or(structure.order),
    };
    let wrong = |reason: String| Error::Loop { file: structure.file.clone(), reason };
    if settings.stop_time <= settings.start_time {
        return Err(wrong(format!(
            "stop time {}: must be after the start, {}",
            settings.stop_time, settings.start_time
        )));
    }
    let mut closed = close(options, &files, &structure)?;
    if options.composite {
        structure.name.push_str("-composite");
    }
    let (mut recording, ending, failure) = simulate(&mut closed, settings, options.json);
    let measured = measure(&structure, &mut recording).map_err(wrong)?;
    let folder = options.out.join(&structure.name);
    let (recording, measured, whole) = (&recording, &measured, options.composite);
    let report = Report { structure: &structure, settings, whole, recording, measured, ending: &ending };
    write_results(&report, &folder)?;
    if let Some(error) = failure {
        eprintln!("what was computed until then is in {}", folder.display());
        return Err(error);
    }
    print(&report, &folder, options.json).map_err(wrong)?;
    let beyond = measured.iter().any(|metric| metric.holds() == Some(false));
    Ok(match ending {
        Ending::Interrupted => ExitCode::from(progress::INTERRUPTED),
        _ if beyond => ExitCode::from(BEYOND_LIMIT),
        _ => ExitCode::SUCCESS,
    })
}

/// Runs until the stop time, the user's interruption or a unit's failure; what was recorded is kept in any case.
fn simulate(closed: &mut ClosedLoop, settings: Settings, silent: bool) -> (Recording, Ending, Option<Error>) {
    progress::listen_to_interrupts();
    let mut shown = Progress::new(silent, settings);
    let mut ending = Ending::Complete;
    let result = closed.run(settings, |time| {
        shown.show(time);
        if progress::is_interrupted() && time < settings.stop_time {
            ending = Ending::Interrupted;
        }
        ending == Ending::Complete
    });
    shown.clear();
    match result {
        Ok(recording) => (recording, ending, None),
        Err((error, recording)) => (*recording, Ending::Failed(error.to_string()), Some(error)),
    }
}

fn write_results(report: &Report, folder: &Path) -> Result<(), Error> {
    let Report { structure, recording, measured, ending, .. } = report;
    std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
    let write = |name: &str, text: String| {
        let file = folder.join(name);
        std::fs::write(&file, text).map_err(Error::file(&file))
    };
    let mut csv = format!("time,{}\n", recording.names.join(","));
    for (k, time) in recording.times.iter().enumerate() {
        let values: Vec<_> = recording.columns.iter().map(|column| column[k].to_string()).collect();
        csv.push_str(&format!("{time},{}\n", values.join(",")));
    }
    write("result.csv", csv)?;
    write("metrics.json", json!({ "loop": structure.name, "ended": ending.word(), "metrics": measured }).to_string())?;
    let wrong = |reason| Error::Loop { file: folder.to_owned(), reason };
    write("plot.svg", svg(&structure.description, &structure.plots, recording).map_err(wrong)?)?;
    write("index.html", report.html().map_err(wrong)?)
}

fn print(report: &Report, folder: &Path, json: bool) -> Result<(), String> {
    let Report { structure, recording, measured, ending, .. } = report;
    if let Some(shortfall) = report.shortfall() {
        eprintln!("the run {shortfall}; what was computed until then is in {}", folder.display());
    }
    if json {
        let warnings = &recording.warnings;
        let value = json!({ "loop": structure.name, "ended": ending.word(), "metrics": measured, "warnings": warnings,
                            "results": folder });
        println!("{value}");
        return Ok(());
    }
    if let Some(plot) = structure.plots.first() {
        println!("{}", terminal(plot, recording)?);
    }
    println!("{:44} {:>12} {:>10}", structure.name, "measured", "limit");
    for Measured { label, value, limit } in *measured {
        let value = value.map_or("–".to_owned(), |value| format!("{value:.5}"));
        println!("{label:44} {value:>12} {:>10}", limit.map_or(String::new(), |limit| format!("{limit}")));
    }
    recording.warnings.iter().for_each(|warning| println!("warning: {warning}"));
    println!("index.html (the report), result.csv, metrics.json and plot.svg are in {}", folder.display());
    Ok(())
}
