//! `simulate`: a single FMU.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::fmi2::calls::Interface;
use adaptive_fmu::fmu::Fmu;
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::output;
use adaptive_fmu::report::number;
use adaptive_fmu::results::{Ending, Report, Verdict};
use adaptive_fmu::simulation::{Alone, AloneEvent, Compared, Difference, Inputs, Read, Recording, Replay, Share};
use adaptive_fmu::structure::{Event, Plot, Settings, Structure, within_run};
use adaptive_fmu::template::three_digits;
use clap::ValueEnum;
use serde_json::json;

use super::hosting::HostingOptions;
use super::linearise::{assignment, open_unit};
use super::loop_options::check_points;
use super::names::Names;
use super::number::positive;
use super::open::OpenOption;
use super::progress::{Bars, Progress};
use super::results::{NAMES, PAGE, TableOptions, write_results};
use super::run::{RESULTS, about, exit_code};
use super::serve;
use super::tables::log_assumptions;
use crate::console;

/// Communication step of an FMU that proposes none, and its stop time, s.
const STEP: f64 = 1e-3;
const STOP_TIME: f64 = 1.0;

#[derive(Clone, Copy, ValueEnum)]
enum By {
    /// Co-simulation (the FMU integrates)
    Cs,
    /// Model exchange (this program integrates)
    Me,
}

#[derive(clap::Args)]
pub struct Arguments {
    /// FMU archive (NAME.fmu), FMU of this package, description file (NAME.toml), or loop as a single FMU
    name: String,
    /// Interface to use [default: co-simulation if the FMU supports it, else model exchange]
    #[arg(long)]
    interface: Option<By>,
    /// CSV, Parquet or MATLAB file (.csv, .parquet, .mat) with inputs over time.
    ///
    /// The first line of a CSV file contains names, of which the first is `time`. The other lines contain numbers, separated by
    /// commas, or by semicolons or tabs, which allow decimal commas. A MATLAB file (version 5 or 7) contains `time` and vectors of
    /// that length. Continuous inputs are interpolated linearly; all other inputs, and tunable parameters, use a zero-order hold.
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// Outputs to compare with the columns of these names of --input, which may have further columns
    ///
    /// The run takes the times of that file. It shows the controls that a controller would have given in a recorded experiment.
    #[arg(long, value_name = "NAME,…", requires = "input")]
    compare: Option<Names>,
    /// Start value of a parameter, or constant value of an input (repeatable)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
    /// Value that a tunable parameter or an input gets during the run (repeatable)
    ///
    /// For example --event '5: mass=2', with the time in s. It is set at the first communication point that is not before it.
    #[arg(long, value_name = "TIME: NAME=VALUE")]
    event: Vec<String>,
    /// Variables to record in addition to the outputs
    #[arg(long, value_name = "NAME,…")]
    record: Option<Names>,
    /// Stop time, s [default: the FMU's own, or 1]
    #[arg(long, value_parser = positive)]
    until: Option<f64>,
    /// Communication step, s [default: the FMU's own, or 0.001]
    #[arg(long, value_parser = positive)]
    step: Option<f64>,
    /// Relative tolerance of the integration in model exchange
    #[arg(long, default_value = "1e-6", value_parser = positive)]
    tolerance: f64,
    /// Folder for results [default: results]
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    hosting: HostingOptions,
    #[command(flatten)]
    open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the unit, writes its outputs, and prints where they are.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let fmu = open_unit(&arguments.name, &arguments.hosting.hosting()?)?;
    let description = &fmu.description;
    let interface = match arguments.interface {
        Some(By::Cs) => Interface::CoSimulation,
        Some(By::Me) => Interface::ModelExchange,
        None if description.co_simulation => Interface::CoSimulation,
        None => Interface::ModelExchange,
    };
    let (inputs, replay) = inputs(arguments, description)?;
    let ends =
        replay.as_ref().and_then(|_| Some([*inputs.as_ref()?.times().first()?, *inputs.as_ref()?.times().last()?]));
    let settings = Settings {
        start_time: ends.map(|[first, _]| first).or(description.start_time).unwrap_or(0.0),
        stop_time: arguments.until.or(ends.map(|[_, last]| last)).or(description.stop_time).unwrap_or(STOP_TIME),
        step: arguments.step.or(description.step.filter(|step| *step > 0.0)).unwrap_or(STEP),
    };
    check_points(settings, fmu.file())?;
    let asked = arguments.event.iter().map(|text| Event::read(text)).collect::<Result<Vec<_>, _>>()?;
    within_run(&asked, settings)?;
    let events = AloneEvent::all(&asked, description, inputs.as_ref())?;
    let mut further = arguments.record.as_ref().map_or(Vec::new(), |Names(names)| names.clone());
    further.extend(replay.iter().flat_map(|replay| replay.further.clone()));
    let name = fmu.file().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let out = serve::folder(arguments.out.as_deref(), RESULTS);
    if let Some(out) = out {
        output::check(out, &name, &NAMES)?;
    }
    let alone = Alone {
        fmu: &fmu,
        interface,
        tolerance: arguments.tolerance,
        start: &arguments.set,
        inputs: inputs.as_ref(),
        further: &further,
        events: &events,
    };
    let (mut recording, ending, failure) = Progress::new(&Bars::new(arguments.json), &description.name, settings)
        .watch(|go_on| alone.run(settings, go_on));
    recording.details.iter().for_each(|text| detail!("{text}"));
    let compared = replay.as_ref().map(|replay| replay.compare(&mut recording));
    let structure = structure(&fmu, &recording, settings, &arguments.set);
    let whole = true;
    let report = Report {
        structure: &structure,
        settings,
        whole,
        recording: &recording,
        measured: &[],
        ending: &ending,
        thinned: None,
    };
    let out = out.filter(|_| recording.times.len() > 1);
    out.map_or(Ok(()), |out| write_results(&report, None, &TableOptions::default(), out, None))?;
    let results = out.map(|out| out.join(&structure.name));
    if console::serves() {
        serve::send(&recording, about(&report, results.as_deref()));
    }
    if let Some(error) = failure {
        if let Some(results) = results {
            error_line!("results until then are in {}", results.display());
        }
        return Err(error);
    }
    print(&report, compared.as_ref(), results.as_deref(), arguments.json);
    if let Some(results) = &results {
        arguments.open.show(&results.join(PAGE));
    }
    Ok(exit_code(if ending == Ending::Interrupted { Verdict::Interrupted } else { Verdict::Holds }))
}

/// Inputs over time, and what is compared with a record.
fn inputs(arguments: &Arguments, description: &ModelDescription) -> Result<(Option<Inputs>, Option<Replay>), Error> {
    let Some(file) = &arguments.input else { return Ok((None, None)) };
    let read = if arguments.compare.is_some() { Inputs::read_some } else { Inputs::read };
    let Read { inputs, others, assumed, left_out, .. } = read(file, description)?;
    log_assumptions(file, &assumed, &left_out);
    let Some(Names(names)) = &arguments.compare else { return Ok((Some(inputs), None)) };
    let parameters: Vec<_> =
        inputs.variables(description).filter(|v| v.causality == "parameter").map(|v| &*v.name).collect();
    if !parameters.is_empty() {
        remark!("columns of {} that set parameters: {}", file.display(), parameters.join(", "));
    }
    let replay = Replay::new(description, names, inputs.times(), others)?;
    if !replay.unused.is_empty() {
        remark!("columns of {} that are not used: {}", file.display(), replay.unused.join(", "));
    }
    Ok((Some(inputs), Some(replay)))
}

fn compared_lines((compared, shares): &(Vec<Compared>, Vec<Share>)) -> Vec<String> {
    let mut lines =
        vec![format!("\n{:28} {:>8} {:>14} {:>14} at t, s", "against the record", "fit, %", "rms", "largest")];
    lines.extend(compared.iter().map(
        |Compared { name, unit, difference: Difference { fit, rms, largest, time, delay } }| {
            let fit = fit.map_or("–".to_owned(), |fit| format!("{fit:.1}"));
            let [rms, largest, time] = [rms, largest, time].map(|value| number(three_digits(*value)));
            let late = match delay {
                0 => String::new(),
                1 => ", recorded 1 step later".to_owned(),
                delay => format!(", recorded {delay} steps later"),
            };
            format!("{name:28} {fit:>8} {rms:>14} {largest:>14} {time} {unit}{late}").trim_end().to_owned()
        },
    ));
    lines.extend(shares.iter().filter(|share| share.part > 0.0).map(|Share { name, words, part, .. }| {
        format!("{words} ({name}) for {} % of the time", number(three_digits(*part)))
    }));
    lines
}

fn compared_as_json((compared, shares): &(Vec<Compared>, Vec<Share>)) -> serde_json::Value {
    let outputs: serde_json::Map<_, _> = compared
        .iter()
        .map(|Compared { name, unit, difference: Difference { fit, rms, largest, time, delay } }| {
            let of = json!({ "unit": unit, "fit": fit, "rms": rms, "largest": largest, "time": time, "delay": delay });
            (name.clone(), of)
        })
        .collect();
    let shares: serde_json::Map<_, _> =
        shares.iter().map(|share| (share.name.to_owned(), json!({ "part": share.part, "most": share.most }))).collect();
    json!({ "outputs": outputs, "shares": shares })
}

/// The unit as a loop of one, whose signals are plotted with those of the same unit of measurement.
fn structure(fmu: &Fmu, recording: &Recording, settings: Settings, values: &[(String, String)]) -> Structure {
    let mut plots: Vec<Plot> = Vec::new();
    let mut of_measures: BTreeMap<&str, usize> = BTreeMap::new();
    for (name, measure) in recording.names.iter().zip(&recording.measures) {
        let place = *of_measures.entry(measure).or_insert_with(|| {
            let title = match measure.as_str() {
                "" => "signals without a unit of measurement".to_owned(),
                "1" => "dimensionless signals".to_owned(),
                _ => format!("signals in {measure}"),
            };
            plots.push(Plot { title, ..Plot::default() });
            plots.len() - 1
        });
        plots[place].signals.push(name.clone());
    }
    Structure::of_unit(fmu, settings, values, plots)
}

fn print(report: &Report, compared: Option<&(Vec<Compared>, Vec<Share>)>, results: Option<&Path>, json: bool) {
    let Report { structure, recording, ending, .. } = report;
    if let Some(shortfall) = report.shortfall() {
        error_line!("the run {shortfall}");
    }
    if json {
        let last: serde_json::Map<_, _> = recording
            .names
            .iter()
            .zip(&recording.columns)
            .map(|(name, values)| (name.clone(), json!(values.last())))
            .collect();
        print_line!(
            "{}",
            json!({ "fmu": structure.name, "ended": ending.word(), "time": report.end(), "last": last,
                           "compared": compared.map(compared_as_json), "warnings": recording.warnings,
                           "results": results.map(console::path) })
        );
        return;
    }
    print_line!("{} until t = {} s", structure.name, report.end());
    for (name, values) in recording.names.iter().zip(&recording.columns) {
        let unit = recording.measure(name).unwrap_or("");
        print_line!(
            "{name:28} {:>14} {unit}",
            adaptive_fmu::report::number(values.last().copied().unwrap_or(f64::NAN))
        );
    }
    compared.into_iter().flat_map(compared_lines).for_each(|line| print_line!("{line}"));
    recording.warnings.iter().for_each(|warning| aside!("warning: {warning}"));
    if let Some(results) = results {
        aside!("index.html (the report), result.csv and plot.svg are in {}", results.display());
    }
}
