//! The JSON schema of descriptions, made from the types that read them: what an editor completes and checks.

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

use crate::library::CATALOGUE;
use crate::model::Description;

/// Name of the file that it is written to.
pub const FILE: &str = "description.schema.json";

fn generator() -> SchemaGenerator {
    let mut settings = SchemaSettings::draft07();
    settings.inline_subschemas = true;
    settings.into_generator()
}

fn of<T: JsonSchema>() -> Schema {
    generator().into_root_schema_for::<T>()
}

/// The structures of all kinds of this package.
fn structures() -> Vec<(&'static str, Schema)> {
    CATALOGUE.iter().map(|entry| (entry.kind.name, (entry.schema)(generator()))).collect()
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

/// A key of descriptions.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// The kind that has it in its structure; none where every description has it.
    pub model: Option<&'static str>,
    /// The key, as `filter.gain`.
    pub name: String,
    /// What it is, as its doc comment says it; nothing where there is none.
    pub text: String,
    /// Its schema.
    pub schema: Value,
    /// Whether it must be given where the table that holds it is.
    pub required: bool,
}

/// Every key of descriptions: those that all have, and those of the structure of each kind.
pub fn keys() -> Vec<Key> {
    let mut keys = Vec::new();
    collect(None, "", &of::<Description>().to_value(), &mut keys);
    for (name, schema) in structures() {
        collect(Some(name), "", &schema.to_value(), &mut keys);
    }
    keys
}

fn collect(model: Option<&'static str>, before: &str, schema: &Value, keys: &mut Vec<Key>) {
    let required = |key: &str| schema["required"].as_array().is_some_and(|keys| keys.iter().any(|known| known == key));
    for (key, value) in schema["properties"].as_object().into_iter().flatten() {
        let (name, text) = (format!("{before}{key}"), value["description"].as_str().unwrap_or_default());
        let text = text.replace('\n', " ");
        keys.push(Key { model, name, text, schema: value.clone(), required: required(key) });
        collect(model, &format!("{before}{key}."), value, keys);
    }
}
