//! Texts at the top of this package, for a program that needs no other files: descriptions of FMUs, loops, their
//! recorded responses, the studies, licences.

include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

/// Files: name and text.
pub type Embedded = &'static [(&'static str, &'static str)];

/// The examples of the thesis, as a study.
pub const THESIS: &str = include_str!("../examples/thesis.toml");

/// First text for an archive's reader.
pub const START: &str = include_str!("../docs/start.txt");

/// The licences in FMUs: name and text.
pub const LICENCES: Embedded = &[
    ("license.txt", include_str!("../docs/license.txt")),
    ("LICENSE-APACHE", include_str!("../LICENSE-APACHE")),
    ("LICENSE-MIT", include_str!("../LICENSE-MIT")),
];

/// The descriptions of this package: name and text.
pub fn descriptions() -> Embedded {
    DESCRIPTIONS
}

/// The league of this package: its study, and the descriptions that it has of its own.
pub fn league() -> Embedded {
    LEAGUE
}

/// Linear plants of textbooks and data sheets: models as JSON, and `plants.toml` with what is known of them.
pub fn zoo() -> Embedded {
    ZOO
}

/// The closed loops of this package: name and files.
pub fn loops() -> &'static [(&'static str, Embedded)] {
    LOOPS
}

/// The reference experiment of an FMU of this package, as JSON.
pub fn reference(name: &str) -> Option<&'static str> {
    REFERENCES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Recorded response of one of these loops, with few points a curve; none for a loop that ends in a failure.
pub fn response(name: &str) -> Option<&'static str> {
    RESPONSES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}
