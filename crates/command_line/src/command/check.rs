//! `check`: what a designer should know of a description before exporting it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::design::digits;
use adaptive_fmu::designs::{Cases, Followed, WorstCase, add_runs, lines, report_page};
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library, Source};
use adaptive_fmu::nominal::WorstPlant;
use adaptive_fmu::output;
use adaptive_fmu::report::{DesignReport, number};
use adaptive_fmu::tuning::parameter_set;
use serde_json::json;

use super::number::positive;
use super::workers;

#[derive(clap::Args)]
pub struct Arguments {
    /// Description file (NAME.toml), FMU that this program exported (NAME.fmu), or FMU of this package
    name: String,
    /// Shared library that contains the model [default: the one built with this program]
    #[arg(long)]
    library: Option<PathBuf>,
    /// Number of plants within the uncertainty of the nominal one to try [default: 200, half of them at corners]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    plants: Option<u32>,
    /// Seed of the random ones among them, and of --worst-case [default: 1]
    #[arg(long)]
    seed: Option<u32>,
    /// Search so long for the worst plant within the uncertainty, with runs of the FMUs, s
    ///
    /// A particle swarm looks for the largest integral of the squared error of a step of the reference.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    worst_case: Option<f64>,
    /// Write the plant with the longest settling time, or that of --worst-case, as a parameter set (.ssv)
    ///
    /// Its parameters are the elements of plant.A and plant.B, as for `run LOOP --case FILE.ssv`.
    #[arg(long, value_name = "FILE.ssv")]
    worst: Option<PathBuf>,
    /// Write the report as a page with pictures
    #[arg(long, value_name = "FILE.html")]
    page: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Carry out the runs of one plant of --worst-case, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

/// Prints the report; the exit code shows whether the design is sound.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { name, library, json, .. } = arguments;
    let library = library.as_deref().map_or_else(Library::next_to_program, Library::open)?;
    let source = exporter::find_description(name)?;
    let drawn = [("plants", arguments.plants), ("seed", arguments.seed)];
    let source = source.with_nominal(drawn.into_iter().filter_map(|(key, value)| Some((key, i64::from(value?)))))?;
    if let Some(text) = &arguments.job {
        workers::reply(&Cases::new(&source, &*super::ready::units()?)?.squared_error(&workers::job::<Vec<f64>>(text)?));
        return Ok(ExitCode::SUCCESS);
    }
    let (mut unit, _) = exporter::describe(&source, &library)?;
    // Units of another library aren't known here.
    if arguments.library.is_none() {
        add_runs(&source, &mut unit.report, super::ready::units);
    }
    let found = search(arguments, &source)?;
    if let Some(file) = &arguments.worst {
        write_worst(file, &unit.report, found.as_ref(), &source)?;
    }
    if let Some(file) = &arguments.page {
        output::write(file, report_page(&unit.name, &unit.report))?;
    }
    if *json {
        let DesignReport { step, findings, worst, pictures, .. } = &unit.report;
        let (verdict, sound) = (unit.report.verdict(), unit.report.is_sound());
        let report = json!({ "name": unit.name, "verdict": verdict, "sound": sound, "step": step, "findings": findings,
                    "summary": unit.report.summary, "worst": worst, "pictures": pictures,
                    "worst_case": found.as_ref().map(case_as_json), "text": lines(&unit.name, &unit.report) });
        print_line!("{report}");
    } else {
        print_line!("{}", lines(&unit.name, &unit.report));
        if let Some(found) = &found {
            print_line!("\n{}", case_lines(found).join("\n"));
        }
    }
    Ok(exit_code(&unit.report))
}

/// The worst plant, where it is searched for.
fn search(arguments: &Arguments, source: &Source) -> Result<Option<WorstCase>, Error> {
    let seed = arguments.seed.map_or(1, u64::from);
    let found = |seconds| Cases::new(source, &*super::ready::units()?)?.worst(seconds, seed);
    arguments.worst_case.map(found).transpose()
}

/// Writes the worst plant as a parameter set.
fn write_worst(file: &Path, report: &DesignReport, found: Option<&WorstCase>, source: &Source) -> Result<(), Error> {
    let plant = found.map(|found| &found.plant).or(report.worst.first());
    let refuse = || Error::Description {
        file: source.file.clone(),
        reason: "--worst needs a plant in [nominal] with its uncertainty, and a loop that is stable with all plants"
            .to_owned(),
    };
    let plant = plant.ok_or_else(refuse)?;
    let values: Vec<_> = entries(plant).collect();
    let values: Vec<_> = values.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let remark = format!("Worst plant of {}: {}", source.file.display(), plant.respects.join(", "));
    let text = parameter_set("worst", &remark, &values).map_err(Error::file(file))?;
    output::write(file, text)
}

/// The entries of a plant, by their names in a loop.
fn entries(plant: &WorstPlant) -> impl Iterator<Item = (String, f64)> {
    [("A", &plant.A), ("B", &plant.B)].into_iter().flat_map(|(name, rows)| {
        rows.iter().enumerate().flat_map(move |(i, row)| {
            row.iter().enumerate().map(move |(j, value)| (format!("plant.{name}[{},{}]", i + 1, j + 1), *value))
        })
    })
}

fn case_lines(WorstCase { plant, followed, tried }: &WorstCase) -> Vec<String> {
    let had = match followed {
        Ok(Followed { settling, overshoot, peaks, .. }) => {
            let settles =
                settling.map_or("does not settle".to_owned(), |time| format!("settles in {} s", digits(time)));
            let peaks = peaks.iter().copied().map(digits).collect::<Vec<_>>().join(", ");
            format!("{settles}, overshoot {} %, peak of the control {peaks}", digits(100.0 * overshoot))
        }
        Err(reason) => format!("its loop fails: {reason}"),
    };
    let rows = |name: &str, rows: &[Vec<f64>]| {
        let row = |row: &Vec<f64>| row.iter().copied().map(number).collect::<Vec<_>>().join(", ");
        format!("  {name:3} {}", rows.iter().map(row).collect::<Vec<_>>().join("\n      "))
    };
    vec![format!("Worst case of {tried} plants: {had}"), rows("A", &plant.A), rows("B", &plant.B)]
}

fn case_as_json(WorstCase { plant, followed, tried }: &WorstCase) -> serde_json::Value {
    let had = followed.as_ref().ok();
    json!({
        "tried": tried, "A": plant.A, "B": plant.B, "failure": followed.as_ref().err(),
        "settling_time": had.and_then(|had| had.settling), "overshoot": had.map(|had| had.overshoot),
        "peaks": had.map(|had| &had.peaks),
    })
}

/// 0 of a sound design, with warnings too; 3 of one that isn't.
pub fn exit_code(report: &DesignReport) -> ExitCode {
    if report.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(3) }
}
