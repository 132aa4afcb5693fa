//! Nothing is allocated on the path of a step of FMI 3.0: values of arrays, steps, and events at communication points.

use adaptive_fmu::fmi2::types::CO_SIMULATION;
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi3_functions::*;
use common::described::open_description;
use common::fmi3::Instance;
use common::{OK, description_names};

use crate::COUNT;

#[test]
fn a_step_with_arrays_and_events_allocates_nothing() {
    for name in description_names() {
        let instance = Instance::started(&open_description(&name), CO_SIMULATION);
        let (inputs, size) = instance.references(|causality| causality == Causality::Input);
        let (all, sizes) = instance.references(|_| true);
        let (mut set, mut got) = (vec![0.0; size], vec![0.0; sizes]);
        let (step, mut time) = (instance.model.description().experiment.step, 0.0);
        for k in 0..100 {
            let (c, before, messages) = (instance.component, COUNT.get(), instance.messages());
            set.iter_mut().enumerate().for_each(|(i, value)| *value = 0.01 * ((k + i) as f64).sin());
            unsafe {
                assert_eq!(fmi3SetFloat64(c, inputs.as_ptr(), inputs.len(), set.as_ptr(), size), OK);
                let (status, reached) = instance.step(time, step);
                assert_eq!(status, OK, "{name}");
                time = reached;
                assert_eq!(fmi3EnterEventMode(c), OK);
                assert_eq!(instance.update(), OK);
                assert_eq!(fmi3EnterStepMode(c), OK);
                assert_eq!(fmi3GetFloat64(c, all.as_ptr(), all.len(), got.as_mut_ptr(), sizes), OK);
            }
            // A warning, given once, is logged with what takes memory.
            let warned = instance.messages() > messages;
            assert!(warned || COUNT.get() == before, "{name}, step {k}: {}", COUNT.get() - before);
        }
    }
}

#[test]
fn an_instance_with_the_sizes_of_another_shares_its_declarations() {
    let text = "name = 'Plant'\nmodel = 'state-space'\ndescription = ''\n[structure]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]\n";
    let resized = |states: u64| {
        let instance = Instance::new(text, CO_SIMULATION);
        let (c, before) = (instance.component, COUNT.get());
        unsafe {
            assert_eq!(fmi3EnterConfigurationMode(c), OK);
            assert_eq!(fmi3SetUInt64(c, [0].as_ptr(), 1, [states].as_ptr(), 1), OK);
            assert_eq!(fmi3ExitConfigurationMode(c), OK);
        }
        (instance, COUNT.get() - before)
    };
    let [(_first, declared), (_second, own), (_third, other)] = [20, 20, 21].map(resized);
    // Each has its own values.
    assert!(5 * own < declared && 5 * own < other, "{declared}, {own}, {other} allocations");
}
