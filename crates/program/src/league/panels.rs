//! Small multiples: a panel for each quantity, a row for each controller.

use std::fmt::Write;

use super::condition::Condition;
use super::margins::Bound;
use super::quantity::under;
use super::record::Record;
use super::study::Plant;
use crate::drawing::escaped;
use crate::results::four_digits;

/// Sizes in pixels.
const LABELS: f64 = 90.0;
const PANEL: f64 = 190.0;
const GAP: f64 = 24.0;
const ROW: f64 = 22.0;
const HEAD: f64 = 24.0;
const FOOT: f64 = 22.0;

/// A point of a panel with its interval; open if it is only a bound.
struct Mark {
    value: f64,
    interval: Option<[f64; 2]>,
    open: bool,
}

/// A panel: title, true for a logarithmic axis, and a mark for each row.
struct Panel {
    title: &'static str,
    logarithmic: bool,
    marks: Vec<Option<Mark>>,
}

/// A picture of the controllers of a plant: failures, errors, variation, dead time.
pub fn panels(plant: &Plant, records: &[&Record]) -> String {
    let all = [
        panel("random plants that fail", false, records, |record| {
            let (value, interval) = record.spread.as_ref()?.rate();
            Some(Mark { value, interval: Some(interval), open: false })
        }),
        panel("error, as a fraction of its limit", true, records, |record| {
            let (value, [low, high]) = record.spread.as_ref()?.median();
            Some(Mark { value: value?, interval: low.zip(high).map(|(low, high)| [low, high]), open: high.is_none() })
        }),
        panel("variation of the control, 1/s", true, records, |record| {
            Some(Mark { value: under(record, Condition::Bench)?.moved(plant), interval: None, open: false })
        }),
        panel("dead-time margin, s", true, records, |record| {
            let margin = record.margins?.dead_time;
            Some(Mark { value: margin.value, interval: None, open: margin.bound != Bound::Within })
        }),
    ];
    let (width, height) = (LABELS + all.len() as f64 * (PANEL + GAP), HEAD + ROW * records.len() as f64 + FOOT);
    let title = escaped(&format!("Controllers of the plant {}", plant.name));
    let mut svg =
        format!("<svg class=\"panels\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">\n");
    for (row, record) in records.iter().enumerate() {
        let (y, name) = (HEAD + ROW * (row as f64 + 0.5), escaped(&record.controller));
        let _ = writeln!(svg, "<text x=\"0\" y=\"{:.1}\">{name}</text>", y + 4.0);
    }
    for (k, panel) in all.iter().enumerate() {
        push_panel(&mut svg, panel, LABELS + k as f64 * (PANEL + GAP), records);
    }
    svg.push_str("</svg>\n");
    svg
}

fn panel(title: &'static str, logarithmic: bool, records: &[&Record], mark: impl Fn(&Record) -> Option<Mark>) -> Panel {
    Panel { title, logarithmic, marks: records.iter().map(|record| mark(record)).collect() }
}

fn push_panel(svg: &mut String, panel: &Panel, left: f64, records: &[&Record]) {
    let Panel { title, logarithmic, marks } = panel;
    let ends = marks.iter().flatten().flat_map(|mark| mark.interval.unwrap_or([mark.value; 2]));
    let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
    let scale = |value: f64| if *logarithmic { value.max(1e-12).log10() } else { value };
    let (low, high) = if *logarithmic { (scale(low) - 0.1, scale(high) + 0.1) } else { (0.0, high.max(0.01)) };
    let at = |value: f64| left + PANEL * ((scale(value) - low) / (high - low)).clamp(0.0, 1.0);
    let bottom = HEAD + ROW * marks.len() as f64;
    let _ = writeln!(svg, "<text x=\"{left}\" y=\"14\" class=\"title\">{title}</text>");
    let _ = writeln!(svg, "<path class=\"frame\" d=\"M{left},{HEAD}V{bottom}H{:.1}\"/>", left + PANEL);
    if low.is_finite() && high.is_finite() {
        let back = |scaled: f64| if *logarithmic { 10_f64.powf(scaled) } else { scaled };
        for (value, anchor, x) in [(back(low), "start", left), (back(high), "end", left + PANEL)] {
            let y = bottom + 15.0;
            let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>", short(value));
        }
    }
    for (row, (mark, record)) in marks.iter().zip(records).enumerate() {
        let y = HEAD + ROW * (row as f64 + 0.5);
        let Some(Mark { value, interval, open }) = mark else {
            let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" class=\"none\">–</text>", left + 6.0, y + 4.0);
            continue;
        };
        let (x, name) = (at(*value), escaped(&format!("{}: {}", record.controller, four_digits(*value))));
        let class = if *open { "open" } else { "mark" };
        let _ = write!(svg, "<g><title>{name}</title>");
        if let Some([low, high]) = interval {
            let _ = write!(svg, "<path class=\"interval\" d=\"M{:.1},{y:.1}H{:.1}\"/>", at(*low), at(*high));
        }
        let _ = writeln!(svg, "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/></g>");
    }
}

/// A number with two digits.
fn short(value: f64) -> String {
    let text = format!("{value:.1e}");
    text.parse::<f64>().map_or(text, |rounded| format!("{rounded}"))
}
