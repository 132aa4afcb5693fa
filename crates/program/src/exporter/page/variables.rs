//! Tables of an FMU's variables.

use std::fmt::Write;

use super::guide::push_alone;
use super::{Handed, escaped};
use crate::model_description::Variable;
use crate::report::number;

/// Appends inputs and outputs.
pub fn push_pins(page: &mut String, handed: &Handed) {
    let is_pin = |variable: &Variable| matches!(variable.causality.as_str(), "input" | "output");
    if handed.xml.variables.iter().any(is_pin) {
        page.push_str("<h2 id=\"pins\">Inputs and outputs</h2>\n");
        push_alone(page, handed);
        push(page, handed, &[("input", "Inputs"), ("output", "Outputs")]);
    }
}

/// Appends all other variables.
pub fn push_others(page: &mut String, handed: &Handed) {
    page.push_str("<h2 id=\"variables\">All other variables</h2>\n");
    push(page, handed, &[("parameter", "Parameters"), ("local", "Local variables")]);
}

fn push(page: &mut String, handed: &Handed, causalities: &[(&str, &str)]) {
    for (causality, title) in causalities {
        let mut variables = handed.xml.variables.iter().filter(|variable| variable.causality == *causality).peekable();
        if variables.peek().is_none() {
            continue;
        }
        let is_set = matches!(*causality, "input" | "parameter");
        let columns = if is_set { "<th>unit<th>start<th>allowed<th>changes" } else { "<th>unit<th>changes" };
        let _ = writeln!(
            page,
            "<h3>{title}</h3>\n<div class=\"scroll wide\"><table>\n<tr><th>name<th>description{columns}"
        );
        for variable in variables {
            let start = figure(variable, variable.start.as_deref());
            let limits = allowed(variable);
            let (unit, changes) = (unit_of(variable), variable.variability.as_str());
            let set = [variable.description.as_str(), unit, &start, &limits, changes];
            let shown = [variable.description.as_str(), unit, changes];
            let cells: String = if is_set { &set[..] } else { &shown[..] }
                .iter()
                .map(|text| format!("<td>{}", escaped(text)))
                .collect();
            let _ = writeln!(page, "<tr><td><code>{}</code>{cells}", escaped(&variable.name));
        }
        page.push_str("</table></div>\n");
    }
}

/// The unit of a variable; empty if it has none.
pub fn unit_of(variable: &Variable) -> &str {
    variable.unit.as_deref().unwrap_or_default()
}

/// The allowed values.
pub fn allowed(variable: &Variable) -> String {
    if !variable.items.is_empty() {
        return variable.items.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    }
    let [min, max] = [&variable.min, &variable.max].map(|limit| {
        let limit = limit.as_deref().filter(|text| !variable.is_no_limit(text));
        limit.map(|text| figure(variable, Some(text)))
    });
    match (min, max) {
        (Some(min), Some(max)) => format!("{min} … {max}"),
        (Some(min), None) => format!("≥ {min}"),
        (None, Some(max)) => format!("≤ {max}"),
        (None, None) => String::new(),
    }
}

/// A short text for a value of a variable: an item's name, or a number without needless digits.
pub fn figure(variable: &Variable, text: Option<&str>) -> String {
    let text = text.unwrap_or_default();
    if let Some((name, _)) = variable.items.iter().find(|(_, item)| item.to_string() == text) {
        return name.clone();
    }
    match text.parse::<f64>() {
        Ok(_) if variable.is_no_limit(text) => "no limit".to_owned(),
        Ok(value) => number(value),
        Err(_) => text.to_owned(),
    }
}
