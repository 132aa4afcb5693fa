//! What takes long to make and follows from other things alone is kept in the user's cache folder, by checksums of what it
//! follows from: whoever has the same finds it. Nothing depends on it: where it can't be read or written, things are made
//! anew.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use sha2::{Digest, Sha256};

/// The folder, in place of that in the user's cache folder; where it is empty, nothing is kept.
pub const FOLDER: &str = "ADAPTIVE_FMU_CACHE";
/// So many files are kept; the oldest go.
const MOST_KEPT: usize = 500;
/// What a process that was killed left unfinished goes after this time.
const UNFINISHED: Duration = Duration::from_secs(3600);

/// A SHA-256 checksum.
pub type Checksum = [u8; 32];

/// A file as it was at a time, with its size.
type Seen = (PathBuf, usize, SystemTime);

/// Checksums of files.
static KNOWN: Mutex<Option<HashMap<Seen, Checksum>>> = Mutex::new(None);

/// The checksum of a file that holds these bytes. A library's takes milliseconds and is asked for again and again: it is
/// computed once, as long as the file stays as it is.
pub fn checksum(file: &Path, bytes: &[u8]) -> Checksum {
    known_or(file, bytes.len(), || digest(bytes))
}

/// The checksum of these bytes.
pub fn digest(bytes: &[u8]) -> Checksum {
    Sha256::digest(bytes).into()
}

/// Of a file that holds so many bytes: what is known already, else what this gives.
pub fn known_or(file: &Path, size: usize, otherwise: impl FnOnce() -> Checksum) -> Checksum {
    let Some(modified) = fs::metadata(file).ok().and_then(|found| found.modified().ok()) else { return otherwise() };
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    *known.get_or_insert_default().entry((file.to_owned(), size, modified)).or_insert_with(otherwise)
}

/// A place in the cache.
#[derive(Debug, Clone)]
pub struct Entry {
    file: PathBuf,
}

impl Entry {
    /// For what follows from these parts, with an extension; nothing where nothing is to be kept, or can be.
    pub fn of(extension: &str, parts: &[&[u8]]) -> Option<Self> {
        let folder = folder()?;
        make(&folder)?;
        let mut hash = Sha256::new();
        for part in parts {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        let mut name = String::new();
        hash.finalize().iter().take(16).for_each(|byte| _ = write!(name, "{byte:02x}"));
        Some(Entry { file: folder.join(name).with_extension(extension) })
    }

    /// Where it is, when it is there.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// What is there.
    pub fn read(&self) -> Option<Vec<u8>> {
        fs::read(&self.file).ok()
    }

    /// Puts it there, whole or not at all.
    pub fn write(&self, bytes: &[u8]) {
        let unfinished = self.unfinished();
        if fs::write(&unfinished, bytes).is_err() || fs::rename(&unfinished, &self.file).is_err() {
            let _ = fs::remove_file(unfinished);
        }
    }

    /// Where this process makes it, beside where it goes: two at a time don't disturb each other, and what they make is the
    /// same. Room is made for it.
    pub fn unfinished(&self) -> PathBuf {
        self.file.parent().into_iter().for_each(tidy);
        self.file.with_extension(format!("{}.tmp", std::process::id()))
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

/// Makes the folder, which nobody else may write to: what lies there is run.
#[cfg(unix)]
fn make(folder: &Path) -> Option<()> {
    use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
    const WRITABLE_BY_OTHERS: u32 = 0o022;
    fs::DirBuilder::new().recursive(true).mode(0o700).create(folder).ok()?;
    (fs::metadata(folder).ok()?.permissions().mode() & WRITABLE_BY_OTHERS == 0).then_some(())
}

#[cfg(not(unix))]
fn make(folder: &Path) -> Option<()> {
    fs::create_dir_all(folder).ok()
}

/// Removes the oldest files where there are too many, and what was left unfinished.
fn tidy(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let dated = |entry: DirEntry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()));
    let mut files: Vec<(SystemTime, PathBuf)> = entries.filter_map(|entry| dated(entry.ok()?)).collect();
    files.sort();
    let surplus = files.len().saturating_sub(MOST_KEPT);
    let is_old = |time: &SystemTime| time.elapsed().is_ok_and(|age| age > UNFINISHED);
    let is_left = |time: &SystemTime, file: &Path| is_old(time) && file.to_string_lossy().contains(".tmp");
    let gone = files.iter().enumerate().filter(|(k, (time, file))| *k < surplus || is_left(time, file));
    gone.for_each(|(_, (_, file))| _ = fs::remove_file(file));
}
