//! The JSON schema of descriptions, made from the types that read them: what an editor completes and checks.

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

use crate::controllers::fuzzy_l1::FuzzyL1;
use crate::controllers::l1::L1;
use crate::controllers::l1_quadrotor::L1Quadrotor;
use crate::controllers::mrac_ppf::MracPpf;
use crate::controllers::neuro_ppf::NeuroPpf;
use crate::controllers::observer::Observer;
use crate::controllers::watched::Watched;
use crate::library::REGISTRY;
use crate::model::Description;
use crate::plants::actuator::Actuator;
use crate::plants::reference::Reference;
use crate::plants::sensor::Sensor;
use crate::plants::state_space::StateSpace;
use crate::system::{CompositeStructure, Kind, NoStructure, System};

/// Name of the file that it is written to.
pub const FILE: &str = "description.schema.json";

/// What a start value may be.
#[derive(JsonSchema)]
#[schemars(untagged)]
#[allow(dead_code)] // for the schema alone: what fits a variable is decided where it is declared
pub(crate) enum StartValue {
    /// Of a scalar, or of one element.
    Number(f64),
    /// True or false.
    Boolean(bool),
    /// An item of a choice.
    Text(String),
    /// Of a vector.
    Numbers(Vec<f64>),
    /// Of a matrix: its rows.
    Rows(Vec<Vec<f64>>),
}

fn generator() -> SchemaGenerator {
    let mut settings = SchemaSettings::draft07();
    settings.inline_subschemas = true;
    settings.into_generator()
}

fn of<T: JsonSchema>() -> Schema {
    generator().into_root_schema_for::<T>()
}

/// Name and structure of a system that has one.
fn structure<M: System<Structure: JsonSchema>>() -> (&'static str, Schema) {
    (M::NAME, of::<M::Structure>())
}

/// The structures of all systems of this package.
fn structures() -> Vec<(&'static str, Schema)> {
    let own = [
        structure::<Watched<FuzzyL1>>(),
        structure::<Watched<L1>>(),
        structure::<Watched<L1Quadrotor<false>>>(),
        structure::<Watched<L1Quadrotor<true>>>(),
        structure::<MracPpf>(),
        structure::<NeuroPpf>(),
        structure::<Observer>(),
        structure::<Actuator>(),
        structure::<Reference>(),
        structure::<Sensor>(),
        structure::<StateSpace>(),
        (Kind::COMPOSITE.name, of::<CompositeStructure>()),
    ];
    let without = |kind: &&Kind| own.iter().all(|(name, _)| *name != kind.name);
    let without: Vec<_> = REGISTRY.iter().filter(without).map(|kind| (kind.name, of::<NoStructure>())).collect();
    own.into_iter().chain(without).collect()
}

/// The schema of a description: `structure` by the `model`.
pub fn description() -> Value {
    let mut schema = of::<Description>().to_value();
    let mut structures = structures();
    structures.sort_by_key(|(name, _)| *name);
    let names: Vec<_> = structures.iter().map(|(name, _)| *name).collect();
    schema["properties"]["model"]["enum"] = json!(names);
    schema["title"] = json!("Description of an FMU");
    schema["allOf"] = structures.into_iter().map(|(name, schema)| choice(name, schema.to_value())).collect();
    schema
}

/// The text of the file: the schema, indented.
pub fn text() -> String {
    format!("{:#}\n", description())
}

fn choice(name: &str, mut structure: Value) -> Value {
    let required = structure.get("required").is_some();
    if let Some(structure) = structure.as_object_mut() {
        structure.remove("$schema");
    }
    let mut then = Map::new();
    then.insert("properties".to_owned(), json!({ "structure": structure }));
    if required {
        then.insert("required".to_owned(), json!(["structure"]));
    }
    json!({ "if": { "properties": { "model": { "const": name } } }, "then": then })
}

/// Every key of descriptions, as `key` or `structure.key` of each model, with what it is: `None` where nothing says it.
pub fn keys() -> Vec<(String, String, Option<String>)> {
    let mut keys = Vec::new();
    let schema = of::<Description>().to_value();
    collect("", "", &schema, &mut keys);
    for (name, schema) in structures() {
        collect(name, "structure.", &schema.to_value(), &mut keys);
    }
    keys
}

fn collect(model: &str, before: &str, schema: &Value, keys: &mut Vec<(String, String, Option<String>)>) {
    for (key, value) in schema["properties"].as_object().into_iter().flatten() {
        let text = value["description"].as_str().map(|text| text.replace('\n', " "));
        keys.push((model.to_owned(), format!("{before}{key}"), text));
        collect(model, &format!("{before}{key}."), value, keys);
    }
}
