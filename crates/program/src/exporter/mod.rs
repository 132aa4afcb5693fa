//! From descriptions to FMU archives.

mod appearance;
mod archive;
mod asked;
mod binaries;
mod browser;
mod compiler;
mod embedded;
mod firmware;
#[allow(unsafe_code)]
mod library;
mod lines;
mod page;
mod pins;
mod platform;
mod source;
mod terminals;

use std::path::{Path, PathBuf};

pub use archive::{
    BUILD, DESCRIBED, Entry, entries, packed_entries, read_bytes, read_entry, unpack, unpack_but, write_entries,
    write_program,
};
pub use asked::{Asked, Glibc, asked_within};
pub use binaries::{Binary, programs};
pub use browser::{BROWSER, BROWSER_FILE, browser_library, check_browser_library};
pub use embedded::{hold, tidy};
pub use firmware::{export_firmware, firmware};
pub(crate) use library::with_causes;
pub use library::{LIBRARIES, Library, SHARED, own_library};
pub(crate) use page::push_report;
pub use platform::Platform;
pub use source::{Content, Form, Further, export_as, packed};

pub use crate::texts::{Embedded, descriptions, league, loops};

use crate::error::Error;
use crate::fmi2::build::Build;
use crate::fmi2::describe::DescribedUnit;
use crate::model::Standard;
use crate::{model, text_file};

/// Name of the file that every loop has.
pub const STRUCTURE_FILE: &str = "SystemStructure.ssd";

/// A description, and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The file, for messages.
    pub file: PathBuf,
    /// Its text.
    pub text: String,
    /// True if the text is as it was read: its lines are those of the file then.
    pub as_written: bool,
}

impl Source {
    /// The text of a file as it was read.
    pub fn read(file: PathBuf, text: String) -> Self {
        Source { file, text, as_written: true }
    }

    /// The same system with other start values; the rest of the text stays, comments too.
    ///
    /// # Errors
    /// When the text is no description.
    pub fn with_start<'a, V: Into<toml_edit::Value>>(
        &self,
        values: impl IntoIterator<Item = (&'a str, V)>,
    ) -> Result<Self, Error> {
        self.with("start", values)
    }

    /// The same system with other values of its nominal plant.
    ///
    /// # Errors
    /// When the text is no description, or has no nominal plant.
    pub fn with_nominal<'a, V: Into<toml_edit::Value>>(
        &self,
        values: impl IntoIterator<Item = (&'a str, V)>,
    ) -> Result<Self, Error> {
        let changed = self.with("nominal", values)?;
        let has_plant = model::Description::read(&self.text).is_ok_and(|description| description.nominal.is_some());
        if changed.as_written || has_plant {
            return Ok(changed);
        }
        let reason = "there is no table [nominal] with the plant that it was designed for; `new --plant` writes one";
        Err(Error::Description { file: self.file.clone(), reason: reason.to_owned() })
    }

    /// The same system as a unit of a version of the standard.
    ///
    /// # Errors
    /// When the text is no description.
    pub fn of_standard(&self, standard: Standard) -> Result<Self, Error> {
        let wanted = (standard == Standard::Fmi3).then_some(3);
        // What can't be read is refused by the library, which knows the line.
        if model::Description::read(&self.text).is_ok_and(|known| known.fmi.map(i64::from) != wanted) {
            return self.with_version(wanted);
        }
        Ok(self.clone())
    }

    fn with_version(&self, version: Option<i64>) -> Result<Self, Error> {
        let refuse = |reason: &str| Error::Description { file: self.file.clone(), reason: reason.to_owned() };
        let mut text: toml_edit::DocumentMut =
            self.text.parse().map_err(|error: toml_edit::TomlError| refuse(error.message()))?;
        match version {
            Some(version) => text["fmi"] = toml_edit::value(version),
            None => _ = text.remove("fmi"),
        }
        Ok(Source { file: self.file.clone(), text: text.to_string(), as_written: self.as_written && version.is_none() })
    }

    fn with<'a, V: Into<toml_edit::Value>>(
        &self,
        table: &str,
        values: impl IntoIterator<Item = (&'a str, V)>,
    ) -> Result<Self, Error> {
        let refuse = |reason: &str| Error::Description { file: self.file.clone(), reason: reason.to_owned() };
        let mut text: toml_edit::DocumentMut =
            self.text.parse().map_err(|error: toml_edit::TomlError| refuse(error.message()))?;
        let mut values = values.into_iter().peekable();
        if values.peek().is_none() {
            return Ok(self.clone());
        }
        let changed = text.entry(table).or_insert_with(toml_edit::table);
        let changed = changed.as_table_like_mut().ok_or_else(|| refuse(&format!("{table} must be a table")))?;
        for (name, value) in values {
            let mut value = value.into();
            if let Some(before) = changed.get_mut(name).and_then(toml_edit::Item::as_value_mut) {
                *value.decor_mut() = before.decor().clone();
                *before = value;
            } else {
                changed.insert(name, toml_edit::value(value));
            }
        }
        Ok(Source { file: self.file.clone(), text: text.to_string(), as_written: false })
    }
}

/// The name of a loop as one FMU: `Loop_3_2_1_cosine`.
pub fn name_of_whole(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    format!("Loop_{}", name.chars().map(plain).collect::<String>())
}

/// The description of one of this package's FMUs, of a TOML file, or within an FMU that this program exported.
///
/// # Errors
/// When there is no such FMU or file, or the FMU is of another tool.
pub fn find_description(name: &str) -> Result<Source, Error> {
    let path = Path::new(name);
    if path.extension().is_some_and(|extension| extension == "toml") {
        let text = text_file::read(path).map_err(Error::file(path))?;
        return Ok(Source::read(path.to_owned(), text));
    }
    if path.extension().is_some_and(|extension| extension == "fmu") {
        if !entries(path)?.iter().any(|entry| entry.name == DESCRIBED) {
            let reason = "contains no description of this program, so it is of another tool. `adaptive-fmu info` shows its \
                          variables, `adaptive-fmu validate` checks it against the standard";
            return Err(Error::Archive { file: path.to_owned(), reason: reason.to_owned() });
        }
        return Ok(Source::read(path.with_extension("toml"), read_entry(path, DESCRIBED)?));
    }
    let found = descriptions().iter().find(|(known, _)| *known == name);
    let (name, text) = found.ok_or_else(|| {
        Error::unknown("FMU", name, descriptions().iter().map(|(name, _)| *name), "`adaptive-fmu list`")
    })?;
    Ok(Source::read(Path::new("modelDescription").join(format!("{name}.toml")), (*text).to_owned()))
}

/// The unit of a description, as the library describes it, and how that was built.
///
/// # Errors
/// For a description that the library refuses.
pub fn describe(source: &Source, library: &Library) -> Result<(DescribedUnit, Build), Error> {
    let described = library.describe(Some(source))?;
    let unit = described.unit.ok_or_else(|| Error::Library("the library described no FMU".to_owned()))?;
    Ok((unit, described.build))
}

/// The version of FMI that an FMU is of, `2.0` or `3.0`; none where a file is no FMU.
pub fn version_of(fmu: &Path) -> Option<String> {
    fmu.extension().filter(|extension| *extension == "fmu")?;
    let xml = read_entry(fmu, "modelDescription.xml").ok()?;
    let (_, version) = xml.split_once("fmiVersion")?;
    version.split(['"', '\'']).nth(1).map(str::to_owned)
}

/// Writes the FMU of a description into a folder; its path.
///
/// # Errors
/// For a description that is refused, or files that can't be written; nothing is left half.
pub fn export(source: &Source, library: &Library, out: &Path) -> Result<PathBuf, Error> {
    export_as(source, library, out, &Content::default())
}
