//! Diagrams as SVG. No plotting library for Rust writes dashes as an attribute, legends next to the axes and points no
//! closer than a screen shows, all of which these figures need.

use std::fmt::Write;

use super::axis::Axis;
use super::thinned::{simplified, thinned};
use super::{Curve, Diagram, Mark, Style};
use crate::drawing::escaped;

/// Sizes of a sheet and of its parts, in pixels.
#[derive(Debug, Clone, Copy)]
struct Sheet {
    width: f64,
    /// Height of a diagram's axes.
    height: f64,
    font: f64,
    /// The part of the width that a legend next to the axes may take; a wider one goes below.
    legend_share: f64,
}

/// A file of its own.
const FILE: Sheet = Sheet { width: 1000.0, height: 230.0, font: 13.0, legend_share: 0.34 };
/// A figure among others, on a page.
const FIGURE: Sheet = Sheet { width: 640.0, height: 270.0, font: 15.0, legend_share: 0.28 };
/// Mean width of a letter, in parts of its height, and the height of a line of text.
const LETTER: f64 = 0.56;
const LINE: f64 = 1.5;
/// Number of units of a curve's whole coordinates in a pixel.
const TENTHS: f64 = 10.0;
/// Largest distance of a curve's line from its points, in tenths of a pixel.
const DISTANCE: f64 = 2.0;
/// The part of the width that a peak takes.
const PEAK_WIDTH: f64 = 0.28;
const MARGIN: f64 = 12.0;
/// The line in front of a name in a legend.
const SAMPLE: f64 = 34.0;
const GREY: &str = "#444";
/// Colour of the times of events.
const EVENT: &str = "#b00020";
/// Attributes of all curves.
pub(super) const CURVES: &str = "fill=\"none\" stroke-linejoin=\"round\"";

/// The diagrams one below the other, with a title.
pub fn svg(title: &str, diagrams: &[Diagram]) -> String {
    let (mut body, mut top) = (String::new(), MARGIN);
    for line in wrapped(title, (FILE.width / (17.0 * LETTER)) as usize) {
        text(&mut body, (MARGIN, top + 18.0), &line, "font-size=\"17\"");
        top += 24.0;
    }
    let edges = Edges::of(&FILE, diagrams);
    for diagram in diagrams {
        top += drawn(&mut body, &FILE, edges, diagram, top, true);
    }
    sheet(FILE.width, top + MARGIN, FILE.font, &body, false)
}

/// One diagram without its title, as wide as its container.
pub fn figure(diagram: &Diagram) -> String {
    let mut body = String::new();
    let edges = Edges::of(&FIGURE, std::slice::from_ref(diagram));
    let height = drawn(&mut body, &FIGURE, edges, diagram, 0.0, false);
    sheet(FIGURE.width, height, FIGURE.font, &body, true)
}

/// A whole picture.
pub(super) fn sheet(width: f64, height: f64, font: f64, body: &str, scalable: bool) -> String {
    let size = if scalable { "width=\"100%\"".to_owned() } else { format!("width=\"{width}\" height=\"{height:.0}\"") };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" {size} viewBox=\"0 0 {width} {height:.0}\" \
         font-family=\"system-ui, sans-serif\" font-size=\"{font}\" fill=\"#1b1b1b\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{body}</svg>\n"
    )
}

/// A text at a place.
pub(super) fn text(out: &mut String, (x, y): (f64, f64), words: &str, how: &str) {
    if words.is_empty() {
        return;
    }
    let before = if how.is_empty() { "" } else { " " };
    let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\"{before}{how}>{}</text>", escaped(words));
}

/// Wraps words to lines of at most so many letters.
fn wrapped(words: &str, most: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in words.split_whitespace() {
        let last = lines.last_mut().filter(|line| line.chars().count() + word.chars().count() < most);
        match last {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => *line = format!("{line} {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    lines.retain(|line| !line.is_empty());
    lines
}

/// Ends of the axes of all diagrams of a sheet.
#[derive(Debug, Clone, Copy)]
struct Edges {
    left: f64,
    right: f64,
    /// True if legends are next to the axes.
    legend_at_side: bool,
}

impl Edges {
    fn of(sheet: &Sheet, diagrams: &[Diagram]) -> Self {
        let width = diagrams.iter().map(|diagram| legend_width(sheet.font, &names(diagram))).fold(0.0, f64::max);
        let legend_at_side = width <= sheet.legend_share * sheet.width;
        let first = |diagram: &Diagram| diagram.parts().first().map(|&(from, to)| diagram.axis(from, to));
        let numbers = diagrams.iter().filter_map(first).map(|axis| numbers_width(sheet, &axis)).fold(0.0, f64::max);
        let right = if legend_at_side { sheet.width - width } else { sheet.width } - MARGIN;
        Edges { left: MARGIN + 1.3 * sheet.font + numbers, right, legend_at_side }
    }
}

/// Width of the numbers at an axis of values.
fn numbers_width(sheet: &Sheet, axis: &Axis) -> f64 {
    let longest = axis.ticks(sheet.height / 45.0).iter().map(|(_, text)| text.chars().count()).max();
    sheet.font * (LETTER * longest.unwrap_or(1) as f64 + 0.8)
}

fn names<'a>(diagram: &'a Diagram) -> Vec<(&'a str, &'a Style)> {
    diagram.curves.iter().map(|curve| (curve.name.as_str(), &curve.style)).collect()
}

/// Draws a diagram from this height on, and returns its height.
fn drawn(out: &mut String, sheet: &Sheet, edges: Edges, diagram: &Diagram, top: f64, titled: bool) -> f64 {
    let line = sheet.font * LINE;
    let mut axes = top + MARGIN;
    if titled {
        text(out, (MARGIN, top + line + 4.0), &diagram.title, "font-weight=\"bold\"");
        axes += line + 4.0;
    }
    if diagram.peak.is_some() {
        axes += line;
    }
    panels(out, sheet, edges, diagram, axes);
    let (names, bottom) = (names(diagram), axes + sheet.height + 3.0 * sheet.font);
    if edges.legend_at_side {
        let left = edges.right + MARGIN;
        legend(out, sheet.font, &names, (left, axes + line), left + 1.0);
        return bottom.max(axes + names.len() as f64 * line) - top;
    }
    legend(out, sheet.font, &names, (sheet.width * 0.1, bottom + line), sheet.width) + line - top
}

/// Draws the axes of a diagram, with a peak on its own ones.
fn panels(out: &mut String, sheet: &Sheet, edges: Edges, diagram: &Diagram, top: f64) {
    let (parts, peak) = (diagram.parts(), diagram.peak_part());
    let axes: Vec<Axis> = parts.iter().map(|&(from, to)| diagram.axis(from, to)).collect();
    let between = axes.get(1).map_or(0.0, |axis| 2.0 * MARGIN + numbers_width(sheet, axis));
    let total = edges.right - edges.left;
    let of_peak = PEAK_WIDTH * total;
    let mut left = edges.left;
    for (place, (&(from, to), &y)) in parts.iter().zip(&axes).enumerate() {
        let width = match peak {
            None => total,
            Some(peak) if peak == place => of_peak,
            Some(_) => total - of_peak - between,
        };
        let frame = Frame { left, top, width, height: sheet.height, x: Axis::linear((from, to)), y };
        frame.draw(out, sheet.font, diagram);
        let note = match (peak, place) {
            (None, _) => "",
            (Some(0), 0) => "the start",
            (Some(0), _) => "after it, on a scale of its own",
            (_, 0) => "before the end, on a scale of its own",
            _ => "the end",
        };
        text(out, (left, top - 0.5 * sheet.font), note, &format!("fill=\"{GREY}\" font-style=\"italic\""));
        left += width + between;
    }
    let (middle, bottom) = ((edges.left + edges.right) / 2.0, top + sheet.height);
    text(out, (middle, bottom + 2.6 * sheet.font), &diagram.x, "text-anchor=\"middle\"");
    let (x, y) = (MARGIN + 0.9 * sheet.font, (top + bottom) / 2.0);
    let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {x:.1} {y:.1})\"");
    text(out, (x, y), &diagram.y, &turned);
}

/// Axes with their place on the sheet.
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x: Axis,
    y: Axis,
}

impl Frame {
    fn draw(&self, out: &mut String, font: f64, Diagram { curves, marks, .. }: &Diagram) {
        let Frame { left, top, width, height, x, y } = self;
        let (right, bottom) = (left + width, top + height);
        let mut grid = String::new();
        let _ = writeln!(out, "<g text-anchor=\"middle\" fill=\"{GREY}\">");
        for (value, words) in x.ticks((width / 80.0).max(2.0)) {
            let across = left + x.place(value) * width;
            let _ = write!(grid, "M{across:.1} {top:.1}V{bottom:.1}");
            text(out, (across, bottom + 1.3 * font), &words, "");
        }
        let _ = writeln!(out, "</g>\n<g text-anchor=\"end\" fill=\"{GREY}\">");
        for (value, words) in y.ticks(height / 45.0) {
            let up = bottom - y.place(value) * height;
            let _ = write!(grid, "M{left:.1} {up:.1}H{right:.1}");
            let at = (left - 0.4 * font, up + 0.35 * font);
            text(out, at, &words, "");
        }
        let _ = writeln!(out, "</g>\n<path d=\"{grid}\" fill=\"none\" stroke=\"#e4e4e4\"/>");
        // An inner picture clips what is outside.
        let (wide, tall) = (width * TENTHS, height * TENTHS);
        let _ = writeln!(
            out,
            "<svg x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
             viewBox=\"0 0 {wide:.0} {tall:.0}\" {CURVES}>"
        );
        for Mark { time, text } in marks.iter().filter(|mark| (x.low..=x.high).contains(&mark.time)) {
            let (across, title) = (x.place(*time) * wide, escaped(text));
            let _ = writeln!(
                out,
                "<path d=\"M{across:.0} 0V{tall:.0}\" stroke=\"{EVENT}\" stroke-width=\"{TENTHS}\" stroke-dasharray=\"20 30\">\
                 <title>{title}</title></path>"
            );
        }
        for beneath in [true, false] {
            for curve in curves.iter().filter(|curve| curve.style.beneath == beneath) {
                let _ = writeln!(out, "<path d=\"{}\" {}/>", self.path(curve), stroke(&curve.style, TENTHS));
            }
        }
        let _ = writeln!(
            out,
            "</svg>\n<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"none\" \
             stroke=\"#999\"/>"
        );
    }

    /// A curve within it, in tenths of a pixel.
    fn path(&self, curve: &Curve) -> String {
        let rows = curve.rows(self.x.low, self.x.high);
        // A neighbour on each side extends lines to the border.
        let rows = rows.start.saturating_sub(1)..(rows.end + 1).min(curve.times.len().min(curve.values.len()));
        let points = thinned(&curve.times[rows.clone()], &curve.values[rows], (self.width / 0.7) as usize);
        let (wide, tall) = (self.width * TENTHS, self.height * TENTHS);
        let (across, upwards) = (self.x.places(), self.y.places());
        let seen = |(time, value): &(f64, f64)| {
            // Far outside is outside.
            let up = upwards(*value).clamp(-3.0, 4.0);
            (across(*time) * wide, (1.0 - up) * tall)
        };
        let mut path = String::new();
        for part in points.split(|(_, value)| !value.is_finite()).filter(|part| !part.is_empty()) {
            line(&mut path, &part.iter().map(seen).collect::<Vec<_>>());
        }
        path
    }
}

/// A line through points, in few whole numbers.
pub(super) fn line(path: &mut String, points: &[(f64, f64)]) {
    let mut last: Option<(i64, i64)> = None;
    for place in simplified(points, DISTANCE) {
        let (x, y) = (points[place].0.round() as i64, points[place].1.round() as i64);
        let _ = match last {
            None => write!(path, "M{x} {y}"),
            Some((from, up)) if (x, y) != (from, up) => write!(path, "l{} {}", x - from, y - up),
            Some(_) => continue,
        };
        last = Some((x, y));
    }
}

/// Attributes of a curve's line, in coordinates of `fine` units a pixel. A reference is broad and pale, so that it
/// shows beneath a curve that follows it exactly.
pub(super) fn stroke(style: &Style, fine: f64) -> String {
    let Style { colour, dashes, beneath } = style;
    let (width, opacity) = if *beneath { (3.2, " stroke-opacity=\"0.55\"") } else { (1.5, "") };
    let width = width * fine;
    let dashes: Vec<String> = dashes.iter().map(|length| (f64::from(*length) * fine).to_string()).collect();
    let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{}\"", dashes.join(" ")) };
    format!("stroke=\"{colour}\" stroke-width=\"{width}\"{opacity}{dashes}")
}

fn name_width(font: f64, name: &str) -> f64 {
    SAMPLE + 0.6 * font + LETTER * font * name.chars().count() as f64
}

fn legend_width(font: f64, names: &[(&str, &Style)]) -> f64 {
    MARGIN + names.iter().map(|(name, _)| name_width(font, name)).fold(0.0, f64::max)
}

/// Draws names with samples of their lines, in rows up to this right end. Returns how far down they extend.
pub(super) fn legend(
    out: &mut String,
    font: f64,
    names: &[(&str, &Style)],
    (left, top): (f64, f64),
    right: f64,
) -> f64 {
    let (mut x, mut y) = (left, top);
    for (name, style) in names {
        let width = name_width(font, name) + font;
        if x > left && x + width > right {
            (x, y) = (left, y + font * LINE);
        }
        let up = y - 0.35 * font;
        let _ = writeln!(out, "<path d=\"M{x:.1} {up:.1}h{SAMPLE}\" {}/>", stroke(style, 1.0));
        text(out, (x + SAMPLE + 0.5 * font, y), name, "");
        x += width;
    }
    y
}
