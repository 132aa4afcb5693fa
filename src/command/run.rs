//! `run`: a closed loop through its FMUs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library};
use adaptive_fmu::simulation::{ClosedLoop, Measured, Order, Recording, Settings, Structure};
use adaptive_fmu::simulation::{measure, svg, terminal};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::export::export;

/// A metric beyond its limit.
const BEYOND_LIMIT: u8 = 3;
const RESULTS: &str = "results";

#[derive(clap::Args)]
pub struct Arguments {
    /// A loop of this package, or a SystemStructure.ssd
    #[arg(value_name = "LOOP")]
    name: String,
    /// Folder with FMUs to use as they are; without it, this package's are exported anew into fmus/
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
    /// As JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// A loop as it is, through the FMUs in a folder.
    pub fn of(name: &str, fmus: &Path, json: bool) -> Self {
        let (fmus, out) = (Some(fmus.to_owned()), PathBuf::from(RESULTS));
        Arguments { name: name.to_owned(), fmus, out, step: None, until: None, order: None, json }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "must be a finite number above 0".to_owned())
}

/// The loop of a name or a file, and where it stands.
pub fn find_loop(name: &str) -> Result<(Structure, PathBuf), Error> {
    if let Some((_, ssd)) = exporter::loops().iter().find(|(known, _)| *known == name) {
        let file = Path::new("examples").join(name).join("SystemStructure.ssd");
        return Ok((Structure::read(ssd, &file)?, file));
    }
    let file = PathBuf::from(name);
    if file.extension().is_none_or(|extension| extension != "ssd") {
        let known: Vec<_> = exporter::loops().iter().map(|(name, _)| *name).collect();
        return Err(Error::Unknown { what: "loop", name: name.to_owned(), known: known.join(", ") });
    }
    let text = std::fs::read_to_string(&file).map_err(Error::file(&file))?;
    Ok((Structure::read(&text, &file)?, file))
}

/// Runs a closed loop, writes what it recorded and prints its metrics.
pub fn execute(options: &Arguments) -> Result<ExitCode, Error> {
    let (structure, file) = find_loop(&options.name)?;
    let fmus = options.fmus.as_deref().unwrap_or(Path::new("fmus"));
    if options.fmus.is_none() {
        // A loop must not show the numbers of units that were exported before an equation was changed.
        let needed: BTreeSet<String> = structure.components.iter().map(|component| component.fmu.clone()).collect();
        export(&Vec::from_iter(needed), &Library::beside_program()?, fmus)?;
    }
    let settings = Settings {
        start_time: structure.start_time,
        stop_time: options.until.unwrap_or(structure.stop_time),
        step: options.step.unwrap_or(structure.step),
        order: options.order.unwrap_or(structure.order),
    };
    let wrong = |reason: String| Error::Loop { file: file.clone(), reason };
    if settings.stop_time <= settings.start_time {
        return Err(wrong(format!(
            "stop time {}: must be after the start, {}",
            settings.stop_time, settings.start_time
        )));
    }
    let mut closed = ClosedLoop::new(&structure, &file, fmus)?;
    let bar = progress_bar(options.json, &settings);
    let result = closed.run(settings, |time| {
        bar.set_position(((time - settings.start_time) * 1e3) as u64);
        true
    });
    bar.finish_and_clear();
    let (mut recording, failure) = match result {
        Ok(recording) => (recording, None),
        Err((error, recording)) => (*recording, Some(error)),
    };
    let measured = measure(&structure, &mut recording).map_err(wrong)?;
    let folder = options.out.join(&structure.name);
    write_results(&structure, &recording, &measured, &folder)?;
    if let Some(error) = failure {
        eprintln!("what was computed until then is in {}", folder.display());
        return Err(error);
    }
    report(&structure, &recording, &measured, &folder, options.json).map_err(wrong)?;
    let beyond =
        measured.iter().any(|m| m.limit.zip(m.value).is_some_and(|(limit, value)| value > limit || value.is_nan()));
    Ok(if beyond { ExitCode::from(BEYOND_LIMIT) } else { ExitCode::SUCCESS })
}

fn progress_bar(silent: bool, settings: &Settings) -> ProgressBar {
    if silent {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(((settings.stop_time - settings.start_time) * 1e3) as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of simulated time, {eta} left") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

fn write_results(
    structure: &Structure,
    recording: &Recording,
    measured: &[Measured],
    folder: &Path,
) -> Result<(), Error> {
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
    write("metrics.json", json!({ "loop": structure.name, "metrics": measured }).to_string())?;
    let drawn = svg(&structure.description, &structure.plots, recording);
    write("plot.svg", drawn.map_err(|reason| Error::Loop { file: folder.to_owned(), reason })?)
}

fn report(
    structure: &Structure,
    recording: &Recording,
    measured: &[Measured],
    folder: &Path,
    json: bool,
) -> Result<(), String> {
    if json {
        let value =
            json!({ "loop": structure.name, "metrics": measured, "warnings": recording.warnings, "results": folder });
        println!("{value}");
        return Ok(());
    }
    if let Some(plot) = structure.plots.first() {
        println!("{}", terminal(plot, recording)?);
    }
    println!("{:44} {:>12} {:>10}", structure.name, "measured", "limit");
    for Measured { label, value, limit } in measured {
        let value = value.map_or("–".to_owned(), |value| format!("{value:.5}"));
        println!("{label:44} {value:>12} {:>10}", limit.map_or(String::new(), |limit| format!("{limit}")));
    }
    recording.warnings.iter().for_each(|warning| println!("warning: {warning}"));
    println!("result.csv, metrics.json and plot.svg are in {}", folder.display());
    Ok(())
}
