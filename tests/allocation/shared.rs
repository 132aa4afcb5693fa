//! Instances of one unit share its declarations and names; each has its values only.

use std::cell::RefCell;
use std::thread;

use adaptive_fmu::fmi2::types::CO_SIMULATION;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Section;
use adaptive_fmu_library::fmi2_functions::fmi2FreeInstance;
use common::{Request, Unit, callbacks, description, description_names, guid};

use crate::BYTES;

/// An instance may hold so many bytes beside its values and the integrator's matrices.
const OVERHEAD: isize = 6000;
/// So often it may hold its values: as they are, as before the step, and with their derivatives, in one direction and in
/// eight at a time.
const COPIES: isize = 13;
/// So many matrices and vectors of the states' size the integrator may hold.
const MATRICES: isize = 8;
const VECTORS: isize = 50;

#[test]
fn a_further_instance_holds_little_more_than_its_values() {
    let log = RefCell::default();
    for name in description_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), description(&name)).unwrap();
        let request = Request {
            registry: REGISTRY,
            name: Some(name.clone()),
            kind: CO_SIMULATION,
            guid: Some(guid(&model)),
            location: Some(format!("file://{}", folder.path().display())),
        };
        let callbacks = callbacks(&log);
        let (first, before) = (request.make(&callbacks), BYTES.get());
        let (further, held) = (request.make(&callbacks), BYTES.get() - before);
        let states = model.variables().reals(Section::State).len() as isize;
        let values = model.start().reals.len() as isize;
        let most = OVERHEAD + 8 * (COPIES * values + VECTORS * states + MATRICES * states * states);
        println!("{name:28} {states:4} states {values:5} values {held:8} bytes of {most:8}");
        assert!(!first.is_null() && !further.is_null() && held > 8 * values, "{name}");
        assert!(held < most, "{name}: {held} bytes");
        unsafe {
            fmi2FreeInstance(first);
            fmi2FreeInstance(further);
        }
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
