//! The checksum of a crate's sources, which its libraries report. Build scripts call it.

use std::fs;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

/// Sets `ADAPTIVE_FMU_SOURCE` for a crate: the checksum of files and of all files in folders.
pub fn track(places: &[impl AsRef<Path>]) {
    let mut hasher = DefaultHasher::new();
    for place in places.iter().map(AsRef::as_ref) {
        println!("cargo::rerun-if-changed={}", place.display());
        hash(place, &mut hasher);
    }
    println!("cargo::rustc-env=ADAPTIVE_FMU_SOURCE={:016x}", hasher.finish());
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

/// Entries of a folder, in the order of the names.
pub fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
}
