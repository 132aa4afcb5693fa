//! One library for several platforms, as FMUs hold it.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::{Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use zip::{ZipArchive, ZipWriter};

use super::archive::{options, refused};
use super::asked::Glibc;
use super::library::library_folders;
use super::platform::Platform;
use crate::cache;
use crate::error::Error;
use crate::fmi2::build::{self, Build};
use crate::library::{PACKAGE, REGISTRY, SOURCE};
use crate::model::Standard;
use crate::text_file;

/// A library for a platform.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binary {
    /// The platform.
    pub platform: Platform,
    /// Its file.
    pub file: PathBuf,
    /// How it was built.
    pub build: Build,
    /// The oldest glibc that it can be loaded with, where it asks for one.
    pub glibc: Option<Glibc>,
    /// Its bytes, if they are in no file.
    pub bytes: Option<Vec<u8>>,
}

impl Binary {
    /// A library by its file, or by platform and file, `win64=adaptive_fmu_library.dll`. The platform follows from the file's
    /// contents; if they have none, it counts as one for this platform, and loading it shows what it is.
    ///
    /// # Errors
    /// When the file can't be read, or is for another platform.
    pub fn named(text: &str) -> Result<Self, Error> {
        let named = text.split_once('=').and_then(|(folder, file)| Some((Platform::named(folder)?, file)));
        let file = Path::new(named.map_or(text, |(_, file)| file));
        let refuse = |reason: String| Err(Error::Library(format!("{}: {reason}", file.display())));
        let bytes = read(file)?;
        match (Binary::of_bytes(file, &bytes)?, named) {
            (Some(binary), Some((wanted, _))) if wanted != binary.platform => {
                refuse(format!("is for {}, not for {}", binary.platform.folder, wanted.folder))
            }
            (Some(binary), _) => Ok(binary),
            (None, Some(_)) => refuse("is not a library of this package, or of another version".to_owned()),
            (None, None) => Ok(Binary::own(file, &bytes)),
        }
    }

    /// A library of this package; none where it is something else.
    pub(super) fn of_bytes(file: &Path, bytes: &[u8]) -> Result<Option<Self>, Error> {
        let Some(build) = Build::within(bytes) else { return Ok(None) };
        let platform = Platform::of_target(&build.target).ok_or_else(|| {
            Error::Library(format!("{}: is for {}, which FMUs do not support", file.display(), build.target))
        })?;
        Ok(Some(Binary { platform, file: file.to_owned(), build, glibc: Glibc::asked_by(bytes), bytes: None }))
    }

    /// The library for this platform.
    pub(super) fn own(file: &Path, bytes: &[u8]) -> Self {
        let build = Build::within(bytes).unwrap_or_default();
        Binary { platform: Platform::own(), file: file.to_owned(), build, glibc: Glibc::asked_by(bytes), bytes: None }
    }
}

/// The bytes of a regular file.
fn read(file: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let read = text_file::open(file).and_then(|mut opened| opened.read_to_end(&mut bytes));
    read.map_err(Error::file(file))?;
    Ok(bytes)
}

/// Libraries for other platforms, or for older systems of this one, near a program: in the folder of an archive for
/// users without Rust, or where cargo writes builds for a given target.
pub(super) fn near(folder: &Path) -> Vec<Binary> {
    let places = library_folders(folder).flat_map(|libraries| folders(&libraries)).chain(of_targets(folder));
    of_names(places, |platform| platform.library_name())
}

/// This program, and what cargo left of the same sources for other platforms, or for older systems of this one.
///
/// # Errors
/// When this program's own path is unknown.
pub fn programs() -> Result<Vec<Binary>, Error> {
    let file = std::env::current_exe().map_err(Error::file("this program"))?;
    let places = file.parent().map(of_targets).unwrap_or_default().into_iter();
    let own = Binary { platform: Platform::own(), build: own_build(), glibc: None, file: file.clone(), bytes: None };
    let mut programs = Binaries::of(own);
    for program in of_names(places, |platform| platform.program_name().to_owned()) {
        // Libraries of other sources are reported when libraries are taken.
        let _ = programs.take(program);
    }
    Ok(programs.of)
}

/// Build of this program, as text. The program holds it, so that one for another platform can be identified.
static OWN_BUILD: [u8; build::length(PACKAGE, SOURCE)] = build::text(PACKAGE, SOURCE);

/// Build of this program.
pub(super) fn own_build() -> Build {
    Build::within(&OWN_BUILD).unwrap_or_default()
}

/// This package's models, of which the program knows more than the library that goes into FMUs.
pub(super) fn own_models() -> build::Library {
    build::Library { registry: REGISTRY, source: SOURCE, build: &OWN_BUILD }
}

/// Folders of cargo's builds for given targets, from the folder of a program.
fn of_targets(folder: &Path) -> Vec<PathBuf> {
    let profile = folder.file_name().unwrap_or_default();
    folder.parent().map(folders).unwrap_or_default().iter().map(|target| target.join(profile)).collect()
}

/// The files in some folders that are called as on any platform, but for what can't go into an FMU.
fn of_names(places: impl Iterator<Item = PathBuf>, name: fn(&Platform) -> String) -> Vec<Binary> {
    let names: BTreeSet<String> = Platform::all().map(|platform| name(&platform)).collect();
    let files = places.flat_map(|place| names.iter().map(move |name| place.join(name)).collect::<Vec<_>>());
    let found = files.filter(|file| file.is_file());
    found.filter_map(|file| Binary::of_bytes(&file, &read(&file).ok()?).ok().flatten()).collect()
}

/// The folders in a folder, in the order of their names.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let found: BTreeSet<PathBuf> = entries.filter(|path| path.is_dir()).collect();
    found.into_iter().collect()
}

/// The libraries that go into every FMU, a platform each.
#[derive(Debug)]
pub(super) struct Binaries {
    of: Vec<Binary>,
    /// Each as an archive of one entry: it is compressed once, not once an FMU.
    packed: OnceLock<Vec<Vec<u8>>>,
}

impl Binaries {
    /// The binaries of one platform.
    pub fn of(binary: Binary) -> Self {
        Binaries { of: vec![binary], packed: OnceLock::new() }
    }

    /// Adds one for another platform.
    pub fn add(&mut self, binary: Binary) -> Result<(), Error> {
        self.require_same(&binary)?;
        if let Some(there) = self.of.iter().find(|there| there.platform == binary.platform) {
            let (there, platform) = (there.file.display(), binary.platform.folder);
            return Err(Error::Library(format!(
                "{}: another library, {there}, is already given for {platform}",
                binary.file.display()
            )));
        }
        self.of.push(binary);
        self.packed.take();
        Ok(())
    }

    /// Adds one that was found: one for the first's platform, which is for older systems, takes its place.
    pub fn take(&mut self, binary: Binary) -> Result<(), Error> {
        if binary.platform != self.of[0].platform {
            return self.add(binary);
        }
        self.require_same(&binary)?;
        self.of[0] = binary;
        self.packed.take();
        Ok(())
    }

    /// All of them.
    pub fn all(&self) -> &[Binary] {
        &self.of
    }

    fn require_same(&self, binary: &Binary) -> Result<(), Error> {
        if binary.build.source == self.of[0].build.source {
            return Ok(());
        }
        let (own, other) = (self.of[0].file.display(), binary.file.display());
        Err(Error::Library(format!(
            "{other} was built from other sources than {own}. Build both from the same sources"
        )))
    }

    /// Puts all of them into the archive of an FMU.
    pub fn write<W: Write + Seek>(&self, name: &str, standard: Standard, zip: &mut ZipWriter<W>) -> Result<(), Error> {
        let is_3 = standard == Standard::Fmi3;
        for (binary, packed) in self.of.iter().zip(self.packed()?) {
            let refuse = refused(&binary.file);
            let mut archive = ZipArchive::new(Cursor::new(packed)).map_err(&refuse)?;
            let entry = archive.by_index_raw(0).map_err(&refuse)?;
            let place = binary.platform.binary_of(standard, name);
            zip.raw_copy_file_rename(entry, place).map_err(&refuse)?;
            let other = binary.platform.other_binary(name).filter(|_| !is_3 && self.leave_free(&binary.platform));
            let Some(other) = other else { continue };
            let entry = archive.by_index_raw(0).map_err(&refuse)?;
            zip.raw_copy_file_rename(entry, other).map_err(&refuse)?;
        }
        Ok(())
    }

    /// True if no library lies where masters look for one of this platform that don't know the platform's own folder.
    fn leave_free(&self, platform: &Platform) -> bool {
        self.of.iter().all(|binary| Some(binary.platform.folder) != platform.other_folder)
    }

    fn packed(&self) -> Result<&Vec<Vec<u8>>, Error> {
        if let Some(packed) = self.packed.get() {
            return Ok(packed);
        }
        let packed = self.of.iter().map(packed).collect::<Result<_, _>>()?;
        Ok(self.packed.get_or_init(|| packed))
    }
}

/// A library as an archive of one entry. Compressing takes most of the time of an export, so the result is cached.
fn packed(Binary { file, bytes, .. }: &Binary) -> Result<Vec<u8>, Error> {
    let bytes: Cow<[u8]> = match bytes {
        Some(bytes) => bytes.into(),
        None => std::fs::read(file).map_err(Error::file(file))?.into(),
    };
    let cached = cache::Entry::of("zip", &[&cache::checksum(file, &bytes)]);
    if let Some(archive) = cached.as_ref().and_then(cache::Entry::read) {
        return Ok(archive);
    }
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("library", options(0o755)).map_err(refused(file))?;
    zip.write_all(&bytes).map_err(Error::file(file))?;
    let archive = zip.finish().map_err(refused(file))?.into_inner();
    if let Some(cached) = cached {
        cached.write(&archive);
    }
    Ok(archive)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The places of the libraries in an FMU for some targets.
    fn places(targets: &[&str]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let binary = |target: &&str| {
            let file = folder.path().join(target);
            std::fs::write(&file, target).unwrap();
            let build = Build { target: (*target).to_owned(), ..own_build() };
            Binary { platform: Platform::of_target(target).unwrap(), file, build, glibc: None, bytes: None }
        };
        let mut all = targets.iter().map(binary);
        let mut binaries = Binaries::of(all.next().unwrap());
        all.for_each(|binary| binaries.add(binary).unwrap());
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        binaries.write("U", Standard::Fmi2, &mut zip).unwrap();
        let mut archive = ZipArchive::new(zip.finish().unwrap()).unwrap();
        let count = archive.len();
        let mut bytes = |index| {
            let mut entry = archive.by_index(index).unwrap();
            let mut text = String::new();
            entry.read_to_string(&mut text).unwrap();
            format!("{} {text}", entry.name().unwrap())
        };
        (0..count).map(&mut bytes).collect()
    }

    #[test]
    fn a_library_for_arm_lies_in_both_folders_unless_one_for_x86_64_takes_the_other() {
        let (arm, intel) = ("aarch64-unknown-linux-gnu", "x86_64-unknown-linux-gnu");
        let tuple = format!("binaries/aarch64-linux/U.so {arm}");
        assert_eq!(places(&[arm]), [tuple.clone(), format!("binaries/linux64/U.so {arm}")]);
        let of_intel = format!("binaries/linux64/U.so {intel}");
        assert_eq!(places(&[arm, intel]), [tuple.clone(), of_intel.clone()]);
        assert_eq!(places(&[intel, arm]), [of_intel, tuple]);
    }
}
