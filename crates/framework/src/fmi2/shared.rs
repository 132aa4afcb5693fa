//! Data shared by all instances of an FMU, created once for those alive at the same time, and cached for later ones on
//! platforms that report when the library is unloaded.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::model::{Description, Model};
use crate::system::Registry;

use super::access::References;
use super::build::Library;
use super::calls::{Answer, Interface, Refused, Standard};
use super::fmi3::arrays;
use super::{model_description, snapshot};

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
    /// Places of states in a master's order; empty where that is how they are stored.
    pub order_of_states: Vec<usize>,
    /// The unit with the sizes of its description, where this one has others.
    pub base: Option<Arc<Shared>>,
}

/// A unit in memory and its origin: description, kinds of a registry, and a master's sizes, if any.
struct Known {
    description: String,
    registry: Registry,
    sizes: Vec<usize>,
    unit: Weak<Shared>,
}

/// This library's units.
struct Units {
    known: Vec<Known>,
    /// Those that stay though none of their instances is alive, the latest last.
    cached: Vec<Arc<Shared>>,
}

static UNITS: Mutex<Units> = Mutex::new(Units { known: Vec::new(), cached: Vec::new() });

/// Number of units that stay without an instance. Searches and sweeps create and free instances of the same few again
/// and again, and reading a description, designing and recording its unit takes many times as long as creating an
/// instance. Units stay only where they can be released before the host unloads the library, or where it is never
/// unloaded, as in a browser.
const MOST_CACHED: usize = if cfg!(any(target_os = "linux", target_family = "wasm")) { 8 } else { 0 };

impl Shared {
    /// The unit of a description, which is in a file. Instances share it by the description's text, not by its place.
    ///
    /// # Errors
    /// Errors in its description.
    pub fn of((file, text): (PathBuf, String), library: Library) -> Answer<Arc<Self>> {
        let alive = units().alive(&text, library.registry, &[]);
        if let Some(unit) = alive {
            return Ok(unit);
        }
        // Made while others may look: two threads may both make it, and then don't share it.
        let refuse = |reason| Refused(format!("{}: {reason}", file.display()));
        let description = Description::read(&text).map_err(refuse)?;
        let model = Model::from_description(description, library.registry).map_err(refuse)?;
        let guid = model_description::guid(&model);
        let unit = Arc::new(Shared::new(model, guid, library.source, None));
        unit.take_in(text, library.registry, Vec::new());
        Ok(unit)
    }

    /// The unit with other sizes.
    ///
    /// # Errors
    /// For sizes that don't fit each other.
    pub fn resized(unit: &Arc<Self>, sizes: &[usize]) -> Answer<Arc<Self>> {
        let base = unit.base.as_ref().unwrap_or(unit);
        if base.model.sizes().values() == sizes {
            return Ok(Arc::clone(base));
        }
        let made_of = units().made_of(base);
        let alive = made_of.as_ref().and_then(|(text, registry)| units().alive(text, registry, sizes));
        if let Some(unit) = alive {
            return Ok(unit);
        }
        let model = base.model.resized(sizes).map_err(|reason| Refused(reason.to_string()))?;
        let unit = Arc::new(Shared::new(model, base.guid, base.source, Some(Arc::clone(base))));
        if let Some((text, registry)) = made_of {
            unit.take_in(text, registry, sizes.to_vec());
        }
        Ok(unit)
    }

    fn new(model: Model, guid: [u8; 16], source: &'static str, base: Option<Arc<Shared>>) -> Self {
        let (references, order_of_states) = match model.description().standard() {
            Standard::Fmi2 => (References::new(model.variables()), Vec::new()),
            Standard::Fmi3 => (arrays::references(&model), arrays::order_of_states(&model)),
        };
        Shared { model: Arc::new(model), references, guid, source, order_of_states, base }
    }

    /// Makes it available to later instances.
    fn take_in(self: &Arc<Self>, description: String, registry: Registry, sizes: Vec<usize>) {
        let known = Known { description, registry, sizes, unit: Arc::downgrade(self) };
        // What goes for it is dropped when this function no longer holds the units.
        let _gone = units().take_in(known, self);
    }

    /// Mark of the saved states of an interface of it, with its own sizes.
    pub fn identity(&self, interface: Interface) -> [u8; 16] {
        let sizes = self.base.as_ref().map_or(String::new(), |_| format!("{:?}", self.model.sizes().values()));
        snapshot::identity(self.guid, interface, &[self.source, &sizes].concat())
    }
}

impl Units {
    /// The unit of a description with these sizes, if it is in memory.
    fn alive(&self, text: &str, registry: Registry, sizes: &[usize]) -> Option<Arc<Shared>> {
        let is_this = |known: &&Known| {
            std::ptr::eq(known.registry, registry) && known.description == text && known.sizes == sizes
        };
        self.known.iter().find(is_this).and_then(|known| known.unit.upgrade())
    }

    /// Description and kinds of a unit.
    fn made_of(&self, unit: &Arc<Shared>) -> Option<(String, Registry)> {
        let known = self.known.iter().find(|known| known.unit.as_ptr() == Arc::as_ptr(unit))?;
        Some((known.description.clone(), known.registry))
    }

    /// Takes a unit in; those that don't stay any longer.
    fn take_in(&mut self, known: Known, unit: &Arc<Shared>) -> Vec<Arc<Shared>> {
        self.forget_the_dead();
        self.known.push(known);
        self.cached.extend((MOST_CACHED > 0).then(|| Arc::clone(unit)));
        self.cached.drain(..self.cached.len().saturating_sub(MOST_CACHED)).collect()
    }

    fn forget_the_dead(&mut self) {
        self.known.retain(|known| known.unit.strong_count() > 0);
    }
}

/// Removes a unit's entry when nothing refers to it any longer.
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
        let cached = UNITS.try_lock().map(|mut units| std::mem::take(&mut units.cached));
        drop(cached);
    }
    leave
};
