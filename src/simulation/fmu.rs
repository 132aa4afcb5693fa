//! FMUs, loaded as any master loads them.

mod exchange;

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use libloading::Library;

use super::description::Description;
use crate::error::Error;
use crate::exporter::{Platform, read_entry, unpack, with_causes};
use crate::fmi2::types::{CO_SIMULATION, CallbackFunctions, Component, LoggerFunction, MODEL_EXCHANGE, Status};

/// A value of a variable.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Of a Real.
    Real(f64),
    /// Of an Integer, or the number of an Enumeration's item.
    Integer(i32),
    /// Of a Boolean.
    Boolean(bool),
    /// Of a String.
    String(String),
}

/// An FMU that was unpacked and loaded.
#[derive(Debug)]
pub struct Fmu {
    file: PathBuf,
    folder: tempfile::TempDir,
    /// What it says of itself.
    pub description: Description,
    library: Library,
}

/// The functions' answers as numbers: another tool's unit may give any.
type Answer = c_int;
const OK: Answer = Status::Ok as c_int;
const WARNING: Answer = Status::Warning as c_int;

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
type GetInteger = unsafe extern "C" fn(Component, *const u32, usize, *mut c_int) -> Answer;
type SetInteger = unsafe extern "C" fn(Component, *const u32, usize, *const c_int) -> Answer;
type SetString = unsafe extern "C" fn(Component, *const u32, usize, *const *const c_char) -> Answer;
type DoStep = unsafe extern "C" fn(Component, f64, f64, c_int) -> Answer;

#[derive(Debug, Clone, Copy)]
struct Functions {
    free: Free,
    setup_experiment: Setup,
    enter_initialization_mode: Plain,
    exit_initialization_mode: Plain,
    terminate: Plain,
    get_real: GetReal,
    set_real: SetReal,
    get_integer: GetInteger,
    set_integer: SetInteger,
    get_boolean: GetInteger,
    set_boolean: SetInteger,
    set_string: SetString,
    do_step: DoStep,
}

impl Fmu {
    /// Loads an archive.
    ///
    /// # Errors
    /// When it is no FMU 2.0 for co-simulation on this platform.
    pub fn open(file: &Path) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
        let description = Description::read(&read_entry(file, "modelDescription.xml")?);
        let description = description.and_then(Description::for_co_simulation).map_err(refuse)?;
        let folder = tempfile::tempdir().map_err(Error::file("temporary folder"))?;
        unpack(file, folder.path())?;
        let identifier = &description.model_identifier;
        let name = Platform::own().binary(identifier);
        let path = folder.path().join(&name);
        if !path.is_file() {
            return Err(refuse(format!("holds no {name}: it can't run on this platform")));
        }
        // SAFETY: the user asked for this FMU to be run; its initialisers run as in any master.
        let library = unsafe { Library::new(&path) }.map_err(|error| refuse(with_causes(&error)))?;
        Ok(Fmu { file: file.to_owned(), folder, description, library })
    }

    /// Its archive.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// An instance for co-simulation.
    ///
    /// # Errors
    /// When the library lacks a function, or refuses.
    pub fn instantiate(self: &Arc<Self>, name: &str) -> Result<Instance, Error> {
        self.instantiate_as(CO_SIMULATION, name)
    }

    /// An instance for model exchange, of an FMU whose library is for both.
    ///
    /// # Errors
    /// When the library lacks a function, or refuses.
    pub fn instantiate_for_exchange(self: &Arc<Self>, name: &str) -> Result<Instance, Error> {
        self.instantiate_as(MODEL_EXCHANGE, name)
    }

    fn instantiate_as(self: &Arc<Self>, kind: c_int, name: &str) -> Result<Instance, Error> {
        let refuse = |reason: String| Error::Archive { file: self.file.clone(), reason };
        let messages = Box::new(RefCell::new(Vec::new()));
        let callbacks = Box::new(CallbackFunctions {
            logger: Some(logger()),
            allocate_memory: None,
            free_memory: None,
            step_finished: None,
            component_environment: std::ptr::from_ref(&*messages).cast_mut().cast(),
        });
        let c_string = |text: &str| CString::new(text).map_err(|_| refuse("a name holds a NUL character".to_owned()));
        let guid = c_string(&self.description.guid)?;
        let resources = c_string(&file_uri(&self.folder.path().join("resources")))?;
        let instance_name = c_string(name)?;
        // SAFETY: the types are those that the standard gives these names; the library stays loaded as long as the
        // instance (it holds this Arc), and strings and callbacks as long as the standard asks.
        unsafe {
            let functions = self.functions().map_err(|error| refuse(with_causes(&error)))?;
            let instantiate =
                self.library.get::<Instantiate>(b"fmi2Instantiate").map_err(|error| refuse(with_causes(&error)))?;
            let (guid, resources) = (guid.as_ptr(), resources.as_ptr());
            let component = instantiate(instance_name.as_ptr(), kind, guid, resources, &*callbacks, 0, 0);
            if component.is_null() {
                return Err(refuse(format!("fmi2Instantiate failed: {}", messages.take().join("; "))));
            }
            let (fmu, name) = (Arc::clone(self), name.to_owned());
            Ok(Instance { component, functions, name, time: 0.0, messages, _callbacks: callbacks, fmu })
        }
    }

    /// # Safety
    /// The library must be an FMU's: each symbol has the type that the standard gives it.
    unsafe fn functions(&self) -> Result<Functions, libloading::Error> {
        // SAFETY: as this function asks of its caller.
        unsafe {
            Ok(Functions {
                free: *self.library.get(b"fmi2FreeInstance")?,
                setup_experiment: *self.library.get(b"fmi2SetupExperiment")?,
                enter_initialization_mode: *self.library.get(b"fmi2EnterInitializationMode")?,
                exit_initialization_mode: *self.library.get(b"fmi2ExitInitializationMode")?,
                terminate: *self.library.get(b"fmi2Terminate")?,
                get_real: *self.library.get(b"fmi2GetReal")?,
                set_real: *self.library.get(b"fmi2SetReal")?,
                get_integer: *self.library.get(b"fmi2GetInteger")?,
                set_integer: *self.library.get(b"fmi2SetInteger")?,
                get_boolean: *self.library.get(b"fmi2GetBoolean")?,
                set_boolean: *self.library.get(b"fmi2SetBoolean")?,
                set_string: *self.library.get(b"fmi2SetString")?,
                do_step: *self.library.get(b"fmi2DoStep")?,
            })
        }
    }
}

/// A `file:` URI of a path.
fn file_uri(path: &Path) -> String {
    let text = path.to_string_lossy().replace('\\', "/").replace('%', "%25").replace(' ', "%20");
    if text.starts_with('/') { format!("file://{text}") } else { format!("file:///{text}") }
}

/// Keeps errors and warnings of an instance. Rust can't define a variadic function, but on every platform that FMUs
/// are built for, the arguments before the dots come as in a function without dots; what follows isn't read.
unsafe extern "C" fn keep_message(
    environment: *mut c_void,
    _instance: *const c_char,
    _status: c_int,
    _category: *const c_char,
    message: *const c_char,
) {
    if !message.is_null() {
        // SAFETY: the environment is the instance's list of messages, which outlives it; the message is a C string.
        let (messages, text) = unsafe { (&*environment.cast::<RefCell<Vec<String>>>(), CStr::from_ptr(message)) };
        // By the standard it is a format of printf.
        messages.borrow_mut().push(text.to_string_lossy().replace("%%", "%"));
    }
}

fn logger() -> LoggerFunction {
    type Fixed = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char);
    // SAFETY: see `keep_message`; the status, an enum in C, is a C int.
    unsafe { std::mem::transmute::<Fixed, LoggerFunction>(keep_message) }
}

/// An instance of an FMU.
#[derive(Debug)]
pub struct Instance {
    component: Component,
    functions: Functions,
    name: String,
    time: f64,
    messages: Box<RefCell<Vec<String>>>,
    _callbacks: Box<CallbackFunctions>,
    fmu: Arc<Fmu>,
}

impl Instance {
    /// Its name in the loop.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its FMU.
    pub fn fmu(&self) -> &Fmu {
        &self.fmu
    }

    /// The description of its FMU.
    pub fn description(&self) -> &Description {
        &self.fmu.description
    }

    /// Messages since the last call: warnings, when every call was OK.
    pub fn messages(&self) -> Vec<String> {
        self.messages.take()
    }

    fn check(&self, function: &'static str, answer: Answer) -> Result<(), Error> {
        if answer == OK || answer == WARNING {
            return Ok(());
        }
        let mut message = self.messages.take().join("; ");
        if message.is_empty() {
            message = format!("status {answer}, without a message");
        }
        Err(self.refusal(function, message))
    }

    fn refusal(&self, function: &'static str, message: String) -> Error {
        Error::Unit { unit: self.name.clone(), function, time: self.time, message }
    }

    /// Sets a start value.
    ///
    /// # Errors
    /// When the unit refuses it.
    pub fn set_start(&self, reference: u32, value: &Value) -> Result<(), Error> {
        match value {
            Value::Real(value) => self.set_real(&[reference], &[*value]),
            Value::Integer(value) => self.set_integer(&[reference], &[*value]),
            Value::Boolean(value) => self.set_boolean(&[reference], &[c_int::from(*value)]),
            Value::String(text) => {
                let text = CString::new(text.replace('\0', "")).unwrap_or_default();
                // SAFETY: the function's type is the standard's; one reference, and one C string that outlives the call.
                let answer = unsafe { (self.functions.set_string)(self.component, &reference, 1, &text.as_ptr()) };
                self.check("fmi2SetString", answer)
            }
        }
    }

    /// Sets up the experiment and enters Initialization Mode.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn enter_initialization(&mut self, start: f64, stop: f64) -> Result<(), Error> {
        self.time = start;
        // SAFETY: the function's type is the standard's.
        let answer = unsafe { (self.functions.setup_experiment)(self.component, 0, 0.0, start, 1, stop) };
        self.check("fmi2SetupExperiment", answer)?;
        // SAFETY: the function's type is the standard's.
        let answer = unsafe { (self.functions.enter_initialization_mode)(self.component) };
        self.check("fmi2EnterInitializationMode", answer)
    }

    /// Leaves Initialization Mode.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn exit_initialization(&self) -> Result<(), Error> {
        // SAFETY: the function's type is the standard's.
        let answer = unsafe { (self.functions.exit_initialization_mode)(self.component) };
        self.check("fmi2ExitInitializationMode", answer)
    }

    /// Reads real variables.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn get_real(&self, references: &[u32], values: &mut [f64]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.get_real)(self.component, pointer, count, values.as_mut_ptr()) };
        self.check("fmi2GetReal", answer)
    }

    /// Sets real variables.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn set_real(&self, references: &[u32], values: &[f64]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.set_real)(self.component, pointer, count, values.as_ptr()) };
        self.check("fmi2SetReal", answer)
    }

    /// Reads integer variables.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn get_integer(&self, references: &[u32], values: &mut [i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.get_integer)(self.component, pointer, count, values.as_mut_ptr()) };
        self.check("fmi2GetInteger", answer)
    }

    /// Sets integer variables.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn set_integer(&self, references: &[u32], values: &[i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.set_integer)(self.component, pointer, count, values.as_ptr()) };
        self.check("fmi2SetInteger", answer)
    }

    /// Reads boolean variables: 0 or 1.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn get_boolean(&self, references: &[u32], values: &mut [i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.get_boolean)(self.component, pointer, count, values.as_mut_ptr()) };
        self.check("fmi2GetBoolean", answer)
    }

    /// Sets boolean variables: 0 or 1.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn set_boolean(&self, references: &[u32], values: &[i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        let (pointer, count) = (references.as_ptr(), references.len());
        // SAFETY: the function's type is the standard's; references and values are as many as said.
        let answer = unsafe { (self.functions.set_boolean)(self.component, pointer, count, values.as_ptr()) };
        self.check("fmi2SetBoolean", answer)
    }

    /// Takes one communication step.
    ///
    /// # Errors
    /// When the step isn't finished, discarded ones included.
    pub fn do_step(&mut self, time: f64, step: f64) -> Result<(), Error> {
        self.time = time;
        // SAFETY: the function's type is the standard's.
        let answer = unsafe { (self.functions.do_step)(self.component, time, step, 1) };
        self.check("fmi2DoStep", answer)
    }

    /// Ends the simulation.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn terminate(&self) -> Result<(), Error> {
        // SAFETY: the function's type is the standard's.
        let answer = unsafe { (self.functions.terminate)(self.component) };
        self.check("fmi2Terminate", answer)
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: freed once, while its library is loaded.
        unsafe { (self.functions.free)(self.component) }
    }
}
