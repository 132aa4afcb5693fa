//! Control laws as C for targets.

use std::path::{Path, PathBuf};

use super::Source;
use super::library::Library;
use crate::error::Error;
use crate::fmi2::firmware::{Firmware, Options};
use crate::output::Files;

/// Build file that builds and tests all controllers of a folder.
const BUILD: &str = include_str!("firmware.cmake");
const BUILD_FILE: &str = "CMakeLists.txt";

/// The controller of a description as C for a target: names and texts of files, and the number of Runge-Kutta steps per
/// period.
///
/// # Errors
/// For a description or options that are refused.
pub fn firmware(source: &Source, library: &Library, options: &Options) -> Result<(Vec<(String, String)>, u32), Error> {
    let Firmware { mut files, substeps } = library.firmware(source, options)?;
    files.push((BUILD_FILE.to_owned(), BUILD.to_owned()));
    Ok((files, substeps))
}

/// Writes the controller of a description into a folder as C for a target: `NAME.h`, `NAME.c`, `NAME_replay.c` with
/// test vectors, `NAME_data_sheet.md`, and a CMakeLists.txt if there is none. Returns their paths, and the number of
/// Runge-Kutta steps per period.
///
/// # Errors
/// For a description or options that are refused, or files that can't be written. No partial files are left.
pub fn export_firmware(
    source: &Source,
    library: &Library,
    options: &Options,
    out: &Path,
) -> Result<(Vec<PathBuf>, u32), Error> {
    let (mut files, substeps) = firmware(source, library, options)?;
    files.retain(|(name, _)| name != BUILD_FILE || !out.join(name).exists());
    let mut written = Files::within(out, "")?;
    for (name, text) in &files {
        written.add(name, text)?;
    }
    written.place()?;
    Ok((files.into_iter().map(|(name, _)| out.join(name)).collect(), substeps))
}
