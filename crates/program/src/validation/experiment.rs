//! Interfaces of an FMU, its identity, and its default experiment.

use std::collections::HashSet;

use roxmltree::Node;

use super::findings::{Findings, Lines};
use super::text::{boolean, double};
use super::variables::Variable;
use super::{Interface, Interfaces};
use crate::model_description::{child, elements};

/// Number of steps of an experiment without a communication step.
pub(super) const USUAL_STEPS: f64 = 100.0;

/// The interfaces that have names for finding libraries.
pub(super) fn interfaces(root: Node, variables: &[Variable], lines: &Lines) -> Interfaces {
    let structure = child(root, "ModelStructure").and_then(|node| child(node, "Derivatives"));
    let derivatives: Vec<Node> = structure.into_iter().flat_map(|node| elements(node, "Unknown")).collect();
    let place = |text: Option<&str>| text?.trim().parse::<usize>().ok()?.checked_sub(1);
    let state = |unknown: Node| variables.get(place(unknown.attribute("index"))?)?.derivative_of()?.checked_sub(1);
    let experiment = child(root, "DefaultExperiment");
    let number = |name: &str| experiment.and_then(|node| node.attribute(name)).and_then(double);
    let start = number("startTime").unwrap_or(0.0);
    let stop = number("stopTime").unwrap_or(start + 1.0);
    Interfaces {
        exchange: interface(root, "ModelExchange", lines),
        co_simulation: interface(root, "CoSimulation", lines),
        states: derivatives.len(),
        state_places: derivatives.into_iter().filter_map(state).collect(),
        start,
        stop,
        step: number("stepSize").unwrap_or((stop - start) / USUAL_STEPS),
    }
}

/// An interface with its flags.
pub(super) fn interface(root: Node, name: &'static str, lines: &Lines) -> Option<Interface> {
    child(root, name).map(|node| Interface {
        identifier: node.attribute("modelIdentifier").unwrap_or_default().to_owned(),
        flags: node
            .attributes()
            .filter(|attribute| boolean(attribute.value()) == Some(true))
            .map(|attribute| attribute.name().to_owned())
            .collect(),
        line: lines.of_node(node),
    })
}

/// Checks the attributes of the root and the interfaces.
pub(super) fn check(root: Node, lines: &Lines, findings: &mut Findings) {
    for name in ["modelName", "guid"] {
        if root.attribute(name).is_some_and(|text| text.trim().is_empty()) {
            findings.error(lines.at(root), format!("{name} is empty"), "2.2.1", "give it a value");
        }
    }
    for (name, section) in [("ModelExchange", "3.3.1"), ("CoSimulation", "4.3.1")] {
        let mut of_kind = elements(root, name);
        if let Some(node) = of_kind.next() {
            check_interface(node, name, section, lines, findings);
        }
        if let Some(second) = of_kind.next() {
            findings.error(lines.at(second), format!("{name} appears twice"), section, "remove one of them");
        }
    }
    if let Some(node) = child(root, "DefaultExperiment") {
        check_experiment(node, lines, findings);
    }
    let mut categories = HashSet::new();
    for node in child(root, "LogCategories").into_iter().flat_map(|node| elements(node, "Category")) {
        let name = node.attribute("name").unwrap_or_default();
        if !categories.insert(name) {
            let what = format!("the log category `{name}` appears twice");
            findings.error(lines.at(node), what, "2.2.4", "list each category once");
        }
    }
}

fn check_interface(node: Node, name: &str, section: &'static str, lines: &Lines, findings: &mut Findings) {
    let identifier = node.attribute("modelIdentifier").unwrap_or_default();
    let letter = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_';
    let is_c = identifier.bytes().next().is_some_and(|first| letter(&first))
        && identifier.bytes().all(|byte| letter(&byte) || byte.is_ascii_digit());
    if node.has_attribute("modelIdentifier") && !is_c {
        let what = format!("modelIdentifier = \"{identifier}\" of {name}");
        findings.error(
            lines.at(node),
            what,
            section,
            "it must be a C identifier, because function names may contain it",
        );
    }
    let is = |flag: &str| node.attribute(flag).and_then(boolean) == Some(true);
    if is("canSerializeFMUstate") && !is("canGetAndSetFMUstate") {
        let what = format!("canSerializeFMUstate without canGetAndSetFMUstate in {name}");
        findings.error(
            lines.at(node),
            what,
            section,
            "set both; an FMU that serialises states must also get and set them",
        );
    }
}

fn check_experiment(node: Node, lines: &Lines, findings: &mut Findings) {
    let number = |name: &str| node.attribute(name).and_then(double);
    for name in ["startTime", "stopTime", "tolerance", "stepSize"] {
        if number(name).is_some_and(|number| !number.is_finite()) {
            let what = format!("{name} = {}", node.attribute(name).unwrap_or_default());
            findings.error(lines.at(node), what, "2.2.5", "it must be finite");
        }
    }
    for name in ["tolerance", "stepSize"] {
        let what = || format!("{name} = {}", node.attribute(name).unwrap_or_default());
        match number(name) {
            // Tools write 0 if they know none.
            Some(0.0) if name == "tolerance" => {
                findings.warning(
                    lines.at(node),
                    what(),
                    "2.2.5",
                    "tools can't meet it; give a value above 0, or leave it out",
                );
            }
            Some(number) if number <= 0.0 => findings.error(lines.at(node), what(), "2.2.5", "it must be above 0"),
            _ => {}
        }
    }
    let (start, stop) = (number("startTime").unwrap_or(0.0), number("stopTime"));
    if let Some(stop) = stop.filter(|stop| *stop <= start) {
        let what = format!("stopTime = {stop} is not after startTime = {start}");
        let advice = "use a stopTime after startTime";
        if stop < start {
            findings.error(lines.at(node), what, "2.2.5", advice);
        } else {
            findings.warning(lines.at(node), what, "2.2.5", advice);
        }
    }
}
