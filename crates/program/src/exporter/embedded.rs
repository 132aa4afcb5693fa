//! The library within the program, unpacked to a file for the system's loader.

use std::fs;
use std::path::PathBuf;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::platform::Platform;
use crate::cache::{self, Entry};
use crate::scratch::Scratch;

static EMBEDDED: OnceLock<&'static [u8]> = OnceLock::new();
/// Folder into which it was unpacked without a cache.
static UNPACKED: Mutex<Option<Scratch>> = Mutex::new(None);

/// Sets the library within the program.
pub fn hold(library: &'static [u8]) {
    let _ = EMBEDDED.set(library);
}

/// Its file: in the user's cache folder, else in a temporary one. None if the program contains no library, or if no
/// file can be written.
pub(super) fn file() -> Option<PathBuf> {
    let bytes = *EMBEDDED.get()?;
    let checksum = cache::digest(bytes);
    if let Some(cached) = Entry::of(cache::LIBRARY, &[&checksum]).filter(|cached| cached.holds(bytes)) {
        cache::known_or(cached.file(), bytes.len(), || checksum);
        return Some(cached.file().to_owned());
    }
    let mut unpacked = UNPACKED.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = match &mut *unpacked {
        Some(folder) => folder,
        none => none.insert(Scratch::new().ok()?),
    };
    let file = folder.path().join(Platform::own().library_name());
    if !file.is_file() {
        fs::write(&file, bytes).ok()?;
    }
    Some(file)
}

/// Removes the temporary folder. Nothing may be exported or run after that.
pub fn tidy() {
    drop(UNPACKED.lock().unwrap_or_else(PoisonError::into_inner).take());
}
