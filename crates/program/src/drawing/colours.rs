//! Colours of charts, and of numbers: from dark blue through grey to amber. Their lightness grows all the way, so that
//! people with any colour vision, and readers of a print without colours, can distinguish them.

/// Colours of a single curve, of a limit, and of curves for comparison.
pub const LINE: &str = "rgb(0, 114, 178)";
pub const LIMIT: &str = "rgb(213, 94, 0)";
pub const COMPARED: &str = "rgb(60, 60, 60)";
/// The colours at the beginning, in the middle and at the end.
const RAMP: [[f64; 3]; 3] = [[8.0, 48.0, 107.0], [122.0, 132.0, 140.0], [240.0, 173.0, 20.0]];
/// Lightness of a colour below which text on it is white.
const DARK: f64 = 0.52;

/// The colour at a place from 0 to 1.
pub fn at(place: f64) -> String {
    let [r, g, b] = mixed(place);
    format!("rgb({r:.0}, {g:.0}, {b:.0})")
}

/// The colour of text on the colour at a place.
pub fn text_on(place: f64) -> &'static str {
    if lightness(mixed(place)) < DARK { "#fff" } else { "#111" }
}

fn mixed(place: f64) -> [f64; 3] {
    let place = if place.is_finite() { place.clamp(0.0, 1.0) } else { 0.0 };
    let (from, part) = if place < 0.5 { (0, 2.0 * place) } else { (1, 2.0 * place - 1.0) };
    let (low, high) = (RAMP[from], RAMP[from + 1]);
    [0, 1, 2].map(|k| low[k] + part * (high[k] - low[k]))
}

/// Approximate lightness of a colour, from 0 to 1.
fn lightness([r, g, b]: [f64; 3]) -> f64 {
    (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_grows_all_the_way_and_text_stays_readable() {
        let places: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        assert!(places.iter().map(|place| lightness(mixed(*place))).is_sorted_by(|a, b| a < b));
        for place in places {
            let text = if text_on(place) == "#fff" { 1.0 } else { 0.067 };
            assert!((lightness(mixed(place)) - text).abs() > 0.4, "{place}");
        }
        assert_eq!(at(f64::NAN), at(0.0));
    }
}
