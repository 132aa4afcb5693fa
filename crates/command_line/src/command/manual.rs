//! `manual`: manual pages, generated from the command line's own definition.

use std::path::{Path, PathBuf};

use adaptive_fmu::error::Error;
use adaptive_fmu::output::Files;
use clap_mangen::Man;

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the pages
    #[arg(long, default_value = "man1")]
    out: PathBuf,
}

/// Writes the pages, and prints where they are.
pub fn execute(arguments: &Arguments, command: &clap::Command) -> Result<(), Error> {
    let pages = pages(command)?;
    std::fs::create_dir_all(&arguments.out).map_err(Error::file(&arguments.out))?;
    let mut files = Files::at(&arguments.out);
    pages.iter().try_for_each(|(name, text)| files.add(name, text))?;
    files.place()?;
    pages.iter().for_each(|(name, _)| print_line!("{}", arguments.out.join(name).display()));
    Ok(())
}

/// The pages of the program and of each of its commands: names of files, and texts.
pub fn pages(command: &clap::Command) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let mut command = command.clone().disable_help_subcommand(true);
    command.build();
    let mut pages = Vec::new();
    collect(&command, &mut pages).map_err(Error::file(Path::new("manual page")))?;
    Ok(pages)
}

fn collect(command: &clap::Command, pages: &mut Vec<(String, Vec<u8>)>) -> std::io::Result<()> {
    let mut text = Vec::new();
    let page = Man::new(command.clone());
    page.render(&mut text)?;
    pages.push((page.get_filename(), text));
    command.get_subcommands().filter(|command| !command.is_hide_set()).try_for_each(|command| collect(command, pages))
}
