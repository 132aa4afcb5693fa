//! Sensors at a plant's outputs, actuators between a controller and its plant.

use std::fmt::Write;
use std::path::Path;

use crate::error::Error;
use crate::exporter::Source;
use crate::model_description::{Affine, ModelDescription};
use crate::plants::actuator::Actuator;
use crate::plants::sensor::Sensor;
use crate::structure::{Component, Connection, Connector, Structure, UnitFile};
use crate::system::System;

/// Largest delay in samples: a third of a second at the usual sample time.
pub(super) const DELAY_SAMPLES: usize = 300;
/// Names in the loop.
pub(crate) const SENSOR: &str = Sensor::NAME;
pub(super) const ACTUATOR: &str = Actuator::NAME;
pub(super) const PLANT: &str = "plant";
pub(super) const CONTROLLER: &str = "controller";

/// A loop with sensors and actuators, and their signals.
pub(crate) struct Benched {
    pub structure: Structure,
    /// Measured outputs of the plant, one for each channel of the sensor.
    pub measured: Vec<String>,
    /// Outputs of the controller, one for each channel of the actuator.
    pub commands: Vec<String>,
}

/// Adds ideal sensors and actuators to a loop of a plant with `channels` controls, a controller and any other
/// components. Actuators have delay lines for `delay_samples`.
pub(crate) fn benched(
    plain: &Structure,
    channels: usize,
    described: &ModelDescription,
    delay_samples: usize,
) -> Result<Benched, Error> {
    let mut structure = plain.clone();
    let refuse = |reason: String| Error::Loop { file: plain.file.clone(), reason };
    let (mut measured, mut commands): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
    let mut added = Vec::new();
    for connection in &mut structure.connections {
        let channels = match (connection.from.0.as_str(), connection.to.0.as_str()) {
            (PLANT, to) if to != PLANT => &mut measured,
            (CONTROLLER, PLANT) => &mut commands,
            _ => continue,
        };
        let known = channels.iter().position(|name| *name == connection.from.1);
        let channel = known.unwrap_or(channels.len()) + 1;
        let unit = if connection.from.0 == PLANT { SENSOR } else { ACTUATOR };
        if known.is_none() {
            channels.push(connection.from.1.clone());
            let to = (unit.to_owned(), format!("u[{channel}]"));
            added.push(Connection { to, transformation: Affine::IDENTITY, ..connection.clone() });
        }
        connection.from = (unit.to_owned(), format!("y[{channel}]"));
    }
    structure.connections.extend(added);
    if commands.len() != channels || measured.is_empty() {
        return Err(refuse(format!(
            "the controller sends {} controls to the plant, and {} outputs are measured: there must be {channels} \
             controls, one for each input of the plant, and at least 1 measured output",
            commands.len(),
            measured.len()
        )));
    }
    let unit_of = |name: &str| {
        let variable = described.variables.iter().find(|variable| variable.name == name);
        variable.and_then(|variable| variable.unit.clone()).unwrap_or_else(|| "1".to_owned())
    };
    let inputs: Vec<String> = (1..=channels)
        .filter_map(|channel| input_of(&structure, ACTUATOR, channel))
        .map(|name| unit_of(&name))
        .collect();
    for (name, units) in [(SENSOR, measured.iter().map(|name| unit_of(name)).collect()), (ACTUATOR, inputs)] {
        // The name must be a C identifier, which a pair's name may not be.
        let plain_name: String = plain.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let fmu = format!("League_{name}_{plain_name}");
        structure
            .descriptions
            .insert(fmu.clone(), description(&fmu, name, &units, if name == ACTUATOR { delay_samples } else { 0 }));
        // In the order of stepping: each takes the latest outputs.
        let place = structure.components.iter().position(|unit| unit.name == CONTROLLER).unwrap_or(0);
        structure.components.insert(place + usize::from(name == ACTUATOR), component(name, &fmu, units.len()));
    }
    Ok(Benched { structure, measured, commands })
}

/// The plant's input that a channel of a component goes to.
fn input_of(structure: &Structure, unit: &str, channel: usize) -> Option<String> {
    let from = (unit.to_owned(), format!("y[{channel}]"));
    structure.connections.iter().find(|connection| connection.from == from).map(|connection| connection.to.1.clone())
}

/// The description of a sensor or an actuator.
fn description(name: &str, model: &str, units: &[String], delay_samples: usize) -> Source {
    let mut text =
        format!("name = \"{name}\"\nmodel = \"{model}\"\ndescription = \"{model} of a league\"\n\n[structure]\n");
    let _ = writeln!(text, "channels = {}\nunits = {units:?}\ndelay_samples = {delay_samples}\n\n[start]", units.len());
    if model == ACTUATOR {
        let all = |value: &str| format!("[{}]", vec![value; units.len()].join(", "));
        let _ = writeln!(text, "u_min = {}\nu_max = {}\nrate_limit = {}", all("-1e15"), all("1e15"), all("1e15"));
    }
    Source { file: Path::new(&format!("{name}.toml")).to_owned(), text, as_written: false }
}

fn component(name: &str, fmu: &str, channels: usize) -> Component {
    let connector = |name: String, kind: &str| Connector {
        name,
        kind: kind.to_owned(),
        data_type: Some("Real".to_owned()),
        unit: None,
        line: 0,
    };
    let connectors =
        (1..=channels).flat_map(|k| [connector(format!("u[{k}]"), "input"), connector(format!("y[{k}]"), "output")]);
    Component {
        name: name.to_owned(),
        source: format!("resources/{fmu}.fmu"),
        fmu: fmu.to_owned(),
        file: UnitFile::Named,
        connectors: connectors.collect(),
        values: Vec::new(),
    }
}
