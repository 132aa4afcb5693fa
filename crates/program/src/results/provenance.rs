//! How a run came to its numbers: enough to run it again, and to notice what has changed since.

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

/// Number of the form in which results are written; it grows when the meaning of something in them changes.
pub const FORMAT: u32 = 1;

/// How a run came to its numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// What made it.
    pub versions: Versions,
    /// The loop as the user named it, and the checksum of its structure, parameter sets and descriptions.
    pub source: Mark,
    /// How it was run.
    pub settings: Asked,
    /// Its units by their names.
    pub units: BTreeMap<String, UnitMark>,
}

/// Versions of what made results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// The program's version.
    pub program: String,
    /// The checksum of the sources of its library.
    pub sources: String,
    /// The form of the results.
    pub format: u32,
}

impl Versions {
    /// Those of this program.
    pub fn own() -> Self {
        let (program, sources) = (env!("CARGO_PKG_VERSION").to_owned(), format!("{}-{SOURCE}", library::SOURCE));
        Versions { program, sources, format: FORMAT }
    }
}

/// A file, and the checksum of what it holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Its name, as the user gave it.
    pub name: PathBuf,
    /// SHA-256.
    pub checksum: String,
}

impl Mark {
    /// Of a file as it is.
    ///
    /// # Errors
    /// When it can't be read.
    pub fn of(file: &Path) -> Result<Self, Error> {
        Ok(Mark { name: file.to_owned(), checksum: checksum_of_file(file)? })
    }
}

/// What the user asked for, with the loop's own settings where nothing was asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// Order of the units; none where they are one.
    pub order: Option<String>,
    /// True if the loop is run as one unit.
    pub composite: bool,
    /// True if circles without a delay are run.
    pub accept_algebraic_loops: bool,
    /// Parameter sets, in the order in which they apply.
    pub cases: Vec<Mark>,
    /// Single values, `unit.variable=value`.
    pub set: Vec<String>,
    /// Events, `time: unit.variable=value`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
    /// Folder of FMUs that are used as they are.
    pub fmus: Option<PathBuf>,
    /// True if units of other tools run in the program's process.
    pub in_process: bool,
    /// Longest time that a call of another tool's unit may take, s.
    pub patience: f64,
}

/// A unit in a run.
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
    /// How it is integrated, of a unit of this package.
    pub integration: BTreeMap<String, Value>,
    /// How its equations are evaluated, of a unit of this package: the numbers are the same.
    #[serde(default)]
    pub evaluated: Option<String>,
}

impl UnitMark {
    /// Tells how the equations of units are evaluated, as far as it is known by now.
    pub fn tell_evaluated(marks: &mut BTreeMap<String, Self>, loaded: &LoadedLoop) {
        for unit in loaded.units() {
            marks.entry(unit.name.clone()).and_modify(|mark| mark.evaluated = unit.fmu.evaluated());
        }
    }

    /// The marks of all units by their names; a function says of which the archives were used as they are.
    ///
    /// # Errors
    /// When an archive can't be read any more.
    pub fn all(loaded: &LoadedLoop, is_elsewhere: impl Fn(&str) -> bool) -> Result<BTreeMap<String, Self>, Error> {
        // However many units are of an archive, it is read once.
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

    /// The mark of a unit, with its archive, where that is used as it is.
    fn of(unit: &LoadedUnit, file: Option<Mark>) -> Self {
        let ModelDescription { name, guid, variables, .. } = &unit.fmu.description;
        let differs = |(place, value): &&(usize, fmu::Value)| own_start(&variables[*place]).as_ref() != Some(value);
        let parameter =
            |(place, value): &(usize, fmu::Value)| (variables[*place].name.clone(), told(value, &variables[*place]));
        let integration = ABOUT_STEPS.iter().filter_map(|name| {
            let place = unit.fmu.description.place(name)?;
            Some(((*name).to_owned(), told(&unit.value(place)?, &variables[place])))
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

/// A value as results tell it: an enumeration's by the name of the item.
fn told(value: &fmu::Value, variable: &Variable) -> Value {
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
    /// What differs from an earlier run, in words. How equations are evaluated is no matter of results.
    pub fn differences(&self, earlier: &Self) -> Vec<String> {
        let told = |it: &Self| {
            let mut it = it.clone();
            it.units.values_mut().for_each(|unit| unit.evaluated = None);
            serde_json::to_value(it).unwrap_or_default()
        };
        differences(&told(earlier), &told(self))
    }
}
