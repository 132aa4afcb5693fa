//! FMUs whose library is loaded into this process, as any master loads it.

use std::cell::RefCell;
use std::ffi::{c_int, c_void};
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::fmi2;
use super::fmi3::{self, Instance3};
use super::kernel::{Awaited, Equations};
use super::messages::{Log, Messages, logger};
use super::unit::{Answer, Call, RunningUnit};
use crate::begun;
use crate::dynamic::Library;
use crate::exporter::with_causes;
use crate::fmi2::calls::{Function, Standard};
use crate::fmi2::types::{CallbackFunctions, Component, MODEL_EXCHANGE};
use crate::model_description::Array;

/// Part of the system's message if a file system allows no code.
const NO_CODE: &str = "failed to map segment";

/// A function of the library, before it has the type that the standard gives its name.
pub(super) type Symbol = unsafe extern "C" fn();

type Free = unsafe extern "C" fn(Component);
/// A function of this crate's libraries.
type DoSteps = unsafe extern "C" fn(Component, *const f64, usize, *const u32, usize, *mut f64) -> usize;

#[cfg(not(target_family = "wasm"))]
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

/// Allocates nothing: this package's FMUs, the only ones here, don't use the master's memory.
#[cfg(target_family = "wasm")]
unsafe extern "C" fn calloc(_: usize, _: usize) -> *mut c_void {
    std::ptr::null_mut()
}

#[cfg(target_family = "wasm")]
unsafe extern "C" fn free(_: *mut c_void) {}

/// Functions that a loop can't do without.
const NEEDED: [Function; 5] = [
    Function::SetupExperiment,
    Function::EnterInitializationMode,
    Function::ExitInitializationMode,
    Function::GetReal,
    Function::Terminate,
];

/// Data to make an instance.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Plan {
    /// Version of the standard.
    pub standard: Standard,
    /// `fmi2Type`
    pub kind: c_int,
    pub name: String,
    pub guid: String,
    /// `file:` URI of the resources; in FMI 3.0 their path, which ends with a separator.
    pub resources: String,
    /// All variables as arrays, in FMI 3.0.
    pub arrays: Vec<Array>,
    /// True if events are handled in Event Mode, in co-simulation with FMI 3.0.
    pub event_mode: bool,
    /// True if it is asked to log, since some FMUs report their errors only then.
    pub logs: bool,
    /// True if its log messages of successful calls are stored.
    pub details: bool,
}

impl Plan {
    /// The function that makes the instance.
    pub fn instantiates(&self) -> &'static str {
        match (self.standard, self.kind) {
            (Standard::Fmi2, _) => "fmi2Instantiate",
            (Standard::Fmi3, MODEL_EXCHANGE) => "fmi3InstantiateModelExchange",
            (Standard::Fmi3, _) => "fmi3InstantiateCoSimulation",
        }
    }
}

/// A loaded library, with the functions of one version of the standard.
#[derive(Debug)]
pub(super) struct Binary {
    /// Functions for model exchange and for co-simulation.
    instantiate: [Option<Symbol>; 2],
    free: Symbol,
    /// Functions in the order of [`Function::ALL`].
    functions: Vec<Option<Symbol>>,
    library: Library,
}

impl Binary {
    /// Loads a library. Returns the reason if that fails.
    pub fn load(path: &Path, standard: Standard) -> Result<Self, String> {
        // SAFETY: the user asked to run this FMU; its initializers run as in any master.
        unsafe { Self::of(open(path)?, standard) }
    }

    /// This library itself, since none can be loaded.
    #[cfg(target_family = "wasm")]
    pub fn linked() -> Result<Self, String> {
        // SAFETY: each function has the type that the standard gives its name.
        unsafe { Self::of(Library, Standard::Fmi2) }
    }

    /// # Safety
    /// The library must export the standard's functions under their names.
    unsafe fn of(library: Library, standard: Standard) -> Result<Self, String> {
        let [exchange, co_simulation, free] = match standard {
            Standard::Fmi2 => ["fmi2Instantiate", "fmi2Instantiate", "fmi2FreeInstance"],
            Standard::Fmi3 => ["fmi3InstantiateModelExchange", "fmi3InstantiateCoSimulation", "fmi3FreeInstance"],
        };
        // SAFETY: each symbol is only called as the function that the standard gives its name.
        unsafe {
            let find = |name: &str| library.get::<Symbol>(name).map(|symbol| *symbol);
            let needed = |name: &str| find(name).map_err(|error| with_causes(&error));
            NEEDED.iter().try_for_each(|function| needed(function.name_in(standard)).map(drop))?;
            let functions = Function::ALL.iter().map(|function| find(function.name_in(standard)).ok()).collect();
            let instantiate = [exchange, co_simulation].map(|name| find(name).ok());
            Ok(Binary { instantiate, free: needed(free)?, functions, library })
        }
    }

    /// The function that makes instances of a kind (`fmi2Type`).
    pub fn instantiate(&self, kind: c_int) -> Result<Symbol, String> {
        let symbol = self.instantiate[usize::from(kind != MODEL_EXCHANGE)];
        symbol.ok_or_else(|| "its library doesn't export the function that makes an instance".to_owned())
    }

    /// A function outside the standard.
    pub fn symbol(&self, name: &str) -> Option<Symbol> {
        // SAFETY: it is only called as a function of the type that a library of this crate gives its name.
        unsafe { self.library.get::<Symbol>(name).map(|symbol| *symbol).ok() }
    }

    /// # Safety
    /// `F` must be the type that the standard gives the function.
    pub unsafe fn function<F: Copy>(&self, function: Function) -> Result<F, String> {
        let symbol = self.functions[function as usize];
        let symbol = symbol.ok_or_else(|| "its library doesn't export this function".to_owned())?;
        // SAFETY: both are pointers to functions; that it is one of this type, the caller states.
        Ok(unsafe { std::mem::transmute_copy(&symbol) })
    }
}

/// The reason why a library isn't loaded, with advice if its file system allows no code.
fn why(error: &dyn std::error::Error) -> String {
    let reason = with_causes(error);
    if !reason.contains(NO_CODE) {
        return reason;
    }
    let folder = std::env::temp_dir();
    format!(
        "{reason}. This happens if {} is mounted noexec. Set TMPDIR to a folder on a file system that allows programs",
        folder.display()
    )
}

/// Loads a library; if it needs Python, loads that first.
///
/// # Safety
/// The library's initializers run.
unsafe fn open(path: &Path) -> Result<Library, String> {
    // SAFETY: as this function asks of its caller.
    let opened = unsafe { Library::new(path) }.map_err(|error| why(&error));
    // Its initializers may have changed the working directory and the file mode mask.
    begun::restore();
    #[cfg(unix)]
    if let Err(reason) = &opened
        && super::python::is_missing(reason)
    {
        super::python::load()?;
        // SAFETY: likewise.
        return unsafe { Library::new(path) }.map_err(|error| why(&error));
    }
    opened
}

/// An instance in this process.
#[derive(Debug)]
pub(super) struct InProcess {
    component: Component,
    /// The same as an instance of FMI 3.0, if it is one.
    fmi3: Option<Instance3>,
    binary: Arc<Binary>,
    log: Box<Log>,
    _callbacks: Box<CallbackFunctions>,
    is_freed: bool,
    /// Its compiled equations, which are dropped with it.
    equations: RefCell<Equations>,
}

impl InProcess {
    /// Makes an instance. Returns the reason if that fails.
    pub fn new(binary: &Arc<Binary>, kernel: Option<Awaited>, plan: &Plan) -> Result<Self, String> {
        let log = Box::new(Log::keeping(plan.details));
        let callbacks = Box::new(CallbackFunctions {
            logger: Some(logger()),
            allocate_memory: Some(calloc),
            free_memory: Some(free),
            step_finished: None,
            component_environment: std::ptr::from_ref(&*log).cast_mut().cast(),
        });
        // SAFETY: the new instance owns the library and the callbacks, so they live as long as it does.
        let component = unsafe {
            match plan.standard {
                Standard::Fmi2 => fmi2::instantiate(binary, plan, &callbacks)?,
                Standard::Fmi3 => fmi3::instantiate(binary, plan, &log)?,
            }
        };
        if component.is_null() {
            return Err(match log.take() {
                silent if silent.is_empty() => format!("{} failed, without a message", plan.instantiates()),
                messages => format!("{} failed: {}", plan.instantiates(), messages.joined()),
            });
        }
        let (binary, equations) = (Arc::clone(binary), RefCell::new(Equations::of(kernel)));
        let fmi3 = (plan.standard == Standard::Fmi3).then(|| Instance3::new(component, &plan.arrays));
        Ok(InProcess { component, fmi3, binary, log, _callbacks: callbacks, is_freed: false, equations })
    }

    /// Hands over its compiled equations once they are ready.
    fn look_for_kernel(&self) {
        self.equations.borrow_mut().look(self.component, &self.binary);
    }
}

impl RunningUnit for InProcess {
    fn call(&self, call: Call<'_>) -> Result<Answer, String> {
        if matches!(call, Call::DoStep { .. } | Call::SetTime(_)) {
            self.look_for_kernel();
        }
        // SAFETY: the library's functions are the standard's, and the instance is alive until it is freed.
        unsafe {
            match &self.fmi3 {
                None => fmi2::call(self.component, &self.binary, call),
                Some(instance) => instance.call(&self.binary, call),
            }
        }
    }

    fn do_steps(&self, times: &[f64], references: &[u32], rows: &mut [f64]) -> usize {
        let Some(symbol) = self.binary.symbol("adaptive_fmu_do_steps").filter(|_| self.fmi3.is_none()) else {
            return 0;
        };
        assert_eq!(rows.len(), (times.len() - 1) * references.len());
        self.look_for_kernel();
        // SAFETY: a library of this crate gives the symbol this type; the instance is alive until it is freed, and the arrays
        // have the lengths that it asks for.
        unsafe {
            let call = std::mem::transmute::<Symbol, DoSteps>(symbol);
            call(self.component, times.as_ptr(), times.len(), references.as_ptr(), references.len(), rows.as_mut_ptr())
        }
    }

    fn messages(&self) -> Messages {
        self.log.take()
    }

    fn component(&self) -> Option<Component> {
        Some(self.component)
    }

    fn free(&mut self) -> Result<(), String> {
        if !std::mem::replace(&mut self.is_freed, true) {
            // SAFETY: the type is the standard's; freed once, while its library is loaded.
            unsafe { std::mem::transmute::<Symbol, Free>(self.binary.free)(self.component) }
        }
        Ok(())
    }
}

impl Drop for InProcess {
    fn drop(&mut self) {
        // Freeing can't fail in this process.
        let _ = self.free();
    }
}
