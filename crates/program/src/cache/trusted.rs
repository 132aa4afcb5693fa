//! Checks that only the user can write to a folder: the files in the cache are executed with the user's rights.

use std::fs::{self, DirBuilder, File, Metadata, OpenOptions, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use super::NAME;
use crate::process::user;

/// Permission to write for the group or others.
const SHARED: u32 = 0o022;
/// Permission that keeps users from renaming or removing files of others.
const STICKY: u32 = 0o1000;
/// The mode of the folder itself.
const PRIVATE: u32 = 0o700;

/// Creates the folder if necessary, and returns true if it can be used. A folder of the user that others may write to
/// is closed to them if it has only files of the cache.
///
/// # Errors
/// Why the folder isn't to be trusted.
pub fn folder(path: &Path) -> Result<bool, String> {
    let Ok(path) = std::path::absolute(path) else { return Ok(false) };
    // Nothing is created where others may write.
    if let Some(parent) = path.parent() {
        check_way(parent)?;
    }
    let Ok(()) = DirBuilder::new().recursive(true).mode(PRIVATE).create(&path) else { return Ok(false) };
    check_way(path.parent().unwrap_or(&path))?;
    let Ok(found) = fs::symlink_metadata(&path) else { return Ok(false) };
    if found.is_symlink() {
        return Err(format!("{} is a link", path.display()));
    }
    if found.uid() != user() {
        return Err(foreign(&path, &found));
    }
    if found.mode() & SHARED == 0 {
        return Ok(true);
    }
    let is_cache_alone = found.mode() & STICKY == 0 && holds_nothing_else(&path).unwrap_or(false);
    let is_closed = is_cache_alone && fs::set_permissions(&path, Permissions::from_mode(PRIVATE)).is_ok();
    if is_closed { Ok(true) } else { Err(open_to_others(&path)) }
}

/// True if all names in a folder are those of the cache.
fn holds_nothing_else(folder: &Path) -> io::Result<bool> {
    let is_of_cache = |name: &[u8]| {
        name.starts_with(b".tmp") || name.get(..NAME).is_some_and(|name| name.iter().all(u8::is_ascii_hexdigit))
    };
    for entry in fs::read_dir(folder)? {
        if !is_of_cache(entry?.file_name().as_encoded_bytes()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Checks all existing folders on the way to one: they belong to the user or the system, and nobody else can put
/// another folder in their place.
fn check_way(path: &Path) -> Result<(), String> {
    let root = fs::symlink_metadata("/").map_or(0, |root| root.uid());
    let way = path.ancestors().collect::<Vec<_>>();
    for part in way.into_iter().rev() {
        let Ok(found) = fs::symlink_metadata(part) else { return Ok(()) };
        if found.uid() != user() && found.uid() != root {
            return Err(foreign(part, &found));
        }
        if found.is_symlink() {
            // Examples are /tmp of macOS, or a folder that an administrator moved.
            let is_of_system = found.uid() == root && (root != user() || part.parent() == Some(Path::new("/")));
            if !is_of_system {
                return Err(format!("{} is a link", part.display()));
            }
            fs::canonicalize(part).map_or(Ok(()), |there| check_way(&there))?;
        } else if found.mode() & SHARED != 0 && found.mode() & STICKY == 0 {
            return Err(open_to_others(part));
        }
    }
    Ok(())
}

fn foreign(path: &Path, found: &Metadata) -> String {
    format!("{} belongs to another user ({})", path.display(), found.uid())
}

fn open_to_others(path: &Path) -> String {
    format!("others may write to {} (mode {:o})", path.display(), fs::metadata(path).map_or(0, |it| it.mode() & 0o7777))
}

/// Opens a file of the cache.
///
/// # Errors
/// When it doesn't exist, or isn't a file of the user that nobody else may write to.
pub fn open(file: &Path) -> io::Result<File> {
    // A pipe would be waited for.
    let opened = OpenOptions::new().read(true).custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK).open(file)?;
    let found = opened.metadata()?;
    let is_own = found.is_file() && found.uid() == user() && found.mode() & SHARED == 0;
    if is_own { Ok(opened) } else { Err(ErrorKind::PermissionDenied.into()) }
}
