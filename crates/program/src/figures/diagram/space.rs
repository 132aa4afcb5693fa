//! Paths in space, seen from the side and from above, with named axes.

use std::fmt::Write;

use super::Style;
use super::axis::{Axis, padded_range};
use super::style::{Part, styles};
use super::svg::{CURVES, legend, line, sheet, stroke, text};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 450.0;
const FONT: f64 = 15.0;
/// View: angles about the axis that points up, and above the plane, in degrees.
const TURN: f64 = 35.0;
const ABOVE: f64 = 22.0;
/// Length of an edge of the cube around it, pixels.
const EDGE: f64 = 235.0;
const TENTHS: f64 = 10.0;
const GREY: &str = "#444";

/// A path in space.
#[derive(Debug, Clone)]
pub struct Path {
    /// Its name.
    pub name: String,
    /// Its part among the paths.
    pub part: Part,
    /// Its points.
    pub points: Vec<[f64; 3]>,
}

/// Projection of a point of the unit cube on the sheet.
fn seen([x, y, z]: [f64; 3]) -> (f64, f64) {
    let (turn, above) = (TURN.to_radians(), ABOVE.to_radians());
    let (x, y, z) = (x - 0.5, y - 0.5, z - 0.5);
    let (across, depth) = (x * turn.cos() - y * turn.sin(), x * turn.sin() + y * turn.cos());
    let up = z * above.cos() + depth * above.sin();
    (0.5 * WIDTH + EDGE * across, 0.5 * (HEIGHT - 40.0) - EDGE * up)
}

/// The paths as an SVG that is as wide as its container. The axes are named; the third points up, or down if `down` is
/// true.
pub fn space(paths: &[Path], axes: &[String; 3], down: bool) -> String {
    let range =
        |k: usize| Axis::linear(padded_range(paths.iter().flat_map(|path| path.points.iter().map(move |p| &p[k]))));
    let ranges = [range(0), range(1), range(2)];
    let place = |k: usize, value: f64| {
        let part = ranges[k].place(value);
        if k == 2 && down { 1.0 - part } else { part }
    };
    let mut body = String::new();
    grid(&mut body, &ranges, axes, place);
    let parts: Vec<Part> = paths.iter().map(|path| path.part).collect();
    let styles = styles(&parts);
    let (wide, tall) = (WIDTH * TENTHS, HEIGHT * TENTHS);
    let _ = writeln!(body, "<svg width=\"{WIDTH}\" height=\"{HEIGHT}\" viewBox=\"0 0 {wide} {tall}\" {CURVES}>");
    let drawn = paths.iter().zip(&styles);
    for beneath in [true, false] {
        for (path, style) in drawn.clone().filter(|(_, style)| style.beneath == beneath) {
            let points = path.points.iter().map(|p| seen([place(0, p[0]), place(1, p[1]), place(2, p[2])]));
            let points: Vec<_> =
                points.map(|(x, y)| (x * TENTHS, y * TENTHS)).filter(|(x, y)| (x + y).is_finite()).collect();
            let mut d = String::new();
            line(&mut d, &points);
            let _ = writeln!(body, "<path d=\"{d}\" {}/>", stroke(style, TENTHS));
        }
    }
    body.push_str("</svg>\n");
    let names: Vec<(&str, &Style)> = paths.iter().map(|path| path.name.as_str()).zip(&styles).collect();
    legend(&mut body, FONT, &names, (0.2 * WIDTH, HEIGHT - 10.0), WIDTH);
    sheet(WIDTH, HEIGHT, FONT, &body, true)
}

/// Draws lines on the three faces behind, and numbers and names at the edges in front.
fn grid(body: &mut String, ranges: &[Axis; 3], axes: &[String; 3], place: impl Fn(usize, f64) -> f64) {
    let mut lines = String::new();
    let mut segment = |from: [f64; 3], to: [f64; 3]| {
        let ((a, b), (c, d)) = (seen(from), seen(to));
        let _ = write!(lines, "M{a:.1} {b:.1}L{c:.1} {d:.1}");
    };
    let grey = format!("text-anchor=\"middle\" fill=\"{GREY}\" font-size=\"13\"");
    for (k, axis) in ranges.iter().enumerate() {
        for (value, words) in axis.ticks(4.0) {
            let at = place(k, value);
            // The faces behind are y = 1, x = 1, and the floor.
            let (edges, outside): ([[f64; 3]; 3], [f64; 3]) = match k {
                0 => ([[at, 0.0, 0.0], [at, 1.0, 0.0], [at, 1.0, 1.0]], [at, -0.06, -0.05]),
                1 => ([[0.0, at, 0.0], [1.0, at, 0.0], [1.0, at, 1.0]], [-0.06, at, -0.05]),
                _ => ([[1.0, 0.0, at], [1.0, 1.0, at], [0.0, 1.0, at]], [1.0, -0.08, at]),
            };
            segment(edges[0], edges[1]);
            segment(edges[1], edges[2]);
            let (x, y) = seen(outside);
            text(body, (x, y + 5.0), &words, &grey);
        }
    }
    let _ = writeln!(body, "<path d=\"{lines}\" fill=\"none\" stroke=\"#e4e4e4\"/>");
    let _ = writeln!(body, "<path d=\"{}\" fill=\"none\" stroke=\"#999\"/>", edges());
    for (name, at) in axes.iter().zip([[0.5, -0.2, -0.17], [-0.2, 0.5, -0.17], [1.0, -0.4, 1.04]]) {
        text(body, seen(at), name, "text-anchor=\"middle\"");
    }
}

/// Draws the edges of the cube, but for those in front of the paths.
fn edges() -> String {
    let corners = |corners: &[[f64; 3]]| {
        let places = corners.iter().map(|corner| seen(*corner)).map(|(x, y)| format!("{x:.1} {y:.1}"));
        format!("M{}", places.collect::<Vec<_>>().join("L"))
    };
    let floor = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0., 0., 0.]];
    let faces = [[0., 1., 0.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.], [1., 0., 0.]];
    corners(&floor) + &corners(&faces) + &corners(&[[1., 1., 0.], [1., 1., 1.]])
}
