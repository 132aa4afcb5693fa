//! `new`: the description of a unit of one's own, with a comment at each setting, ready to be exported as it stands; and
//! the structure of a loop of given units.

mod closed_loop;
mod plant;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use adaptive_fmu::error::Error;
use adaptive_fmu::output::Files;
use adaptive_fmu::template::{Request, Sizes};
use adaptive_fmu::{library, schema};
use clap::builder::PossibleValuesParser;

use super::hosting::HostingOptions;
use super::linearise::{assignment, finite};
use super::names::Which;
use super::number::positive;

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
    /// Writes the structure of a loop for given units, connected by the names of their signals
    Loop(closed_loop::Arguments),
}

/// The kind and the name are there where no other form is asked for.
#[derive(clap::Args)]
struct UnitArguments {
    /// Kind of the unit: a controller, an observer, a plant, or what stands between
    #[arg(required = true, value_parser = PossibleValuesParser::new(library::begun().map(|entry| entry.kind.name)))]
    kind: Option<String>,
    /// Its name: a C identifier
    #[arg(long, required = true)]
    name: Option<String>,
    /// Number of states of the plant; with an FMU for the plant that names none, their names
    #[arg(long, value_name = "COUNT or NAME,…")]
    states: Option<Which>,
    /// Number of inputs of the plant, which are a controller's controls; with a plant, names of those that are used
    #[arg(long, value_name = "COUNT or NAME,…")]
    inputs: Option<Which>,
    /// Number of outputs of the plant, or of channels; with a plant, names of those that are used
    #[arg(long, value_name = "COUNT or NAME,…")]
    outputs: Option<Which>,
    /// Nominal plant: A, B, C, D, and optionally names, units and limits, in JSON; or any FMU, which is linearised
    #[arg(long, value_name = "FILE.json or FILE.fmu")]
    plant: Option<PathBuf>,
    /// With an FMU for the plant: time in s at which it is linearised, in place of the start time
    #[arg(long, value_name = "TIME", requires = "plant", value_parser = finite)]
    at: Option<f64>,
    /// With an FMU for the plant: start value of a parameter, or value of an input, which is held until then
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment, requires = "plant")]
    set: Vec<(String, String)>,
    /// With an FMU for the plant: communication step in s by which it is linearised, in place of the one that it proposes
    #[arg(long, requires = "plant", value_parser = positive)]
    step: Option<f64>,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Least speed of the controlled system, rad/s; that of the plant's own slowest pole unless given
    #[arg(long, value_parser = positive)]
    bandwidth: Option<f64>,
    /// Usual magnitude of the reference, in the unit of the output
    #[arg(long, default_value = "1", value_parser = positive)]
    reference: f64,
    /// File to write; NAME.toml unless given
    #[arg(long)]
    out: Option<PathBuf>,
    /// Overwrites a file of that name
    #[arg(long)]
    force: bool,
    /// No schema for editors beside it
    #[arg(long)]
    no_schema: bool,
}

/// Writes a description, or the structure of a loop.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let unit = &arguments.unit;
    match (&arguments.other, &unit.kind, &unit.name) {
        (Some(Other::Loop(arguments)), ..) => closed_loop::execute(arguments),
        (None, Some(kind), Some(name)) => write_unit(kind, name, unit),
        // The parser refuses that.
        (None, ..) => Ok(()),
    }
}

/// Writes the description, and beside it the schema by which editors complete it.
fn write_unit(kind: &str, name: &str, arguments: &UnitArguments) -> Result<(), Error> {
    let UnitArguments { bandwidth, reference, force, .. } = arguments;
    let (plant, sizes) = match &arguments.plant {
        Some(file) => (Some(plant::find(arguments, file)?), Sizes::default()),
        None => (None, plant::sizes(arguments)?),
    };
    let request = Request { kind, name, sizes, plant, bandwidth: *bandwidth, reference: *reference };
    let file = arguments.out.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.toml")));
    let refuse = |reason: String| Error::Description { file: file.clone(), reason };
    let mut text = library::begin(&request).map_err(|invalid| refuse(invalid.to_string()))?;
    if !arguments.no_schema {
        text.insert_str(0, &format!("#:schema ./{}\n", schema::FILE));
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut files = Files::at(folder);
    let Some(own) = file.file_name() else { return Err(refuse("is no name of a file".to_owned())) };
    if *force {
        files.add(own, &text)?
    } else {
        files.add_new(own, &text).map_err(there_already)?
    }
    if !arguments.no_schema {
        files.add(schema::FILE, schema::text())?;
    }
    files.place().map_err(there_already)?;
    say!("{}", file.display());
    if !arguments.no_schema {
        say!("{}", folder.join(schema::FILE).display());
    }
    Ok(())
}

/// Tells how a file that is there is written all the same.
fn there_already(error: Error) -> Error {
    match error {
        Error::File { file, source } if source.kind() == ErrorKind::AlreadyExists => {
            Error::Description { file, reason: "is there already; --force overwrites it".to_owned() }
        }
        other => other,
    }
}
