//! Charts of many runs that need no script: metrics over a parameter, and families of curves.

use std::fmt::Write;

use super::escaped;
use crate::report::number;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 36.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 48.0;

/// A curve.
pub struct Line {
    /// Tooltip of the line.
    pub name: String,
    pub colour: String,
    pub points: Vec<(f64, Option<f64>)>,
    /// True if its points are marked.
    pub marked: bool,
    pub dashed: bool,
}

/// A diagram.
pub struct Chart<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    /// True if the horizontal axis is logarithmic.
    pub logarithmic: bool,
    pub lines: Vec<Line>,
}

/// An axis: its ends, and pixels.
struct Axis {
    low: f64,
    high: f64,
    logarithmic: bool,
    from: f64,
    to: f64,
}

impl Axis {
    fn at(&self, value: f64) -> f64 {
        let scale = |value: f64| if self.logarithmic { value.log10() } else { value };
        let part = (scale(value) - scale(self.low)) / (scale(self.high) - scale(self.low));
        self.from + part * (self.to - self.from)
    }

    /// Round numbers within it.
    fn ticks(&self) -> Vec<f64> {
        if self.logarithmic {
            let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
            let steps: &[f64] = if last - first <= 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let all = (first..=last).flat_map(|ten| steps.iter().map(move |step| step * 10_f64.powi(ten)));
            return all.filter(|tick| *tick >= self.low * 0.999_999 && *tick <= self.high * 1.000_001).collect();
        }
        let rough = (self.high - self.low) / 6.0;
        let ten = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * ten).into_iter().find(|step| *step >= rough * 0.999_999);
        let step = step.unwrap_or(rough);
        let (first, last) = ((self.low / step - 1e-9).ceil() as i64, (self.high / step + 1e-9).floor() as i64);
        (first..=last).map(|k| rounded(k as f64 * step)).collect()
    }
}

/// A value without the rounding of a multiplication.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

/// Smallest and largest of some numbers.
fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    (low <= high).then_some((low, high))
}

/// Style of charts.
pub const CHARTS: &str = "
  .chart { display: block; width: 100%; max-width: 60em; }
  .chart text { font-size: 12px; fill: #444; }
  .chart path { fill: none; }
  .chart .grid { stroke: #e4e4e4; }
  .chart .curve { stroke-width: 1.5; stroke-linejoin: round; }
  .chart g:hover .curve { stroke-width: 4; }
";

impl Chart<'_> {
    /// The chart, with its title above it.
    pub fn svg(&self) -> String {
        format!("<h2>{}</h2>\n{}", escaped(self.title), self.drawing())
    }

    /// The picture without its title.
    pub fn drawing(&self) -> String {
        let points = || self.lines.iter().flat_map(|line| &line.points);
        let (left, right) = ends(points().map(|(x, _)| *x)).unwrap_or((0.0, 1.0));
        let (low, high) = ends(points().filter_map(|(_, y)| *y)).unwrap_or((-1.0, 1.0));
        let apart = if high > low { 0.06 * (high - low) } else { 0.1 * low.abs().max(1.0) };
        let right = if right > left { right } else { left + left.abs().max(1.0) };
        let x = Axis { low: left, high: right, logarithmic: self.logarithmic, from: LEFT, to: WIDTH - RIGHT };
        let y = Axis { low: low - apart, high: high + apart, logarithmic: false, from: HEIGHT - BOTTOM, to: TOP };
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\n",
            escaped(self.title)
        );
        self.push_axes(&mut svg, &x, &y);
        self.lines.iter().for_each(|line| push_line(&mut svg, line, &x, &y));
        svg.push_str("</svg>\n");
        svg
    }

    fn push_axes(&self, svg: &mut String, x: &Axis, y: &Axis) {
        let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
        for tick in x.ticks() {
            let (at, text) = (x.at(tick), number(tick));
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{at:.1},{TOP}V{bottom}\"/>");
            let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{text}</text>", bottom + 17.0);
        }
        for tick in y.ticks() {
            let (at, text) = (y.at(tick), number(tick));
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{LEFT},{at:.1}H{right}\"/>");
            let _ = writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>", LEFT - 7.0, at + 4.0);
        }
        let (middle, height) = ((LEFT + right) / 2.0, HEIGHT - 8.0);
        let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{height}\" text-anchor=\"middle\">{}</text>", escaped(self.x));
        let turned = format!("translate(15 {}) rotate(-90)", (TOP + bottom) / 2.0);
        let _ = writeln!(svg, "<text transform=\"{turned}\" text-anchor=\"middle\">{}</text>", escaped(self.y));
    }
}

fn push_line(svg: &mut String, line: &Line, x: &Axis, y: &Axis) {
    let Line { name, colour, points, marked, dashed } = line;
    let (mut path, mut marks, mut gap) = (String::new(), String::new(), true);
    for (at, value) in points {
        if let Some(value) = value {
            let (across, up) = (x.at(*at), y.at(*value));
            let _ = write!(path, "{}{across:.1},{up:.1}", if gap { 'M' } else { 'L' });
            if *marked {
                let _ = write!(marks, "<circle cx=\"{across:.1}\" cy=\"{up:.1}\" r=\"3\" fill=\"{colour}\"/>");
            }
        }
        gap = value.is_none();
    }
    let dashes = if *dashed { " stroke-dasharray=\"7 5\"" } else { "" };
    let name = escaped(name);
    let _ = writeln!(
        svg,
        "<g><title>{name}</title><path class=\"curve\" stroke=\"{colour}\"{dashes} d=\"{path}\"/>{marks}</g>"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(low: f64, high: f64, logarithmic: bool) -> Axis {
        Axis { low, high, logarithmic, from: 0.0, to: 100.0 }
    }

    #[test]
    fn ticks_are_round_numbers_within_the_axis() {
        assert_eq!(axis(0.0, 1.0, false).ticks(), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(axis(1e3, 1e5, true).ticks(), [1e3, 2e3, 5e3, 1e4, 2e4, 5e4, 1e5]);
        assert_eq!(axis(1e-2, 1e4, true).ticks().len(), 7);
        assert!((axis(1e3, 1e5, true).at(1e4) - 50.0).abs() < 1e-12);
    }

    #[test]
    fn a_gap_stays_a_gap_and_names_are_no_markup() {
        let points = vec![(1.0, Some(1.0)), (2.0, None), (3.0, Some(2.0))];
        let line = Line { name: "<b>".into(), colour: "red".into(), points, marked: true, dashed: false };
        let svg = Chart { title: "a < b", x: "k", y: "m", logarithmic: false, lines: vec![line] }.svg();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("&lt;b&gt;") && svg.contains("a &lt; b") && !svg.contains("<b>"), "{svg}");
        let path = svg.split("class=\"curve\"").nth(1).unwrap().split("d=\"").nth(1).unwrap();
        assert_eq!(path.split('"').next().unwrap().matches('M').count(), 2);
    }
}
