//! An instance of an FMU, with every answer and every number checked.

use std::cell::Cell;
use std::sync::Arc;

use super::Fmu;
use super::Value;
use super::kernel::Common;
use super::messages::Messages;
use super::unit::{Answer, Call, DISCARD, OK, RunningUnit, WARNING, no_event_info};
use crate::error::{Error, Number};
use crate::fmi2::calls::{Function, Standard};
use crate::model_description::ModelDescription;

/// Largest number of event iterations at one time; more are taken for an endless loop.
const EVENT_ITERATIONS: usize = 1000;

/// An instance of an FMU.
#[derive(Debug)]
pub struct Instance {
    unit: Box<dyn RunningUnit>,
    name: String,
    time: f64,
    /// True if the last failed call may be repeated in another way: it was discarded, or a number wasn't finite.
    may_try_again: Cell<bool>,
    fmu: Arc<Fmu>,
}

/// Result of an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// Time of the next one that the FMU requests, s.
    pub next: Option<f64>,
    /// True if continuous states changed.
    pub states_changed: bool,
    /// True if the states' nominal values changed.
    pub nominals_changed: bool,
}

impl Instance {
    pub(super) fn new(unit: Box<dyn RunningUnit>, name: &str, fmu: &Arc<Fmu>) -> Self {
        Instance { unit, name: name.to_owned(), time: 0.0, may_try_again: Cell::new(false), fmu: Arc::clone(fmu) }
    }

    /// Its name in the loop.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its FMU.
    pub fn fmu(&self) -> &Fmu {
        &self.fmu
    }

    /// The description of its FMU.
    pub fn description(&self) -> &ModelDescription {
        &self.fmu.description
    }

    /// The communication step that its FMU proposes, else a usual one, s.
    pub fn step(&self) -> f64 {
        self.fmu.step()
    }

    /// Compiles equations for the parameters that it has in common with another instance of its FMU; none if they can't be.
    pub fn compile_common(&self, other: &Instance) -> Option<Common> {
        let components =
            [self.unit.component()?, other.unit.component().filter(|_| Arc::ptr_eq(&self.fmu, &other.fmu))?];
        let (binary, kernel) = self.fmu.here()?;
        kernel.compile_common(components, binary)
    }

    /// Messages since the last call: warnings, if every call was OK.
    pub fn messages(&self) -> Messages {
        self.unit.messages()
    }

    /// True if the last failed call may be repeated in another way, for example with a shorter step.
    pub(crate) fn may_try_again(&self) -> bool {
        self.may_try_again.get()
    }

    fn call(&self, call: Call<'_>) -> Result<(), Error> {
        let function = call.function();
        match self.unit.call(call) {
            Ok(answer) => self.check(function, answer),
            Err(reason) => {
                self.may_try_again.set(false);
                let logged = self.unit.messages();
                let logged = if logged.is_empty() { String::new() } else { format!("; {}", logged.joined()) };
                Err(self.refusal(function, format!("{reason}{logged}")))
            }
        }
    }

    fn check(&self, function: Function, answer: Answer) -> Result<(), Error> {
        if answer == OK || answer == WARNING {
            return Ok(());
        }
        self.may_try_again.set(answer == DISCARD);
        let (messages, fmi) = (self.unit.messages(), self.standard().prefix());
        Err(self.refusal(
            function,
            match answer {
                _ if !messages.is_empty() => messages.joined(),
                DISCARD => format!("it returned {fmi}Discard, without a message"),
                3 => format!("it returned {fmi}Error, without a message"),
                4 => format!("it returned {fmi}Fatal, so it can't continue, without a message"),
                5 if self.standard() == Standard::Fmi2 => {
                    "it returned fmi2Pending, which is not allowed for this function".to_owned()
                }
                answer => format!("it returned {answer}, which is not a status of the FMI standard"),
            },
        ))
    }

    fn standard(&self) -> Standard {
        self.description().standard
    }

    fn refusal(&self, function: Function, message: String) -> Error {
        Error::Unit { unit: self.name.clone(), function: function.name_in(self.standard()), time: self.time, message }
    }

    /// Refuses a number that isn't finite, though the FMU returned the status OK.
    fn check_numbers(&self, function: Function, numbers: &[f64], name: impl Fn(usize) -> String) -> Result<(), Error> {
        let Some(place) = numbers.iter().position(|number| !number.is_finite()) else { return Ok(()) };
        self.may_try_again.set(true);
        let (name, number, fmi) = (name(place), Number(numbers[place]), self.standard().prefix());
        Err(self.refusal(function, format!("{name} = {number} is not a finite number, but the call returned {fmi}OK")))
    }

    /// The variable of a value reference, for messages.
    fn name_of(&self, reference: u32) -> String {
        let variables = &self.description().variables;
        let found = variables.iter().find(|variable| variable.reference == reference && variable.kind == "Real");
        found.map_or_else(|| format!("value reference {reference}"), |variable| format!("`{}`", variable.name))
    }

    /// Sets a start value.
    ///
    /// # Errors
    /// If the FMU refuses it.
    pub fn set_start(&self, reference: u32, value: &Value) -> Result<(), Error> {
        match value {
            Value::Real(value) => self.set_real(&[reference], &[*value]),
            Value::Integer(value) => self.set_integer(&[reference], &[*value]),
            Value::Boolean(value) => self.set_boolean(&[reference], &[i32::from(*value)]),
            Value::String(text) => self.call(Call::SetString(reference, text)),
        }
    }

    /// Sets up the experiment and enters Initialization Mode.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn enter_initialization(&mut self, start: f64, stop: f64) -> Result<(), Error> {
        self.time = start;
        self.call(Call::SetupExperiment { start, stop })?;
        self.call(Call::Plain(Function::EnterInitializationMode))
    }

    /// Leaves Initialization Mode.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn exit_initialization(&self) -> Result<(), Error> {
        self.call(Call::Plain(Function::ExitInitializationMode))
    }

    /// Reads real variables.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn get_real(&self, references: &[u32], values: &mut [f64]) -> Result<(), Error> {
        self.get_any_real(references, values)?;
        self.check_numbers(Function::GetReal, values, |place| self.name_of(references[place]))
    }

    /// Reads real variables, finite or not.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn get_any_real(&self, references: &[u32], values: &mut [f64]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::GetReal(references, values))
    }

    /// Sets real variables.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn set_real(&self, references: &[u32], values: &[f64]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::SetReal(references, values))
    }

    /// Reads integer variables.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn get_integer(&self, references: &[u32], values: &mut [i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::GetWhole(Function::GetInteger, references, values))
    }

    /// Sets integer variables.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn set_integer(&self, references: &[u32], values: &[i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::SetWhole(Function::SetInteger, references, values))
    }

    /// Reads boolean variables: 0 or 1.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn get_boolean(&self, references: &[u32], values: &mut [i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::GetWhole(Function::GetBoolean, references, values))
    }

    /// Sets boolean variables: 0 or 1.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn set_boolean(&self, references: &[u32], values: &[i32]) -> Result<(), Error> {
        assert_eq!(references.len(), values.len());
        self.call(Call::SetWhole(Function::SetBoolean, references, values))
    }

    /// Takes one communication step.
    ///
    /// # Errors
    /// If the step isn't finished, also if it was discarded.
    pub fn do_step(&mut self, time: f64, step: f64) -> Result<(), Error> {
        self.time = time;
        self.call(Call::DoStep { time, step })
    }

    /// Takes communication steps to these times from the first of them in one go, and writes the values of variables behind
    /// each: real ones, integers and Booleans. Returns the number of steps that were taken; the others are left to
    /// [`Instance::do_step`].
    pub(crate) fn do_steps(&mut self, times: &[f64], references: &[u32], rows: &mut [f64]) -> usize {
        self.unit.do_steps(times, references, rows)
    }

    /// Takes note of the values behind one of these steps, which began at a time.
    ///
    /// # Errors
    /// If one of them is not finite.
    pub(crate) fn stepped(&mut self, time: f64, references: &[u32], row: &[f64]) -> Result<(), Error> {
        self.time = time;
        self.check_numbers(Function::GetReal, row, |place| self.name_of(references[place]))
    }

    /// Ends the simulation.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn terminate(&self) -> Result<(), Error> {
        self.call(Call::Plain(Function::Terminate))
    }

    /// Frees the instance. Returns its last messages.
    ///
    /// # Errors
    /// If its process doesn't survive that.
    pub fn free(mut self) -> Result<Messages, Error> {
        let (freed, standard) = (self.unit.free(), self.standard());
        let messages = self.unit.messages();
        freed.map(|()| messages).map_err(|message| {
            let unit = self.name.clone();
            let function = if standard == Standard::Fmi2 { "fmi2FreeInstance" } else { "fmi3FreeInstance" };
            Error::Unit { unit, function, time: self.time, message }
        })
    }

    /// Directional derivative of unknowns with respect to knowns.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn directional_derivative(&self, unknowns: &[u32], knowns: &[u32], seed: &[f64]) -> Result<Vec<f64>, Error> {
        assert_eq!(knowns.len(), seed.len());
        let mut result = vec![0.0; unknowns.len()];
        self.call(Call::DirectionalDerivative { unknowns, knowns, seed, result: &mut result })?;
        self.check_numbers(Function::GetDirectionalDerivative, &result, |place| {
            format!("the derivative of {}", self.name_of(unknowns[place]))
        })?;
        Ok(result)
    }

    /// Ends an event of model exchange: discrete states are taken over until they no longer change. The instance is in
    /// Event Mode, as it is after initialisation, and then in Continuous-Time Mode.
    ///
    /// # Errors
    /// If the FMU refuses, or its events never end.
    pub fn finish_event(&self) -> Result<Event, Error> {
        let event = self.update()?;
        self.call(Call::Plain(Function::EnterContinuousTimeMode))?;
        Ok(event)
    }

    /// Leaves Event Mode for the next step of co-simulation.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn enter_step_mode(&self) -> Result<(), Error> {
        self.call(Call::Plain(Function::EnterStepMode))
    }

    /// Takes discrete states over, in Event Mode, until they no longer change.
    ///
    /// # Errors
    /// If the FMU refuses, or its events never end.
    pub fn update(&self) -> Result<Event, Error> {
        let (mut info, mut states_changed, mut nominals_changed) = (no_event_info(), false, false);
        for _ in 0..EVENT_ITERATIONS {
            self.call(Call::NewDiscreteStates(&mut info))?;
            states_changed |= info.values_changed != 0;
            nominals_changed |= info.nominals_changed != 0;
            if info.terminate_simulation != 0 {
                let reason = "the FMU requested to end the simulation".to_owned();
                return Err(self.refusal(Function::NewDiscreteStates, reason));
            }
            if info.new_discrete_states_needed == 0 {
                let next = (info.next_event_time_defined != 0).then_some(info.next_event_time);
                return Ok(Event { next, states_changed, nominals_changed });
            }
        }
        let reason = format!("the discrete states still change after {EVENT_ITERATIONS} iterations");
        Err(self.refusal(Function::NewDiscreteStates, reason))
    }

    /// Begins an event, of model exchange or, in FMI 3.0, at the end of a step.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn begin_event(&self) -> Result<(), Error> {
        self.call(Call::Plain(Function::EnterEventMode))
    }

    /// Sets the time of model exchange, s.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn set_time(&mut self, time: f64) -> Result<(), Error> {
        self.time = time;
        self.call(Call::SetTime(time))
    }

    /// Reports that an integrator's step is complete. Returns true if the FMU requests Event Mode.
    ///
    /// # Errors
    /// If the FMU refuses, or requests to end the simulation.
    pub fn completed_step(&self) -> Result<bool, Error> {
        let mut asked = [0; 2];
        self.call(Call::CompletedIntegratorStep(&mut asked))?;
        if asked[1] != 0 {
            let reason = "the FMU requested to end the simulation".to_owned();
            return Err(self.refusal(Function::CompletedIntegratorStep, reason));
        }
        Ok(asked[0] != 0)
    }

    /// The continuous states, in the order of the model structure.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn states(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers(Function::GetContinuousStates, "state", count)
    }

    /// Their derivatives.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn state_derivatives(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers(Function::GetDerivatives, "derivative", count)
    }

    /// The event indicators.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn event_indicators(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers(Function::GetEventIndicators, "event indicator", count)
    }

    /// The states' nominal values.
    ///
    /// # Errors
    /// If the FMU refuses, or returns a number that is not finite.
    pub fn nominals(&self, count: usize) -> Result<Vec<f64>, Error> {
        self.numbers(Function::GetNominalsOfContinuousStates, "nominal value", count)
    }

    fn numbers(&self, function: Function, what: &str, count: usize) -> Result<Vec<f64>, Error> {
        let mut numbers = vec![0.0; count];
        self.call(Call::GetNumbers(function, &mut numbers))?;
        self.check_numbers(function, &numbers, |place| format!("{what} {}", place + 1))?;
        Ok(numbers)
    }

    /// Sets the continuous states.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub fn set_states(&self, states: &[f64]) -> Result<(), Error> {
        self.call(Call::SetContinuousStates(states))
    }
}
