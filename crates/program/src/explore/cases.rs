//! A loop as it is, and with each of the parameter sets in its folder.

use crate::error::Error;
use crate::simulation::LoadedLoop;
use crate::structure::{LoopFiles, Settings, Structure};

/// The most communication points of a composite while parameters are moved: about one a pixel.
const POINTS: f64 = 1000.0;

/// A loop with the start values of one of its cases.
#[derive(Debug)]
pub struct Base {
    /// Name of the case; none for the loop as it is.
    pub name: Option<String>,
    /// The loop.
    pub structure: Structure,
    /// Its units.
    pub loaded: LoadedLoop,
}

/// Loads a loop and its cases; returns the cases that are left out, too.
///
/// # Errors
/// When the loop itself can't be loaded.
pub fn cases(
    structure: Structure,
    files: &LoopFiles,
    load: impl Fn(&Structure) -> Result<LoadedLoop, Error>,
) -> Result<(Vec<Base>, Vec<String>), Error> {
    let mut notes = Vec::new();
    let mut bases = vec![Base { name: None, loaded: load(&structure)?, structure }];
    for case in files.parameter_files() {
        let mut changed = bases[0].structure.clone();
        // A set that the loop binds to one of its components is no case: its names lack the component.
        if changed.apply_case(case.as_ref(), files).is_err() || changed == bases[0].structure {
            continue;
        }
        match load(&changed) {
            Ok(loaded) => bases.push(Base { name: Some(case), loaded, structure: changed }),
            Err(error) => notes.push(format!("parameter set {case} can't be used: {error}")),
        }
    }
    Ok((bases, notes))
}

/// Settings of a composite while parameters are moved.
#[must_use]
pub fn coarse(fine: Settings) -> Settings {
    Settings { step: fine.step.max((fine.stop_time - fine.start_time) / POINTS), ..fine }
}
