//! One unit alone, in co-simulation or model exchange, with inputs over time.

use std::sync::Arc;

use super::closed_loop::Said;
use super::exchange::Exchange;
use super::inputs::Inputs;
use super::port::{Ports, signals};
use super::recording::Recording;
use crate::error::Error;
use crate::fmi2::calls::Interface;
use crate::fmu::{Fmu, Instance, SHOWS_VARIABLES, set_starts};
use crate::model_description::Affine;
use crate::model_description::ModelStructure;
use crate::structure::Settings;

/// What is run, and how.
#[derive(Debug)]
pub struct Alone<'a> {
    /// The unit.
    pub fmu: &'a Arc<Fmu>,
    /// By which interface.
    pub interface: Interface,
    /// Relative tolerance of the integration in model exchange.
    pub tolerance: f64,
    /// Start values.
    pub start: &'a [(String, String)],
    /// Inputs over time.
    pub inputs: Option<&'a Inputs>,
    /// What is recorded beside the outputs.
    pub further: &'a [String],
}

enum Running<'a> {
    CoSimulation(Instance),
    Exchange(Box<Exchange<'a>>),
}

impl Alone<'_> {
    /// Runs the unit. `progress` is told the time, and may end the run by answering false.
    ///
    /// # Errors
    /// When the unit fails, together with what was recorded until then.
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
        let (mut running, mut said) = (self.begun(start_time, stop_time)?, Said::default());
        let name = &self.fmu.description.name;
        ports.give(running.instance(), &mut row)?;
        recording.push(start_time, &row);
        for (time, next) in settings.points() {
            running.advance(self.inputs, time, next)?;
            ports.give(running.instance(), &mut row)?;
            recording.push(next, &row);
            said.keep(name, &running.instance().messages(), &mut recording.warnings);
            if !progress(next) {
                break;
            }
        }
        let instance = running.into_instance();
        instance.terminate()?;
        said.keep(name, &instance.messages(), &mut recording.warnings);
        let freed = instance.free();
        if let Ok(messages) = &freed {
            said.keep(name, messages, &mut recording.warnings);
        }
        said.end(name, recording);
        freed.map(drop)
    }

    /// What is recorded; the recording has their names then.
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
