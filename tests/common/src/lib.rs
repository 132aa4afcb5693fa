//! A master that calls the C functions as any tool does.
// Only tests call this, with instances that they made.
#![allow(clippy::new_without_default, clippy::should_implement_trait, clippy::not_unsafe_ptr_arg_deref)]

pub mod closed;
pub mod contacts;
pub mod described;
pub mod drawn;
pub mod exact;
pub mod exchange;
pub mod fmi3;
pub mod fuzz;
pub mod limited_loop;
pub mod loops;
pub mod models;
pub mod pages;
pub mod random;
pub mod random_equations;
pub mod sample;
pub mod sequences;
pub mod standard;
pub mod states;
pub mod stiff;
pub mod systems;

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};

use adaptive_fmu::catalogue::Trial;
use adaptive_fmu::fmi2::build::Library;
use adaptive_fmu::fmi2::interface;
use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::fmi2::{access::References, model_description};
use adaptive_fmu::library::{self, REGISTRY, SOURCE};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::{Data, Registry};
use adaptive_fmu_library::fmi2_functions::*;

pub const OK: Status = Status::Ok;
pub const ERROR: Status = Status::Error;
pub const DISCARD: Status = Status::Discard;

/// Log entries: status, category and message.
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

pub fn callbacks(log: &RefCell<Logged>) -> CallbackFunctions {
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

/// True if a text is a format of printf that asks for no argument.
pub fn is_plain_format(text: &str) -> bool {
    !text.replace("%%", "").contains('%')
}

/// A call of fmi2Instantiate; `None` is a NULL pointer.
pub struct Request {
    pub registry: Registry,
    pub name: Option<String>,
    pub kind: c_int,
    pub guid: Option<String>,
    pub location: Option<String>,
}

impl Request {
    pub fn make(&self, callbacks: *const CallbackFunctions) -> Component {
        let strings = [&self.name, &self.guid, &self.location]
            .map(|text| text.as_ref().map(|text| CString::new(text.as_str()).unwrap()));
        let [name, guid, location] =
            strings.each_ref().map(|text| text.as_ref().map_or(std::ptr::null(), |t| t.as_ptr()));
        let library = Library { registry: self.registry, source: SOURCE, build: &[] };
        unsafe { interface::instantiate(library, name, self.kind, guid, location, callbacks, FALSE, FALSE) }
    }
}

/// An instance of an FMU, with its model for names.
pub struct Unit {
    pub component: Component,
    pub model: Model,
    log: Box<RefCell<Logged>>,
    _callbacks: Box<CallbackFunctions>,
    _folder: tempfile::TempDir,
}

/// A file or a folder by its path in the repository.
pub fn at_top(path: &str) -> PathBuf {
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|folder| folder.join("modelDescription").is_dir());
    folder.expect("this package lies within that of the descriptions").join(path)
}

/// The folder of this package's descriptions.
pub fn description_folder() -> PathBuf {
    at_top("modelDescription")
}

/// The text of a description of this package.
pub fn description(name: &str) -> String {
    std::fs::read_to_string(description_folder().join(format!("{name}.toml"))).unwrap()
}

/// The names of all descriptions of this package.
pub fn description_names() -> Vec<String> {
    let files = std::fs::read_dir(description_folder()).unwrap().map(|entry| entry.unwrap().path());
    let mut names: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert!(!names.is_empty(), "there are descriptions");
    names
}

pub fn guid(model: &Model) -> String {
    model_description::guid_text(model_description::guid(model))
}

impl Unit {
    /// Instantiated.
    pub fn new(name: &str) -> Self {
        Unit::from_text(&description(name))
    }

    /// Instantiated from a description's text.
    pub fn from_text(text: &str) -> Self {
        Unit::of(REGISTRY, text)
    }

    /// Instantiated from a description's text and a registry of the test's own.
    pub fn of(registry: Registry, text: &str) -> Self {
        Unit::made(registry, text, CO_SIMULATION)
    }

    /// Instantiated for one of the two interfaces.
    pub fn made(registry: Registry, text: &str, kind: c_int) -> Self {
        let model = Model::from_description(Description::read(text).unwrap(), registry).unwrap();
        let guid = guid(&model);
        Unit::try_new(registry, text, model, &guid, kind).expect("an instance")
    }

    /// Returns the result of fmi2Instantiate, or its log.
    pub fn try_new(registry: Registry, text: &str, model: Model, guid: &str, kind: c_int) -> Result<Self, Logged> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), text).unwrap();
        let location = Some(format!("file://{}", folder.path().display()));
        let log = Box::new(RefCell::new(Vec::new()));
        let callbacks = Box::new(callbacks(&log));
        let request = Request { registry, name: Some("unit".to_owned()), kind, guid: Some(guid.to_owned()), location };
        let component = request.make(&*callbacks);
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
        self.enter(time);
        assert_eq!(self.exit(), OK, "{:?}", self.messages());
    }

    pub fn setup(&self, start: f64, stop: Option<f64>) -> Status {
        let defined = Boolean::from(stop.is_some());
        unsafe { fmi2SetupExperiment(self.component, FALSE, 0.0, start, defined, stop.unwrap_or(0.0)) }
    }

    /// Into Initialization Mode.
    pub fn enter(&self, time: f64) {
        assert_eq!(self.setup(time, None), OK, "{:?}", self.messages());
        assert_eq!(unsafe { fmi2EnterInitializationMode(self.component) }, OK, "{:?}", self.messages());
    }

    /// Out of Initialization Mode.
    pub fn exit(&self) -> Status {
        unsafe { fmi2ExitInitializationMode(self.component) }
    }

    /// Sets the start values for tests by which its kind moves in both interfaces alike.
    pub fn soften(&self) {
        self.try_with(|trial| trial.smooth);
    }

    /// Sets start values for tests that its kind gives, as far as it has them.
    pub fn try_with(&self, which: fn(&Trial) -> &'static str) {
        let Some(entry) = library::find(&self.model.description().model) else { return };
        for (key, value) in described::tried(self.model.variables(), which(&entry.trial)) {
            match value {
                toml::Value::String(item) => assert_eq!(self.set_integer(&key, self.item(&key, &item)), OK),
                toml::Value::Array(values) => {
                    let numbers = values.iter().map(|value| value.as_float().unwrap());
                    numbers.enumerate().for_each(|(i, number)| self.put(&format!("{key}[{}]", i + 1), number));
                }
                number => self.put(&key, number.as_float().unwrap()),
            }
        }
    }

    /// The number of an item of a choice.
    fn item(&self, name: &str, item: &str) -> c_int {
        let variable = self.model.variables().find(name).unwrap().variable;
        let Data::Choice { items, .. } = &variable.data else { panic!("{name} is no choice") };
        let place = items.iter().position(|(known, _)| known == item);
        place.unwrap_or_else(|| panic!("{name} has no item {item}")) as c_int + 1
    }

    pub fn reset(&self) -> Status {
        unsafe { fmi2Reset(self.component) }
    }

    pub fn terminate(&self) -> Status {
        unsafe { fmi2Terminate(self.component) }
    }

    pub fn reference(&self, name: &str) -> u32 {
        let variables = self.model.variables();
        References::of(variables, variables.find(name).unwrap_or_else(|| panic!("no variable {name}")))
    }

    pub fn get(&self, name: &str) -> f64 {
        let mut value = f64::NAN;
        assert_eq!(self.try_get(name, &mut value), OK, "{name}: {:?}", self.messages());
        value
    }

    pub fn try_get(&self, name: &str, value: &mut f64) -> Status {
        unsafe { fmi2GetReal(self.component, &self.reference(name), 1, value) }
    }

    pub fn set(&self, name: &str, value: f64) -> Status {
        unsafe { fmi2SetReal(self.component, &self.reference(name), 1, &value) }
    }

    /// Sets what the test needs set.
    pub fn put(&self, name: &str, value: f64) {
        assert_eq!(self.set(name, value), OK, "{name} = {value}: {:?}", self.messages());
    }

    pub fn set_reals(&self, references: &[u32], values: &[f64]) -> Status {
        unsafe { fmi2SetReal(self.component, references.as_ptr(), references.len(), values.as_ptr()) }
    }

    pub fn get_reals(&self, references: &[u32], values: &mut [f64]) -> Status {
        unsafe { fmi2GetReal(self.component, references.as_ptr(), references.len(), values.as_mut_ptr()) }
    }

    pub fn set_integer(&self, name: &str, value: c_int) -> Status {
        unsafe { fmi2SetInteger(self.component, &self.reference(name), 1, &value) }
    }

    pub fn get_integer(&self, name: &str) -> c_int {
        let mut value = c_int::MIN;
        let status = unsafe { fmi2GetInteger(self.component, &self.reference(name), 1, &mut value) };
        assert_eq!(status, OK, "{name}: {:?}", self.messages());
        value
    }

    /// Rate of an input over the next step.
    pub fn set_boolean(&self, name: &str, value: bool) -> Status {
        unsafe { fmi2SetBoolean(self.component, &self.reference(name), 1, &Boolean::from(value)) }
    }

    pub fn get_boolean(&self, name: &str) -> bool {
        let mut value = -1;
        assert_eq!(unsafe { fmi2GetBoolean(self.component, &self.reference(name), 1, &mut value) }, OK);
        value != 0
    }

    pub fn set_slope(&self, name: &str, slope: f64) -> Status {
        unsafe { fmi2SetRealInputDerivatives(self.component, &self.reference(name), 1, &1, &slope) }
    }

    /// First derivative of an output.
    pub fn output_derivative(&self, name: &str) -> f64 {
        let mut value = f64::NAN;
        let status = unsafe { fmi2GetRealOutputDerivatives(self.component, &self.reference(name), 1, &1, &mut value) };
        assert_eq!(status, OK, "{name}: {:?}", self.messages());
        value
    }

    pub fn last_successful_time(&self) -> f64 {
        let mut time = f64::NAN;
        let kind = status_kind::LAST_SUCCESSFUL_TIME;
        assert_eq!(unsafe { fmi2GetRealStatus(self.component, kind, &mut time) }, OK, "{:?}", self.messages());
        time
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

    /// All visible reals.
    pub fn values(&self) -> Vec<u64> {
        let reals = self.model.variables().visible().filter(|element| element.variable.is_real());
        let references: Vec<u32> = reals.map(|element| References::of(self.model.variables(), element)).collect();
        let mut values = vec![0.0; references.len()];
        assert_eq!(self.get_reals(&references, &mut values), OK, "{:?}", self.messages());
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

    /// Asserts that a call is refused with a message that names these things, and that nothing at all has changed.
    pub fn refuses(&self, named: &[&str], call: impl FnOnce(&Unit) -> Status) {
        let before = self.fingerprint();
        self.messages();
        assert_eq!(call(self), ERROR, "a call that should name {named:?}");
        let message = self.last_message();
        named.iter().for_each(|name| assert!(message.contains(name), "`{message}` names {name}"));
        assert!(is_plain_format(&message), "by the standard the message is a format: {message}");
        assert!(!message.contains('\n'), "one line: {message}");
        assert_eq!(self.fingerprint(), before, "a refused call changes nothing: {message}");
    }
}

impl Drop for Unit {
    fn drop(&mut self) {
        unsafe { fmi2FreeInstance(self.component) }
    }
}
