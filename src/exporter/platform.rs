//! The platforms that a unit can hold libraries for.

/// A platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Platform {
    /// Folder of its libraries in an FMU, as the standard names it.
    pub folder: &'static str,
    /// What its libraries' names end with.
    pub suffix: &'static str,
}

/// The standard has no name for Linux on ARM; this one is of its third version, and masters look there.
const KNOWN: [(&str, &str, Platform); 7] = [
    ("x86_64", "linux", Platform { folder: "linux64", suffix: ".so" }),
    ("i686", "linux", Platform { folder: "linux32", suffix: ".so" }),
    ("aarch64", "linux", Platform { folder: "aarch64-linux", suffix: ".so" }),
    ("x86_64", "windows", Platform { folder: "win64", suffix: ".dll" }),
    ("i686", "windows", Platform { folder: "win32", suffix: ".dll" }),
    ("x86_64", "darwin", Platform { folder: "darwin64", suffix: ".dylib" }),
    ("aarch64", "darwin", Platform { folder: "darwin64", suffix: ".dylib" }),
];

impl Platform {
    /// Where this program runs; what isn't known counts as Linux.
    pub fn own() -> Self {
        Self::of_target(env!("ADAPTIVE_FMU_TARGET")).unwrap_or(KNOWN[0].2)
    }

    /// Of a target as Rust names it, say `x86_64-pc-windows-gnu`.
    pub fn of_target(target: &str) -> Option<Self> {
        let mut parts = target.split('-');
        let processor = parts.next()?;
        let has = |system: &str| parts.clone().any(|part| part == system);
        // Masters are linked with glibc; what is linked with another C library can't be loaded by them.
        let fits = |(known, system, _): &&(&str, &str, Platform)| *known == processor && has(system) && !has("musl");
        KNOWN.iter().find(fits).map(|(.., platform)| *platform)
    }

    /// By its folder.
    pub fn named(folder: &str) -> Option<Self> {
        KNOWN.iter().find(|(.., platform)| platform.folder == folder).map(|(.., platform)| *platform)
    }

    /// What Rust calls this package's library there.
    pub fn library_name(&self) -> String {
        let prefix = if self.suffix == ".dll" { "" } else { "lib" };
        format!("{prefix}adaptive_fmu{}", self.suffix)
    }

    /// What this package's program is called there.
    pub fn program_name(&self) -> &'static str {
        if self.suffix == ".dll" { "adaptive-fmu.exe" } else { "adaptive-fmu" }
    }

    /// All of them.
    pub fn all() -> impl Iterator<Item = Platform> {
        KNOWN.iter().map(|(.., platform)| *platform)
    }

    /// Where a library of this platform lies in an FMU of this name.
    pub fn binary(&self, name: &str) -> String {
        format!("binaries/{}/{name}{}", self.folder, self.suffix)
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
            ("aarch64-apple-darwin", "binaries/darwin64/U.dylib"),
        ] {
            assert_eq!(Platform::of_target(target).unwrap().binary("U"), path);
        }
        assert_eq!(Platform::of_target("wasm32-unknown-unknown"), None);
        assert_eq!(Platform::of_target("x86_64-unknown-linux-musl"), None);
        assert_eq!(Platform::named("win64"), Platform::of_target("x86_64-pc-windows-gnu"));
    }
}
