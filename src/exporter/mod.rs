//! From descriptions to FMU archives.

mod archive;
mod composite;
#[allow(unsafe_code)]
mod library;
mod page;

use std::path::{Path, PathBuf};

pub use archive::{PLATFORM, read_entry, unpack, write_entries};
pub use composite::{composite, composite_name, with_values};
pub use library::Library;
pub(crate) use library::with_causes;
pub(crate) use page::escaped;

use crate::error::Error;
use crate::fmi2::describe::{Build, Unit};

include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

/// Files within this program: name and text.
pub type Embedded = &'static [(&'static str, &'static str)];

/// A description, and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The file, for messages.
    pub file: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// The same system with other start values.
    ///
    /// # Errors
    /// When the text is no description.
    pub fn with_start(self, values: &[(&str, &str)]) -> Result<Self, Error> {
        if values.is_empty() {
            return Ok(self);
        }
        let refuse = |reason: String| Error::Description { file: self.file.clone(), reason };
        let mut table: toml::Table = self.text.parse().map_err(|error: toml::de::Error| refuse(error.to_string()))?;
        let start = table.entry("start").or_insert_with(|| toml::Table::new().into());
        let start = start.as_table_mut().ok_or_else(|| refuse("start must be a table".to_owned()))?;
        start.extend(values.iter().map(|(name, text)| ((*name).to_owned(), (*text).into())));
        Ok(Source { text: table.to_string(), ..self })
    }
}

/// The descriptions of this package: name and text.
pub fn descriptions() -> &'static [(&'static str, &'static str)] {
    DESCRIPTIONS
}

/// The closed loops of this package: name and files.
pub fn loops() -> &'static [(&'static str, Embedded)] {
    LOOPS
}

/// The description of one of this package's FMUs, or of a TOML file.
///
/// # Errors
/// When there is no such FMU or file.
pub fn find_description(name: &str) -> Result<Source, Error> {
    let path = Path::new(name);
    if path.extension().is_some_and(|extension| extension == "toml") {
        let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
        return Ok(Source { file: path.to_owned(), text });
    }
    let found = DESCRIPTIONS.iter().find(|(known, _)| *known == name);
    let (name, text) = found.ok_or_else(|| {
        let known: Vec<_> = DESCRIPTIONS.iter().map(|(name, _)| *name).collect();
        Error::Unknown { what: "FMU", name: name.to_owned(), known: known.join(", ") }
    })?;
    Ok(Source { file: Path::new("modelDescription").join(format!("{name}.toml")), text: (*text).to_owned() })
}

/// The unit of a description, as the library describes it, and how that was built.
fn describe(source: &Source, library: &Library) -> Result<(Unit, Build), Error> {
    let described = library.describe(Some(&source.text)).map_err(|error| match error {
        Error::Library(reason) => Error::Description { file: source.file.clone(), reason },
        other => other,
    })?;
    let unit = described.unit.ok_or_else(|| Error::Library("the library described no unit".to_owned()))?;
    Ok((unit, described.build))
}

/// Writes the FMU of a description into a folder; its path.
///
/// # Errors
/// For a description that is refused, or files that can't be written; nothing is left half.
pub fn export(source: &Source, library: &Library, out: &Path) -> Result<PathBuf, Error> {
    let (unit, build) = describe(source, library)?;
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    let file = out.join(format!("{}.fmu", unit.name));
    let page = page::html(&unit, &build);
    archive::write(&file, &unit, &source.text, &page, library)?;
    Ok(file)
}
