//! System Structure and Parameterization 1.0: loops as data, read from folders and archives, and packed.

mod annotation;
mod defaults;
mod event;
mod files;
mod followed;
mod parameters;
mod reader;
mod source;
mod structure;
mod system;
mod tuning;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use annotation::{ExpectedFailure, IdealModel, Metric, PerformanceFunction, Plot, Scale, Statistic};
pub use event::{Event, within_run};
pub use files::LoopFiles;
pub(super) use files::is_inside;
pub use followed::Tracked;
pub(super) use reader::parse;
pub use source::UnitFile;
pub use tuning::{SquareTerm, TunedParameter, Tuning};

use super::settings::{Order, Settings};
use crate::error::{Error, Invalid};
use crate::exporter::{Source, find_description};
use crate::fmu::Fmu;
use crate::model_description::{Affine, UnitDefinition};

/// Name of the file that every loop has.
pub const STRUCTURE: &str = crate::exporter::STRUCTURE_FILE;

/// A closed loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// The file it was read from, for messages.
    pub file: PathBuf,
    /// Its name.
    pub name: String,
    /// What it shows.
    pub description: String,
    /// Units, in the order in which they are stepped.
    pub components: Vec<Component>,
    /// Descriptions of units that lie beside it, by the names of their FMUs.
    pub descriptions: BTreeMap<String, Source>,
    /// Connections.
    pub connections: Vec<Connection>,
    /// Start values of what the loop has of its own where it is one unit, each name once.
    pub whole: Vec<StartValue>,
    /// Parameter files that it names, by their paths in its folder.
    pub parameter_files: Vec<String>,
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// When units see each other's new outputs.
    pub order: Order,
    /// What is asked for in place of that.
    pub asked_order: Option<Order>,
    /// True if separate units may close a circle that all of them pass through without a delay.
    pub accepts_algebraic_loops: bool,
    /// Ideal models, simulated beside the loop for comparison.
    pub models: Vec<IdealModel>,
    /// What is measured.
    pub metrics: Vec<Metric>,
    /// What is plotted.
    pub plots: Vec<Plot>,
    /// The failure that it is to end with, if it is to.
    pub expected_failure: Option<ExpectedFailure>,
    /// How it is tuned, unless the user says otherwise.
    pub tuning: Option<Tuning>,
    /// Values that variables get while it runs.
    pub events: Vec<Event>,
    /// What was chosen for it.
    pub notes: Vec<String>,
}

impl Structure {
    /// The signals that it names: those of metrics, plots and ideal models.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        let measured = self.metrics.iter().flat_map(|metric| [Some(&metric.of), metric.minus.as_ref()]).flatten();
        let plotted = self.plots.iter().flat_map(|plot| &plot.signals);
        let inputs = self.models.iter().map(|model| &model.input);
        measured.chain(plotted).chain(inputs).map(String::as_str)
    }
}

/// A unit of the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Its name in the loop.
    pub name: String,
    /// What the loop names as its source.
    pub source: String,
    /// Name of the FMU.
    pub fmu: String,
    /// Where that comes from.
    pub file: UnitFile,
    /// What others may connect to.
    pub connectors: Vec<Connector>,
    /// Start values that differ from the FMU's own, each name once.
    pub values: Vec<StartValue>,
}

impl Component {
    /// Its archive, where those that are taken by their names lie in a folder.
    pub fn path_in(&self, fmus: &Path) -> PathBuf {
        match &self.file {
            UnitFile::Archive { path, .. } => path.clone(),
            _ => fmus.join(format!("{}.fmu", self.fmu)),
        }
    }

    /// True if it is exported from a description, unless a folder of FMUs is given.
    pub fn is_exported(&self) -> bool {
        !matches!(self.file, UnitFile::Archive { .. })
    }
}

/// A variable of a component that others may connect to.
#[derive(Debug, Clone, PartialEq)]
pub struct Connector {
    /// Name of the variable.
    pub name: String,
    /// input, output, parameter, calculatedParameter or inout.
    pub kind: String,
    /// Real, Integer, Boolean, String or Enumeration, where it is told.
    pub data_type: Option<String>,
    /// Its unit, where that is told; else it is the FMU's.
    pub unit: Option<UnitDefinition>,
    /// Line in the file.
    pub line: u32,
}

/// A start value.
#[derive(Debug, Clone, PartialEq)]
pub struct StartValue {
    /// Name of the variable.
    pub name: String,
    /// Real, Integer, Boolean, String or Enumeration; none where the variable decides.
    pub data_type: Option<String>,
    /// The value.
    pub text: String,
    /// Its unit, where that is told; else it is the variable's.
    pub unit: Option<UnitDefinition>,
    /// Where it was given.
    pub origin: Origin,
}

/// Where something was given, for messages.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The file, or the argument.
    pub file: PathBuf,
    /// The line in it.
    pub line: Option<u32>,
}

/// A connection from an output to an input, by component and connector.
#[derive(Debug, Clone, PartialEq)]
pub struct Connection {
    /// Where the value comes from.
    pub from: (String, String),
    /// Where it goes.
    pub to: (String, String),
    /// What is made of it on the way, after the conversion of units.
    pub transformation: Affine,
    /// True if units are converted, and must be of one dimension.
    pub convert_units: bool,
    /// Line in the file.
    pub line: u32,
}

impl Structure {
    /// The unit that a variable or signal of the loop, `unit.variable`, is of.
    pub fn unit_of(&self, name: &str) -> Option<&Component> {
        let is_of = |unit: &&Component| name.strip_prefix(&unit.name).is_some_and(|rest| rest.starts_with('.'));
        self.components.iter().filter(is_of).max_by_key(|unit| unit.name.len())
    }

    /// A unit alone, as a loop without connections; its archive gives it its name.
    pub fn of_unit(fmu: &Fmu, settings: Settings, values: &[(String, String)], plots: Vec<Plot>) -> Self {
        let file = fmu.file().to_owned();
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let value = |(name, text): &(String, String)| StartValue {
            name: name.clone(),
            data_type: None,
            text: text.clone(),
            unit: None,
            origin: Origin { file: file.clone(), line: None },
        };
        let component = Component {
            name: name.clone(),
            source: file.display().to_string(),
            fmu: name.clone(),
            file: UnitFile::Named,
            connectors: Vec::new(),
            values: values.iter().map(value).collect(),
        };
        let bare = Self::bare(file, name, fmu.description.description.clone(), settings);
        Structure { components: vec![component], plots, ..bare }
    }

    /// A loop of no units.
    pub(crate) fn bare(file: PathBuf, name: String, description: String, settings: Settings) -> Self {
        let Settings { start_time, stop_time, step } = settings;
        Structure {
            file,
            name,
            description,
            components: Vec::new(),
            descriptions: BTreeMap::new(),
            connections: Vec::new(),
            whole: Vec::new(),
            parameter_files: Vec::new(),
            start_time,
            stop_time,
            step,
            order: Order::GaussSeidel,
            asked_order: None,
            accepts_algebraic_loops: false,
            models: Vec::new(),
            metrics: Vec::new(),
            plots: Vec::new(),
            expected_failure: None,
            tuning: None,
            events: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Takes all units from a folder of FMUs that would come from resources, or be exported.
    pub fn take_from_folder(&mut self) {
        for component in &mut self.components {
            if !matches!(component.file, UnitFile::Archive { elsewhere: true, .. }) {
                component.file = UnitFile::Named;
            }
        }
    }

    /// Leaves units out: what was connected to them is open.
    ///
    /// # Errors
    /// For a name that no unit has, and where none would be left.
    pub fn leave_out(&mut self, units: &[String]) -> Result<(), Error> {
        for unit in units {
            let Some(place) = self.components.iter().position(|component| component.name == *unit) else {
                let known = self.components.iter().map(|component| component.name.as_str());
                return Err(Error::unknown("unit", unit, known, ""));
            };
            self.components.remove(place);
            self.connections.retain(|connection| connection.from.0 != *unit && connection.to.0 != *unit);
            self.name.push_str(&format!("-without-{unit}"));
        }
        if self.components.is_empty() {
            return Err(Error::Loop { file: self.file.clone(), reason: "no component would be left".to_owned() });
        }
        Ok(())
    }

    /// The description of a unit: the one that lies beside the loop, or this package's.
    ///
    /// # Errors
    /// When there is none.
    pub fn description_of(&self, fmu: &str) -> Result<Source, Error> {
        self.descriptions.get(fmu).map_or_else(|| find_description(fmu), |source| Ok(source.clone()))
    }

    /// All start values that differ from the FMUs' own, by their names in the loop.
    pub fn all_values(&self) -> BTreeMap<String, String> {
        let units = self.components.iter().flat_map(|unit| unit.values.iter().map(move |value| (Some(unit), value)));
        let all = units.chain(self.whole.iter().map(|value| (None, value)));
        let name =
            |unit: Option<&Component>, name: &str| unit.map_or(name.to_owned(), |unit| format!("{}.{name}", unit.name));
        all.map(|(unit, value)| (name(unit, &value.name), value.text.clone())).collect()
    }

    /// A refusal of what stands in a line of its file.
    pub fn refuse(&self, line: u32, reason: &str) -> Error {
        Origin { file: self.file.clone(), line: Some(line) }.refuse(reason)
    }
}

impl Origin {
    /// True if it is an argument of a command.
    pub fn is_argument(&self) -> bool {
        self.file.to_string_lossy().starts_with("--")
    }

    /// A refusal of what was given there.
    pub fn refuse(&self, reason: &str) -> Error {
        let reason = self.line.map_or_else(|| reason.to_owned(), |line| format!("line {line}: {reason}"));
        let file = self.file.clone();
        match self.is_argument() {
            true => Error::Argument(Invalid::because(format!("{}: {reason}", file.display()))),
            false => Error::Loop { file, reason },
        }
    }
}
