//! Units whose library is loaded into this process, as any master loads it.

use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int, c_void};
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::kernel::{Awaited, Equations};
use super::messages::{Log, Messages, logger};
use super::unit::{Answer, Call, RunningUnit};
use crate::begun;
use crate::dynamic::Library;
use crate::exporter::with_causes;
use crate::fmi2::calls::Function;
use crate::fmi2::types::{CallbackFunctions, Component, EventInfo};

/// Part of the message of a system that loads no code from a file system.
const NO_CODE: &str = "failed to map segment";

/// A function of the library, before it has the type that the standard gives its name.
pub(super) type Symbol = unsafe extern "C" fn();

type Instantiate = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const CallbackFunctions,
    c_int,
    c_int,
) -> Component;
type Free = unsafe extern "C" fn(Component);
type Setup = unsafe extern "C" fn(Component, c_int, f64, f64, c_int, f64) -> Answer;
type Plain = unsafe extern "C" fn(Component) -> Answer;
type GetReal = unsafe extern "C" fn(Component, *const u32, usize, *mut f64) -> Answer;
type SetReal = unsafe extern "C" fn(Component, *const u32, usize, *const f64) -> Answer;
type GetWhole = unsafe extern "C" fn(Component, *const u32, usize, *mut c_int) -> Answer;
type SetWhole = unsafe extern "C" fn(Component, *const u32, usize, *const c_int) -> Answer;
type SetString = unsafe extern "C" fn(Component, *const u32, usize, *const *const c_char) -> Answer;
type DoStep = unsafe extern "C" fn(Component, f64, f64, c_int) -> Answer;
type DirectionalDerivative =
    unsafe extern "C" fn(Component, *const u32, usize, *const u32, usize, *const f64, *mut f64) -> Answer;
type NewDiscreteStates = unsafe extern "C" fn(Component, *mut EventInfo) -> Answer;
type GetNumbers = unsafe extern "C" fn(Component, *mut f64, usize) -> Answer;
type SetNumbers = unsafe extern "C" fn(Component, *const f64, usize) -> Answer;
type SetTime = unsafe extern "C" fn(Component, f64) -> Answer;
type CompletedIntegratorStep = unsafe extern "C" fn(Component, c_int, *mut c_int, *mut c_int) -> Answer;

#[cfg(not(target_family = "wasm"))]
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

/// This package's units take no memory of a master's, and there are no others.
#[cfg(target_family = "wasm")]
unsafe extern "C" fn calloc(_: usize, _: usize) -> *mut c_void {
    std::ptr::null_mut()
}

#[cfg(target_family = "wasm")]
unsafe extern "C" fn free(_: *mut c_void) {}

/// What a loop can't do without.
const NEEDED: [Function; 5] = [
    Function::SetupExperiment,
    Function::EnterInitializationMode,
    Function::ExitInitializationMode,
    Function::GetReal,
    Function::Terminate,
];

/// What an instance is made of.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Plan {
    /// `fmi2Type`
    pub kind: c_int,
    pub name: String,
    pub guid: String,
    /// `file:` URI of the resources.
    pub resources: String,
    /// True if it is asked to log: some units tell of their errors only then.
    pub logs: bool,
    /// True if what it logs of calls that went well is kept.
    pub details: bool,
}

/// A loaded library.
#[derive(Debug)]
pub(super) struct Binary {
    instantiate: Symbol,
    free: Symbol,
    /// In the order of [`Function::ALL`].
    functions: Vec<Option<Symbol>>,
    library: Library,
}

impl Binary {
    /// Loads a library; the reason where that fails.
    pub fn load(path: &Path) -> Result<Self, String> {
        // SAFETY: the user asked for this FMU to be run; its initialisers run as in any master.
        unsafe { Self::of(open(path)?) }
    }

    /// This very library, where none can be loaded.
    #[cfg(target_family = "wasm")]
    pub fn linked() -> Result<Self, String> {
        // SAFETY: each function has the type that the standard gives its name.
        unsafe { Self::of(Library) }
    }

    /// # Safety
    /// What the library exports under a name of the standard must be that function.
    unsafe fn of(library: Library) -> Result<Self, String> {
        // SAFETY: each symbol is only called as the function that the standard gives its name.
        unsafe {
            let find = |name: &str| library.get::<Symbol>(name).map(|symbol| *symbol);
            let needed = |name: &str| find(name).map_err(|error| with_causes(&error));
            NEEDED.iter().try_for_each(|function| needed(function.name()).map(drop))?;
            let functions = Function::ALL.iter().map(|function| find(function.name()).ok()).collect();
            let (instantiate, free) = (needed("fmi2Instantiate")?, needed("fmi2FreeInstance")?);
            Ok(Binary { instantiate, free, functions, library })
        }
    }

    /// A function that isn't of the standard.
    pub fn symbol(&self, name: &str) -> Option<Symbol> {
        // SAFETY: it is only called as a function of the type that a library of this crate gives its name.
        unsafe { self.library.get::<Symbol>(name).map(|symbol| *symbol).ok() }
    }

    /// # Safety
    /// `F` must be the type that the standard gives the function.
    unsafe fn function<F: Copy>(&self, function: Function) -> Result<F, String> {
        let symbol = self.functions[function as usize];
        let symbol = symbol.ok_or_else(|| "its library doesn't export this function".to_owned())?;
        // SAFETY: both are pointers to functions; that it is one of this type, the caller states.
        Ok(unsafe { std::mem::transmute_copy(&symbol) })
    }
}

/// The reason why a library isn't loaded, with advice where its file system allows no code.
fn why(error: &dyn std::error::Error) -> String {
    let reason = with_causes(error);
    if !reason.contains(NO_CODE) {
        return reason;
    }
    let folder = std::env::temp_dir();
    format!(
        "{reason}. So it is where {} is mounted noexec: set TMPDIR to a folder on a file system that allows programs",
        folder.display()
    )
}

/// Loads a library, and Python before it where it is in Python.
///
/// # Safety
/// The library's initialisers are run.
unsafe fn open(path: &Path) -> Result<Library, String> {
    // SAFETY: as this function asks of its caller.
    let opened = unsafe { Library::new(path) }.map_err(|error| why(&error));
    // Its initialisers may have moved the process, and there are other files to be read.
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
    binary: Arc<Binary>,
    log: Box<Log>,
    _callbacks: Box<CallbackFunctions>,
    is_freed: bool,
    /// Its compiled equations. Dropped when the instance is freed.
    equations: RefCell<Equations>,
}

impl InProcess {
    /// Makes an instance; the reason where that fails.
    pub fn new(binary: &Arc<Binary>, kernel: Option<Awaited>, plan: &Plan) -> Result<Self, String> {
        let log = Box::new(Log::keeping(plan.details));
        let callbacks = Box::new(CallbackFunctions {
            logger: Some(logger()),
            allocate_memory: Some(calloc),
            free_memory: Some(free),
            step_finished: None,
            component_environment: std::ptr::from_ref(&*log).cast_mut().cast(),
        });
        let text = |text: &str| CString::new(text).map_err(|_| "a name holds a NUL character".to_owned());
        let (name, guid, resources) = (text(&plan.name)?, text(&plan.guid)?, text(&plan.resources)?);
        // SAFETY: the type is the standard's; the library stays loaded as long as the instance, which holds it, and
        // strings and callbacks live as long as the standard asks.
        let component = unsafe {
            let instantiate: Instantiate = std::mem::transmute(binary.instantiate);
            let (guid, resources) = (guid.as_ptr(), resources.as_ptr());
            instantiate(name.as_ptr(), plan.kind, guid, resources, &raw const *callbacks, 0, plan.logs.into())
        };
        if component.is_null() {
            return Err(match log.take() {
                silent if silent.is_empty() => "fmi2Instantiate failed, without a message".to_owned(),
                messages => format!("fmi2Instantiate failed: {}", messages.joined()),
            });
        }
        let (binary, equations) = (Arc::clone(binary), RefCell::new(Equations::of(kernel)));
        Ok(InProcess { component, binary, log, _callbacks: callbacks, is_freed: false, equations })
    }

    /// Hands over its compiled equations when they are there.
    fn look_for_kernel(&self) {
        self.equations.borrow_mut().look(self.component, &self.binary);
    }
}

impl RunningUnit for InProcess {
    fn call(&self, call: Call<'_>) -> Result<Answer, String> {
        let (component, function) = (self.component, call.function());
        // SAFETY: the types are those that the standard gives the functions; references and values are as many as said
        // (`Instance` sees to that), and texts outlive the calls.
        unsafe {
            let binary = &self.binary;
            Ok(match call {
                Call::Plain(_) => binary.function::<Plain>(function)?(component),
                Call::SetupExperiment { start, stop } => {
                    binary.function::<Setup>(function)?(component, 0, 0.0, start, 1, stop)
                }
                Call::GetReal(references, values) => {
                    let call = binary.function::<GetReal>(function)?;
                    call(component, references.as_ptr(), references.len(), values.as_mut_ptr())
                }
                Call::SetReal(references, values) => {
                    let call = binary.function::<SetReal>(function)?;
                    call(component, references.as_ptr(), references.len(), values.as_ptr())
                }
                Call::GetWhole(_, references, values) => {
                    let call = binary.function::<GetWhole>(function)?;
                    call(component, references.as_ptr(), references.len(), values.as_mut_ptr())
                }
                Call::SetWhole(_, references, values) => {
                    let call = binary.function::<SetWhole>(function)?;
                    call(component, references.as_ptr(), references.len(), values.as_ptr())
                }
                Call::SetString(reference, text) => {
                    let text = CString::new(text.replace('\0', "")).unwrap_or_default();
                    binary.function::<SetString>(function)?(component, &raw const reference, 1, &text.as_ptr())
                }
                Call::DoStep { time, step } => {
                    self.look_for_kernel();
                    binary.function::<DoStep>(function)?(component, time, step, 1)
                }
                Call::DirectionalDerivative { unknowns, knowns, seed, result } => {
                    let call = binary.function::<DirectionalDerivative>(function)?;
                    let (unknown, known) = (unknowns.as_ptr(), knowns.as_ptr());
                    call(component, unknown, unknowns.len(), known, knowns.len(), seed.as_ptr(), result.as_mut_ptr())
                }
                Call::GetNumbers(_, numbers) => {
                    binary.function::<GetNumbers>(function)?(component, numbers.as_mut_ptr(), numbers.len())
                }
                Call::SetContinuousStates(states) => {
                    binary.function::<SetNumbers>(function)?(component, states.as_ptr(), states.len())
                }
                Call::SetTime(time) => {
                    self.look_for_kernel();
                    binary.function::<SetTime>(function)?(component, time)
                }
                Call::NewDiscreteStates(info) => binary.function::<NewDiscreteStates>(function)?(component, info),
                Call::CompletedIntegratorStep([event, end]) => {
                    binary.function::<CompletedIntegratorStep>(function)?(component, 1, event, end)
                }
            })
        }
    }

    fn messages(&self) -> Messages {
        self.log.take()
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
        // Never an error in this process.
        let _ = self.free();
    }
}
