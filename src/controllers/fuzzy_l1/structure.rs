//! The structure of an L1 controller with a fuzzy gain: that of an L1 controller, and what its channels share.

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};

use crate::controllers::fuzzy_gain::Sharing;
use crate::controllers::l1::{L1Structure, PlantMatrices, enters_rates};
use crate::system::Invalid;

/// The key of what channels share of the weights, and what it is.
pub(super) const WEIGHTS: [&str; 2] =
    ["fuzzy_weights", "Whether channels share one `k_p`, `k_d` and `k_e`, or each has its own, with a `fuzzy_scale`."];
/// The key of what channels share of the output sets, and what it is.
pub(super) const SETS: [&str; 2] =
    ["fuzzy_sets", "Whether channels share the nine corners of the output sets, or each has its own."];

/// The description of the structure.
#[derive(Debug)]
pub struct FuzzyL1Structure {
    pub(super) sharing: Sharing,
    pub(super) of_l1: L1Structure,
}

impl<'de> Deserialize<'de> for FuzzyL1Structure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut table = toml::Table::deserialize(deserializer)?;
        let sharing = Sharing { weights: taken(&mut table, WEIGHTS[0])?, sets: taken(&mut table, SETS[0])? };
        let of_l1 = toml::Value::Table(table).try_into().map_err(D::Error::custom)?;
        Ok(FuzzyL1Structure { sharing, of_l1 })
    }
}

/// Removes the value of a key; the default without it.
fn taken<T: DeserializeOwned + Default, E: serde::de::Error>(table: &mut toml::Table, key: &str) -> Result<T, E> {
    let value = table.remove(key).map(toml::Value::try_into).transpose();
    Ok(value.map_err(|error| E::custom(format!("{key}: {error}")))?.unwrap_or_default())
}

impl schemars::JsonSchema for FuzzyL1Structure {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "FuzzyL1Structure".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        use crate::controllers::fuzzy_gain::Held;

        let mut schema = <L1Structure as schemars::JsonSchema>::json_schema(generator);
        let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) else {
            return schema;
        };
        for [key, text] in [WEIGHTS, SETS] {
            let mut held = <Held as schemars::JsonSchema>::json_schema(generator);
            held.insert("description".to_owned(), text.into());
            held.insert("default".to_owned(), serde_json::json!(Held::default()));
            properties.insert(key.to_owned(), held.to_value());
        }
        schema
    }
}

/// Refuses an output whose rate isn't known from the state.
pub(super) fn require_rates(plant: &PlantMatrices) -> Result<(), Invalid> {
    if enters_rates(&plant.B, &plant.C).contains(&true) {
        let entered = (&plant.C * &plant.B).amax();
        let allowed = format!(
            "must be 0: the rate of an output with feedthrough from the control is not known from the state. With {} = \
             \"own\" such a channel's gain depends on its error only",
            WEIGHTS[0]
        );
        return Err(Invalid::new("C B: largest entry", format!("{entered:.3e}"), allowed));
    }
    Ok(())
}
