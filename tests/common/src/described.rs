//! Models from descriptions as people write them.

use super::description;
use adaptive_fmu::library::{self, REGISTRY};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::system::Variables;

pub fn model(text: &str) -> Result<Model, String> {
    let description = Description::read(text).map_err(|invalid| invalid.to_string())?;
    Model::from_description(description, REGISTRY).map_err(|invalid| invalid.to_string())
}

/// The text of a description of this package, with the start values by which its kind takes any inputs, as a law with a
/// funnel does where that is wide.
pub fn open_description(name: &str) -> String {
    let text = description(name);
    let unit = model(&text).unwrap();
    let mut table: toml::Table = text.parse().unwrap();
    let start = table.entry("start").or_insert_with(|| toml::Table::new().into()).as_table_mut().unwrap();
    let trial = library::find(&unit.description().model).map_or("", |entry| entry.trial.alone);
    for (key, value) in tried(unit.variables(), trial) {
        start.insert(key, value);
    }
    table.to_string()
}

/// The start values for tests that an FMU has. A vector gets a number for each element.
pub fn tried(variables: &Variables, lines: &str) -> toml::Table {
    let spread = |(key, value): (String, toml::Value)| {
        if variables.find(&key).is_some() {
            return Some((key, value));
        }
        let len = (1..).take_while(|i| variables.find(&format!("{key}[{i}]")).is_some()).count();
        (len > 0).then(|| (key, vec![value; len].into()))
    };
    lines.parse::<toml::Table>().unwrap().into_iter().filter_map(spread).collect()
}

/// Asserts that a description is refused in one line that names these things.
pub fn refused(text: &str, named: &[&str]) {
    let message = model(text).err().unwrap_or_else(|| panic!("this should be refused for {named:?}:\n{text}"));
    for name in named {
        assert!(message.contains(name), "`{message}` names `{name}`");
    }
    assert!(!message.contains('\n') && message.len() < 500, "a line that can be read: {message}");
}
