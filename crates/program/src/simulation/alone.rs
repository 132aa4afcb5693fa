//! A single FMU in co-simulation or model exchange, with inputs over time.

use std::sync::Arc;

use super::changes::ROUNDING;
use super::closed_loop::LoggedMessages;
use super::exchange::Exchange;
use super::inputs::Inputs;
use super::loaded::may_change;
use super::port::{Ports, signals};
use super::recording::Recording;
use crate::error::Error;
use crate::fmi2::calls::Interface;
use crate::fmu::{Fmu, Instance, SHOWS_VARIABLES, Value, set_starts, typed, within_limits};
use crate::model_description::Affine;
use crate::model_description::{ModelDescription, ModelStructure, Variable};
use crate::near;
use crate::structure::{Event, Settings};

/// A run of a single FMU.
#[derive(Debug)]
pub struct Alone<'a> {
    /// The unit.
    pub fmu: &'a Arc<Fmu>,
    /// Its interface.
    pub interface: Interface,
    /// Relative tolerance of the integration in model exchange.
    pub tolerance: f64,
    /// Start values.
    pub start: &'a [(String, String)],
    /// Inputs over time.
    pub inputs: Option<&'a Inputs>,
    /// Variables that are recorded in addition to the outputs.
    pub further: &'a [String],
    /// Values that variables get during the run, in the order of their times.
    pub events: &'a [AloneEvent],
}

/// A value that a variable of a unit gets during a run.
#[derive(Debug, Clone, PartialEq)]
pub struct AloneEvent {
    time: f64,
    reference: u32,
    value: Value,
}

impl AloneEvent {
    /// Events of an FMU some of whose inputs have values over time, in the order of their times.
    ///
    /// # Errors
    /// An event of a variable that doesn't exist, can't change during a run, or can't have the value.
    pub fn all(events: &[Event], description: &ModelDescription, inputs: Option<&Inputs>) -> Result<Vec<Self>, Error> {
        let one = |Event { time, name, text, origin }: &Event| {
            let refuse = |reason: String| origin.refuse(&reason);
            let known = |variable: &&Variable| may_change(variable, None).is_ok();
            let variable = description.variable(name).ok_or_else(|| {
                let known: Vec<_> = description.variables.iter().filter(known).map(|v| v.name.as_str()).collect();
                refuse(format!("there is no `{name}` that may change during a run; {}", near::choice(name, &known, "")))
            })?;
            let has_course = inputs.is_some_and(|inputs| inputs.has(variable.reference));
            may_change(variable, has_course.then_some("--input has values for it"))
                .map_err(|reason| refuse(format!("`{name}` can't change during a run: {reason}")))?;
            let value = typed(text, variable).and_then(|value| within_limits(value, variable));
            let value = value.map_err(|reason| refuse(format!("`{name}` = {text}: {reason}")))?;
            Ok(AloneEvent { time: *time, reference: variable.reference, value })
        };
        let mut all = events.iter().map(one).collect::<Result<Vec<_>, Error>>()?;
        all.sort_by(|a, b| a.time.total_cmp(&b.time));
        Ok(all)
    }
}

enum Running<'a> {
    CoSimulation(Instance),
    Exchange(Box<Exchange<'a>>),
}

impl Alone<'_> {
    /// Runs the FMU. `progress` gets the time, and may end the run by returning false.
    ///
    /// # Errors
    /// When the FMU fails, together with what was recorded until then.
    pub fn run(
        &self,
        settings: Settings,
        mut progress: impl FnMut(f64) -> bool,
    ) -> Result<Recording, (Error, Box<Recording>)> {
        let mut recording = Recording::default();
        match self.run_into(&mut recording, settings, &mut progress) {
            Ok(()) => Ok(recording),
            Err(error) => Err((error, Box::new(recording))),
        }
    }

    fn run_into(
        &self,
        recording: &mut Recording,
        settings: Settings,
        progress: &mut impl FnMut(f64) -> bool,
    ) -> Result<(), Error> {
        let mut ports = self.ports(recording)?;
        let mut row = vec![0.0; recording.names.len()];
        let Settings { start_time, stop_time, .. } = settings;
        let (mut running, mut logged) = (self.begun(start_time, stop_time)?, LoggedMessages::default());
        let name = &self.fmu.description.name;
        ports.give(running.instance(), &mut row)?;
        recording.push(start_time, &row);
        let mut events = self.events.iter().peekable();
        for (time, next) in settings.points() {
            let is_due = |event: &&AloneEvent| event.time <= time + ROUNDING * (next - time);
            let due: Vec<_> =
                std::iter::from_fn(|| events.next_if(is_due)).map(|it| (it.reference, it.value.clone())).collect();
            running.change(&due)?;
            running.advance(self.inputs, time, next)?;
            ports.give(running.instance(), &mut row)?;
            recording.push(next, &row);
            logged.keep(name, &running.instance().messages(), &mut recording.warnings);
            if !progress(next) {
                break;
            }
        }
        let instance = running.into_instance();
        instance.terminate()?;
        logged.keep(name, &instance.messages(), &mut recording.warnings);
        let freed = instance.free();
        if let Ok(messages) = &freed {
            logged.keep(name, messages, &mut recording.warnings);
        }
        logged.end(name, recording);
        freed.map(drop)
    }

    /// Variables that are recorded; their names are added to the recording.
    fn ports(&self, recording: &mut Recording) -> Result<Ports, Error> {
        let description = &self.fmu.description;
        let mut places: Vec<usize> = signals(description).map(|(place, _)| place).collect();
        for name in self.further {
            let place = description.place(name).filter(|&place| description.variables[place].kind != "String");
            let place = place.ok_or_else(|| {
                let known = description.variables.iter().map(|variable| variable.name.as_str());
                Error::unknown("variable", name, known, SHOWS_VARIABLES)
            })?;
            if !places.contains(&place) {
                places.push(place);
            }
        }
        let mut ports = Ports::default();
        for (column, place) in places.into_iter().enumerate() {
            let variable = &description.variables[place];
            ports.add(variable, column, Affine::IDENTITY);
            recording.names.push(variable.name.clone());
            recording.measures.push(variable.unit.clone().unwrap_or_default());
            recording.columns.push(Vec::new());
        }
        Ok(ports)
    }

    /// An instance with start values and inputs, initialised.
    fn begun(&self, start: f64, stop: f64) -> Result<Running<'_>, Error> {
        let (fmu, name) = (self.fmu, &self.fmu.description.name);
        let mut instance = match self.interface {
            Interface::CoSimulation => fmu.instantiate(name)?,
            Interface::ModelExchange => fmu.instantiate_for_exchange(name)?,
        };
        set_starts(&instance, self.start)?;
        instance.enter_initialization(start, stop)?;
        if let Some(inputs) = self.inputs {
            inputs.set(&instance, start)?;
        }
        instance.exit_initialization()?;
        if self.interface == Interface::CoSimulation {
            return Ok(Running::CoSimulation(instance));
        }
        let refuse = |reason: String| Error::Archive { file: fmu.file().to_owned(), reason };
        let structure = ModelStructure::read(fmu.text()).map_err(refuse)?;
        let counts = (structure.states.len(), structure.indicators);
        Ok(Running::Exchange(Box::new(Exchange::begin(instance, self.inputs, counts, self.tolerance, start)?)))
    }
}

impl Running<'_> {
    fn instance(&self) -> &Instance {
        match self {
            Running::CoSimulation(instance) => instance,
            Running::Exchange(exchange) => exchange.instance(),
        }
    }

    fn into_instance(self) -> Instance {
        match self {
            Running::CoSimulation(instance) => instance,
            Running::Exchange(exchange) => exchange.into_instance(),
        }
    }

    /// Sets values of variables at the present time.
    fn change(&mut self, changes: &[(u32, Value)]) -> Result<(), Error> {
        match self {
            _ if changes.is_empty() => Ok(()),
            Running::CoSimulation(instance) => {
                changes.iter().try_for_each(|(reference, value)| instance.set_start(*reference, value))
            }
            Running::Exchange(exchange) => exchange.event(changes),
        }
    }

    fn advance(&mut self, inputs: Option<&Inputs>, time: f64, next: f64) -> Result<(), Error> {
        match self {
            Running::CoSimulation(instance) => {
                inputs.map_or(Ok(()), |inputs| inputs.set(instance, time))?;
                instance.do_step(time, next - time)
            }
            Running::Exchange(exchange) => exchange.advance(next),
        }
    }
}
