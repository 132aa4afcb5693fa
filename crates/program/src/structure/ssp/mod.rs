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
    /// Description for the user.
    pub description: String,
    /// Components, in the order in which they are stepped.
    pub components: Vec<Component>,
    /// Descriptions that come with the loop, by the names of their FMUs.
    pub descriptions: BTreeMap<String, Source>,
    /// Connections.
    pub connections: Vec<Connection>,
    /// Start values of the composite's own parameters, each name once.
    pub whole: Vec<StartValue>,
    /// Parameter files that it names, by their paths in its folder.
    pub parameter_files: Vec<String>,
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// Order of stepping.
    pub order: Order,
    /// Order that the user asks for instead.
    pub asked_order: Option<Order>,
    /// True if separate components may close an algebraic loop.
    pub accepts_algebraic_loops: bool,
    /// Ideal models, simulated for comparison.
    pub models: Vec<IdealModel>,
    /// Metrics.
    pub metrics: Vec<Metric>,
    /// Plots.
    pub plots: Vec<Plot>,
    /// The failure that it is expected to end with, if any.
    pub expected_failure: Option<ExpectedFailure>,
    /// Default settings of tuning.
    pub tuning: Option<Tuning>,
    /// Values that variables get while it runs.
    pub events: Vec<Event>,
    /// Notes on choices that were made for it.
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

/// A component of the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Its name in the loop.
    pub name: String,
    /// Source attribute in the loop.
    pub source: String,
    /// Name of the FMU.
    pub fmu: String,
    /// Origin of the FMU.
    pub file: UnitFile,
    /// Variables that others may connect to.
    pub connectors: Vec<Connector>,
    /// Start values that differ from the FMU's own, each name once.
    pub values: Vec<StartValue>,
}

impl Component {
    /// Its archive; one that is taken by its name is in the given folder.
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
    /// Real, Integer, Boolean, String or Enumeration, if it is given.
    pub data_type: Option<String>,
    /// Its unit, if that is given; else the FMU's applies.
    pub unit: Option<UnitDefinition>,
    /// Line in the file.
    pub line: u32,
}

/// A start value.
#[derive(Debug, Clone, PartialEq)]
pub struct StartValue {
    /// Name of the variable.
    pub name: String,
    /// Real, Integer, Boolean, String or Enumeration; none if the variable decides.
    pub data_type: Option<String>,
    /// The value.
    pub text: String,
    /// Its unit, if that is given; else the variable's applies.
    pub unit: Option<UnitDefinition>,
    /// Its source, for messages.
    pub origin: Origin,
}

/// Source of a value, for messages.
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
    /// Source of the value.
    pub from: (String, String),
    /// Target of the value.
    pub to: (String, String),
    /// Transformation of the value, after the conversion of units.
    pub transformation: Affine,
    /// True if units are converted, and must be of one dimension.
    pub convert_units: bool,
    /// Line in the file.
    pub line: u32,
}

impl Structure {
    /// The component of a variable or signal of the loop, `component.variable`.
    pub fn unit_of(&self, name: &str) -> Option<&Component> {
        let is_of = |unit: &&Component| name.strip_prefix(&unit.name).is_some_and(|rest| rest.starts_with('.'));
        self.components.iter().filter(is_of).max_by_key(|unit| unit.name.len())
    }

    /// A standalone FMU as a loop without connections, named after its archive.
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

    /// A loop without components.
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

    /// Takes components from a folder of FMUs instead of resources or exports.
    pub fn take_from_folder(&mut self) {
        for component in &mut self.components {
            if !matches!(component.file, UnitFile::Archive { elsewhere: true, .. }) {
                component.file = UnitFile::Named;
            }
        }
    }

    /// Leaves components out: what was connected to them is open.
    ///
    /// # Errors
    /// For a name that no component has, and if none would be left.
    pub fn leave_out(&mut self, units: &[String]) -> Result<(), Error> {
        for unit in units {
            let Some(place) = self.components.iter().position(|component| component.name == *unit) else {
                let known = self.components.iter().map(|component| component.name.as_str());
                return Err(Error::unknown("component", unit, known, ""));
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

    /// The description of an FMU: the one that comes with the loop, or this package's.
    ///
    /// # Errors
    /// If there is none.
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

    /// A refusal with a line of its file.
    pub fn refuse(&self, line: u32, reason: &str) -> Error {
        Origin { file: self.file.clone(), line: Some(line) }.refuse(reason)
    }
}

impl Origin {
    /// True if it is an argument of a command.
    pub fn is_argument(&self) -> bool {
        self.file.to_string_lossy().starts_with("--")
    }

    /// A refusal of what was given at this place.
    pub fn refuse(&self, reason: &str) -> Error {
        let reason = self.line.map_or_else(|| reason.to_owned(), |line| format!("line {line}: {reason}"));
        let file = self.file.clone();
        match self.is_argument() {
            true => Error::Argument(Invalid::because(format!("{}: {reason}", file.display()))),
            false => Error::Loop { file, reason },
        }
    }
}
