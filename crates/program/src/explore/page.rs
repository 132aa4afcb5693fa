//! The page and its files, which are the same with a server and with this package's library in the page.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::base64;
use crate::drawing::escaped;
use crate::error::Error;
use crate::exporter::check_browser_library;
use crate::figures::{DIAGRAMS, SCRIPT, STYLE};
use crate::output;

const PAGE: &str = include_str!("explore.html");
const LOOKS: &str = include_str!("explore.css");
const SCRIPT_KIND: &str = "text/javascript; charset=utf-8";

/// Backend of a page: its scripts, names and texts, in their order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Backend(&'static [(&'static str, &'static str)]);

impl Backend {
    /// The server of the page.
    pub const SERVER: Backend = Backend(&[("server.js", include_str!("server.js"))]);
    /// This package's library within the page, in [`PROGRAM`].
    const LIBRARY: Backend = Backend(&[LIBRARY_SCRIPT, ("browser.js", include_str!("browser.js"))]);
}

/// The file with the library for a page without a server, by far the largest.
pub const PROGRAM: &str = "program.js";

/// The script that runs it.
pub const LIBRARY_SCRIPT: (&str, &str) = ("library.js", include_str!("library.js"));

/// The scripts of any page, in their order, without those of its backend.
const SCRIPTS: [(&str, &str); 4] = [
    ("diagrams.js", SCRIPT),
    ("controls.js", include_str!("controls.js")),
    ("steps.js", include_str!("steps.js")),
    ("explore.js", include_str!("explore.js")),
];

/// A file of the page by its name: its type and its text.
pub(super) fn file(name: &str, backend: Backend) -> Option<(&'static str, String)> {
    if name == "explore.css" {
        return Some(("text/css; charset=utf-8", format!("{STYLE}{DIAGRAMS}{LOOKS}")));
    }
    let mut scripts = SCRIPTS.iter().chain(backend.0);
    scripts.find(|(known, _)| *known == name).map(|(_, text)| (SCRIPT_KIND, (*text).to_owned()))
}

/// The page of a loop; `query` follows the names of its files.
pub(super) fn html(name: &str, backend: Backend, query: &str) -> String {
    let script = |name: &str| format!("<script src=\"{name}{query}\"></script>\n");
    // What answers comes before what asks.
    let scripts: String = backend.0.iter().chain(&SCRIPTS).map(|(name, _)| script(name)).collect();
    PAGE.replace("{query}", query).replace("{scripts}", &scripts).replace("{name}", &escaped(name))
}

/// Writes the page of one of this package's loops into a folder, and returns its file. It needs no server, as it has
/// the library, compiled to WebAssembly, which all pages of a folder share.
///
/// # Errors
/// When the library isn't WebAssembly, or a file can't be written.
pub fn write_page(name: &str, library: (&Path, &[u8]), out: &Path) -> Result<PathBuf, Error> {
    let program = program(library)?;
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    output::write(&out.join(PROGRAM), program)?;
    let others = SCRIPTS.iter().chain(Backend::LIBRARY.0).map(|(name, _)| *name).chain(["explore.css"]);
    for name in others {
        let (_, text) = self::file(name, Backend::LIBRARY).unwrap_or_default();
        output::write(&out.join(name), text)?;
    }
    let page = out.join(format!("{name}.html"));
    let scripts = format!("<script src=\"{PROGRAM}\"></script>\n<script src=\"browser.js\">");
    let text = html(name, Backend::LIBRARY, "").replace("<script src=\"browser.js\">", &scripts);
    output::write(&page, text)?;
    Ok(page)
}

/// The library of this package as a script, compressed, as text. A page may load it from a file as well as from a server.
///
/// # Errors
/// When the file isn't this library as WebAssembly.
pub fn program((file, bytes): (&Path, &[u8])) -> Result<String, Error> {
    check_browser_library(bytes).map_err(|reason| Error::Library(format!("{}: {reason}", file.display())))?;
    Ok(format!("'use strict';\nconst PROGRAM = '{}';\n", compressed(bytes).map_err(Error::file(file))?))
}

/// Bytes for a script: compressed (gzip), as base64.
///
/// # Errors
/// None, as they are in memory.
pub fn compressed(bytes: &[u8]) -> io::Result<String> {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    compressed.write_all(bytes)?;
    Ok(base64::padded(&compressed.finish()?))
}
