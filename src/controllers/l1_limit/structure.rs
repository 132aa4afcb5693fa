//! The structure of a limit controller: that of an L1 controller, without what belongs to its estimates.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use crate::controllers::l1::{L1Structure, PlantMatrices};
use crate::system::Invalid;

/// Least singular value of the directions of the uncertainty, in parts of the largest.
const LEAST_DIRECTION: f64 = 1e-12;

/// The description of the structure.
#[derive(Debug)]
pub struct L1LimitStructure {
    pub(super) of_l1: L1Structure,
}

impl<'de> Deserialize<'de> for L1LimitStructure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = toml::Table::deserialize(deserializer)?;
        let of_l1 = L1Structure::without_estimates(table).map_err(D::Error::custom)?;
        Ok(L1LimitStructure { of_l1 })
    }
}

impl schemars::JsonSchema for L1LimitStructure {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "L1LimitStructure".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        L1Structure::schema_without_estimates(generator)
    }
}

/// B̄⁺, the pseudoinverse of the directions (B B_um) of the uncertainty.
pub(super) fn inverse(plant: &PlantMatrices) -> Result<DMatrix<f64>, Invalid> {
    let directions = plant.all_directions();
    if !directions.norm_squared().is_finite() {
        return Err(Invalid::because("B, B_um: their entries must be small enough to be squared"));
    }
    let sizes = directions.singular_values();
    let least = if sizes.max() > 0.0 { sizes.min() / sizes.max() } else { 0.0 };
    if least < LEAST_DIRECTION {
        let allowed = format!("must be above {LEAST_DIRECTION:e}: each channel needs a direction of its own");
        let name = "(B B_um): least singular value in parts of the largest";
        return Err(Invalid::new(name, format!("{least:.3e}"), allowed));
    }
    directions.pseudo_inverse(0.0).map_err(Invalid::because)
}
