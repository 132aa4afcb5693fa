//! `dist`: archives and wheels for users without Rust.

use std::path::{Path, PathBuf};

use adaptive_fmu::distribution;
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Binary, Library};
use serde_json::json;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the archives
    #[arg(long, default_value = "dist")]
    out: PathBuf,
    /// Wheels for pip instead, which hold the Python package, too
    #[arg(long)]
    wheels: bool,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Writes an archive, or a wheel, for every platform that this program was built for.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let library = Library::beside_program()?.with_other_platforms()?;
    library.left_out().iter().for_each(|warning| tell!("warning: {warning}"));
    let programs = exporter::programs()?;
    let form = if arguments.wheels { distribution::write_wheel } else { distribution::write };
    let write = |program: &Binary| form(program, &library, Path::new("."), &arguments.out);
    let files = programs.iter().map(write).collect::<Result<Vec<_>, _>>()?;
    if arguments.json {
        say!("{}", json!({ "archives": files }));
    } else {
        files.iter().for_each(|file| say!("{}", file.display()));
    }
    Ok(())
}
