//! Hosts in C++ whose loggers throw, jump, or call in again (docs/fmu_behaviour.md): what the units promise them.
//!
//! Needs a C++ compiler, `c++` or what `CXX` names.
#![cfg(unix)]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu_library::fmi2_functions::*;
use common::*;
use libloading::Library;

const NOTHING: c_int = 0;
const THROW: c_int = 1;
const JUMP: c_int = 2;
const GET: c_int = 3;

/// Ends of a call.
const RETURNED: c_int = 0;
const THROWN: c_int = 1;
const JUMPED: c_int = 2;

type Call = unsafe extern "C-unwind" fn(Component) -> c_int;

/// A host with one instance of a plant.
struct Host {
    library: Library,
    host: *mut c_void,
    component: Component,
    model: Model,
    _folder: tempfile::TempDir,
}

fn compiled(folder: &Path) -> Library {
    let library = folder.join("host.so");
    let source = at_top("tests/hosts/logger.cpp");
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
    let done = Command::new(compiler).args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(source).output();
    let done = done.expect("a C++ compiler");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    unsafe { Library::new(library) }.unwrap()
}

impl Host {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let text = description("NonlinearSiso");
        std::fs::write(folder.path().join("description.toml"), &text).unwrap();
        let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
        let variables = model.variables();
        OUTPUT.get_or_init(|| References::of(variables, variables.find("y[1]").unwrap()));
        let library = compiled(folder.path());
        let host = unsafe { library.get::<extern "C" fn() -> *mut c_void>(b"new_host").unwrap()() };
        let mut made = Host { library, host, component: std::ptr::null_mut(), model, _folder: folder };
        made.component = made.instantiate(&guid(&made.model));
        assert!(!made.component.is_null(), "{}", made.text());
        made
    }

    fn callbacks(&self) -> CallbackFunctions {
        CallbackFunctions {
            logger: Some(*unsafe { self.library.get::<LoggerFunction>(b"logger") }.unwrap()),
            allocate_memory: None,
            free_memory: None,
            step_finished: None,
            component_environment: self.host,
        }
    }

    fn instantiate(&self, guid: &str) -> Component {
        let place = format!("file://{}", self._folder.path().display());
        let [guid, place] = [guid, &place].map(|text| CString::new(text).unwrap());
        let (name, guid, place) = (c"unit".as_ptr(), guid.as_ptr(), place.as_ptr());
        unsafe { fmi2Instantiate(name, CO_SIMULATION, guid, place, &self.callbacks(), FALSE, FALSE) }
    }

    fn start(&self) {
        unsafe {
            assert_eq!(fmi2SetupExperiment(self.component, FALSE, 0.0, 0.0, FALSE, 0.0), OK);
            assert_eq!(fmi2EnterInitializationMode(self.component), OK);
            assert_eq!(fmi2ExitInitializationMode(self.component), OK);
        }
    }

    /// Calls with a logger that does something; how it came back, and the call's answer.
    fn call(&self, what: c_int, call: Call) -> (c_int, c_int) {
        type Tell = extern "C" fn(*mut c_void, c_int, Component, Call);
        type CallAsHost = extern "C" fn(*mut c_void, Call, Component, *mut c_int) -> c_int;
        let mut status = -1;
        let back = unsafe {
            self.library.get::<Tell>(b"tell_host").unwrap()(self.host, what, self.component, get);
            self.library.get::<CallAsHost>(b"call_as_host").unwrap()(self.host, call, self.component, &mut status)
        };
        (back, status)
    }

    /// The last message, expanded as by printf.
    fn text(&self) -> String {
        type Text = extern "C" fn(*const c_void) -> *const c_char;
        let text = unsafe { CStr::from_ptr(self.library.get::<Text>(b"text").unwrap()(self.host)) };
        text.to_string_lossy().into_owned()
    }

    fn number(&self, of: &[u8]) -> c_int {
        unsafe { self.library.get::<extern "C" fn(*const c_void) -> c_int>(of).unwrap()(self.host) }
    }

    fn bytes(&self) -> Vec<u8> {
        let (c, mut state, mut size) = (self.component, std::ptr::null_mut(), 0);
        unsafe {
            assert_eq!(fmi2GetFMUstate(c, &mut state), OK);
            assert_eq!(fmi2SerializedFMUstateSize(c, state, &mut size), OK);
            let mut bytes = vec![0_u8; size];
            assert_eq!(fmi2SerializeFMUstate(c, state, bytes.as_mut_ptr().cast(), size), OK);
            assert_eq!(fmi2FreeFMUstate(c, &mut state), OK);
            bytes
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        unsafe {
            fmi2FreeInstance(self.component);
            self.library.get::<extern "C" fn(*mut c_void)>(b"free_host").unwrap()(self.host);
        }
    }
}

/// The first state, by the call that a host makes from its logger.
unsafe extern "C-unwind" fn get(c: Component) -> c_int {
    let mut value = f64::NAN;
    let status = unsafe { fmi2GetReal(c, OUTPUT.get().unwrap(), 1, &mut value) };
    assert!(value.is_finite());
    status as c_int
}

/// Value reference of the plant's output, found before a host has set a state of its own.
static OUTPUT: OnceLock<u32> = OnceLock::new();

unsafe extern "C-unwind" fn refused_step(c: Component) -> c_int {
    unsafe { fmi2DoStep(c, 5.0, 0.1, TRUE) as c_int }
}

unsafe extern "C-unwind" fn refused_value(c: Component) -> c_int {
    unsafe { fmi2SetReal(c, &1_000_000, 1, &f64::NAN) as c_int }
}

unsafe extern "C-unwind" fn unknown_category(c: Component) -> c_int {
    unsafe { fmi2SetDebugLogging(c, TRUE, 1, &c"100% %s%n".as_ptr()) as c_int }
}

unsafe extern "C-unwind" fn step(c: Component) -> c_int {
    unsafe { fmi2DoStep(c, 0.0, 0.1, TRUE) as c_int }
}

#[test]
fn an_exception_of_the_logger_comes_back_to_the_host_and_the_instance_goes_on() {
    let host = Host::new();
    host.start();
    let before = host.bytes();
    for call in [refused_step as Call, refused_value, unknown_category] {
        assert_eq!(host.call(THROW, call), (THROWN, -1));
        assert_eq!((host.number(b"messages"), host.bytes() == before), (1, true), "{}", host.text());
        assert_eq!(host.call(NOTHING, call), (RETURNED, ERROR as c_int));
    }
    assert_eq!(host.call(NOTHING, step), (RETURNED, OK as c_int));
}

#[test]
fn an_exception_while_an_instance_is_made_comes_back_too() {
    unsafe extern "C-unwind" fn make(host: Component) -> c_int {
        let host = unsafe { &*host.cast::<Host>() };
        c_int::from(!host.instantiate("{another}").is_null())
    }
    type Tell = extern "C" fn(*mut c_void, c_int, Component, Call);
    type CallAsHost = extern "C" fn(*mut c_void, Call, Component, *mut c_int) -> c_int;
    let (host, mut status) = (Host::new(), -1);
    let back = unsafe {
        host.library.get::<Tell>(b"tell_host").unwrap()(host.host, THROW, host.component, get);
        let this = std::ptr::from_ref(&host).cast_mut().cast();
        host.library.get::<CallAsHost>(b"call_as_host").unwrap()(host.host, make, this, &mut status)
    };
    assert_eq!((back, status), (THROWN, -1));
    assert!(host.text().contains("GUID"), "{}", host.text());
}

#[test]
fn a_jump_out_of_the_logger_leaves_an_instance_that_goes_on() {
    let host = Host::new();
    host.start();
    let before = host.bytes();
    for call in [refused_step as Call, refused_value, unknown_category] {
        assert_eq!(host.call(JUMP, call), (JUMPED, -1));
        assert!(host.bytes() == before);
    }
    assert_eq!(host.call(NOTHING, step), (RETURNED, OK as c_int));
}

#[test]
fn an_instance_can_be_read_from_its_logger() {
    let host = Host::new();
    host.start();
    assert_eq!(host.call(GET, refused_step), (RETURNED, ERROR as c_int));
    assert_eq!((host.number(b"messages"), host.number(b"answer")), (1, OK as c_int));
    assert_eq!(host.call(NOTHING, step), (RETURNED, OK as c_int));
}

#[test]
fn a_message_that_a_host_expands_shows_percent_signs_as_they_are() {
    let host = Host::new();
    assert_eq!(host.call(NOTHING, unknown_category), (RETURNED, ERROR as c_int));
    assert!(host.text().contains("no category `100% %s%n`"), "{}", host.text());
}

/// The floating-point state of the host comes back with its exception, and after its jump.
#[cfg(target_arch = "x86_64")]
#[test]
fn the_floating_point_state_is_the_hosts_own_after_an_exception_and_a_jump() {
    use std::arch::asm;
    const ROUND_DOWN: u32 = 0x3f80;
    const DEFAULT: u32 = 0x1f80;
    let (host, mut left) = (Host::new(), 0_u32);
    host.start();
    for (what, back) in [(THROW, THROWN), (JUMP, JUMPED), (GET, RETURNED)] {
        unsafe { asm!("ldmxcsr [{}]", in(reg) &ROUND_DOWN) };
        let came = host.call(what, refused_step).0;
        unsafe {
            asm!("stmxcsr [{}]", in(reg) &raw mut left);
            asm!("ldmxcsr [{}]", in(reg) &DEFAULT);
        }
        assert_eq!((came, left), (back, ROUND_DOWN));
    }
}
