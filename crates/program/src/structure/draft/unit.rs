//! The components that a loop is drafted for: FMUs of any tool, descriptions, FMUs of this package.

use std::path::{Component, Path, PathBuf};

use crate::catalogue::Role;
use crate::error::{Error, Invalid};
use crate::exporter::{DESCRIBED, Library, Source, describe, find_description, read_entry};
use crate::model_description::ModelDescription;
use crate::{library, model};

/// A component of a loop.
#[derive(Debug)]
pub struct DraftUnit {
    /// The name in the loop that the user gave it.
    pub(super) given: Option<String>,
    /// Name of its file, or of the FMU.
    pub(super) stem: String,
    /// Source attribute in the loop.
    pub(super) source: String,
    pub(super) description: ModelDescription,
    /// The system that the FMU is generated from, if it is one of this package.
    pub(super) model: Option<String>,
}

impl DraftUnit {
    /// Role in the loop, if it is known; a system from the user's own library counts as a plant.
    pub(super) fn role(&self) -> Option<Role> {
        self.model.as_deref().map(|model| library::find(model).map_or(Role::Plant, |entry| entry.role))
    }

    /// The component of a description, with the source attribute of its file.
    ///
    /// # Errors
    /// For a description that is refused.
    pub fn of_description(source: &Source, place: String, library: &Library) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
        let own = model::Description::read(&source.text).map_err(|invalid| refuse(invalid.to_string()))?;
        let (unit, _) = describe(source, library)?;
        let description = ModelDescription::read(&unit.model_description).map_err(refuse)?;
        Ok(DraftUnit { given: None, stem: own.name, source: place, description, model: Some(own.model) })
    }

    /// True if it passes on signals of any kind, channel by channel.
    pub(super) fn hands_on(&self) -> bool {
        self.role().is_some_and(Role::hands_on)
    }
}

/// Finds components for a loop in a folder.
#[derive(Debug)]
pub struct Found<'a> {
    folder: &'a Path,
    library: Option<Library>,
}

impl<'a> Found<'a> {
    /// Returns a finder for a loop in an existing folder.
    pub fn new(folder: &'a Path) -> Self {
        Found { folder, library: None }
    }

    /// The component that a word names: `FILE.fmu`, `FILE.toml` or an FMU of this package, optionally after `NAME=`.
    ///
    /// # Errors
    /// If there is no such component, or if it isn't for co-simulation.
    pub fn unit(&mut self, word: &str) -> Result<DraftUnit, Error> {
        let (given, name) = named(word)?;
        let path = Path::new(name);
        let unit = match path.extension().and_then(|extension| extension.to_str()) {
            Some("fmu") => self.of_archive(path)?,
            Some("toml") => self.of_description(&find_description(name)?, source_of(path, self.folder)?)?,
            _ => self.of_description(&find_description(name)?, format!("resources/{name}.fmu"))?,
        };
        Ok(DraftUnit { given, ..unit })
    }

    fn of_archive(&self, path: &Path) -> Result<DraftUnit, Error> {
        let xml = read_entry(path, "modelDescription.xml")?;
        let description = ModelDescription::read(&xml).and_then(ModelDescription::for_co_simulation);
        let description = description.map_err(|reason| Error::Archive { file: path.to_owned(), reason })?;
        // An FMU of this package contains its description.
        let own = description.is_own();
        let described = own.then(|| read_entry(path, DESCRIBED).ok()).flatten();
        let model = described.and_then(|text| model::Description::read(&text).ok()).map(|described| described.model);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(DraftUnit { given: None, stem, source: source_of(path, self.folder)?, description, model })
    }

    fn of_description(&mut self, source: &Source, place: String) -> Result<DraftUnit, Error> {
        let library = match self.library.take() {
            Some(library) => library,
            None => Library::next_to_program()?,
        };
        DraftUnit::of_description(source, place, self.library.insert(library))
    }
}

/// A given name in the loop, and what it names. A file's own name may contain an equals sign.
fn named(word: &str) -> Result<(Option<String>, &str), Error> {
    let Some((name, rest)) = word.split_once('=').filter(|_| !Path::new(word).is_file()) else {
        return Ok((None, word));
    };
    let odd = |c: char| c.is_control() || c.is_whitespace() || c == '.';
    if name.is_empty() || name.contains(odd) {
        let allowed = "the name before = must not be empty, and must have no spaces or dots";
        return Err(Error::Argument(Invalid::new("--units", word, allowed)));
    }
    Ok((Some(name.to_owned()), rest))
}

/// Source attribute for a file: a relative path if it is below the folder or its parent, else a URI.
fn source_of(file: &Path, folder: &Path) -> Result<String, Error> {
    let whole = |path: &Path| path.canonicalize().map_err(Error::file(path));
    let plain = |path: &Path| if path.as_os_str().is_empty() { PathBuf::from(".") } else { path.to_owned() };
    // A link is named as it is, since its target may have another name.
    let place = whole(&plain(file.parent().unwrap_or(Path::new(""))))?.join(file.file_name().unwrap_or_default());
    let folder = whole(folder)?;
    let above = folder.parent().filter(|parent| parent.parent().is_some());
    let source = match (place.strip_prefix(&folder), above.map(|above| place.strip_prefix(above))) {
        (Ok(below), _) => coded(below).map(|path| path.trim_start_matches('/').to_owned()),
        (_, Some(Ok(above))) => coded(above).map(|path| format!("../{}", path.trim_start_matches('/'))),
        _ => coded(&place).map(|path| format!("file://{path}")),
    };
    let refuse = || Error::Argument(Invalid::new("--units", file.display(), "its path must be UTF-8"));
    source.ok_or_else(refuse)
}

/// A path after a slash, with percent codes for characters that a URI can't have; none if it isn't UTF-8.
fn coded(path: &Path) -> Option<String> {
    let mut text = String::new();
    for part in path.components() {
        let part = match part {
            Component::RootDir => continue,
            Component::Prefix(prefix) => prefix.as_os_str().to_str()?.trim_start_matches(r"\\?\"),
            other => other.as_os_str().to_str()?,
        };
        text.push('/');
        for c in part.chars() {
            if c.is_alphanumeric() || "-._~+,()@".contains(c) {
                text.push(c);
            } else {
                c.encode_utf8(&mut [0; 4]).bytes().for_each(|byte| text.push_str(&format!("%{byte:02X}")));
            }
        }
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_named_by_a_relative_path_where_it_lies_near() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("all/loop");
        let far = root.path().join("far");
        for path in [folder.join("resources"), root.path().join("all/other units"), far.clone()] {
            std::fs::create_dir_all(path).unwrap();
        }
        let source = |path: &Path| source_of(path, &folder).unwrap();
        assert_eq!(source(&folder.join("resources/../A b%.fmu")), "A%20b%25.fmu");
        assert_eq!(source(&folder.join("resources/Ä<\"&'.fmu")), "resources/Ä%3C%22%26%27.fmu");
        assert_eq!(source(&root.path().join("all/other units/C.toml")), "../other%20units/C.toml");
        let whole = far.canonicalize().unwrap();
        assert_eq!(source(&far.join("D:e.fmu")), format!("file://{}/D%3Ae.fmu", whole.display()));
        assert!(source_of(&root.path().join("gone/X.fmu"), &folder).is_err());
    }

    #[test]
    fn a_name_may_precede_a_file() {
        assert_eq!(named("motor=a/M.fmu").unwrap(), (Some("motor".to_owned()), "a/M.fmu"));
        assert_eq!(named("a/M.fmu").unwrap(), (None, "a/M.fmu"));
        assert!(named("=M.fmu").is_err() && named("a b=M.fmu").is_err() && named("a.b=M.fmu").is_err());
    }
}
