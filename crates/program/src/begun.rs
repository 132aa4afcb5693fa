//! The working folder and the file mode mask of the process when a command began. An FMU that runs within the process
//! may change both; paths that the user gave still refer to the former.

use std::env;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static FOLDER: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Notes both: a command begins.
pub fn note() {
    *FOLDER.lock().unwrap_or_else(PoisonError::into_inner) = env::current_dir().ok();
    #[cfg(unix)]
    mask::note();
}

/// A path relative to the folder in which the command began.
pub fn path(path: &Path) -> PathBuf {
    let folder = FOLDER.lock().unwrap_or_else(PoisonError::into_inner);
    match &*folder {
        Some(folder) if path.is_relative() => folder.join(path),
        _ => path.to_owned(),
    }
}

/// Puts both back.
pub(crate) fn restore() {
    if let Some(folder) = &*FOLDER.lock().unwrap_or_else(PoisonError::into_inner) {
        // If the folder is gone, nothing can be read from it.
        let _ = env::set_current_dir(folder);
    }
    restore_mask();
}

/// Restores the mask, before something is created.
pub(crate) fn restore_mask() {
    #[cfg(unix)]
    mask::restore();
}

#[cfg(unix)]
#[allow(unsafe_code)]
mod mask {
    use std::sync::OnceLock;

    static MASK: OnceLock<libc::mode_t> = OnceLock::new();

    /// This runs once, before any FMU is loaded: the mask can only be read by changing it.
    pub fn note() {
        MASK.get_or_init(|| {
            let mask = set(0o077);
            set(mask);
            mask
        });
    }

    pub fn restore() {
        if let Some(&mask) = MASK.get() {
            set(mask);
        }
    }

    /// Sets it; what it was.
    fn set(mask: libc::mode_t) -> libc::mode_t {
        // SAFETY: it takes a number and returns one.
        unsafe { libc::umask(mask) }
    }
}
