//! Checks whether a loop and its FMUs fit each other: names, types, units, and algebraic loops.

use std::collections::BTreeSet;

use super::feedthrough::{Feedthrough, Link};
use super::ssp::{Component, Connection, Connector, StartValue, Structure};
use crate::error::Error;
use crate::fmu::{SHOWS_VARIABLES, Value, is_designed, typed, why_fixed, within_limits};
use crate::model_description::{Affine, UnitDefinition};
use crate::model_description::{ModelDescription, Variable};
use crate::near;

/// Largest number of connections whose units are named in a note.
const MOST_DOUBTS: usize = 5;

/// A loop in the terms of its FMUs.
#[derive(Debug, Clone, PartialEq)]
pub struct Wiring {
    /// Start values of each component: place of the variable, and value.
    pub values: Vec<Vec<(usize, Value)>>,
    /// Connections.
    pub links: Vec<Link>,
    /// Notes on what a user may have forgotten.
    pub notes: Vec<String>,
    /// True if some connections close a loop in which no component is known to delay.
    pub circular: bool,
}

/// Treatment of algebraic loops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlgebraicLoops {
    /// Components use the outputs of the previous exchange. If every component declares feedthrough, the structure
    /// must accept algebraic loops; if one declares nothing, the loop is always accepted.
    Exchanged,
    /// Refused, also if feedthrough is only possible: components that are integrated together exchange nothing.
    Refused,
}

/// One end of a connection.
struct End<'a> {
    place: (usize, usize),
    variable: &'a Variable,
    /// The unit of the connector, and of the variable.
    units: (Option<&'a UnitDefinition>, Option<&'a UnitDefinition>),
}

impl<'a> End<'a> {
    /// The unit in which its values are passed on, if it has one.
    fn outside(&self) -> Option<&'a UnitDefinition> {
        self.units.0.or(self.units.1)
    }
}

struct Check<'a> {
    structure: &'a Structure,
    descriptions: &'a [&'a ModelDescription],
}

/// Checks a loop against the descriptions of its components' FMUs, one each, in their order.
///
/// # Errors
/// If something doesn't fit, with its name and line.
pub fn check(
    structure: &Structure,
    descriptions: &[&ModelDescription],
    treatment: AlgebraicLoops,
) -> Result<Wiring, Error> {
    let check = Check { structure, descriptions };
    check.connectors()?;
    let (links, doubts) = check.links()?;
    let units = 0..structure.components.len();
    let values = units.map(|unit| check.values(unit, &links)).collect::<Result<_, _>>()?;
    let mut notes = structure.notes.clone();
    notes.extend(check.notes(&links));
    notes.extend(doubts);
    let note = check.loop_note(&links, treatment)?;
    let circular = note.is_some();
    notes.extend(note);
    Ok(Wiring { values, links, notes, circular })
}

impl<'a> Check<'a> {
    fn components(&self) -> impl Iterator<Item = (&'a Component, &'a ModelDescription)> {
        self.structure.components.iter().zip(self.descriptions.iter().copied())
    }

    fn connectors(&self) -> Result<(), Error> {
        for (component, description) in self.components() {
            for connector in &component.connectors {
                let refuse = |reason: &str| self.structure.refuse(connector.line, reason);
                let name = format!("{}.{}", component.name, connector.name);
                let variable = description.variable(&connector.name);
                let variable = variable.ok_or_else(|| {
                    let choice = near::choice(&connector.name, &names(description, |_| true), SHOWS_VARIABLES);
                    refuse(&format!("connector `{name}`: {} has no such variable; {choice}", component.fmu))
                })?;
                if connector.kind != variable.causality {
                    let (kind, causality) = (&connector.kind, &variable.causality);
                    return Err(refuse(&format!(
                        "connector `{name}` has kind {kind}, but the variable of the FMU is {causality}"
                    )));
                }
                // Some tools know no enumerations, and take them for integers as FMI's functions do.
                let kind = connector.data_type.as_ref().filter(|kind| {
                    **kind != variable.kind && (kind.as_str(), variable.kind.as_str()) != ("Integer", "Enumeration")
                });
                if let Some(kind) = kind {
                    return Err(refuse(&format!(
                        "connector `{name}` has type {kind}, but the variable of the FMU has type {}",
                        variable.kind
                    )));
                }
                if let (Some(unit), Some(own)) = (&connector.unit, &variable.measure)
                    && unit.to(own).is_none()
                {
                    let reason = format!(
                        "connector `{name}` has unit {}, which can't be converted to {}, the unit of the FMU's \
                         variable",
                        unit.name, own.name
                    );
                    return Err(refuse(&reason));
                }
            }
        }
        Ok(())
    }

    /// The connections, and a note on their units if there is one.
    fn links(&self) -> Result<(Vec<Link>, Option<String>), Error> {
        let (mut links, mut doubts): (Vec<Link>, _) = (Vec::new(), Vec::new());
        for connection in &self.structure.connections {
            let refuse = |reason: &str| self.structure.refuse(connection.line, reason);
            let from = self.end(&connection.from, "output").map_err(|reason| refuse(&reason))?;
            let to = self.end(&connection.to, "input").map_err(|reason| refuse(&reason))?;
            if let Some(other) = links.iter().position(|link| link.to == to.place) {
                let earlier = self.structure.connections[other].line;
                let reason = format!(
                    "input `{}` is already connected in line {earlier}. An input takes one connection",
                    name(&connection.to)
                );
                return Err(refuse(&reason));
            }
            let conversion = conversion(connection, &from, &to).map_err(|reason| refuse(&reason))?;
            links.push(Link { from: from.place, to: to.place, conversion });
            doubts.extend(doubt(connection, &from, &to));
        }
        let more = doubts.len().saturating_sub(MOST_DOUBTS);
        doubts.truncate(MOST_DOUBTS);
        doubts.extend((more > 0).then(|| format!("and {more} more")));
        let warning =
            (!doubts.is_empty()).then(|| format!("units of measurement of connections: {}", doubts.join("; ")));
        Ok((links, warning))
    }

    fn end(&self, end: &'a (String, String), causality: &str) -> Result<End<'a>, String> {
        let (unit, variable) = end;
        let found = self.structure.components.iter().position(|component| component.name == *unit);
        let known = || self.structure.components.iter().map(|component| component.name.as_str()).collect::<Vec<_>>();
        let unit =
            found.ok_or_else(|| format!("there is no component `{unit}`; {}", near::choice(unit, &known(), "")))?;
        let (component, description) = (&self.structure.components[unit], self.descriptions[unit]);
        let connector = component.connectors.iter().find(|connector| connector.name == *variable);
        let connector: &Connector = connector.ok_or_else(|| {
            let known: Vec<_> = component.connectors.iter().map(|connector| connector.name.as_str()).collect();
            let choice = near::choice(variable, &known, "");
            format!("`{variable}` is not among the connectors of `{}`; {choice}", component.name)
        })?;
        let place = description.place(variable).ok_or_else(|| format!("there is no `{}`", name(end)))?;
        let variable = &description.variables[place];
        if variable.causality != causality {
            let (way, is) = (if causality == "output" { "starts" } else { "ends" }, &variable.causality);
            return Err(format!("a connection {way} at an {causality}, but `{}` has causality {is}", name(end)));
        }
        let units = (connector.unit.as_ref(), variable.measure.as_deref());
        Ok(End { place: (unit, place), variable, units })
    }

    fn values(&self, unit: usize, links: &[Link]) -> Result<Vec<(usize, Value)>, Error> {
        let is_connected = |place| links.iter().any(|link| link.to == (unit, place));
        start_values(&self.structure.components[unit], self.descriptions[unit], is_connected)
    }

    /// A note on an algebraic loop that is accepted, if there is one.
    fn loop_note(&self, links: &[Link], treatment: AlgebraicLoops) -> Result<Option<String>, Error> {
        let feedthrough = Feedthrough::new(links, self.descriptions);
        if treatment == AlgebraicLoops::Refused {
            let found = feedthrough.possible_loop();
            return found.map_or(Ok(None), |path| Err(self.algebraic_loop(&path, "")));
        }
        if let Some(path) = feedthrough.declared_loop() {
            if !self.structure.accepts_algebraic_loops {
                let advice = ". Use --accept-algebraic-loops to run it with outputs of the previous exchange, one exchange \
                    late";
                return Err(self.algebraic_loop(&path, advice));
            }
            let path = self.signals(&path);
            return Ok(Some(format!("algebraic loop, accepted: {path}. Its values are one exchange late")));
        }
        Ok(feedthrough.possible_loop().map(|path| {
            let undeclared: BTreeSet<usize> =
                feedthrough.undeclared().into_iter().map(|link| links[link].to.0).collect();
            let names: Vec<_> =
                undeclared.iter().map(|&unit| format!("`{}`", self.structure.components[unit].name)).collect();
            let (names, verb) = (names.join(", "), if names.len() == 1 { "does" } else { "do" });
            let path = self.signals(&path);
            format!(
                "{names} {verb} not declare which outputs depend directly on which inputs, so {path} may be an \
                 algebraic loop. Each component uses the outputs of the previous exchange"
            )
        }))
    }

    fn algebraic_loop(&self, path: &[usize], advice: &str) -> Error {
        let line = path.iter().map(|&link| self.structure.connections[link].line).min().unwrap_or_default();
        let signals = self.signals(path);
        self.structure.refuse(line, &format!("algebraic loop, in which no component has a delay: {signals}{advice}"))
    }

    /// The signals of an algebraic loop, from one to the next.
    fn signals(&self, path: &[usize]) -> String {
        let connections = path.iter().map(|&link| &self.structure.connections[link]);
        let mut signals: Vec<_> =
            connections.flat_map(|connection| [name(&connection.from), name(&connection.to)]).collect();
        signals.extend(signals.first().cloned());
        signals.join(" → ")
    }

    fn notes(&self, links: &[Link]) -> Vec<String> {
        let mut notes = Vec::new();
        for (unit, (component, description)) in self.components().enumerate() {
            for connector in component.connectors.iter().filter(|connector| connector.kind == "input") {
                let place = description.place(&connector.name);
                let set = component.values.iter().any(|value| value.name == connector.name);
                if !set && !links.iter().any(|link| place == Some(link.to.1) && link.to.0 == unit) {
                    let (line, name) = (connector.line, format!("{}.{}", component.name, connector.name));
                    notes.push(format!("line {line}: input `{name}` is not connected and stays at its start value"));
                }
            }
        }
        notes
    }
}

/// The start values of a component in the types and units of its FMU's variables, with their places, except values
/// that the FMU was designed with.
///
/// # Errors
/// For a value of a variable that isn't there, can't be set, is connected, or is of another type or dimension.
pub fn start_values(
    component: &Component,
    description: &ModelDescription,
    is_connected: impl Fn(usize) -> bool,
) -> Result<Vec<(usize, Value)>, Error> {
    let value_of = |start: &StartValue| {
        let name = format!("{}.{}", component.name, start.name);
        let refuse = |reason: String| start.origin.refuse(&reason);
        let place = description.place(&start.name);
        let place = place.ok_or_else(|| {
            let known = names(description, |v| v.start.is_some() && v.variability != "constant");
            let choice = near::choice(&start.name, &known, SHOWS_VARIABLES);
            refuse(format!("there is no `{name}`: {} has no such variable; {choice}", component.fmu))
        })?;
        let variable = &description.variables[place];
        if is_connected(place) {
            return Err(refuse(format!("`{name}` can't be set because it is connected")));
        }
        let value = value(start, variable, variable.measure.as_deref());
        if is_designed(variable) && value.as_ref().is_ok_and(|value| starts_with(variable, value)) {
            return Ok(None);
        }
        if variable.start.is_none() || variable.variability == "constant" {
            return Err(refuse(format!("`{name}` can't be set: {}", why_fixed(variable))));
        }
        Ok(Some((place, value.map_err(|reason| refuse(format!("`{name}` = {}: {reason}", start.text)))?)))
    };
    component.values.iter().filter_map(|start| value_of(start).transpose()).collect()
}

/// True if a variable starts with a value.
fn starts_with(variable: &Variable, value: &Value) -> bool {
    let start = variable.start.as_deref().unwrap_or_default();
    match value {
        Value::Real(number) => start.parse() == Ok(*number),
        Value::Integer(number) => start.parse() == Ok(*number),
        Value::Boolean(value) => matches!(start, "true" | "1") == *value,
        Value::String(text) => start == text,
    }
}

/// The names of some of an FMU's variables.
fn names(description: &ModelDescription, is_wanted: impl Fn(&Variable) -> bool) -> Vec<&str> {
    let variables = description.variables.iter().filter(|variable| is_wanted(variable));
    variables.map(|variable| variable.name.as_str()).collect()
}

fn name((unit, variable): &(String, String)) -> String {
    format!("{unit}.{variable}")
}

/// Conversion of a value between two variables: to the unit of the first connector, to that of the second, through
/// the transformation, to the unit of the second variable.
fn conversion(connection: &Connection, from: &End, to: &End) -> Result<Affine, String> {
    let (one, another) = (name(&connection.from), name(&connection.to));
    let (source, target) = (from.variable, to.variable);
    match (source.kind.as_str(), target.kind.as_str()) {
        ("Real" | "Integer", "Real") => {}
        ("Integer", "Integer") | ("Boolean", "Boolean") if connection.transformation == Affine::IDENTITY => {}
        ("Enumeration", "Enumeration") if source.items == target.items => {}
        (kind, other) if kind != other => {
            return Err(format!("`{one}` has type {kind}, but `{another}` has type {other}"));
        }
        ("Enumeration", _) => return Err(format!("`{one}` and `{another}` are enumerations with different items")),
        (kind, _) => return Err(format!("`{one}` has type {kind}. Only values for a Real input can be transformed")),
    }
    if !connection.convert_units {
        return Ok(connection.transformation);
    }
    // Within one end, the dimensions have been compared before.
    let inner = |from: Option<&UnitDefinition>, to: Option<&UnitDefinition>| {
        from.zip(to).and_then(|(from, to)| from.to(to)).unwrap_or(Affine::IDENTITY)
    };
    let (first, last) = (inner(from.units.1, from.units.0), inner(to.units.0, to.units.1));
    let between = match (from.outside(), to.outside()) {
        (Some(unit), Some(other)) => unit.to(other).ok_or_else(|| {
            format!(
                "`{one}` has unit {} and `{another}` has unit {}, of another dimension. To pass the number on \
                 unchanged, use suppressUnitConversion=\"true\"",
                unit.name, other.name
            )
        })?,
        _ => Affine::IDENTITY,
    };
    Ok(first.then(between).then(connection.transformation).then(last))
}

/// Reason to look at the units of a connection, if there is one.
fn doubt(connection: &Connection, from: &End, to: &End) -> Option<String> {
    let (unit, other) = from.outside().zip(to.outside()).filter(|_| connection.convert_units)?;
    let reason = unit.doubt(other)?;
    let (one, another) = (name(&connection.from), name(&connection.to));
    let meant = [unit, other].into_iter().find_map(UnitDefinition::meant);
    let meant = meant.map_or(String::new(), |question| format!(" ({question})"));
    Some(format!("`{one}` has unit {} and `{another}` has unit {}, {reason}{meant}", unit.name, other.name))
}

/// A start value in the type and the unit of its variable.
fn value(start: &StartValue, variable: &Variable, own: Option<&UnitDefinition>) -> Result<Value, String> {
    let given = start.data_type.as_deref().unwrap_or(&variable.kind);
    let kind = variable.kind.as_str();
    if given != kind && !matches!((given, kind), ("Integer", "Real" | "Enumeration")) {
        return Err(format!("is given as {given}, but the variable has type {kind}"));
    }
    let value = typed(&start.text, variable)?;
    let (Value::Real(number), Some((unit, own))) = (&value, start.unit.as_ref().zip(own)) else {
        return within_limits(value, variable);
    };
    let conversion = unit.to(own).ok_or_else(|| {
        format!("is given in {}, but the variable has unit {}, of another dimension", unit.name, own.name)
    })?;
    within_limits(Value::Real(conversion.of(*number)), variable)
}
