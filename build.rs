//! What the crate holds beside its code.

use std::path::{Path, PathBuf};
use std::{env, fs};

use adaptive_fmu_sources::{self as sources, entries};

fn main() {
    embed();
    // All that the library is made of; in a package from a registry, the framework is one of its own. Of the documentation there
    // is what FMUs and archives hold.
    let code = ["framework", "library"].map(|name| Path::new("crates").join(name).join("src"));
    let texts =
        ["src", "plants", "Cargo.toml", "docs/controllers", "docs/plants", "docs/license.txt", "docs/start.txt"];
    let places = code.into_iter().filter(|folder| folder.is_dir()).chain(texts.map(PathBuf::from));
    sources::tell(&places.collect::<Vec<_>>());
}

/// The descriptions of FMUs and the closed loops, within the program: it needs no files beside it.
fn embed() {
    println!("cargo::rerun-if-changed=modelDescription");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").unwrap_or_default());
    let descriptions = texts(&root.join("modelDescription"), &["toml"], stem);
    let loops =
        entries(&root.join("examples")).into_iter().filter(|folder| folder.join("SystemStructure.ssd").is_file());
    let loops: Vec<_> = loops.collect();
    // Not the whole folder: what a notebook there leaves beside it must not build everything anew.
    loops.iter().for_each(|folder| println!("cargo::rerun-if-changed={}", folder.display()));
    let responses: String = loops.iter().filter_map(|folder| response(folder)).collect();
    let loops =
        loops.iter().map(|folder| format!("({:?}, &[\n{}]),\n", name(folder), texts(folder, &["ssd", "ssv"], name)));
    let league = root.join("examples/league");
    println!("cargo::rerun-if-changed={}", league.display());
    let code = format!(
        "static LEAGUE: Embedded = &[\n{}];\n\
         static DESCRIPTIONS: Embedded = &[\n{descriptions}];\nstatic LOOPS: &[(&str, Embedded)] = &[\n{}];\n\
         static RESPONSES: Embedded = &[\n{responses}];\n",
        texts(&league, &["toml"], name),
        loops.collect::<String>()
    );
    let file = Path::new(&env::var("OUT_DIR").unwrap_or_default()).join("embedded.rs");
    fs::write(file, code).expect("cargo's own folder can be written");
}

/// What a loop recorded, where that is kept, likewise.
fn response(folder: &Path) -> Option<String> {
    let file = folder.join("response.txt");
    file.is_file().then(|| format!("({:?}, include_str!({file:?})),\n", name(folder)))
}

/// The files of a folder with one of some extensions, as entries of a Rust array: key and text.
fn texts(folder: &Path, extensions: &[&str], key: fn(&Path) -> String) -> String {
    let has = |path: &PathBuf| path.extension().is_some_and(|e| extensions.iter().any(|extension| e == *extension));
    let files = entries(folder).into_iter().filter(has);
    files.map(|path| format!("({:?}, include_str!({path:?})),\n", key(&path))).collect()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
