//! Checks that start values, limits and nominal values are consistent.

use roxmltree::Node;

use super::findings::{At, Findings, Lines};
use super::text::double;
use super::types::{Types, types};
use super::variables::{SECTION, Variable};
use crate::model_description::elements;

/// Checks variables and types.
pub(super) fn check(root: Node, variables: &[Variable], lines: &Lines, findings: &mut Findings) {
    let types = types(root);
    for (name, node) in &types {
        let at = || At::named(lines.of_node(*node), name);
        check_limits(&|key| node.attribute(key).and_then(double), &at, "2.2.3", findings);
    }
    for variable in variables {
        check_variable(variable, &types, findings);
    }
}

fn check_variable(variable: &Variable, types: &Types, findings: &mut Findings) {
    let declared = variable.attribute("declaredType").and_then(|name| types.get(name)).copied();
    let inherited = |key: &str| declared.and_then(|node| node.attribute(key));
    let number = |key: &str| variable.attribute(key).or_else(|| inherited(key)).and_then(double);
    if matches!(variable.kind, "Real" | "Integer" | "Enumeration") {
        check_limits(&number, &|| variable.at(), SECTION, findings);
    }
    let start = variable.attribute("start").and_then(double);
    if variable.kind == "Real"
        && let Some(start) = start.filter(|start| !start.is_finite())
    {
        let what = format!("start = {start}");
        findings.warning(variable.at(), what, SECTION, "use a finite value; many tools can't set any other");
    }
    let items: Vec<f64> = declared
        .into_iter()
        .flat_map(|node| elements(node, "Item"))
        .filter_map(|item| item.attribute("value").and_then(double))
        .collect();
    let of_no_item = |start: &f64| variable.kind == "Enumeration" && !items.is_empty() && !items.contains(start);
    if let Some(start) = start.filter(of_no_item) {
        let what = format!("start = {start} matches no item of its type");
        findings.error(variable.at(), what, SECTION, "use the value of an item");
    }
}

fn check_limits(
    number: &dyn Fn(&str) -> Option<f64>,
    at: &dyn Fn() -> At,
    section: &'static str,
    findings: &mut Findings,
) {
    let (min, max, start) = (number("min"), number("max"), number("start"));
    for (key, value) in [("min", min), ("max", max)] {
        if value.is_some_and(f64::is_nan) {
            findings.error(at(), format!("{key} is NaN"), section, "use a number");
        }
    }
    if let (Some(min), Some(max)) = (min, max)
        && min > max
    {
        findings.error(at(), format!("min = {min} is above max = {max}"), section, "swap them");
        return;
    }
    let (least, most) = (min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY));
    if let Some(start) = start.filter(|start| *start < least || *start > most) {
        let what = format!("start = {start} is outside its limits, {least} … {most}");
        findings.error(at(), what, section, "use a start value within them");
    }
    if let Some(nominal) = number("nominal").filter(|nominal| !(*nominal > 0.0 && nominal.is_finite())) {
        findings.error(at(), format!("nominal = {nominal}"), section, "it must be a finite number above 0");
    }
}
