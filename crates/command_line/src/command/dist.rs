//! `dist`: archives and wheels for users without Rust.

use std::path::{Path, PathBuf};

use adaptive_fmu::distribution;
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Binary, Library};
use clap_complete::Shell;
use serde_json::json;

use super::{completions, manual};
use crate::console;

/// Places where shells look for completions.
const COMPLETIONS: [(Shell, &str); 3] = [
    (Shell::Bash, "bash-completion/completions/adaptive-fmu"),
    (Shell::Zsh, "zsh/site-functions/_adaptive-fmu"),
    (Shell::Fish, "fish/vendor_completions.d/adaptive-fmu.fish"),
];

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the archives
    #[arg(long, default_value = "dist")]
    out: PathBuf,
    /// Write wheels for pip instead, which also contain the Python package
    #[arg(long)]
    wheels: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Writes an archive, or a wheel, for every platform that this program was built for.
pub fn execute(arguments: &Arguments, command: &clap::Command) -> Result<(), Error> {
    let shell = shell_files(command)?;
    let library = Library::next_to_program()?.with_other_platforms()?;
    library.left_out().iter().for_each(|warning| error_line!("warning: {warning}"));
    let programs = exporter::programs()?;
    let form = if arguments.wheels { distribution::write_wheel } else { distribution::write };
    let write = |program: &Binary| form(program, &library, Path::new("."), &shell, &arguments.out);
    let files = programs.iter().map(write).collect::<Result<Vec<_>, _>>()?;
    if arguments.json {
        print_line!("{}", json!({ "archives": files.iter().map(|file| console::path(file)).collect::<Vec<_>>() }));
    } else {
        files.iter().for_each(|file| print_line!("{}", file.display()));
    }
    Ok(())
}

/// Manual pages and completions, where shells look for them below `share`.
fn shell_files(command: &clap::Command) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let pages = manual::pages(command)?.into_iter().map(|(name, text)| (format!("man/man1/{name}"), text));
    let script = |(shell, file): (Shell, &str)| (file.to_owned(), completions::script(shell, command).into_bytes());
    Ok(pages.chain(COMPLETIONS.map(script)).collect())
}
