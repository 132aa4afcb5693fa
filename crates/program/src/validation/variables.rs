//! Variables one by one: types, variability and start values.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use super::findings::{At, Findings, Lines, short};
use super::text::{boolean, one_of};
use super::types::Types;
use crate::model_description::{child, elements};

/// The section of the standard that defines variables.
pub(super) const SECTION: &str = "2.2.7";

/// A variable as the file declares it, with the defaults of the standard.
#[derive(Debug)]
pub(super) struct Variable<'a, 'input> {
    pub name: &'a str,
    pub line: u32,
    /// Real, Integer, Boolean, String or Enumeration; empty if it has no type.
    pub kind: &'a str,
    pub reference: Option<u32>,
    pub causality: &'a str,
    pub variability: &'a str,
    /// None where it can't have one.
    pub initial: Option<&'a str>,
    pub node: Node<'a, 'input>,
    /// The element of its type.
    pub value: Option<Node<'a, 'input>>,
}

/// The values of `initial` for a causality and variability, the default first; none if it must be absent. `Err` if
/// there are no such variables.
fn starts(causality: &str, variability: &str) -> Result<&'static [&'static str], String> {
    let variabilities: &[&str] = match causality {
        "parameter" | "calculatedParameter" => &["fixed", "tunable"],
        "input" => &["discrete", "continuous"],
        "output" => &["constant", "discrete", "continuous"],
        "independent" => &["continuous"],
        _ => &["constant", "fixed", "tunable", "discrete", "continuous"],
    };
    if !variabilities.contains(&variability) {
        return Err(one_of(variabilities));
    }
    Ok(match (causality, variability) {
        ("input" | "independent", _) => &[],
        ("parameter", _) | (_, "constant") => &["exact"],
        (_, "fixed" | "tunable") => &["calculated", "approx"],
        _ => &["calculated", "exact", "approx"],
    })
}

impl<'a, 'input> Variable<'a, 'input> {
    /// All variables of a description.
    pub fn all(root: Node<'a, 'input>, lines: &Lines) -> Vec<Self> {
        let list = child(root, "ModelVariables").into_iter().flat_map(|node| elements(node, "ScalarVariable"));
        list.map(|node| Variable::new(node, lines)).collect()
    }

    fn new(node: Node<'a, 'input>, lines: &Lines) -> Self {
        const TYPES: [&str; 5] = ["Real", "Integer", "Boolean", "String", "Enumeration"];
        let value = node.children().find(|child| child.is_element() && TYPES.contains(&child.tag_name().name()));
        let kind = value.map_or("", |value| value.tag_name().name());
        let causality = node.attribute("causality").unwrap_or("local");
        let usual = if kind == "Real" { "continuous" } else { "discrete" };
        let variability = node.attribute("variability").unwrap_or(usual);
        let usual = starts(causality, variability).ok().and_then(|starts| starts.first().copied());
        Variable {
            name: node.attribute("name").unwrap_or_default(),
            line: lines.of_node(node),
            kind,
            reference: node.attribute("valueReference").and_then(|text| text.trim().parse().ok()),
            causality,
            variability,
            initial: node.attribute("initial").or(usual),
            node,
            value,
        }
    }

    /// An attribute of its type.
    pub fn attribute(&self, name: &str) -> Option<&'a str> {
        self.value.and_then(|value| value.attribute(name))
    }

    /// Its own unit, or that of its type.
    pub fn unit(&self, types: &Types<'a, '_>) -> Option<&'a str> {
        let declared = || types.get(self.attribute("declaredType")?)?.attribute("unit");
        self.attribute("unit").or_else(declared)
    }

    pub fn at(&self) -> At {
        At::named(self.line, self.name)
    }

    /// The place of the variable whose derivative it is, from 1.
    pub fn derivative_of(&self) -> Option<usize> {
        self.attribute("derivative").and_then(|text| text.trim().parse().ok())
    }
}

/// Checks names, combinations of attributes, and start values.
pub(super) fn check(variables: &[Variable], findings: &mut Findings) {
    check_names(variables, findings);
    let states: HashSet<usize> = variables.iter().filter_map(Variable::derivative_of).collect();
    for (place, variable) in variables.iter().enumerate() {
        check_combination(variable, findings);
        check_start(variable, findings);
        check_derivative(variable, variables, findings);
        if variable.attribute("reinit").and_then(boolean) == Some(true) && !states.contains(&(place + 1)) {
            findings.error(
                variable.at(),
                "reinit = \"true\", but the variable is not a state",
                SECTION,
                "remove reinit",
            );
        }
    }
    let mut independent = variables.iter().filter(|variable| variable.causality == "independent");
    if let (Some(first), Some(second)) = (independent.next(), independent.next()) {
        let what = format!("there are two independent variables; the first is `{}`", short(first.name));
        findings.error(second.at(), what, SECTION, "declare at most one, for time");
    }
}

fn check_names(variables: &[Variable], findings: &mut Findings) {
    let mut lines = HashMap::new();
    for variable in variables {
        if variable.name.is_empty() {
            findings.error(At::line(variable.line), "a variable has an empty name", SECTION, "give it a name");
        } else if let Some(line) = lines.insert(variable.name, variable.line) {
            let what = format!("the variable in line {line} already has this name");
            findings.error(variable.at(), what, SECTION, "give each variable a unique name");
        }
    }
}

fn check_combination(variable: &Variable, findings: &mut Findings) {
    let Variable { kind, causality, variability, .. } = variable;
    if *variability == "continuous" && !matches!(*kind, "Real" | "") {
        let what = format!("variability = \"continuous\", but the type is {kind}");
        findings.error(variable.at(), what, SECTION, "only a Real can be continuous; use variability = \"discrete\"");
    }
    let initial = variable.node.attribute("initial");
    match starts(causality, variability) {
        Err(allowed) => {
            let what = format!("causality = \"{causality}\" with variability = \"{variability}\"");
            findings.error(variable.at(), what, SECTION, format!("the variability must be {allowed}"));
        }
        Ok([]) => {
            if let Some(initial) = initial {
                let what = format!("initial = \"{initial}\" with causality = \"{causality}\"");
                findings.error(variable.at(), what, SECTION, "remove initial; it is not allowed here");
            }
        }
        Ok(starts) => {
            if let Some(initial) = initial.filter(|initial| !starts.contains(initial)) {
                let what = format!(
                    "initial = \"{initial}\" with variability = \"{variability}\" and causality = \"{causality}\""
                );
                findings.error(variable.at(), what, SECTION, format!("initial must be {}", one_of(starts)));
            }
        }
    }
    if *causality == "independent" && *kind != "Real" {
        let what = format!("the independent variable has type {kind}");
        findings.error(variable.at(), what, SECTION, "make it a Real");
    }
    if variable.node.attribute("canHandleMultipleSetPerTimeInstant").is_some() && *causality != "input" {
        let what = format!("canHandleMultipleSetPerTimeInstant with causality = \"{causality}\"");
        findings.error(variable.at(), what, SECTION, "remove it; only inputs may have it");
    }
}

fn check_start(variable: &Variable, findings: &mut Findings) {
    let Variable { causality, variability, initial, .. } = variable;
    let has_start = variable.attribute("start").is_some();
    let needs = matches!(initial, Some("exact" | "approx")) || *causality == "input" || *variability == "constant";
    let because = match (initial, *causality) {
        (_, "independent") => "causality = \"independent\"".to_owned(),
        (Some(initial), _) => format!("initial = \"{initial}\""),
        (None, _) => format!("causality = \"{causality}\""),
    };
    if needs && !has_start && variable.value.is_some() {
        findings.error(
            variable.at(),
            format!("there is no start value, but {because} requires one"),
            SECTION,
            "give it a start value",
        );
    }
    if has_start && (*initial == Some("calculated") || *causality == "independent") {
        findings.error(
            variable.at(),
            format!("there is a start value, but {because} allows none"),
            SECTION,
            "remove the start value",
        );
    }
}

fn check_derivative(variable: &Variable, variables: &[Variable], findings: &mut Findings) {
    if let Some(text) = variable.attribute("derivative") {
        let state = variable.derivative_of().and_then(|place| variables.get(place.checked_sub(1)?));
        match state {
            None => {
                let what = format!("derivative = \"{text}\"");
                let advice = format!("it must be the index of a variable, from 1 to {}", variables.len());
                findings.error(variable.at(), what, SECTION, advice);
            }
            Some(state) if state.kind != "Real" || state.variability != "continuous" => {
                let name = short(state.name);
                let what = format!("it is the derivative of `{name}`, a {} {}", state.variability, state.kind);
                findings.error(variable.at(), what, SECTION, "only a continuous Real has a derivative");
            }
            Some(state) if std::ptr::eq(state, variable) => {
                findings.error(variable.at(), "it is its own derivative", SECTION, "give the index of the state");
            }
            // A master that knows the derivative of an input passes it by another one.
            Some(state) if (state.causality, variable.causality) == ("input", "input") => {}
            Some(state) if !matches!(state.causality, "local" | "output") => {
                let article = if state.causality.starts_with('i') { "an" } else { "a" };
                let what = format!("it is the derivative of `{}`, {article} {}", short(state.name), state.causality);
                findings.warning(variable.at(), what, SECTION, "a state must have causality local or output");
            }
            Some(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_start_how_is_the_table_of_the_standard() {
        for (causality, variability, expected) in [
            ("parameter", "fixed", &["exact"][..]),
            ("calculatedParameter", "tunable", &["calculated", "approx"]),
            ("input", "continuous", &[]),
            ("output", "constant", &["exact"]),
            ("output", "discrete", &["calculated", "exact", "approx"]),
            ("local", "fixed", &["calculated", "approx"]),
            ("local", "continuous", &["calculated", "exact", "approx"]),
            ("independent", "continuous", &[]),
        ] {
            assert_eq!(starts(causality, variability), Ok(expected), "{causality} {variability}");
        }
        for (causality, variability) in [
            ("parameter", "constant"),
            ("parameter", "continuous"),
            ("calculatedParameter", "discrete"),
            ("input", "fixed"),
            ("output", "tunable"),
            ("independent", "discrete"),
        ] {
            assert!(starts(causality, variability).is_err(), "{causality} {variability}");
        }
    }
}
