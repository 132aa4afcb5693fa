//! Temporary folders. Each is removed with its value; those of a killed run are removed by the next run.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Once;

use tempfile::TempDir;

use crate::begun;
use crate::error::Error;

/// Start of the name of each; random characters follow.
const PREFIX: &str = ".adaptive-fmu-run-";
const RANDOM: usize = 6;
/// A file in each that is locked while the folder is in use. It shows others so, and that this program made the folder.
const LOCK: &str = "adaptive-fmu.lock";
/// The folder next to that file that is handed out.
const FILES: &str = "files";

/// A temporary folder of this process, accessible to its user only.
#[derive(Debug)]
pub struct Scratch {
    path: PathBuf,
    _lock: File,
    /// Folder that is removed with this value.
    _folder: TempDir,
}

/// Builder of a folder that only its user can access.
fn private() -> fs::DirBuilder {
    #[allow(unused_mut)]
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder
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
        begun::restore_mask();
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).rand_bytes(RANDOM);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        loop {
            let folder = builder.tempdir()?;
            let file = folder.path().join(LOCK);
            let lock = File::create_new(&file)?;
            // Another process may have removed it before it was locked.
            if !matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) && file.is_file() {
                let path = folder.path().join(FILES);
                private().create(&path)?;
                return Ok(Scratch { path, _lock: lock, _folder: folder });
            }
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// True if a folder has such a name.
#[cfg(unix)]
fn is_named(name: &[u8]) -> bool {
    let random = name.strip_prefix(PREFIX.as_bytes());
    random.is_some_and(|random| random.len() == RANDOM && random.iter().all(u8::is_ascii_alphanumeric))
}

/// Removes unused folders of this program that belong to this user and aren't locked.
#[cfg(unix)]
fn remove_left_over(place: &Path) {
    use std::os::unix::fs::MetadataExt;
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        let is_own = || entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == crate::process::user());
        let lock = entry.path().join(LOCK);
        let is_marked = || fs::symlink_metadata(&lock).is_ok_and(|found| found.is_file());
        if is_named(entry.file_name().as_encoded_bytes())
            && is_own()
            && is_marked()
            && let Ok(lock) = File::open(&lock)
            && lock.try_lock().is_ok()
        {
            // While it is locked nobody else begins to use it. A folder that can't be removed is harmless.
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
            fs::create_dir_all(folder.join(FILES)).unwrap();
            File::create_new(folder.join(LOCK)).unwrap();
            folder
        };
        let left = made(".adaptive-fmu-run-aB3dEf");
        let used = made(".adaptive-fmu-run-used00");
        let unmarked = made(".adaptive-fmu-run-backup");
        fs::remove_file(unmarked.join(LOCK)).unwrap();
        let others = [".adaptive-fmu-run-longer0", "adaptive-fmu-0.1.0-linux64", "another"].map(made);
        let others_stay = || unmarked.exists() && others.iter().all(|other| other.exists());
        let lock = File::open(used.join(LOCK)).unwrap();
        lock.lock().unwrap();
        remove_left_over(place.path());
        assert_eq!([left.exists(), used.exists(), others_stay()], [false, true, true]);
        drop(lock);
        remove_left_over(place.path());
        assert_eq!([used.exists(), others_stay()], [false, true]);
    }

    #[test]
    fn a_folder_is_for_its_user_alone() {
        use std::os::unix::fs::MetadataExt;
        let scratch = Scratch::new().unwrap();
        assert_eq!(fs::read_dir(scratch.path()).unwrap().count(), 0);
        let outer = scratch.path().parent().unwrap();
        assert!(is_named(outer.file_name().unwrap().as_encoded_bytes()));
        assert_eq!(fs::metadata(outer).unwrap().mode() & 0o777, 0o700);
    }

    #[test]
    fn a_folder_is_gone_with_its_value() {
        let scratch = Scratch::new().unwrap();
        let folder = scratch.path().parent().unwrap().to_owned();
        assert!(folder.is_dir());
        remove_left_over(folder.parent().unwrap());
        assert!(folder.is_dir());
        drop(scratch);
        assert!(!folder.exists());
    }
}
