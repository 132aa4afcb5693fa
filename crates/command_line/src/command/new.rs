//! `new`: the description of the user's own FMU, with a comment at each setting, ready for export; and the structure of
//! a loop of given components.

mod closed_loop;
mod excitation;
pub mod plant;

use std::ffi::{OsStr, OsString};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::output::Files;
use adaptive_fmu::template::{Request, Sizes};
use adaptive_fmu::{library, schema};
use clap::builder::PossibleValuesParser;

use self::excitation::{ExperimentOptions, is_experiment};
use super::hosting::HostingOptions;
use super::linearise::assignment;
use super::names::{Names, Which};
use super::number::{finite, part, positive};
use super::trim::TrimOptions;
use super::{check, identify};
use crate::console;

#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Arguments {
    #[command(subcommand)]
    other: Option<Other>,
    #[command(flatten)]
    unit: UnitArguments,
}

#[derive(clap::Subcommand)]
enum Other {
    /// Write the structure of a loop of given FMUs, connected by the names of their signals
    Loop(closed_loop::Arguments),
}

/// The kind and the name are there where no other form is asked for.
#[derive(clap::Args, Clone)]
pub struct UnitArguments {
    /// Kind of FMU: controller, observer, plant (state-space), reference, experiment (excitation), sensor or actuator
    #[arg(required = true, value_parser = PossibleValuesParser::new(library::begun().map(|entry| entry.kind.name)))]
    kind: Option<String>,
    /// Name of the FMU, a C identifier
    #[arg(long, required = true)]
    name: Option<String>,
    /// Number of states of the plant [default: depends on KIND, mostly 2]
    ///
    /// For an FMU as --plant that declares no states, give the names of its states [default: all its Real outputs].
    #[arg(long, value_name = "COUNT or NAME,…")]
    states: Option<Which>,
    /// Number of inputs of the plant, which are the controls of a controller [default: depends on KIND, mostly 1]
    ///
    /// With --plant, give the names of the inputs to use [default: all]. With excitation, names are those of the plant's inputs.
    #[arg(long, value_name = "COUNT or NAME,…")]
    inputs: Option<Which>,
    /// Number of outputs of the plant, or of channels [default: depends on KIND, mostly 1]
    ///
    /// With --plant, give the names of the outputs to use [default: all].
    #[arg(long, value_name = "COUNT or NAME,…")]
    outputs: Option<Which>,
    /// Nominal plant: matrices in JSON, or an FMU of any tool, which is linearised [default: chains of integrators]
    ///
    /// The JSON file contains A, B, C, and optionally D, or num and den of a transfer function; also the dead time of the inputs,
    /// names, units of measurement and limits of the signals, and the sample time dt of a model in discrete time.
    /// `linearise --json` prints this format.
    #[arg(long, value_name = "FILE.json or FILE.fmu")]
    plant: Option<PathBuf>,
    /// Records of the plant (.csv, .parquet, .mat): `identify` makes NAME.json of them, which is the nominal plant then (repeatable)
    ///
    /// --inputs and --states, or only --outputs, give the names of their columns.
    #[arg(long, value_name = "RECORD", conflicts_with = "plant", requires = "inputs")]
    data: Vec<PathBuf>,
    /// Known entries of that plant, as for `identify`
    #[arg(long, value_name = "FILE.toml", requires = "data")]
    structure: Option<PathBuf>,
    /// Time at which the FMU of --plant is linearised, s [default: its start time]
    #[arg(long, value_name = "TIME", requires = "plant", value_parser = finite)]
    at: Option<f64>,
    /// Start value of a parameter, or constant value of an input, of the FMU of --plant (repeatable)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment, requires = "plant")]
    set: Vec<(String, String)>,
    /// Communication step to linearise the FMU of --plant, s [default: the one it proposes, or 0.001]
    ///
    /// With excitation it is also the step of the signal [default: 1/200 of the settling time, or a fifth of the time of the fastest pole
    /// of --plant, rounded down].
    #[arg(long, value_parser = positive)]
    step: Option<f64>,
    #[command(flatten)]
    trim: TrimOptions,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Bandwidth of the controlled system, rad/s [default: twice that of the plant's slowest stable pole not at 0]
    ///
    /// If there is no such pole, the default is the plant's largest pole. A plant whose poles are all at 0 has no default.
    /// Without a plant, and for neuro-ppf, it is 2 rad/s.
    #[arg(long, value_parser = positive)]
    bandwidth: Option<f64>,
    /// Usual magnitude of the reference, in the output's unit of measurement, or of each reference [default: 1]
    #[arg(long, value_name = "NUMBER,…", value_delimiter = ',', value_parser = positive)]
    reference: Vec<f64>,
    /// Uncertainty of the numbers of --plant, as 20% or 0.2: L1 controllers are designed for it, other descriptions keep it for `check`
    #[arg(long, value_name = "PART", value_parser = part)]
    uncertainty: Option<f64>,
    #[command(flatten)]
    region: plant::RegionOptions,
    #[command(flatten)]
    experiment: ExperimentOptions,
    /// File to write [default: NAME.toml]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Overwrite an existing file of that name
    #[arg(long)]
    force: bool,
    /// Do not write the JSON schema for editors next to the file
    #[arg(long)]
    no_schema: bool,
}

/// Writes a description, or the structure of a loop; the exit code is 3 for a description whose design is not sound.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let unit = &arguments.unit;
    match (&arguments.other, &unit.kind, &unit.name) {
        (Some(Other::Loop(arguments)), ..) => closed_loop::execute(arguments).map(|()| ExitCode::SUCCESS),
        (None, Some(kind), Some(name)) => write_unit(kind, name, unit),
        // The parser refuses that.
        (None, ..) => Ok(ExitCode::SUCCESS),
    }
}

/// Writes the description, with the schema by which editors complete it; or the table of an experiment.
fn write_unit(kind: &str, name: &str, arguments: &UnitArguments) -> Result<ExitCode, Error> {
    let UnitArguments { bandwidth, reference, uncertainty, experiment, .. } = arguments;
    experiment.check(kind, arguments)?;
    let file = arguments.out.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.{}", ending(arguments))));
    let identified = recorded(arguments, &file)?;
    let plant_file = identified.as_ref().map(|(file, _)| file).or(arguments.plant.as_ref());
    let (plant, sizes) = match plant_file {
        Some(file) => {
            let asked = of_plant(kind, file, arguments);
            // The states of a model from records were chosen when it was made.
            let states = asked.states.filter(|_| identified.is_none());
            (Some(plant::find(&plant::Asked { states, ..asked }, file)?), Sizes::default())
        }
        None if is_experiment(kind) => (None, excitation::sizes(arguments)?),
        None => (None, plant::sizes(arguments)?),
    };
    if let Some((option, value)) = arguments.region.given() {
        library::check_uncertainty(kind, option, plant.is_some(), value).map_err(Error::Argument)?;
    }
    let asked = experiment.asked(arguments);
    let experiment = experiment.experiment(&asked, arguments.step);
    let experiment = is_experiment(kind).then_some(&experiment);
    let (bandwidth, uncertainty) = (*bandwidth, *uncertainty);
    let reference = if reference.is_empty() { &[1.0] } else { reference.as_slice() };
    let request = Request { kind, name, sizes, plant, bandwidth, reference, uncertainty, experiment };
    let refuse = |reason: String| Error::Description { file: file.clone(), reason };
    // With a plant, what is refused is about it.
    let about = plant_file.unwrap_or(&file).clone();
    let begun =
        library::begin(&request).map_err(|invalid| Error::Description { file: about, reason: invalid.to_string() })?;
    let made = Description::read(&begun.text).and_then(|own| Model::from_description(own, library::REGISTRY));
    let made = made.map_err(|invalid| refuse(invalid.to_string()))?;
    let code = identified.map_or(ExitCode::SUCCESS, |(_, code)| code);
    if arguments.experiment.csv {
        write(&file, &excitation::table(made)?, false, arguments.force)?;
        begun.notes.iter().for_each(|note| remark!("{note}"));
        return Ok(code);
    }
    let mut text = begun.text;
    if !arguments.no_schema {
        text.insert_str(0, &format!("#:schema ./{}\n", schema::FILE));
    }
    write(&file, &text, !arguments.no_schema, arguments.force)?;
    begun.notes.iter().for_each(|note| remark!("{note}"));
    let report = made.report();
    if let Some(reason) = report.reason() {
        error_line!("Not sound: {reason}");
    }
    Ok(if code == ExitCode::SUCCESS { check::exit_code(&report) } else { code })
}

/// The file of the model that records give, in the folder of the description, and the exit code of `identify`.
fn recorded(arguments: &UnitArguments, out: &Path) -> Result<Option<(PathBuf, ExitCode)>, Error> {
    let UnitArguments { data, structure, inputs, states, outputs, force, .. } = arguments;
    if data.is_empty() {
        return Ok(None);
    }
    let names = |option: &str, which: &Option<Which>| match which {
        Some(Which::Named(Names(names))) => Ok(Some(format!("{option}={}", names.join(",")))),
        Some(Which::Count(count)) => {
            let allowed = "must be names of columns of the records";
            Err(Error::Argument(Invalid::new(option, count, allowed)))
        }
        None => Ok(None),
    };
    let model = out.with_extension("json");
    let measured = names("--states", states)?.map_or_else(|| names("--outputs", outputs), |states| Ok(Some(states)))?;
    if measured.is_none() {
        let reason = "--data needs --states NAME,…, the columns that are the plant's states, or --outputs NAME,… where not all of them \
                      were measured";
        return Err(Error::Argument(Invalid::because(reason)));
    }
    let mut asked: Vec<OsString> = data.iter().map(|file| file.clone().into_os_string()).collect();
    asked.extend([names("--inputs", inputs)?, measured].into_iter().flatten().map(OsString::from));
    asked.extend(["--out".into(), model.clone().into_os_string()]);
    asked.extend(structure.iter().flat_map(|file| ["--structure".into(), file.clone().into_os_string()]));
    asked.extend(force.then(|| "--force".into()));
    Ok(Some((model, identify::execute(&identify::Arguments::of(asked)?)?)))
}

/// The ending of the file that is written.
fn ending(arguments: &UnitArguments) -> &'static str {
    if arguments.experiment.csv { "csv" } else { "toml" }
}

/// Options for the plant: the step of an experiment is none for matrices.
fn of_plant<'a>(kind: &str, file: &Path, arguments: &'a UnitArguments) -> plant::Asked<'a> {
    let asked = plant::Asked::of(arguments);
    let is_fmu = file.extension().is_some_and(|extension| extension == "fmu");
    let step = asked.step.filter(|_| is_fmu || !is_experiment(kind));
    plant::Asked { step, ..asked }
}

/// Writes a file, and the schema next to it where it is a description.
fn write(file: &Path, text: &str, with_schema: bool, force: bool) -> Result<(), Error> {
    let schema = if with_schema { schema::text() } else { String::new() };
    let mut texts = vec![(PathBuf::from(name_of(file)?), text, force)];
    texts.extend(with_schema.then(|| (PathBuf::from(schema::FILE), schema.as_str(), true)));
    place(file, &texts)?;
    print_line!("{}", file.display());
    if with_schema {
        print_line!("{}", file.with_file_name(schema::FILE).display());
    }
    Ok(())
}

/// The name of a file.
pub fn name_of(file: &Path) -> Result<&OsStr, Error> {
    let refuse = || Error::Description { file: file.to_owned(), reason: "must be the name of a file".to_owned() };
    file.file_name().ok_or_else(refuse)
}

/// Writes texts into the folder of a file, all of them or none: name, text, and true if it replaces a file of that name.
pub fn place(file: &Path, texts: &[(PathBuf, &str, bool)]) -> Result<(), Error> {
    let mut files = Files::at(file.parent().unwrap_or(Path::new("")));
    for (name, text, replaces) in texts {
        if *replaces {
            files.add(name, text)?;
        } else {
            files.add_new(name, text).map_err(there_already)?;
        }
    }
    files.place().map_err(there_already)
}

/// Adds to an error how to overwrite an existing file.
pub fn there_already(error: Error) -> Error {
    match error {
        Error::File { file, source } if source.kind() == ErrorKind::AlreadyExists => {
            let force = if console::serves() { "force=True" } else { "--force" };
            Error::Description { file, reason: format!("the file exists. Use {force} to overwrite it") }
        }
        other => other,
    }
}
