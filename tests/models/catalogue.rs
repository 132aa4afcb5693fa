//! The catalogue of kinds: nothing else lists them, each has what belongs to it, and the tables of kinds and FMUs in the
//! documentation follow from it.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use adaptive_fmu::catalogue::{Entry, Trial};
use adaptive_fmu::generated;
use adaptive_fmu::library::{CATALOGUE, REGISTRY, find};
use adaptive_fmu::model::Model;
use adaptive_fmu::pages::{self, Guide};
use adaptive_fmu::system::Causality;
use common::described::model;
use common::{at_top, description, description_folder, description_names};

const FOLDERS: [&str; 5] = ["crates/framework/src", "crates/program/src", "crates/command_line/src", "src", "plants"];
/// Names of kinds that are words of their own, too.
const WORDS: [&str; 4] = ["reference", "excitation", "composite", "funnel"];

fn root() -> PathBuf {
    at_top("")
}

/// The Rust files of this package.
fn sources() -> Vec<(PathBuf, String)> {
    let mut open: Vec<PathBuf> = FOLDERS.iter().map(|folder| root().join(folder)).collect();
    let mut files = Vec::new();
    while let Some(path) = open.pop() {
        if path.is_dir() {
            open.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            files.push((path, text));
        }
    }
    files
}

/// The composite's kind, which no type of its own declares.
const COMPOSITE: &str = "name: \"composite\"";

/// The lines that name a kind, where it is one of a file: a line of `const NAME`, or of the composite's kind.
fn has_its_name(line: &str) -> bool {
    line.contains("const NAME: &'static str =") || line.contains(COMPOSITE)
}

#[test]
fn every_kind_that_has_a_file_is_listed_in_the_catalogue() {
    let quoted = |line: &str| line.split('"').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let lines: Vec<String> = sources().iter().flat_map(|(_, text)| text.lines()).map(str::to_owned).collect();
    // A doc comment shows a model that isn't of this package.
    let own = lines.iter().map(String::as_str).filter(|line| has_its_name(line) && !line.starts_with("//!"));
    // The composite's line has other texts, too.
    let names = own.map(|line| if line.contains(COMPOSITE) { COMPOSITE } else { line });
    let named: BTreeSet<String> = names.flat_map(quoted).collect();
    let listed: BTreeSet<String> = CATALOGUE.iter().map(|entry| entry.kind.name.to_owned()).collect();
    assert_eq!(named, listed, "kinds with a file, and kinds with a line in src/library.rs");
    let registered: Vec<_> = REGISTRY.iter().map(|kind| kind.name).collect();
    assert_eq!(registered, CATALOGUE.iter().map(|entry| entry.kind.name).collect::<Vec<_>>());
}

#[test]
fn nothing_but_its_own_file_names_a_kind() {
    for (file, text) in sources() {
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        // An icon has the name of its kind.
        let is_name = |line: &str| has_its_name(line) || line.contains("icon!(");
        let lines = code.lines().filter(|line| !is_name(line) && !line.trim_start().starts_with("//"));
        for line in lines {
            let kinds = CATALOGUE.iter().map(|entry| entry.kind.name).filter(|name| !WORDS.contains(name));
            let found: Vec<_> = kinds.filter(|name| line.contains(&format!("\"{name}\""))).collect();
            assert!(found.is_empty(), "{} names {found:?}: {line}", file.display());
        }
    }
}

#[test]
fn every_kind_has_a_title_a_page_and_a_guide() {
    let mut titles = BTreeSet::new();
    for entry in CATALOGUE {
        let name = entry.kind.name;
        assert!(!entry.title.is_empty() && titles.insert(entry.title), "{name}: `{}`", entry.title);
        let page = fs::read_to_string(root().join("docs").join(format!("{}.md", entry.page)));
        let page = page.unwrap_or_else(|error| panic!("{name}: {}: {error}", entry.page));
        let page = page.split_once("\n---\n").map_or(page.as_str(), |(_, text)| text);
        assert!(entry.kind.documentation.starts_with(page), "{name}: its documentation begins with {}", entry.page);
        let Guide { purpose, alone, limits, .. } = entry.guide;
        assert!(!purpose.is_empty() && limits.starts_with("- "), "{name}: what it is for, and what it can't do");
        assert!(alone.starts_with("With nothing connected "), "{name}: what it shows until it is connected");
        let Trial { alone, smooth, steady, moving } = entry.trial;
        for text in [alone, smooth, steady, moving] {
            text.parse::<toml::Table>().unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }
}

#[test]
fn no_two_kinds_share_an_icon() {
    let icons: Vec<_> = CATALOGUE.iter().map(Entry::icon).chain([pages::icon("")]).collect();
    let names: BTreeSet<_> = icons.iter().map(|icon| icon.name).collect();
    let pictures: BTreeSet<_> = icons.iter().map(|icon| icon.png).collect();
    let drawings: BTreeSet<_> = icons.iter().map(|icon| icon.svg).collect();
    assert_eq!([names.len(), pictures.len(), drawings.len()], [icons.len(); 3]);
    for icon in &icons {
        let begins = icon.png.starts_with(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x80\0\0\0\x80");
        assert!(begins && icon.png.len() <= 4096, "{}: a PNG of 128 × 128, of 4 kB at most", icon.name);
        assert!(icon.svg.contains("viewBox=\"0 0 128 128\""), "{}: the same size as SVG", icon.name);
    }
    let files = fs::read_dir(root().join("modelDescription/icons")).unwrap().map(|entry| entry.unwrap().path());
    let files: BTreeSet<String> = files.map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect();
    let wanted = names.iter().flat_map(|name| ["svg", "png"].map(|ending| format!("{name}.{ending}"))).collect();
    assert_eq!(files, wanted, "an SVG and a PNG for each icon, and no other file");
}

#[test]
fn the_gains_that_a_kind_names_are_parameters_of_its_units() {
    let mut named: BTreeSet<(&str, &str)> = BTreeSet::new();
    for (entry, model) in units() {
        let parameters = model.variables().iter().filter(|variable| variable.causality == Causality::Parameter);
        let parameters: BTreeSet<_> = parameters.map(|variable| variable.name.clone()).collect();
        let gains = entry.guide.gains.iter().map(|(name, _)| *name);
        let found: Vec<_> = gains.filter(|name| parameters.contains(*name)).collect();
        // What has no parameters of its own names those that every unit has.
        let least = if entry.kind.name == "unwrap" { 1 } else { 4 };
        assert!((least..=6).contains(&found.len()), "{}: {found:?}", model.description().name);
        named.extend(found.into_iter().map(|name| (entry.kind.name, name)));
    }
    for entry in CATALOGUE {
        for (name, _) in entry.guide.gains {
            assert!(named.contains(&(entry.kind.name, *name)), "{}: no unit has `{name}`", entry.kind.name);
        }
    }
}

#[test]
fn every_kind_has_a_description_among_the_units() {
    let models = units().map(|(_, model)| model.description().model.clone()).collect::<BTreeSet<_>>();
    for name in CATALOGUE.iter().map(|entry| entry.kind.name).filter(|name| *name != "composite") {
        assert!(models.contains(name), "{} has no unit of `{name}`", description_folder().display());
    }
}

/// All units of this package, each with the entry of its kind.
fn units() -> impl Iterator<Item = (&'static Entry, Model)> {
    let models = description_names().into_iter().map(|name| model(&description(&name)).unwrap());
    models.map(|model| (find(&model.description().model).unwrap(), model))
}

#[test]
fn files_that_follow_from_others_are_current() {
    let read = |page: &str| Ok(fs::read_to_string(root().join(page)).unwrap());
    let files = generated::files(read).unwrap();
    assert!(files.len() > description_names().len() + 4);
    for (file, text) in files {
        let current = fs::read_to_string(root().join(&file)).unwrap_or_default() == text;
        assert!(current, "{file} isn't what its sources give: run `adaptive-fmu generate`, and review the difference");
    }
}
