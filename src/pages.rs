//! The pages of kinds in `docs`, a constant for each, and the icons of `modelDescription/icons`. The build script writes
//! them: a page is the one place where something is said of a kind.

/// What is said of a kind in its page below `docs`: the entries of its front matter, and its text.
#[derive(Debug, Clone, Copy)]
pub struct Page {
    /// Its place below `docs`, without an ending.
    pub place: &'static str,
    /// What the kind is, in a few words.
    pub title: &'static str,
    /// What its FMUs tell a reader.
    pub guide: Guide,
    /// Where a reader chooses a controller: what one needs to have for it, and what to expect; nothing of other kinds.
    pub choice: &'static [&'static str],
    /// Its text, and behind it that of the page in `followed by`.
    pub text: &'static str,
}

/// What the FMUs of a kind tell a reader who has nothing else. Texts are Markdown, and may have parts that hold for some
/// structures only, as a page may.
#[derive(Debug, Clone, Copy)]
pub struct Guide {
    /// What such a unit is for, in a sentence or two.
    pub purpose: &'static str,
    /// What such a unit shows while nothing is connected to it, and what to connect.
    pub alone: &'static str,
    /// The parameters that matter most, and what each does. A unit leaves out those that it doesn't have.
    pub gains: &'static [(&'static str, &'static str)],
    /// What it can't do, as a list.
    pub limits: &'static str,
}

impl Guide {
    /// Of kinds that tell nothing of themselves.
    pub const NONE: Guide = Guide { purpose: "", alone: "", gains: &[], limits: "" };
}

/// The picture of a kind's units.
#[derive(Debug, Clone, Copy)]
pub struct Icon {
    /// Name of its files in `modelDescription/icons`, without an ending.
    pub name: &'static str,
    /// As SVG.
    pub svg: &'static str,
    /// The same as PNG, 128 × 128.
    pub png: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/pages.rs"));

/// The icon of a kind by its name; of a kind that has none, that of any unit.
pub fn icon(kind: &str) -> Icon {
    let named = |name: &str| ICONS.iter().find(|icon| icon.name == name).copied();
    named(kind).or_else(|| named("unit")).unwrap_or(ICONS[0])
}
