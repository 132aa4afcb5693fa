//! Provenance of results: enough to repeat a run, and to notice changes since then.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::Error;
use crate::fmu::{self, own_start};
use crate::model_description::{ModelDescription, Variable};
use crate::sealed::{checksum_of_file, differences};
use crate::simulation::{LoadedLoop, LoadedUnit};
use crate::structure::ABOUT_STEPS;
use crate::{SOURCE, library};

/// Version of the format of results, which increases if the meaning of something in them changes.
pub const FORMAT: u32 = 1;

/// Provenance of a run's results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Versions of the program and its library.
    pub versions: Versions,
    /// The loop as the user named it, and the checksum of its structure, parameter sets and descriptions.
    pub source: Mark,
    /// Settings of the run.
    pub settings: Asked,
    /// Its components by their names.
    pub units: BTreeMap<String, UnitMark>,
}

/// Versions of the software that computed results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// The program's version.
    pub program: String,
    /// The checksum of the sources of its library.
    pub sources: String,
    /// Version of the results' format.
    pub format: u32,
}

impl Versions {
    /// Versions of this program.
    pub fn own() -> Self {
        let (program, sources) = (env!("CARGO_PKG_VERSION").to_owned(), format!("{}-{SOURCE}", library::SOURCE));
        Versions { program, sources, format: FORMAT }
    }
}

/// A file and the checksum of its content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Its name, as the user gave it.
    pub name: PathBuf,
    /// SHA-256.
    pub checksum: String,
}

impl Mark {
    /// Returns the mark of a file as it is now.
    ///
    /// # Errors
    /// If it can't be read.
    pub fn of(file: &Path) -> Result<Self, Error> {
        Ok(Mark { name: file.to_owned(), checksum: checksum_of_file(file)? })
    }
}

/// Settings by the user, completed by the loop's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// Order of stepping; none for a composite.
    pub order: Option<String>,
    /// True if the loop is run as a single FMU.
    pub composite: bool,
    /// True if algebraic loops are accepted.
    pub accept_algebraic_loops: bool,
    /// Parameter sets, in the order in which they apply.
    pub cases: Vec<Mark>,
    /// Single values, `component.variable=value`.
    pub set: Vec<String>,
    /// Events, `time: component.variable=value`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
    /// Folder of FMUs that are used as they are.
    pub fmus: Option<PathBuf>,
    /// True if FMUs of other tools run in the program's process.
    pub in_process: bool,
    /// Longest time of a call of another tool's FMU, s.
    pub patience: f64,
}

/// A component in a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnitMark {
    /// Name of its FMU.
    pub fmu: String,
    /// The FMU's GUID.
    pub guid: String,
    /// The archive of an FMU that was used as it is.
    pub file: Option<Mark>,
    /// Start values that differ from the FMU's own.
    pub parameters: BTreeMap<String, Value>,
    /// Settings of the integration, for an FMU of this package.
    pub integration: BTreeMap<String, Value>,
    /// Evaluation of the equations, for an FMU of this package. It doesn't change results.
    #[serde(default)]
    pub evaluated: Option<String>,
}

impl UnitMark {
    /// Updates how the equations of components are evaluated, as far as it is known by now.
    pub fn note_evaluated(marks: &mut BTreeMap<String, Self>, loaded: &LoadedLoop) {
        for unit in loaded.units() {
            marks.entry(unit.name.clone()).and_modify(|mark| mark.evaluated = unit.fmu.evaluated());
        }
    }

    /// The marks of all components by their names. `is_elsewhere` is true for those whose archives were used directly.
    ///
    /// # Errors
    /// If an archive can't be read any more.
    pub fn all(loaded: &LoadedLoop, is_elsewhere: impl Fn(&str) -> bool) -> Result<BTreeMap<String, Self>, Error> {
        // An archive of several components is read once.
        let mut known: HashMap<&Path, Mark> = HashMap::new();
        let mut marked = BTreeMap::new();
        for unit in loaded.units() {
            let file = is_elsewhere(&unit.name).then(|| unit.fmu.file());
            if let Some(file) = file.filter(|file| !known.contains_key(file)) {
                known.insert(file, Mark::of(file)?);
            }
            let mark = file.and_then(|file| known.get(file).cloned());
            marked.insert(unit.name.clone(), Self::of(unit, mark));
        }
        Ok(marked)
    }

    /// The mark of a component, with its archive if that is used as it is.
    fn of(unit: &LoadedUnit, file: Option<Mark>) -> Self {
        let ModelDescription { name, guid, variables, .. } = &unit.fmu.description;
        let differs = |(place, value): &&(usize, fmu::Value)| own_start(&variables[*place]).as_ref() != Some(value);
        let parameter = |(place, value): &(usize, fmu::Value)| {
            (variables[*place].name.clone(), value_json(value, &variables[*place]))
        };
        let integration = ABOUT_STEPS.iter().filter_map(|name| {
            let place = unit.fmu.description.place(name)?;
            Some(((*name).to_owned(), value_json(&unit.value(place)?, &variables[place])))
        });
        UnitMark {
            fmu: name.clone(),
            guid: guid.clone(),
            file,
            parameters: unit.values.iter().filter(differs).map(parameter).collect(),
            integration: integration.collect(),
            evaluated: unit.fmu.evaluated(),
        }
    }
}

/// A value as results show it: an enumeration's is the name of the item.
fn value_json(value: &fmu::Value, variable: &Variable) -> Value {
    match value {
        fmu::Value::Real(number) => (*number).into(),
        fmu::Value::Integer(number) => match variable.items.iter().find(|(_, item)| item == number) {
            Some((name, _)) => name.clone().into(),
            None => (*number).into(),
        },
        fmu::Value::Boolean(value) => (*value).into(),
        fmu::Value::String(text) => text.clone().into(),
    }
}

impl Provenance {
    /// Differences from an earlier run, as text. Evaluation of equations is left out, since it doesn't change results.
    pub fn differences(&self, earlier: &Self) -> Vec<String> {
        let json = |it: &Self| {
            let mut it = it.clone();
            it.units.values_mut().for_each(|unit| unit.evaluated = None);
            serde_json::to_value(it).unwrap_or_default()
        };
        differences(&json(earlier), &json(self))
    }
}
