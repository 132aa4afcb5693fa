//! Colours and dashes of the curves of a diagram: no two share both, and a reference has the colour of its signal.

/// Colours of M. Okabe and K. Ito, which people with any colour vision can distinguish; without their yellow, which
/// can't be read on white. Black is the last.
pub const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"];
const BLACK: &str = "#000000";
/// Dashes of references, in pixels: a line, a gap, and so on. Further references have additional dots.
const DASHED: [&[u32]; 3] = [&[8, 5], &[2, 4], &[8, 4, 2, 4]];

/// Style of a curve.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Style {
    /// Its colour, as `#RRGGBB`.
    pub colour: &'static str,
    /// Lengths of lines and gaps in pixels; empty for a solid line.
    pub dashes: Vec<u32>,
    /// True if it is drawn beneath the others, as for a reference.
    pub beneath: bool,
}

/// Part of a curve in its diagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A signal by itself.
    Own,
    /// Reference of the curve at a place, or its bound.
    ReferenceOf(usize),
    /// Reference of all curves, or their bound.
    Reference,
}

/// The styles of curves. References are dashed, other curves are solid as long as there are colours.
pub fn styles(parts: &[Part]) -> Vec<Style> {
    let mut styles: Vec<Style> = Vec::with_capacity(parts.len());
    let own = |place: usize| parts[..place].iter().filter(|part| **part == Part::Own).count();
    let colour = |place: usize| COLOURS[own(place) % COLOURS.len()];
    for (place, part) in parts.iter().enumerate() {
        let style = match *part {
            Part::Own => {
                let round = own(place) / COLOURS.len();
                Style { colour: colour(place), dashes: dotted(&[16, 4], round), beneath: false }
            }
            Part::ReferenceOf(followed) => reference(colour(followed), &styles),
            Part::Reference => reference(BLACK, &styles),
        };
        styles.push(style);
    }
    styles
}

/// The style of a further reference of this colour.
fn reference(colour: &'static str, before: &[Style]) -> Style {
    let number = before.iter().filter(|style| style.beneath && style.colour == colour).count();
    let dashes = DASHED.get(number).map_or_else(|| dotted(&[8, 4], number), |dashes| dashes.to_vec());
    Style { colour, dashes, beneath: true }
}

/// A dash with so many dots after it; no dashes without dots.
fn dotted(dash: &[u32], dots: usize) -> Vec<u32> {
    if dots == 0 { Vec::new() } else { dash.iter().copied().chain([2, 4].repeat(dots)).collect() }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_curves_share_colour_and_dashes_however_many_there_are() {
        let mut parts = vec![Part::Own; 60];
        parts.extend((0..60).flat_map(|place| [Part::ReferenceOf(place), Part::ReferenceOf(place)]));
        parts.extend([Part::Reference; 5]);
        let distinct: HashSet<_> = styles(&parts).into_iter().map(|style| (style.colour, style.dashes)).collect();
        assert_eq!(distinct.len(), parts.len());
    }

    #[test]
    fn a_reference_has_the_colour_of_what_follows_it_and_is_dashed() {
        let styles = styles(&[Part::Own, Part::ReferenceOf(0), Part::ReferenceOf(3), Part::Own, Part::ReferenceOf(0)]);
        assert_eq!([0, 1, 4].map(|place| styles[place].colour), [COLOURS[0]; 3]);
        assert_eq!((styles[2].colour, styles[3].colour), (COLOURS[1], COLOURS[1]));
        assert!(styles[0].dashes.is_empty() && styles[3].dashes.is_empty());
        assert!([1, 2, 4].iter().all(|&place| styles[place].beneath && !styles[place].dashes.is_empty()));
        assert_ne!(styles[1].dashes, styles[4].dashes);
    }
}
