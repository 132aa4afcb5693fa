//! Appearance of an FMU: its page, its icon, and its pins in groups.

use super::page::{self, Handed};
use super::{Source, terminals};
use crate::catalogue::Entry;
use crate::error::{Error, Invalid};
use crate::fmi2::build::Build;
use crate::fmi2::describe::DescribedUnit;
use crate::library as own;
use crate::model::{Description, Standard};
use crate::model_description::ModelDescription;
use crate::pages::{self, Icon};

/// Files of an FMU for readers and for tools that show blocks.
pub struct Appearance {
    /// documentation/index.html
    pub page: String,
    /// Its icon.
    pub icon: Icon,
    /// terminalsAndIcons/terminalsAndIcons.xml, if requested, and in FMI 3.0.
    pub terminals: Option<String>,
}

/// The appearance of an FMU, which was generated from a description.
///
/// # Errors
/// If the description, or the library's answer to it, can't be read.
pub fn appearance(
    source: &Source,
    unit: &DescribedUnit,
    build: &Build,
    with_terminals: bool,
) -> Result<Appearance, Error> {
    let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
    let description = Description::read(&source.text).map_err(|invalid: Invalid| refuse(invalid.to_string()))?;
    let xml = ModelDescription::read(&unit.model_description).map_err(refuse)?;
    let entry = entry(&description, build);
    let handed = Handed::new(unit, build, &xml, &description, entry);
    Ok(Appearance {
        page: page::html(&handed),
        icon: entry.map_or_else(|| pages::icon(""), Entry::icon),
        terminals: match description.standard() {
            Standard::Fmi2 => with_terminals.then(|| terminals::xml(&handed.pins)),
            // Only its icon: elements of arrays can't be members of a terminal.
            Standard::Fmi3 => Some(terminals::xml(&[])),
        },
    })
}

/// The kind of an FMU in the catalogue, if it is of this package, not of another with the same name.
fn entry(description: &Description, build: &Build) -> Option<&'static Entry> {
    (build.package == own::PACKAGE).then(|| own::find(&description.model)).flatten()
}
