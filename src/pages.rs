//! The pages of kinds in `docs`, a constant for each, and the icons of `modelDescription/icons`. The build script
//! generates them: a page is the only description of a kind.

/// Page of a kind below `docs`: the entries of its front matter, and its text.
#[derive(Debug, Clone, Copy)]
pub struct Page {
    /// Its place below `docs`, without an ending.
    pub place: &'static str,
    /// The kind in a few words.
    pub title: &'static str,
    /// Guide for the readers of its FMUs.
    pub guide: Guide,
    /// Requirements and expectations, for readers who choose a controller; empty for other kinds.
    pub choice: &'static [&'static str],
    /// Its text, and behind it that of the page in `followed by`.
    pub text: &'static str,
}

/// Guide for readers who have only an FMU of a kind. Texts are Markdown, and may have parts that apply to some
/// structures only, as a page may.
#[derive(Debug, Clone, Copy)]
pub struct Guide {
    /// Purpose of such an FMU, in a sentence or two.
    pub purpose: &'static str,
    /// Behaviour of such an FMU while nothing is connected to it, and what to connect.
    pub alone: &'static str,
    /// The parameters that matter most, and what each does. A unit leaves out those that it doesn't have.
    pub gains: &'static [(&'static str, &'static str)],
    /// Limitations, as a list.
    pub limits: &'static str,
}

impl Guide {
    /// The guide of kinds without one.
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
