//! Functions of the standard for an instance, in safe Rust.

use std::sync::Arc;

use crate::error::{Invalid, Number, StepError};
use crate::execution::{Execution, Settled};
use crate::model::Block;
use crate::system::Data;

use super::access::{Access, NoValue, Type, element};
use super::calls::{Answer, Function, Interface, Phase, Refused, Standard};
use super::kernel::Functions;
use super::logger::{self, DISCARDED, EVENTS, Logger};
use super::model_description;
use super::resources::DESCRIPTION;
use super::shared::Shared;
use super::snapshot::Slots;
use super::types::Status;

/// Value references of single values, which can be gone through several times.
pub trait Values: Iterator<Item = u32> + Clone {}

impl<T: Iterator<Item = u32> + Clone> Values for T {}

/// One instance of a unit.
#[derive(Debug)]
pub struct Instance {
    pub(crate) execution: Execution,
    /// Data shared with the other instances of its FMU.
    pub(crate) unit: Arc<Shared>,
    /// Mark of the saved states that are its own: of the same unit, its sizes and interface in the same build.
    pub(super) identity: [u8; 16],
    /// Destination of messages.
    pub logger: Logger,
    /// Standard and interface of the instance.
    pub(crate) of: (Standard, Interface),
    pub(crate) phase: Phase,
    pub(super) stop_time: Option<f64>,
    pub(super) slots: Slots,
    /// True if the master handles events in co-simulation, in Event Mode, and if a step may end at one.
    pub(crate) event_mode: bool,
    pub(crate) early_return: bool,
    /// Discrete variables before a step, where events are its master's.
    pub(crate) discrete: Vec<u64>,
    /// True if it was logged that the master's communication points aren't the sums of its steps.
    pub(super) points_differ: bool,
    /// Sizes that were set in Configuration Mode.
    pub(crate) asked_sizes: Vec<usize>,
}

impl Instance {
    /// An instance of a unit, of which the master has read the description with this GUID.
    ///
    /// # Errors
    /// When the GUID isn't this unit's.
    pub fn new(unit: Arc<Shared>, of: (Standard, Interface), guid: &str, logger: Logger) -> Answer<Self> {
        let own = unit.guid;
        if unit.model.description().standard() != of.0 {
            let [asked, is] = match of.0 {
                Standard::Fmi2 => ["fmi2Instantiate", "FMI 3.0"],
                Standard::Fmi3 => ["a function of FMI 3.0", "FMI 2.0"],
            };
            return Err(Refused(format!("this is an FMU of {is}, and {asked} was called")));
        }
        if guid != model_description::guid_text(own) {
            let name = match of.0 {
                Standard::Fmi2 => "the GUID",
                Standard::Fmi3 => "the instantiation token",
            };
            return Err(Refused(format!(
                "{name} `{guid}` is not that of this FMU, {}: modelDescription.xml and resources/{DESCRIPTION} don't belong \
                 together",
                model_description::guid_text(own)
            )));
        }
        Ok(Instance {
            execution: begun(&unit, of.1),
            identity: unit.identity(of.1),
            unit,
            logger,
            of,
            phase: Phase::Instantiated,
            stop_time: None,
            slots: Slots::default(),
            event_mode: false,
            early_return: false,
            discrete: Vec::new(),
            points_differ: false,
            asked_sizes: Vec::new(),
        })
    }

    /// Begins anew as an instance of a unit that differs in its sizes; what it was until then.
    pub(crate) fn take_unit(&mut self, unit: Arc<Shared>) -> Execution {
        let former = std::mem::replace(&mut self.execution, begun(&unit, self.of.1));
        self.identity = unit.identity(self.of.1);
        self.unit = unit;
        if self.event_mode {
            self.use_event_mode(self.early_return);
        }
        if self.logger.is_enabled(EVENTS) {
            self.execution.log_methods();
        }
        former
    }

    /// The name of a function in its standard.
    pub(crate) fn called(&self, function: Function) -> &'static str {
        function.name_in(self.of.0)
    }

    fn refused_start(&self, function: Function, error: &StepError) -> Refused {
        Refused(format!("{}: {error}", self.called(function)))
    }

    /// Phase in the state machine.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Marks the instance as unusable: after a panic nothing can be relied on.
    pub fn poison(&mut self) {
        self.phase = Phase::Poisoned;
    }

    /// Returns the functions from which a kernel of its equations is compiled: for any parameters, or for those that it
    /// has in common with another instance of its unit now.
    ///
    /// # Errors
    /// The equations have no kernel.
    pub fn kernel_functions(&self, other: Option<&Instance>) -> Result<Functions, Invalid> {
        let (own, model) = (self.execution.block(), &self.unit.model);
        let alike = |other: &Block| (own.reals.len(), own.integers.len()) == (other.reals.len(), other.integers.len());
        let other = other.map(|other| other.execution.block()).filter(|other| alike(other));
        let settled = other.map_or_else(Settled::default, |other| Settled::common(model, own, other));
        Functions::of(model, settled)
    }

    /// Uses compiled equations. Returns false if they aren't those of its model, or are for other parameters.
    pub fn take_kernel(&mut self, kernel: crate::kernel::Kernel) -> bool {
        self.execution.take_kernel(kernel)
    }

    /// True if it evaluates compiled equations.
    pub fn has_kernel(&self) -> bool {
        self.execution.has_kernel()
    }

    /// Refuses a call that the table doesn't allow now.
    ///
    /// # Errors
    /// With what is allowed.
    #[inline]
    pub fn check(&self, function: Function) -> Answer {
        if function.allowed_in(self.of, self.phase) {
            return Ok(());
        }
        Err(Refused(function.refusal(self.of, self.phase)))
    }

    /// Sends the messages that the model left.
    pub fn flush_log(&mut self) {
        for message in self.execution.take_messages() {
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
            let name = self.called(Function::SetDebugLogging);
            return Err(Refused(format!("{name}: there is no category `{unknown}`; there are {known}")));
        }
        let all = categories.is_empty() || categories.contains(&"logAll");
        let wanted = if all { &known[..] } else { categories };
        match self.of.0 {
            Standard::Fmi2 if !on => self.logger.enable(Vec::new()),
            Standard::Fmi2 => self.logger.enable(wanted.iter().map(|category| (*category).to_owned()).collect()),
            Standard::Fmi3 => self.logger.switch(wanted, on),
        }
        if self.logger.is_enabled(EVENTS) {
            self.execution.log_methods();
        }
        Ok(())
    }

    /// The log categories with their descriptions.
    pub fn categories(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        logger::categories(self.execution.model())
    }

    /// fmi2SetupExperiment
    ///
    /// # Errors
    /// For values that are no times or no tolerance.
    pub fn setup_experiment(&mut self, tolerance: Option<f64>, start: f64, stop: Option<f64>) -> Answer {
        let name = self.called(Function::SetupExperiment);
        if let Some(tolerance) = tolerance.filter(|tolerance| !(tolerance.is_finite() && *tolerance > 0.0)) {
            return Err(Refused(format!("{name}: tolerance = {} must be finite and above 0", Number(tolerance))));
        }
        if !start.is_finite() {
            return Err(Refused(format!("{name}: startTime = {} must be finite", Number(start))));
        }
        if let Some(stop) = stop.filter(|stop| !(stop.is_finite() && *stop >= start)) {
            return Err(Refused(format!(
                "{name}: stopTime = {} must be finite, and at least startTime = {}",
                Number(stop),
                Number(start)
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
    }

    /// fmi2ExitInitializationMode
    ///
    /// # Errors
    /// For parameters or inputs from which nothing can start; they can be set anew.
    pub fn exit_initialization_mode(&mut self) -> Answer {
        self.compute_start(Function::ExitInitializationMode)?;
        self.phase = match self.of.1 {
            Interface::ModelExchange => {
                let started = self.execution.begin_model_exchange();
                started.map_err(|error| self.refused_start(Function::ExitInitializationMode, &error))?;
                Phase::Event
            }
            Interface::CoSimulation if self.event_mode => {
                let started = self.execution.begin_event_mode();
                started.map_err(|error| self.refused_start(Function::ExitInitializationMode, &error))?;
                Phase::Event
            }
            Interface::CoSimulation => Phase::StepComplete,
        };
        self.execution.find_indicators();
        Ok(())
    }

    fn compute_start(&mut self, function: Function) -> Answer {
        self.execution.initialise().map_err(|error| self.refused_start(function, &error))
    }

    /// Brings what is calculated up to date: in Initialization Mode to what is set at present, in model exchange and in Event Mode
    /// to the present time, states and inputs. In co-simulation it changes with steps only.
    ///
    /// # Errors
    /// When nothing can start from what is set.
    pub(crate) fn evaluate(&mut self, function: Function) -> Answer {
        match (self.phase, self.of.1) {
            (Phase::Initialization, _) => self.compute_start(function),
            (Phase::Event, _) | (_, Interface::ModelExchange) => {
                self.execution.evaluate();
                Ok(())
            }
            (_, Interface::CoSimulation) => Ok(()),
        }
    }

    /// fmi2Terminate
    pub fn terminate(&mut self) {
        if self.phase == Phase::Event {
            self.execution.evaluate();
        }
        self.phase = Phase::Terminated;
    }

    /// fmi2Reset
    pub fn reset(&mut self) {
        if let Some(base) = self.unit.base.clone() {
            self.take_unit(base);
        }
        self.execution.reset();
        self.phase = Phase::Instantiated;
        self.stop_time = None;
    }

    /// The place of a value, and what may be done with it.
    pub(crate) fn place(&self, function: Function, reference: u32, wanted: Type) -> Answer<(usize, Access)> {
        self.unit.references.find(reference, wanted).map_err(|no_value| {
            let name = self.called(function);
            match no_value {
                NoValue::Unknown => Refused(format!("{name}: there is no variable with value reference {reference}")),
                NoValue::Other(is) => {
                    let (variable, reference) = (self.name(reference), self.unit.references.outer(reference));
                    Refused(format!("{name}: `{variable}` (value reference {reference}) is of type {is:?}"))
                }
            }
        })
    }

    pub(crate) fn name(&self, reference: u32) -> String {
        if let Some(indicator) = self.unit.references.indicator(reference) {
            return format!("event_indicators[{}]", indicator + 1);
        }
        // Time is the only one that no system declares.
        element(self.execution.model().variables(), reference).map_or("time".to_owned(), |element| element.name())
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
            Access::Tunable if self.phase == Phase::ContinuousTime => {
                "a tunable parameter, which in model exchange can only be set in Event Mode"
            }
            Access::Input | Access::Tunable => return Ok(()),
            Access::Fixed if before => return Ok(()),
            Access::Fixed => "a fixed parameter, which can only be set before the simulation starts",
            Access::Designed => "a constant, with which the FMU was designed: export it again to change it",
            Access::Calculated { .. } | Access::Hidden => "calculated by the FMU and can't be set",
        };
        Err(Refused(format!(
            "{}: `{}` (value reference {}) is {what}",
            self.called(function),
            self.name(reference),
            self.unit.references.outer(reference)
        )))
    }

    /// Brings up to date what is read, where any of it is calculated.
    fn evaluate_for(&mut self, function: Function, is: Type, references: impl Iterator<Item = u32>) -> Answer {
        let mut calculated = false;
        for reference in references {
            calculated |= matches!(self.place(function, reference, is)?.1, Access::Calculated { .. });
        }
        match self.phase {
            _ if !calculated => Ok(()),
            Phase::Instantiated => {
                let name = self.called(function);
                Err(Refused(format!("{name}: calculated values are available from Initialization Mode on")))
            }
            _ => self.evaluate(function),
        }
    }

    /// Answers a question for a value that is no number at the present point. fmi2Discard, since a solver that only
    /// probed may come back with a smaller step; with fmi2Error it would have to give up.
    pub(crate) fn not_finite(&mut self, function: Function, what: &str, value: f64) -> Status {
        let (name, value, time) = (self.called(function), Number(value), Number(self.execution.time()));
        let cause = self.execution.unsound().map_or(String::new(), |reasons| format!(": {reasons}"));
        self.discard(&format!("{name}: {what} is {value} at t = {time} s, which is no finite number{cause}"))
    }

    pub(super) fn discard(&mut self, reason: &str) -> Status {
        self.logger.log(Status::Discard, DISCARDED, reason);
        Status::Discard
    }

    /// fmi2GetReal
    ///
    /// # Errors
    /// For value references that aren't those of reals.
    pub fn get_real(&mut self, references: impl Values, values: &mut [f64]) -> Answer<Status> {
        self.evaluate_for(Function::GetReal, Type::Real, references.clone())?;
        let own = &self.unit.references;
        // In Step Mode they are those of the end of the last step, whatever inputs were set since then.
        if self.phase != Phase::StepComplete && references.clone().any(|one| own.indicator(one).is_some()) {
            self.execution.find_indicators();
        }
        let (reals, indicators) = (&self.execution.block().reals, self.execution.known_indicators());
        let value = |reference| own.indicator(reference).map_or_else(|| reals[reference as usize], |k| indicators[k]);
        let broken = hand_out(references.clone().map(value), values);
        Ok(broken.map_or(Status::Ok, |(k, value)| {
            let what =
                format!("`{}`", references.clone().nth(k).map_or(String::new(), |reference| self.name(reference)));
            self.not_finite(Function::GetReal, &what, value)
        }))
    }

    /// fmi2SetReal
    ///
    /// # Errors
    /// For value references or values that can't be set; nothing is changed.
    pub fn set_real(&mut self, references: impl Values, values: &[f64]) -> Answer {
        for (reference, value) in references.clone().zip(values) {
            let (_, access) = self.place(Function::SetReal, reference, Type::Real)?;
            self.check_settable(Function::SetReal, reference, access)?;
            if !value.is_finite() {
                let name = self.name(reference);
                let function = self.called(Function::SetReal);
                return Err(Refused(format!("{function}: `{name}` = {} must be a finite number", Number(*value))));
            }
        }
        for (reference, &value) in references.zip(values) {
            let (place, _) = self.place(Function::SetReal, reference, Type::Real)?;
            self.execution.set_real(place, value);
        }
        Ok(())
    }

    /// fmi2GetInteger, fmi2GetBoolean: gives each value with its number.
    ///
    /// # Errors
    /// For value references of another type.
    pub fn get_integer(
        &mut self,
        function: Function,
        is: Type,
        references: impl Values,
        mut give: impl FnMut(usize, i32),
    ) -> Answer {
        self.evaluate_for(function, is, references.clone())?;
        for (k, reference) in references.enumerate() {
            let (place, _) = self.place(function, reference, is)?;
            give(k, self.execution.block().integers[place]);
        }
        Ok(())
    }

    /// fmi2SetInteger, fmi2SetBoolean
    ///
    /// # Errors
    /// For value references or values that can't be set; nothing is changed.
    pub fn set_integer(
        &mut self,
        function: Function,
        is: Type,
        references: impl Values,
        values: impl Iterator<Item = i64> + Clone,
    ) -> Answer {
        for (reference, value) in references.clone().zip(values.clone()) {
            let (place, access) = self.place(function, reference, is)?;
            self.check_settable(function, reference, access)?;
            if !i32::try_from(value).is_ok_and(|value| self.unit.references.holds(place, value)) {
                let items = self.items(reference);
                let name = self.name(reference);
                return Err(Refused(format!(
                    "{}: `{name}` = {value} is no item; there are {items}",
                    self.called(function)
                )));
            }
        }
        for (reference, value) in references.zip(values) {
            let (place, _) = self.place(function, reference, is)?;
            // What fits was looked at above.
            let value = if is == Type::Boolean { i32::from(value != 0) } else { value as i32 };
            if self.phase == Phase::ContinuousTime {
                // Parameters were refused, so this is an input.
                self.execution.set_integer_input_between_events(place, value);
            } else {
                self.execution.set_integer(place, value);
            }
        }
        Ok(())
    }
}

fn begun(unit: &Shared, interface: Interface) -> Execution {
    let mut execution = Execution::new(Arc::clone(&unit.model));
    if interface == Interface::ModelExchange {
        execution.hand_over_integration();
    }
    execution
}

/// Hands out numbers, all of them or, where one isn't finite, none: then its place, and what it is.
pub(crate) fn hand_out(found: impl Iterator<Item = f64> + Clone, values: &mut [f64]) -> Option<(usize, f64)> {
    let broken = found.clone().enumerate().find(|(_, number)| !number.is_finite());
    if broken.is_none() {
        values.iter_mut().zip(found).for_each(|(value, number)| *value = number);
    }
    broken
}
