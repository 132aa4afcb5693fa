//! Variables that share a value: the same type and the same value reference.

use std::collections::BTreeMap;

use roxmltree::Node;

use super::findings::{Findings, short};
use super::text::{boolean, double};
use super::types::{Types, types};
use super::variables::{SECTION, Variable};

/// Checks that variables with the same value agree on it.
pub(super) fn check(root: Node, variables: &[Variable], findings: &mut Findings) {
    let types = types(root);
    let mut shared: BTreeMap<(&str, u32), Vec<&Variable>> = BTreeMap::new();
    for variable in variables {
        if let Some(reference) = variable.reference {
            // In the standard, Enumeration uses the functions of Integer.
            let kind = if variable.kind == "Enumeration" { "Integer" } else { variable.kind };
            shared.entry((kind, reference)).or_default().push(variable);
        }
    }
    for ((_, reference), set) in shared.iter().filter(|(_, set)| set.len() > 1) {
        check_set(*reference, set, &types, findings);
    }
}

/// True if two constants have the same value, in any notation.
fn same_value(first: &Variable, second: &Variable) -> bool {
    let (Some(a), Some(b)) = (first.attribute("start"), second.attribute("start")) else {
        return first.attribute("start") == second.attribute("start");
    };
    match first.kind {
        "String" => a == b,
        "Boolean" => boolean(a) == boolean(b),
        _ => match (double(a), double(b)) {
            (Some(a), Some(b)) => a == b || (a.is_nan() && b.is_nan()),
            _ => a == b,
        },
    }
}

fn check_set(reference: u32, set: &[&Variable], types: &Types, findings: &mut Findings) {
    let first = set[0];
    let shared = |other: &Variable| format!("it shares valueReference {reference} with `{}`", short(other.name));
    for variable in &set[1..] {
        if (variable.variability == "constant") != (first.variability == "constant") {
            let what = format!("{}, but only one of them is constant", shared(first));
            findings.error(variable.at(), what, SECTION, "give it its own value reference");
        } else if variable.variability == "constant" && !same_value(variable, first) {
            let what = format!("{}, a constant with a different value", shared(first));
            findings.error(variable.at(), what, SECTION, "give constants with the same reference the same value");
        }
        if variable.unit(types) != first.unit(types) {
            let what = format!("{}, which has a different unit", shared(first));
            findings.warning(variable.at(), what, SECTION, "give both the same unit");
        }
    }
    let changing = set.iter().filter(|variable| variable.variability != "constant");
    let mut set_by_master = changing.filter(|variable| variable.attribute("start").is_some());
    if let Some(settable) = set_by_master.next() {
        for variable in set_by_master {
            let what = format!("{}, and both have a start value", shared(settable));
            findings.error(variable.at(), what, SECTION, "give at most one of them a start value");
        }
    }
}
