//! ModelStructure: the outputs, derivatives and unknowns at the start, and their dependencies.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use super::findings::{At, Findings, Lines, short};
use super::text::one_of;
use super::variables::Variable;
use crate::model_description::{child, elements};

const SECTION: &str = "2.2.8";

/// A list of unknowns from the file.
struct List<'a, 'input, 'v> {
    name: &'static str,
    variables: &'v [Variable<'a, 'input>],
    lines: &'v Lines,
}

/// Checks the lists of the structure.
pub(super) fn check(root: Node, variables: &[Variable], lines: &Lines, findings: &mut Findings) {
    let Some(structure) = child(root, "ModelStructure") else { return };
    let at = lines.at(structure);
    let mut listed = |name: &'static str| {
        let unknowns: Vec<Node> =
            child(structure, name).into_iter().flat_map(|node| elements(node, "Unknown")).collect();
        List { name, variables, lines }.check(&unknowns, findings)
    };
    let (outputs, derivatives, initial) = (listed("Outputs"), listed("Derivatives"), listed("InitialUnknowns"));
    check_outputs(variables, &outputs, &at, findings);
    for place in &derivatives {
        let variable = &variables[*place];
        if variable.attribute("derivative").is_none() {
            let what = "it is listed in Derivatives, but has no attribute derivative";
            findings.error(variable.at(), what, SECTION, "set derivative to the index of its state");
        }
    }
    check_states(root, variables, &derivatives, &at, findings);
    check_initial(variables, &outputs, &derivatives, &initial, &at, findings);
}

impl List<'_, '_, '_> {
    /// Checks the unknowns one by one; returns the places of their variables, from 0, as far as they exist.
    fn check(&self, unknowns: &[Node], findings: &mut Findings) -> Vec<usize> {
        let mut lines = HashMap::new();
        let mut places = Vec::new();
        for unknown in unknowns {
            let line = self.lines.of_node(*unknown);
            let text = unknown.attribute("index").unwrap_or_default();
            let Ok(index) = text.trim().parse::<usize>() else { continue };
            let Some(variable) = index.checked_sub(1).and_then(|place| self.variables.get(place)) else {
                self.refuse_index(line, text, "index", findings);
                continue;
            };
            let at = At::named(line, variable.name);
            if let Some(earlier) = lines.insert(index, line) {
                let what = format!("it is listed twice in {}, first in line {earlier}", self.name);
                findings.error(at.clone(), what, SECTION, "list it once");
            } else {
                places.push(index - 1);
            }
            self.check_dependencies(*unknown, &at, findings);
        }
        places
    }

    fn refuse_index(&self, line: u32, text: &str, key: &str, findings: &mut Findings) {
        let what = format!("{key} = \"{text}\" in {}", self.name);
        let advice = format!("it must be the index of a variable, from 1 to {}", self.variables.len());
        findings.error(At::line(line), what, SECTION, advice);
    }

    fn check_dependencies(&self, unknown: Node, at: &At, findings: &mut Findings) {
        let words = |name| unknown.attribute(name).map(|text| text.split_whitespace().collect::<Vec<_>>());
        let (on, kinds) = (words("dependencies"), words("dependenciesKind"));
        let mut seen = HashSet::new();
        for word in on.iter().flatten() {
            let Ok(index) = word.parse::<usize>() else { continue };
            if !(1..=self.variables.len()).contains(&index) {
                self.refuse_index(at.line.unwrap_or_default(), word, "dependencies", findings);
            } else if !seen.insert(index) {
                let what = format!("dependencies list variable {index} twice");
                findings.error(at.clone(), what, SECTION, "list it once");
            }
        }
        match (&on, &kinds) {
            (None, Some(_)) => {
                let what = "dependenciesKind is given without dependencies";
                findings.error(at.clone(), what, SECTION, "add dependencies, or remove dependenciesKind");
            }
            (Some(on), Some(kinds)) if on.len() != kinds.len() => {
                let what =
                    format!("there are {} dependencies, but {} entries in dependenciesKind", on.len(), kinds.len());
                findings.error(at.clone(), what, SECTION, "give each dependency a kind");
            }
            _ => {}
        }
        const AT_START: [&str; 2] = ["dependent", "constant"];
        let other = kinds.iter().flatten().find(|kind| self.name == "InitialUnknowns" && !AT_START.contains(kind));
        if let Some(kind) = other {
            let what = format!("dependenciesKind = \"{kind}\" in {}", self.name);
            findings.error(at.clone(), what, SECTION, format!("here it must be {}", one_of(&AT_START)));
        }
    }
}

/// Checks that the list of outputs has exactly the variables that are outputs.
fn check_outputs(variables: &[Variable], outputs: &[usize], at: &At, findings: &mut Findings) {
    let listed: HashSet<usize> = outputs.iter().copied().collect();
    for (place, variable) in variables.iter().enumerate() {
        match (variable.causality == "output", listed.contains(&place)) {
            (true, false) => {
                let what = "it is an output, but is not listed in Outputs";
                let at = At::named(at.line, variable.name);
                findings.error(at, what, SECTION, format!("add <Unknown index=\"{}\"/> to Outputs", place + 1));
            }
            (false, true) => {
                let what = format!("it is listed in Outputs, but has causality {}", variable.causality);
                findings.error(variable.at(), what, SECTION, "remove it from Outputs, or make it an output");
            }
            _ => {}
        }
    }
}

/// Checks, for model exchange, that the list has one derivative for each state.
fn check_states(root: Node, variables: &[Variable], derivatives: &[usize], at: &At, findings: &mut Findings) {
    let mut states = HashMap::new();
    for place in derivatives {
        let variable = &variables[*place];
        if let Some(state) = variable.derivative_of()
            && let Some(other) = states.insert(state, variable.name)
        {
            let what = format!("`{}` is a derivative of the same state", short(other));
            findings.error(variable.at(), what, SECTION, "list one derivative for each state");
        }
    }
    let listed: HashSet<usize> = derivatives.iter().copied().collect();
    // The derivative of an input is an input.
    let unlisted = |(place, variable): &(usize, &Variable)| {
        variable.derivative_of().is_some() && variable.causality != "input" && !listed.contains(place)
    };
    for (place, variable) in variables.iter().enumerate().filter(unlisted) {
        if child(root, "ModelExchange").is_some() {
            let what = "it has the attribute derivative, but is not listed in Derivatives";
            let at = At::named(at.line, variable.name);
            let advice = format!("add <Unknown index=\"{}\"/> if it is the derivative of a state", place + 1);
            findings.warning(at, what, SECTION, advice);
        }
    }
}

/// Checks that the list has the variables that are computed at the start, and no others.
fn check_initial(
    variables: &[Variable],
    outputs: &[usize],
    derivatives: &[usize],
    initial: &[usize],
    at: &At,
    findings: &mut Findings,
) {
    let states = derivatives.iter().filter_map(|place| variables[*place].derivative_of()?.checked_sub(1));
    let unknown =
        |place: &usize| variables.get(*place).is_some_and(|v| matches!(v.initial, Some("calculated" | "approx")));
    let candidates = outputs.iter().copied().chain(derivatives.iter().copied()).chain(states);
    let calculated = variables.iter().enumerate().filter(|(_, variable)| variable.causality == "calculatedParameter");
    let expected: HashSet<usize> = candidates.filter(unknown).chain(calculated.map(|(place, _)| place)).collect();
    let listed: HashSet<usize> = initial.iter().copied().collect();
    for (place, variable) in variables.iter().enumerate() {
        match (expected.contains(&place), listed.contains(&place)) {
            (true, false) => {
                let what = "it is computed during initialization, but is not listed in InitialUnknowns";
                let at = At::named(at.line, variable.name);
                findings.error(at, what, SECTION, format!("add <Unknown index=\"{}\"/> to InitialUnknowns", place + 1));
            }
            (false, true) => {
                let what = "it is listed in InitialUnknowns, but is not an output, state, derivative or calculated \
                    parameter computed during initialization";
                findings.error(variable.at(), what, SECTION, "remove it from InitialUnknowns");
            }
            _ => {}
        }
    }
}
