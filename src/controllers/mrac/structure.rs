//! The structure of a plain MRAC: that of an L1 controller, without what belongs to its filter.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use crate::controllers::l1::L1Structure;

/// Keys of an L1 controller that this one has no use for.
const OF_L1_ALONE: [&str; 4] = ["filter", "unmatched", "B_um", "commands"];
/// Keys that may be left out, and their values then.
const USUAL: [(&str, &str); 2] = [("regressor", "state"), ("input_gain", "diagonal")];

/// The description of the structure.
#[derive(Debug)]
pub struct PlainMracStructure {
    pub(super) of_l1: L1Structure,
}

impl<'de> Deserialize<'de> for PlainMracStructure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut table = toml::Table::deserialize(deserializer)?;
        if let Some(key) = OF_L1_ALONE.iter().find(|key| table.contains_key(**key)) {
            let reason =
                "this controller has no filter, cancels only matched uncertainty, and commands the control itself";
            return Err(D::Error::custom(format!("{key}: belongs to L1 controllers ({reason}). Leave it out")));
        }
        for (key, value) in USUAL {
            table.entry(key).or_insert_with(|| value.into());
        }
        let of_l1 = toml::Value::Table(table).try_into().map_err(D::Error::custom)?;
        Ok(PlainMracStructure { of_l1 })
    }
}

impl schemars::JsonSchema for PlainMracStructure {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "PlainMracStructure".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = L1Structure::json_schema(generator);
        if let Some(required) = schema.get_mut("required").and_then(serde_json::Value::as_array_mut) {
            required.retain(|key| USUAL.iter().all(|(known, _)| key.as_str() != Some(known)));
        }
        if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
            OF_L1_ALONE.iter().for_each(|key| drop(properties.remove(*key)));
        }
        schema
    }
}
