//! `export`: descriptions become FMUs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library};
use serde_json::json;

#[derive(clap::Args)]
pub struct Arguments {
    /// FMUs of this package, or description files (NAME.toml); all FMUs of this package where none is named
    names: Vec<String>,
    /// All FMUs of this package
    #[arg(long, conflicts_with = "names")]
    all: bool,
    /// A whole loop as one FMU, integrated together (repeatable); only these where no FMU is named
    #[arg(long, value_name = "LOOP")]
    composite: Vec<String>,
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
}

/// Writes the FMUs that are asked for, and closes a loop through them.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { names, all: every, composite, out, library, run, json } = arguments;
    let library = library.as_deref().map_or_else(Library::beside_program, Library::open)?;
    let names = if *every || (names.is_empty() && composite.is_empty()) { all() } else { names.clone() };
    let mut files = export(&names, &library, out)?;
    for name in composite {
        let (structure, _) = super::run::find_loop(name)?;
        files.push(exporter::export(&exporter::composite(&structure)?, &library, out)?);
    }
    if *json {
        println!("{}", json!({ "fmus": files }));
    } else {
        files.iter().for_each(|file| println!("{}", file.display()));
    }
    let close = |name: &String| super::run::execute(&super::run::Arguments::of(name, out, *json));
    run.as_ref().map_or(Ok(ExitCode::SUCCESS), close)
}

/// The names of all FMUs of this package.
fn all() -> Vec<String> {
    exporter::descriptions().iter().map(|(name, _)| (*name).to_owned()).collect()
}

/// Writes FMUs into a folder; their paths.
pub fn export(names: &[String], library: &Library, out: &Path) -> Result<Vec<PathBuf>, Error> {
    let build = library.describe(None)?.build;
    if !build.optimised {
        eprintln!("warning: the library was built without optimisation and is slow; build it with --release");
    }
    names.iter().map(|name| exporter::export(&exporter::find_description(name)?, library, out)).collect()
}
