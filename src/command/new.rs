//! `new`: the description of a unit of one's own, with a comment at each setting, ready to be exported as it stands.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use adaptive_fmu::error::Error;
use adaptive_fmu::schema;
use adaptive_fmu::template::{self, MOST, Plant, Request, Sizes};
use clap::builder::PossibleValuesParser;

use super::loop_options::positive;

#[derive(clap::Args)]
pub struct Arguments {
    /// What it is to be: a controller, an observer, a plant, or what stands between
    #[arg(value_parser = PossibleValuesParser::new(template::KINDS))]
    kind: String,
    /// Its name: a C identifier
    #[arg(long)]
    name: String,
    /// Number of states of the plant
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=MOST))]
    states: Option<u16>,
    /// Number of inputs of the plant, which are a controller's controls
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=MOST))]
    inputs: Option<u16>,
    /// Number of outputs of the plant, or of channels
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=MOST))]
    outputs: Option<u16>,
    /// Nominal plant: A, B, C, D, and optionally names, units and limits, in JSON
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["states", "inputs", "outputs"])]
    plant: Option<PathBuf>,
    /// How fast the controlled system is to be at least, rad/s; the plant's own slowest pole where it isn't given
    #[arg(long, value_parser = positive)]
    bandwidth: Option<f64>,
    /// Usual magnitude of the reference, in the unit of the output
    #[arg(long, default_value = "1", value_parser = positive)]
    reference: f64,
    /// File to write; NAME.toml unless given
    #[arg(long)]
    out: Option<PathBuf>,
    /// Whether a file of that name is overwritten
    #[arg(long)]
    force: bool,
    /// No schema for editors beside it
    #[arg(long)]
    no_schema: bool,
}

/// Writes the description, and beside it the schema by which editors complete it.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let Arguments { kind, name, states, inputs, outputs, bandwidth, reference, force, .. } = arguments;
    let size = |size: &Option<u16>| size.map(usize::from);
    let sizes = Sizes { states: size(states), inputs: size(inputs), outputs: size(outputs) };
    let plant = arguments.plant.as_deref().map(Plant::read).transpose()?;
    let request = Request { kind, name, sizes, plant, bandwidth: *bandwidth, reference: *reference };
    let file = arguments.out.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.toml")));
    let refuse = |reason: String| Error::Description { file: file.clone(), reason };
    let mut text = template::description(&request).map_err(|invalid| refuse(invalid.to_string()))?;
    if !arguments.no_schema {
        text.insert_str(0, &format!("#:schema ./{}\n", schema::FILE));
    }
    write(&file, &text, *force)?;
    println!("{}", file.display());
    if !arguments.no_schema {
        let schema = file.parent().unwrap_or(Path::new("")).join(schema::FILE);
        std::fs::write(&schema, schema::text()).map_err(Error::file(&schema))?;
        println!("{}", schema.display());
    }
    Ok(())
}

fn write(file: &Path, text: &str, force: bool) -> Result<(), Error> {
    let mut options = OpenOptions::new();
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let mut opened = options.write(true).open(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            let reason = "is there already; --force overwrites it".to_owned();
            Error::Description { file: file.to_owned(), reason }
        }
        _ => Error::file(file)(error),
    })?;
    opened.write_all(text.as_bytes()).map_err(Error::file(file))
}
