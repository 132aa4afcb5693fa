//! The structure of a loop for given units: connected by the names of their signals, with a comment wherever a person
//! must decide.

mod given;
mod order;
mod smooth_start;
mod text;
mod unit;
mod wiring;

use std::path::Path;

use smooth_start::Starts;
pub use unit::{DraftUnit, Found};
use wiring::{Input, Wires};

use super::check;
use super::check::Circles;
use super::ssp::{LoopFiles, Structure};
use crate::error::Error;
use crate::model_description::{ModelDescription, Variable};

/// Where no unit proposes one: communication step and stop time, s.
const STEP: f64 = 1e-3;
const STOP_TIME: f64 = 10.0;

/// A variable: places of unit and variable.
type Signal = (usize, usize);

/// What a unit does in the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Role {
    Reference,
    Plant,
    /// A sensor, an observer or an actuator.
    Between,
    Controller,
}

/// What a user asks for.
#[derive(Debug, Clone, Default)]
pub struct Wishes {
    /// The loop's name.
    pub name: String,
    /// Communication step, s; the shortest that a unit proposes unless given.
    pub step: Option<f64>,
    /// Stop time, s; the latest that a unit proposes unless given.
    pub stop_time: Option<f64>,
    /// Connections in addition to those by names, or in place of them: input and output, as `component.variable`.
    pub connections: Vec<(String, String)>,
}

/// A loop that was wired.
#[derive(Debug)]
pub struct Draft {
    /// In the order in which they are stepped.
    units: Vec<DraftUnit>,
    roles: Vec<Role>,
    names: Vec<String>,
    wires: Wires,
    name: String,
    step: f64,
    stop_time: f64,
    /// Start values of components in this loop.
    starts: Vec<Starts>,
}

/// What was found of a draft's structure as a loop that is to run.
#[derive(Debug)]
pub struct Checked {
    /// What is to be known of it.
    pub notes: Vec<String>,
    /// Why it can't run as it stands.
    pub refusal: Option<Error>,
}

impl Draft {
    /// Wires units. Names in the loop are those that units have without the connections that are given.
    ///
    /// # Errors
    /// Connections that can't be made.
    pub fn new(units: Vec<DraftUnit>, wishes: Wishes) -> Result<Self, Error> {
        let mut wires = Wires::of(&units);
        let roles = order::roles(&units, &wires);
        let names = order::names(&units, &roles, &order::order(&units, &roles, &wires));
        given::connect(&mut wires, &units, &names, &wishes.connections)?;
        let roles = order::roles(&units, &wires);
        let places = order::order(&units, &roles, &wires);
        let wires = wires.moved(&places);
        let roles: Vec<_> = places.iter().map(|&place| roles[place]).collect();
        let mut units: Vec<_> = units.into_iter().map(Some).collect();
        let units: Vec<_> = places.iter().filter_map(|&place| units[place].take()).collect();
        let names = places.iter().map(|&place| names[place].clone()).collect();
        let proper = |number: &f64| number.is_finite() && *number > 0.0;
        let steps = units.iter().filter_map(|unit| unit.description.step).filter(proper);
        let stops = units.iter().filter_map(|unit| unit.description.stop_time).filter(proper);
        let step = wishes.step.or_else(|| steps.reduce(f64::min)).unwrap_or(STEP);
        let stop_time = wishes.stop_time.or_else(|| stops.reduce(f64::max)).unwrap_or(STOP_TIME);
        let starts = Vec::new();
        let draft = Draft { units, roles, names, wires, name: wishes.name, step, stop_time, starts };
        let starts = smooth_start::of(&draft);
        Ok(Draft { starts, ..draft })
    }

    /// The text of its SystemStructure.ssd.
    pub fn text(&self) -> String {
        text::structure(self)
    }

    /// How many inputs are connected.
    pub fn connected(&self) -> usize {
        self.wires.inputs.iter().filter(|(_, input)| matches!(input, Input::Connected { .. })).count()
    }

    /// Why components have other start values in this loop than by themselves.
    pub fn adapted(&self) -> impl Iterator<Item = &str> {
        self.starts.iter().map(|starts| starts.why.as_str())
    }

    /// The inputs that a person must decide about, by their names in the loop, and why.
    pub fn undecided(&self) -> impl Iterator<Item = (String, &str)> {
        self.wires.inputs.iter().filter_map(|(signal, input)| match input {
            Input::Open { reason, .. } => Some((self.shown(*signal), reason.as_str())),
            _ => None,
        })
    }

    /// The same, a line each.
    pub fn open(&self) -> Vec<String> {
        self.undecided().map(|(input, reason)| format!("`{input}`: {reason}")).collect()
    }

    /// The inputs that need no connection.
    pub fn unneeded(&self) -> Vec<String> {
        let unneeded = self.wires.inputs.iter().filter(|(_, input)| *input == Input::Unneeded);
        unneeded.map(|(signal, _)| self.shown(*signal)).collect()
    }

    /// Its text as a loop of a folder: whether types and units fit, and whether its circles have a delay.
    ///
    /// # Errors
    /// When it is no structure, as of two different descriptions of one name.
    pub fn check(&self, text: &str, folder: &Path) -> Result<Checked, Error> {
        let structure = Structure::parse(text, &LoopFiles::within(folder))?;
        let descriptions: Vec<&ModelDescription> = self.units.iter().map(|unit| &unit.description).collect();
        Ok(match check(&structure, &descriptions, Circles::Exchanged) {
            // Inputs without a connection are told of already.
            Ok(wiring) => {
                let told = |note: &String| !note.contains(" is not connected and stays at ");
                Checked { notes: wiring.notes.into_iter().filter(told).collect(), refusal: None }
            }
            Err(refusal) => Checked { notes: Vec::new(), refusal: Some(refusal) },
        })
    }

    fn variable(&self, (unit, variable): Signal) -> &Variable {
        &self.units[unit].description.variables[variable]
    }

    /// A signal's name in the loop.
    fn shown(&self, signal: Signal) -> String {
        format!("{}.{}", self.names[signal.0], self.variable(signal).name)
    }

    /// The connections, from outputs to inputs.
    fn connections(&self) -> impl Iterator<Item = (Signal, Signal)> {
        self.wires.connections()
    }
}
