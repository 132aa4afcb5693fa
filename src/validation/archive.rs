//! The archive: what lies where.

use std::path::{Path, PathBuf};

use super::findings::{At, Findings};
use super::{Interface, Interfaces};
use crate::error::Error;
use crate::exporter::{self, Platform};

const DESCRIPTION: &str = "modelDescription.xml";
const SECTION: &str = "2.3";
/// What the standard puts at the root of an archive.
const KNOWN: [&str; 8] =
    [DESCRIPTION, "model.png", "documentation", "sources", "binaries", "resources", "extra", "terminalsAndIcons"];

/// An archive's list of files.
pub(super) struct Archive {
    file: PathBuf,
    names: Vec<String>,
}

impl Archive {
    pub fn read(file: &Path) -> Result<Self, Error> {
        let names = exporter::entries(file)?.into_iter().map(|entry| entry.name).collect();
        Ok(Archive { file: file.to_owned(), names })
    }

    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    /// The bytes of a file in it.
    pub fn bytes(&self, name: &str) -> Result<Vec<u8>, Error> {
        exporter::read_bytes(&self.file, name)
    }

    /// The text of its description, where it has one.
    pub fn description(&self) -> Result<Option<String>, Error> {
        self.has(DESCRIPTION).then(|| exporter::read_entry(&self.file, DESCRIPTION)).transpose()
    }

    /// Checks the places of files.
    pub fn check(&self, findings: &mut Findings) {
        if !self.has(DESCRIPTION) {
            let below = self.names.iter().find(|name| name.ends_with(&format!("/{DESCRIPTION}")));
            let advice = below.map_or("add it".to_owned(), |below| {
                format!("`{below}` lies too deep: pack the files of that folder, not the folder")
            });
            findings.error(At::nowhere(), format!("the archive has no {DESCRIPTION} at its root"), SECTION, advice);
        }
        for name in &self.names {
            let outside = name.starts_with('/') || name.split(['/', '\\']).any(|part| part == "..");
            let drive = name.as_bytes().get(1) == Some(&b':');
            if outside || drive {
                let what = format!("the entry `{name}` would lie outside the folder that it is unpacked to");
                findings.error(At::nowhere(), what, SECTION, "pack relative paths only");
            } else if name.contains('\\') {
                let what = format!("the path `{name}` has a backslash");
                findings.error(At::nowhere(), what, SECTION, "separate folders by slashes");
            }
        }
        let mut other: Vec<&str> = self.names.iter().map(|name| name.split('/').next().unwrap_or_default()).collect();
        other.sort_unstable();
        other.dedup();
        for name in other.into_iter().filter(|name| !KNOWN.contains(name) && !name.is_empty() && *name != "..") {
            let what = format!("`{name}` at the root of the archive is nothing that the standard knows");
            findings.warning(At::nowhere(), what, SECTION, "put it into resources or extra");
        }
    }

    /// Checks that there are libraries, or sources.
    pub fn check_binaries(&self, interfaces: &Interfaces, findings: &mut Findings) {
        for (name, interface) in interfaces.named() {
            self.check_interface(name, interface, findings);
        }
    }

    fn check_interface(&self, name: &str, interface: &Interface, findings: &mut Findings) {
        let (identifier, at) = (&interface.identifier, || At::line(interface.line));
        let has_sources = self.names.iter().any(|name| name.starts_with("sources/"));
        if self.libraries(identifier).next().is_none() && !has_sources {
            let what = format!("{name}: there is no library binaries/PLATFORM/{identifier}.so, .dll or .dylib");
            let advice = "add one, named as modelIdentifier says, or sources";
            findings.error(at(), what, SECTION, advice);
            return;
        }
        let own = Platform::own().binary(identifier);
        if !self.has(&own) {
            let what = format!("{name}: there is no {own}");
            findings.warning(at(), what, SECTION, "it can't run on this platform: add a library for it");
        }
    }

    /// The libraries of an identifier, for whatever platform.
    pub fn libraries(&self, identifier: &str) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str).filter(move |name| {
            let file = name.strip_prefix("binaries/").and_then(|rest| rest.split_once('/')).map(|(_, file)| file);
            let plain = file.and_then(|file| file.strip_prefix(identifier));
            matches!(plain, Some(".so" | ".dll" | ".dylib"))
        })
    }
}

impl Interfaces {
    /// Those that there are, with the names of their elements.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &Interface)> {
        let both = [("ModelExchange", &self.exchange), ("CoSimulation", &self.co_simulation)];
        both.into_iter().filter_map(|(name, interface)| Some((name, interface.as_ref()?)))
    }
}
