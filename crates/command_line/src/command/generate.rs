//! `generate`: the files of this project's own folder that follow from others.

use std::fs;
use std::path::Path;

use adaptive_fmu::error::Error;
use adaptive_fmu::{generated, output};

/// Writes those that aren't current into the current folder, and prints their names.
pub fn execute() -> Result<(), Error> {
    let read = |page: &str| fs::read_to_string(page).map_err(Error::file(Path::new(page)));
    for (file, text) in generated::files(read)? {
        if fs::read_to_string(&file).unwrap_or_default() != text {
            output::write(Path::new(&file), text)?;
            print_line!("{file}");
        }
    }
    Ok(())
}
