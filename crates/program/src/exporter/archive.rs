//! The .fmu archive.

use std::fs::File;
use std::io::{Cursor, ErrorKind, Read, Write};
use std::path::Path;

use zip::result::{ZipError, ZipResult};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::appearance::Appearance;
use super::library::Library;
use crate::error::Error;
use crate::fmi2::build::Build;
use crate::fmi2::describe::DescribedUnit;
use crate::model::Standard;
use crate::texts::LICENCES;
use crate::{output, text_file};

/// Largest unpacked size of an archive, and of one text in it: limits for archives of others.
const LARGEST: u64 = 1 << 30;
const LARGEST_TEXT: u64 = 1 << 26;
/// The most files in an archive.
const MOST_ENTRIES: usize = 10_000;

/// A file in an archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its path.
    pub name: String,
    /// Its size in bytes, unpacked.
    pub size: u64,
    /// Its checksum (CRC-32).
    pub checksum: u32,
}

/// Name of the entry with the build of an FMU's library.
pub const BUILD: &str = "resources/build.json";
/// Its description, as a person wrote it.
pub const DESCRIBED: &str = "resources/description.toml";

/// Contents of an FMU except its libraries.
pub struct Contents<'a> {
    /// The unit.
    pub unit: &'a DescribedUnit,
    /// How the library was built that described it.
    pub build: &'a Build,
    /// Its description, which the library reads.
    pub description: &'a str,
    /// Its page, its picture and its terminals.
    pub appearance: &'a Appearance,
    /// Files of C: names and texts.
    pub sources: &'a [(String, String)],
    /// Further files: places in the archive, and bytes.
    pub further: &'a [(String, Vec<u8>)],
}

/// Libraries in an FMU.
pub enum Libraries<'a> {
    /// One library for all units, for its platforms.
    Common(&'a Library),
    /// Libraries of its own: places in the archive, and bytes.
    Own(&'a [(String, Vec<u8>)]),
}

/// The bytes of an FMU, whose file is for messages.
///
/// # Errors
/// When libraries can't be read.
pub fn packed(file: &Path, contents: &Contents, libraries: &Libraries) -> Result<Vec<u8>, Error> {
    let Contents { unit, build, description, appearance, sources, further } = contents;
    let build = serde_json::to_string_pretty(build).map_err(|error| Error::file(file)(error.into()))?;
    let (standard, xml) = match &unit.model_description_3 {
        Some(xml) => (Standard::Fmi3, xml),
        None => (Standard::Fmi2, &unit.model_description),
    };
    let mut entries: Vec<(&str, &[u8])> = vec![
        ("modelDescription.xml", xml.as_bytes()),
        ("documentation/index.html", appearance.page.as_bytes()),
        (DESCRIBED, description.as_bytes()),
        (BUILD, build.as_bytes()),
    ];
    if standard == Standard::Fmi2 {
        entries.insert(1, ("model.png", appearance.icon.png));
    }
    if let Some(terminals) = &appearance.terminals {
        entries.extend([
            ("terminalsAndIcons/terminalsAndIcons.xml", terminals.as_bytes()),
            ("terminalsAndIcons/icon.png", appearance.icon.png),
            ("terminalsAndIcons/icon.svg", appearance.icon.svg.as_bytes()),
        ]);
    }
    let licences: Vec<_> =
        LICENCES.iter().map(|(name, text)| (format!("documentation/licenses/{name}"), text)).collect();
    entries.extend(licences.iter().map(|(place, text)| (place.as_str(), text.as_bytes())));
    let places: Vec<String> = sources.iter().map(|(name, _)| format!("sources/{name}")).collect();
    entries.extend(places.iter().zip(*sources).map(|(place, (_, text))| (place.as_str(), text.as_bytes())));
    entries.extend(further.iter().map(|(place, bytes)| (place.as_str(), &bytes[..])));
    let mut zip = zipped(&entries).map_err(refused(file))?;
    match libraries {
        Libraries::Common(library) => library.packed().write(&unit.name, standard, &mut zip)?,
        Libraries::Own(own) => {
            let own: Vec<(&str, &[u8])> = own.iter().map(|(place, bytes)| (place.as_str(), &bytes[..])).collect();
            add(&mut zip, &own, 0o755).map_err(refused(file))?;
        }
    }
    finished(file, zip)
}

/// The bytes of an archive of some entries.
///
/// # Errors
/// When there are too many.
pub fn packed_entries(file: &Path, entries: &[(&str, &[u8])]) -> Result<Vec<u8>, Error> {
    finished(file, zipped(entries).map_err(refused(file))?)
}

/// Writes an archive of some entries; a file of that name is replaced at the end, or not at all.
///
/// # Errors
/// When it can't be written.
pub fn write_entries(file: &Path, entries: &[(&str, &[u8])]) -> Result<(), Error> {
    output::write(file, packed_entries(file, entries)?)
}

/// Writes an archive of some entries, and of others that can be run, likewise.
///
/// # Errors
/// When it can't be written.
pub fn write_program(file: &Path, entries: &[(&str, &[u8])], programs: &[(&str, &[u8])]) -> Result<(), Error> {
    let mut zip = zipped(entries).map_err(refused(file))?;
    add(&mut zip, programs, 0o755).map_err(refused(file))?;
    output::write(file, finished(file, zip)?)
}

type Zip = ZipWriter<Cursor<Vec<u8>>>;

/// The bytes of an archive at its end.
fn finished(file: &Path, zip: Zip) -> Result<Vec<u8>, Error> {
    zip.finish().map(Cursor::into_inner).map_err(refused(file))
}

/// The same entries always give the same bytes: no times, no owners.
fn zipped(entries: &[(&str, &[u8])]) -> ZipResult<Zip> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    add(&mut zip, entries, 0o644)?;
    Ok(zip)
}

fn add(zip: &mut Zip, entries: &[(&str, &[u8])], permissions: u32) -> ZipResult<()> {
    for (name, bytes) in entries {
        zip.start_file(*name, options(permissions))?;
        zip.write_all(bytes)?;
    }
    Ok(())
}

/// How an entry with these permissions is written. Of the time of an export most goes into compression: this level takes
/// half that of the usual one, for archives that are 3 % larger.
pub(super) fn options(permissions: u32) -> SimpleFileOptions {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    let options = options.compression_level(Some(4));
    options.last_modified_time(DateTime::default()).unix_permissions(permissions)
}

/// Reason for refusing an archive.
pub(super) fn refused(file: &Path) -> impl Fn(ZipError) -> Error {
    move |error| Error::Archive { file: file.to_owned(), reason: error.to_string() }
}

pub(super) fn open(file: &Path) -> Result<ZipArchive<File>, Error> {
    let opened = text_file::open(file).map_err(Error::file(file))?;
    let refuse =
        |error: ZipError| Error::Archive { file: file.to_owned(), reason: format!("not a readable archive: {error}") };
    let mut archive = ZipArchive::new(opened).map_err(refuse)?;
    if archive.has_duplicate_names() {
        let reason = "has several entries with the same name".to_owned();
        return Err(Error::Archive { file: file.to_owned(), reason });
    }
    if archive.len() > MOST_ENTRIES {
        let reason = format!("has {} files; at most {MOST_ENTRIES} are allowed", archive.len());
        return Err(Error::Archive { file: file.to_owned(), reason });
    }
    let mut total = 0_u64;
    for index in 0..archive.len() {
        total = total.saturating_add(archive.by_index_raw(index).map_err(refuse)?.size());
    }
    if total > LARGEST {
        let reason = format!("would unpack to {total} bytes; at most {LARGEST} are allowed");
        return Err(Error::Archive { file: file.to_owned(), reason });
    }
    Ok(archive)
}

/// The files in an archive.
///
/// # Errors
/// When it is broken or hostile.
pub fn entries(file: &Path) -> Result<Vec<Entry>, Error> {
    let mut archive = open(file)?;
    let count = archive.len();
    let entry = |index| {
        let entry = archive.by_index_raw(index)?;
        let name = entry.name()?.into_owned();
        Ok(entry.is_file().then_some(Entry { size: entry.size(), checksum: entry.crc32(), name }))
    };
    let entries: zip::result::ZipResult<Vec<_>> = (0..count).map(entry).collect();
    let entries = entries.map_err(|error| Error::Archive { file: file.to_owned(), reason: error.to_string() })?;
    Ok(entries.into_iter().flatten().collect())
}

/// The text of one file in an archive.
///
/// # Errors
/// When it isn't there, or isn't text.
pub fn read_entry(file: &Path, name: &str) -> Result<String, Error> {
    let mut archive = open(file)?;
    let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
    let entry =
        archive.by_name(name).map_err(|_| refuse(format!("has no {name}, so it is not an FMU of this kind")))?;
    if entry.size() > LARGEST_TEXT {
        return Err(refuse(format!("{name}: is longer than {LARGEST_TEXT} bytes")));
    }
    let mut text = String::new();
    entry.take(LARGEST_TEXT + 1).read_to_string(&mut text).map_err(|error| refuse(format!("{name}: {error}")))?;
    Ok(text)
}

/// The bytes of one file in an archive, which may be as large as an archive unpacks to.
///
/// # Errors
/// When it isn't there, or is broken.
pub fn read_bytes(file: &Path, name: &str) -> Result<Vec<u8>, Error> {
    let mut archive = open(file)?;
    let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
    let entry = archive.by_name(name).map_err(|error| refuse(format!("{name}: {error}")))?;
    let mut bytes = Vec::new();
    entry.take(LARGEST + 1).read_to_end(&mut bytes).map_err(|error| refuse(format!("{name}: {error}")))?;
    Ok(bytes)
}

/// Unpacks an archive into a folder; entries that would lie outside it are refused.
///
/// # Errors
/// When the archive is broken or hostile, or files can't be written.
pub fn unpack(file: &Path, folder: &Path) -> Result<(), Error> {
    unpack_but(file, folder, None)
}

/// Unpacks an archive likewise, but for files of one size and checksum.
///
/// # Errors
/// As [`unpack`].
pub fn unpack_but(file: &Path, folder: &Path, left: Option<(u64, u32)>) -> Result<(), Error> {
    let mut archive = open(file)?;
    let refuse = |reason: String| Error::Archive { file: file.to_owned(), reason };
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).map_err(|error| refuse(error.to_string()))?;
        let Some(name) = entry.enclosed_name() else {
            return Err(refuse(format!("entry {index} would be outside the folder")));
        };
        let target = folder.join(&name);
        let failed = |error: std::io::Error| refuse(format!("{}: {error}", name.display()));
        if entry.is_dir() {
            std::fs::create_dir_all(&target).map_err(failed)?;
            continue;
        }
        if left == Some((entry.size(), entry.crc32())) {
            continue;
        }
        if let Some(parent) = target.parent() {
            std::fs::create_dir_all(parent).map_err(failed)?;
        }
        // Two names may be one path: `a` and `./a`.
        let mut written = File::create_new(&target).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => refuse(format!("has several entries for `{}`", name.display())),
            _ => failed(error),
        })?;
        let size = entry.size();
        // One byte more than there is, so that the end is met, where the checksum is compared.
        let copied = std::io::copy(&mut (&mut entry).take(size.saturating_add(1)), &mut written).map_err(failed)?;
        if copied != size {
            return Err(refuse(format!("the entry `{}` does not have its declared size", name.display())));
        }
    }
    Ok(())
}
