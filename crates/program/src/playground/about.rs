//! Kinds of controllers that the page offers, and plants as examples.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::controllers::l1::L1;
use crate::controllers::l1_sampled::L1Sampled;
use crate::controllers::ladrc::Ladrc;
use crate::controllers::pid::Pid;
use crate::error::{Error, Invalid};
use crate::library::{self, PACKAGE};
use crate::system::System;
use crate::template::USUAL_UNCERTAINTY;
use crate::texts::zoo;

/// The kinds that the page designs, in its order.
const KINDS: [&str; 4] =
    [<Pid as System>::NAME, <Ladrc as System>::NAME, <L1 as System>::NAME, <L1Sampled as System>::NAME];

/// A plant of this package.
#[derive(Debug, Deserialize)]
struct Known {
    title: String,
    source: String,
    known: String,
    bandwidth: f64,
    reference: Reference,
}

/// A step of one reference, or of each.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(untagged)]
enum Reference {
    One(f64),
    Each(Vec<f64>),
}

/// Kinds, plants and the version.
///
/// # Errors
/// When the list of plants can't be read.
pub fn about() -> Result<Value, Error> {
    let kinds = KINDS.iter().filter_map(|kind| library::find(kind)).map(|entry| {
        let is_uncertain = entry.template.is_some_and(|template| template.is_uncertain);
        json!({ "kind": entry.kind.name, "title": entry.title, "about": entry.guide.purpose, "uncertain": is_uncertain })
    });
    Ok(json!({ "version": PACKAGE, "kinds": kinds.collect::<Vec<_>>(), "plants": plants()? }))
}

fn plants() -> Result<Vec<Value>, Error> {
    let text = |name: &str| zoo().iter().find(|(known, _)| *known == name).map(|(_, text)| *text);
    let list = text("plants.toml").unwrap_or_default();
    let list: BTreeMap<String, Known> =
        toml::from_str(list).map_err(|error| Error::Argument(Invalid::because(error)))?;
    let plant = |(name, known): (String, Known)| {
        let plant = text(&format!("{name}.json"))?;
        let reference = match known.reference {
            Reference::One(size) => vec![size],
            Reference::Each(sizes) => sizes,
        };
        Some(json!({
            "name": name, "title": known.title, "about": format!("{}. {}", known.source, known.known), "plant": plant,
            "bandwidth": known.bandwidth, "reference": reference, "uncertainty": USUAL_UNCERTAINTY,
        }))
    };
    Ok(list.into_iter().filter_map(plant).collect())
}
