//! What `info` tells about a build, and linker flags of the shared library.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rustc-env=ADAPTIVE_FMU_TARGET={}", env::var("TARGET").unwrap_or_default());
    println!("cargo::rustc-env=ADAPTIVE_FMU_COMPILER={}", compiler());
    let optimised = env::var("OPT_LEVEL").is_ok_and(|level| level != "0" && level != "1");
    println!("cargo::rustc-env=ADAPTIVE_FMU_OPTIMISED={optimised}");
    let mut hasher = DefaultHasher::new();
    embed();
    for folder in ["src", "plants", "docs", "Cargo.toml"] {
        println!("cargo::rerun-if-changed={folder}");
        hash(Path::new(folder), &mut hasher);
    }
    println!("cargo::rustc-env=ADAPTIVE_FMU_SOURCE={:016x}", hasher.finish());
    // A fuzzer's library leaves symbols of its sanitizer to the program that loads it.
    let fuzzing = env::var_os("CARGO_CFG_FUZZING").is_some();
    println!("cargo::rustc-check-cfg=cfg(old_glibc)");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") && !fuzzing {
        // An undefined symbol is an error here, not in a user's tool.
        println!("cargo::rustc-link-arg-cdylib=-Wl,-z,defs");
        if links_glibc() {
            println!("cargo::rustc-cfg=old_glibc");
        }
    }
}

/// Whether a library of this target is linked with glibc, as it is loaded, on a processor that src/fmi2/old_glibc.rs knows.
fn links_glibc() -> bool {
    let of_target = |name: &str| env::var(format!("CARGO_CFG_TARGET_{name}")).unwrap_or_default();
    let within = of_target("FEATURE").split(',').any(|feature| feature == "crt-static");
    of_target("ENV") == "gnu" && ["x86_64", "aarch64"].contains(&of_target("ARCH").as_str()) && !within
}

fn compiler() -> String {
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = Command::new(rustc).arg("--version").output().map(|output| output.stdout).unwrap_or_default();
    String::from_utf8_lossy(&version).trim().to_owned()
}

/// Contents of files in the order of their names.
fn hash(path: &Path, hasher: &mut DefaultHasher) {
    if path.is_dir() {
        entries(path).iter().for_each(|path| hash(path, hasher));
    } else {
        hasher.write(path.to_string_lossy().as_bytes());
        hasher.write(&fs::read(path).unwrap_or_default());
    }
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
    let loops =
        loops.iter().map(|folder| format!("({:?}, &[\n{}]),\n", name(folder), texts(folder, &["ssd", "ssv"], name)));
    let code = format!(
        "static DESCRIPTIONS: Embedded = &[\n{descriptions}];\nstatic LOOPS: &[(&str, Embedded)] = &[\n{}];\n",
        loops.collect::<String>()
    );
    let file = Path::new(&env::var("OUT_DIR").unwrap_or_default()).join("embedded.rs");
    fs::write(file, code).expect("cargo's own folder can be written");
}

/// The files of a folder with one of some extensions, as entries of a Rust array: key and text.
fn texts(folder: &Path, extensions: &[&str], key: fn(&Path) -> String) -> String {
    let has = |path: &PathBuf| path.extension().is_some_and(|e| extensions.iter().any(|extension| e == *extension));
    let files = entries(folder).into_iter().filter(has);
    files.map(|path| format!("({:?}, include_str!({path:?})),\n", key(&path))).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
