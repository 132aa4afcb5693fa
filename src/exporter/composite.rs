//! The description of a whole loop as one unit, made from its structure and the descriptions of its units.

use std::path::Path;

use toml::{Table, Value};

use super::{Source, find_description};
use crate::error::Error;
use crate::model::Description;
use crate::simulation::{Component, Structure};
use crate::system::Kind;

/// Parameters about communication steps, of which a whole has none inside.
const ABOUT_STEPS: [&str; 4] = ["input_handling", "relative_tolerance", "on_step_failure", "integration_method"];

/// The name of a loop as one FMU: `Loop_3_2_1_cosine`.
pub fn composite_name(structure: &Structure) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    format!("Loop_{}", structure.name.chars().map(plain).collect::<String>())
}

/// The description of a loop as one FMU.
///
/// # Errors
/// When one of its units isn't of this package.
pub fn composite(structure: &Structure) -> Result<Source, Error> {
    let parts: Result<Vec<Value>, Error> =
        structure.components.iter().map(|unit| part(unit).map(Value::Table)).collect();
    let link = |(unit, connector): &(String, String)| Value::String(format!("{unit}.{connector}"));
    let links = structure.connections.iter().map(|c| Value::Array(vec![link(&c.from), link(&c.to)]));
    let mut inside = Table::new();
    inside.insert("connections".to_owned(), Value::Array(links.collect()));
    inside.insert("parts".to_owned(), Value::Array(parts?));
    let experiment = [("stop_time", structure.stop_time), ("step", structure.step)];
    let experiment = experiment.map(|(key, value)| (key.to_owned(), Value::Float(value)));
    let name = composite_name(structure);
    let mut description = Table::new();
    description.insert("name".to_owned(), Value::String(name.clone()));
    description.insert("model".to_owned(), Value::String(Kind::COMPOSITE.name.to_owned()));
    description.insert("description".to_owned(), Value::String(format!("{}, as one unit", structure.description)));
    description.insert("experiment".to_owned(), Value::Table(experiment.into_iter().collect()));
    description.insert("structure".to_owned(), Value::Table(inside));
    Ok(Source { file: Path::new(&format!("{name}.toml")).to_owned(), text: description.to_string() })
}

/// A unit as a part: its description, with the loop's start values.
fn part(unit: &Component) -> Result<Table, Error> {
    let source = find_description(&unit.fmu)?;
    let refuse =
        |reason: crate::error::Invalid| Error::Description { file: source.file.clone(), reason: reason.to_string() };
    let description = Description::read(&source.text).map_err(refuse)?;
    let mut start = description.start;
    for (name, value) in unit.values.iter().filter(|(name, _)| !ABOUT_STEPS.contains(&name.as_str())) {
        start.insert(name.clone(), value_of(value));
    }
    start.retain(|name, _| !ABOUT_STEPS.contains(&name));
    let mut part = Table::new();
    part.insert("name".to_owned(), Value::String(unit.name.clone()));
    part.insert("model".to_owned(), Value::String(description.model));
    part.insert("structure".to_owned(), Value::Table(description.structure));
    part.insert("start".to_owned(), Value::Table(start));
    Ok(part)
}

/// A value from its text: a number, true or false, or the name of an item.
fn value_of(text: &str) -> Value {
    if let Ok(integer) = text.parse() {
        return Value::Integer(integer);
    }
    match (text.parse(), text) {
        (Ok(number), _) => Value::Float(number),
        (_, "true") => Value::Boolean(true),
        (_, "false") => Value::Boolean(false),
        _ => Value::String(text.to_owned()),
    }
}
