//! The FMUs of loops: of this package, from their descriptions, or of other tools.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Error;
use crate::fmu::{Fmu, Hosting, Ready};
use crate::model::Description;
use crate::sealed;
use crate::simulation::LoadedLoop;
use crate::structure::{Component, Structure, Whole};
use crate::system::Kind;

/// FMUs, each opened once.
#[derive(Debug)]
pub struct Units {
    ready: Ready,
    hosting: Hosting,
    archives: Mutex<HashMap<PathBuf, Arc<Fmu>>>,
}

impl Units {
    /// Returns an empty collection. `hosting` decides in which processes FMUs of other tools run.
    ///
    /// # Errors
    /// If there is no library for this package's FMUs.
    pub fn new(hosting: Hosting) -> Result<Self, Error> {
        Ok(Units { ready: Ready::new()?, hosting, archives: Mutex::default() })
    }

    /// The FMU of a component.
    pub(super) fn fmu(&self, structure: &Structure, unit: &Component) -> Result<Arc<Fmu>, Error> {
        if unit.is_exported() {
            return self.ready.fmu(&structure.description_of(&unit.fmu)?);
        }
        let path = unit.path_in(Path::new(""));
        let mut archives = self.archives.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(fmu) = archives.get(&path) {
            return Ok(Arc::clone(fmu));
        }
        let fmu = Arc::new(Fmu::open(&path, &self.hosting)?);
        archives.insert(path, Arc::clone(&fmu));
        Ok(fmu)
    }

    /// A loop that is ready to run, and true if it is a single FMU, of which FMUs of other tools and composites can't
    /// be parts.
    pub(super) fn load(&self, structure: &Structure) -> Result<(LoadedLoop, bool), Error> {
        if !self.can_be_one(structure)? {
            return Ok((self.load_apart(structure)?, false));
        }
        let Whole { source, values, .. } = Whole::new(structure, self.ready.library())?;
        Ok((LoadedLoop::whole(&structure.name, self.ready.fmu(&source)?, &values, Vec::new())?, true))
    }

    /// A loop as separate components.
    pub(super) fn load_apart(&self, structure: &Structure) -> Result<LoadedLoop, Error> {
        LoadedLoop::of(structure, |unit| self.fmu(structure, unit))
    }

    fn can_be_one(&self, structure: &Structure) -> Result<bool, Error> {
        for unit in &structure.components {
            if !unit.is_exported() {
                return Ok(false);
            }
            let source = structure.description_of(&unit.fmu)?;
            let wrong = |reason: crate::error::Invalid| Error::Description {
                file: source.file.clone(),
                reason: reason.to_string(),
            };
            if Description::read(&source.text).map_err(wrong)?.model == Kind::COMPOSITE.name {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Checksum of a loop's FMUs, and of the values that it sets.
    pub(super) fn checksum(&self, structure: &Structure) -> Result<String, Error> {
        let mut text = String::new();
        for unit in &structure.components {
            if unit.is_exported() {
                text += &structure.description_of(&unit.fmu)?.text;
            } else {
                text += &sealed::checksum_of_file(&unit.path_in(Path::new("")))?;
            }
        }
        Ok(sealed::checksum(format!("{text}{:?}", structure.all_values())))
    }
}
