//! Build data of a library: stored in it as text, so that they can be read in a library for another platform, too.

use serde::{Deserialize, Serialize};

use crate::system::Registry;

/// Data that the C functions of a library get about it.
#[derive(Debug, Clone, Copy)]
pub struct Library {
    /// The kinds that it makes units of.
    pub registry: Registry,
    /// Checksum of its sources.
    pub source: &'static str,
    /// Build data, as [`text`].
    pub build: &'static [u8],
}

/// Checksum of the framework's own sources.
pub const SOURCE: &str = env!("ADAPTIVE_FMU_SOURCE");

/// The target platform, as Rust names it.
pub const TARGET: &str = env!("ADAPTIVE_FMU_TARGET");

const MARK: &str = "{\"adaptive-fmu library\":";

/// Build data common to all libraries that are built with this framework.
const COMMON: &str = concat!(
    "{\"version\":\"",
    env!("CARGO_PKG_VERSION"),
    "\",\"target\":\"",
    env!("ADAPTIVE_FMU_TARGET"),
    "\",\"compiler\":\"",
    env!("ADAPTIVE_FMU_COMPILER"),
    "\",\"optimised\":",
    env!("ADAPTIVE_FMU_OPTIMISED"),
);

/// Build data of a package's library or program, for storage in it.
pub const fn text<const LENGTH: usize>(package: &str, source: &str) -> [u8; LENGTH] {
    let (parts, mut text, mut length) = (parts(package, source), [0; LENGTH], 0);
    // Iterators can't be used before a program runs.
    let mut k = 0;
    while k < parts.len() {
        let (_, rest) = text.split_at_mut(length);
        rest.split_at_mut(parts[k].len()).0.copy_from_slice(parts[k].as_bytes());
        length += parts[k].len();
        k += 1;
    }
    text
}

/// The length of [`text`], bytes.
pub const fn length(package: &str, source: &str) -> usize {
    let (parts, mut length, mut k) = (parts(package, source), 0, 0);
    while k < parts.len() {
        length += parts[k].len();
        k += 1;
    }
    length
}

const fn parts<'a>(package: &'a str, source: &'a str) -> [&'a str; 7] {
    [MARK, COMMON, ",\"source\":\"", source, "\",\"package\":\"", package, "\"}}"]
}

/// Build data of a library.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Build {
    /// Name and version of the package that holds the models.
    pub package: String,
    /// Version of the framework.
    pub version: String,
    /// Target platform, as Rust names it.
    pub target: String,
    /// Compiler.
    pub compiler: String,
    /// Checksum of the sources.
    pub source: String,
    /// True if it was optimised.
    pub optimised: bool,
}

#[derive(Deserialize)]
struct Marked {
    #[serde(rename = "adaptive-fmu library")]
    build: Build,
}

impl Build {
    /// Reads the build data from the bytes of a library for any platform; none if they hold none.
    pub fn within(library: &[u8]) -> Option<Self> {
        let mark = MARK.as_bytes();
        let places = library.windows(mark.len()).enumerate().filter(|(_, bytes)| *bytes == mark);
        places.map(|(place, _)| place).find_map(|place| {
            let mut values = serde_json::Deserializer::from_slice(&library[place..]).into_iter::<Marked>();
            Some(values.next()?.ok()?.build)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKAGE: &str = "models 1.2.3";

    #[test]
    fn a_build_is_found_within_the_bytes_of_a_library() {
        const TEXT: [u8; length(PACKAGE, SOURCE)] = text(PACKAGE, SOURCE);
        let own = Build::within(&TEXT).unwrap();
        assert_eq!((&*own.version, &*own.package, &*own.source), (env!("CARGO_PKG_VERSION"), PACKAGE, SOURCE));
        assert!(own.target.contains(std::env::consts::ARCH) && own.compiler.contains("rustc"), "{own:?}");
        assert_eq!(own.source.len(), 16);
        // A library also holds the mark itself.
        let bytes = [b"\0\x7fELF", MARK.as_bytes(), b"\xff\0", &TEXT, b"\0rest"].concat();
        assert_eq!(Build::within(&bytes), Some(own));
        assert_eq!(Build::within(b"\x7fELF of somebody else's"), None);
    }
}
