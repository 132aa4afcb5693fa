//! Temporary folders. One is removed with its value; those of a run that was killed, by the next run.

#[cfg(unix)]
use std::fs;
use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;
use std::sync::Once;

use tempfile::TempDir;

use crate::error::Error;

/// The name of each begins with this.
const PREFIX: &str = "adaptive-fmu-";

/// A temporary folder of this process.
#[derive(Debug)]
pub struct Scratch {
    /// Tells others that the folder is in use, where the system has such locks of folders.
    _lock: Option<File>,
    folder: TempDir,
}

impl Scratch {
    /// A new one, which is empty.
    ///
    /// # Errors
    /// When none can be made.
    pub fn new() -> Result<Self, Error> {
        static TIDIED: Once = Once::new();
        TIDIED.call_once(|| remove_left_over(&std::env::temp_dir()));
        Self::made().map_err(Error::file("temporary folder"))
    }

    fn made() -> io::Result<Self> {
        loop {
            let folder = tempfile::Builder::new().prefix(PREFIX).tempdir()?;
            let lock = File::open(folder.path()).ok();
            let is_taken = |lock: &File| matches!(lock.try_lock(), Err(TryLockError::WouldBlock));
            // Another process may have taken it for one that was left before it was locked.
            if !lock.as_ref().is_some_and(is_taken) && folder.path().is_dir() {
                return Ok(Scratch { _lock: lock, folder });
            }
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes folders that nobody uses any more: those of this user that aren't locked.
#[cfg(unix)]
fn remove_left_over(place: &Path) {
    use std::os::unix::fs::MetadataExt;
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        let is_named = entry.file_name().as_encoded_bytes().starts_with(PREFIX.as_bytes());
        let is_own = || entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == crate::process::user());
        if is_named
            && is_own()
            && let Ok(folder) = File::open(entry.path())
            && folder.try_lock().is_ok()
        {
            // While it is locked nobody else begins to use it. What can't be removed disturbs nothing.
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(not(unix))]
fn remove_left_over(_: &Path) {}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_uses_is_removed_and_nothing_else() {
        let place = tempfile::tempdir().unwrap();
        let made = |name: &str| {
            let folder = place.path().join(name);
            fs::create_dir_all(folder.join("inside")).unwrap();
            folder
        };
        let [left, used, other] = ["adaptive-fmu-left", "adaptive-fmu-used", "another"].map(made);
        let lock = File::open(&used).unwrap();
        lock.lock().unwrap();
        remove_left_over(place.path());
        assert_eq!([left.exists(), used.exists(), other.exists()], [false, true, true]);
        drop(lock);
        remove_left_over(place.path());
        assert_eq!([used.exists(), other.exists()], [false, true]);
    }

    #[test]
    fn a_folder_is_gone_with_its_value() {
        let scratch = Scratch::new().unwrap();
        let folder = scratch.path().to_owned();
        assert!(folder.is_dir());
        remove_left_over(folder.parent().unwrap());
        assert!(folder.is_dir());
        drop(scratch);
        assert!(!folder.exists());
    }
}
