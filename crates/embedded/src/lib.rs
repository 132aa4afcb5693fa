//! The shared library that cargo builds together with a program, as bytes within that program.
//!
//! A package whose library is an `rlib` and a `cdylib` gets both from one call of the compiler, before its program is
//! compiled. The program gets the `rlib`; the shared library is in the same folder.
#![deny(missing_docs)]

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro::TokenStream;

/// `library!(name)`: `Some(bytes)` of the shared library of the dependency with this name, or `None` where there is none:
/// the program is only checked, or its target has no shared libraries.
#[proc_macro]
pub fn library(name: TokenStream) -> TokenStream {
    let name = name.to_string();
    let found = dependency(&name, env::args()).and_then(|file| next_to(&file, &name));
    // `include_bytes` also makes cargo rebuild the program when that file changes.
    let code = found.map_or("None".to_owned(), |file| format!("Some(include_bytes!({file:?}))"));
    code.parse().unwrap_or_default()
}

/// Finds the file of a dependency in the compiler's arguments: `--extern name=file`. None if it contains no code.
fn dependency(name: &str, arguments: impl Iterator<Item = String>) -> Option<PathBuf> {
    let arguments = arguments.flat_map(|argument| match argument.strip_prefix('@') {
        // Arguments that are too long for the system are in a file, one a line.
        Some(file) => fs::read_to_string(file).unwrap_or_default().lines().map(str::to_owned).collect(),
        None => vec![argument],
    });
    let files = arguments.filter_map(|argument| {
        let named = argument.strip_prefix("--extern=").unwrap_or(&argument).strip_prefix(name)?;
        Some(PathBuf::from(named.strip_prefix('=')?))
    });
    files.into_iter().find(|file| file.extension() == Some(OsStr::new("rlib")))
}

/// Finds the shared library next to the other form of a library.
fn next_to(rlib: &Path, name: &str) -> Option<PathBuf> {
    let hashed = rlib.file_stem()?.to_str()?.strip_prefix("lib")?.to_owned();
    // Of packages that are no workspace's own, cargo gives it the same suffix.
    let names = [name, &hashed];
    let files = names.iter().flat_map(|name| {
        [format!("lib{name}.so"), format!("lib{name}.dylib"), format!("{name}.dll")]
            .map(|file| rlib.with_file_name(file))
    });
    files.into_iter().find(|file| file.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(arguments: &[&str]) -> Option<PathBuf> {
        dependency("own", arguments.iter().map(|argument| (*argument).to_owned()))
    }

    #[test]
    fn the_dependency_is_found_as_cargo_names_it() {
        let rlib = Some(PathBuf::from("deps/libown-12.rlib"));
        assert_eq!(
            found(&["rustc", "--extern", "owner=deps/libowner.rlib", "--extern", "own=deps/libown-12.rlib"]),
            rlib
        );
        assert_eq!(found(&["--extern=own=deps/libown-12.rlib"]), rlib);
        assert_eq!(found(&["--extern", "own=deps/libown-12.rmeta"]), None, "a program that is only checked");
    }

    #[test]
    fn the_shared_library_is_next_to_it() {
        let folder = env::temp_dir().join(format!("embedded-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let rlib = folder.join("libown-12.rlib");
        assert_eq!(next_to(&rlib, "own"), None);
        for file in ["own-12.dll", "libown.so"] {
            fs::write(folder.join(file), "").unwrap();
            assert_eq!(next_to(&rlib, "own"), Some(folder.join(file)));
        }
        fs::remove_dir_all(&folder).unwrap();
    }
}
