//! Nothing is allocated on the path of a step of FMI 3.0: values of arrays, steps, and events at communication points.

use std::cell::Cell;
use std::ffi::{CString, c_char, c_void};
use std::ptr::null;

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::fmi2::fmi3::arrays;
use adaptive_fmu::fmi2::types::{Component, Status};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi3_functions::*;
use common::described::open_description;
use common::{OK, description_names, guid};

use crate::COUNT;

/// Counts messages; the environment is the counter.
unsafe extern "C-unwind" fn log(messages: *mut c_void, _: Status, _: *const c_char, _: *const c_char) {
    let messages = unsafe { &*messages.cast::<Cell<usize>>() };
    messages.set(messages.get() + 1);
}

/// Value references of the Float64 variables of some causalities, and the number of their values.
fn references(model: &Model, wanted: impl Fn(Causality) -> bool) -> (Vec<u32>, usize) {
    let (variables, all) = (model.variables(), arrays::references(model));
    let found =
        arrays::entries(model).filter(|it| it.element.variable.is_real() && wanted(it.element.variable.causality));
    let found: Vec<_> =
        found.map(|it| (all.outer(References::of(variables, it.element)), it.elements().len())).collect();
    let size = found.iter().map(|(_, size)| size).sum();
    (found.into_iter().map(|(reference, _)| reference).collect(), size)
}

/// An initialised instance for co-simulation with Event Mode, in Step Mode.
fn started(model: &Model, folder: &str, messages: &Cell<usize>) -> Component {
    let [name, token, resources] = ["unit", &guid(model), folder].map(|text| CString::new(text).unwrap());
    unsafe {
        let (name, token, resources) = (name.as_ptr(), token.as_ptr(), resources.as_ptr());
        let (none, environment, logger) = (null(), std::ptr::from_ref(messages).cast_mut().cast(), Some(log as _));
        let c = fmi3InstantiateCoSimulation(
            name,
            token,
            resources,
            false,
            true,
            true,
            true,
            none,
            0,
            environment,
            logger,
            none.cast(),
        );
        assert!(!c.is_null(), "{}", model.description().name);
        assert_eq!(fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0), OK);
        assert_eq!(fmi3ExitInitializationMode(c), OK);
        update(c);
        c
    }
}

/// Ends an event.
unsafe fn update(c: Component) {
    let ([mut needed, mut end, mut nominals, mut values, mut defined], mut next) =
        ([true, false, false, false, false], 0.0);
    while needed {
        let answer = unsafe {
            fmi3UpdateDiscreteStates(c, &mut needed, &mut end, &mut nominals, &mut values, &mut defined, &mut next)
        };
        assert_eq!(answer, OK);
    }
    assert_eq!(unsafe { fmi3EnterStepMode(c) }, OK);
}

#[test]
fn a_step_with_arrays_and_events_allocates_nothing() {
    for name in description_names() {
        let text = format!("fmi = 3\n{}", open_description(&name));
        let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("description.toml"), &text).unwrap();
        let messages = Cell::new(0);
        let c = started(&model, &format!("{}/", folder.path().display()), &messages);
        let (inputs, size) = references(&model, |causality| causality == Causality::Input);
        let (all, sizes) = references(&model, |_| true);
        let (mut set, mut got) = (vec![0.0; size], vec![0.0; sizes]);
        let step = model.description().experiment.step;
        let ([mut event, mut end, mut early], mut time) = ([false; 3], 0.0);
        for k in 0..100 {
            let (before, said) = (COUNT.get(), messages.get());
            set.iter_mut().enumerate().for_each(|(i, value)| *value = 0.01 * ((k + i) as f64).sin());
            let point = time;
            unsafe {
                assert_eq!(fmi3SetFloat64(c, inputs.as_ptr(), inputs.len(), set.as_ptr(), size), OK);
                let flags = (&mut event, &mut end, &mut early);
                assert_eq!(fmi3DoStep(c, point, step, true, flags.0, flags.1, flags.2, &mut time), OK, "{name}");
                assert_eq!(fmi3EnterEventMode(c), OK);
                update(c);
                assert_eq!(fmi3GetFloat64(c, all.as_ptr(), all.len(), got.as_mut_ptr(), sizes), OK);
            }
            // A warning, given once, is logged with what takes memory.
            let warned = messages.get() > said;
            assert!(warned || COUNT.get() == before, "{name}, step {k}: {}", COUNT.get() - before);
        }
        unsafe { fmi3FreeInstance(c) };
    }
}
