//! The files of a loop: in this program, in a folder, or in an archive.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::source::{UnitFile, unit_file};
use super::{STRUCTURE, Structure};
use crate::error::{Error, Invalid};
use crate::exporter::{self, BUILD, DESCRIBED, Embedded, Source, read_entry};
use crate::fmi2::build::Build;
use crate::library;
use crate::model::Description;
use crate::scratch::Scratch;
use crate::sealed::checksum;
use crate::text_file;

/// The files of a loop.
#[derive(Debug)]
pub struct LoopFiles {
    /// The folder or archive as the user named it, for messages.
    shown: PathBuf,
    place: Place,
    /// Name of the SystemStructure.ssd.
    structure: String,
}

#[derive(Debug)]
enum Place {
    Program(Embedded),
    Folder(PathBuf),
    Unpacked(Scratch),
    /// In memory: the structure if there is one, and descriptions by the names of their FMUs.
    InMemory(Option<String>, BTreeMap<String, Source>),
}

/// True if a path lies in the folder that it starts from: no URL, no way up, nothing that a tool might decode.
pub fn is_inside(path: &str) -> bool {
    let odd = |c: char| c.is_control() || "\\:%?#".contains(c);
    !path.is_empty()
        && !path.contains(odd)
        && Path::new(path).components().all(|part| matches!(part, Component::Normal(_)))
}

/// The structures in a folder.
fn structures(folder: &Path) -> Result<Vec<String>, Error> {
    let entries = std::fs::read_dir(folder).map_err(Error::file(folder))?;
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(|name| name.ends_with(".ssd")).collect();
    names.sort();
    Ok(names)
}

/// The default structure of an archive: SystemStructure.ssd, or else the only one.
fn only_structure(archive: &Path, folder: &Path) -> Result<String, Error> {
    let known = structures(folder)?;
    match &known[..] {
        [only] => Ok(only.clone()),
        [] => Ok(STRUCTURE.to_owned()),
        _ if known.iter().any(|name| name == STRUCTURE) => Ok(STRUCTURE.to_owned()),
        _ => {
            let reason = format!(
                "has no {STRUCTURE}, but several variants: {}. Name one of them: {}/{}, or --variant of `run`",
                known.join(", "),
                archive.display(),
                known[0]
            );
            Err(Error::Loop { file: archive.to_owned(), reason })
        }
    }
}

/// Error for a name that is no loop: it names an FMU, or nothing.
fn no_loop(name: &str, extension: Option<&str>) -> Error {
    let kind = match extension {
        Some("fmu") => "an FMU",
        Some("toml") => "the description of an FMU",
        _ if exporter::find_description(name).is_ok() => "an FMU of this package",
        _ => {
            let known = exporter::loops().iter().map(|(name, _)| *name);
            return Error::unknown("loop", name, known, "`adaptive-fmu list`");
        }
    };
    Error::Argument(Invalid::because(format!(
        "{name} is {kind}, not a loop: `adaptive-fmu simulate {name}` simulates it, `adaptive-fmu new loop --units {name} …` connects it \
         with others"
    )))
}

/// Error for a name of a structure that a folder doesn't have.
fn no_variant(folder: &Path, file: &str) -> Error {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match structures(here) {
        Ok(known) => Error::unknown("structure", file, known, ""),
        Err(_) => Error::Argument(Invalid::because(format!(
            "{}: has no variants; only folders and .ssp archives with several structures have them",
            folder.display()
        ))),
    }
}

impl LoopFiles {
    /// Finds a loop of this package by its name, or by a path: a folder with a SystemStructure.ssd, an .ssd file, or an
    /// .ssp archive.
    ///
    /// # Errors
    /// If there is none, or its archive is broken or hostile.
    pub fn find(name: &str) -> Result<Self, Error> {
        if let Some((_, files)) = exporter::loops().iter().find(|(known, _)| *known == name) {
            let (shown, place) = (Path::new("examples").join(name), Place::Program(files));
            return Ok(LoopFiles { shown, place, structure: STRUCTURE.to_owned() });
        }
        let path = PathBuf::from(name);
        let extension = path.extension().and_then(|extension| extension.to_str());
        let archive =
            path.parent().filter(|parent| parent.extension().is_some_and(|end| end == "ssp") && parent.is_file());
        let (shown, place, structure) = if let Some(archive) = archive {
            let folder = Scratch::new()?;
            exporter::unpack(archive, folder.path())?;
            let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let known = structures(folder.path())?;
            if !known.contains(&file) {
                return Err(Error::unknown("variant", &file, known, ""));
            }
            (archive.to_owned(), Place::Unpacked(folder), file)
        } else if path.is_dir() {
            (path.clone(), Place::Folder(path), STRUCTURE.to_owned())
        } else if extension == Some("ssd") {
            let folder = path.parent().unwrap_or(Path::new("")).to_owned();
            let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if !path.exists() {
                return Err(no_variant(&folder, &file));
            }
            (folder.clone(), Place::Folder(folder), file)
        } else if extension == Some("ssp") {
            let folder = Scratch::new()?;
            exporter::unpack(&path, folder.path())?;
            let structure = only_structure(&path, folder.path())?;
            (path, Place::Unpacked(folder), structure)
        } else {
            return Err(no_loop(name, extension));
        };
        Ok(LoopFiles { shown, place, structure })
    }

    /// Files of a loop in a folder.
    pub fn within(folder: &Path) -> Self {
        let (shown, place) = (folder.to_owned(), Place::Folder(folder.to_owned()));
        LoopFiles { shown, place, structure: STRUCTURE.to_owned() }
    }

    /// A structure and descriptions that are in no folder.
    pub fn in_memory(structure: Option<String>, descriptions: impl IntoIterator<Item = Source>) -> Self {
        let name = |source: &Source| source.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let sources = descriptions.into_iter().map(|source| (name(&source), source)).collect();
        LoopFiles { shown: PathBuf::new(), place: Place::InMemory(structure, sources), structure: STRUCTURE.to_owned() }
    }

    /// The loop.
    ///
    /// # Errors
    /// If something is wrong, with its file and line.
    pub fn structure(&self) -> Result<Structure, Error> {
        Structure::read(self)
    }

    /// A file's path, for messages.
    pub(in crate::structure) fn path(&self, name: &str) -> PathBuf {
        self.shown.join(name)
    }

    /// The path of a file of the loop, for messages: within its archive if that was unpacked.
    pub(super) fn shown(&self, path: &Path) -> PathBuf {
        let inside = self.folder().and_then(|folder| path.strip_prefix(folder).ok());
        inside.map_or_else(|| path.to_owned(), |inside| self.shown.join(inside))
    }

    pub(in crate::structure) fn structure_file(&self) -> PathBuf {
        self.path(&self.structure)
    }

    /// The chosen structure of an archive, if it doesn't have the usual name.
    pub(super) fn chosen(&self) -> Option<&str> {
        Some(self.structure.as_str()).filter(|name| matches!(self.place, Place::Unpacked(_)) && *name != STRUCTURE)
    }

    pub(in crate::structure) fn structure_text(&self) -> Result<String, Error> {
        self.read(&self.structure)
    }

    /// The checksum of all that a structure is read from: its file, the parameter sets that it names, and the
    /// descriptions of components that come with it.
    ///
    /// # Errors
    /// If a file can't be read any more.
    pub fn checksum(&self, structure: &Structure) -> Result<String, Error> {
        let mut sums = vec![checksum(self.structure_text()?)];
        for name in &structure.parameter_files {
            sums.push(format!("{name} {}", checksum(self.read(name)?)));
        }
        sums.extend(structure.descriptions.iter().map(|(name, source)| format!("{name} {}", checksum(&source.text))));
        Ok(checksum(sums.join("\n")))
    }

    /// Text and path, for messages, of a parameter set: a file, or one of those next to the structure.
    ///
    /// # Errors
    /// If it can't be read.
    pub fn case(&self, case: &Path) -> Result<(String, PathBuf), Error> {
        let sibling =
            case.to_str().filter(|name| !case.is_file() && self.parameter_files().contains(&(*name).to_owned()));
        match sibling {
            Some(name) => Ok((self.read(name)?, self.path(name))),
            None => match text_file::read(case) {
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    Err(Error::unknown("parameter set", &case.to_string_lossy(), self.parameter_files(), ""))
                }
                read => Ok((read.map_err(Error::file(case))?, case.to_owned())),
            },
        }
    }

    /// The text of a file.
    ///
    /// # Errors
    /// If it isn't there, isn't text, or is too long.
    pub(in crate::structure) fn read(&self, name: &str) -> Result<String, Error> {
        let failed = |error| Error::file(self.path(name))(error);
        let found = match &self.place {
            Place::Program(files) => files.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned()),
            Place::InMemory(structure, _) => structure.clone().filter(|_| name == self.structure),
            Place::Folder(_) | Place::Unpacked(_) => {
                let folder = self.folder().unwrap_or(Path::new(""));
                return text_file::read(&folder.join(name)).map_err(failed);
            }
        };
        found.ok_or_else(|| failed(ErrorKind::NotFound.into()))
    }

    fn folder(&self) -> Option<&Path> {
        match &self.place {
            Place::Program(_) | Place::InMemory(..) => None,
            Place::Folder(folder) => Some(folder),
            Place::Unpacked(folder) => Some(folder.path()),
        }
    }

    /// The name of the FMU that a component's source names, and its origin.
    ///
    /// # Errors
    /// If there is none, with the reason.
    pub(super) fn unit(&self, source: &str) -> Result<(String, UnitFile), String> {
        if let Place::InMemory(_, sources) = &self.place {
            let stem = Path::new(source).file_stem().unwrap_or_default().to_string_lossy().into_owned();
            if sources.contains_key(&stem) {
                return Ok((stem, UnitFile::Named));
            }
        }
        unit_file(source, self.folder(), matches!(self.place, Place::Unpacked(_)))
    }

    /// The description of an FMU, if there is one next to the structure, in its resources, or in its archive there.
    pub(super) fn description(&self, fmu: &str) -> Result<Option<Source>, Error> {
        if let Place::InMemory(_, sources) = &self.place {
            return Ok(sources.get(fmu).cloned());
        }
        let names = [format!("{fmu}.toml"), format!("resources/{fmu}.toml")];
        let lies_there = |name: &&String| self.folder().is_some_and(|folder| folder.join(name).is_file());
        if let Some(name) = names.iter().find(lies_there) {
            return Ok(Some(Source::read(self.path(name), self.read(name)?)));
        }
        Ok(self.description_within(fmu))
    }

    /// The description within an archive in the resources, if it is an FMU of this program: from any other, this one
    /// would make another FMU.
    fn description_within(&self, fmu: &str) -> Option<Source> {
        let place = format!("resources/{fmu}.fmu");
        let archive = self.folder()?.join(&place);
        if !archive.is_file() {
            return None;
        }
        let build: Build = serde_json::from_str(&read_entry(&archive, BUILD).ok()?).ok()?;
        let text = read_entry(&archive, DESCRIBED).ok()?;
        let is_own = build.source == library::SOURCE && Description::read(&text).is_ok_and(|own| own.name == fmu);
        is_own.then(|| Source::read(self.path(&place), text))
    }

    /// Names of the parameter files next to the structure, in order.
    pub fn parameter_files(&self) -> Vec<String> {
        let is_set = |name: &String| name.ends_with(".ssv") && is_inside(name);
        let mut names: Vec<String> = match (&self.place, self.folder()) {
            (Place::InMemory(..), _) => Vec::new(),
            (Place::Program(files), _) => files.iter().map(|(name, _)| (*name).to_owned()).filter(is_set).collect(),
            (_, folder) => {
                let folder = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
                let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
                entries.filter_map(|entry| entry.file_name().into_string().ok()).filter(is_set).collect()
            }
        };
        names.sort();
        names
    }
}

#[cfg(test)]
mod tests {
    use super::is_inside;

    #[test]
    fn a_path_that_leads_elsewhere_is_not_inside() {
        for path in
            ["", "/etc/passwd", "../up.ssv", "a/../../up.ssv", "file:///a.ssv", "c:\\a.ssv", "%2e%2e/a", "a\\..\\b"]
        {
            assert!(!is_inside(path), "{path}");
        }
        assert!(is_inside("cases/high gain.ssv") && is_inside("a.ssv"));
    }
}
