//! What each FMU costs through the functions that a master calls: a communication step (inputs set, step, outputs read)
//! and the life of an instance (instantiated, initialised, terminated, freed).
//!
//! A step is 1 ms, one of the first hundred from the start, all inputs held at a twentieth of their nominal values. A
//! law that no step can follow with these has gentle gains and a wide funnel.

use std::cell::RefCell;
use std::hint::black_box;
use std::time::{Duration, Instant};

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::fmi2::interface;
use adaptive_fmu::fmi2::types::{CO_SIMULATION, FmuState};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Causality;
use common::{OK, Request, Unit, callbacks, description, description_names, guid};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const STEP: f64 = 1e-3;
const COUNT: usize = 100;

/// A unit with what is set and read in each of its steps.
struct Stepped {
    unit: Unit,
    inputs: Vec<u32>,
    set: Vec<f64>,
    outputs: Vec<u32>,
    read: Vec<f64>,
    /// As it stands at the start.
    begin: FmuState,
}

impl Stepped {
    fn new(name: &str, gentle: bool) -> Self {
        let unit = Unit::new(name);
        let ports = |causality| {
            let reals = unit.model.variables().visible().filter(|element| element.variable.is_real());
            reals.filter(move |element| element.variable.causality == causality)
        };
        let reference = |element| References::of(unit.model.variables(), element);
        let inputs = ports(Causality::Input).map(reference).collect();
        let set = ports(Causality::Input).map(|element| 0.05 * element.nominal()).collect();
        let outputs: Vec<_> = ports(Causality::Output).map(reference).collect();
        if gentle {
            unit.try_with(|trial| trial.alone);
            unit.soften();
        }
        unit.start(0.0);
        let mut begin = std::ptr::null_mut();
        assert_eq!(unsafe { interface::get_fmu_state(unit.component, &mut begin) }, OK);
        Stepped { read: vec![0.0; outputs.len()], unit, inputs, set, outputs, begin }
    }

    /// Takes all steps, from the start; whether they could be taken.
    fn steps(&mut self) -> bool {
        let mut time = 0.0;
        (0..COUNT).all(|_| {
            let given = self.unit.set_reals(&self.inputs, &self.set) == OK;
            let stepped = given && interface::do_step(self.unit.component, time, STEP) == OK;
            time += STEP;
            stepped && self.unit.get_reals(&self.outputs, &mut self.read) == OK
        })
    }

    /// How long all steps take from the start, so many times over.
    fn measure(&mut self, times: u64) -> Duration {
        let mut took = Duration::ZERO;
        for _ in 0..times {
            assert_eq!(interface::set_fmu_state(self.unit.component, self.begin), OK);
            let begun = Instant::now();
            assert!(black_box(self.steps()));
            took += begun.elapsed();
        }
        took
    }
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.throughput(Throughput::Elements(COUNT as u64)).sample_size(10);
    group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(500));
    for name in description_names() {
        let gentle = !Stepped::new(&name, false).steps();
        let mut stepped = Stepped::new(&name, gentle);
        let label = if gentle { format!("{name}, wide funnel") } else { name };
        group.bench_function(label, |bencher| bencher.iter_custom(|times| stepped.measure(times)));
    }
    group.finish();
}

fn lifetimes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("life");
    group.sample_size(10).warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(300));
    let log = RefCell::new(Vec::new());
    let callbacks = callbacks(&log);
    for name in description_names() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), description(&name)).unwrap();
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let location = Some(format!("file://{}", folder.path().display()));
        let (kind, guid) = (CO_SIMULATION, Some(guid(&model)));
        let request = Request { registry: REGISTRY, name: Some("unit".to_owned()), kind, guid, location };
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let component = request.make(&callbacks);
                assert_eq!(interface::setup_experiment(component, 0, 0.0, 0.0, 0, 0.0), OK);
                assert_eq!(interface::enter_initialization_mode(component), OK);
                assert_eq!(interface::exit_initialization_mode(component), OK);
                assert_eq!(interface::terminate(component), OK);
                unsafe { interface::free_instance(component) }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, steps, lifetimes);
criterion_main!(benches);
