//! Cache of files that take long to generate, in the user's cache folder. Checksums of its inputs name a file, so that
//! the same inputs find it. Nothing depends on the cache: files that can't be read are generated again. They are loaded
//! and executed, so only the user may be able to write to the folder. A checksum detects damaged files.

#[cfg(unix)]
mod trusted;

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write as _;
use std::fs::{self, DirEntry, File};
use std::io::{self, ErrorKind, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use sha2::{Digest, Sha256};

use crate::begun;

/// Variable that names another cache folder; empty for no cache.
pub const FOLDER: &str = "ADAPTIVE_FMU_CACHE";
/// The most files in the cache; the oldest are removed first.
const MOST_CACHED: usize = 500;
/// Time for which a library stays after the start of a program that loads it.
const RECENT: Duration = Duration::from_secs(3600);
/// Age at which an unfinished file of a killed process is removed.
const UNFINISHED: Duration = Duration::from_secs(3600);
/// Version of the format of the files, which is part of their names.
const FORM: &[u8] = b"2";

/// Extension of libraries, which other processes load while they run.
pub(crate) const LIBRARY: &str = "library";
/// Number of digits at the start of a file's name.
const NAME: usize = 32;
/// Length of a SHA-256 checksum.
const LENGTH: usize = 32;
/// A SHA-256 checksum.
pub(crate) type Checksum = [u8; LENGTH];

/// A file with its size, and the time of its last change.
type Seen = (PathBuf, usize, SystemTime);

/// Checksums of files.
static KNOWN: Mutex<Option<HashMap<Seen, Checksum>>> = Mutex::new(None);

/// Troubles with the cache that concern the user.
static TROUBLE: Mutex<Trouble> = Mutex::new(Trouble { untrusted: None, is_reported: false, damaged: BTreeSet::new() });

struct Trouble {
    /// Reason why the folder isn't used.
    untrusted: Option<String>,
    is_reported: bool,
    /// Files that are made anew.
    damaged: BTreeSet<PathBuf>,
}

/// Troubles with the cache that weren't reported yet, one line each.
pub fn trouble() -> Vec<String> {
    let mut found = TROUBLE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut lines = Vec::new();
    if let Some(reason) = found.untrusted.clone().filter(|_| !std::mem::replace(&mut found.is_reported, true)) {
        lines.push(format!(
            "the cache is not used: {reason}. Its files are loaded and executed, so only you may be able to write to \
             it. Set {FOLDER} to another folder, or to nothing to run without a cache"
        ));
    }
    let damaged: Vec<_> = std::mem::take(&mut found.damaged).iter().map(|file| file.display().to_string()).collect();
    if !damaged.is_empty() {
        lines.push(format!("damaged files in the cache were generated again: {}", damaged.join(", ")));
    }
    lines
}

/// The checksum of a file with these bytes. That of a library takes milliseconds and is needed often, so it is computed
/// once for an unchanged file.
pub(crate) fn checksum(file: &Path, bytes: &[u8]) -> Checksum {
    known_or(file, bytes.len(), || digest(bytes))
}

/// The checksum of these bytes.
pub(crate) fn digest(bytes: &[u8]) -> Checksum {
    Sha256::digest(bytes).into()
}

/// Returns the known checksum of a file of this size, otherwise computes it.
pub(crate) fn known_or(file: &Path, size: usize, otherwise: impl FnOnce() -> Checksum) -> Checksum {
    let Some(modified) = fs::metadata(file).ok().and_then(|found| found.modified().ok()) else { return otherwise() };
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    *known.get_or_insert_default().entry((file.to_owned(), size, modified)).or_insert_with(otherwise)
}

/// A place in the cache.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    file: PathBuf,
}

impl Entry {
    /// The entry for these parts, with an extension; none without a usable cache folder.
    pub fn of(extension: &str, parts: &[&[u8]]) -> Option<Self> {
        let folder = folder()?;
        begun::restore_mask();
        make(&folder)?;
        let mut hash = Sha256::new();
        for part in [FORM].iter().chain(parts) {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        let mut name = String::new();
        hash.finalize().iter().take(NAME / 2).for_each(|byte| _ = write!(name, "{byte:02x}"));
        Some(Entry { file: folder.join(name).with_extension(extension) })
    }

    /// Its file, which may not exist yet.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The [written](Entry::write) content, if it is whole.
    pub fn read(&self) -> Option<Vec<u8>> {
        let mut bytes = self.bytes()?;
        let content = bytes.split_off(bytes.len().min(LENGTH));
        if bytes != digest(&content) {
            self.note_damage();
            return None;
        }
        Some(content)
    }

    /// Writes the content after its checksum, as a whole or not at all.
    pub fn write(&self, content: &[u8]) {
        self.place(&[&digest(content), content]);
    }

    /// True if there is a file of exactly these bytes, or one can be written: others read the file itself.
    pub fn holds(&self, bytes: &[u8]) -> bool {
        let is_there = |found: Option<Vec<u8>>| found.is_some_and(|found| found == bytes);
        let found = self.bytes();
        if found.as_ref().is_some_and(|found| found != bytes) {
            self.note_damage();
        }
        if is_there(found) {
            self.note_use();
            return true;
        }
        self.place(&[bytes]);
        // A disk may be full.
        is_there(self.bytes())
    }

    /// Marks the file as used: the oldest files are removed first.
    fn note_use(&self) {
        let is_old = |time: SystemTime| time.elapsed().is_ok_and(|age| age > RECENT / 4);
        let modified = fs::metadata(&self.file).and_then(|found| found.modified());
        if modified.is_ok_and(is_old) {
            // If it can't be marked, it is removed earlier, and generated again.
            let _ = File::options().write(true).open(&self.file).and_then(|file| file.set_modified(SystemTime::now()));
        }
    }

    /// The bytes of the file, if it exists.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        match open(&self.file).and_then(|mut file| file.read_to_end(&mut bytes)) {
            Ok(_) => Some(bytes),
            Err(error) => {
                if error.kind() != ErrorKind::NotFound {
                    self.note_damage();
                }
                None
            }
        }
    }

    /// Notes that the file is damaged: a warning names it, and it is generated again.
    pub fn note_damage(&self) {
        TROUBLE.lock().unwrap_or_else(PoisonError::into_inner).damaged.insert(self.file.clone());
    }

    /// Writes bytes as a whole or not at all, also if the power fails.
    fn place(&self, parts: &[&[u8]]) {
        let Some(folder) = self.file.parent() else { return };
        tidy(folder);
        begun::restore_mask();
        let write = || -> io::Result<()> {
            let mut file = tempfile::Builder::new().suffix(".tmp").tempfile_in(folder)?;
            parts.iter().try_for_each(|part| file.write_all(part))?;
            file.as_file().sync_all()?;
            file.persist(&self.file)?;
            Ok(())
        };
        // A cache that can't be written is no obstacle.
        let _ = write();
    }
}

/// The cache folder of this package.
fn folder() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if std::env::var_os(FOLDER).is_some() {
        return of(FOLDER);
    }
    let home = |inner: &str| of("HOME").map(|home| home.join(inner));
    let caches = if cfg!(windows) {
        of("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        home("Library/Caches")
    } else {
        of("XDG_CACHE_HOME").filter(|path| path.is_absolute()).or_else(|| home(".cache"))
    };
    Some(caches?.join("adaptive-fmu"))
}

/// Creates the folder, if it can be trusted.
#[cfg(unix)]
fn make(folder: &Path) -> Option<()> {
    let note = |reason: String| {
        TROUBLE.lock().unwrap_or_else(PoisonError::into_inner).untrusted.get_or_insert(reason);
        false
    };
    trusted::folder(folder).unwrap_or_else(note).then_some(())
}

#[cfg(not(unix))]
fn make(folder: &Path) -> Option<()> {
    fs::create_dir_all(folder).ok()
}

#[cfg(unix)]
fn open(file: &Path) -> io::Result<File> {
    trusted::open(file)
}

#[cfg(not(unix))]
fn open(file: &Path) -> io::Result<File> {
    File::open(file)
}

/// Removes the oldest of too many files, and unfinished ones.
fn tidy(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let dated = |entry: DirEntry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()));
    let mut files: Vec<(SystemTime, PathBuf)> = entries.filter_map(|entry| dated(entry.ok()?)).collect();
    files.sort();
    let surplus = files.len().saturating_sub(MOST_CACHED);
    let is_old = |time: &SystemTime| time.elapsed().is_ok_and(|age| age > UNFINISHED);
    let is_left = |time: &SystemTime, file: &Path| is_old(time) && file.to_string_lossy().contains(".tmp");
    let is_loaded = |time: &SystemTime, file: &Path| {
        let is_library = file.extension().is_some_and(|extension| extension == LIBRARY);
        is_library && time.elapsed().is_ok_and(|age| age < RECENT)
    };
    let goes = |k: usize, time: &SystemTime, file: &Path| k < surplus && !is_loaded(time, file) || is_left(time, file);
    let gone = files.iter().enumerate().filter(|(k, (time, file))| goes(*k, time, file));
    gone.for_each(|(_, (_, file))| _ = fs::remove_file(file));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_a_program_loads_stays_however_many_newer_files_there_are() {
        let folder = tempfile::tempdir().unwrap();
        let loaded = Entry { file: folder.path().join("loaded").with_extension(LIBRARY) };
        let old = Entry { file: folder.path().join("old").with_extension(LIBRARY) };
        assert!(loaded.holds(b"library") && old.holds(b"other"));
        let hours_ago = SystemTime::now() - 2 * RECENT;
        for entry in [&loaded, &old] {
            File::options().write(true).open(entry.file()).unwrap().set_modified(hours_ago).unwrap();
        }
        // A program begins.
        assert!(loaded.holds(b"library"));
        for k in 0..MOST_CACHED + 2 {
            fs::write(folder.path().join(format!("{k}.kernel")), b"").unwrap();
        }
        tidy(folder.path());
        assert_eq!([loaded.file().exists(), old.file().exists()], [true, false]);
    }

    #[test]
    fn a_library_that_is_loaded_from_here_is_whole_or_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let entry = Entry { file: folder.path().join("one.library") };
        let library = [7; 5000];
        assert!(entry.holds(&library) && !is_damaged(&entry));
        for damaged in [&[][..], &[7; 4999], &[0; 5000]] {
            fs::write(&entry.file, damaged).unwrap();
            assert!(entry.holds(&library) && is_damaged(&entry));
            assert_eq!(fs::read(&entry.file).unwrap(), library);
        }
        // If nothing can be written, there is no file.
        let nowhere = Entry { file: folder.path().join("none").join("one.library") };
        assert!(!nowhere.holds(&library) && !is_damaged(&nowhere));
    }

    /// True if the file was noted as damaged; it is no longer noted then.
    fn is_damaged(entry: &Entry) -> bool {
        TROUBLE.lock().unwrap_or_else(PoisonError::into_inner).damaged.remove(&entry.file)
    }
}
