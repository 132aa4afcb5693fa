//! A loop of this package for a page without a server.

use super::cases::{cases, coarse};
use super::session::Session;
use crate::error::Error;
use crate::fmu::Ready;
use crate::simulation::LoadedLoop;
use crate::structure::{LoopFiles, Settings, Structure, Whole};

/// A session with one of this package's loops as a composite, and its cases.
///
/// # Errors
/// When there is no such loop, or it can't be run.
pub fn begun(name: &str) -> Result<Session, Error> {
    let files = LoopFiles::find(name)?;
    let mut structure = files.structure()?;
    structure.expected_failure = structure.expected_failure.filter(|it| !it.separate_only);
    let Structure { start_time, stop_time, step, .. } = structure;
    let fine = Settings { start_time, stop_time, step };
    let ready = Ready::new()?;
    let load = |structure: &Structure| {
        let Whole { source, values, notes } = Whole::new(structure, ready.library())?;
        Ok(LoadedLoop::whole(&structure.name, ready.fmu(&source)?, &values, notes)?
            .recording(structure.signals())
            .with_events(&structure.events)?)
    };
    let plain = load(&structure)?;
    let (bases, notes) = cases(structure, &files, load)?;
    Ok(Session::new(bases, &plain, (coarse(fine), fine), true, notes, "".into()))
}
