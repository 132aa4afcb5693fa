//! An archive for users without Rust: the program, its libraries for every platform that was built, descriptions,
//! loops, documentation and licences.

mod wheel;

pub use wheel::write as write_wheel;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::exporter::{
    self, BROWSER, BROWSER_FILE, Binary, LIBRARIES, Library, browser_library, check_browser_library,
};
use crate::texts::START;

const VERSION: &str = env!("CARGO_PKG_VERSION");
const SUMS: &str = "SHA256SUMS";
/// Files that the README links to, in addition to `docs`.
const TEXTS: [&str; 8] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CITATION.cff",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "LICENSE-APACHE",
    "LICENSE-MIT",
];
/// Files that build a site of `docs`. They are left out, as the archive lacks the rest of the site.
const SITE: [&str; 2] = ["docs/requirements.txt", "docs/serve"];
/// The licences of all crates in the program and its libraries, on all platforms.
const LICENCES: &str = "packaging/LICENCES.txt";

/// Files of an archive: paths there, and bytes.
type Files = BTreeMap<String, Vec<u8>>;

/// Writes an archive for a platform into a folder, and returns its path. `shell` has manual pages and completions by
/// their places below `share`.
///
/// # Errors
/// When the source folder with the documentation and cargo's list of licences doesn't exist, or files can't be read or
/// written.
pub fn write(
    program: &Binary,
    library: &Library,
    source: &Path,
    shell: &[(String, Vec<u8>)],
    out: &Path,
) -> Result<PathBuf, Error> {
    let name = format!("adaptive-fmu-{VERSION}-{}", program.platform.folder);
    let mut files = material(source)?;
    files.insert("START.txt".to_owned(), START.into());
    files.extend(shell.iter().map(|(path, text)| (format!("share/{path}"), text.clone())));
    let mut programs = Files::from([(program.platform.program_name().to_owned(), read(&program.file)?)]);
    programs.extend(browser()?.map(|(path, bytes)| (format!("{LIBRARIES}/{path}"), bytes)));
    for Binary { platform, file, .. } in library.binaries() {
        programs.insert(format!("{LIBRARIES}/{}/{}", platform.folder, platform.library_name()), read(file)?);
    }
    files.insert(SUMS.to_owned(), sums(files.iter().chain(&programs)).into_bytes());
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    let file = out.join(format!("{name}.zip"));
    let [files, programs] = [files, programs]
        .map(|files| files.into_iter().map(|(path, bytes)| (format!("{name}/{path}"), bytes)).collect::<Vec<_>>());
    exporter::write_program(&file, &entries(&files), &entries(&programs))?;
    Ok(file)
}

/// Files of a program: texts, licences, descriptions and loops.
fn material(source: &Path) -> Result<Files, Error> {
    let mut files = texts(source)?;
    let licences = read(&source.join(LICENCES))?;
    files.insert("licences/PACKAGES.txt".to_owned(), licences);
    for (name, text) in exporter::descriptions() {
        files.insert(format!("modelDescription/{name}.toml"), (*text).into());
    }
    for (name, texts) in exporter::loops() {
        files.extend(texts.iter().map(|(file, text)| (format!("examples/{name}/{file}"), (*text).into())));
    }
    Ok(files)
}

/// The library for the page in a browser, if it was built of the same sources: its place among the libraries, and its
/// bytes.
fn browser() -> Result<Option<(String, Vec<u8>)>, Error> {
    let Some(file) = browser_library() else { return Ok(None) };
    let bytes = read(&file)?;
    Ok(check_browser_library(&bytes).is_ok().then(|| (format!("{BROWSER}/{BROWSER_FILE}"), bytes)))
}

fn entries(files: &[(String, Vec<u8>)]) -> Vec<(&str, &[u8])> {
    files.iter().map(|(path, bytes)| (path.as_str(), bytes.as_slice())).collect()
}

fn read(file: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(file).map_err(Error::file(file))
}

/// Texts for readers, from the source folder.
fn texts(source: &Path) -> Result<Files, Error> {
    let manifest = source.join("Cargo.toml");
    let own = std::fs::read_to_string(&manifest).is_ok_and(|text| text.contains("name = \"adaptive-fmu-models\""));
    if !own {
        let reason =
            "is not the one of adaptive-fmu: run this in its source folder, which the documentation comes from";
        return Err(Error::Source { file: manifest, reason: reason.to_owned() });
    }
    let mut files = Files::new();
    let mut open: Vec<PathBuf> = TEXTS.iter().map(PathBuf::from).chain([PathBuf::from("docs")]).collect();
    while let Some(path) = open.pop() {
        let place = source.join(&path);
        if place.is_dir() {
            let entries = std::fs::read_dir(&place).map_err(Error::file(&place))?.flatten();
            open.extend(entries.map(|entry| path.join(entry.file_name())));
        } else if !SITE.iter().any(|file| path == Path::new(file)) {
            files.insert(path.to_string_lossy().replace('\\', "/"), read(&place)?);
        }
    }
    Ok(files)
}

/// Checksums in the format of `sha256sum --check`.
fn sums<'a>(files: impl Iterator<Item = (&'a String, &'a Vec<u8>)>) -> String {
    let line = |(path, bytes): (&String, &Vec<u8>)| {
        let digest: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{digest}  {path}\n")
    };
    files.map(line).collect()
}
