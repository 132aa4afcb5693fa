//! What the functions of the standard do with an instance, in safe Rust.

use std::path::Path;

use crate::error::StepError;
use crate::execution::{Execution, OnStepFailure};
use crate::model::{Description, Model};
use crate::system::{Data, Registry, Section};

use super::access::{Access, NoValue, References, Type, element};
use super::calls::{Function, Phase};
use super::logger::Logger;
use super::model_description;
use super::resources::DESCRIPTION;
use super::snapshot::{self, Slots};
use super::types::Status;

/// How far, in parts of the step, a master's communication point may lie from where the instance stands.
const COMMUNICATION_POINT_SLACK: f64 = 1e-6;
/// Debug messages about accepted parameters and events.
pub const EVENTS: &str = "logEvents";

/// Why a call is refused, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(pub String);

impl<T: Into<String>> From<T> for Refused {
    fn from(text: T) -> Self {
        Refused(text.into())
    }
}

/// The answer to a call.
pub type Answer<T = ()> = Result<T, Refused>;

/// One instance of a unit.
#[derive(Debug)]
pub struct Instance {
    pub(super) execution: Execution,
    references: References,
    /// Which saved states are its own: those of the same unit in the same build.
    pub(super) identity: [u8; 16],
    /// Where messages go.
    pub logger: Logger,
    pub(super) phase: Phase,
    pub(super) stop_time: Option<f64>,
    /// In Initialization Mode: whether something was set since everything was computed.
    pub(super) stale: bool,
    pub(super) slots: Slots,
}

/// Makes the model of an FMU whose resources lie in a folder.
///
/// # Errors
/// What is wrong with its description.
pub fn load_model(resources: &Path, registry: Registry) -> Answer<Model> {
    let file = resources.join(DESCRIPTION);
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    let refuse = |reason| Refused(format!("{}: {reason}", file.display()));
    let description = Description::read(&text).map_err(refuse)?;
    Model::from_description(description, registry).map_err(refuse)
}

impl Instance {
    /// An instance of a model, of which the master has read the description with this GUID.
    ///
    /// # Errors
    /// When the GUID isn't this model's.
    pub fn new(model: Model, guid: &str, logger: Logger) -> Answer<Self> {
        let own = model_description::guid(&model);
        if guid != model_description::guid_text(own) {
            return Err(Refused(format!(
                "fmi2Instantiate: the GUID `{guid}` is not that of this unit, {}: modelDescription.xml and \
                 resources/{DESCRIPTION} don't belong together",
                model_description::guid_text(own)
            )));
        }
        Ok(Instance {
            references: References::new(model.variables()),
            execution: Execution::new(model),
            identity: snapshot::identity(own),
            logger,
            phase: Phase::Instantiated,
            stop_time: None,
            stale: true,
            slots: Slots::default(),
        })
    }

    /// Where in the state machine it is.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// After a panic nothing can be relied on.
    pub fn poison(&mut self) {
        self.phase = Phase::Poisoned;
    }

    /// Refuses a call that the table doesn't allow now.
    ///
    /// # Errors
    /// With what is allowed.
    #[inline]
    pub fn check(&self, function: Function) -> Answer {
        if function.allowed_in(self.phase) { Ok(()) } else { Err(Refused(function.refusal(self.phase))) }
    }

    /// Sends the messages that the model left.
    pub fn flush_log(&mut self) {
        for message in self.execution.log.drain(..) {
            self.logger.log(Status::Warning, message.category, &message.text);
        }
    }

    /// fmi2SetDebugLogging
    ///
    /// # Errors
    /// For a category that doesn't exist.
    pub fn set_debug_logging(&mut self, on: bool, categories: &[&str]) -> Answer {
        let known: Vec<&str> = self.categories().map(|(name, _)| name).collect();
        if let Some(unknown) = categories.iter().find(|category| !known.contains(category) && **category != "logAll") {
            let known = known.join(", ");
            return Err(Refused(format!("fmi2SetDebugLogging: there is no category `{unknown}`; there are {known}")));
        }
        let all = categories.is_empty() || categories.contains(&"logAll");
        let wanted = if all { &known[..] } else { categories };
        let wanted = if on { wanted.iter().map(|category| (*category).to_owned()).collect() } else { Vec::new() };
        self.logger.enable(wanted);
        Ok(())
    }

    /// The log categories with their descriptions.
    pub fn categories(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        model_description::log_categories(self.execution.model())
    }

    /// fmi2SetupExperiment
    ///
    /// # Errors
    /// For values that are no times or no tolerance.
    pub fn setup_experiment(&mut self, tolerance: Option<f64>, start: f64, stop: Option<f64>) -> Answer {
        if let Some(tolerance) = tolerance.filter(|tolerance| !(tolerance.is_finite() && *tolerance > 0.0)) {
            return Err(Refused(format!("fmi2SetupExperiment: tolerance = {tolerance} must be finite and above 0")));
        }
        if !start.is_finite() {
            return Err(Refused(format!("fmi2SetupExperiment: startTime = {start} must be finite")));
        }
        if let Some(stop) = stop.filter(|stop| !(stop.is_finite() && *stop >= start)) {
            return Err(Refused(format!(
                "fmi2SetupExperiment: stopTime = {stop} must be finite, and at least startTime = {start}"
            )));
        }
        self.execution.set_tolerance(tolerance.unwrap_or(0.0));
        self.execution.set_time(start);
        self.stop_time = stop;
        Ok(())
    }

    /// fmi2EnterInitializationMode
    pub fn enter_initialization_mode(&mut self) {
        self.phase = Phase::Initialization;
        self.stale = true;
    }

    /// fmi2ExitInitializationMode
    ///
    /// # Errors
    /// For parameters or inputs from which nothing can start; they can be set anew.
    pub fn exit_initialization_mode(&mut self) -> Answer {
        self.compute_start("fmi2ExitInitializationMode")?;
        self.phase = Phase::StepComplete;
        Ok(())
    }

    fn compute_start(&mut self, function: &str) -> Answer {
        if self.stale {
            self.execution.initialise().map_err(|error| Refused(format!("{function}: {error}")))?;
            self.stale = false;
        }
        Ok(())
    }

    /// fmi2Terminate
    pub fn terminate(&mut self) {
        self.phase = Phase::Terminated;
    }

    /// fmi2Reset
    pub fn reset(&mut self) {
        self.execution.reset();
        self.phase = Phase::Instantiated;
        self.stop_time = None;
        self.stale = true;
    }

    /// The place of a value, and what may be done with it.
    fn place(&self, function: Function, reference: u32, wanted: Type) -> Answer<(usize, Access)> {
        self.references.find(reference, wanted).map_err(|no_value| {
            let name = function.name();
            match no_value {
                NoValue::Unknown => Refused(format!("{name}: there is no variable with value reference {reference}")),
                NoValue::Other(is) => {
                    let variable = self.name(reference);
                    Refused(format!("{name}: `{variable}` (value reference {reference}) is of type {is:?}"))
                }
            }
        })
    }

    fn name(&self, reference: u32) -> String {
        element(self.execution.model().variables(), reference).map_or(String::new(), |element| element.name())
    }

    /// The items of a choice, with their numbers.
    fn items(&self, reference: u32) -> String {
        let element = element(self.execution.model().variables(), reference);
        let Some(Data::Choice { items, .. }) = element.map(|element| &element.variable.data) else {
            return String::new();
        };
        let items: Vec<_> = items.iter().enumerate().map(|(k, (name, _))| format!("{} {name}", k + 1)).collect();
        items.join(", ")
    }

    /// Refuses to set what can't be set now.
    fn check_settable(&self, function: Function, reference: u32, access: Access) -> Answer {
        let before = matches!(self.phase, Phase::Instantiated | Phase::Initialization);
        let what = match access {
            Access::Input | Access::Tunable => return Ok(()),
            Access::Fixed if before => return Ok(()),
            Access::Fixed => "a fixed parameter, which can only be set before the simulation starts",
            Access::Calculated { .. } | Access::Hidden => "calculated by the unit and can't be set",
        };
        Err(Refused(format!("{}: `{}` (value reference {reference}) is {what}", function.name(), self.name(reference))))
    }

    fn was_set(&mut self, access: Access) {
        self.stale = true;
        if self.phase == Phase::StepComplete && access != Access::Input {
            self.execution.parameters_set();
        }
    }

    /// In Initialization Mode every calculated value is computed from what is set at present.
    fn compute_if_stale(&mut self, function: Function, is: Type, references: &[u32]) -> Answer {
        let mut calculated = false;
        for &reference in references {
            calculated |= matches!(self.place(function, reference, is)?.1, Access::Calculated { .. });
        }
        if calculated && self.phase == Phase::Initialization { self.compute_start(function.name()) } else { Ok(()) }
    }

    /// fmi2GetReal
    ///
    /// # Errors
    /// For value references that aren't those of reals.
    pub fn get_real(&mut self, references: &[u32], values: &mut [f64]) -> Answer {
        self.compute_if_stale(Function::GetReal, Type::Real, references)?;
        for (value, &reference) in values.iter_mut().zip(references) {
            *value = self.execution.block.reals[reference as usize];
        }
        Ok(())
    }

    /// fmi2SetReal
    ///
    /// # Errors
    /// For value references or values that can't be set; nothing is changed.
    pub fn set_real(&mut self, references: &[u32], values: &[f64]) -> Answer {
        for (&reference, value) in references.iter().zip(values) {
            let (_, access) = self.place(Function::SetReal, reference, Type::Real)?;
            self.check_settable(Function::SetReal, reference, access)?;
            if !value.is_finite() {
                let name = self.name(reference);
                return Err(Refused(format!("fmi2SetReal: `{name}` = {value} must be a finite number")));
            }
        }
        for (&reference, &value) in references.iter().zip(values) {
            let (place, access) = self.place(Function::SetReal, reference, Type::Real)?;
            self.execution.block.reals[place] = value;
            self.was_set(access);
        }
        Ok(())
    }

    /// fmi2GetInteger, fmi2GetBoolean
    ///
    /// # Errors
    /// For value references of another type.
    pub fn get_integer(&mut self, function: Function, is: Type, references: &[u32], values: &mut [i32]) -> Answer {
        self.compute_if_stale(function, is, references)?;
        for (value, &reference) in values.iter_mut().zip(references) {
            let (place, _) = self.place(function, reference, is)?;
            *value = self.execution.block.integers[place];
        }
        Ok(())
    }

    /// fmi2SetInteger, fmi2SetBoolean
    ///
    /// # Errors
    /// For value references or values that can't be set; nothing is changed.
    pub fn set_integer(&mut self, function: Function, is: Type, references: &[u32], values: &[i32]) -> Answer {
        for (&reference, &value) in references.iter().zip(values) {
            let (place, access) = self.place(function, reference, is)?;
            self.check_settable(function, reference, access)?;
            if !self.references.holds(place, value) {
                let items = self.items(reference);
                let name = self.name(reference);
                return Err(Refused(format!("{}: `{name}` = {value} is no item; there are {items}", function.name())));
            }
        }
        for (&reference, &value) in references.iter().zip(values) {
            let (place, access) = self.place(function, reference, is)?;
            self.execution.block.integers[place] = if is == Type::Boolean { i32::from(value != 0) } else { value };
            self.was_set(access);
        }
        Ok(())
    }

    /// fmi2SetRealInputDerivatives
    ///
    /// # Errors
    /// For what isn't a real input, another order than 1, or values that aren't finite.
    pub fn set_input_derivatives(&mut self, references: &[u32], orders: &[i32], values: &[f64]) -> Answer {
        let function = Function::SetRealInputDerivatives;
        for ((&reference, &order), value) in references.iter().zip(orders).zip(values) {
            let (_, access) = self.place(function, reference, Type::Real)?;
            let name = || self.name(reference);
            if access != Access::Input {
                return Err(Refused(format!("{}: `{}` is not an input", function.name(), name())));
            }
            if order != 1 {
                return Err(Refused(format!(
                    "{}: `{}`: order {order}; only order 1 is supported",
                    function.name(),
                    name()
                )));
            }
            if !value.is_finite() {
                return Err(Refused(format!("{}: `{}`: {value} must be a finite number", function.name(), name())));
            }
        }
        let first = self.execution.model().variables().reals(Section::Input).start;
        for (&reference, &value) in references.iter().zip(values) {
            self.execution.set_input_slope(reference as usize - first, value);
        }
        Ok(())
    }

    /// fmi2GetRealOutputDerivatives
    ///
    /// # Errors
    /// For what isn't a real output, or another order than 1.
    pub fn get_output_derivatives(&mut self, references: &[u32], orders: &[i32], values: &mut [f64]) -> Answer {
        let function = Function::GetRealOutputDerivatives;
        for (&reference, &order) in references.iter().zip(orders) {
            let (_, access) = self.place(function, reference, Type::Real)?;
            if access != (Access::Calculated { output: true }) {
                return Err(Refused(format!("{}: `{}` is not an output", function.name(), self.name(reference))));
            }
            if order != 1 {
                let name = self.name(reference);
                return Err(Refused(format!(
                    "{}: `{name}`: order {order}; only order 1 is supported",
                    function.name()
                )));
            }
        }
        let derivatives = self.execution.time_derivatives();
        for (value, &reference) in values.iter_mut().zip(references) {
            *value = derivatives[reference as usize].eps;
        }
        Ok(())
    }

    /// fmi2GetDirectionalDerivative, at the present inputs.
    ///
    /// # Errors
    /// For unknowns that aren't calculated reals, knowns that are neither inputs nor states, or a seed that isn't finite.
    pub fn get_directional_derivative(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        result: &mut [f64],
    ) -> Answer {
        let function = Function::GetDirectionalDerivative;
        let refuse = |instance: &Self, reference, reason: &str| {
            Err(Refused(format!("{}: `{}` {reason}", function.name(), instance.name(reference))))
        };
        for &unknown in unknowns {
            if !matches!(self.place(function, unknown, Type::Real)?.1, Access::Calculated { .. }) {
                return refuse(self, unknown, "is not calculated, so it has no derivative");
            }
        }
        let variables = self.execution.model().variables();
        let (inputs, states) = (variables.reals(Section::Input), variables.reals(Section::State));
        for (&known, change) in knowns.iter().zip(seed) {
            let (place, _) = self.place(function, known, Type::Real)?;
            if !inputs.contains(&place) && !states.contains(&place) {
                return refuse(self, known, "is neither an input nor a state");
            }
            if !change.is_finite() {
                return refuse(self, known, &format!("has the seed {change}, which must be finite"));
            }
        }
        self.execution.directional_derivative(unknowns, knowns, seed, result);
        Ok(())
    }

    /// fmi2DoStep
    ///
    /// # Errors
    /// When the step is refused (nothing changed), or can't be finished (values as before, and the instance in error).
    pub fn do_step(&mut self, point: f64, step: f64) -> Answer<Status> {
        self.check_step(point, step)?;
        match self.execution.step(point, step) {
            Ok(taken_over) => {
                if taken_over && self.logger.is_enabled(EVENTS) {
                    self.logger.log(Status::Ok, EVENTS, &format!("tunable parameters taken over at t = {point} s"));
                }
                Ok(Status::Ok)
            }
            Err(error) => self.failed_step(error, point, step),
        }
    }

    fn failed_step(&mut self, error: StepError, point: f64, step: f64) -> Answer<Status> {
        let reason = format!("fmi2DoStep from t = {point} s by {step} s: {error}");
        match error {
            // As with any refused argument, the instance can go on.
            StepError::Parameters(_) => Err(Refused(reason)),
            // A smaller step would not start either, so this is never discarded.
            StepError::Invalid(_) => {
                self.phase = Phase::Error;
                Err(Refused(reason))
            }
            _ if self.execution.on_step_failure() == OnStepFailure::Discard => {
                self.phase = Phase::StepFailed;
                self.logger.log(Status::Discard, "logStatusDiscard", &reason);
                Ok(Status::Discard)
            }
            _ => {
                self.phase = Phase::Error;
                Err(Refused(reason))
            }
        }
    }

    fn check_step(&self, point: f64, step: f64) -> Answer {
        if !(step.is_finite() && step > 0.0) {
            return Err(Refused(format!("fmi2DoStep: communicationStepSize = {step} must be finite and above 0")));
        }
        let time = self.execution.time();
        let slack = COMMUNICATION_POINT_SLACK * step + 4.0 * f64::EPSILON * time.abs();
        if !(point.is_finite() && (point - time).abs() <= slack) {
            return Err(Refused(format!(
                "fmi2DoStep: currentCommunicationPoint = {point} s, but the instance stands at t = {time} s; to go back, \
                 restore a saved state"
            )));
        }
        if point + step <= point {
            return Err(Refused(format!(
                "fmi2DoStep: communicationStepSize = {step} is too small to change t = {point} s"
            )));
        }
        match self.stop_time {
            Some(stop) if point + step > stop + slack => Err(Refused(format!(
                "fmi2DoStep: {point} s + {step} s goes beyond stopTime = {stop} s, which fmi2SetupExperiment was given"
            ))),
            _ => Ok(()),
        }
    }

    /// Time up to which values are valid, s.
    pub fn last_successful_time(&self) -> f64 {
        self.execution.time()
    }
}
