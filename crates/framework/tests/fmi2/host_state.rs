//! The floating-point state of the host is its own: a unit computes the same bits in any, and leaves it as it was.
#![cfg(target_arch = "x86_64")]

use std::arch::asm;
use std::cell::RefCell;
use std::ffi::CString;

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::fmi2::build::Library;
use adaptive_fmu::fmi2::interface;
use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::{REGISTRY, SOURCE};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi2_functions::*;
use common::{OK, description, description_names, guid};

const STEPS: i32 = 20;
/// Library of the exported functions, whose FMUs are compared with those of the others.
const LIBRARY: Library = Library { registry: REGISTRY, source: SOURCE, build: &[] };

/// Control and flags of SSE, and control of the x87 unit.
#[derive(Debug, Clone, Copy, PartialEq)]
struct HostState {
    mxcsr: u32,
    x87: u16,
}

const DEFAULT: HostState = HostState { mxcsr: 0x1f80, x87: 0x37f };
/// Invalid operations, divisions by zero and overflows end the host.
const TRAPPING: HostState =
    HostState { mxcsr: 0x1f80 & !(1 << 7 | 1 << 9 | 1 << 10), x87: 0x37f & !(1 | 1 << 2 | 1 << 3) };
const OTHERS: [(&str, HostState); 6] = [
    ("rounds down", HostState { mxcsr: 0x3f80, x87: 0x77f }),
    ("rounds up", HostState { mxcsr: 0x5f80, x87: 0xb7f }),
    ("rounds toward zero", HostState { mxcsr: 0x7f80, x87: 0xf7f }),
    ("flushes small numbers to zero", HostState { mxcsr: 0x1f80 | 1 << 15 | 1 << 6, x87: 0x37f }),
    ("has every flag of past exceptions", HostState { mxcsr: 0x1fbf, x87: 0x37f }),
    ("computes with 53 bits in the x87 unit, as Windows does", HostState { mxcsr: 0x1f80, x87: 0x27f }),
];

impl HostState {
    fn read() -> Self {
        let mut state = HostState { mxcsr: 0, x87: 0 };
        unsafe {
            asm!("stmxcsr [{}]", in(reg) &raw mut state.mxcsr);
            asm!("fnstcw [{}]", in(reg) &raw mut state.x87);
        }
        state
    }

    fn set(self) {
        unsafe {
            asm!("ldmxcsr [{}]", in(reg) &raw const self.mxcsr);
            asm!("fldcw [{}]", in(reg) &raw const self.x87);
        }
    }
}

/// Kind of calls: in a state of the host, or of inner functions, to check the exceptions that they raise.
#[derive(Debug, Clone, Copy)]
enum Way {
    InState(HostState),
    Inside,
}

/// A unit in one of the two interfaces, and everything that its calls gave.
struct Lifetime {
    way: Way,
    model: Model,
    component: Component,
    reals: Vec<u32>,
    inputs: Vec<u32>,
    seen: Vec<u64>,
    wrong: Vec<String>,
}

/// Exceptions that inner functions may not raise: an invalid operation, and a division by zero.
const WRONG_INSIDE: u32 = 1 | 1 << 2;

impl Lifetime {
    /// Makes one call, given as the exported function and as its inner one.
    fn call<T>(&mut self, name: &str, exported: impl FnOnce(Component) -> T, inside: impl FnOnce(Component) -> T) -> T {
        let c = self.component;
        match self.way {
            Way::InState(state) => {
                state.set();
                let answer = exported(c);
                let left = HostState::read();
                DEFAULT.set();
                if left != state {
                    self.wrong.push(format!("{name} leaves {left:x?}, not {state:x?}"));
                }
                answer
            }
            Way::Inside => {
                DEFAULT.set();
                let answer = inside(c);
                let raised = HostState::read().mxcsr & WRONG_INSIDE;
                DEFAULT.set();
                if raised != 0 {
                    self.wrong.push(format!("{name} raises {raised:#x}"));
                }
                answer
            }
        }
    }

    fn see(&mut self, status: Status, numbers: &[f64]) {
        self.seen.push(status as u64);
        self.seen.extend(numbers.iter().map(|number| number.to_bits()));
    }

    fn instantiate(name: &str, kind: i32, way: Way) -> Lifetime {
        let text = description(name);
        let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), text).unwrap();
        let [guid, place] =
            [guid(&model), format!("file://{}", folder.path().display())].map(|text| CString::new(text).unwrap());
        let (unit, guid, place) = (c"unit".as_ptr(), guid.as_ptr(), place.as_ptr());
        let callbacks = CallbackFunctions {
            logger: None,
            allocate_memory: None,
            free_memory: None,
            step_finished: None,
            component_environment: std::ptr::null_mut(),
        };
        let variables = model.variables();
        let of = |wanted: &dyn Fn(Causality) -> bool| -> Vec<u32> {
            let found = variables.visible().filter(|e| e.variable.is_real() && wanted(e.variable.causality));
            found.map(|e| References::of(variables, e)).collect()
        };
        let (reals, inputs) = (of(&|_| true), of(&|causality| causality == Causality::Input));
        let component = std::ptr::null_mut();
        let mut lifetime = Lifetime { way, component, reals, inputs, seen: Vec::new(), wrong: Vec::new(), model };
        lifetime.component = lifetime.call(
            "fmi2Instantiate",
            |_| unsafe { fmi2Instantiate(unit, kind, guid, place, &callbacks, FALSE, FALSE) },
            |_| unsafe { interface::instantiate(LIBRARY, unit, kind, guid, place, &callbacks, FALSE, FALSE) },
        );
        assert!(!lifetime.component.is_null(), "{name}, {way:x?}");
        lifetime
    }

    fn set_inputs(&mut self, k: i32) {
        let values: Vec<f64> =
            (0..self.inputs.len()).map(|i| 1e-4 * (f64::from(k) + i as f64).sin() + 1e-310).collect();
        let (vr, n, v) = (self.inputs.as_ptr(), values.len(), values.as_ptr());
        let set = self.call(
            "fmi2SetReal",
            |c| unsafe { fmi2SetReal(c, vr, n, v) },
            |c| unsafe { interface::set_real(c, vr, n, v) },
        );
        self.see(set, &[]);
    }

    fn read(&mut self) {
        let mut values = vec![0.0; self.reals.len()];
        let (vr, n, v) = (self.reals.as_ptr(), values.len(), values.as_mut_ptr());
        let got = self.call(
            "fmi2GetReal",
            |c| unsafe { fmi2GetReal(c, vr, n, v) },
            |c| unsafe { interface::get_real(c, vr, n, v) },
        );
        self.see(got, &values);
    }

    fn start(&mut self) {
        let setup = self.call(
            "fmi2SetupExperiment",
            |c| unsafe { fmi2SetupExperiment(c, TRUE, 1e-7, 0.0, FALSE, 0.0) },
            |c| interface::setup_experiment(c, TRUE, 1e-7, 0.0, FALSE, 0.0),
        );
        self.see(setup, &[]);
        let entered = self.call(
            "fmi2EnterInitializationMode",
            |c| unsafe { fmi2EnterInitializationMode(c) },
            interface::enter_initialization_mode,
        );
        self.see(entered, &[]);
        self.set_inputs(0);
        self.read();
        let left = self.call(
            "fmi2ExitInitializationMode",
            |c| unsafe { fmi2ExitInitializationMode(c) },
            interface::exit_initialization_mode,
        );
        self.see(left, &[]);
    }

    fn steps(&mut self) {
        let step = self.model.description().experiment.step;
        for k in 0..STEPS {
            self.set_inputs(k);
            let point = f64::from(k) * step;
            let stepped = self.call(
                "fmi2DoStep",
                |c| unsafe { fmi2DoStep(c, point, step, TRUE) },
                |c| interface::do_step(c, point, step),
            );
            self.see(stepped, &[]);
            self.read();
        }
    }

    fn exchange(&mut self) {
        let h = 1e-3 * self.model.description().experiment.step;
        let (n, m) = (self.model.variables().states(), self.model.variables().indicators().len());
        let (mut x, mut dx, mut z) = (vec![0.0; n], vec![0.0; n], vec![0.0; m]);
        for k in 0..STEPS {
            if k % 10 == 0 {
                self.event(k > 0);
            }
            self.set_inputs(k);
            let time = f64::from(k) * h;
            let set = self.call("fmi2SetTime", |c| unsafe { fmi2SetTime(c, time) }, |c| interface::set_time(c, time));
            self.see(set, &[]);
            let (px, pdx, pz) = (x.as_mut_ptr(), dx.as_mut_ptr(), z.as_mut_ptr());
            let got = self.call(
                "fmi2GetContinuousStates",
                |c| unsafe { fmi2GetContinuousStates(c, px, n) },
                |c| unsafe { interface::get_continuous_states(c, px, n) },
            );
            self.see(got, &x);
            let got = self.call(
                "fmi2GetDerivatives",
                |c| unsafe { fmi2GetDerivatives(c, pdx, n) },
                |c| unsafe { interface::get_derivatives(c, pdx, n) },
            );
            self.see(got, &dx);
            x.iter_mut().zip(&dx).for_each(|(x, dx)| *x += h * dx);
            let px = x.as_ptr();
            let set = self.call(
                "fmi2SetContinuousStates",
                |c| unsafe { fmi2SetContinuousStates(c, px, n) },
                |c| unsafe { interface::set_continuous_states(c, px, n) },
            );
            self.see(set, &[]);
            let got = self.call(
                "fmi2GetEventIndicators",
                |c| unsafe { fmi2GetEventIndicators(c, pz, m) },
                |c| unsafe { interface::get_event_indicators(c, pz, m) },
            );
            self.see(got, &z);
            let (mut enter, mut end) = (0, 0);
            let (enter, end) = (&raw mut enter, &raw mut end);
            let completed = self.call(
                "fmi2CompletedIntegratorStep",
                |c| unsafe { fmi2CompletedIntegratorStep(c, TRUE, enter, end) },
                |c| unsafe { interface::completed_integrator_step(c, enter, end) },
            );
            self.see(completed, &[]);
            self.read();
        }
    }

    fn event(&mut self, enter: bool) {
        if enter {
            let entered =
                self.call("fmi2EnterEventMode", |c| unsafe { fmi2EnterEventMode(c) }, interface::enter_event_mode);
            self.see(entered, &[]);
        }
        let mut info = EventInfo {
            new_discrete_states_needed: TRUE,
            terminate_simulation: FALSE,
            nominals_changed: FALSE,
            values_changed: FALSE,
            next_event_time_defined: FALSE,
            next_event_time: 0.0,
        };
        while info.new_discrete_states_needed != FALSE {
            info.new_discrete_states_needed = FALSE;
            let pointer = &raw mut info;
            let updated = self.call(
                "fmi2NewDiscreteStates",
                |c| unsafe { fmi2NewDiscreteStates(c, pointer) },
                |c| unsafe { interface::new_discrete_states(c, pointer) },
            );
            self.see(updated, &[info.next_event_time]);
        }
        let entered = self.call(
            "fmi2EnterContinuousTimeMode",
            |c| unsafe { fmi2EnterContinuousTimeMode(c) },
            interface::enter_continuous_time_mode,
        );
        self.see(entered, &[]);
    }

    fn end(&mut self) {
        let mut state = std::ptr::null_mut();
        let place = &raw mut state;
        let saved = self.call(
            "fmi2GetFMUstate",
            |c| unsafe { fmi2GetFMUstate(c, place) },
            |c| unsafe { interface::get_fmu_state(c, place) },
        );
        let restored = self.call(
            "fmi2SetFMUstate",
            |c| unsafe { fmi2SetFMUstate(c, state) },
            |c| interface::set_fmu_state(c, state),
        );
        let terminated = self.call("fmi2Terminate", |c| unsafe { fmi2Terminate(c) }, interface::terminate);
        let refused = self.call(
            "a call of fmi2DoStep that is refused",
            |c| unsafe { fmi2DoStep(c, f64::NAN, f64::INFINITY, TRUE) },
            |c| interface::do_step(c, f64::NAN, f64::INFINITY),
        );
        [saved, restored, terminated, refused].into_iter().for_each(|status| self.see(status, &[]));
        self.call("fmi2FreeInstance", |c| unsafe { fmi2FreeInstance(c) }, |c| unsafe { interface::free_instance(c) });
    }
}

/// Lifetime from instantiation to the end.
fn run_lifetime(name: &str, kind: i32, way: Way) -> Lifetime {
    let mut lifetime = Lifetime::instantiate(name, kind, way);
    lifetime.start();
    if kind == CO_SIMULATION {
        lifetime.steps()
    } else {
        lifetime.exchange()
    }
    lifetime.end();
    assert!(lifetime.seen.iter().filter(|seen| **seen == OK as u64).count() > 50, "{name} runs: {:?}", lifetime.seen);
    lifetime
}

fn answers(name: &str, kind: i32, way: Way) -> Vec<u64> {
    let lifetime = run_lifetime(name, kind, way);
    assert!(lifetime.wrong.is_empty(), "{name}, interface {kind}, {way:x?}: {:#?}", lifetime.wrong);
    lifetime.seen
}

fn every_unit(check: impl Fn(&str, i32)) {
    for name in description_names() {
        [CO_SIMULATION, MODEL_EXCHANGE].into_iter().for_each(|kind| check(&name, kind));
    }
}

#[test]
fn every_unit_computes_the_same_bits_in_any_state_of_the_host_and_leaves_it_as_it_was() {
    every_unit(|name, kind| {
        let usual = answers(name, kind, Way::InState(DEFAULT));
        for (host, state) in OTHERS {
            assert!(answers(name, kind, Way::InState(state)) == usual, "{name} in a host that {host}");
        }
    });
}

/// Test for a process of its own, which an exception would end; the next test starts it.
#[test]
#[ignore = "run by the next test"]
fn every_unit_in_a_trapping_host() {
    every_unit(|name, kind| {
        let usual = answers(name, kind, Way::InState(DEFAULT));
        assert!(answers(name, kind, Way::InState(TRAPPING)) == usual, "{name}");
    });
}

#[test]
fn every_unit_runs_in_a_host_that_traps_invalid_operations_divisions_by_zero_and_overflows() {
    let host = std::env::current_exe().unwrap();
    let options = ["--exact", "host_state::every_unit_in_a_trapping_host", "--ignored", "--nocapture"];
    let done = std::process::Command::new(host).args(options).output().unwrap();
    let [out, errors] = [done.stdout, done.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(done.status.success() && out.contains("1 passed"), "{:?}: {out}{errors}", done.status);
}

/// The state that it sets does trap: else the tests above would pass with anything.
#[test]
#[ignore = "ends its process; run by the next test"]
fn a_division_of_zero_by_zero_in_a_trapping_host() {
    let (zero, mut quotient) = (std::hint::black_box(0.0_f64), 0.0);
    TRAPPING.set();
    unsafe {
        asm!("divsd {0}, {1}", "movsd [{2}], {0}", inout(xmm_reg) zero => _, in(xmm_reg) zero, in(reg) &raw mut quotient)
    };
    DEFAULT.set();
}

#[test]
fn a_trapping_host_is_ended_by_a_division_of_zero_by_zero() {
    let host = std::env::current_exe().unwrap();
    let options = ["--exact", "host_state::a_division_of_zero_by_zero_in_a_trapping_host", "--ignored"];
    let done = std::process::Command::new(host).args(options).output().unwrap();
    assert!(!done.status.success() && done.status.code().is_none(), "{:?}", done.status);
}

/// C sources of a unit have no guard around them.
#[test]
fn no_unit_has_an_invalid_operation_or_a_division_by_zero_inside() {
    let wrong = RefCell::new(Vec::new());
    every_unit(|name, kind| {
        let mut found = run_lifetime(name, kind, Way::Inside).wrong;
        found.dedup();
        wrong.borrow_mut().extend(found.into_iter().map(|what| format!("{name}, interface {kind}: {what}")));
    });
    assert!(wrong.borrow().is_empty(), "{:#?}", wrong.borrow());
}

#[test]
fn a_call_without_an_instance_leaves_the_state_too() {
    for (_, state) in OTHERS {
        state.set();
        let answers = unsafe { (fmi2DoStep(std::ptr::null_mut(), 0.0, 1.0, TRUE), fmi2GetVersion().is_null()) };
        let left = HostState::read();
        DEFAULT.set();
        assert_eq!((left, answers), (state, (Status::Error, false)));
    }
}
