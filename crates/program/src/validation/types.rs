//! Checks that used units and types are defined, and each only once.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use super::findings::{At, Findings, Lines, short};
use super::text::double;
use super::variables::{SECTION, Variable};
use crate::model_description::{child, elements};

/// The types of a description by their names, each with the element of its kind.
pub(super) type Types<'a, 'input> = HashMap<&'a str, Node<'a, 'input>>;

pub(super) fn types<'a, 'input>(root: Node<'a, 'input>) -> Types<'a, 'input> {
    let list = child(root, "TypeDefinitions").into_iter().flat_map(|node| elements(node, "SimpleType"));
    list.filter_map(|node| Some((node.attribute("name")?, node.children().find(Node::is_element)?))).collect()
}

/// Checks units and types, and that those of variables are defined.
pub(super) fn check(root: Node, variables: &[Variable], lines: &Lines, findings: &mut Findings) {
    let units = check_units(root, lines, findings);
    check_types(root, variables, lines, findings);
    let types = types(root);
    for (name, node) in &types {
        check_unit(*node, None, &units, &|| At::named(lines.of_node(*node), name), findings);
    }
    for variable in variables {
        let Some(value) = variable.value else { continue };
        let declared = variable.attribute("declaredType");
        let found = declared.and_then(|name| types.get(name)).copied();
        match (declared, found) {
            (Some(name), None) => {
                let what = format!("the type `{name}` is not defined");
                findings.error(variable.at(), what, SECTION, "define it in TypeDefinitions");
            }
            (Some(name), Some(node)) if node.tag_name().name() != variable.kind => {
                let (name, kind) = (short(name), node.tag_name().name());
                let what = format!("its type is {}, but `{name}` is defined for {kind}", variable.kind);
                findings.error(variable.at(), what, SECTION, "use a type defined for the same kind");
            }
            _ => {}
        }
        check_unit(value, found, &units, &|| variable.at(), findings);
    }
}

/// The units with their display units.
type Units<'a> = HashMap<&'a str, HashSet<&'a str>>;

fn check_units<'a>(root: Node<'a, '_>, lines: &Lines, findings: &mut Findings) -> Units<'a> {
    let mut units = Units::new();
    for unit in child(root, "UnitDefinitions").into_iter().flat_map(|node| elements(node, "Unit")) {
        let name = unit.attribute("name").unwrap_or_default();
        let (mut shown, short_name) = (HashSet::new(), short(name));
        for display in elements(unit, "DisplayUnit") {
            let other = display.attribute("name").unwrap_or_default();
            if !shown.insert(other) {
                let what = format!("the display unit `{other}` of `{short_name}` is defined twice");
                findings.error(lines.at(display), what, "2.2.2", "define it once");
            }
        }
        for node in unit.children().filter(Node::is_element) {
            if node.attribute("factor").and_then(double) == Some(0.0) {
                let what = format!("factor = 0 in the unit `{short_name}`");
                findings.error(lines.at(node), what, "2.2.2", "give a factor other than 0");
            }
        }
        if units.insert(name, shown).is_some() {
            let what = format!("the unit `{name}` is defined twice");
            findings.error(lines.at(unit), what, "2.2.2", "define each unit once");
        }
    }
    units
}

fn check_types(root: Node, variables: &[Variable], lines: &Lines, findings: &mut Findings) {
    let variables: HashSet<&str> = variables.iter().map(|variable| variable.name).collect();
    let mut known = HashSet::new();
    for node in child(root, "TypeDefinitions").into_iter().flat_map(|node| elements(node, "SimpleType")) {
        let name = node.attribute("name").unwrap_or_default();
        if !known.insert(name) {
            let what = format!("the type `{name}` is defined twice");
            findings.error(lines.at(node), what, "2.2.3", "define each type once");
        }
        if variables.contains(name) {
            let what = format!("the type `{name}` has the same name as a variable");
            findings.error(lines.at(node), what, "2.2.3", "rename it");
        }
        let items: Vec<Node> = elements(node, "Enumeration").flat_map(|node| elements(node, "Item")).collect();
        let short_name = short(name);
        for key in ["name", "value"] {
            let mut found = HashSet::new();
            for item in &items {
                let value = item.attribute(key).unwrap_or_default();
                if !found.insert(value) {
                    let what = format!("two items of the type `{short_name}` have the {key} {value}");
                    findings.error(lines.at(*item), what, "2.2.3", format!("give each a unique {key}"));
                }
            }
        }
    }
}

/// Checks the units of a variable or type; missing ones are those of its type.
fn check_unit(node: Node, declared: Option<Node>, units: &Units, at: &dyn Fn() -> At, findings: &mut Findings) {
    let own = node.attribute("unit");
    let inherited = declared.and_then(|declared| declared.attribute("unit"));
    if let Some(unit) = own.filter(|unit| !units.contains_key(unit)) {
        let what = format!("the unit `{unit}` is not defined");
        findings.error(at(), what, "2.2.2", "define it in UnitDefinitions");
    }
    let Some(display) = node.attribute("displayUnit") else { return };
    match own.or(inherited) {
        None => {
            let what = format!("displayUnit = \"{display}\" without a unit");
            findings.error(at(), what, "2.2.3", "add the unit");
        }
        Some(unit) if units.get(unit).is_some_and(|shown| !shown.contains(display)) => {
            let what = format!("the display unit `{display}` of the unit `{}` is not defined", short(unit));
            findings.warning(at(), what, "2.2.2", "tools ignore it; define it as DisplayUnit of that unit");
        }
        Some(_) => {}
    }
}
