//! Files of this project that follow from others: descriptions of FMUs, the schema, tables in the documentation. The
//! command `generate` writes them, and a test checks them.

use std::fmt::Write;

use serde_json::Value;

use crate::catalogue::Entry;
use crate::error::{Error, Invalid};
use crate::fmi2::model_description;
use crate::library::{CATALOGUE, REGISTRY, find};
use crate::model::{Description, Model};
use crate::schema::{self, Key};
use crate::system::{Causality, Element};
use crate::texts;

/// All generated files: their places in this project's folder, and their texts. `read` gives the text of a page, in
/// which a table is between `<!-- generated: NAME -->` and `<!-- end -->`.
///
/// # Errors
/// A description is not valid, or a page can't be read or has no place for its table.
pub fn files(read: impl Fn(&str) -> Result<String, Error>) -> Result<Vec<(String, String)>, Error> {
    let models: Vec<_> =
        texts::descriptions().iter().map(|(_, text)| model(text)).collect::<Result<_, _>>().map_err(Error::Argument)?;
    let units: Vec<_> = models.iter().filter_map(|model| Some((find(&model.description().model)?, model))).collect();
    let place = |name: &str, ending: &str| format!("modelDescription/{name}{ending}");
    let descriptions =
        models.iter().map(|model| (place(&model.description().name, ".xml"), model_description::xml(model)));
    let mut files: Vec<_> = descriptions.chain([(place(schema::FILE, ""), schema::text())]).collect();
    for (page, tables) in [
        ("README.md", vec![("controllers", choices(false))]),
        ("docs/choosing.md", vec![("choices", choices(true))]),
        ("docs/fmus.md", vec![("fmus", fmus(&units))]),
        ("docs/description.md", vec![("kinds", kinds())]),
        ("docs/description_structure.md", vec![("structures", structures(|key| !of_signals(key)))]),
        ("docs/description_signals.md", vec![("signals", structures(of_signals))]),
        ("docs/source_units.md", vec![("designed", designed(&models))]),
    ] {
        let mut text = read(page)?;
        for (name, table) in tables {
            put(&mut text, name, &table)
                .ok_or_else(|| Error::Argument(Invalid::new(page, name, "has no place for this generated table")))?;
        }
        files.push((page.to_owned(), text));
    }
    Ok(files)
}

fn model(text: &str) -> Result<Model, Invalid> {
    Model::from_description(Description::read(text)?, REGISTRY)
}

/// Puts a table into its place in a page; none if there is no place.
pub fn put(page: &mut String, name: &str, table: &str) -> Option<()> {
    let mark = format!("<!-- generated: {name} -->\n");
    let begin = page.find(&mark)? + mark.len();
    let end = begin + page[begin..].find("<!-- end -->")?;
    page.replace_range(begin..end, table);
    Some(())
}

/// Table for choosing a controller, with or without a column of what to expect.
fn choices(wide: bool) -> String {
    let head = if wide {
        "| you have | take | what to expect |\n| --- | --- | --- |\n"
    } else {
        "| you have | take |\n| --- | --- |\n"
    };
    let mut table = head.to_owned();
    for Entry { choice, kind, page, .. } in CATALOGUE {
        let [have, expect] = choice else { continue };
        let _ = match wide {
            true => writeln!(table, "| {have} | [`{}`]({page}.md) | {expect} |", kind.name),
            false => writeln!(table, "| {have} | `{}` |", kind.name),
        };
    }
    table
}

/// Table of FMUs, by their roles in a loop, then by their names.
fn fmus(units: &[(&Entry, &Model)]) -> String {
    let mut units = units.to_vec();
    units.sort_by_key(|(entry, _)| entry.role);
    let head = "| FMU | what it is | inputs | outputs |\n| --- | --- | --- | --- |\n".to_owned();
    units.into_iter().fold(head, |table, (entry, model)| table + &row_of_unit(entry, model))
}

fn row_of_unit(entry: &Entry, model: &Model) -> String {
    let description = model.description();
    let [inputs, outputs] = [Causality::Input, Causality::Output].map(|causality| ports(model, causality));
    let (name, what, page) = (&description.name, cell(&description.description), entry.page);
    format!("| `{name}` | [{what}]({page}.md) | {inputs} | {outputs} |\n")
}

/// Inputs and outputs that most controllers have: the page of FMUs names them once.
const COMMON: [&str; 6] =
    ["enabled", "u_manual", "step_too_long", "time_at_limit", "projection_active", "funnel_reopened"];

/// The variables of a causality without those that most controllers have: `x[1:4]`.
fn ports(model: &Model, causality: Causality) -> String {
    let elements: Vec<Element> = model.variables().visible().collect();
    let arrays = elements.chunk_by(|a, b| std::ptr::eq(a.variable, b.variable));
    let listed = arrays
        .filter(|array| array[0].variable.causality == causality && !COMMON.contains(&array[0].variable.name.as_str()));
    let shown = listed.map(|array| {
        let names: Vec<_> = array.iter().map(|element| format!("`{}`", element.name())).collect();
        match &names[..] {
            [first, .., last] if first.ends_with("[1]`") => {
                let end = last.rsplit('[').next().unwrap_or_default();
                format!("{}:{end}", first.trim_end_matches("]`"))
            }
            names => names.join(", "),
        }
    });
    shown.collect::<Vec<_>>().join(", ")
}

/// Table of the parameters that an FMU with C sources fixes.
fn designed(models: &[Model]) -> String {
    models.iter().fold("| FMU | fixed |\n| --- | --- |\n".to_owned(), |table, model| {
        let fixed: Vec<_> = model.designed_names().iter().map(|parameter| format!("`{parameter}`")).collect();
        let fixed = if fixed.is_empty() { "none".to_owned() } else { fixed.join(", ") };
        table + &format!("| `{}` | {fixed} |\n", model.description().name)
    })
}

/// Table of kinds, with those of which `new` begins a description.
fn kinds() -> String {
    let mut table = "| `model` | what it is | `new` begins one |\n| --- | --- | --- |\n".to_owned();
    for Entry { kind, title, page, template, .. } in CATALOGUE {
        let begun = if template.is_some() { "yes" } else { "" };
        let _ = writeln!(table, "| `{}` | [{}]({page}.md) | {begun} |", kind.name, cell(title));
    }
    table
}

/// True for a key that gives names or units of signals.
fn of_signals(key: &str) -> bool {
    ["quantities", "units"].iter().any(|name| key.split('.').next() == Some(name))
}

/// Models whose keys are mostly the same, and their name in a table.
const GROUPS: [(&str, &str); 2] = [
    ("`l1`, `fuzzy-l1`, `l1-quadrotor`, `l1-quadrotor-observed`, `l1-limit`, `l1-sampled`, `l1-ppf`", "all L1"),
    ("`l1`, `fuzzy-l1`, `l1-quadrotor`, `l1-quadrotor-observed`, `l1-limit`, `l1-sampled`", "L1 but `l1-ppf`"),
];

/// Table of some keys of structures, with their models.
fn structures(chosen: impl Fn(&str) -> bool) -> String {
    let mut rows: Vec<(String, String, Vec<&str>)> = Vec::new();
    for key in schema::keys() {
        let Some(model) = key.model.filter(|_| chosen(&key.name)) else { continue };
        let text = what_it_is(&key);
        match rows.iter_mut().find(|(name, known, _)| *name == key.name && *known == text) {
            Some((_, _, models)) => models.push(model),
            None => rows.push((key.name, text, vec![model])),
        }
    }
    rows.sort_by(|(one, ..), (other, ..)| one.cmp(other));
    let row = |(name, text, models): &(String, String, Vec<&str>)| {
        let models: Vec<_> = models.iter().map(|model| format!("`{model}`")).collect();
        let models = GROUPS.iter().fold(models.join(", "), |models, (group, name)| models.replace(group, name));
        format!("| `{name}` | {models} | {} |\n", cell(text))
    };
    let head = "| key | models | what it is |\n| --- | --- | --- |\n".to_owned();
    head + &rows.iter().map(row).collect::<String>()
}

/// Text of a key: its doc comment, the values that are allowed, and its default.
fn what_it_is(key: &Key) -> String {
    let mut text = key.text.trim_end_matches('.').to_owned();
    // A word gets a small letter, a symbol stays.
    let mut letters = text.chars();
    if let [Some(first), second] = [letters.next(), letters.next()]
        && second.is_none_or(|c| c.is_lowercase() || c == ' ')
    {
        text.replace_range(..first.len_utf8(), &first.to_lowercase().to_string());
    }
    let items = key.schema["oneOf"].as_array().into_iter().flatten().filter_map(|item| item["const"].as_str());
    let items: Vec<_> = items.map(|item| format!("`\"{item}\"`")).collect();
    if let [first @ .., last] = &items[..] {
        text += &format!(": {} or {last}", first.join(", "));
    }
    if let Some(keys) = key.schema["items"]["properties"].as_object() {
        text += &format!(", each `{{ {} }}`", keys.keys().cloned().collect::<Vec<_>>().join(", "));
    }
    let default = &key.schema["default"];
    let has_rule = key.required || ["none is given", "none are given"].iter().any(|words| text.contains(words));
    let empty = default.as_array().is_some_and(Vec::is_empty);
    match default {
        Value::Null => {}
        _ if has_rule || empty => {}
        default => text += &format!("; `{default}` unless given"),
    }
    text
}

// Text for a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
