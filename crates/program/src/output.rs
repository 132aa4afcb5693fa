//! Files of commands are written next to their places, synced, then renamed. So an earlier file stays whole until
//! another whole one replaces it, and files that belong together are replaced when all of them are written.
//!
//! No link is followed. A link in the place of a file, or of a folder below the one that the user named, is an error
//! that names it.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use crate::begun;
use crate::error::Error;

/// Suffix of files that aren't whole yet.
const PART: &str = ".part";
/// Number of random characters before it.
const RANDOM: usize = 6;

/// Files that belong together, written but not yet in their places. Dropped, they leave nothing.
#[derive(Debug)]
pub struct Files {
    folder: PathBuf,
    written: Vec<Written>,
}

/// A file that is being written piece by piece. Dropped, it leaves nothing.
#[derive(Debug)]
pub struct Part {
    writer: BufWriter<NamedTempFile>,
    file: PathBuf,
    replaces: bool,
}

impl Part {
    /// Its final path, for messages.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// All of it, on the disk.
    fn written(self) -> io::Result<Written> {
        let Part { writer, file, replaces } = self;
        let part = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
        part.as_file().sync_all()?;
        Ok(Written { part, file, replaces })
    }
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

#[derive(Debug)]
struct Written {
    part: NamedTempFile,
    file: PathBuf,
    /// True if a file of that name may be replaced.
    replaces: bool,
}

impl Files {
    /// Files for an existing folder.
    pub fn at(folder: &Path) -> Self {
        Files { folder: begun::path(named(folder)), written: Vec::new() }
    }

    /// Files for a folder, which is created if necessary: the one that the user named, and one below it.
    ///
    /// # Errors
    /// When it can't be made, or its place is taken by a link or a file.
    pub fn within(out: &Path, below: &str) -> Result<Self, Error> {
        Ok(Files::at(&make_folder(out, below)?))
    }

    /// Adds a file, which may lie in folders below.
    ///
    /// # Errors
    /// When it can't be written, or its place is taken by something other than a plain file.
    pub fn add(&mut self, name: impl AsRef<Path>, bytes: impl AsRef<[u8]>) -> Result<(), Error> {
        self.put(name.as_ref(), bytes.as_ref(), true)
    }

    /// Adds a file that must not exist yet.
    ///
    /// # Errors
    /// When it can't be written, or the name is taken.
    pub fn add_new(&mut self, name: impl AsRef<Path>, bytes: impl AsRef<[u8]>) -> Result<(), Error> {
        self.put(name.as_ref(), bytes.as_ref(), false)
    }

    /// Begins a file that is written piece by piece, and [added](Files::finish) when it is whole.
    ///
    /// # Errors
    /// When it can't be made, or its place is taken by something other than a plain file.
    pub fn begin(&self, name: impl AsRef<Path>) -> Result<Part, Error> {
        self.part(name.as_ref(), true)
    }

    /// Adds a file that [`Files::begin`] returned.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(&mut self, part: Part) -> Result<(), Error> {
        let file = part.file.clone();
        self.written.push(part.written().map_err(Error::file(file))?);
        Ok(())
    }

    fn put(&mut self, path: &Path, bytes: &[u8], replaces: bool) -> Result<(), Error> {
        let mut part = self.part(path, replaces)?;
        part.write_all(bytes).map_err(Error::file(&part.file))?;
        self.finish(part)
    }

    fn part(&self, path: &Path, replaces: bool) -> Result<Part, Error> {
        let (below, name) = (path.parent().unwrap_or(Path::new("")), file_name(path)?);
        let folder = folder(&self.folder, below, true)?;
        let file = folder.join(name);
        if !replaces && fs::symlink_metadata(&file).is_ok() {
            return Err(Error::file(&file)(ErrorKind::AlreadyExists.into()));
        }
        require_plain(&file)?;
        let writer = BufWriter::new(temporary_next_to(&folder, name).map_err(Error::file(&file))?);
        Ok(Part { writer, file, replaces })
    }

    /// Puts all of them into their places.
    ///
    /// # Errors
    /// When a place is taken by something other than a plain file: then no file is placed. Or when one can't be
    /// renamed.
    pub fn place(self) -> Result<(), Error> {
        self.written.iter().try_for_each(|written| require_plain(&written.file))?;
        for Written { part, file, replaces } in self.written {
            let placed = if replaces { part.persist(&file) } else { part.persist_noclobber(&file) };
            placed.map_err(|error| Error::file(&file)(error.error))?;
        }
        Ok(())
    }
}

/// The parent of a plain name is empty.
fn named(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Writes one file.
///
/// # Errors
/// When it can't be written, or its place is taken by something other than a plain file; then that stays as it was.
pub fn write(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Error> {
    let mut files = Files::at(file.parent().unwrap_or(Path::new("")));
    files.add(file_name(file)?, bytes)?;
    files.place()
}

/// Creates a folder if necessary: the one that the user named, and one below it. Removes files that a killed run left
/// in the former, or in any folder directly below.
///
/// # Errors
/// When it can't be made, or its place is taken by a link or a file.
pub fn make_folder(out: &Path, below: &str) -> Result<PathBuf, Error> {
    static TIDIED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    begun::restore_mask();
    let out = named(out);
    let place = begun::path(out);
    fs::create_dir_all(&place).map_err(Error::file(out))?;
    if TIDIED.lock().unwrap_or_else(PoisonError::into_inner).insert(place.clone()) {
        remove_left_over(&place);
        let inside = fs::read_dir(&place).into_iter().flatten().flatten();
        let folders = inside.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
        folders.for_each(|folder| remove_left_over(&folder.path()));
    }
    folder(out, Path::new(below), true)
}

/// Checks that files of these names could be put into a folder below the one that the user named, before a long
/// computation. Nothing is made.
///
/// # Errors
/// When the place of a file, or of the folder, is taken by something else.
pub fn check(out: &Path, below: &str, names: &[&str]) -> Result<(), Error> {
    if fs::metadata(begun::path(out)).is_ok_and(|found| !found.is_dir()) {
        return Err(refusal(out, "is not a folder. Name another one with --out"));
    }
    let folder = folder(out, Path::new(below), false)?;
    let place = begun::path(&folder);
    let there = place.ancestors().find(|ancestor| ancestor.is_dir()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(there).map_err(Error::file(&folder))?;
    names.iter().try_for_each(|name| require_plain(&folder.join(name)))
}

/// A folder below another, without any link on the way.
fn folder(out: &Path, below: &Path, make: bool) -> Result<PathBuf, Error> {
    if !below.components().all(|component| matches!(component, Component::Normal(_))) {
        return Err(refusal(&out.join(below), "would be outside the given folder"));
    }
    let mut path = out.to_owned();
    for component in below.components() {
        path.push(component);
        let place = begun::path(&path);
        match fs::symlink_metadata(&place) {
            Ok(found) if found.is_symlink() => return Err(a_link(&path)),
            Ok(found) if !found.is_dir() => return Err(refusal(&path, "is not a folder. Move it away")),
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::NotFound && make => match fs::create_dir(&place) {
                Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(Error::file(&path)(error)),
                _ => {}
            },
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(Error::file(&path)(error)),
        }
    }
    Ok(path)
}

/// Checks that there is nothing, or a file that may be replaced.
fn require_plain(file: &Path) -> Result<(), Error> {
    match fs::symlink_metadata(begun::path(file)) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(Error::file(file)(error)),
        Ok(found) if found.is_symlink() => Err(a_link(file)),
        Ok(found) if found.is_dir() => Err(refusal(file, "is a folder. Move it away")),
        Ok(found) if !found.is_file() => Err(refusal(file, "is not a regular file. Name another one")),
        Ok(found) if found.permissions().readonly() => Err(refusal(file, "is write-protected")),
        Ok(_) => Ok(()),
    }
}

fn a_link(path: &Path) -> Error {
    refusal(path, "is a link, and nothing is written through links. Move it away")
}

fn refusal(path: &Path, reason: &str) -> Error {
    Error::file(path)(io::Error::new(ErrorKind::InvalidInput, reason.to_owned()))
}

fn file_name(file: &Path) -> Result<&OsStr, Error> {
    file.file_name().ok_or_else(|| refusal(file, "must be the name of a file"))
}

/// An empty file next to the place of another, with its permissions.
fn temporary_next_to(folder: &Path, name: &OsStr) -> io::Result<NamedTempFile> {
    let prefix = [OsStr::new("."), name, OsStr::new(".")].into_iter().collect::<OsString>();
    remove_left_over(folder);
    // Permissions of a private file stay.
    let before = fs::metadata(folder.join(name)).ok().map(|found| found.permissions());
    let part = loop {
        let part = created(folder, &prefix)?;
        // The lock shows others that this file isn't left over from a process that was killed.
        let locked = part.as_file().try_lock();
        // Another process may have removed it before it was locked.
        if !matches!(locked, Err(TryLockError::WouldBlock)) && fs::symlink_metadata(part.path()).is_ok() {
            break part;
        }
    };
    if let Some(before) = before {
        part.as_file().set_permissions(before)?;
    }
    Ok(part)
}

fn created(folder: &Path, prefix: &OsStr) -> io::Result<NamedTempFile> {
    begun::restore_mask();
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(PART).rand_bytes(RANDOM);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Like any new file, it gets the permissions of the user's mask.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// True if this is the name of an unfinished file: `.NAME.RANDOM.part`.
fn is_part(name: &[u8]) -> bool {
    let (Some(b'.'), Some(rest)) = (name.first(), name.strip_suffix(PART.as_bytes())) else { return false };
    let random = rest.rsplit(|byte| *byte == b'.').next().unwrap_or_default();
    random.len() == RANDOM && random.iter().all(u8::is_ascii_alphanumeric) && rest.len() > RANDOM + 2
}

/// Removes unfinished files of killed processes from a folder. Files that can't be removed are harmless.
fn remove_left_over(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if is_part(entry.file_name().as_encoded_bytes()) && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let unused = File::open(entry.path()).is_ok_and(|file| {
                // It is removed under the lock, so that nobody else begins to use it.
                file.try_lock().is_ok() && fs::remove_file(entry.path()).is_ok()
            });
            let _ = unused;
        }
    }
}
