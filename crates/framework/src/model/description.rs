//! The description of a unit, as a person writes it.

use serde::{Deserialize, Serialize};

use crate::error::{Invalid, Number};
use crate::near;
use crate::nominal::NominalPlant;
use crate::system::{Names, Word, Words};

/// Versions of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Standard {
    /// FMI 2.0
    #[default]
    Fmi2,
    /// FMI 3.0
    Fmi3,
}

impl Standard {
    /// Every version that FMUs are exported in.
    pub const ALL: [Standard; 2] = [Standard::Fmi2, Standard::Fmi3];

    /// The version as modelDescription.xml has it.
    pub fn version(self) -> &'static str {
        match self {
            Standard::Fmi2 => "2.0",
            Standard::Fmi3 => "3.0",
        }
    }

    /// Beginning of the names of its functions and constants.
    pub fn prefix(self) -> &'static str {
        match self {
            Standard::Fmi2 => "fmi2",
            Standard::Fmi3 => "fmi3",
        }
    }
}

/// The description of an FMU, as a person writes it (`modelDescription/NAME.toml`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Name of the FMU: a C identifier.
    pub name: String,
    /// Its system: the name of a kind.
    pub model: String,
    /// The unit in one line.
    pub description: String,
    /// Author of the unit.
    #[serde(default)]
    pub author: Option<String>,
    /// Its version, as its author counts.
    #[serde(default)]
    pub version: Option<String>,
    /// Terms of use: a name, or an SPDX expression, as "MIT OR Apache-2.0".
    #[serde(default)]
    pub license: Option<String>,
    /// Holder of the rights: "Copyright 2026 …".
    #[serde(default)]
    pub copyright: Option<String>,
    /// Default experiment.
    #[serde(default)]
    pub experiment: Experiment,
    /// Sizes, matrices and choices that the system's variables follow from.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, serde_json::Value>"))]
    pub structure: toml::Table,
    /// Names of one's own for variables, by the system's names of them.
    #[serde(default)]
    pub names: Names,
    /// Start values that differ from the system's own.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, StartValue>"))]
    pub start: toml::Table,
    /// Usual magnitudes of variables that differ from the system's own: what tolerances of their errors are relative to.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, Magnitude>"))]
    pub magnitudes: toml::Table,
    /// The plant that the controller was designed for. It makes no variables; the design report and the page read it.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "NominalPlant"))]
    pub nominal: Option<NominalPlant>,
    /// Version of the standard, 2 or 3, where the unit isn't of FMI 2.0. Written by an export.
    #[serde(default)]
    pub fmi: Option<u8>,
    /// Parameters that are constants of this unit: those that its design was computed from. Written by an export with sources.
    #[serde(default)]
    pub designed: Option<Vec<String>>,
}

/// A start value.
#[cfg(feature = "schema")]
#[derive(schemars::JsonSchema)]
#[schemars(untagged)]
#[allow(dead_code)] // for the schema only: what fits a variable is decided where it is declared
enum StartValue {
    /// A scalar, or one element.
    Number(f64),
    /// True or false.
    Boolean(bool),
    /// An item of a choice.
    Text(String),
    /// A vector.
    Numbers(Vec<f64>),
    /// A matrix: its rows.
    Rows(Vec<Vec<f64>>),
}

/// A usual magnitude.
#[cfg(feature = "schema")]
#[derive(schemars::JsonSchema)]
#[schemars(untagged)]
#[allow(dead_code)] // for the schema only
enum Magnitude {
    /// A scalar, or one element.
    Number(f64),
    /// A vector.
    Numbers(Vec<f64>),
    /// A matrix: its rows.
    Rows(Vec<Vec<f64>>),
}

/// The default experiment.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Experiment {
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
}

impl Default for Experiment {
    fn default() -> Self {
        Experiment { stop_time: 10.0, step: 1e-3 }
    }
}

impl Description {
    /// The version of the standard that its unit is of.
    pub fn standard(&self) -> Standard {
        if self.fmi == Some(3) { Standard::Fmi3 } else { Standard::Fmi2 }
    }

    /// Reads a description.
    ///
    /// # Errors
    /// One line: what is wrong, where, and what is allowed.
    pub fn read(text: &str) -> Result<Self, Invalid> {
        let description: Description =
            toml::from_str(text).map_err(|error| Invalid::because(near::in_line(text, &error)))?;
        let mut invalid = Invalid::none();
        for table in [&description.structure, &description.start] {
            table.values().for_each(|value| check_texts(value, &mut invalid));
        }
        check_text(&description.description, &mut invalid);
        for (key, text) in description.about() {
            text.into_iter().for_each(|text| check_line(key, text, &mut invalid));
        }
        let words = description.names.values().flat_map(Words::each);
        words.filter_map(Word::description).for_each(|text| check_text(text, &mut invalid));
        let name = &description.name;
        let starts_well = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
        if !starts_well || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') || name.len() > 100 {
            let allowed = "must be a C identifier of at most 100 characters (letters, digits, _)";
            invalid.and(Invalid::new("name", format!("`{}`", name.escape_debug()), allowed));
        }
        if let Some(version) = description.fmi.filter(|version| ![2, 3].contains(version)) {
            invalid.and(Invalid::new("fmi", version, "must be 2 or 3"));
        }
        let Experiment { stop_time, step } = description.experiment;
        for (key, value) in [("experiment.stop_time", stop_time), ("experiment.step", step)] {
            if !(value.is_finite() && value > 0.0) {
                invalid.and(Invalid::new(key, Number(value), "must be a finite number above 0"));
            }
        }
        invalid.into_result()?;
        Ok(description)
    }

    /// Author, licence and the like of the FMU, by their attributes in the XML, which are the keys.
    pub fn about(&self) -> impl Iterator<Item = (&'static str, Option<&str>)> {
        let Description { author, version, license, copyright, .. } = self;
        let texts = [("author", author), ("version", version), ("license", license), ("copyright", copyright)];
        texts.into_iter().map(|(key, text)| (key, text.as_deref()))
    }
}

/// The longest text about a unit, in characters.
const LONGEST_LINE: usize = 200;

/// Refuses what is no line of text.
fn check_line(key: &str, text: &str, invalid: &mut Invalid) {
    let bad = |c: char| c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}');
    if text.trim().is_empty() || text.trim() != text || text.contains(bad) || text.chars().count() > LONGEST_LINE {
        let shown: String = text.escape_debug().take(80).collect();
        let allowed = format!(
            "must be one line of 1 … {LONGEST_LINE} characters without leading or trailing spaces; leave the key out \
             if it is not needed"
        );
        invalid.and(Invalid::new(key, format!("`{shown}`"), allowed));
    }
}

/// Refuses texts that XML can't hold: control characters and noncharacters.
fn check_text(text: &str, invalid: &mut Invalid) {
    let bad = |c: &char| c.is_control() && !matches!(c, '\t' | '\n' | '\r') || matches!(c, '\u{fffe}' | '\u{ffff}');
    if text.chars().any(|c| bad(&c)) {
        let shown: String = text.escape_default().take(80).collect();
        invalid.and(Invalid::because(format!(
            "the text `{shown}` contains a control character, which XML does not allow"
        )));
    }
}

fn check_texts(value: &toml::Value, invalid: &mut Invalid) {
    match value {
        toml::Value::String(text) => check_text(text, invalid),
        toml::Value::Array(values) => values.iter().for_each(|value| check_texts(value, invalid)),
        toml::Value::Table(table) => table.values().for_each(|value| check_texts(value, invalid)),
        _ => {}
    }
}
