//! FMUs in Python, whose libraries expect the host to have Python loaded.

use std::path::PathBuf;
use std::process::Command;

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW};

use crate::exporter::with_causes;

/// Asks an interpreter for its shared library.
const QUESTION: &str = "import os, sysconfig
value = sysconfig.get_config_var
print(os.path.join(value('LIBDIR') or '', value('INSTSONAME') or value('LDLIBRARY') or ''))";

/// True if a library couldn't be loaded because Python's functions weren't there.
pub(super) fn is_missing(reason: &str) -> bool {
    reason.contains("undefined symbol: Py") || reason.contains("undefined symbol: _Py")
}

/// Loads the shared library of `python3` for all libraries that are loaded later. Returns advice if that fails.
pub(super) fn load() -> Result<(), String> {
    let library = find()?;
    // SAFETY: the user asked to run an FMU that needs Python; its initializers run as in any host of Python.
    let loaded = unsafe { Library::open(Some(&library), RTLD_NOW | RTLD_GLOBAL) };
    let loaded = loaded.map_err(|error| needs(&with_causes(&error)))?;
    // Python can't be unloaded, since the FMU's library may use it until this process ends.
    std::mem::forget(loaded);
    Ok(())
}

fn find() -> Result<PathBuf, String> {
    let answer = Command::new("python3").args(["-c", QUESTION]).output();
    let answer = answer.map_err(|error| needs(&format!("python3 can't be started: {error}")))?;
    let path = PathBuf::from(String::from_utf8_lossy(&answer.stdout).trim());
    let is_shared = path.file_name().is_some_and(|name| {
        name.to_string_lossy().contains(".so") || path.extension().is_some_and(|end| end == "dylib")
    });
    if !is_shared || !path.is_file() {
        return Err(needs(&format!("python3 has no shared library at {}", path.display())));
    }
    Ok(path)
}

fn needs(reason: &str) -> String {
    format!(
        "is an FMU written in Python. It needs the shared library of the python3 on the PATH: {reason}. On Debian, \
         install it with `apt install libpython3-dev`; build your own Python with --enable-shared"
    )
}
