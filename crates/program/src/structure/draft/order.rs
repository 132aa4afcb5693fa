//! Roles and names of the components in the loop, and the order in which they are stepped.

use std::collections::{BTreeSet, HashSet};

use super::wiring::Wires;
use super::{DraftUnit, Role};
use crate::catalogue;

/// The roles of components. If none is known to be a controller, the one that a reference goes to is taken as it.
pub fn roles(units: &[DraftUnit], wires: &Wires) -> Vec<Role> {
    let known = |unit: &DraftUnit| match unit.role() {
        Some(catalogue::Role::Reference) => Some(Role::Reference),
        Some(catalogue::Role::Controller) => Some(Role::Controller),
        Some(
            catalogue::Role::Sensor
            | catalogue::Role::Actuator
            | catalogue::Role::Observer
            // Stepped after the plant, so that a row of a record has the input that acts from then on.
            | catalogue::Role::Excitation,
        ) => Some(Role::Between),
        Some(catalogue::Role::Plant) => Some(Role::Plant),
        Some(catalogue::Role::Composite) => None,
        None if unit.description.variables.iter().any(|variable| variable.causality == "input") => None,
        None => Some(Role::Reference),
    };
    let known: Vec<_> = units.iter().map(known).collect();
    let is_reference = |unit: usize| known[unit] == Some(Role::Reference);
    let driven: HashSet<usize> =
        wires.connections().filter(|(from, _)| is_reference(from.0)).map(|(_, to)| to.0).collect();
    let has_controller = known.contains(&Some(Role::Controller));
    let guess = |unit: usize| if driven.contains(&unit) && !has_controller { Role::Controller } else { Role::Plant };
    known.iter().enumerate().map(|(unit, role)| role.unwrap_or_else(|| guess(unit))).collect()
}

/// The places of components in the order in which they are stepped: each after those on which its outputs depend
/// directly, as far as there is such an order; references first, then plants.
pub fn order(units: &[DraftUnit], roles: &[Role], wires: &Wires) -> Vec<usize> {
    let mut sources = vec![BTreeSet::new(); units.len()];
    for (from, (unit, input)) in wires.connections().filter(|(from, to)| from.0 != to.0) {
        let description = &units[unit].description;
        // A plant that declares no dependencies is taken to have states between its inputs and outputs.
        let undeclared = roles[unit] != Role::Plant;
        let declared = &description.dependencies;
        let shows = declared.iter().any(|(_, on)| on.as_ref().map_or(undeclared, |on| on.contains(&input)));
        let outputs = description.variables.iter().filter(|variable| variable.causality == "output").count();
        if units[unit].hands_on() || shows || undeclared && declared.len() < outputs {
            sources[unit].insert(from.0);
        }
    }
    let (mut taken, mut order) = (vec![false; units.len()], Vec::new());
    while order.len() < units.len() {
        let free = (0..units.len()).filter(|&unit| !taken[unit]);
        let waits = |unit: usize| sources[unit].iter().any(|&source| !taken[source]);
        let Some(next) = free.min_by_key(|&unit| (waits(unit), roles[unit])) else { break };
        taken[next] = true;
        order.push(next);
    }
    order
}

/// Names in the loop: given names, each of them unique; names of roles that only one component has; else names of
/// files, numbered in the order of stepping if they are taken.
pub fn names(units: &[DraftUnit], roles: &[Role], stepped: &[usize]) -> Vec<String> {
    let of_role = |unit: usize| match roles[unit] {
        Role::Reference => "reference",
        Role::Plant => "plant",
        Role::Controller => "controller",
        Role::Between => units[unit].model.as_deref().unwrap_or("unit"),
    };
    let all: Vec<_> = (0..units.len()).map(of_role).collect();
    let mut used: HashSet<String> = HashSet::new();
    let own = |unit: usize| {
        units[unit].given.clone().unwrap_or_else(|| {
            let alone = all.iter().filter(|name| **name == all[unit]).count() == 1;
            if alone { all[unit].to_owned() } else { plain(&units[unit].stem) }
        })
    };
    let given: HashSet<&String> = units.iter().filter_map(|unit| unit.given.as_ref()).collect();
    let mut names = vec![String::new(); units.len()];
    for &unit in stepped {
        let wanted = own(unit);
        let is_given = units[unit].given.is_some();
        let free = |name: &String| is_given || !used.contains(name) && !given.contains(name);
        let numbered = (2..).map(|number| format!("{wanted}_{number}"));
        let name = std::iter::once(wanted.clone()).chain(numbered).find(free).unwrap_or_default();
        used.insert(name.clone());
        names[unit] = name;
    }
    names
}

/// A file's name without characters that a component's name can't have.
fn plain(stem: &str) -> String {
    let name: String = stem.chars().map(|c| if c.is_alphanumeric() || c == '-' { c } else { '_' }).collect();
    if name.is_empty() { "unit".to_owned() } else { name }
}
