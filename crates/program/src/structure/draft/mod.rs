//! The structure of a loop for given FMUs: connected by the names of their signals, with a comment wherever the user
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
use super::check::AlgebraicLoops;
use super::ssp::{LoopFiles, Structure};
use crate::error::Error;
use crate::model_description::{ModelDescription, Variable};

/// Default communication step and stop time, s, if no FMU proposes them.
const STEP: f64 = 1e-3;
const STOP_TIME: f64 = 10.0;

/// A variable: places of component and variable.
type Signal = (usize, usize);

/// Role of a component in the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Role {
    Reference,
    Plant,
    /// A sensor, an observer or an actuator.
    Between,
    Controller,
}

/// Choices of the user.
#[derive(Debug, Clone, Default)]
pub struct Wishes {
    /// The loop's name.
    pub name: String,
    /// Communication step, s [default: the shortest that an FMU proposes].
    pub step: Option<f64>,
    /// Stop time, s [default: the latest that an FMU proposes].
    pub stop_time: Option<f64>,
    /// Connections in addition to those by names, or in place of them: input and output, as `component.variable`.
    pub connections: Vec<(String, String)>,
}

/// A loop that was wired.
#[derive(Debug)]
pub struct Draft {
    /// Components in the order in which they are stepped.
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

/// Result of checking a draft as a loop that is to run.
#[derive(Debug)]
pub struct Checked {
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Reason why it can't run as it is.
    pub refusal: Option<Error>,
}

impl Draft {
    /// Wires components. The given connections don't change their names in the loop.
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

    /// Number of connected inputs.
    pub fn connected(&self) -> usize {
        self.wires.inputs.iter().filter(|(_, input)| matches!(input, Input::Connected { .. })).count()
    }

    /// Reasons why components have other start values in this loop than as standalone FMUs.
    pub fn adapted(&self) -> impl Iterator<Item = &str> {
        self.starts.iter().map(|starts| starts.why.as_str())
    }

    /// The inputs that the user must decide about, by their names in the loop, and why.
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

    /// Checks its text as a loop of a folder: types, units, and algebraic loops.
    ///
    /// # Errors
    /// If it is no valid structure, for example because one name has two different descriptions.
    pub fn check(&self, text: &str, folder: &Path) -> Result<Checked, Error> {
        let structure = Structure::parse(text, &LoopFiles::within(folder))?;
        let descriptions: Vec<&ModelDescription> = self.units.iter().map(|unit| &unit.description).collect();
        Ok(match check(&structure, &descriptions, AlgebraicLoops::Exchanged) {
            // `undecided` and `unneeded` list the inputs without a connection.
            Ok(wiring) => {
                let is_shown = |note: &String| !note.contains(" is not connected and stays at ");
                Checked { notes: wiring.notes.into_iter().filter(is_shown).collect(), refusal: None }
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
