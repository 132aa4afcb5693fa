//! FMUs with C sources, and with libraries that are compiled from these.

use std::path::{Path, PathBuf};

use super::appearance::appearance;
use super::archive::{self, Contents, Libraries};
use super::library::Library;
use super::platform::Platform;
use super::{Source, compiler, describe};
use crate::error::Error;
use crate::fmi2::describe::{DescribedUnit, SourceUnit};
use crate::fmi2::source::{RUNTIME, boundary};
use crate::model::Standard;
use crate::output;
use crate::scratch::Scratch;

/// Form of an FMU: generic, with C sources, or compiled from them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Form {
    /// The library of all units, with a description.
    #[default]
    Generic,
    /// C sources; and that library too.
    Source {
        /// True if the library is there.
        with_library: bool,
    },
    /// C sources, and a library for this machine that its compiler makes of them.
    Compiled,
    /// C sources, and libraries for platforms, older systems among them, that zig makes of them.
    CompiledFor {
        /// For which platforms.
        platforms: Vec<Platform>,
    },
}

/// Contents of an FMU except its description.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Content {
    /// The forms of its unit.
    pub form: Form,
    /// True if terminals are added, which some importers refuse in an FMU of FMI 2.0.
    pub terminals: bool,
    /// The version of the standard.
    pub standard: Standard,
}

/// Files that an FMU has in addition: their places in it, and bytes.
pub type Further = Vec<(String, Vec<u8>)>;

/// Writes the FMU of a description into a folder; its path.
///
/// # Errors
/// For a description that is refused, or files that can't be written; nothing is left half. With C sources, for a kind that
/// can't be recorded, with what can't; where a compiler is missing or refuses.
pub fn export_as(source: &Source, library: &Library, out: &Path, content: &Content) -> Result<PathBuf, Error> {
    let (name, bytes) = packed(source, library, content, &|_, _| Ok(Further::new()))?;
    output::make_folder(out, "")?;
    let file = out.join(name);
    output::write(&file, bytes)?;
    Ok(file)
}

/// The FMU of a description in memory, with further files that follow from its description and what that makes: the name
/// of its file, and its bytes.
///
/// # Errors
/// As [`export_as`], but for files that can't be written, and those of the further files.
pub fn packed(
    source: &Source,
    library: &Library,
    content: &Content,
    further: &dyn Fn(&Source, &DescribedUnit) -> Result<Further, Error>,
) -> Result<(String, Vec<u8>), Error> {
    let Content { form, terminals, standard } = content;
    let source = &source.of_standard(*standard)?;
    if *form == Form::Generic {
        let (unit, build) = describe(source, library)?;
        let appearance = appearance(source, &unit, &build, *terminals)?;
        let further = further(source, &unit)?;
        let (description, sources) = (&source.text, &[][..]);
        let contents =
            Contents { unit: &unit, build: &build, description, appearance: &appearance, sources, further: &further };
        return named(&contents, &Libraries::Common(library));
    }
    let SourceUnit { unit, designed, files } = library.source(source)?;
    let source = with_designed(source, &designed)?;
    let (_, build) = describe(&source, library)?;
    let appearance = appearance(&source, &unit, &build, *terminals)?;
    let sources = with_runtime(files, *standard);
    let (description, further) = (&source.text, further(&source, &unit)?);
    let contents = Contents {
        unit: &unit,
        build: &build,
        description,
        appearance: &appearance,
        sources: &sources,
        further: &further,
    };
    let own = match form {
        Form::Generic | Form::Source { with_library: true } => {
            return named(&contents, &Libraries::Common(library));
        }
        Form::Source { with_library: false } => Vec::new(),
        Form::Compiled => compiled((&unit.name, *standard), &sources, &[Platform::own()], false)?,
        Form::CompiledFor { platforms } => compiled((&unit.name, *standard), &sources, platforms, true)?,
    };
    named(&contents, &Libraries::Own(&own))
}

/// The name of the file of an FMU, and its bytes.
fn named(contents: &Contents, libraries: &Libraries) -> Result<(String, Vec<u8>), Error> {
    let name = format!("{}.fmu", contents.unit.name);
    let bytes = archive::packed(Path::new(&name), contents, libraries)?;
    Ok((name, bytes))
}

/// A unit's own files, with those that all units share.
fn with_runtime(files: Vec<(String, String)>, standard: Standard) -> Vec<(String, String)> {
    let shared = RUNTIME.iter().chain(boundary(standard)).map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
    files.into_iter().chain(shared).collect()
}

/// The description of a unit in which parameters of its design are constants.
fn with_designed(source: &Source, designed: &[String]) -> Result<Source, Error> {
    let refuse = |error: toml_edit::TomlError| Error::Description {
        file: source.file.clone(),
        reason: error.message().to_owned(),
    };
    let mut text: toml_edit::DocumentMut = source.text.parse().map_err(refuse)?;
    text["designed"] = toml_edit::value(designed.iter().collect::<toml_edit::Array>());
    Ok(Source { file: source.file.clone(), text: text.to_string(), as_written: false })
}

/// Libraries compiled from sources: their places in an FMU, and their bytes.
fn compiled(
    (name, standard): (&str, Standard),
    sources: &[(String, String)],
    platforms: &[Platform],
    portable: bool,
) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let folder = Scratch::new()?;
    for (name, text) in sources {
        let file = folder.path().join(name);
        std::fs::write(&file, text).map_err(Error::file(&file))?;
    }
    let compile = |platform: &Platform| compiler::compile(folder.path(), *platform, portable);
    platforms.iter().map(|platform| Ok((platform.binary_of(standard, name), compile(platform)?))).collect()
}
