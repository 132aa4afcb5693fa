//! FMUs, loaded as any master loads them: those of this package into this process, those of other tools into separate
//! processes.

mod fmi2;
mod fmi3;
#[cfg(unix)]
mod guest;
mod in_process;
mod instance;
mod kernel;
mod messages;
#[cfg(unix)]
mod own_process;
#[cfg(unix)]
mod python;
mod ready;
mod start;
mod unit;
#[cfg(unix)]
mod wire;

use std::ffi::c_int;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

#[cfg(unix)]
pub use guest::serve as serve_unit;
use in_process::{Binary, InProcess, Plan};
pub use instance::{Event, Instance};
use kernel::{Awaited, checksum};
pub use kernel::{Common, fold_parameters};
pub use messages::Messages;
#[cfg(unix)]
use own_process::OwnProcess;
pub use ready::Ready;
pub(crate) use start::{SHOWS_VARIABLES, is_designed, own_start, set_starts, typed, why_fixed, within_limits};
use unit::RunningUnit;

use crate::cache::Checksum;
use crate::error::Error;
use crate::exporter::{Entry, Platform, entries, own_library, read_entry, unpack_but};
use crate::fmi2::calls::Standard;
#[cfg(target_family = "wasm")]
use crate::fmi2::resources::DATA_PREFIX;
use crate::fmi2::resources::DESCRIPTION;
use crate::fmi2::types::{CO_SIMULATION, MODEL_EXCHANGE};
use crate::model_description::ModelDescription;
use crate::scratch::Scratch;

/// The command with which this package's program runs an FMU for another process of it.
pub const UNIT_PROCESS: &str = "unit-process";

/// Communication step of an FMU that proposes none, s.
const STEP: f64 = 1e-3;
const NOT_FOR_CO_SIMULATION: &str = "modelDescription.xml: the FMU does not support co-simulation";
const NOT_FOR_EXCHANGE: &str = "modelDescription.xml: the FMU does not support model exchange";

/// True if messages of successful calls of this package's FMUs are stored, such as the integration method.
static DETAILS: AtomicBool = AtomicBool::new(false);

/// Stores messages of successful calls of this package's FMUs from now on ([`Messages::details`]).
pub fn keep_details() {
    DETAILS.store(true, Ordering::Relaxed);
}

/// A value of a variable.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Value of a Real.
    Real(f64),
    /// Value of an Integer, or number of an Enumeration's item.
    Integer(i32),
    /// Value of a Boolean.
    Boolean(bool),
    /// Value of a String.
    String(String),
}

/// Processes for FMUs of other tools. Those that were built with this crate always run in this process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Hosting {
    /// They run in this process: faster, but a crash ends it.
    InProcess,
    /// Each instance runs in a separate process.
    OwnProcess {
        /// This package's program.
        program: PathBuf,
        /// Longest time of one call.
        patience: Duration,
    },
}

impl Hosting {
    /// True if this platform supports a process for each FMU.
    pub const HAS_PROCESSES: bool = cfg!(unix);
}

/// An FMU that was unpacked.
#[derive(Debug)]
pub struct Fmu {
    file: PathBuf,
    /// Its unpacked files, which are deleted with it; none if it was never an archive.
    folder: Option<Scratch>,
    /// Location of its resources, as its instances get it.
    resources: String,
    /// modelDescription.xml
    text: String,
    /// The same, parsed.
    pub description: ModelDescription,
    /// Library and process of instances for co-simulation, if it supports that.
    co_simulation: Option<Place>,
    /// The same for model exchange. A failure is reported only on use, since the other interface may suffice.
    exchange: Option<Result<Place, String>>,
}

/// Library and process of its instances.
#[derive(Debug, Clone)]
enum Place {
    Here {
        binary: Arc<Binary>,
        /// Its compiled equations, if it is of this crate.
        kernel: Option<Awaited>,
    },
    #[cfg(unix)]
    OwnProcess { library: PathBuf, program: PathBuf, patience: Duration },
}

impl Fmu {
    /// Opens an archive of an FMU for co-simulation.
    ///
    /// # Errors
    /// If it is no FMU for co-simulation on this platform.
    pub fn open(file: &Path, hosting: &Hosting) -> Result<Self, Error> {
        let fmu = Self::open_any(file, hosting)?;
        let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
        if fmu.description.co_simulation { Ok(fmu) } else { Err(refuse(NOT_FOR_CO_SIMULATION.to_owned())) }
    }

    /// Opens an archive of an FMU for co-simulation, model exchange or both.
    ///
    /// # Errors
    /// If it is no FMU of FMI 2.0 or 3.0 on this platform.
    pub fn open_any(file: &Path, hosting: &Hosting) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
        let text = read_entry(file, "modelDescription.xml")?;
        let description = ModelDescription::read(&text).map_err(refuse)?;
        let folder = Scratch::new()?;
        let (own, entries, common) = (Platform::own(), entries(file)?, OwnLibrary::loaded());
        let standard = description.standard;
        // The library next to this program isn't unpacked, since it is loaded already.
        unpack_but(file, folder.path(), common.map(|common| common.mark))?;
        let resources = folder.path().join("resources");
        let place = |identifier: &str| {
            let found =
                own.binaries(standard, identifier).find_map(|place| entries.iter().find(|entry| entry.name == place));
            if let Some(common) = common.filter(|common| found.is_some_and(|found| common.is_entry(found))) {
                return Ok(Place::here(common.binary(standard), Some(&common.checksum), &resources));
            }
            let library = own.find_binary(folder.path(), standard, identifier).ok_or_else(|| {
                let missing = own.binary_of(standard, identifier);
                format!("contains no {missing}, so it can't run on this platform")
            })?;
            Place::of(library, &resources, hosting, standard)
        };
        let first = place(&description.model_identifier).map_err(refuse)?;
        let exchange = match &description.exchange_identifier {
            Some(identifier) if *identifier == description.model_identifier => Some(Ok(first.clone())),
            other => other.as_deref().map(place),
        };
        let co_simulation = description.co_simulation.then_some(first);
        let resources = match standard {
            Standard::Fmi2 => file_uri(&resources),
            Standard::Fmi3 => format!("{}{}", resources.display(), std::path::MAIN_SEPARATOR),
        };
        let file = file.to_owned();
        Ok(Fmu { file, folder: Some(folder), resources, text, description, co_simulation, exchange })
    }

    /// An FMU of this library itself, from its description and the modelDescription.xml of that, without an archive.
    ///
    /// # Errors
    /// If it isn't for co-simulation.
    #[cfg(target_family = "wasm")]
    pub fn linked(described: &str, text: String) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Library(reason);
        let description = ModelDescription::read(&text).map_err(refuse)?;
        let place = Place::Here { binary: Arc::new(Binary::linked().map_err(refuse)?), kernel: None };
        let resources = format!("{DATA_PREFIX}{}", described.replace('%', "%25"));
        let file = PathBuf::from(format!("{}.fmu", description.name));
        Ok(Fmu { file, folder: None, resources, text, description, co_simulation: Some(place), exchange: None })
    }

    /// Its archive.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The communication step that it proposes, else a default one, s.
    pub fn step(&self) -> f64 {
        self.description.step.filter(|step| *step > 0.0).unwrap_or(STEP)
    }

    /// Text on its origin, and on how its instances run.
    pub fn origin(&self) -> String {
        let exchange = || self.exchange.as_ref().and_then(|place| place.as_ref().ok());
        let how = match self.co_simulation.as_ref().or_else(exchange) {
            Some(Place::Here { .. }) => "in this process",
            #[cfg(unix)]
            Some(Place::OwnProcess { .. }) => "each instance in its own process",
            None => "nowhere",
        };
        let evaluated = self.evaluated().map(|how| format!(", equations {how}")).unwrap_or_default();
        format!("{}, {how}{evaluated}", self.file.display())
    }

    /// Text on how the equations of one of this package's FMUs are evaluated.
    pub fn evaluated(&self) -> Option<String> {
        let exchange = || self.exchange.as_ref().and_then(|place| place.as_ref().ok());
        match self.co_simulation.as_ref().or_else(exchange)? {
            Place::Here { kernel, .. } => kernel.as_ref().map(Awaited::status),
            #[cfg(unix)]
            Place::OwnProcess { .. } => None,
        }
    }

    /// The text of its modelDescription.xml.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The library and the compiled equations of its instances for co-simulation, if it is of this crate.
    fn here(&self) -> Option<(&Arc<Binary>, &Awaited)> {
        match self.co_simulation.as_ref()? {
            Place::Here { binary, kernel } => Some((binary, kernel.as_ref()?)),
            #[cfg(unix)]
            Place::OwnProcess { .. } => None,
        }
    }

    /// True if its equations are compiled: the library is of this program, in this process.
    pub(crate) fn is_compiled(&self) -> bool {
        self.here().is_some()
    }

    /// The description that it was exported from, if the library is of this program, in this process.
    pub(crate) fn own_description(&self) -> Option<String> {
        self.here()?;
        std::fs::read_to_string(self.folder.as_ref()?.path().join("resources").join(DESCRIPTION)).ok()
    }

    /// Hands compiled equations for common parameters to all further instances for co-simulation.
    pub fn share(&self, common: &Common) {
        if let Some((_, kernel)) = self.here() {
            kernel.share(common);
        }
    }

    /// True if each instance has a separate process.
    pub fn has_own_processes(&self) -> bool {
        let exchange = self.exchange.iter().filter_map(|place| place.as_ref().ok());
        self.co_simulation.iter().chain(exchange).all(|place| !matches!(place, Place::Here { .. }))
    }

    /// An instance for co-simulation.
    ///
    /// # Errors
    /// If it is not for that, its library lacks a function, or refuses.
    pub fn instantiate(self: &Arc<Self>, name: &str) -> Result<Instance, Error> {
        self.instantiate_for_steps(name, false)
    }

    /// An instance for co-simulation, whose events are handled in Event Mode.
    ///
    /// # Errors
    /// As [`Fmu::instantiate`].
    pub fn instantiate_with_events(self: &Arc<Self>, name: &str) -> Result<Instance, Error> {
        self.instantiate_for_steps(name, true)
    }

    fn instantiate_for_steps(self: &Arc<Self>, name: &str, event_mode: bool) -> Result<Instance, Error> {
        let place = self.co_simulation.as_ref().ok_or(NOT_FOR_CO_SIMULATION);
        self.instantiate_in(place, (CO_SIMULATION, event_mode), name)
    }

    /// An instance for model exchange.
    ///
    /// # Errors
    /// If it is not for that, its library lacks a function, or refuses.
    pub fn instantiate_for_exchange(self: &Arc<Self>, name: &str) -> Result<Instance, Error> {
        let place = self.exchange.as_ref().ok_or(NOT_FOR_EXCHANGE);
        let place = place.and_then(|place| place.as_ref().map_err(String::as_str));
        self.instantiate_in(place, (MODEL_EXCHANGE, false), name)
    }

    fn instantiate_in(
        self: &Arc<Self>,
        place: Result<&Place, &str>,
        (kind, event_mode): (c_int, bool),
        name: &str,
    ) -> Result<Instance, Error> {
        let ModelDescription { standard, guid, arrays, .. } = &self.description;
        // This package's FMUs report errors and warnings in any case.
        let details = self.description.is_own() && DETAILS.load(Ordering::Relaxed);
        let plan = Plan {
            standard: *standard,
            kind,
            name: name.to_owned(),
            guid: guid.clone(),
            resources: self.resources.clone(),
            arrays: arrays.clone(),
            event_mode,
            logs: !self.description.is_own() || details || *standard == Standard::Fmi3,
            details,
        };
        let unit = place.map_err(str::to_owned).and_then(|place| place.unit(&plan));
        let unit = unit.map_err(|reason| Error::Archive { file: self.file.clone(), reason })?;
        Ok(Instance::new(unit, name, self))
    }
}

impl Place {
    /// Loads a library, whose resources are in a folder, or chooses a separate process. Returns the reason if it can't.
    fn of(library: PathBuf, resources: &Path, hosting: &Hosting, standard: Standard) -> Result<Self, String> {
        let bytes = std::fs::read(&library).map_err(|error| format!("its library can't be read: {error}"))?;
        let checksum = checksum(&library, &bytes);
        #[cfg(unix)]
        if let Hosting::OwnProcess { program, patience } = hosting
            && checksum.is_none()
        {
            return Ok(Place::OwnProcess { library, program: program.clone(), patience: *patience });
        }
        #[cfg(not(unix))]
        let _ = hosting;
        Ok(Place::here(&Arc::new(Binary::load(&library, standard)?), checksum.as_ref(), resources))
    }

    /// Returns instances in this process, with compiled equations if the library is of this crate and has a checksum.
    fn here(binary: &Arc<Binary>, checksum: Option<&Checksum>, resources: &Path) -> Self {
        let kernel = checksum.and_then(|checksum| Awaited::of(binary, checksum, &resources.join(DESCRIPTION)));
        Place::Here { binary: Arc::clone(binary), kernel }
    }

    fn unit(&self, plan: &Plan) -> Result<Box<dyn RunningUnit>, String> {
        Ok(match self {
            Place::Here { binary, kernel } => Box::new(InProcess::new(binary, kernel.clone(), plan)?),
            #[cfg(unix)]
            Place::OwnProcess { library, program, patience } => {
                Box::new(OwnProcess::new(program, *patience, library, plan)?)
            }
        })
    }
}

/// The library that was built together with this program, which most FMUs contain: loaded once.
struct OwnLibrary {
    /// Functions for each version of the standard.
    binaries: [Arc<Binary>; 2],
    checksum: Checksum,
    /// Size and checksum within archives.
    mark: (u64, u32),
}

impl OwnLibrary {
    /// Returns it if there is one.
    fn loaded() -> Option<&'static Self> {
        static OWN: OnceLock<Option<OwnLibrary>> = OnceLock::new();
        let load = || {
            let file = own_library()?;
            let bytes = std::fs::read(&file).ok()?;
            let mark = (bytes.len() as u64, crc32fast::hash(&bytes));
            let checksum = checksum(&file, &bytes)?;
            let load = |standard| Some(Arc::new(Binary::load(&file, standard).ok()?));
            Some(OwnLibrary { binaries: [load(Standard::Fmi2)?, load(Standard::Fmi3)?], checksum, mark })
        };
        OWN.get_or_init(load).as_ref()
    }

    fn binary(&self, standard: Standard) -> &Arc<Binary> {
        &self.binaries[usize::from(standard == Standard::Fmi3)]
    }

    fn is_entry(&self, entry: &Entry) -> bool {
        self.mark == (entry.size, entry.checksum)
    }
}

/// A `file:` URI of a path.
fn file_uri(path: &Path) -> String {
    let text = path.to_string_lossy().replace('\\', "/").replace('%', "%25").replace(' ', "%20");
    if text.starts_with('/') { format!("file://{text}") } else { format!("file:///{text}") }
}
