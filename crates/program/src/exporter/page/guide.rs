//! A kind's part of an FMU's page: purpose, gains, warnings and limitations.

use std::fmt::Write;

use super::variables::{allowed, figure, unit_of};
use super::{Handed, escaped};
use crate::catalogue::Role;
use crate::exporter::pins::ranges;
use crate::model_description::Variable;

/// Appends the purpose of the FMU.
pub fn push_purpose(page: &mut String, handed: &Handed) {
    if let Some(entry) = handed.entry {
        let _ = writeln!(page, "<div id=\"purpose\">{}</div>", handed.to_html(entry.guide.purpose));
    }
}

/// Appends the behaviour of the FMU without connections.
pub fn push_alone(page: &mut String, handed: &Handed) {
    if let Some(entry) = handed.entry {
        let _ = writeln!(page, "<div id=\"alone\">{}</div>", handed.to_html(entry.guide.alone));
    }
}

/// The heading of its equations.
pub fn heading(handed: &Handed) -> &'static str {
    match handed.entry.map(|entry| entry.role) {
        Some(Role::Controller) => "Control law",
        Some(Role::Composite) => "Parts and equations",
        _ => "Equations",
    }
}

/// Appends the most important parameters; nothing for kinds that name none.
pub fn push_gains(page: &mut String, handed: &Handed) {
    let Some(entry) = handed.entry else { return };
    let mut rows = String::new();
    for (name, text) in entry.guide.gains {
        let elements = elements(handed, name);
        if elements.is_empty() {
            continue;
        }
        let names = ranges(elements.iter().map(|variable| variable.name.as_str()));
        let shown =
            if names.len() > 3 { format!("{} … {}", names[0], names[names.len() - 1]) } else { names.join(", ") };
        let _ = writeln!(
            rows,
            "<tr><td><code>{}</code><td>{}<td>{}<td>{}<td>{}",
            escaped(&shown),
            handed.to_html(text).trim().trim_start_matches("<p>").trim_end_matches("</p>"),
            escaped(&starts(&elements)),
            escaped(unit_of(elements[0])),
            escaped(&allowed(elements[0])),
        );
    }
    if !rows.is_empty() {
        let _ = writeln!(
            page,
            "<h2 id=\"gains\">Main parameters</h2>\n<div class=\"scroll wide\"><table>\n<tr><th>parameter<th>effect\
             <th>start value<th>unit<th>allowed\n{rows}</table></div>"
        );
    }
}

/// The elements of a parameter, by the model's own name of it; only the diagonal ones if all others are 0.
fn elements<'a>(handed: &Handed<'a>, name: &str) -> Vec<&'a Variable> {
    let of = |declared: &str| declared.split('[').next() == Some(name);
    let is_free = |variable: &Variable| variable.causality == "parameter" || variable.variability == "constant";
    let declared = handed.xml.variables.iter().zip(&handed.unit.declared);
    let all: Vec<_> = declared.filter(|(variable, declared)| of(declared) && is_free(variable)).collect();
    let diagonal = |declared: &str| {
        let indices = declared.split(['[', ',', ']']).skip(1).filter(|index| !index.is_empty()).collect::<Vec<_>>();
        indices.len() == 2 && indices[0] == indices[1]
    };
    let zero = |variable: &Variable| variable.start.as_deref().and_then(|text| text.parse().ok()) == Some(0.0);
    let is_diagonal = all.iter().any(|(_, declared)| declared.contains(','))
        && all.iter().all(|(variable, declared)| diagonal(declared) || zero(variable));
    all.into_iter().filter(|(_, declared)| !is_diagonal || diagonal(declared)).map(|(variable, _)| variable).collect()
}

/// Start values of some elements: only one if all are equal, and at most six.
fn starts(elements: &[&Variable]) -> String {
    let figures: Vec<String> = elements.iter().map(|variable| figure(variable, variable.start.as_deref())).collect();
    if figures.iter().all(|text| *text == figures[0]) {
        return figures[0].clone();
    }
    let shown = figures.iter().take(6).cloned().collect::<Vec<_>>().join(", ");
    if figures.len() > 6 { format!("{shown}, …") } else { shown }
}

/// Appends the log categories, and when each is used.
pub fn push_warnings(page: &mut String, handed: &Handed) {
    if handed.unit.warnings.is_empty() {
        return;
    }
    page.push_str(
        "<h2 id=\"warnings\">Warnings</h2>\n<p>The FMU logs these categories to the simulation tool.</p>\n<div \
         class=\"scroll\"><table>\n<tr><th>category<th>when\n",
    );
    for (category, text) in &handed.unit.warnings {
        let _ = writeln!(page, "<tr><td><code>{}</code><td>{}", escaped(category), escaped(text));
    }
    page.push_str("</table></div>\n");
}

/// Appends the limitations of the FMU; nothing for kinds that name none.
pub fn push_limits(page: &mut String, handed: &Handed) {
    let limits = handed.entry.map_or("", |entry| entry.guide.limits);
    let mut seen = Vec::new();
    let parts = handed.parts.iter().filter_map(|part| Some((part.name, part.entry?)));
    let parts = parts.filter(|(_, entry)| !entry.guide.limits.is_empty()).filter(|(_, entry)| {
        let new = !seen.contains(&entry.kind.name);
        seen.push(entry.kind.name);
        new
    });
    let parts: String = parts
        .map(|(name, entry)| format!("<h3>{}</h3>\n{}", escaped(name), handed.to_html(entry.guide.limits)))
        .collect();
    if !limits.is_empty() {
        let _ = write!(page, "<h2 id=\"limits\">Limitations</h2>\n{}{parts}", handed.to_html(limits));
    }
}
