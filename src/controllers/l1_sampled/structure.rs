//! The structure of a sampled L1 controller: that of an L1 controller, without what belongs to its adaptation.
#![allow(non_snake_case)] // matrices have the names of the thesis

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use crate::controllers::l1::{Commands, L1Structure, PlantMatrices};
use crate::system::Invalid;

/// Method that estimates the unknown part from the measured state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Estimate {
    /// Exact deviation from the nominal plant in the last interval.
    #[default]
    Exact,
    /// Error of a predictor, as published (Hovakimyan, Cao 2010).
    Published,
}

/// The description of the structure.
#[derive(Debug)]
pub struct L1SampledStructure {
    pub(super) estimate: Estimate,
    pub(super) of_l1: L1Structure,
}

/// The key of an [`Estimate`].
const ESTIMATE: &str = "estimate";
impl<'de> Deserialize<'de> for L1SampledStructure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut table = toml::Table::deserialize(deserializer)?;
        let estimate = table.remove(ESTIMATE).map(toml::Value::try_into).transpose();
        let estimate = estimate.map_err(|error| D::Error::custom(format!("{ESTIMATE}: {error}")))?;
        let of_l1 = L1Structure::without_estimates(table).map_err(D::Error::custom)?;
        Ok(L1SampledStructure { estimate: estimate.unwrap_or_default(), of_l1 })
    }
}

impl schemars::JsonSchema for L1SampledStructure {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "L1SampledStructure".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = L1Structure::schema_without_estimates(generator);
        let mut estimate = Estimate::json_schema(generator);
        estimate.insert("default".to_owned(), serde_json::json!("exact"));
        if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
            properties.remove("commands");
            properties.insert(ESTIMATE.to_owned(), estimate.to_value());
        }
        schema
    }
}

impl L1SampledStructure {
    /// # Errors
    /// Matrices that don't fit, or keys that this controller has no use for.
    pub(super) fn plant(&self) -> Result<PlantMatrices, Invalid> {
        let plant = self.of_l1.plant()?;
        if self.of_l1.commands == Commands::Acceleration {
            let allowed = "must be \"control\": nominal_input_gain is the effect of a control";
            return Err(Invalid::new("commands", "\"acceleration\"", allowed));
        }
        Ok(plant)
    }
}
