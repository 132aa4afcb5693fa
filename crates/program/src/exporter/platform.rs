//! The platforms for which an FMU can contain libraries.

use std::path::{Path, PathBuf};

use crate::fmi2::build::TARGET;
use crate::model::Standard;

/// A platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Platform {
    /// Folder of its libraries in an FMU, as the standard names it.
    pub folder: &'static str,
    /// Folder in which masters that don't know this name look for them: that of the same system on x86-64.
    pub other_folder: Option<&'static str>,
    /// Suffix of its libraries' names.
    pub suffix: &'static str,
}

/// All platforms by processor and system. FMI 2.0.4, section 2.3, has its own names for x86; any other processor has
/// that of FMI 3.0. docs/platforms.md lists where masters look.
const KNOWN: [(&str, &str, Platform); 8] = [
    ("x86_64", "linux", Platform::of_x86("linux64", ".so")),
    ("i686", "linux", Platform::of_x86("linux32", ".so")),
    ("aarch64", "linux", Platform { folder: "aarch64-linux", other_folder: Some("linux64"), suffix: ".so" }),
    ("x86_64", "windows", Platform::of_x86("win64", ".dll")),
    ("i686", "windows", Platform::of_x86("win32", ".dll")),
    ("aarch64", "windows", Platform { folder: "aarch64-windows", other_folder: None, suffix: ".dll" }),
    ("x86_64", "darwin", Platform::of_x86("darwin64", ".dylib")),
    ("aarch64", "darwin", Platform { folder: "aarch64-darwin", other_folder: Some("darwin64"), suffix: ".dylib" }),
];

impl Platform {
    const fn of_x86(folder: &'static str, suffix: &'static str) -> Self {
        Platform { folder, other_folder: None, suffix }
    }

    /// The platform of this program; an unknown one counts as Linux.
    pub fn own() -> Self {
        Self::of_target(TARGET).unwrap_or(KNOWN[0].2)
    }

    /// The platform of a target as Rust names it, such as `x86_64-pc-windows-gnu`.
    pub fn of_target(target: &str) -> Option<Self> {
        let mut parts = target.split('-');
        let processor = parts.next()?;
        let has = |system: &str| parts.clone().any(|part| part == system);
        // Masters are linked with glibc, so they can't load a library that is linked with another C library.
        let fits = |(known, system, _): &&(&str, &str, Platform)| *known == processor && has(system) && !has("musl");
        KNOWN.iter().find(fits).map(|(.., platform)| *platform)
    }

    /// Processor and system, as compilers name them.
    pub fn target(&self) -> (&'static str, &'static str) {
        let known = KNOWN.iter().find(|(.., platform)| platform == self);
        known.map_or((KNOWN[0].0, KNOWN[0].1), |(processor, system, _)| (processor, system))
    }

    /// The platform with a folder.
    pub fn named(folder: &str) -> Option<Self> {
        KNOWN.iter().find(|(.., platform)| platform.folder == folder).map(|(.., platform)| *platform)
    }

    /// File name of this package's library there, as Rust names it.
    pub fn library_name(&self) -> String {
        let prefix = if self.suffix == ".dll" { "" } else { "lib" };
        format!("{prefix}adaptive_fmu_library{}", self.suffix)
    }

    /// File name of this package's program there.
    pub fn program_name(&self) -> &'static str {
        if self.suffix == ".dll" { "adaptive-fmu.exe" } else { "adaptive-fmu" }
    }

    /// All of them.
    pub fn all() -> impl Iterator<Item = Platform> {
        KNOWN.iter().map(|(.., platform)| *platform)
    }

    /// The place of a library of this platform in an FMU of a standard.
    pub fn binary_of(&self, standard: Standard, name: &str) -> String {
        if standard == Standard::Fmi2 {
            return self.binary(name);
        }
        let (processor, system) = self.target();
        let processor = if processor == "i686" { "x86" } else { processor };
        self.binary_in(&format!("{processor}-{system}"), name)
    }

    /// The place of a library of this platform in an FMU of FMI 2.0.
    pub fn binary(&self, name: &str) -> String {
        self.binary_in(self.folder, name)
    }

    /// A second place for it, if no library for x86-64 is there.
    pub fn other_binary(&self, name: &str) -> Option<String> {
        self.other_folder.map(|folder| self.binary_in(folder, name))
    }

    /// The library of this platform in the folder of an FMU, in one of its [places](Platform::binaries).
    pub fn find_binary(&self, fmu: &Path, standard: Standard, name: &str) -> Option<PathBuf> {
        self.binaries(standard, name).map(|place| fmu.join(place)).find(|path| path.is_file())
    }

    /// Places of the library of this platform in an FMU: its own place, and in FMI 2.0 also that of other tools.
    pub fn binaries(&self, standard: Standard, name: &str) -> impl Iterator<Item = String> {
        let other = (standard == Standard::Fmi2).then(|| self.other_binary(name)).flatten();
        [Some(self.binary_of(standard, name)), other].into_iter().flatten()
    }

    fn binary_in(&self, folder: &str, name: &str) -> String {
        format!("binaries/{folder}/{name}{}", self.suffix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_have_the_folders_of_the_standard() {
        for (target, path) in [
            ("x86_64-unknown-linux-gnu", "binaries/linux64/U.so"),
            ("aarch64-unknown-linux-gnu", "binaries/aarch64-linux/U.so"),
            ("x86_64-pc-windows-gnu", "binaries/win64/U.dll"),
            ("x86_64-pc-windows-msvc", "binaries/win64/U.dll"),
            ("x86_64-apple-darwin", "binaries/darwin64/U.dylib"),
            ("aarch64-apple-darwin", "binaries/aarch64-darwin/U.dylib"),
        ] {
            assert_eq!(Platform::of_target(target).unwrap().binary("U"), path);
        }
        assert_eq!(Platform::of_target("wasm32-unknown-unknown"), None);
        assert_eq!(Platform::of_target("x86_64-unknown-linux-musl"), None);
        assert_eq!(Platform::named("win64"), Platform::of_target("x86_64-pc-windows-gnu"));
        assert_eq!(Platform::named("darwin64"), Platform::of_target("x86_64-apple-darwin"));
    }

    #[test]
    fn a_library_for_arm_is_found_where_other_tools_put_it_if_not_in_its_own_place() {
        let fmu = tempfile::tempdir().unwrap();
        let arm = Platform::of_target("aarch64-unknown-linux-gnu").unwrap();
        let find = |platform: &Platform| {
            let found = platform.find_binary(fmu.path(), Standard::Fmi2, "U")?;
            Some(found.strip_prefix(fmu.path()).unwrap().to_string_lossy().into_owned())
        };
        for (folder, of_arm) in
            [("win64", None), ("linux64", Some("linux64")), ("aarch64-linux", Some("aarch64-linux"))]
        {
            std::fs::create_dir_all(fmu.path().join("binaries").join(folder)).unwrap();
            std::fs::write(fmu.path().join(format!("binaries/{folder}/U.so")), "x").unwrap();
            assert_eq!(find(&arm), of_arm.map(|folder| format!("binaries/{folder}/U.so")));
        }
        let mac = Platform::of_target("aarch64-apple-darwin").unwrap();
        assert_eq!(mac.other_binary("U").as_deref(), Some("binaries/darwin64/U.dylib"));
        assert_eq!((find(&mac), find(&Platform::named("linux32").unwrap())), (None, None));
    }
}
