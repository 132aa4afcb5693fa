//! How a library was built: within it as text, so that a library for another platform can be told, too.

use serde::{Deserialize, Serialize};

const MARK: &[u8] = b"{\"adaptive-fmu library\":";

/// Of this very library or program.
const OWN: &str = concat!(
    "{\"adaptive-fmu library\":{\"version\":\"",
    env!("CARGO_PKG_VERSION"),
    "\",\"target\":\"",
    env!("ADAPTIVE_FMU_TARGET"),
    "\",\"compiler\":\"",
    env!("ADAPTIVE_FMU_COMPILER"),
    "\",\"source\":\"",
    env!("ADAPTIVE_FMU_SOURCE"),
    "\",\"optimised\":",
    env!("ADAPTIVE_FMU_OPTIMISED"),
    "}}"
);

/// How a library was built.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Build {
    /// Name and version of the package that holds the models, where the library was asked.
    #[serde(default)]
    pub package: String,
    /// Version of this crate.
    pub version: String,
    /// Target platform, as Rust names it.
    pub target: String,
    /// Compiler.
    pub compiler: String,
    /// Checksum of this crate's sources.
    pub source: String,
    /// Whether it was optimised.
    pub optimised: bool,
}

#[derive(Deserialize)]
struct Marked {
    #[serde(rename = "adaptive-fmu library")]
    build: Build,
}

impl Build {
    /// Of this very library or program.
    pub fn own() -> Self {
        Self::within(OWN.as_bytes()).unwrap_or_default()
    }

    /// Of this very library, with the models of a package.
    pub(super) fn of(package: &str) -> Self {
        Build { package: package.to_owned(), ..Self::own() }
    }

    /// Of the library that these bytes are, whatever platform it is for; none where it isn't one of this package.
    pub fn within(library: &[u8]) -> Option<Self> {
        let places = library.windows(MARK.len()).enumerate().filter(|(_, bytes)| *bytes == MARK);
        places.map(|(place, _)| place).find_map(|place| {
            let mut values = serde_json::Deserializer::from_slice(&library[place..]).into_iter::<Marked>();
            Some(values.next()?.ok()?.build)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_is_found_within_the_bytes_of_a_library() {
        let own = Build::own();
        assert_eq!(own.version, env!("CARGO_PKG_VERSION"));
        assert!(own.target.contains(std::env::consts::ARCH) && own.compiler.contains("rustc"), "{own:?}");
        assert_eq!(own.source.len(), 16);
        // The mark itself stands in a library, too.
        let bytes = [b"\0\x7fELF", MARK, b"\xff\0", OWN.as_bytes(), b"\0rest"].concat();
        assert_eq!(Build::within(&bytes), Some(own));
        assert_eq!(Build::within(b"\x7fELF of somebody else's"), None);
    }
}
