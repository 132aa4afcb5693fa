//! The structure of an L1 controller with prescribed performance: that of an L1 controller with the filter 1/s. The relative
//! degree follows from its sizes.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use crate::controllers::l1::{Baseline, L1Structure, PlantMatrices};
use crate::mathematics::matrices;
use crate::system::Invalid;

/// The description of the structure.
#[derive(Debug)]
pub struct L1PpfStructure {
    pub(super) of_l1: L1Structure,
}

/// The least singular value of an input gain, in parts of the largest one.
const LEAST: f64 = 1e-12;
/// Keys of an L1 controller's structure that this law has no use for, each with the reason.
const NOT_HERE: [(&str, &str); 3] = [
    ("filter", "this controller has only the filter D(s) = 1/s; leave it out, or use model = \"l1\""),
    ("unmatched", "this controller cancels only matched uncertainty; leave it out, or use model = \"l1\""),
    ("B_um", "this controller cancels only matched uncertainty; leave it out, or use model = \"l1\""),
];

impl<'de> Deserialize<'de> for L1PpfStructure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = toml::Table::deserialize(deserializer)?;
        let is_used = |key: &str| table.get(key).is_some_and(|value| value.as_bool() != Some(false));
        if let Some((key, reason)) = NOT_HERE.into_iter().find(|(key, _)| is_used(key)) {
            return Err(D::Error::custom(format!("{key}: {reason}")));
        }
        let of_l1 = toml::Value::Table(table).try_into().map_err(D::Error::custom)?;
        Ok(L1PpfStructure { of_l1 })
    }
}

impl schemars::JsonSchema for L1PpfStructure {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "L1PpfStructure".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = <L1Structure as schemars::JsonSchema>::json_schema(generator);
        if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
            NOT_HERE.iter().for_each(|(key, _)| drop(properties.remove(*key)));
        }
        schema
    }
}

impl L1PpfStructure {
    /// # Errors
    /// Matrices that don't fit, or keys that this law has no use for.
    pub(super) fn plant(&self) -> Result<PlantMatrices, Invalid> {
        let plant = self.of_l1.plant()?;
        let (n, m) = plant.B.shape();
        if n != m && n != 2 * m {
            let allowed = format!(
                "must have {m} rows, or {}, as it has {m} columns: a control for each state, or for each pair of a coordinate \
                 and its rate",
                2 * m
            );
            return Err(Invalid::new("B", format!("{n} x {m}"), allowed));
        }
        if n > m && self.of_l1.baseline == Baseline::None {
            let allowed = "must be \"inside\" or \"outside\" where a control shows after two derivatives";
            return Err(Invalid::new("baseline", "\"none\"", allowed));
        }
        Ok(plant)
    }

    /// The inverse of the nominal input gain: B, or C A B for relative degree 2.
    ///
    /// # Errors
    /// Controls that don't appear independently of each other in these derivatives.
    pub(super) fn inverse_gain(plant: &PlantMatrices) -> Result<DMatrix<f64>, Invalid> {
        let PlantMatrices { A, B, C, .. } = plant;
        let (name, gain) = match A {
            Some(A) if B.nrows() > B.ncols() => {
                let entered = (C * B).amax();
                if entered > 1e-9 * C.amax() * B.amax() {
                    let allowed =
                        "must be 0: with a control for each pair of states it must not show in an output's rate";
                    return Err(Invalid::new("C B: largest entry", format!("{entered:.3e}"), allowed));
                }
                ("C A B", C * A * B)
            }
            _ => ("B", B.clone()),
        };
        let name = format!("{name}: least singular value in parts of the largest");
        let allowed = format!("must be above {LEAST:e}: the controls must show independently of each other");
        if !gain.norm_squared().is_finite() {
            return Err(Invalid::because("A, B, C: their entries must be small enough to be squared"));
        }
        matrices::inverse(&gain, LEAST).map_err(|least| Invalid::new(name, format!("{least:.3e}"), allowed))
    }
}
