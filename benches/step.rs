//! Cost of a communication step through the C interface, against a hand-written C unit in the same run.
//!
//! Ours integrates with error control, checks every argument and every value, and can be saved and restored; the C
//! unit takes one forward Euler step. The error of both is printed beside.

use std::ffi::{CString, c_int, c_void};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;

use adaptive_fmu::fmi2::build::{Library, SOURCE};
use adaptive_fmu::fmi2::types::{CO_SIMULATION, CallbackFunctions, Component, FALSE, Status};
use adaptive_fmu::fmi2::{access::References, interface, model_description};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::*;
use criterion::{Criterion, criterion_group, criterion_main};

/// Van der Pol's oscillator, as a user would write it.
struct VanDerPol {
    mu: ScalarOf<Parameter>,
    x0: VectorOf<Parameter>,
    x: VectorOf<State>,
}

impl System for VanDerPol {
    type Structure = NoStructure;
    const NAME: &'static str = "van-der-pol";
    const DOCUMENTATION: &'static str = "Van der Pol oscillator.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(VanDerPol {
            mu: d.parameter(scalar("mu", "damping").start(1.0)),
            x0: d.parameter(vector("x0", 2, "initial state").starts(&[2.0, 0.0]).fixed()),
            x: d.state(vector("x", 2, "state").output()),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        dx.set(self.x, [x2, v[self.mu] * (-x1 * x1 + 1.0) * x2 - x1]);
    }
}

static REGISTRY: Registry = &[Kind::of::<VanDerPol>()];
const DESCRIPTION: &str = "name = 'VanDerPol'\nmodel = 'van-der-pol'\ndescription = 'Van der Pol oscillator'\n";

/// Our unit, behind the functions that a master calls.
struct Unit {
    component: Component,
    references: [u32; 2],
    time: f64,
}

impl Unit {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), DESCRIPTION).unwrap();
        let model = Model::from_description(Description::read(DESCRIPTION).unwrap(), REGISTRY).unwrap();
        let reference = |name| References::of(model.variables(), model.variables().find(name).unwrap());
        let references = [reference("x[1]"), reference("x[2]")];
        let guid = CString::new(model_description::guid_text(model_description::guid(&model))).unwrap();
        let location = CString::new(format!("file://{}", folder.path().display())).unwrap();
        let callbacks = CallbackFunctions {
            logger: None,
            allocate_memory: None,
            free_memory: None,
            step_finished: None,
            component_environment: std::ptr::null_mut(),
        };
        let (guid, location) = (guid.as_ptr(), location.as_ptr());
        let component = unsafe {
            let name = c"unit".as_ptr();
            let library = Library { registry: REGISTRY, source: SOURCE, build: &[] };
            interface::instantiate(library, name, CO_SIMULATION, guid, location, &callbacks, FALSE, FALSE)
        };
        assert!(!component.is_null());
        assert_eq!(interface::setup_experiment(component, FALSE, 0.0, 0.0, FALSE, 0.0), Status::Ok);
        assert_eq!(interface::enter_initialization_mode(component), Status::Ok);
        assert_eq!(interface::exit_initialization_mode(component), Status::Ok);
        Unit { component, references, time: 0.0 }
    }

    fn step(&mut self, h: f64) -> [f64; 2] {
        let mut x = [0.0; 2];
        assert_eq!(interface::do_step(self.component, self.time, h), Status::Ok);
        self.time += h;
        let got = unsafe { interface::get_real(self.component, self.references.as_ptr(), 2, x.as_mut_ptr()) };
        assert_eq!(got, Status::Ok);
        x
    }
}

impl Drop for Unit {
    fn drop(&mut self) {
        unsafe { interface::free_instance(self.component) }
    }
}

/// The C unit.
struct Peer {
    library: libloading::Library,
    component: *mut c_void,
    time: f64,
}

impl Peer {
    /// Compiles it, with an Euler step of this size; `None` where there is no C compiler.
    fn compile(h: f64) -> Option<PathBuf> {
        let source = common::at_top("benches/van_der_pol.c");
        let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("van_der_pol_{h}.so"));
        let mut compiler = Command::new("cc");
        let compiler = compiler.args(["-O2", "-shared", "-fPIC", "-o"]).arg(&library).arg(source);
        let compiler = compiler.arg(format!("-DSTEP={h}")).arg("-lm");
        compiler.status().is_ok_and(|status| status.success()).then_some(library)
    }

    fn new(path: &Path) -> Self {
        type Text = *const std::ffi::c_char;
        type Instantiate = unsafe extern "C" fn(Text, c_int, Text, Text, *const c_void, c_int, c_int) -> *mut c_void;
        let library = unsafe { libloading::Library::new(path) }.unwrap();
        let null = std::ptr::null();
        let component = unsafe {
            let instantiate = library.get::<Instantiate>(b"fmi2Instantiate").unwrap();
            let exit = library.get::<unsafe extern "C" fn(*mut c_void) -> c_int>(b"fmi2ExitInitializationMode");
            let component = instantiate(c"unit".as_ptr(), CO_SIMULATION, null, null, null.cast(), 0, 0);
            assert_eq!(exit.unwrap()(component), 0);
            component
        };
        Peer { library, component, time: 0.0 }
    }

    fn stepper(&mut self) -> impl FnMut(f64) -> [f64; 2] {
        type Step = unsafe extern "C" fn(*mut c_void, f64, f64, c_int) -> c_int;
        type Get = unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut f64) -> c_int;
        let step = unsafe { *self.library.get::<Step>(b"fmi2DoStep").unwrap() };
        let get = unsafe { *self.library.get::<Get>(b"fmi2GetReal").unwrap() };
        move |h| {
            let (mut x, references) = ([0.0; 2], [1, 3]);
            unsafe {
                assert_eq!(step(self.component, self.time, h, 1), 0);
                assert_eq!(get(self.component, references.as_ptr(), 2, x.as_mut_ptr()), 0);
            }
            self.time += h;
            x
        }
    }
}

/// The state at 10 s, by many small Runge–Kutta steps.
fn reference_at_10s() -> [f64; 2] {
    let f = |x: [f64; 2]| [x[1], (1.0 - x[0] * x[0]) * x[1] - x[0]];
    let mut x = [2.0, 0.0];
    let h = 1e-4;
    for _ in 0..100_000 {
        let along = |k: [f64; 2], part: f64| [x[0] + part * h * k[0], x[1] + part * h * k[1]];
        let k1 = f(x);
        let k2 = f(along(k1, 0.5));
        let k3 = f(along(k2, 0.5));
        let k4 = f(along(k3, 1.0));
        x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    x
}

fn error_at_10s(h: f64, mut step: impl FnMut(f64) -> [f64; 2]) -> f64 {
    let x = (0..(10.0 / h).round() as usize).map(|_| step(h)).last().unwrap();
    let exact = reference_at_10s();
    (x[0] - exact[0]).abs().max((x[1] - exact[1]).abs())
}

fn van_der_pol(criterion: &mut Criterion) {
    for h in [1e-2, 1e-3] {
        let mut group = criterion.benchmark_group(format!("Van der Pol, step {} ms", h * 1e3));
        let mut unit = Unit::new();
        println!("error at 10 s: ours {:.1e}", error_at_10s(h, |h| unit.step(h)));
        group.bench_function("adaptive-fmu", |bencher| bencher.iter(|| black_box(unit.step(black_box(h)))));
        if let Some(library) = Peer::compile(h) {
            let mut peer = Peer::new(&library);
            println!("error at 10 s: C with one Euler step {:.1e}", error_at_10s(h, peer.stepper()));
            let mut step = peer.stepper();
            group.bench_function("C, one Euler step", |bencher| bencher.iter(|| black_box(step(black_box(h)))));
        } else {
            println!("the C peer is skipped: there is no C compiler `cc`");
        }
        group.finish();
    }
}

criterion_group!(benches, van_der_pol);
criterion_main!(benches);
