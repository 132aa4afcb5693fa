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
fn every_key_says_what_it_is_and_stands_on_the_page_of_keys() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/description.md");
    let page = std::fs::read_to_string(&file).unwrap_or_default();
    let section = |model: &str| {
        let start = if model.is_empty() { "## Every description" } else { "## `structure`" };
        let rest = page.split(start).nth(1).unwrap_or_default();
        rest.split("\n## ").next().unwrap_or_default().to_owned()
    };
    for (model, key, text) in schema::keys() {
        assert!(text.is_some_and(|text| text.len() > 5), "{model} {key} has no doc comment");
        let of_model = |line: &&str| model.is_empty() || line.contains(&format!("`{model}`")) || line.contains("| all");
        let key = key.strip_prefix("structure.").unwrap_or(&key);
        let row = section(&model).lines().any(|line| line.starts_with(&format!("| `{key}` ")) && of_model(&line));
        assert!(row, "docs/description.md has no row for `{key}` of `{model}`");
    }
}
