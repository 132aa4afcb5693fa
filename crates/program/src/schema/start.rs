//! Schema of `[start]` of each kind: the parameters and inputs of every structure that the kind has.
//!
//! Variables follow from structures, so they are collected from kinds: with the structures of this package's
//! descriptions, with one or two choices of these made otherwise, and with start values by rows. Sizes are left open.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

use crate::exporter;
use crate::library::REGISTRY;
use crate::model::{Description, Model};
use crate::system::{Causality, Data, Naming, Section, Variable};

/// Content of `[start]` of a kind: the schema of each variable, and of each element, by the variable's name.
#[derive(Debug, Default)]
pub(super) struct Start {
    whole: BTreeMap<String, Known>,
    elements: BTreeMap<String, Value>,
}

/// A variable of a kind.
#[derive(Debug)]
struct Known {
    /// Description, with its unit.
    text: String,
    /// Its different schemas, which depend on the structure.
    schemas: Vec<Value>,
}

/// Keys with texts of the user.
const TEXTS: [&str; 2] = ["units", "quantities"];

/// The most numbers of a choice that are tried.
const MOST_NUMBERS: usize = 10;

impl Start {
    /// Content for a kind with this schema of its structure.
    pub fn of(kind: &str, structure: &Value) -> Self {
        let mut start = Start::default();
        let described = exporter::descriptions().iter().filter_map(|(_, text)| Description::read(text).ok());
        for mut description in described.filter(|description| description.model == kind) {
            TEXTS.iter().for_each(|key| drop(description.structure.remove(*key)));
            let choices = choices(structure);
            start.learn(&description);
            for (k, first) in choices.iter().enumerate() {
                let with_first = with(&description, first);
                start.learn(&with_first);
                start.learn(&by_rows(&with_first));
                choices[k + 1..].iter().for_each(|second| start.learn(&with(&with_first, second)));
            }
        }
        start
    }

    /// Adds the variables of a structure, if it is valid.
    fn learn(&mut self, description: &Description) {
        let Ok(variables) = Model::variables_of(description, REGISTRY) else { return };
        let settable = |v: &&Variable| {
            matches!(v.section, Section::Parameter | Section::Input) && v.causality != Causality::Hidden
        };
        for variable in variables.iter().filter(settable) {
            let one = one(variable, description);
            let whole = whole(variable, &one);
            let known = self.whole.entry(variable.name.clone());
            let known = known.or_insert_with(|| Known { text: text(variable), schemas: Vec::new() });
            if !known.schemas.contains(&whole) {
                known.schemas.push(whole);
            }
            if variable.naming != Naming::Scalar {
                self.elements.entry(variable.name.clone()).or_insert(one);
            }
        }
    }

    /// The schema of each variable.
    pub fn variables(&self) -> impl Iterator<Item = (&String, Value)> {
        self.whole.iter().map(|(name, Known { text, schemas })| {
            let mut schema = match &schemas[..] {
                [one] => one.clone(),
                many => json!({ "anyOf": many }),
            };
            schema["description"] = json!(text);
            (name, schema)
        })
    }

    /// The schema of the elements by patterns of their names; names with the same schema share a pattern.
    pub fn patterns(&self) -> Map<String, Value> {
        let mut alike: BTreeMap<String, (Value, Vec<&str>)> = BTreeMap::new();
        for (name, schema) in &self.elements {
            alike.entry(schema.to_string()).or_insert_with(|| (schema.clone(), Vec::new())).1.push(name);
        }
        let pattern = |names: &[&str]| format!("^({})\\[[0-9]+(,[0-9]+)?\\]$", names.join("|"));
        alike.into_values().map(|(schema, names)| (pattern(&names), schema)).collect()
    }
}

/// The choices at the top of a structure: a key, and a value that it may have.
fn choices(structure: &Value) -> Vec<(String, toml::Value)> {
    let mut choices = Vec::new();
    for (key, schema) in structure["properties"].as_object().into_iter().flatten() {
        let named =
            |name: &str| schema["type"] == name || schema["type"].as_array().is_some_and(|t| t.contains(&json!(name)));
        let items = schema["oneOf"].as_array().into_iter().flatten().filter_map(|item| item["const"].as_str());
        choices.extend(items.map(|item| (key.clone(), toml::Value::String(item.to_owned()))));
        // A number with few possible values.
        if let (true, Some(least), Some(most)) =
            (named("integer"), schema["minimum"].as_i64(), schema["maximum"].as_i64())
        {
            let few = (least..=most).take(MOST_NUMBERS);
            choices.extend(few.map(|value| (key.clone(), toml::Value::Integer(value))));
        }
        if named("boolean") {
            choices.extend([true, false].map(|value| (key.clone(), toml::Value::Boolean(value))));
        }
        // An optional matrix.
        if named("array") && named("null") {
            let number = toml::Value::Float(0.0);
            choices.push((key.clone(), toml::Value::Array(vec![toml::Value::Array(vec![number])])));
        }
    }
    choices
}

fn with(description: &Description, (key, value): &(String, toml::Value)) -> Description {
    let mut other = description.clone();
    other.structure.insert(key.clone(), value.clone());
    other
}

/// The same with lists of rows in place of lists of numbers: some parameters may be either.
fn by_rows(description: &Description) -> Description {
    let mut other = description.clone();
    let lists = other.start.iter_mut().filter(|(_, value)| value.is_array());
    lists.for_each(|(_, value)| *value = toml::Value::Array(vec![value.clone()]));
    other
}

/// The schema of a scalar, or of one element.
fn one(variable: &Variable, description: &Description) -> Value {
    match &variable.data {
        Data::Real { min, above_min, max, .. } => {
            let mut schema = json!({ "type": "number" });
            if let Some(min) = min {
                schema[if *above_min { "exclusiveMinimum" } else { "minimum" }] = json!(min);
            }
            if let Some(max) = max {
                schema["maximum"] = json!(max);
            }
            schema
        }
        Data::Integer { limits: Some((min, max)), .. } => json!({ "type": "integer", "minimum": min, "maximum": max }),
        Data::Integer { limits: None, .. } => json!({ "type": "integer" }),
        Data::Boolean { .. } => json!({ "type": "boolean" }),
        Data::Choice { items, .. } => {
            let structure = description.structure.to_string();
            // Items that a structure gives.
            if items.iter().all(|(name, _)| structure.contains(&format!("\"{name}\""))) {
                return json!({ "type": "string" });
            }
            let item = |(name, text): &(String, String)| json!({ "const": name, "description": text });
            json!({ "oneOf": items.iter().map(item).collect::<Vec<_>>() })
        }
    }
}

/// The schema of a whole variable.
fn whole(variable: &Variable, one: &Value) -> Value {
    let list = |of: &Value| json!({ "type": "array", "minItems": 1, "items": of });
    match variable.naming {
        Naming::Scalar => one.clone(),
        Naming::Vector(_) | Naming::Diagonal(_) => list(one),
        Naming::Matrix(..) => list(&list(one)),
    }
}

/// Description of a variable, with the unit that all elements share, if any.
fn text(variable: &Variable) -> String {
    let texts: BTreeSet<&str> = variable.description.iter().map(String::as_str).collect();
    let text = texts.into_iter().collect::<Vec<_>>().join("; ");
    let units: BTreeSet<_> = variable.elements().map(|element| element.unit()).collect();
    match units.first() {
        Some(&unit) if units.len() == 1 && !matches!(unit, "" | "1") => format!("{text} [{unit}]"),
        _ => text,
    }
}
