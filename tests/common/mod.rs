//! A master that calls the C functions as any tool does.
#![allow(dead_code)] // each test file uses its part

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::fmi2::{access::References, model_description};
use adaptive_fmu::library::{REGISTRY, fmi2_functions::*};
use adaptive_fmu::model::{Description, Model};

pub const OK: Status = Status::Ok;
pub const ERROR: Status = Status::Error;

/// What was logged: status, category and message.
pub type Logged = Vec<(c_int, String, String)>;

/// The logger of every [`Unit`]; its environment is the unit's list of messages.
///
/// A variadic function can't be written in stable Rust; the messages are preformatted, so the arguments before the
/// dots are all that there is, and on the platforms of these tests they are passed as in a function without dots.
unsafe extern "C" fn logger(
    environment: *mut c_void,
    _instance: *const c_char,
    status: Status,
    category: *const c_char,
    message: *const c_char,
) {
    let log = unsafe { &*environment.cast::<RefCell<Logged>>() };
    let text = |pointer| unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned();
    log.borrow_mut().push((status as c_int, text(category), text(message)));
}

fn callbacks(log: &RefCell<Logged>) -> CallbackFunctions {
    let function: unsafe extern "C" fn(_, _, _, _, _) = logger;
    CallbackFunctions {
        logger: Some(unsafe {
            std::mem::transmute::<
                unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char),
                LoggerFunction,
            >(function)
        }),
        allocate_memory: None,
        free_memory: None,
        step_finished: None,
        component_environment: std::ptr::from_ref(log).cast_mut().cast(),
    }
}

/// An instance of a unit, with the model beside it for names.
pub struct Unit {
    pub component: Component,
    pub model: Model,
    log: Box<RefCell<Logged>>,
    _callbacks: Box<CallbackFunctions>,
    _folder: tempfile::TempDir,
}

/// The text of a description of this package.
pub fn description(name: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("modelDescription").join(format!("{name}.toml"));
    std::fs::read_to_string(file).unwrap()
}

impl Unit {
    /// Instantiated.
    pub fn new(name: &str) -> Self {
        Unit::from_text(&description(name))
    }

    /// Instantiated from a description's text.
    pub fn from_text(text: &str) -> Self {
        let model = Model::from_description(Description::read(text).unwrap(), REGISTRY).unwrap();
        let guid = model_description::guid_text(model_description::guid(&model));
        Unit::try_new(text, model, &guid, CO_SIMULATION).expect("an instance")
    }

    /// What fmi2Instantiate gives, or what it logged.
    pub fn try_new(text: &str, model: Model, guid: &str, kind: c_int) -> Result<Self, Logged> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), text).unwrap();
        let location = CString::new(format!("file://{}", folder.path().display())).unwrap();
        let log = Box::new(RefCell::new(Vec::new()));
        let callbacks = Box::new(callbacks(&log));
        let guid = CString::new(guid).unwrap();
        let component = unsafe {
            fmi2Instantiate(c"unit".as_ptr(), kind, guid.as_ptr(), location.as_ptr(), &*callbacks, FALSE, FALSE)
        };
        if component.is_null() {
            return Err(log.take());
        }
        Ok(Unit { component, model, log, _callbacks: callbacks, _folder: folder })
    }

    /// Instantiated and initialised, starting at 0.
    pub fn started(name: &str) -> Self {
        let unit = Unit::new(name);
        unit.start(0.0);
        unit
    }

    pub fn start(&self, time: f64) {
        assert_eq!(self.setup(time, None), OK);
        assert_eq!(unsafe { fmi2EnterInitializationMode(self.component) }, OK);
        assert_eq!(unsafe { fmi2ExitInitializationMode(self.component) }, OK, "{:?}", self.messages());
    }

    pub fn setup(&self, start: f64, stop: Option<f64>) -> Status {
        let defined = Boolean::from(stop.is_some());
        unsafe { fmi2SetupExperiment(self.component, FALSE, 0.0, start, defined, stop.unwrap_or(0.0)) }
    }

    pub fn reference(&self, name: &str) -> u32 {
        let variables = self.model.variables();
        References::of(variables, variables.find(name).unwrap_or_else(|| panic!("no variable {name}")))
    }

    pub fn get(&self, name: &str) -> f64 {
        let mut value = f64::NAN;
        assert_eq!(
            unsafe { fmi2GetReal(self.component, &self.reference(name), 1, &mut value) },
            OK,
            "{:?}",
            self.messages()
        );
        value
    }

    pub fn set(&self, name: &str, value: f64) -> Status {
        unsafe { fmi2SetReal(self.component, &self.reference(name), 1, &value) }
    }

    pub fn set_integer(&self, name: &str, value: c_int) -> Status {
        unsafe { fmi2SetInteger(self.component, &self.reference(name), 1, &value) }
    }

    pub fn step(&self, point: f64, step: f64) -> Status {
        unsafe { fmi2DoStep(self.component, point, step, FALSE) }
    }

    /// Steps to a time, and asserts that every step is taken.
    pub fn run(&self, from: f64, steps: usize, step: f64) {
        for k in 0..steps {
            assert_eq!(self.step(from + k as f64 * step, step), OK, "{:?}", self.messages());
        }
    }

    /// All visible reals: a fingerprint of the instance.
    pub fn values(&self) -> Vec<u64> {
        let reals = self.model.variables().visible().filter(|element| element.variable.is_real());
        let references: Vec<u32> = reals.map(|element| References::of(self.model.variables(), element)).collect();
        let mut values = vec![0.0; references.len()];
        let status = unsafe { fmi2GetReal(self.component, references.as_ptr(), references.len(), values.as_mut_ptr()) };
        assert_eq!(status, OK, "{:?}", self.messages());
        values.into_iter().map(f64::to_bits).collect()
    }

    /// Messages so far, which are then forgotten.
    pub fn messages(&self) -> Logged {
        self.log.take()
    }

    /// The last message's text.
    pub fn last_message(&self) -> String {
        self.messages().pop().map_or(String::new(), |(_, _, text)| text)
    }
}

impl Drop for Unit {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.component) }
    }
}
