//! `run --again`: an earlier run once more.

use std::path::Path;
use std::process::ExitCode;

use adaptive_fmu::begun;
use adaptive_fmu::error::Error;
use adaptive_fmu::results::{Asked, Mark, Recorded, TABLE};
use adaptive_fmu::structure::LoopFiles;
use serde_json::json;

use super::hosting::HostingOptions;
use super::loop_options::LoopOptions;
use super::parameters::Parameters;
use super::progress::Bars;
use super::results::{self, TableOptions};
use super::run::{self, Arguments};
use crate::console;

/// Tag of a repeated run's results.
const TAG: &str = "again";

/// Runs it with the settings stored in its results, and prints the differences. The earlier results stay.
pub fn execute(arguments: &Arguments, folder: &Path) -> Result<ExitCode, Error> {
    let earlier = Recorded::read(folder)?;
    let refuse = |reason: String| Error::Loop { file: folder.to_owned(), reason };
    let stored = earlier.provenance.as_ref();
    let stored = stored.ok_or_else(|| {
        refuse(
            "has no settings of the run, as results of `simulate` and of version 0.1.0. Run the loop again by its name"
                .to_owned(),
        )
    })?;
    results::check(&earlier)?;
    let name = stored.source.name.to_string_lossy().into_owned();
    LoopFiles::find(&name).map_err(|error| {
        refuse(format!(
            "the run used the loop `{name}`, relative to the folder in which it was started. From the current \
             folder: {error}"
        ))
    })?;
    let tables = if arguments.tables.every.is_some() || arguments.tables.parquet {
        arguments.tables.clone()
    } else {
        TableOptions::of(&earlier)
    };
    let folder_of_results = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let repeated = Arguments {
        name: Some(name.clone()),
        again: None,
        all: false,
        variant: None,
        out: Some(arguments.out.clone().unwrap_or_else(|| folder_of_results.to_owned())),
        tag: Some(arguments.tag.clone().unwrap_or_else(|| TAG.to_owned())),
        tables,
        options: options(&stored.settings).map_err(refuse)?,
        open: arguments.open,
        json: arguments.json,
    };
    let place = run::place(&repeated, &name)?;
    if place.canonicalize().is_ok_and(|place| folder.canonicalize().is_ok_and(|folder| folder == place)) {
        return Err(refuse("the repeated run would replace these results. Choose another --tag".into()));
    }
    let done = run::run(&repeated, &name, &Bars::new(repeated.json))?;
    let mut differences = done.provenance.differences(stored);
    let ended = done.report().ending.word();
    if ended != earlier.ended {
        differences.push(format!("the run was {}, is {ended}", earlier.ended));
    }
    let table = |folder: &Path| std::fs::read(begun::path(&folder.join(TABLE))).ok();
    let same = done.folder.as_deref().and_then(table).is_some_and(|csv| Some(csv) == table(folder));
    differences.iter().for_each(|difference| error_line!("differs from {}: {difference}", folder.display()));
    if same {
        error_line!("{TABLE} is identical to that of {}", folder.display());
    } else {
        error_line!("{TABLE} differs from that of {}", folder.display());
    }
    let output = json!({ "of": console::path(folder), "differences": differences, "same_numbers": same });
    run::finish(done, repeated.json, repeated.open, Some(("again", output)))
}

/// The options that give these settings.
fn options(asked: &Asked) -> Result<LoopOptions, String> {
    let Asked {
        stop_time,
        step,
        order,
        composite,
        accept_algebraic_loops,
        cases,
        set,
        events,
        fmus,
        in_process,
        patience,
        ..
    } = asked.clone();
    Ok(LoopOptions {
        linear: false,
        composite,
        fmus,
        step: Some(step),
        until: Some(stop_time),
        order: order.as_deref().map(str::parse).transpose()?,
        accept_algebraic_loops,
        terminals: false,
        parameters: Parameters::of(cases.into_iter().map(|Mark { name, .. }| name).collect(), set, events),
        hosting: HostingOptions { in_process, patience },
    })
}
