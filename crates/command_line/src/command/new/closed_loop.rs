//! `new loop`: the structure of a loop for given units.

use std::path::{Path, PathBuf};

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::output::{Files, make_folder};
use adaptive_fmu::structure::{Draft, Found, STRUCTURE, Wishes};

use serde_json::{Value, json};

use super::there_already;
use crate::command::linearise::assignment;
use crate::command::number::positive;

/// Largest number of components whose names are listed.
const MOST_LINES: usize = 20;

#[derive(clap::Args)]
pub struct Arguments {
    /// Components of the loop: FMUs of any tool, description files, or names of FMUs of this package.
    ///
    /// NAME= sets the name of a component in the loop. By default it is named by its role (such as reference, plant or
    /// controller) if no other component has that role, else by its file.
    #[arg(long, value_name = "[NAME=]FILE", required = true, num_args = 1..)]
    units: Vec<String>,
    /// Folder for SystemStructure.ssd, created if it does not exist
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
    /// Overwrite an existing SystemStructure.ssd
    #[arg(long)]
    force: bool,
    /// Name of the loop and of its results folder [default: name of the folder of --out]
    #[arg(long)]
    name: Option<String>,
    /// Communication step, s [default: the shortest that an FMU proposes, or 0.001]
    #[arg(long, value_parser = positive)]
    step: Option<f64>,
    /// Stop time, s [default: the latest that an FMU proposes, or 10]
    #[arg(long, value_parser = positive)]
    until: Option<f64>,
    /// Connect an input of a component to an output, where their names differ (repeatable)
    ///
    /// For example --connect plant.u=controller.voltage, with the names of components in the loop. Arrays of equal length are
    /// connected element by element. Such a connection replaces the one that names lead to.
    #[arg(long, value_name = "INPUT=OUTPUT", value_parser = assignment)]
    connect: Vec<(String, String)>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Writes the structure, and prints the connections and the open inputs and outputs.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let out = &arguments.out;
    let is_new = !out.exists();
    let folder = make_folder(out, "")?;
    let written = write(arguments, &folder);
    if written.is_err() && is_new {
        // A refused command leaves no empty folder. One that something lies in isn't removed.
        let _ = std::fs::remove_dir(&folder);
    }
    written
}

fn write(arguments: &Arguments, folder: &Path) -> Result<(), Error> {
    let mut found = Found::new(folder);
    given_once(&arguments.units)?;
    let units = arguments.units.iter().map(|word| found.unit(word)).collect::<Result<Vec<_>, _>>()?;
    let name = match &arguments.name {
        Some(name) => name.clone(),
        None => name_of(folder),
    };
    let connections = arguments.connect.clone();
    let draft = Draft::new(units, Wishes { name, step: arguments.step, stop_time: arguments.until, connections })?;
    let text = draft.text();
    let checked = draft.check(&text, folder)?;
    let mut files = Files::at(folder);
    if arguments.force {
        files.add(STRUCTURE, &text)?
    } else {
        files.add_new(STRUCTURE, &text).map_err(there_already)?
    }
    files.place().map_err(there_already)?;
    let warnings = checked.notes.iter().map(|note| format!("warning: {note}"));
    let refusal = checked.refusal.iter().map(|refusal| format!("warning: `run` will refuse this structure: {refusal}"));
    let warnings: Vec<_> = warnings.chain(refusal).collect();
    let file = folder.join(STRUCTURE);
    if arguments.json {
        print_line!("{}", in_json(&draft, &file, &warnings))
    } else {
        print_summary(&draft, &file, &warnings)
    }
    Ok(())
}

fn in_json(draft: &Draft, file: &Path, warnings: &[String]) -> Value {
    let open: Vec<_> = draft.undecided().map(|(input, reason)| json!({ "input": input, "reason": reason })).collect();
    let adapted: Vec<_> = draft.adapted().collect();
    json!({ "structure": file, "connected": draft.connected(), "open": open, "unneeded": draft.unneeded(),
            "adapted": adapted, "warnings": warnings })
}

fn print_summary(draft: &Draft, file: &Path, warnings: &[String]) {
    print_line!("{}", file.display());
    let (connected, open, unneeded) = (draft.connected(), draft.open(), draft.unneeded());
    print_line!("connected inputs: {connected}; open inputs, each with a comment in the file: {}", open.len());
    if !unneeded.is_empty() {
        print_line!("inputs that need no connection: {}", first(&unneeded).join(", "));
    }
    draft.adapted().for_each(|line| remark!("{line}"));
    first(&open).iter().for_each(|line| remark!("to decide: {line}"));
    warnings.iter().for_each(|warning| error_line!("{warning}"));
}

/// Refuses a name in the loop that is given to two units.
fn given_once(words: &[String]) -> Result<(), Error> {
    let given = |word: &String| word.split_once('=').map(|(name, _)| name.to_owned());
    let names: Vec<_> = words.iter().filter_map(given).collect();
    let twice = names.iter().enumerate().find(|(place, name)| names[..*place].contains(name));
    let refuse = |name: &String| {
        Error::Argument(Invalid::new(
            "--units",
            name,
            "this name is given to several FMUs; each component needs its own name",
        ))
    };
    twice.map_or(Ok(()), |(_, name)| Err(refuse(name)))
}

/// The first of many lines, and how many more there are.
fn first(lines: &[String]) -> Vec<String> {
    let more = lines.len().saturating_sub(MOST_LINES);
    let mut shown: Vec<_> = lines.iter().take(MOST_LINES).cloned().collect();
    shown.extend((more > 0).then(|| format!("and {more} more")));
    shown
}

/// The name of a folder without what a loop's name can't hold.
fn name_of(folder: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let own = whole.file_name().unwrap_or_default().to_string_lossy();
    let plain = |c: char| if c.is_alphanumeric() || "_-. ".contains(c) { c } else { '_' };
    let name: String = own.chars().map(plain).collect();
    let name = name.trim_start_matches('.');
    if name.is_empty() { "loop".to_owned() } else { name.to_owned() }
}
