//! Instances of one unit share its declarations and names; each has its values only.

use std::cell::RefCell;
use std::path::Path;
use std::sync::Barrier;
use std::thread;

use adaptive_fmu::fmi2::interface;
use adaptive_fmu::fmi2::types::CO_SIMULATION;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::{Causality, Section};
use adaptive_fmu_library::fmi2_functions::fmi2FreeInstance;
use common::described::open_description;
use common::{OK, Request, Unit, callbacks, description, description_names, guid};

use crate::{BYTES, COUNT};

/// Largest size of an instance in bytes without its values, and in all; docs/internals.md states them.
const OVERHEAD: isize = 3000;
const MOST: isize = 11_200;
/// Number of copies of the values in a thread's working memory: as before the step, and with their derivatives in eight
/// directions; a few more with the evaluated ones.
const COPIES: isize = 12;
/// The most matrices and vectors of the states' size in the integrator.
const MATRICES: isize = 8;
const VECTORS: isize = 50;

/// Request for instances of an FMU whose resources are in a folder.
fn request(name: &str, folder: &Path) -> Request {
    let model = Model::from_description(Description::read(&description(name)).unwrap(), REGISTRY).unwrap();
    // Instances share by their descriptions, so those of other tests have different ones.
    let text = format!("{}\n# Of {}.\n", description(name), folder.display());
    std::fs::write(folder.join("description.toml"), text).unwrap();
    Request {
        registry: REGISTRY,
        name: Some(name.to_owned()),
        kind: CO_SIMULATION,
        guid: Some(guid(&model)),
        location: Some(format!("file://{}", folder.display())),
    }
}

#[test]
fn a_further_instance_holds_little_more_than_its_values() {
    assert!(std::fs::read_to_string(common::at_top("docs/internals.md")).unwrap().contains("at most 11.2 kB"));
    let log = RefCell::default();
    let callbacks = callbacks(&log);
    for name in description_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let request = request(&name, folder.path());
        let make = || {
            let before = BYTES.get();
            let component = request.make(&callbacks);
            assert!(!component.is_null(), "{name}");
            assert_eq!(interface::setup_experiment(component, 0, 0.0, 0.0, 0, 0.0), OK);
            assert_eq!(interface::enter_initialization_mode(component), OK);
            assert_eq!(interface::exit_initialization_mode(component), OK);
            (component, BYTES.get() - before)
        };
        // The second brings what those behind it work with, too.
        let [(first, _), (second, shared), (third, bytes)] = [make(), make(), make()];
        let states = model.variables().reals(Section::State).len() as isize;
        let (values, integers) = (model.start().reals.len() as isize, model.start().integers.len() as isize);
        let own = OVERHEAD + 8 * values + 4 * integers;
        let with_shared = own + 8 * (COPIES * values + VECTORS * states + MATRICES * states * states);
        println!(
            "{name:28} {states:4} states {values:5} values {bytes:6} bytes of {own:6}, {shared:8} of {with_shared:8}"
        );
        assert!(bytes > 8 * values && bytes <= own.min(MOST), "{name}: {bytes} bytes");
        assert!(shared <= with_shared, "{name}: {shared} bytes with what is shared");
        [first, second, third].into_iter().for_each(|component| unsafe { fmi2FreeInstance(component) });
    }
}

#[test]
fn a_thread_has_its_working_memory_still_after_others_have_made_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let request = request("L1TwoLinkRobot", folder.path());
    let make = || {
        let log: &'static RefCell<_> = Box::leak(Box::default());
        let callbacks = Box::leak(Box::new(callbacks(log)));
        let before = BYTES.get();
        let component = request.make(callbacks);
        assert_eq!(interface::enter_initialization_mode(component), OK);
        assert_eq!(interface::exit_initialization_mode(component), OK);
        (component.expose_provenance(), BYTES.get() - before)
    };
    let [(first, _), (second, shared)] = [make(), make()];
    let (other, of_other) = thread::scope(|scope| scope.spawn(make).join().unwrap());
    let (third, bytes) = make();
    assert!(of_other > MOST && shared > MOST && bytes <= MOST, "{shared}, {of_other}, {bytes} bytes");
    for component in [first, second, other, third] {
        unsafe { fmi2FreeInstance(std::ptr::with_exposed_provenance_mut(component)) };
    }
}

/// The most allocations in the lifetime of an instance, if its FMU has been in use.
const OF_A_LIFETIME: usize = 100;

#[test]
fn a_unit_that_was_in_use_is_not_made_anew() {
    let log = RefCell::default();
    let callbacks = callbacks(&log);
    for name in description_names() {
        let folder = tempfile::tempdir().unwrap();
        let request = request(&name, folder.path());
        let lifetime = || {
            let before = COUNT.get();
            let component = request.make(&callbacks);
            assert_eq!(interface::enter_initialization_mode(component), OK);
            assert_eq!(interface::exit_initialization_mode(component), OK);
            unsafe { fmi2FreeInstance(component) }
            COUNT.get() - before
        };
        // Units of other tests, which run at the same time, may take its place in between.
        let counts: Vec<usize> = (0..10).map(|_| lifetime()).collect();
        println!("{name:28} {counts:?}");
        assert!(counts[1..].iter().any(|&count| count < OF_A_LIFETIME), "{name}: {counts:?}");
    }
}

/// A unit with its inputs, and what it is read by.
struct Fed {
    unit: Unit,
    inputs: Vec<u32>,
    all: Vec<u32>,
    step: f64,
}

impl Fed {
    /// An instance that is integrated by a method, where there is a choice.
    fn new(name: &str, method: i32) -> Self {
        let unit = Unit::from_text(&open_description(name));
        if unit.model.variables().find("integration_method").is_some() {
            assert_eq!(unit.set_integer("integration_method", method), OK);
        }
        unit.start(0.0);
        let reals = |wanted: fn(Causality) -> bool| {
            let visible = unit.model.variables().visible();
            let reals = visible.filter(|element| element.variable.is_real() && wanted(element.variable.causality));
            reals.map(|element| unit.reference(&element.name())).collect()
        };
        let (inputs, all) = (reals(|causality| causality == Causality::Input), reals(|_| true));
        Fed { inputs, all, step: unit.model.description().experiment.step, unit }
    }

    /// Takes the step of a number, with inputs of a size: all values behind it, by their bits.
    fn step(&self, k: usize, size: f64) -> Vec<u64> {
        let set: Vec<f64> = (0..self.inputs.len()).map(|i| size * ((k + i) as f64).sin()).collect();
        let mut got = vec![0.0; self.all.len()];
        assert_eq!(self.unit.set_reals(&self.inputs, &set), OK);
        assert_eq!(self.unit.step(k as f64 * self.step, self.step), OK);
        assert_eq!(self.unit.get_reals(&self.all, &mut got), OK);
        got.into_iter().map(f64::to_bits).collect()
    }
}

#[test]
fn instances_that_work_at_one_place_don_t_feel_each_other() {
    for name in description_names() {
        // One that has its own place, and two that share one.
        let [alone, first, second] = [1, 1, 3].map(|method| Fed::new(&name, method));
        for k in 0..30 {
            let expected = alone.step(k, 0.01);
            let found = first.step(k, 0.01);
            assert!(found == expected, "{name}, step {k}");
            second.step(k, 0.02);
        }
    }
}

#[test]
fn threads_that_initialise_instances_step_them_at_once_without_allocation() {
    let first = Fed::new("L1TwoLinkRobot", 1);
    let expected: Vec<_> = (0..50).map(|k| first.step(k, 0.01)).collect();
    let together = Barrier::new(4);
    thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let fed = Fed::new("L1TwoLinkRobot", 1);
                together.wait();
                for (k, expected) in expected.iter().enumerate() {
                    let set: Vec<f64> = (0..fed.inputs.len()).map(|i| 0.01 * ((k + i) as f64).sin()).collect();
                    assert_eq!(fed.unit.set_reals(&fed.inputs, &set), OK);
                    let before = COUNT.get();
                    assert_eq!(fed.unit.step(k as f64 * fed.step, fed.step), OK);
                    let count = COUNT.get() - before;
                    // A warning, given once, is logged with what takes memory.
                    assert!(count == 0 || !fed.unit.messages().is_empty(), "step {k}: {count}");
                    let mut got = vec![0.0; fed.all.len()];
                    assert_eq!(fed.unit.get_reals(&fed.all, &mut got), OK);
                    assert!(got.iter().map(|value| value.to_bits()).eq(expected.iter().copied()), "step {k}");
                }
            });
        }
    });
}

#[test]
fn instances_of_a_thread_are_stepped_by_others_at_once() {
    let alone = Fed::new("L1TwoLinkRobot", 1);
    let expected: Vec<_> = (0..50).map(|k| alone.step(k, 0.01)).collect();
    let fed: Vec<_> = (0..4).map(|_| Fed::new("L1TwoLinkRobot", 1)).collect();
    thread::scope(|scope| {
        for fed in fed.into_iter().map(Moved) {
            let expected = &expected;
            scope.spawn(move || {
                let fed = fed.taken();
                for (k, expected) in expected.iter().enumerate() {
                    assert!(fed.step(k, 0.01) == *expected, "step {k}");
                }
            });
        }
    });
}

/// An instance on its way to another thread, as the standard lets a master do.
struct Moved(Fed);

unsafe impl Send for Moved {}

impl Moved {
    fn taken(self) -> Fed {
        self.0
    }
}

#[test]
fn instances_of_one_unit_don_t_feel_each_other() {
    let units: Vec<_> = (0..3).map(|_| Unit::started("Sensor")).collect();
    units[1].put("u[1]", 2.0);
    units.iter().for_each(|unit| unit.run(0.0, 10, 1e-2));
    let values: Vec<f64> = units.iter().map(|unit| unit.get("y[1]")).collect();
    assert!(values[0].to_bits() == values[2].to_bits() && values[0] != values[1], "{values:?}");
}

#[test]
fn many_threads_make_and_free_instances_of_one_unit() {
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                for _ in 0..50 {
                    let unit = Unit::started("Sensor");
                    unit.run(0.0, 1, 1e-3);
                }
            });
        }
    });
}
