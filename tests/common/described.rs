//! Models from descriptions as people write them.

use super::description;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};

pub fn model(text: &str) -> Result<Model, String> {
    let description = Description::read(text).map_err(|invalid| invalid.to_string())?;
    Model::from_description(description, REGISTRY).map_err(|invalid| invalid.to_string())
}

/// The text of a description of this package, with funnels that hold the error wherever its inputs put it within a few
/// units: where another law takes any inputs, one with a funnel has none for an error outside.
pub fn open_description(name: &str) -> String {
    let mut table: toml::Table = description(name).parse().unwrap();
    if let Some(start) = table.get_mut("start").and_then(toml::Value::as_table_mut) {
        for (name, wide) in [("rho_0", 10.0), ("decay_rate", 0.0)] {
            let values = start.get_mut(name).and_then(toml::Value::as_array_mut);
            values.into_iter().flatten().for_each(|value| *value = wide.into());
        }
        start.remove("funnel");
    }
    table.to_string()
}

/// Asserts that a description is refused in one line that names these things.
pub fn refused(text: &str, named: &[&str]) {
    let message = model(text).err().unwrap_or_else(|| panic!("this should be refused for {named:?}:\n{text}"));
    for name in named {
        assert!(message.contains(name), "`{message}` names `{name}`");
    }
    assert!(!message.contains('\n') && message.len() < 500, "a line that can be read: {message}");
}
