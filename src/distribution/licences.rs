//! The licences of what the program and its libraries are linked of.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde::Deserialize;

use crate::error::Error;

/// How the names of files begin that hold a licence.
const BEGINNINGS: [&str; 6] = ["license", "licence", "copying", "copyright", "notice", "unlicense"];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    /// The packages of this workspace, by their ids: they are under its own licence.
    workspace_members: BTreeSet<String>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Package {
    id: String,
    name: String,
    version: String,
    license: Option<String>,
    repository: Option<String>,
    authors: Vec<String>,
    manifest_path: String,
}

#[derive(Deserialize)]
struct Resolve {
    root: String,
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    pkg: String,
    dep_kinds: Vec<Kind>,
}

#[derive(Deserialize)]
struct Kind {
    kind: Option<String>,
}

/// A table of the packages, and the texts of their licences, by their paths in an archive.
///
/// # Errors
/// When cargo doesn't tell the packages.
pub fn of_dependencies(source: &Path, target: &str) -> Result<Vec<(String, String)>, Error> {
    let Metadata { packages, workspace_members, resolve } = metadata(source, target)?;
    let linked = linked(&resolve);
    let packages: BTreeMap<_, _> = packages
        .iter()
        .filter(|package| linked.contains(package.id.as_str()) && !workspace_members.contains(&package.id))
        .map(|package| ((&package.name, &package.version), package))
        .collect();
    let mut table =
        "The packages that the program and its libraries are linked of, beside Rust's standard library (MIT or \
                     Apache-2.0).\n\n"
            .to_owned();
    let mut texts = Vec::new();
    for Package { name, version, license, repository, authors, manifest_path, .. } in packages.into_values() {
        let before = texts.len();
        for (file, text) in texts_of(Path::new(manifest_path)) {
            texts.push((format!("licences/{name}-{version}/{file}"), text));
        }
        let (licence, at) = (license.as_deref().unwrap_or("see its text"), repository.as_deref().unwrap_or(""));
        let by = match texts.len() > before {
            true => String::new(),
            false => format!(" (its package holds no text; by {})", authors.join(", ")),
        };
        table.push_str(&format!("{name} {version}: {licence}{by} {at}\n"));
    }
    texts.push(("licences/PACKAGES.txt".to_owned(), table));
    Ok(texts)
}

fn metadata(source: &Path, target: &str) -> Result<Metadata, Error> {
    let refuse = |reason: String| Error::Source { file: source.join("Cargo.toml"), reason };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = ["metadata", "--format-version", "1", "--locked", "--filter-platform", target];
    let output = Command::new(cargo).args(arguments).current_dir(source).output();
    let output = output.map_err(|error| refuse(format!("cargo can't be run, which tells the licences: {error}")))?;
    if !output.status.success() {
        return Err(refuse(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| refuse(format!("cargo metadata: {error}")))
}

/// What is linked: dependencies of dependencies, but none of tests and build scripts alone.
fn linked(resolve: &Resolve) -> BTreeSet<&str> {
    let nodes: BTreeMap<_, _> = resolve.nodes.iter().map(|node| (node.id.as_str(), node)).collect();
    let (mut found, mut open) = (BTreeSet::new(), vec![resolve.root.as_str()]);
    while let Some(id) = open.pop() {
        if found.insert(id) {
            let needed = nodes.get(id).into_iter().flat_map(|node| &node.deps);
            let linked = needed.filter(|needed| needed.dep_kinds.iter().any(|kind| kind.kind.is_none()));
            open.extend(linked.map(|needed| needed.pkg.as_str()));
        }
    }
    found
}

fn texts_of(manifest: &Path) -> BTreeMap<String, String> {
    let entries = manifest.parent().and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten();
    let licences = entries.filter_map(|entry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        let lower = name.to_lowercase();
        let is_licence = BEGINNINGS.iter().any(|beginning| lower.starts_with(beginning));
        Some((name, is_licence.then(|| std::fs::read_to_string(entry.path()).ok())??))
    });
    licences.collect()
}
