//! The command line: reads arguments, calls the library, prints. Nothing is decided here.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library};
use adaptive_fmu::fmi2::describe::Build;
use adaptive_fmu::simulation::{ClosedLoop, Description, Measured, Order, Recording, Settings, Structure};
use adaptive_fmu::simulation::{measure, svg, terminal};
use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

/// Adaptive controllers and their plants as FMI 2.0 units.
///
/// Exit codes: 0 done; 1 it could not be done, with the reason on stderr; 2 the arguments are wrong; 3 a loop ran,
/// but a metric is beyond its limit.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Lists the FMUs and the closed loops
    List {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Writes FMUs
    Export {
        /// FMUs of this package, or description files (NAME.toml); all FMUs of this package where none is named
        names: Vec<String>,
        /// All FMUs of this package
        #[arg(long, conflicts_with = "names")]
        all: bool,
        /// Folder for the FMUs
        #[arg(long, default_value = "fmus")]
        out: PathBuf,
        /// Shared library to pack instead of the one built with this program (one that holds models of your own)
        #[arg(long)]
        library: Option<PathBuf>,
        /// Then closes this loop through the FMUs
        #[arg(long, value_name = "LOOP")]
        run: Option<String>,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Tells what an FMU is
    Info {
        /// The archive
        fmu: PathBuf,
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Runs a closed loop through its FMUs: metrics, CSV and a plot
    Run {
        /// A loop of this package, or a SystemStructure.ssd
        #[arg(value_name = "LOOP")]
        name: String,
        /// Folder with FMUs to use as they are; without it, this package's are exported anew into fmus/
        #[arg(long)]
        fmus: Option<PathBuf>,
        /// Folder for results
        #[arg(long, default_value = "results")]
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
    },
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "must be a finite number above 0".to_owned())
}

/// A metric beyond its limit.
const BEYOND_LIMIT: u8 = 3;

fn main() -> ExitCode {
    match execute(Arguments::parse().command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn execute(command: Command) -> Result<ExitCode, Error> {
    match command {
        Command::List { json } => list(json),
        Command::Export { names, all: _, out, library, run: then_run, json } => {
            let library = library.map_or_else(Library::beside_program, |path| Library::open(&path))?;
            let names = if names.is_empty() {
                exporter::descriptions().iter().map(|(name, _)| (*name).to_owned()).collect()
            } else {
                names
            };
            let files = export(&names, &library, &out)?;
            if json {
                println!("{}", json!({ "fmus": files }));
            } else {
                files.iter().for_each(|file| println!("{}", file.display()));
            }
            let options =
                RunOptions { fmus: Some(&out), out: Path::new("results"), step: None, until: None, order: None, json };
            then_run.map_or(Ok(ExitCode::SUCCESS), |name| run(&name, &options))
        }
        Command::Info { fmu, json } => info(&fmu, json),
        Command::Run { name, fmus, out, step, until, order, json } => {
            run(&name, &RunOptions { fmus: fmus.as_deref(), out: &out, step, until, order, json })
        }
    }
}

fn list(json: bool) -> Result<ExitCode, Error> {
    let mut fmus = Vec::new();
    for (name, _) in exporter::descriptions() {
        let source = exporter::find_description(name)?;
        let description = adaptive_fmu::model::Description::read(&source.text)
            .map_err(|invalid| Error::Description { file: source.file, reason: invalid.to_string() })?;
        fmus.push((name, description.description));
    }
    let mut loops = Vec::new();
    for (name, ssd) in exporter::loops() {
        loops.push((name, Structure::read(ssd, Path::new(name))?.description));
    }
    if json {
        let entry = |(name, text): &(_, String)| json!({ "name": name, "description": text });
        let value = json!({ "fmus": fmus.iter().map(|e| entry(&(*e.0, e.1.clone()))).collect::<Vec<_>>(),
                            "loops": loops.iter().map(|e| entry(&(*e.0, e.1.clone()))).collect::<Vec<_>>() });
        println!("{value}");
    } else {
        println!("FMUs");
        fmus.iter().for_each(|(name, text)| println!("  {name:24} {text}"));
        println!("Loops");
        loops.iter().for_each(|(name, text)| println!("  {name:24} {text}"));
    }
    Ok(ExitCode::SUCCESS)
}

fn export(names: &[String], library: &Library, out: &Path) -> Result<Vec<PathBuf>, Error> {
    let build = library.describe(None)?.build;
    if !build.optimised {
        eprintln!("warning: the library was built without optimisation and is slow; build it with --release");
    }
    names.iter().map(|name| exporter::export(&exporter::find_description(name)?, library, out)).collect()
}

fn info(fmu: &Path, json: bool) -> Result<ExitCode, Error> {
    let xml = exporter::read_entry(fmu, "modelDescription.xml")?;
    let refuse = |reason| Error::Archive { file: fmu.to_owned(), reason };
    let description = Description::read(&xml).map_err(refuse)?;
    let own = exporter::read_entry(fmu, "resources/description.toml").ok();
    let Build { version, target, compiler, source, .. } = Build::own();
    let program = format!("{version}, {target}, {compiler}, source {source}");
    if json {
        let variables: Vec<_> = description.variables.iter().map(|v| {
            json!({ "name": v.name, "valueReference": v.reference, "causality": v.causality, "variability": v.variability,
                    "type": v.kind, "unit": v.unit, "start": v.start, "min": v.min, "max": v.max,
                    "description": v.description })
        }).collect();
        println!(
            "{}",
            json!({
            "name": description.name, "description": description.description, "guid": description.guid,
            "generationTool": description.generation_tool, "step": description.step, "stopTime": description.stop_time,
            "capabilities": description.capabilities, "logCategories": description.categories,
            "variables": variables, "source": own, "program": program })
        );
        return Ok(ExitCode::SUCCESS);
    }
    println!("{}: {}", description.name, description.description);
    println!("made by {}, GUID {}", description.generation_tool, description.guid);
    println!("this program: {program}");
    let capabilities: Vec<_> = description.capabilities.iter().map(|(name, value)| format!("{name} {value}")).collect();
    println!("co-simulation: {}", capabilities.join(", "));
    println!("log categories: {}", description.categories.join(", "));
    println!();
    println!("{:26} {:10} {:10} {:6} {:12} description", "variable", "causality", "changes", "unit", "start");
    for v in &description.variables {
        let (unit, start) = (v.unit.as_deref().unwrap_or(""), v.start.as_deref().unwrap_or(""));
        println!("{:26} {:10} {:10} {unit:6} {start:12} {}", v.name, v.causality, v.variability, v.description);
    }
    Ok(ExitCode::SUCCESS)
}

struct RunOptions<'a> {
    fmus: Option<&'a Path>,
    out: &'a Path,
    step: Option<f64>,
    until: Option<f64>,
    order: Option<Order>,
    json: bool,
}

fn find_loop(name: &str) -> Result<(Structure, PathBuf), Error> {
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

fn run(name: &str, options: &RunOptions) -> Result<ExitCode, Error> {
    let (structure, file) = find_loop(name)?;
    let fmus = options.fmus.unwrap_or(Path::new("fmus"));
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
