//! Wheels for pip: the Python package, the program, its libraries for every platform that was built, descriptions,
//! loops and documentation. The metadata of the package is that of `pyproject.toml` (Python's Core metadata 2.4).

use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::{Files, VERSION, browser, entries, material, read};
use crate::base64;
use crate::error::Error;
use crate::exporter::{self, Binary, Glibc, LIBRARIES, Library, Platform, SHARED};

const PROJECT: &str = "pyproject.toml";
const PACKAGE: &str = "python/adaptive_fmu";
/// The oldest macOS on which Rust's programs run, by processor.
const MACOS: [(&str, &str); 2] = [("x86_64", "macosx_10_12_x86_64"), ("aarch64", "macosx_11_0_arm64")];

#[derive(Deserialize)]
struct PyProject {
    project: Project,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Project {
    name: String,
    description: String,
    license: String,
    license_files: Vec<String>,
    requires_python: String,
    keywords: Vec<String>,
    classifiers: Vec<String>,
    dependencies: Vec<String>,
    optional_dependencies: toml::Table,
}

/// Writes the wheel of a platform into a folder, and returns its path. `shell` has manual pages and completions by
/// their places below `share`, which pip puts into the environment.
///
/// # Errors
/// When the source folder doesn't exist, pip has no name for the platform, or files can't be read or written.
pub fn write(
    program: &Binary,
    library: &Library,
    source: &Path,
    shell: &[(String, Vec<u8>)],
    out: &Path,
) -> Result<PathBuf, Error> {
    let mut files = Files::new();
    let project = project(source)?;
    let name = project.name.replace('-', "_");
    let (information, data) = (format!("{name}-{VERSION}.dist-info"), format!("{name}-{VERSION}.data"));
    for file in package_files(source)? {
        let inner = file.strip_prefix(source.join("python")).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        files.insert(inner, read(&file)?);
    }
    let shared = |path: &str| format!("{data}/data/{SHARED}/{path}");
    files.extend(material(source)?.into_iter().map(|(path, bytes)| (shared(&path), bytes)));
    files.extend(shell.iter().map(|(path, text)| (format!("{data}/data/share/{path}"), text.clone())));
    files.extend(browser()?.map(|(path, bytes)| (shared(&format!("{LIBRARIES}/{path}")), bytes)));
    for Binary { platform, file, .. } in library.binaries() {
        let path = format!("{LIBRARIES}/{}/{}", platform.folder, platform.library_name());
        files.insert(shared(&path), read(file)?);
    }
    for licence in &project.license_files {
        files.insert(format!("{information}/licenses/{licence}"), read(&source.join(licence))?);
    }
    let bytes = read(&program.file)?;
    let tag = format!("py3-none-{}", platform_tag(program, &bytes)?);
    let readme = String::from_utf8_lossy(&read(&source.join("README.md"))?).into_owned();
    files.insert(format!("{information}/METADATA"), metadata(&project, &readme).into_bytes());
    let wheel =
        format!("Wheel-Version: 1.0\nGenerator: {} {VERSION}\nRoot-Is-Purelib: false\nTag: {tag}\n", project.name);
    files.insert(format!("{information}/WHEEL"), wheel.into_bytes());
    let programs = Files::from([(format!("{data}/scripts/{}", program.platform.program_name()), bytes)]);
    let own = format!("{information}/RECORD");
    let record: String = files.iter().chain(&programs).map(|(path, bytes)| recorded(path, bytes)).collect();
    files.insert(own.clone(), format!("{record}{own},,\n").into_bytes());
    std::fs::create_dir_all(out).map_err(Error::file(out))?;
    let file = out.join(format!("{name}-{VERSION}-{tag}.whl"));
    let [files, programs] = [files, programs].map(|files| files.into_iter().collect::<Vec<_>>());
    exporter::write_program(&file, &entries(&files), &entries(&programs))?;
    Ok(file)
}

fn project(source: &Path) -> Result<Project, Error> {
    let file = source.join(PROJECT);
    let text = std::fs::read_to_string(&file).map_err(Error::file(&file))?;
    let read: PyProject =
        toml::from_str(&text).map_err(|error| Error::Source { file, reason: error.message().to_owned() })?;
    Ok(read.project)
}

/// The modules of the Python package, and the mark that it is typed.
fn package_files(source: &Path) -> Result<Vec<PathBuf>, Error> {
    let folder = source.join(PACKAGE);
    let entries = std::fs::read_dir(&folder).map_err(Error::file(&folder))?.flatten().map(|entry| entry.path());
    let belongs = |path: &PathBuf| path.extension().is_some_and(|e| e == "py") || path.ends_with("py.typed");
    Ok(entries.filter(belongs).collect())
}

/// pip's name of the platforms that a program runs on.
fn platform_tag(program: &Binary, bytes: &[u8]) -> Result<String, Error> {
    let (processor, system) = program.platform.target();
    let refuse = || {
        let known = Platform::all().map(|platform| platform.folder);
        Error::unknown("platform for pip", program.platform.folder, known, "")
    };
    Ok(match (system, processor) {
        ("linux", _) => match Glibc::asked_by(bytes) {
            Some(glibc) => {
                format!("manylinux_{}_{processor}", glibc.max(Glibc::PROMISED).to_string().replace('.', "_"))
            }
            None => format!("linux_{processor}"),
        },
        ("windows", "x86_64") => "win_amd64".to_owned(),
        ("windows", "i686") => "win32".to_owned(),
        ("windows", "aarch64") => "win_arm64".to_owned(),
        ("darwin", _) => {
            MACOS.iter().find(|(known, _)| *known == processor).map(|(_, tag)| (*tag).to_owned()).ok_or_else(refuse)?
        }
        _ => return Err(refuse()),
    })
}

fn metadata(project: &Project, readme: &str) -> String {
    let mut lines = vec![
        ("Metadata-Version", "2.4".to_owned()),
        ("Name", project.name.clone()),
        ("Version", VERSION.to_owned()),
        ("Summary", project.description.clone()),
        ("Keywords", project.keywords.join(",")),
        ("License-Expression", project.license.clone()),
        ("Requires-Python", project.requires_python.clone()),
    ];
    lines.extend(project.license_files.iter().map(|file| ("License-File", file.clone())));
    lines.extend(project.classifiers.iter().map(|classifier| ("Classifier", classifier.clone())));
    lines.extend(project.dependencies.iter().map(|needed| ("Requires-Dist", needed.clone())));
    for (extra, needed) in &project.optional_dependencies {
        lines.push(("Provides-Extra", extra.clone()));
        let needed = needed.as_array().into_iter().flatten().filter_map(toml::Value::as_str);
        lines.extend(needed.map(|needed| ("Requires-Dist", format!("{needed} ; extra == '{extra}'"))));
    }
    lines.push(("Description-Content-Type", "text/markdown".to_owned()));
    let head: String = lines.into_iter().map(|(key, value)| format!("{key}: {value}\n")).collect();
    format!("{head}\n{readme}")
}

/// A line of the wheel's record: path, checksum, size.
fn recorded(path: &str, bytes: &[u8]) -> String {
    format!("{path},sha256={},{}\n", base64::of_paths(&Sha256::digest(bytes)), bytes.len())
}
