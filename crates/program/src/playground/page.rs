//! The files of the page.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::error::Error;
use crate::explore::{LIBRARY_SCRIPT, PROGRAM, compressed, program};
use crate::exporter::{Binary, Library, Platform};
use crate::figures::{DIAGRAMS, SCRIPT, STYLE};
use crate::output;

const PAGE: &str = include_str!("playground.html");
const LOOKS: &str = include_str!("playground.css");

/// Scripts of the page, in their order.
const SCRIPTS: [(&str, &str); 14] = [
    LIBRARY_SCRIPT,
    ("backend.js", include_str!("backend.js")),
    ("diagrams.js", SCRIPT),
    ("common.js", include_str!("common.js")),
    ("matrices.js", include_str!("matrices.js")),
    ("plant.js", include_str!("plant.js")),
    ("link.js", include_str!("link.js")),
    ("queue.js", include_str!("queue.js")),
    ("curves.js", include_str!("curves.js")),
    ("knobs.js", include_str!("knobs.js")),
    ("report.js", include_str!("report.js")),
    ("files.js", include_str!("files.js")),
    ("forms.js", include_str!("forms.js")),
    ("playground.js", include_str!("playground.js")),
];

/// Writes the page into a folder, and returns its file: `library` is this package's library as WebAssembly, with its
/// file, and FMUs of the page are for the platforms of `others`. Files that are no longer needed stay.
///
/// # Errors
/// When the library isn't WebAssembly of this program's sources, or a file can't be read or written.
pub fn write_playground(library: (&Path, &[u8]), others: &Library, out: &Path) -> Result<PathBuf, Error> {
    let program = program(library)?;
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    let write = |name: &str, text: String| output::write(&out.join(name), text);
    write(PROGRAM, program)?;
    let mut platforms = Vec::new();
    for Binary { platform, file, .. } in others.binaries() {
        let bytes = std::fs::read(file).map_err(Error::file(file))?;
        let text = compressed(&bytes).map_err(Error::file(file))?;
        let name = format!("library-{}.js", platform.folder);
        platforms.push(json!({
            "folder": platform.folder, "title": title(platform), "file": name, "bytes": text.len() / 4 * 3,
        }));
        write(&name, format!("'use strict';\nLIBRARIES['{}'] = '{text}';\n", platform.folder))?;
    }
    write("platforms.js", format!("'use strict';\nconst PLATFORMS = {};\n", json!(platforms)))?;
    for (name, text) in SCRIPTS {
        write(name, text.to_owned())?;
    }
    write("playground.css", format!("{STYLE}{DIAGRAMS}{LOOKS}"))?;
    let scripts = ["platforms.js"].into_iter().chain(SCRIPTS.iter().map(|(name, _)| *name));
    let scripts: String = scripts.map(|name| format!("<script src=\"{name}\"></script>\n")).collect();
    let page = out.join("index.html");
    write("index.html", PAGE.replace("{scripts}", &scripts).replace("{query}", ""))?;
    Ok(page)
}

/// A platform for people: `Linux, x86-64`.
fn title(platform: &Platform) -> String {
    let (processor, system) = platform.target();
    let system = match system {
        "linux" => "Linux",
        "windows" => "Windows",
        _ => "macOS",
    };
    let processor = match processor {
        "x86_64" => "x86-64",
        "i686" => "x86, 32 bit",
        _ => "ARM64",
    };
    format!("{system}, {processor}")
}
