//! What `info` tells about a build, and linker flags of the shared library.

use std::hash::{DefaultHasher, Hasher};
use std::path::Path;
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rustc-env=ADAPTIVE_FMU_TARGET={}", env::var("TARGET").unwrap_or_default());
    println!("cargo::rustc-env=ADAPTIVE_FMU_COMPILER={}", compiler());
    let mut hasher = DefaultHasher::new();
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
