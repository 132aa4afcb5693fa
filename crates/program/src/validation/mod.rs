//! Checks whether an FMU is what the standard (FMI 2.0.4) asks for: its archive, its modelDescription.xml, the functions of its
//! libraries, and a short run. Sections of the standard are named with each finding. Of FMI 3.0, modelDescription.xml is checked as
//! far as a run needs it.

mod aliases;
mod archive;
mod experiment;
mod findings;
mod fmi3;
mod functions;
mod names;
mod schema;
mod structure;
mod text;
mod trial;
mod types;
mod values;
mod variables;

use std::collections::HashSet;
use std::path::Path;

pub use findings::{Finding, Findings, Severity};
pub use trial::Trial;

use crate::error::Error;
use crate::fmi2::calls::Standard;
use crate::fmu::Hosting;
use crate::model_description::xml;
use crate::related::{Fault, Replay, Replayed};
use archive::Archive;
use findings::{At, Lines};
use variables::Variable;

/// Result of the checks of an FMU.
#[derive(Debug)]
pub struct Report {
    /// Its findings, in the order in which they were made.
    pub findings: Findings,
    /// How it was run.
    pub trial: Trial,
    /// Its own experiments, run and compared with their references.
    pub replayed: Vec<Replayed>,
}

impl Report {
    /// True if it is what the standard asks for, and its own experiments have their results.
    pub fn is_sound(&self) -> bool {
        self.findings.count(Severity::Error) == 0
    }
}

/// Parts of a description that the checks of libraries and a run need.
#[derive(Debug)]
struct Interfaces {
    exchange: Option<Interface>,
    co_simulation: Option<Interface>,
    /// How many states it has.
    states: usize,
    /// Their places among the variables, from 0.
    state_places: HashSet<usize>,
    /// Start and stop time of its default experiment, and the communication step, s.
    start: f64,
    stop: f64,
    step: f64,
}

/// An interface that an FMU is for.
#[derive(Debug)]
struct Interface {
    identifier: String,
    /// Its flags that are true.
    flags: Vec<String>,
    line: u32,
}

impl Interface {
    fn is(&self, flag: &str) -> bool {
        self.flags.iter().any(|set| set == flag)
    }
}

/// Checks an FMU. It is run only if asked for, and if nothing else is wrong with it.
///
/// # Errors
/// When the archive can't be read.
pub fn validate(file: &Path, run: Option<&Hosting>) -> Result<Report, Error> {
    let archive = Archive::read(file)?;
    let mut findings = Findings::default();
    archive.check(&mut findings);
    let description = archive.description(&mut findings)?;
    let interfaces = description.as_ref().and_then(|text| {
        findings.standard = fmi3::standard(text);
        match findings.standard {
            Standard::Fmi2 => check_description(text, &mut findings),
            Standard::Fmi3 => fmi3::check_description(text, &mut findings),
        }
    });
    if let Some(interfaces) = &interfaces {
        archive.check_binaries(interfaces, &mut findings);
        functions::check(&archive, interfaces, &mut findings)?;
    }
    let mut replay = Replay::of(file)?;
    note(std::mem::take(&mut replay.faults), &mut findings);
    let (trial, fmu) = match (interfaces, run) {
        (_, None) => (Trial::NotAskedFor, None),
        (Some(interfaces), Some(hosting)) if findings.count(Severity::Error) == 0 => {
            trial::run(file, hosting, &archive, &interfaces, &mut findings)
        }
        _ => (Trial::Unsound, None),
    };
    let is_sound = findings.count(Severity::Error) == 0;
    let replayed = fmu.filter(|_| is_sound).map_or_else(Vec::new, |fmu| replay.run(&fmu));
    replay.faults.extend(replayed.iter().flat_map(Replayed::faults));
    note(replay.faults, &mut findings);
    Ok(Report { findings, trial, replayed })
}

/// Takes over what is wrong with related files.
fn note(faults: Vec<Fault>, findings: &mut Findings) {
    for Fault { is_error, what, advice } in faults {
        if is_error {
            findings.error(At::nowhere(), what, findings::RELATED, advice);
        } else {
            findings.warning(At::nowhere(), what, findings::RELATED, advice);
        }
    }
}

/// Checks a modelDescription.xml; its interfaces, if they are known.
fn check_description(text: &str, findings: &mut Findings) -> Option<Interfaces> {
    let document = match xml::parse(text) {
        Ok(document) => document,
        Err(reason) => {
            let advice = "make it well-formed XML (without a document type)";
            findings.error(At::nowhere(), format!("modelDescription.xml: {reason}"), "2.2", advice);
            return None;
        }
    };
    let lines = Lines::of(text);
    let root = document.root_element();
    if !schema::check(root, &lines, findings) {
        return None;
    }
    let variables = Variable::all(root, &lines);
    experiment::check(root, &lines, findings);
    variables::check(&variables, findings);
    types::check(root, &variables, &lines, findings);
    values::check(root, &variables, &lines, findings);
    aliases::check(root, &variables, findings);
    names::check(root, &variables, findings);
    structure::check(root, &variables, &lines, findings);
    Some(experiment::interfaces(root, &variables, &lines))
}
