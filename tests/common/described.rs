//! Models from descriptions as people write them.

use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};

pub fn model(text: &str) -> Result<Model, String> {
    let description = Description::read(text).map_err(|invalid| invalid.to_string())?;
    Model::from_description(description, REGISTRY).map_err(|invalid| invalid.to_string())
}

/// Asserts that a description is refused in one line that names these things.
pub fn refused(text: &str, named: &[&str]) {
    let message = model(text).err().unwrap_or_else(|| panic!("this should be refused for {named:?}:\n{text}"));
    for name in named {
        assert!(message.contains(name), "`{message}` names `{name}`");
    }
    assert!(!message.contains('\n') && message.len() < 500, "a line that can be read: {message}");
}
