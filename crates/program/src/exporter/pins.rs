//! The pins of an FMU: its inputs and outputs, grouped by purpose.

use std::collections::HashMap;

use crate::catalogue::Role;
use crate::fmi2::describe::DescribedUnit;
use crate::model_description::{ModelDescription, Variable};

/// Purpose of a pin in a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Reference with its derivatives.
    Reference,
    /// Measured signal of a plant.
    Measurement,
    /// Input of a sensor, or measured input of an observer.
    Measured,
    /// Estimate of an observer.
    Estimate,
    /// Control of a plant.
    Control,
    /// Command to an actuator.
    Command,
    /// Pin that needn't be connected.
    Other,
}

impl Group {
    /// Name and description of its terminal; none if its pins have none.
    pub fn terminal(self) -> Option<(&'static str, &'static str)> {
        match self {
            Group::Reference => Some(("reference", "reference with its derivatives")),
            Group::Measurement => Some(("measurement", "measurements of the plant")),
            Group::Measured => Some(("measured", "outputs of the plant that are measured")),
            Group::Estimate => Some(("estimate", "estimate of the plant's state")),
            Group::Control => Some(("control", "controls of the plant")),
            Group::Command => Some(("command", "commands of the controller")),
            Group::Other => None,
        }
    }
}

/// An input or output.
#[derive(Debug, Clone)]
pub struct Pin<'a> {
    /// The variable under its current name.
    pub variable: &'a Variable,
    /// The part of a composite that it belongs to.
    pub part: Option<&'a str>,
    /// The model's own name of it, without the part's.
    pub declared: &'a str,
    /// Its purpose.
    pub group: Group,
    /// True if it is an input.
    pub is_input: bool,
}

impl Pin<'_> {
    /// The name of the signal, equal for pins that should be connected, whatever their FMUs call it.
    pub fn member(&self, role: Option<Role>) -> String {
        let (name, index) = self.declared.split_at(self.declared.find('[').unwrap_or(self.declared.len()));
        let name = match (role, self.group, name) {
            (Some(Role::Sensor), ..) | (_, Group::Estimate, _) => "x",
            (Some(Role::Actuator), ..) => "u",
            (_, _, name) => name,
        };
        format!("{name}{index}")
    }
}

/// The pins of an FMU with a role, or of a composite, by the roles of its parts.
pub fn pins<'a>(
    unit: &'a DescribedUnit,
    xml: &'a ModelDescription,
    role: Option<Role>,
    parts: &HashMap<&'a str, Option<Role>>,
) -> Vec<(Pin<'a>, Option<Role>)> {
    let pin = |(place, variable): (usize, &'a Variable)| {
        let is_input = variable.causality == "input";
        if !is_input && variable.causality != "output" {
            return None;
        }
        let full = unit.declared.get(place).map_or(variable.name.as_str(), String::as_str);
        let part = full.split_once('.').filter(|(part, _)| parts.contains_key(part));
        let (part, declared) = part.map_or((None, full), |(part, rest)| (Some(part), rest));
        let role = part.map_or(role, |part| parts[part]);
        let name = declared.split('[').next().unwrap_or_default();
        let group = group(role, is_input, name);
        Some((Pin { variable, part, declared, group, is_input }, role))
    };
    xml.variables.iter().enumerate().filter_map(pin).collect()
}

/// Purpose of a pin by the role of its FMU and the model's own name of the pin.
fn group(role: Option<Role>, is_input: bool, name: &str) -> Group {
    let Some(role) = role else { return Group::Other };
    match (role, is_input, name) {
        (Role::Controller, true, "r" | "dr" | "ddr") | (Role::Reference, false, "r" | "dr" | "ddr") => Group::Reference,
        (Role::Controller, true, "x" | "y") | (Role::Plant, false, "x" | "y") => Group::Measurement,
        (Role::Sensor, false, "y") => Group::Measurement,
        (Role::Sensor, true, "u") | (Role::Observer, true, "y") => Group::Measured,
        (Role::Controller, true, "x_obs") | (Role::Observer, false, "x_obs") => Group::Estimate,
        (Role::Controller, false, "u") | (Role::Plant | Role::Observer, true, "u") => Group::Control,
        (Role::Actuator, false, "y" | "achieved") | (Role::Excitation, false, "u") => Group::Control,
        (Role::Actuator, true, "u") => Group::Command,
        _ => Group::Other,
    }
}

/// Joins elements to ranges: `x[1…4]` for `x[1]`, `x[2]`, `x[3]`, `x[4]`.
pub fn ranges<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    runs(names.map(|name| [name])).into_iter().map(|[range]| range).collect()
}

/// The same for rows of names whose indices all increase together.
pub fn runs<'a, const N: usize>(rows: impl Iterator<Item = [&'a str; N]>) -> Vec<[String; N]> {
    let mut runs: Vec<([&'a str; N], usize)> = Vec::new();
    for row in rows {
        let goes_on = runs.last().is_some_and(|(first, length)| (0..N).all(|k| follows(first[k], row[k], *length)));
        match runs.last_mut().filter(|_| goes_on) {
            Some((_, length)) => *length += 1,
            None => runs.push((row, 1)),
        }
    }
    runs.into_iter().map(|(first, length)| first.map(|name| range(name, length))).collect()
}

/// Name and index of a vector's element.
fn element(name: &str) -> Option<(&str, usize)> {
    let (name, index) = name.strip_suffix(']')?.rsplit_once('[')?;
    Some((name, index.parse().ok()?))
}

/// True if a name is that of the element `places` after the first one.
fn follows(first: &str, name: &str, places: usize) -> bool {
    let (Some((vector, begin)), Some((same, index))) = (element(first), element(name)) else { return false };
    vector == same && begin + places == index
}

fn range(first: &str, length: usize) -> String {
    match element(first).filter(|_| length > 1) {
        Some((name, begin)) => format!("{name}[{begin}…{}]", begin + length - 1),
        None => first.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_of_a_vector_are_reported_as_a_range() {
        let ranges_of = |names: &[&str]| ranges(names.iter().copied());
        assert_eq!(ranges_of(&["x[1]", "x[2]", "x[3]", "u[1]", "enabled"]), ["x[1…3]", "u[1]", "enabled"]);
        assert_eq!(ranges_of(&["x[1]", "x[3]", "speed", "current"]), ["x[1]", "x[3]", "speed", "current"]);
        let pairs = [["x[7]", "y[1]"], ["x[8]", "y[2]"], ["x[9]", "y[4]"]];
        let both = runs(pairs.into_iter());
        assert_eq!(both, [["x[7…8]".to_owned(), "y[1…2]".to_owned()], ["x[9]".to_owned(), "y[4]".to_owned()]]);
    }
}
