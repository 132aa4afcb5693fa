//! Plots of an FMU's response: recorded in its loop, or from its standalone demonstration.
//!
//! A run takes up to 20 s, too long for every export. So the package contains the curves of its loops, as few points
//! each (`examples/LOOP/response.txt`), and a test runs the loops and compares.

use std::fmt::Write;

use super::demonstration::{self, Shown};
use super::wiring::{From, Wiring};
use super::{Handed, escaped};
use crate::report::number;
use crate::texts::response;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 210.0;
const LEFT: f64 = 52.0;
const BOTTOM: f64 = 34.0;
const MARGIN: f64 = 10.0;
/// Width of a digit of a label, rounded up.
const DIGIT: f64 = 6.5;
/// Part of the time that counts as the start, and the ratio of ranges above which a peak there is cut off.
const START: f64 = 0.05;
const BEYOND: f64 = 4.0;

/// A curve.
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Its unit; empty, `-` or `1` if it is dimensionless or unknown.
    pub unit: String,
    /// True if it is a reference of others.
    pub is_reference: bool,
    /// Times and values.
    pub points: Vec<(f64, f64)>,
}

/// Curves in one diagram.
pub struct Plot {
    /// Its title.
    pub title: String,
    /// Its curves.
    pub curves: Vec<Curve>,
}

/// Appends the plots; for an FMU outside this package's loops also how to run it.
pub fn push(page: &mut String, handed: &Handed, wiring: &Wiring) {
    if let Some((name, text)) = wiring.loop_name().and_then(|name| Some((name, response(name)?))) {
        return push_loop(page, wiring, name, text);
    }
    page.push_str("<h2 id=\"response\">Response</h2>\n");
    if let Some(Shown { how, plot }) = demonstration::shown(handed) {
        let _ = write!(page, "<p>{how}</p>\n<div class=\"row\">\n");
        push_plot(page, &plot);
        page.push_str("</div>\n");
    }
    let name = escaped(&handed.unit.name);
    let _ = match wiring.from {
        From::Itself(_) => writeln!(page, "<p><code>adaptive-fmu simulate {name}.fmu</code> runs it.</p>"),
        _ => writeln!(
            page,
            "<p>In a loop: <code>adaptive-fmu new loop --units {name}.fmu …</code>, with the other FMUs of the loop, \
             connects them. <code>adaptive-fmu run</code> simulates the loop.</p>"
        ),
    };
}

/// Appends the recorded response of a loop of this package.
fn push_loop(page: &mut String, wiring: &Wiring, name: &str, text: &str) {
    let plots = read(text);
    let how = match wiring.from {
        From::Itself(_) => "is shown as recorded with separate FMUs",
        _ => "is shown as recorded with the values of the package",
    };
    let _ = write!(
        page,
        "<h2 id=\"response\">Response of the loop</h2>\n<p>The loop <code>{0}</code> {how}. <code>adaptive-fmu run \
         {0}</code> repeats the run.</p>\n<div class=\"row\">\n",
        escaped(name)
    );
    for plot in chosen(&plots, wiring) {
        push_plot(page, plot);
    }
    page.push_str("</div>\n");
}

/// The first plot, and the first other one with a signal of the FMU; else the last.
fn chosen<'a>(plots: &'a [Plot], wiring: &Wiring) -> Vec<&'a Plot> {
    let own: Vec<_> = match wiring.from {
        From::Loop(_) => wiring.parts.iter().filter(|part| part.is_own).map(|part| format!("{}.", part.name)).collect(),
        _ => Vec::new(),
    };
    let shows = |plot: &&Plot| plot.curves.iter().any(|curve| own.iter().any(|own| curve.name.starts_with(own)));
    let others = plots.get(1..).unwrap_or_default();
    plots.first().into_iter().chain(others.iter().find(shows).or(others.last())).collect()
}

/// Reads the stored response of a loop: lines `plot TITLE`, each followed by lines `curve NAME UNIT t y t y …`, or
/// `reference …` for references.
fn read(text: &str) -> Vec<Plot> {
    let mut plots: Vec<Plot> = Vec::new();
    for line in text.lines() {
        let Some((what, rest)) = line.split_once(' ') else { continue };
        let Some(plot) = plots.last_mut().filter(|_| what != "plot") else {
            plots.push(Plot { title: rest.to_owned(), curves: Vec::new() });
            continue;
        };
        let mut words = rest.split(' ');
        let mut word = || words.next().unwrap_or_default().to_owned();
        let (name, unit) = (word(), word());
        let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
        let points = numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
        plot.curves.push(Curve { name, unit, is_reference: what == "reference", points });
    }
    plots
}

/// Smallest and largest number.
fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// A step between marks of an axis: 1, 2 or 5 times a power of ten, with some four marks in a range.
fn step(range: f64) -> f64 {
    let raw = range / 4.0;
    let ten = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * ten).find(|step| *step >= raw).unwrap_or(10.0 * ten)
}

fn push_plot(page: &mut String, plot: &Plot) {
    let all = || plot.curves.iter().flat_map(|curve| &curve.points);
    let (_, end) = extent(all().map(|(time, _)| *time));
    let full = extent(all().map(|(_, value)| *value));
    let later = extent(all().filter(|(time, _)| *time >= START * end).map(|(_, value)| *value));
    let is_cut = full.1 - full.0 > BEYOND * (later.1 - later.0) && later.1 > later.0;
    let (low, high) = if is_cut { later } else { full };
    let room = if high > low { 0.07 * (high - low) } else { 0.5 };
    let (low, high) = (low - room, high + room);
    let unit = plot.curves.first().map_or("-", |curve| curve.unit.as_str());
    let title = match unit {
        "-" | "1" | "" => escaped(&plot.title),
        _ if plot.curves.iter().all(|curve| curve.unit == unit || curve.unit == "-") => {
            format!("{} in {}", escaped(&plot.title), escaped(unit))
        }
        _ => escaped(&plot.title),
    };
    let _ = write!(
        page,
        "<figure>\n<figcaption>{title}</figcaption>\n<svg role=\"img\" aria-label=\"{title}\" width=\"{WIDTH}\" \
         height=\"{HEIGHT}\" viewBox=\"0 0 {WIDTH} {HEIGHT}\">\n"
    );
    let x = |time: f64| LEFT + (WIDTH - LEFT - MARGIN) * time / end;
    let y = |value: f64| HEIGHT - BOTTOM - (HEIGHT - BOTTOM - MARGIN) * (value - low) / (high - low);
    push_axes(page, (low, high), end, x, y);
    let styles = styles(&plot.curves);
    let mut order: Vec<usize> = (0..plot.curves.len()).collect();
    order.sort_by_key(|k| styles[*k].1);
    for k in order {
        let bounded = |value: f64| value.clamp(low, high);
        let points = plot.curves[k].points.iter().map(|(t, value)| format!("{:.1},{:.1}", x(*t), y(bounded(*value))));
        let (colour, class) = style(styles[k]);
        let points = points.collect::<Vec<_>>().join(" ");
        let _ = writeln!(page, "<polyline class=\"{class}\" stroke=\"{colour}\" points=\"{points}\"/>");
    }
    page.push_str("</svg>\n");
    for (curve, given) in plot.curves.iter().zip(&styles) {
        let (colour, class) = style(*given);
        let _ = writeln!(
            page,
            "<span class=\"key\"><svg width=\"26\" height=\"8\"><path class=\"{class}\" stroke=\"{colour}\" \
             d=\"M1 4H25\"/></svg><code>{}</code></span>",
            escaped(&curve.name)
        );
    }
    if is_cut {
        let [low, high] = [full.0, full.1].map(|value| number(format!("{value:.2e}").parse().unwrap_or(value)));
        let _ = writeln!(page, "<div>At the start the curves range from {low} to {high} (cut off here).</div>");
    }
    page.push_str("</figure>\n");
}

fn push_axes(page: &mut String, (low, high): (f64, f64), end: f64, x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) {
    let (across, up) = (step(end), step(high - low));
    let marks = |from: f64, to: f64, step: f64| {
        let first = (from / step).ceil() as i64;
        (first..).map(move |k| k as f64 * step).take_while(move |mark| *mark <= to * (1.0 + 1e-9))
    };
    let shown = |mark: f64| number(format!("{mark:.3e}").parse().unwrap_or(mark));
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - MARGIN);
    for mark in marks(low, high, up) {
        let at = y(mark);
        let _ = writeln!(
            page,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text class=\"soft\" x=\"{:.0}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            shown(mark)
        );
    }
    for mark in marks(0.0, end, across) {
        let at = x(mark);
        let text = if mark == 0.0 { "0 s".to_owned() } else { shown(mark) };
        let is_cut = at + 0.5 * DIGIT * text.chars().count() as f64 > WIDTH;
        let anchor = if is_cut { "end" } else { "middle" };
        let _ = writeln!(
            page,
            "<path class=\"grid\" d=\"M{at:.1} {MARGIN}V{bottom}\"/><text class=\"soft\" x=\"{at:.1}\" y=\"{:.0}\" \
             text-anchor=\"{anchor}\">{text}</text>",
            bottom + 16.0
        );
    }
}

/// Colours of curves, and true for dashed ones. References are dashed; if there are several followers, each reference
/// has the colour of its follower.
fn styles(curves: &[Curve]) -> Vec<(usize, bool)> {
    let several = curves.iter().filter(|curve| !curve.is_reference).count() > 1;
    // In a plot that begins with a reference, each reference is before its follower.
    let behind = usize::from(!curves.first().is_some_and(|curve| curve.is_reference));
    let (mut styles, mut next) = (Vec::new(), 0);
    for curve in curves {
        let dashed = curve.is_reference;
        let colour = if dashed && several { usize::max(next, behind) - behind } else { next };
        if !(dashed && several) {
            next += 1;
        }
        styles.push((colour, dashed));
    }
    styles
}

fn style((colour, dashed): (usize, bool)) -> (String, &'static str) {
    (format!("var(--c{})", colour % 6), if dashed { "curve dashed" } else { "curve" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_axes_are_round_numbers() {
        assert_eq!([1.0, 60.0, 0.37, 250.0].map(step), [0.5, 20.0, 0.1, 100.0]);
    }

    #[test]
    fn a_reference_has_the_colour_of_what_follows_it() {
        let curve = |name: &str| Curve {
            name: name.to_owned(),
            unit: "1".to_owned(),
            is_reference: !name.starts_with("plant."),
            points: Vec::new(),
        };
        let pairs = ["plant.y[1]", "reference.r[1]", "plant.y[2]", "reference.r[2]"].map(curve);
        assert_eq!(styles(&pairs), [(0, false), (0, true), (1, false), (1, true)]);
        let before = ["x_m1", "plant.y[1]", "x_m2", "plant.y[2]"].map(curve);
        assert_eq!(styles(&before), [(0, true), (0, false), (1, true), (1, false)]);
        let one = ["plant.y[1]", "y_m", "reference.r[1]"].map(curve);
        assert_eq!(styles(&one), [(0, false), (1, true), (2, true)]);
    }

    #[test]
    fn every_loop_that_does_not_fail_has_its_response() {
        for (name, files) in crate::exporter::loops() {
            let fails = files.iter().any(|(_, text)| text.contains("<ExpectedFailure"));
            let plots = response(name).map(read).unwrap_or_default();
            assert_eq!(plots.is_empty(), fails, "{name}");
            assert!(plots.iter().all(|plot| plot.curves.iter().all(|curve| curve.points.len() > 1)), "{name}");
        }
    }
}
