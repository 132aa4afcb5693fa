//! Connections of an FMU: in the loop of this package that has it, inside itself if it is a composite, or in any loop
//! by the role of its kind.

use super::{Handed, Part as OwnPart};
use crate::catalogue::Role;
use crate::exporter::pins::{Group, Pin, ranges};
use crate::exporter::{STRUCTURE_FILE, find_description, loops, name_of_whole};
use crate::library;
use crate::model::Description;
use crate::model_description::xml::parse;
use crate::model_description::{child, elements};

/// Source of the connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum From {
    /// A loop of this package, by its name.
    Loop(&'static str),
    /// The FMU, which is a composite; with the name of its loop if that is of this package.
    Itself(Option<&'static str>),
    /// The role of its kind in a loop.
    Kind,
}

/// A block of the diagram.
#[derive(Debug, Clone)]
pub struct Part {
    /// Its name in the loop.
    pub name: String,
    /// Name of its FMU, or title of its kind.
    pub title: String,
    /// Its role there.
    pub role: Option<Role>,
    /// True if it is the FMU of the page, or a part of it.
    pub is_own: bool,
    /// True if it stands for any FMU of its role.
    pub is_any: bool,
}

/// The connections from one block to another, pin by pin.
#[derive(Debug, Clone)]
pub struct Link {
    /// Block of the outputs.
    pub from: usize,
    /// Block of the inputs.
    pub to: usize,
    /// Names of outputs and inputs.
    pub pairs: Vec<(String, String)>,
}

/// Blocks and connections.
#[derive(Debug, Clone)]
pub struct Wiring {
    /// Their source.
    pub from: From,
    /// Blocks.
    pub parts: Vec<Part>,
    /// Connections.
    pub links: Vec<Link>,
}

impl Wiring {
    /// The wiring of an FMU.
    pub fn of(handed: &Handed) -> Wiring {
        if !handed.parts.is_empty() {
            return within(handed);
        }
        shipped(handed).unwrap_or_else(|| by_kind(handed))
    }

    /// The loop of this package that is shown.
    pub fn loop_name(&self) -> Option<&'static str> {
        match self.from {
            From::Loop(name) => Some(name),
            From::Itself(name) => name,
            From::Kind => None,
        }
    }

    fn new(from: From, parts: Vec<Part>) -> Self {
        Wiring { from, parts, links: Vec::new() }
    }

    fn connect(&mut self, from: usize, to: usize, pair: (String, String)) {
        match self.links.iter_mut().find(|link| (link.from, link.to) == (from, to)) {
            Some(link) => link.pairs.push(pair),
            None => self.links.push(Link { from, to, pairs: vec![pair] }),
        }
    }

    /// The place of a block.
    fn place(&self, name: &str) -> Option<usize> {
        self.parts.iter().position(|part| part.name == name)
    }

    /// Pins of a block that are connected.
    pub fn connected(&self, part: usize, inputs: bool) -> impl Iterator<Item = &str> {
        let links = self.links.iter().filter(move |link| if inputs { link.to == part } else { link.from == part });
        let pairs = links.flat_map(|link| &link.pairs);
        pairs.map(move |(from, to)| if inputs { to.as_str() } else { from.as_str() })
    }
}

/// The role of a kind by its name.
fn role(model: &str) -> Option<Role> {
    library::find(model).map(|entry| entry.role)
}

/// Wiring in the first loop of this package with the FMU and without an expected failure; none if there is none.
fn shipped(handed: &Handed) -> Option<Wiring> {
    let name = &handed.unit.name;
    handed.entry?;
    let known = Description::read(&find_description(name).ok()?.text).ok()?;
    let own = handed.description;
    if (&known.model, &known.structure, &known.names) != (&own.model, &own.structure, &own.names) {
        return None;
    }
    let place = format!("resources/{name}.fmu");
    let texts = loops().iter().filter_map(|(name, files)| {
        let (_, text) = files.iter().find(|(file, _)| *file == STRUCTURE_FILE)?;
        (text.contains(&place) && !text.contains("<ExpectedFailure")).then_some((*name, *text))
    });
    texts.into_iter().find_map(|(of, text)| read(of, text, name))
}

/// Reads a loop of this package.
fn read(of: &'static str, text: &str, own: &str) -> Option<Wiring> {
    let document = parse(text).ok()?;
    let system = child(document.root_element(), "System")?;
    let components = elements(child(system, "Elements")?, "Component");
    let parts = components.map(|component| {
        let source = component.attribute("source").unwrap_or_default();
        let fmu = source.rsplit('/').next().unwrap_or_default().trim_end_matches(".fmu");
        let description = find_description(fmu).ok().and_then(|source| Description::read(&source.text).ok());
        Part {
            name: component.attribute("name").unwrap_or_default().to_owned(),
            title: fmu.to_owned(),
            role: description.and_then(|description| role(&description.model)),
            is_own: fmu == own,
            is_any: false,
        }
    });
    let mut wiring = Wiring::new(From::Loop(of), parts.collect());
    for connection in elements(child(system, "Connections")?, "Connection") {
        let text = |key: &str| connection.attribute(key).unwrap_or_default();
        let ends = wiring.place(text("startElement")).zip(wiring.place(text("endElement")));
        let (from, to) = ends?;
        wiring.connect(from, to, (text("startConnector").to_owned(), text("endConnector").to_owned()));
    }
    Some(wiring)
}

/// Wiring inside a composite.
fn within(handed: &Handed) -> Wiring {
    let block = |part: &OwnPart| Part {
        name: part.name.to_owned(),
        title: part.entry.map_or("", |entry| entry.title).to_owned(),
        role: part.role(),
        is_own: true,
        is_any: false,
    };
    let name = loops().iter().map(|(name, _)| *name).find(|name| name_of_whole(name) == handed.unit.name);
    let mut wiring = Wiring::new(From::Itself(name), handed.parts.iter().map(block).collect());
    let connections = handed.description.structure.get("connections").and_then(toml::Value::as_array);
    for pair in connections.into_iter().flatten() {
        let end = |k: usize| pair.get(k).and_then(toml::Value::as_str).and_then(|text| text.split_once('.'));
        let Some(((from, output), (to, input))) = end(0).zip(end(1)) else { continue };
        if let Some((from, to)) = wiring.place(from).zip(wiring.place(to)) {
            wiring.connect(from, to, (output.to_owned(), input.to_owned()));
        }
    }
    wiring
}

/// Wiring in any loop: each pin is connected to a block that has such a signal.
fn by_kind(handed: &Handed) -> Wiring {
    let own = Part {
        name: handed.unit.name.clone(),
        title: handed.entry.map_or("", |entry| entry.title).to_owned(),
        role: handed.entry.map(|entry| entry.role),
        is_own: true,
        is_any: false,
    };
    let is_known = own.role.is_some();
    let mut wiring = Wiring::new(From::Kind, vec![own]);
    let has_state = handed.pins.iter().any(|(pin, _)| !pin.is_input && pin.declared.starts_with("x["));
    for (pin, role) in &handed.pins {
        // A controller takes the state if there is one.
        let is_spare = *role == Some(Role::Plant) && has_state && pin.declared.starts_with('y');
        let Some(partner) = partner(pin, *role).filter(|_| is_known && !is_spare) else { continue };
        let name = format!("{partner:?}").to_lowercase();
        let place = wiring.place(&name).unwrap_or_else(|| {
            let title = format!("your {name}");
            wiring.parts.push(Part { name, title, role: Some(partner), is_own: false, is_any: true });
            wiring.parts.len() - 1
        });
        let (ours, theirs) = (pin.variable.name.clone(), pin.member(*role));
        if pin.is_input {
            wiring.connect(place, 0, (theirs, ours));
        } else {
            wiring.connect(0, place, (ours, theirs));
        }
    }
    wiring
}

/// Role of the block that a pin is connected to.
fn partner(pin: &Pin, role: Option<Role>) -> Option<Role> {
    let role = role.filter(|_| pin.group != Group::Other)?;
    Some(match (role, pin.group) {
        (Role::Reference | Role::Plant, _) => Role::Controller,
        (Role::Sensor, _) if pin.is_input => Role::Plant,
        (Role::Actuator, _) if !pin.is_input => Role::Plant,
        (Role::Sensor | Role::Actuator, _) => Role::Controller,
        (Role::Observer, Group::Measured) => Role::Plant,
        (Role::Observer, _) => Role::Controller,
        (_, Group::Reference) => Role::Reference,
        (_, Group::Estimate) => Role::Observer,
        _ => Role::Plant,
    })
}

/// Short names of the pins of the FMU or one of its parts: the connected ones, or the others.
pub fn shown(handed: &Handed, wiring: &Wiring, part: usize, inputs: bool, connected: bool) -> Vec<String> {
    let block = &wiring.parts[part];
    let is_whole = !handed.parts.is_empty();
    let here = |pin: &&Pin| pin.is_input == inputs && (!is_whole || pin.part == Some(block.name.as_str()));
    let prefix = if is_whole { format!("{}.", block.name) } else { String::new() };
    let wired: Vec<&str> = wiring.connected(part, inputs).collect();
    let pins = handed.pins.iter().map(|(pin, _)| pin).filter(here);
    let names = pins.map(|pin| pin.variable.name.strip_prefix(&prefix).unwrap_or(&pin.variable.name));
    ranges(names.filter(|name| wired.contains(name) == connected))
}
