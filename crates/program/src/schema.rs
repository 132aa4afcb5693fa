//! JSON schema of descriptions, generated from the types that read them, for completion and checks in editors.

mod start;

use std::collections::BTreeMap;

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

use crate::library::CATALOGUE;
use crate::model::Description;
use start::Start;

/// Name of the generated file.
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

/// The schema of a description: `structure` and `start` depend on the `model`.
pub fn description() -> Value {
    let mut schema = of::<Description>().to_value();
    let mut structures = structures();
    structures.sort_by_key(|(name, _)| *name);
    let names: Vec<_> = structures.iter().map(|(name, _)| *name).collect();
    schema["properties"]["model"]["enum"] = json!(names);
    schema["title"] = json!("Description of an FMU");
    let starts = structures.iter().map(|(name, schema)| Start::of(name, schema.as_value()));
    let (starts, shared) = shared(starts.collect());
    let kinds = structures.into_iter().zip(starts);
    schema["allOf"] = kinds.map(|((name, schema), start)| choice(name, schema.to_value(), start)).collect();
    schema["definitions"] = Value::Object(shared);
    schema
}

/// Schemas of variables by their names, and of elements by patterns of them.
#[derive(Debug)]
struct Variables {
    whole: Map<String, Value>,
    elements: Map<String, Value>,
}

/// The variables of all kinds. Those of several kinds are defined once, under a name.
fn shared(starts: Vec<Start>) -> (Vec<Variables>, Map<String, Value>) {
    let mut uses: BTreeMap<String, (String, Value, usize)> = BTreeMap::new();
    for (name, schema) in starts.iter().flat_map(Start::variables) {
        uses.entry(format!("{name} {schema}")).or_insert_with(|| (name.clone(), schema, 0)).2 += 1;
    }
    let mut definitions = Map::new();
    let mut names = BTreeMap::new();
    for (identity, (name, schema, _)) in uses.into_iter().filter(|(_, (.., count))| *count > 1) {
        let others = (2..).map(|number| format!("{name}.{number}"));
        let free = [name.clone()].into_iter().chain(others).find(|name| !definitions.contains_key(name));
        let free = free.unwrap_or(name);
        definitions.insert(free.clone(), schema);
        names.insert(identity, free);
    }
    let refer = |(name, schema): (&String, Value)| {
        let known = names.get(&format!("{name} {schema}"));
        let schema = known.map_or(schema, |known| json!({ "$ref": format!("#/definitions/{known}") }));
        (name.clone(), schema)
    };
    let variables =
        |start: &Start| Variables { whole: start.variables().map(refer).collect(), elements: start.patterns() };
    (starts.iter().map(variables).collect(), definitions)
}

impl Variables {
    /// Schema of `[start]`.
    fn schema(&self) -> Value {
        json!({ "properties": self.whole, "patternProperties": self.elements })
    }

    /// The keys of `[start]` if a description gives no names of its own.
    fn strict(&self) -> Value {
        let any =
            |known: &Map<String, Value>| Value::Object(known.keys().map(|key| (key.clone(), json!(true))).collect());
        json!({ "properties": any(&self.whole), "patternProperties": any(&self.elements), "additionalProperties": false })
    }
}

/// The text of the file: the schema, indented.
pub fn text() -> String {
    format!("{:#}\n", description())
}

fn choice(name: &str, mut structure: Value, variables: Variables) -> Value {
    let required = structure.get("required").is_some();
    if let Some(structure) = structure.as_object_mut() {
        structure.remove("$schema");
    }
    let mut then = Map::new();
    then.insert("properties".to_owned(), json!({ "structure": structure }));
    if !variables.whole.is_empty() {
        then["properties"]["start"] = variables.schema();
        // Without names of the user's own, `[start]` has no other keys than the model's.
        then.insert("if".to_owned(), json!({ "properties": { "names": { "maxProperties": 0 } } }));
        then.insert("then".to_owned(), json!({ "properties": { "start": variables.strict() } }));
    }
    if required {
        then.insert("required".to_owned(), json!(["structure"]));
    }
    json!({ "if": { "properties": { "model": { "const": name } } }, "then": then })
}

/// A key of descriptions.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// The kind whose structure has it; none for a key of every description.
    pub model: Option<&'static str>,
    /// The key, as `filter.gain`.
    pub name: String,
    /// Its doc comment; empty if there is none.
    pub text: String,
    /// Its schema.
    pub schema: Value,
    /// True if it is required in its table.
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
