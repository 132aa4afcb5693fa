//! What all instances of a unit have in common, made once for those that live at a time.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::model::{Description, Model};
use crate::system::Registry;

use super::access::References;
use super::build::Library;
use super::instance::{Answer, Refused};
use super::model_description;

/// A unit without its values.
#[derive(Debug)]
pub struct Shared {
    /// Its model.
    pub model: Arc<Model>,
    /// Its value references.
    pub references: References,
    /// Its GUID, by which the master's description is compared.
    pub guid: [u8; 16],
    /// Checksum of the sources of its library.
    pub source: &'static str,
}

/// A unit that instances of are alive, and what it was made of: a description, by the kinds of a registry.
struct Known {
    description: String,
    registry: Registry,
    unit: Weak<Shared>,
}

static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());

impl Shared {
    /// The unit of a description, which lies in a file. Instances share it by what the description says, not where it
    /// lies.
    ///
    /// # Errors
    /// What is wrong with its description.
    pub fn of((file, text): (PathBuf, String), library: Library) -> Answer<Arc<Self>> {
        let is_this = |known: &&Known| std::ptr::eq(known.registry, library.registry) && known.description == text;
        let alive = known_units().iter().find(is_this).and_then(|known| known.unit.upgrade());
        if let Some(unit) = alive {
            return Ok(unit);
        }
        // Made while others may look: two threads may both make it, and then don't share it.
        let refuse = |reason| Refused(format!("{}: {reason}", file.display()));
        let description = Description::read(&text).map_err(refuse)?;
        let model = Model::from_description(description, library.registry).map_err(refuse)?;
        let (references, guid) = (References::new(model.variables()), model_description::guid(&model));
        let unit = Arc::new(Shared { model: Arc::new(model), references, guid, source: library.source });
        let mut known = known_units();
        known.retain(|known| known.unit.strong_count() > 0);
        known.push(Known { description: text, registry: library.registry, unit: Arc::downgrade(&unit) });
        Ok(unit)
    }
}

/// With the last instance goes what is known of a unit: a host that unloads the library finds nothing left of it.
impl Drop for Shared {
    fn drop(&mut self) {
        let mut known = known_units();
        known.retain(|known| known.unit.strong_count() > 0);
        known.shrink_to_fit();
    }
}

fn known_units() -> std::sync::MutexGuard<'static, Vec<Known>> {
    // What a panic left is whole: units are only added and removed.
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner)
}
