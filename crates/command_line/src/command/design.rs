//! `design`: from a plant to the recommended controller.

use std::path::PathBuf;
use std::process::ExitCode;

use adaptive_fmu::designs::{
    Candidate, Design, Followed, Judged, Kind, Noise, Task, figures, files, page, ranked, shortfall,
};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::exporter::Library;
use adaptive_fmu::output::{Files, make_folder};
use adaptive_fmu::template::{Plant, USUAL_UNCERTAINTY, references};
use adaptive_fmu::{near, parallel};
use serde_json::{Value, json};

use super::hosting::HostingOptions;
use super::linearise::assignment;
use super::names::{Names, Which};
use super::new::plant::{Asked, RegionOptions, find};
use super::new::there_already;
use super::number::{finite, part, positive};
use super::open::OpenOption;
use super::trim::TrimOptions;
use crate::console;

/// The page, in the folder.
const PAGE: &str = "index.html";

#[derive(clap::Args)]
pub struct Arguments {
    /// Plant: matrices in JSON, as for `new --plant`, or an FMU of any tool, which is linearised
    #[arg(value_name = "PLANT.json or PLANT.fmu")]
    plant: PathBuf,
    /// Outputs to control, as many as the plant has inputs [default: all]
    #[arg(long, alias = "outputs", value_name = "NAME,…")]
    output: Option<Names>,
    /// Inputs to use [default: all]
    #[arg(long, value_name = "NAME,…")]
    inputs: Option<Names>,
    /// Time in which the nominal loop is to settle to 2 % of a step of the reference, s
    #[arg(long, value_name = "TIME", value_parser = positive, required_unless_present = "bandwidth")]
    settling_time: Option<f64>,
    /// Bandwidth of the loop, in place of one that follows from --settling-time, rad/s
    #[arg(long, value_parser = positive)]
    bandwidth: Option<f64>,
    /// States that are measured, in addition to the controlled outputs [default: all]
    ///
    /// Only controllers that need no other signals are candidates.
    #[arg(long, value_name = "NAME,…")]
    measured: Option<Names>,
    /// Uncertainty of each number of A and B, as 20% or 0.2 [default: 20%, or that of the records of PLANT]
    #[arg(long, value_name = "PART", value_parser = part)]
    uncertainty: Option<f64>,
    #[command(flatten)]
    region: RegionOptions,
    /// Kinds of controllers to try [default: all that `design` knows]
    #[arg(long, value_name = "KIND,…")]
    kinds: Option<Names>,
    /// Usual magnitude of the reference, in the output's unit of measurement, or of each reference
    #[arg(long, value_name = "NUMBER,…", default_value = "1", value_delimiter = ',', value_parser = positive)]
    reference: Vec<f64>,
    /// Standard deviation of the noise of the measured signals, or of one of them (repeatable)
    #[arg(long, value_name = "[NAME=]DEVIATION", value_parser = noise)]
    noise: Vec<Noise>,
    /// Time at which an FMU is linearised, s [default: its start time]
    #[arg(long, value_name = "TIME", value_parser = finite)]
    at: Option<f64>,
    /// Start value of a parameter, or constant value of an input, of an FMU (repeatable)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
    #[command(flatten)]
    trim: TrimOptions,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Folder for descriptions, a loop and the page
    #[arg(long, value_name = "FOLDER", default_value = "design")]
    out: PathBuf,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Noise of a signal, or of all.
fn noise(text: &str) -> Result<Noise, String> {
    let (signal, number) = text.split_once('=').map_or((None, text), |(name, number)| (Some(name.trim()), number));
    let deviation = number.trim().parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0);
    let deviation = deviation.ok_or("must be a finite number, at least 0, or NAME=NUMBER")?;
    Ok(Noise { signal: signal.map(str::to_owned), deviation })
}

/// Designs, compares and writes; the exit code is 3 where no candidate is sound.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let kinds = kinds(arguments.kinds.as_ref())?;
    let (task, note) = task(arguments)?.with_names();
    note.iter().for_each(|note| remark!("{note}"));
    let units = super::ready::units()?;
    let threads = vec![(); parallel::cores().min(kinds.len())];
    let try_one = |(): &(), place: usize| task.candidate(&kinds[place], &units);
    let candidates = parallel::each(&threads, kinds.len(), try_one);
    let order = ranked(&task, &candidates);
    let best = order.first().and_then(|&first| candidates[first].outcome.as_ref().ok());
    let Some(best) = best else {
        let reason = |one: &Candidate| Some(format!("{}: {}", one.kind.name, one.outcome.as_ref().err()?));
        let reasons: Vec<_> = candidates.iter().filter_map(reason).collect();
        let reason = format!("no controller was found for this plant. {}", reasons.join("; "));
        return Err(Error::Description { file: arguments.plant.clone(), reason });
    };
    write(arguments, &task, &candidates, &order, (best, units.library()))?;
    if arguments.json {
        print_line!("{}", as_json(&candidates, &order, arguments));
    } else {
        print(&task, &candidates, &order, arguments);
    }
    arguments.open.show(&arguments.out.join(PAGE));
    Ok(if best.verdict() == Judged::Sound { ExitCode::SUCCESS } else { ExitCode::from(3) })
}

/// The task of a command line.
fn task(arguments: &Arguments) -> Result<Task, Error> {
    let named = |names: &Option<Names>| names.clone().map(Which::Named);
    let (inputs, outputs) = (named(&arguments.inputs), named(&arguments.output));
    let is_fmu = arguments.plant.extension().is_some_and(|extension| extension == "fmu");
    if !is_fmu && (arguments.at.is_some() || !arguments.set.is_empty() || !arguments.trim.is_empty()) {
        let reason =
            "--at, --set, --free, --want and --hold are for an FMU as the plant; a file of matrices is linear already";
        return Err(Error::Description { file: arguments.plant.clone(), reason: reason.to_owned() });
    }
    let asked = Asked {
        inputs: inputs.as_ref(),
        outputs: outputs.as_ref(),
        at: arguments.at,
        set: &arguments.set,
        trim: arguments.trim.clone(),
        hosting: arguments.hosting.clone(),
        region: arguments.region.clone(),
        ..Asked::default()
    };
    let plant = find(&asked, &arguments.plant)?;
    let (_, m, p) = plant.sizes();
    if m != p {
        let given = if plant.y.names.is_empty() { format!("{p} outputs") } else { plant.y.names.join(", ") };
        let allowed = format!(
            "must be {m}, one for each input: choose them with --output NAME,…, or inputs with --inputs NAME,…"
        );
        return Err(Error::Argument(Invalid::new("--output", given, allowed)));
    }
    let references = references(&arguments.reference, p).map_err(Error::Argument)?;
    let signals: Vec<_> = arguments.noise.iter().filter_map(|noise| noise.signal.clone()).collect();
    known("--noise", &plant, &signals)?;
    Ok(Task {
        measures_states: measures_states(&plant, arguments.measured.as_ref())?,
        settling_time: arguments.settling_time,
        bandwidth: arguments.bandwidth,
        uncertainty: arguments.uncertainty.or(if plant.records.is_none() { Some(USUAL_UNCERTAINTY) } else { None }),
        plant,
        references,
        noise: arguments.noise.clone(),
    })
}

/// True if all states are measured.
fn measures_states(plant: &Plant, measured: Option<&Names>) -> Result<bool, Error> {
    let Some(Names(measured)) = measured else {
        return Ok(plant.records.as_ref().is_none_or(|records| records.measures_states));
    };
    known("--measured", plant, measured)?;
    let states = &plant.x.names;
    Ok(!states.is_empty() && states.iter().all(|state| measured.contains(state)))
}

/// Refuses names that no state and no output of the plant has.
fn known(option: &str, plant: &Plant, names: &[String]) -> Result<(), Error> {
    let outputs = plant.y.names.iter().filter(|name| !plant.x.names.contains(name));
    let known: Vec<_> = plant.x.names.iter().chain(outputs).map(String::as_str).collect();
    let unknown = names.iter().find(|name| !known.contains(&name.as_str()));
    let refuse = |name: &String| {
        let allowed = format!("is no state or output of the plant; {}", near::choice(name, &known, ""));
        Err(Error::Argument(Invalid::new(option, name, allowed)))
    };
    unknown.map_or(Ok(()), refuse)
}

/// The kinds that are asked for.
fn kinds(names: Option<&Names>) -> Result<Vec<Kind>, Error> {
    let all = Kind::all();
    let Some(Names(names)) = names else { return Ok(all) };
    let known: Vec<_> = all.iter().map(|kind| kind.name.as_str()).collect();
    let find = |name: &String| {
        let unknown = || Error::unknown("kind for `design`", name, known.iter().copied(), "");
        all.iter().find(|kind| kind.name == *name).cloned().ok_or_else(unknown)
    };
    names.iter().map(find).collect()
}

/// Writes descriptions, the loop and the page.
fn write(
    arguments: &Arguments,
    task: &Task,
    candidates: &[Candidate],
    order: &[usize],
    (best, library): (&Design, &Library),
) -> Result<(), Error> {
    let out = make_folder(&arguments.out, "")?;
    let name = out.canonicalize().unwrap_or_else(|_| out.clone());
    let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let plant = arguments.plant.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let page = (PAGE.to_owned(), page(task, candidates, order, &plant));
    let mut written = Files::at(&out);
    for (name, text) in files(task, candidates, best, (&name, library))?.into_iter().chain([page]) {
        match arguments.force {
            true => written.add(&name, &text)?,
            false => written.add_new(&name, &text).map_err(there_already)?,
        }
    }
    written.place().map_err(there_already)
}

/// The columns of the table.
const COLUMNS: [&str; 9] =
    ["", "settles", "worst", "overshoot", "worst", "peak of the control", "noise", "margins", "operations"];

fn print(task: &Task, candidates: &[Candidate], order: &[usize], arguments: &Arguments) {
    let designed =
        order.iter().filter_map(|&place| Some((&candidates[place].kind, candidates[place].outcome.as_ref().ok()?)));
    let rows: Vec<_> = [COLUMNS.map(str::to_owned)]
        .into_iter()
        .chain(designed.clone().map(|(kind, design)| {
            let [settles, worst, overshoot, more, peaks, noise, margins, operations] = figures(task, design);
            [kind.name.clone(), settles, worst, overshoot, more, peaks, noise, margins, operations]
        }))
        .collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<_> = (0..COLUMNS.len()).map(width).collect();
    let has_noise = !task.noise.is_empty();
    for row in &rows {
        let shown = (0..COLUMNS.len()).filter(|&column| has_noise || COLUMNS[column] != "noise");
        let cells = shown.map(|column| format!("{:1$}", row[column], widths[column]));
        print_line!("{}", cells.collect::<Vec<_>>().join("  ").trim_end());
    }
    print_line!("");
    for (place, (kind, design)) in designed.enumerate() {
        match design.reason() {
            None if place == 0 => {
                let but = shortfall(task, design).map_or_else(String::new, |what| format!(", although {what}"));
                print_line!("{}: recommended{but}", kind.name);
            }
            None => {}
            Some(reason) => print_line!("{}: {}: {reason}", kind.name, design.verdict().words()),
        }
        design.notes.iter().for_each(|note| print_line!("{}: {note}", kind.name));
    }
    for candidate in candidates {
        if let Err(reason) = &candidate.outcome {
            print_line!("{}: {reason}", candidate.kind.name);
        }
    }
    aside!(
        "descriptions, the loop of the first (`adaptive-fmu run {}`) and {PAGE} are in {}",
        arguments.out.join("loop").display(),
        arguments.out.display()
    );
}

fn as_json(candidates: &[Candidate], order: &[usize], arguments: &Arguments) -> Value {
    let followed = |followed: &Followed| json!({ "settling_time": followed.settling, "overshoot": followed.overshoot, "error_at_end": followed.off, "peaks": followed.peaks });
    let one = |&place: &usize| {
        let Candidate { kind, outcome } = &candidates[place];
        match outcome {
            Err(reason) => json!({ "kind": kind.name, "refused": reason }),
            Ok(design) => json!({
                "kind": kind.name,
                "sound": design.verdict() == Judged::Sound,
                "verdict": design.verdict().words(),
                "reason": design.reason(),
                "files": design.texts.iter().map(|(name, _)| console::path(&arguments.out.join(format!("{name}.toml")))).collect::<Vec<_>>(),
                "bandwidth": design.bandwidth,
                "step": design.step,
                "duration": design.duration(),
                "nominal": design.followed().map(followed),
                "worst": design.worst().as_ref().map(followed),
                "noise": design.noise,
                "operations": design.operations,
                "summary": design.report.summary,
                "notes": design.notes,
            }),
        }
    };
    let loop_ = arguments.out.join("loop");
    json!({
        "candidates": order.iter().map(one).collect::<Vec<_>>(),
        "loop": console::path(&loop_),
        "page": console::path(&arguments.out.join(PAGE)),
    })
}
