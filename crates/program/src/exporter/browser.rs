//! This package's library for browsers.

use std::path::PathBuf;

use super::library::library_folders;
use crate::fmi2::build::Build;
use crate::{SOURCE, library};

/// Folder of this package's library for browsers, next to those of platforms, and its name; cargo's profile for it has
/// the same name.
pub const BROWSER: &str = "browser";
/// See [`BROWSER`].
pub const BROWSER_FILE: &str = "adaptive_fmu.wasm";

/// This package's library for browsers, which comes with the program, or which `packaging/browser` built.
pub fn browser_library() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let folder = program.parent()?;
    let built = folder.parent().map(|target| target.join("wasm32-unknown-unknown"));
    let places = library_folders(folder).chain(built).map(|place| place.join(BROWSER).join(BROWSER_FILE));
    places.into_iter().find(|file| file.is_file())
}

/// Refuses any file but this library as WebAssembly, built of the same sources as this program.
///
/// # Errors
/// The reason, and how this library is built.
pub fn check_browser_library(bytes: &[u8]) -> Result<(), String> {
    const ADVICE: &str = "`packaging/browser` in the source folder builds it";
    if !bytes.starts_with(b"\0asm") {
        return Err(format!("is not a WebAssembly module; {ADVICE}"));
    }
    match Build::within(bytes) {
        None => Err(format!("is not the library of this package; {ADVICE}")),
        Some(build) if build.source != library::SOURCE || !holds(bytes, SOURCE.as_bytes()) => {
            Err(format!("was built from other sources than this program; {ADVICE}"))
        }
        Some(_) => Ok(()),
    }
}

/// True if bytes hold others.
fn holds(bytes: &[u8], text: &[u8]) -> bool {
    bytes.windows(text.len()).any(|place| place == text)
}
