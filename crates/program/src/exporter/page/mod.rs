//! documentation/index.html: what a reader who has nothing but the FMU must know, in the order in which it is asked for;
//! readable without a network, on a telephone and on paper.

mod demonstration;
mod diagram;
mod guide;
mod markdown;
mod only;
mod report;
mod response;
mod variables;
mod wiring;

use std::collections::HashMap;
use std::fmt::Write;

use super::pins::{Pin, pins};
use crate::catalogue::{Entry, Role};
use crate::fmi2::build::Build;
use crate::fmi2::describe::DescribedUnit;
use crate::library;
use crate::model::Description;
use crate::model_description::ModelDescription;
use crate::pages;
use markdown::rendered;
use wiring::Wiring;

const STYLE: &str = include_str!("style.css");

/// A unit that is handed on: what its page tells follows from this.
pub struct Handed<'a> {
    unit: &'a DescribedUnit,
    build: &'a Build,
    xml: &'a ModelDescription,
    description: &'a Description,
    entry: Option<&'static Entry>,
    /// Its parts, where it is a whole loop.
    parts: Vec<Part<'a>>,
    /// Its pins, with the roles of the units that they belong to.
    pub pins: Vec<(Pin<'a>, Option<Role>)>,
}

/// A part of a whole loop.
struct Part<'a> {
    name: &'a str,
    entry: Option<&'static Entry>,
    structure: Option<&'a toml::Table>,
}

impl<'a> Handed<'a> {
    /// A unit with what it was made from, and its kind where that stands in the catalogue.
    pub fn new(
        unit: &'a DescribedUnit,
        build: &'a Build,
        xml: &'a ModelDescription,
        description: &'a Description,
        entry: Option<&'static Entry>,
    ) -> Self {
        let is_whole = entry.is_some_and(|entry| entry.role == Role::Composite);
        let parts = if is_whole { parts(&description.structure) } else { Vec::new() };
        let roles: HashMap<&str, Option<Role>> = parts.iter().map(|part| (part.name, part.role())).collect();
        let pins = pins(unit, xml, entry.map(|entry| entry.role), &roles);
        Handed { unit, build, xml, description, entry, parts, pins }
    }

    /// Markdown with what holds for this unit alone, as HTML.
    fn told(&self, markdown: &str) -> String {
        let own = [&self.description.structure];
        let structures: Vec<&toml::Table> = if self.parts.is_empty() {
            own.to_vec()
        } else {
            self.parts.iter().filter_map(|part| part.structure).collect()
        };
        rendered(&only::having(markdown, &structures))
    }
}

impl Part<'_> {
    fn role(&self) -> Option<Role> {
        self.entry.map(|entry| entry.role)
    }
}

/// The parts of a whole loop, from its structure.
fn parts(structure: &toml::Table) -> Vec<Part<'_>> {
    let parts = structure.get("parts").and_then(toml::Value::as_array);
    parts.into_iter().flatten().filter_map(part).collect()
}

fn part(part: &toml::Value) -> Option<Part<'_>> {
    let text = |key: &str| part.get(key).and_then(toml::Value::as_str);
    let structure = part.get("structure").and_then(toml::Value::as_table);
    Some(Part { name: text("name")?, entry: text("model").and_then(library::find), structure })
}

/// The page of a unit.
pub fn html(handed: &Handed) -> String {
    let Handed { unit, build, xml, entry, .. } = handed;
    let name = escaped(&unit.name);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{name}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n{}<h1>{name}</h1>\n<p>{}.</p>\n{}",
        entry.map_or_else(|| pages::icon(""), Entry::icon).svg.replacen("<svg ", "<svg class=\"icon\" ", 1),
        escaped(&xml.description),
        about(xml)
    );
    let wiring = Wiring::of(handed);
    guide::push_purpose(&mut page, handed);
    diagram::push(&mut page, &wiring, handed);
    variables::push_pins(&mut page, handed);
    guide::push_gains(&mut page, handed);
    response::push(&mut page, handed, &wiring);
    guide::push_warnings(&mut page, handed);
    guide::push_limits(&mut page, handed);
    let _ = write!(page, "<h2 id=\"law\">{}</h2>\n{}", guide::heading(handed), handed.told(&unit.documentation));
    variables::push_others(&mut page, handed);
    report::push(&mut page, &unit.report);
    let Build { version, target, compiler, .. } = build;
    let _ = writeln!(
        page,
        "<footer>FMI 2.0 unit for co-simulation and model exchange, made by adaptive-fmu {version} ({target}, {compiler}). \
         It reads nothing but its own resources, writes nothing, and needs no network.</footer>\n</body>\n</html>"
    );
    page
}

/// Whose the unit is, in a line.
fn about(xml: &ModelDescription) -> String {
    let texts = xml.about.iter().map(|(key, text)| match *key {
        "author" => format!("By {}", escaped(text)),
        "copyright" => escaped(text),
        key => format!("{key} {}", escaped(text)),
    });
    let texts = texts.collect::<Vec<_>>().join(", ");
    if texts.is_empty() { texts } else { format!("<p>{texts}.</p>\n") }
}

/// Text that is no markup in HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_a_description_is_no_markup() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
    }
}
