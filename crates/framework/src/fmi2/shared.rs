//! What all instances of a unit have in common, made once for those that live at a time, and kept for those that come after
//! them, where the platform tells when the library is unloaded.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::model::{Description, Model};
use crate::system::Registry;

use super::access::References;
use super::build::Library;
use super::calls::{Answer, Refused, Standard};
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

/// A unit that is in memory, and what it was made of: a description, by the kinds of a registry.
struct Known {
    description: String,
    registry: Registry,
    unit: Weak<Shared>,
}

/// What this library holds of units.
struct Units {
    known: Vec<Known>,
    /// Those that stay though none of their instances is alive, the latest last.
    kept: Vec<Arc<Shared>>,
}

static UNITS: Mutex<Units> = Mutex::new(Units { known: Vec::new(), kept: Vec::new() });

/// So many units stay without an instance: searches and sweeps make and free instances of the same few again and again, and
/// to read a description, design and record its unit takes many times as long as an instance. Only where they can be let go of
/// before the library leaves the memory of its host, or it never does, as in a browser.
const MOST_KEPT: usize = if cfg!(any(target_os = "linux", target_family = "wasm")) { 8 } else { 0 };

impl Shared {
    /// The unit of a description, which lies in a file. Instances share it by what the description says, not where it
    /// lies.
    ///
    /// # Errors
    /// What is wrong with its description.
    pub fn of((file, text): (PathBuf, String), library: Library) -> Answer<Arc<Self>> {
        let is_this = |known: &&Known| std::ptr::eq(known.registry, library.registry) && known.description == text;
        let alive = units().known.iter().find(is_this).and_then(|known| known.unit.upgrade());
        if let Some(unit) = alive {
            return Ok(unit);
        }
        // Made while others may look: two threads may both make it, and then don't share it.
        let refuse = |reason| Refused(format!("{}: {reason}", file.display()));
        let description = Description::read(&text).map_err(refuse)?;
        let model = Model::from_description(description, library.registry).map_err(refuse)?;
        let references = match model.description().standard() {
            Standard::Fmi2 => References::new(model.variables()),
            Standard::Fmi3 => super::fmi3::arrays::references(&model),
        };
        let guid = model_description::guid(&model);
        let unit = Arc::new(Shared { model: Arc::new(model), references, guid, source: library.source });
        let known = Known { description: text, registry: library.registry, unit: Arc::downgrade(&unit) };
        // What goes for it is dropped when this function no longer holds the units.
        let _gone = units().take_in(known, &unit);
        Ok(unit)
    }
}

impl Units {
    /// Takes a unit in; those that don't stay any longer.
    fn take_in(&mut self, known: Known, unit: &Arc<Shared>) -> Vec<Arc<Shared>> {
        self.forget_the_dead();
        self.known.push(known);
        self.kept.extend((MOST_KEPT > 0).then(|| Arc::clone(unit)));
        self.kept.drain(..self.kept.len().saturating_sub(MOST_KEPT)).collect()
    }

    fn forget_the_dead(&mut self) {
        self.known.retain(|known| known.unit.strong_count() > 0);
    }
}

/// With the last that holds a unit goes what is known of it.
impl Drop for Shared {
    fn drop(&mut self) {
        let mut units = units();
        units.forget_the_dead();
        units.known.shrink_to_fit();
    }
}

fn units() -> std::sync::MutexGuard<'static, Units> {
    // What a panic left is whole: units are only added and removed.
    UNITS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Called when a host unloads the library, or ends: it finds nothing left of it.
#[cfg(target_os = "linux")]
#[used]
// SAFETY: the section is a list of functions of this type, which the loader calls when it is done with the library.
#[allow(unsafe_code)]
#[unsafe(link_section = ".fini_array")]
static LEAVE: extern "C" fn() = {
    extern "C" fn leave() {
        // A thread that holds them when the host ends may never be done.
        let kept = UNITS.try_lock().map(|mut units| std::mem::take(&mut units.kept));
        drop(kept);
    }
    leave
};
