//! A master of FMI 3.0.

use std::cell::Cell;
use std::ffi::{CString, c_char, c_void};
use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::fmi2::fmi3::arrays;
use adaptive_fmu::fmi2::types::{CO_SIMULATION, Component, Status};
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi3_functions::*;

use super::{OK, guid};

/// An instance with what it logs.
pub struct Instance {
    pub component: Component,
    pub model: Model,
    messages: Box<Cell<usize>>,
    _folder: tempfile::TempDir,
}

/// Counts messages; the environment is the counter.
unsafe extern "C-unwind" fn log(messages: *mut c_void, _: Status, _: *const c_char, _: *const c_char) {
    let messages = unsafe { &*messages.cast::<Cell<usize>>() };
    messages.set(messages.get() + 1);
}

impl Instance {
    /// An instance of a description; for co-simulation with Event Mode.
    pub fn new(description: &str, kind: i32) -> Self {
        let text = format!("fmi = 3\n{description}");
        let model = Model::from_description(Description::read(&text).unwrap(), REGISTRY).unwrap();
        let (folder, messages) = (tempfile::tempdir().unwrap(), Box::new(Cell::new(0)));
        std::fs::write(folder.path().join("description.toml"), &text).unwrap();
        let resources = format!("{}/", folder.path().display());
        let [name, token, resources] = ["unit", &guid(&model), &resources].map(|text| CString::new(text).unwrap());
        let (name, token, resources) = (name.as_ptr(), token.as_ptr(), resources.as_ptr());
        let (environment, logger) = (std::ptr::from_ref(&*messages).cast_mut().cast(), Some(log as _));
        let component = unsafe {
            if kind == CO_SIMULATION {
                let (none, no_function) = (null(), null());
                fmi3InstantiateCoSimulation(
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
                    no_function,
                )
            } else {
                fmi3InstantiateModelExchange(name, token, resources, false, true, environment, logger)
            }
        };
        assert!(!component.is_null(), "{}", model.description().name);
        Instance { component, model, messages, _folder: folder }
    }

    /// An instance in Initialization Mode.
    pub fn entered(description: &str, kind: i32) -> Self {
        let instance = Instance::new(description, kind);
        assert_eq!(unsafe { fmi3EnterInitializationMode(instance.component, false, 0.0, 0.0, false, 0.0) }, OK);
        instance
    }

    /// An initialised instance, in Step Mode or Continuous-Time Mode.
    pub fn started(description: &str, kind: i32) -> Self {
        let instance = Instance::entered(description, kind);
        assert_eq!(unsafe { fmi3ExitInitializationMode(instance.component) }, OK);
        assert_eq!(instance.update(), OK);
        let c = instance.component;
        let begun =
            unsafe { if kind == CO_SIMULATION { fmi3EnterStepMode(c) } else { fmi3EnterContinuousTimeMode(c) } };
        assert_eq!(begun, OK);
        instance
    }

    /// Number of messages so far.
    pub fn messages(&self) -> usize {
        self.messages.get()
    }

    /// Updates discrete states until nothing changes; the first status that isn't good.
    pub fn update(&self) -> Status {
        let ([mut needed, mut end, mut nominals, mut values, mut defined], mut next) =
            ([true, false, false, false, false], 0.0);
        while needed {
            let c = self.component;
            let status = unsafe {
                fmi3UpdateDiscreteStates(c, &mut needed, &mut end, &mut nominals, &mut values, &mut defined, &mut next)
            };
            if status != OK {
                return status;
            }
            assert!(!defined || next.is_finite(), "{}: next event at {next}", self.model.description().name);
        }
        OK
    }

    /// Makes a step; the status, and the time that was reached.
    pub fn step(&self, point: f64, step: f64) -> (Status, f64) {
        let ([mut event, mut end, mut early], mut time) = ([false; 3], point);
        let status =
            unsafe { fmi3DoStep(self.component, point, step, true, &mut event, &mut end, &mut early, &mut time) };
        (status, time)
    }

    /// Value references of the Float64 variables of some causalities, and the number of their values.
    pub fn references(&self, wanted: impl Fn(Causality) -> bool) -> (Vec<u32>, usize) {
        let (variables, all) = (self.model.variables(), arrays::references(&self.model));
        let entries = arrays::entries(&self.model);
        let found = entries.filter(|it| it.element.variable.is_real() && wanted(it.element.variable.causality));
        let found = found.map(|it| (all.outer(References::of(variables, it.element)), it.elements().len()));
        let (references, sizes): (Vec<_>, Vec<_>) = found.unzip();
        (references, sizes.into_iter().sum())
    }

    /// Its state as bytes.
    pub fn state(&self) -> Vec<u8> {
        let (c, mut state, mut size) = (self.component, null_mut(), 0);
        unsafe {
            assert_eq!(fmi3GetFMUState(c, &mut state), OK);
            assert_eq!(fmi3SerializedFMUStateSize(c, state, &mut size), OK);
            let mut bytes = vec![0; size];
            assert_eq!(fmi3SerializeFMUState(c, state, bytes.as_mut_ptr(), size), OK);
            assert_eq!(fmi3FreeFMUState(c, &mut state), OK);
            bytes
        }
    }

    /// Takes over a state from its bytes; the status.
    pub fn restore(&self, bytes: &[u8]) -> Status {
        let (c, mut state) = (self.component, null_mut());
        unsafe {
            match fmi3DeserializeFMUState(c, bytes.as_ptr(), bytes.len(), &mut state) {
                OK => {}
                refused => return refused,
            }
            let status = fmi3SetFMUState(c, state);
            assert_eq!(fmi3FreeFMUState(c, &mut state), OK);
            status
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        unsafe { fmi3FreeInstance(self.component) };
    }
}
