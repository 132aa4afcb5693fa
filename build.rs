//! What `info` tells about a build, and linker flags of the shared library.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rustc-env=ADAPTIVE_FMU_TARGET={}", env::var("TARGET").unwrap_or_default());
    println!("cargo::rustc-env=ADAPTIVE_FMU_COMPILER={}", compiler());
    let mut hasher = DefaultHasher::new();
    embed();
    for folder in ["src", "plants", "docs", "Cargo.toml"] {
        println!("cargo::rerun-if-changed={folder}");
        hash(Path::new(folder), &mut hasher);
    }
    println!("cargo::rustc-env=ADAPTIVE_FMU_SOURCE={:016x}", hasher.finish());
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        // An undefined symbol is an error here, not in a user's tool.
        println!("cargo::rustc-link-arg-cdylib=-Wl,-z,defs");
    }
}

fn compiler() -> String {
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = Command::new(rustc).arg("--version").output().map(|output| output.stdout).unwrap_or_default();
    String::from_utf8_lossy(&version).trim().to_owned()
}

/// Contents of files in the order of their names.
fn hash(path: &Path, hasher: &mut DefaultHasher) {
    if let Ok(entries) = fs::read_dir(path) {
        let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        paths.iter().for_each(|path| hash(path, hasher));
    } else {
        hasher.write(path.to_string_lossy().as_bytes());
        hasher.write(&fs::read(path).unwrap_or_default());
    }
}

/// The descriptions of FMUs and the closed loops, within the program: it needs no files beside it.
fn embed() {
    println!("cargo::rerun-if-changed=modelDescription");
    println!("cargo::rerun-if-changed=examples");
    let root = env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let list = |name: &str, folder: &str, pick: &dyn Fn(&Path) -> Option<(String, PathBuf)>| {
        let entries = fs::read_dir(Path::new(&root).join(folder)).into_iter().flatten().flatten();
        let mut found: Vec<_> = entries.filter_map(|entry| pick(&entry.path())).collect();
        found.sort();
        let lines = found.iter().map(|(key, path)| format!("({key:?}, include_str!({path:?})),\n"));
        format!("static {name}: &[(&str, &str)] = &[\n{}];\n", lines.collect::<String>())
    };
    let description = |path: &Path| {
        let is_description = path.extension().is_some_and(|extension| extension == "toml");
        is_description.then(|| (stem(path), path.to_owned()))
    };
    let closed_loop = |path: &Path| {
        let file = path.join("SystemStructure.ssd");
        file.is_file().then(|| (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), file))
    };
    let code = list("DESCRIPTIONS", "modelDescription", &description) + &list("LOOPS", "examples", &closed_loop);
    let file = Path::new(&env::var("OUT_DIR").unwrap_or_default()).join("embedded.rs");
    fs::write(file, code).expect("cargo's own folder can be written");
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
