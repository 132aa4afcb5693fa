//! Sketches of diagrams for the terminal, in Unicode's Braille patterns: two by four dots a character.

use super::diagram::{padded_range, thinned};
use crate::report::number;
use crate::simulation::Recording;
use crate::structure::Plot;

/// Size in dots.
const WIDTH: usize = 160;
const HEIGHT: usize = 60;
const DOTS: (usize, usize) = (2, 4);
/// The pattern without dots; the bits of the others, by row and column.
const EMPTY: u32 = 0x2800;
const BITS: [[u32; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// A sketch of one diagram.
///
/// # Errors
/// When it names a signal that isn't there.
pub fn terminal(plot: &Plot, recording: &Recording) -> Result<String, String> {
    let (Some(&start), Some(&end)) = (recording.times.first(), recording.times.last()) else {
        return Ok(String::new());
    };
    let column = |name: &String| recording.column(name).ok_or_else(|| format!("there is no signal `{name}`"));
    let columns = plot.signals.iter().map(column).collect::<Result<Vec<_>, _>>()?;
    let (low, high) = padded_range(columns.iter().copied().flatten());
    let mut canvas = vec![[EMPTY; WIDTH / DOTS.0]; HEIGHT / DOTS.1];
    for column in columns {
        let place = |value: f64, low: f64, high: f64, size: usize| (value - low) / (high - low) * (size - 1) as f64;
        let dots = thinned(&recording.times, column, 2 * WIDTH).into_iter().filter(|(_, value)| value.is_finite());
        let dots: Vec<_> =
            dots.map(|(t, value)| (place(t, start, end, WIDTH), place(value, low, high, HEIGHT))).collect();
        dots.windows(2).for_each(|ends| line(&mut canvas, ends[0], ends[1]));
    }
    let mut text = format!("{} ({})\n", plot.title, plot.signals.join(", "));
    let last = canvas.len() - 1;
    for (k, row) in canvas.iter().enumerate() {
        let label = if k == 0 {
            format!(" {}", number(high))
        } else if k == last {
            format!(" {}", number(low))
        } else {
            String::new()
        };
        text.extend(row.iter().filter_map(|pattern| char::from_u32(*pattern)));
        text.push_str(&format!("{label}\n"));
    }
    let (start, end) = (number(start), format!("t = {} s", number(end)));
    text.push_str(&format!("{start}{end:>width$}\n", width = (WIDTH / DOTS.0).saturating_sub(start.len())));
    Ok(text)
}

/// A line between two dots, each by column and row from below.
fn line(canvas: &mut [[u32; WIDTH / DOTS.0]], from: (f64, f64), to: (f64, f64)) {
    let steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).ceil().max(1.0);
    let mut part = 0.0;
    while part <= steps {
        let between = |from: f64, to: f64| (from + (to - from) * part / steps).round() as usize;
        let (column, row) = (between(from.0, to.0).min(WIDTH - 1), HEIGHT - 1 - between(from.1, to.1).min(HEIGHT - 1));
        canvas[row / DOTS.1][column / DOTS.0] |= BITS[row % DOTS.1][column % DOTS.0];
        part += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sketch(values: Vec<f64>) -> Vec<String> {
        let times = (0..values.len()).map(|k| k as f64).collect();
        let recording = Recording { names: vec!["a.y".into()], times, columns: vec![values], ..Recording::default() };
        let plot = Plot { title: "output".into(), signals: vec!["a.y".into()], ..Plot::default() };
        terminal(&plot, &recording).unwrap().lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_straight_line_goes_from_corner_to_corner() {
        let lines = sketch(vec![0.0, 1.0, 2.0]);
        assert_eq!(lines[0], "output (a.y)");
        assert_eq!(lines.len(), 2 + HEIGHT / DOTS.1);
        // There are margins above and below; marked dots go up by equal steps.
        let marked = |line: &str| line.chars().position(|c| ('\u{2801}'..='\u{28ff}').contains(&c));
        let places: Vec<_> = lines[1..=HEIGHT / DOTS.1].iter().rev().filter_map(|line| marked(line)).collect();
        assert!(places.len() > 11 && places.is_sorted(), "{lines:#?}");
        assert_eq!((places[0], lines[1].ends_with(" 2.12"), lines[15].ends_with(" -0.12")), (0, true, true));
        assert!(lines[16].starts_with('0') && lines[16].ends_with("t = 2 s"));
    }

    #[test]
    fn no_number_and_no_point_are_no_fault() {
        assert!(sketch(vec![f64::NAN; 5]).len() > 10);
        assert!(sketch(Vec::new()).is_empty());
        assert!(sketch(vec![1.0]).len() > 10);
        assert!(sketch(vec![0.0, f64::INFINITY, 1.0]).len() > 10);
    }
}
