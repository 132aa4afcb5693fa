//! Mixers, between a controller and the actuators of its plant, which limit the controls jointly.

use std::path::Path;

use super::bench::ACTUATOR;
use super::study::Mixer;
use crate::error::Error;
use crate::exporter::find_description;
use crate::model_description::Affine;
use crate::structure::{Component, Connection, Connector, Structure, UnitFile};

/// Its name in the loop.
pub(super) const MIXER: &str = "mixer";
/// Its signals.
const ASKED: &str = "u";
const ACHIEVED: &str = "achieved";

/// The control of a channel, counted from 1, after the mixer.
pub(super) fn achieved(channel: usize) -> String {
    format!("{MIXER}.{ACHIEVED}[{channel}]")
}

/// Adds a mixer without limits before the actuators of a loop. Its files are in this folder, with the study.
///
/// # Errors
/// If there is no such FMU, or it lacks a parameter.
pub(super) fn put(structure: &mut Structure, mixer: &Mixer, folder: &Path) -> Result<(), Error> {
    let mut asked = Vec::new();
    for connection in structure.connections.iter_mut().filter(|connection| connection.to.0 == ACTUATOR) {
        let channel = asked.len() + 1;
        let to = (MIXER.to_owned(), format!("{ASKED}[{channel}]"));
        asked.push(Connection { to, ..connection.clone() });
        connection.from = (MIXER.to_owned(), format!("{ACHIEVED}[{channel}]"));
        connection.transformation = Affine::IDENTITY;
    }
    let unit = component(structure, mixer, asked.len(), folder)?;
    structure.connections.extend(asked);
    // In the order of stepping: the actuators take the mixer's latest outputs.
    let place = structure.components.iter().position(|unit| unit.name == ACTUATOR).unwrap_or(0);
    structure.components.insert(place, unit);
    mixer.without.iter().try_for_each(|(name, value)| structure.set(&format!("{MIXER}.{name}={value}")))
}

fn component(structure: &mut Structure, mixer: &Mixer, channels: usize, folder: &Path) -> Result<Component, Error> {
    let given = folder.join(&mixer.unit);
    let is_archive = given.extension().is_some_and(|extension| extension == "fmu");
    let stem = given.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (fmu, file) = match given.is_file() {
        true if is_archive => (stem, UnitFile::Archive { path: given, elsewhere: true }),
        true => {
            let source = find_description(&given.display().to_string())?;
            structure.descriptions.insert(stem.clone(), source);
            (stem, UnitFile::Named)
        }
        false => (mixer.unit.clone(), UnitFile::Named),
    };
    let connector = |name: String, kind: &str| Connector {
        name,
        kind: kind.to_owned(),
        data_type: Some("Real".to_owned()),
        unit: None,
        line: 0,
    };
    let of_channel = |k| [connector(format!("{ASKED}[{k}]"), "input"), connector(format!("{ACHIEVED}[{k}]"), "output")];
    Ok(Component {
        name: MIXER.to_owned(),
        source: format!("resources/{fmu}.fmu"),
        connectors: (1..=channels).flat_map(of_channel).collect(),
        values: Vec::new(),
        fmu,
        file,
    })
}
