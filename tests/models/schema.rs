//! The schema of descriptions: what is checked in is what the types give, and the page of keys knows every key.

use adaptive_fmu::library::{CATALOGUE, REGISTRY, begin};
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::schema;
use adaptive_fmu::system::Causality;
use adaptive_fmu::template::Request;
use common::at_top;
use serde_json::Value;

#[test]
fn every_model_has_its_structure_in_the_schema() {
    let schema = schema::description();
    let models: Vec<_> = schema["properties"]["model"]["enum"].as_array().unwrap().iter().collect();
    assert!(
        REGISTRY.iter().all(|kind| models.iter().any(|model| *model == kind.name)) && models.len() == REGISTRY.len()
    );
}

/// True if `[start]` of the model may hold this key, by the schema.
fn is_known(schema: &Value, model: &str, key: &str) -> bool {
    let of_model = |kind: &&Value| kind["if"]["properties"]["model"]["const"] == model;
    let start =
        schema["allOf"].as_array().unwrap().iter().find(of_model).map(|kind| &kind["then"]["properties"]["start"]);
    start.is_some_and(|start| start["properties"].get(key).is_some())
}

#[test]
fn whatever_a_new_description_can_start_with_is_known_to_editors() {
    let schema = schema::description();
    let mut checked = 0;
    for entry in CATALOGUE.iter() {
        let Some(template) = entry.template else { continue };
        let (kind, name) = (entry.kind.name, "Mine");
        for &sizes in template.tried {
            let request = Request {
                kind,
                name,
                sizes,
                plant: None,
                bandwidth: None,
                reference: &[1.0],
                uncertainty: None,
                experiment: None,
            };
            let description = Description::read(&begin(&request).unwrap().text).unwrap();
            let variables = Model::variables_of(&description, REGISTRY).unwrap();
            let settable = variables.iter().filter(|v| matches!(v.causality, Causality::Parameter | Causality::Input));
            for variable in settable {
                assert!(is_known(&schema, kind, &variable.name), "{kind}: {}", variable.name);
                checked += 1;
            }
        }
    }
    assert!(checked > 200);
    // What no description of this package has, but a structure may: a choice, two of them, a matrix that may be left out.
    let known = |model: &str, names: &[&str]| names.iter().all(|name| is_known(&schema, model, name));
    assert!(known("l1", &["rho_0", "A_m", "pole_real", "nominal_inertia", "theta_bound_unmatched"]));
    assert!(known("state-space", &["D", "x0"]) && known("pid", &["rho_0"]) && known("reference", &["signal"]));
    assert!(!known("pid", &["adaptation_gain"]) && !known("l1", &["u"]));
    // A list of numbers or of rows.
    let bound = schema["definitions"]["theta_bound"]["anyOf"].as_array().unwrap();
    assert!(["number", "array"].iter().all(|item| bound.iter().any(|list| list["items"]["type"] == *item)));
}

#[test]
fn every_key_has_a_description() {
    let silent: Vec<_> = schema::keys().into_iter().filter(|key| key.text.len() <= 5).collect();
    assert!(silent.is_empty(), "no doc comment: {silent:#?}");
}

#[test]
fn every_key_that_all_descriptions_have_is_on_the_page_of_keys() {
    let file = at_top("docs/description.md");
    let page = std::fs::read_to_string(&file).unwrap_or_default();
    let section = page.split("## Every description").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap();
    for key in schema::keys().into_iter().filter(|key| key.model.is_none()) {
        let row = section.lines().any(|line| line.starts_with(&format!("| `{}` ", key.name)));
        assert!(row, "docs/description.md has no row for `{}`", key.name);
    }
}
