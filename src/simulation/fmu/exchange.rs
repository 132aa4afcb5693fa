//! What only some masters ask of a unit: directional derivatives, and the functions of model exchange. They are looked
//! up when they are called, for a unit may lack them.

use std::ffi::c_int;

use super::{Answer, Instance};
use crate::error::Error;
use crate::exporter::with_causes;
use crate::fmi2::types::{Component, EventInfo, FALSE};

type DirectionalDerivative =
    unsafe extern "C" fn(Component, *const u32, usize, *const u32, usize, *const f64, *mut f64) -> Answer;
type Plain = unsafe extern "C" fn(Component) -> Answer;
type NewDiscreteStates = unsafe extern "C" fn(Component, *mut EventInfo) -> Answer;
type GetNumbers = unsafe extern "C" fn(Component, *mut f64, usize) -> Answer;
type SetNumbers = unsafe extern "C" fn(Component, *const f64, usize) -> Answer;

/// More event iterations than this at one time never end.
const EVENT_ITERATIONS: usize = 1000;

impl Instance {
    /// # Safety
    /// `F` must be the type that the standard gives the function, and must not be used when the instance is gone.
    unsafe fn function<F: Copy>(&self, name: &'static str) -> Result<F, Error> {
        // SAFETY: as this function asks of its caller.
        let found = unsafe { self.fmu.library.get::<F>(name.as_bytes()) };
        found.map(|function| *function).map_err(|error| self.refusal(name, with_causes(&error)))
    }

    /// How unknowns change when knowns change along a direction.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn directional_derivative(&self, unknowns: &[u32], knowns: &[u32], seed: &[f64]) -> Result<Vec<f64>, Error> {
        assert_eq!(knowns.len(), seed.len());
        let (name, mut result) = ("fmi2GetDirectionalDerivative", vec![0.0; unknowns.len()]);
        let (unknown, n, known, m) = (unknowns.as_ptr(), unknowns.len(), knowns.as_ptr(), knowns.len());
        // SAFETY: the type is the standard's of that name; references and numbers are as many as said.
        let answer = unsafe {
            let function: DirectionalDerivative = self.function(name)?;
            function(self.component, unknown, n, known, m, seed.as_ptr(), result.as_mut_ptr())
        };
        self.check(name, answer)?;
        Ok(result)
    }

    /// Ends an event of model exchange: discrete states are taken over until they no longer change. The instance is in
    /// Event Mode, as it is after initialisation, and then in Continuous-Time Mode.
    ///
    /// # Errors
    /// When the unit refuses, or its events never end.
    pub fn finish_event(&self) -> Result<(), Error> {
        let mut info = EventInfo {
            new_discrete_states_needed: FALSE,
            terminate_simulation: FALSE,
            nominals_changed: FALSE,
            values_changed: FALSE,
            next_event_time_defined: FALSE,
            next_event_time: 0.0,
        };
        let name = "fmi2NewDiscreteStates";
        for _ in 0..EVENT_ITERATIONS {
            // SAFETY: the type is the standard's of that name.
            let answer = unsafe { self.function::<NewDiscreteStates>(name)?(self.component, &mut info) };
            self.check(name, answer)?;
            if info.terminate_simulation != FALSE {
                return Err(self.refusal(name, "the unit asks to end the simulation".to_owned()));
            }
            if info.new_discrete_states_needed == FALSE {
                return self.enter("fmi2EnterContinuousTimeMode");
            }
        }
        Err(self.refusal(name, format!("its discrete states still change after {EVENT_ITERATIONS} iterations")))
    }

    /// Begins an event of model exchange.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn begin_event(&self) -> Result<(), Error> {
        self.enter("fmi2EnterEventMode")
    }

    fn enter(&self, name: &'static str) -> Result<(), Error> {
        // SAFETY: the type is the standard's of that name.
        let answer: c_int = unsafe { self.function::<Plain>(name)?(self.component) };
        self.check(name, answer)
    }

    /// The continuous states, in the order of the model structure.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn states(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers("fmi2GetContinuousStates", count)
    }

    /// Their derivatives.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn state_derivatives(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers("fmi2GetDerivatives", count)
    }

    fn numbers(&self, name: &'static str, count: usize) -> Result<Vec<f64>, Error> {
        let mut numbers = vec![0.0; count];
        // SAFETY: the type is the standard's of that name; numbers are as many as said.
        let answer = unsafe { self.function::<GetNumbers>(name)?(self.component, numbers.as_mut_ptr(), count) };
        self.check(name, answer)?;
        Ok(numbers)
    }

    /// Sets the continuous states.
    ///
    /// # Errors
    /// When the unit refuses.
    pub fn set_states(&self, states: &[f64]) -> Result<(), Error> {
        let name = "fmi2SetContinuousStates";
        // SAFETY: the type is the standard's of that name; numbers are as many as said.
        let answer = unsafe { self.function::<SetNumbers>(name)?(self.component, states.as_ptr(), states.len()) };
        self.check(name, answer)
    }
}
