//! The archive: what lies where.

use std::path::{Path, PathBuf};

use super::findings::{At, Findings};
use super::{Interface, Interfaces};
use crate::error::Error;
use crate::exporter::{self, Platform};
use crate::fmi2::calls::Standard;

const DESCRIPTION: &str = "modelDescription.xml";
const SECTION: &str = "2.3";
/// Files and folders of the standard at the root of an archive.
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

    /// The text of its description, if any. An encoding other than UTF-8 is a finding.
    pub fn description(&self, findings: &mut Findings) -> Result<Option<String>, Error> {
        if !self.has(DESCRIPTION) {
            return Ok(None);
        }
        let refused = match exporter::read_entry(&self.file, DESCRIPTION) {
            Ok(text) => return Ok(Some(text)),
            Err(refused) => refused,
        };
        let bytes = self.bytes(DESCRIPTION)?;
        // It may also have been too long.
        let Err(error) = std::str::from_utf8(&bytes) else { return Err(refused) };
        let before = bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        let line = u32::try_from(before + 1).unwrap_or(u32::MAX);
        let what = format!("{DESCRIPTION} is not in UTF-8");
        findings.error(At::line(line), what, "2.2", "write it in UTF-8, and encoding=\"UTF-8\" in its first line");
        Ok(None)
    }

    /// True if it has a library that can be loaded on a platform.
    pub fn has_library(&self, platform: &Platform, standard: Standard, identifier: &str) -> bool {
        platform.binaries(standard, identifier).any(|place| self.has(&place))
    }

    /// Checks the places of files.
    pub fn check(&self, findings: &mut Findings) {
        if !self.has(DESCRIPTION) {
            let below = self.names.iter().find(|name| name.ends_with(&format!("/{DESCRIPTION}")));
            let advice = below.map_or("add it".to_owned(), |below| {
                format!("`{below}` is in a subfolder: pack the contents of that folder, not the folder itself")
            });
            findings.error(At::nowhere(), format!("the archive has no {DESCRIPTION} at its root"), SECTION, advice);
        }
        for name in &self.names {
            let outside = name.starts_with('/') || name.split(['/', '\\']).any(|part| part == "..");
            let drive = name.as_bytes().get(1) == Some(&b':');
            if outside || drive {
                let what = format!("the entry `{name}` would be unpacked outside the target folder");
                findings.error(At::nowhere(), what, SECTION, "pack relative paths only");
            } else if name.contains('\\') {
                let what = format!("the path `{name}` contains a backslash");
                findings.error(At::nowhere(), what, SECTION, "separate folders with /");
            }
        }
        let mut other: Vec<&str> = self.names.iter().map(|name| name.split('/').next().unwrap_or_default()).collect();
        other.sort_unstable();
        other.dedup();
        for name in other.into_iter().filter(|name| !KNOWN.contains(name) && !name.is_empty() && *name != "..") {
            let what = format!("`{name}` at the root of the archive is not defined by the standard");
            findings.warning(At::nowhere(), what, SECTION, "move it to resources or extra");
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
            let advice = "add a library named after modelIdentifier, or C sources";
            findings.error(at(), what, SECTION, advice);
            return;
        }
        let own = Platform::own();
        if !self.has_library(&own, findings.standard, identifier) {
            let what = format!("{name}: there is no {}", own.binary_of(findings.standard, identifier));
            findings.warning(at(), what, SECTION, "it can't run on this platform; add a library for this platform");
        }
    }

    /// The libraries of an identifier, for any platform.
    pub fn libraries(&self, identifier: &str) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str).filter(move |name| {
            let file = name.strip_prefix("binaries/").and_then(|rest| rest.split_once('/')).map(|(_, file)| file);
            let plain = file.and_then(|file| file.strip_prefix(identifier));
            matches!(plain, Some(".so" | ".dll" | ".dylib"))
        })
    }
}

impl Interfaces {
    /// The interfaces of the FMU, with the names of their elements.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &Interface)> {
        let both = [("ModelExchange", &self.exchange), ("CoSimulation", &self.co_simulation)];
        both.into_iter().filter_map(|(name, interface)| Some((name, interface.as_ref()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_counts_in_each_folder_that_it_is_loaded_from() {
        let of = |names: &[&str]| Archive {
            file: PathBuf::new(),
            names: names.iter().map(|name| (*name).to_owned()).collect(),
        };
        let arm = Platform::of_target("aarch64-apple-darwin").unwrap();
        assert!(of(&["binaries/aarch64-darwin/U.dylib"]).has_library(&arm, Standard::Fmi2, "U"));
        assert!(of(&["binaries/darwin64/U.dylib"]).has_library(&arm, Standard::Fmi2, "U"));
        assert!(!of(&["binaries/linux64/U.so", "binaries/darwin64/V.dylib"]).has_library(&arm, Standard::Fmi2, "U"));
    }
}
