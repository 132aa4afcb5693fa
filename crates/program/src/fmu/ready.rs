//! FMUs that are exported, unpacked and loaded once for all runs of a process.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::Fmu;
use crate::error::Error;
use crate::exporter::{Library, Source};
#[cfg(not(target_family = "wasm"))]
use crate::scratch::Scratch;

/// Largest number of cached FMUs; the least recently used one is dropped.
const MOST_CACHED: usize = 64;

/// FMUs by their descriptions.
#[derive(Debug)]
pub struct Ready {
    library: Library,
    #[cfg(not(target_family = "wasm"))]
    folder: Scratch,
    cached: Mutex<VecDeque<(String, Arc<Fmu>)>>,
}

impl Ready {
    /// Returns an empty cache for the library that was built together with this program.
    ///
    /// # Errors
    /// If there is none, or a temporary folder can't be made.
    pub fn new() -> Result<Self, Error> {
        Ok(Ready {
            library: Library::next_to_program()?,
            #[cfg(not(target_family = "wasm"))]
            folder: Scratch::new()?,
            cached: Mutex::default(),
        })
    }

    /// The library of these FMUs.
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// The FMU of a description.
    ///
    /// # Errors
    /// For a description that is refused, or files that can't be written.
    pub fn fmu(&self, source: &Source) -> Result<Arc<Fmu>, Error> {
        let mut cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner);
        let place = cached.iter().position(|(text, _)| *text == source.text);
        let fmu = match place.and_then(|place| cached.remove(place)) {
            Some((_, fmu)) => fmu,
            None => Arc::new(self.made(source)?),
        };
        cached.push_back((source.text.clone(), Arc::clone(&fmu)));
        while cached.len() > MOST_CACHED {
            cached.pop_front();
        }
        Ok(fmu)
    }

    /// Exports an archive and opens it, as any master does.
    #[cfg(not(target_family = "wasm"))]
    fn made(&self, source: &Source) -> Result<Fmu, Error> {
        let file = crate::exporter::export(source, &self.library, self.folder.path())?;
        let fmu = Fmu::open_any(&file, &super::Hosting::InProcess)?;
        // It is unpacked, and the next one may have the same name.
        std::fs::remove_file(&file).map_err(Error::file(&file))?;
        Ok(fmu)
    }

    #[cfg(target_family = "wasm")]
    fn made(&self, source: &Source) -> Result<Fmu, Error> {
        let (unit, _) = crate::exporter::describe(source, &self.library)?;
        Fmu::linked(&source.text, unit.model_description)
    }
}
