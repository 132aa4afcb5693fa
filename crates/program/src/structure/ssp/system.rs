//! The system of a structure: its components and connections, those of systems within it too, as one flat list.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use super::files::LoopFiles;
use super::reader::Reader;
use super::{Component, Connection, StartValue};
use crate::error::Error;
use crate::model_description::{Affine, UnitDefinition};
use crate::model_description::{child, elements};

/// Largest depth of nested systems.
const DEEPEST: usize = 20;
/// Largest number of components of a loop: each is an FMU that is loaded.
const MOST_COMPONENTS: usize = 1000;

/// A system with its contents; names begin with those of the enclosing systems, `inner.component`.
#[derive(Debug, Default)]
pub(super) struct System {
    pub components: Vec<Component>,
    pub connections: Vec<Connection>,
    /// Values that systems bind, the outermost last.
    pub values: Vec<StartValue>,
    /// Names of all systems.
    systems: HashSet<String>,
    /// Their connectors, by system and name; true if they have a unit of their own.
    ports: HashMap<(String, String), bool>,
}

impl Reader<'_> {
    /// A system with all systems within it.
    pub fn system(&self, node: Node, units: &[UnitDefinition], files: &LoopFiles) -> Result<System, Error> {
        let mut system = System::default();
        self.collect(node, "", 0, (units, files), &mut system)?;
        let connections = self.through_systems(node, &system)?;
        system.values =
            std::mem::take(&mut system.values).into_iter().flat_map(|value| system.at_units(value)).collect();
        system.connections = connections;
        Ok(system)
    }

    fn collect(
        &self,
        node: Node,
        path: &str,
        depth: usize,
        (units, files): (&[UnitDefinition], &LoopFiles),
        system: &mut System,
    ) -> Result<(), Error> {
        if depth > DEEPEST {
            return Err(self.refuse(node, &format!("systems are nested more than {DEEPEST} deep")));
        }
        system.systems.insert(path.to_owned());
        for connector in self.connectors(node, units)? {
            system.ports.insert((path.to_owned(), connector.name), connector.unit.is_some());
        }
        let inside = if depth == 0 { Some(self.inside(node, "Elements")?) } else { child(node, "Elements") };
        for element in inside.into_iter().flat_map(|node| node.children().filter(Node::is_element)) {
            match element.tag_name().name() {
                "Component" => self.add_component(element, path, (units, files), system)?,
                "System" => {
                    let path = within(path, &self.required(element, "name")?);
                    self.collect(element, &path, depth + 1, (units, files), system)?;
                }
                kind => {
                    let reason = format!("a {kind} among the elements can't be read. Use components and systems");
                    return Err(self.refuse(element, &reason));
                }
            }
        }
        let connections = child(node, "Connections").into_iter().flat_map(|node| elements(node, "Connection"));
        for connection in connections {
            let mut connection = self.connection(connection)?;
            for end in [&mut connection.from.0, &mut connection.to.0] {
                *end = if end.is_empty() { path.to_owned() } else { within(path, end) };
            }
            system.connections.push(connection);
        }
        let named = |value: StartValue| StartValue { name: within(path, &value.name), ..value };
        system.values.extend(self.bindings(node, units, files)?.into_iter().map(named));
        Ok(())
    }

    fn add_component(
        &self,
        node: Node,
        path: &str,
        (units, files): (&[UnitDefinition], &LoopFiles),
        system: &mut System,
    ) -> Result<(), Error> {
        let mut component = self.component(node, units, files)?;
        component.name = within(path, &component.name);
        if system.components.iter().any(|other| other.name == component.name) {
            return Err(self.refuse(node, &format!("two components are named `{}`", component.name)));
        }
        system.components.push(component);
        if system.components.len() > MOST_COMPONENTS {
            return Err(self.refuse(node, &format!("there are more than {MOST_COMPONENTS} components")));
        }
        Ok(())
    }

    /// The connections between components, through the connectors of systems.
    fn through_systems(&self, node: Node, system: &System) -> Result<Vec<Connection>, Error> {
        let refuse = |line, reason: &str| Err(super::Origin { line: Some(line), ..self.origin(node) }.refuse(reason));
        for connection in &system.connections {
            for (end, side) in [(&connection.from, "start"), (&connection.to, "end")] {
                if system.systems.contains(&end.0) && !system.ports.contains_key(end) {
                    let whole = if end.0.is_empty() { "the system".to_owned() } else { format!("system `{}`", end.0) };
                    let reason = format!(
                        "{side}Connector = {}: {whole} has no such connector; {side}Element names a component",
                        end.1
                    );
                    return refuse(connection.line, &reason);
                }
            }
        }
        let mut connections = Vec::new();
        let to_systems = || system.connections.iter().filter(|connection| system.systems.contains(&connection.to.0));
        for (k, connection) in to_systems().enumerate() {
            if let Some(other) = to_systems().take(k).find(|other| other.to == connection.to) {
                let name = within(&connection.to.0, &connection.to.1);
                let reason = format!("connector `{name}` is already connected in line {}", other.line);
                return refuse(connection.line, &reason);
            }
        }
        'each: for last in system.connections.iter().filter(|connection| !system.systems.contains(&connection.to.0)) {
            let mut whole = last.clone();
            for _ in 0..=system.connections.len() {
                if !system.systems.contains(&whole.from.0) {
                    connections.push(whole);
                    continue 'each;
                }
                // A connector without a source is an input of the outer system, which stays at its start value.
                let Some(before) = system.connections.iter().find(|other| other.to == whole.from) else {
                    continue 'each;
                };
                let is_plain = before.transformation == Affine::IDENTITY && whole.transformation == Affine::IDENTITY;
                if system.ports[&whole.from] && !is_plain {
                    let name = &whole.from.1;
                    let reason = format!(
                        "a transformation together with a unit at `{name}`, a system's connector, can't be read"
                    );
                    return refuse(last.line, &reason);
                }
                whole.transformation = before.transformation.then(whole.transformation);
                whole.convert_units &= before.convert_units;
                whole.from.clone_from(&before.from);
            }
            return refuse(last.line, "connections between systems pass this value on in an endless cycle");
        }
        Ok(connections)
    }
}

impl System {
    /// A component's value as it is; for a system's connector, the values of all inputs to which it leads. A connector
    /// with a source gets its values from there.
    fn at_units(&self, value: StartValue) -> Vec<StartValue> {
        let Some(port) = self.ports.keys().find(|(system, name)| within(system, name) == value.name) else {
            return vec![value];
        };
        if self.connections.iter().any(|connection| connection.to == *port) {
            return Vec::new();
        }
        let (mut values, mut reached) = (Vec::new(), vec![port.clone()]);
        let mut next = 0;
        while let Some(port) = reached.get(next).cloned() {
            next += 1;
            for connection in self.connections.iter().filter(|connection| connection.from == port) {
                if !self.systems.contains(&connection.to.0) {
                    let name = format!("{}.{}", connection.to.0, connection.to.1);
                    values.push(StartValue { name, ..value.clone() });
                } else if !reached.contains(&connection.to) {
                    reached.push(connection.to.clone());
                }
            }
        }
        values
    }
}

/// A name within the systems of a path.
fn within(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}
