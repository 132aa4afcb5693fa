//! The schema of descriptions: what is checked in is what the types give, and the page of keys knows every key.

use std::path::Path;

use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::schema;

#[test]
fn the_checked_in_schema_is_that_of_the_types() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("modelDescription").join(schema::FILE);
    let text = schema::text();
    if std::env::var_os("UPDATE_DESCRIPTIONS").is_some() {
        std::fs::write(&file, &text).unwrap();
    }
    assert!(
        std::fs::read_to_string(&file).unwrap_or_default() == text,
        "{} differs from what the types give. If that is meant, run the tests once with UPDATE_DESCRIPTIONS=1",
        file.display()
    );
}

#[test]
fn every_model_has_its_structure_in_the_schema() {
    let schema = schema::description();
    let models: Vec<_> = schema["properties"]["model"]["enum"].as_array().unwrap().iter().collect();
    assert!(
        REGISTRY.iter().all(|kind| models.iter().any(|model| *model == kind.name)) && models.len() == REGISTRY.len()
    );
}

#[test]
fn every_key_says_what_it_is() {
    let silent: Vec<_> = schema::keys().into_iter().filter(|key| key.text.len() <= 5).collect();
    assert!(silent.is_empty(), "no doc comment: {silent:#?}");
}

#[test]
fn every_key_that_all_descriptions_have_stands_on_the_page_of_keys() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/description.md");
    let page = std::fs::read_to_string(&file).unwrap_or_default();
    let section = page.split("## Every description").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap();
    for key in schema::keys().into_iter().filter(|key| key.model.is_none()) {
        let row = section.lines().any(|line| line.starts_with(&format!("| `{}` ", key.name)));
        assert!(row, "docs/description.md has no row for `{}`", key.name);
    }
}
