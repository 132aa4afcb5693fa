//! The parameters that a unit with C sources fixes, as the documentation lists them.

use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::{description, description_names, pages};

#[test]
fn the_documentation_lists_what_each_unit_with_sources_fixes() {
    let mut table = "| FMU | fixed |\n| --- | --- |\n".to_owned();
    for name in description_names() {
        let model = Model::from_description(Description::read(&description(&name)).unwrap(), REGISTRY).unwrap();
        let fixed: Vec<_> = model.designed_names().iter().map(|parameter| format!("`{parameter}`")).collect();
        let fixed = if fixed.is_empty() { "none".to_owned() } else { fixed.join(", ") };
        table.push_str(&format!("| `{name}` | {fixed} |\n"));
    }
    pages::assert_generated("docs/designed.md", "designed", &table);
}
