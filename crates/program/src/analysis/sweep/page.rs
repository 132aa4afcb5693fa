//! The page of a sweep: metrics over the parameter or as maps, families of curves, and a table of all runs.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::{Axis, Point, Sweep};
use crate::drawing::escaped;
use crate::drawing::{CHARTS, Chart, Line, colours};
use crate::figures::{beginning, ending, time_label, value_label};
use crate::report::number;
use crate::results::four_digits;
use crate::structure::Plot;

/// Style of the charts and maps of this page, in addition to that of every page.
const STYLE: &str = "
  .map td { text-align: right; padding: 0.3em 0.7em; border: 1px solid #fff; font-variant-numeric: tabular-nums; }
  .map .failed { text-align: center; background: #fff; color: #b00020; border: 1px dashed #b00020; }
  .map .over { font-weight: bold; text-decoration: underline; }
  .ramp { display: inline-block; width: 12em; height: 0.8em; vertical-align: middle; margin: 0 0.5em; }
";
/// The most rows of the table; further ones are in the CSV only.
const MOST_ROWS: usize = 1000;

/// The page of a sweep.
#[derive(Debug)]
pub struct SweepPage<'a> {
    /// The sweep.
    pub sweep: &'a Sweep,
    /// Its runs; none for those that were not made.
    pub points: &'a [Option<Point>],
    /// Name of the table in the same folder.
    pub table: &'a str,
}

impl SweepPage<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let structure = self.sweep.structure();
        let names: Vec<_> = self.sweep.axes().iter().map(|axis| axis.name.as_str()).collect();
        let title = format!("{} over {}", structure.name, names.join(" and "));
        let mut page = beginning(&title, &structure.description)
            .replace("</head>", &format!("<style>{CHARTS}{STYLE}</style>\n</head>"));
        let (made, failed) = (self.made().count(), self.made().filter(|(_, point)| point.failure.is_some()).count());
        let runs = self.sweep.runs();
        let _ = writeln!(page, "<p>{made} of {runs} runs, {failed} failed.</p>");
        if made < runs {
            page.push_str("<p class=\"bad\">The sweep was interrupted. Repeat the command to continue.</p>\n");
        }
        for (k, label) in self.sweep.metrics(self.points) {
            match self.sweep.axes() {
                [axis] => page.push_str(&self.over(axis, k, label)),
                [down, across] => page.push_str(&self.map(down, across, k, label)),
                _ => {}
            }
        }
        self.push_families(&mut page);
        self.push_table(&mut page);
        ending(&mut page);
        page
    }

    fn made(&self) -> impl Iterator<Item = (usize, &Point)> {
        self.points.iter().enumerate().filter_map(|(run, point)| Some((run, point.as_ref()?)))
    }

    fn limit(&self, metric: usize) -> Option<f64> {
        self.sweep.structure().metrics.get(metric)?.limit
    }

    /// A metric over the only parameter, with a gap where a run failed; empty for a parameter that isn't a number.
    fn over(&self, axis: &Axis, metric: usize, label: &str) -> String {
        if let Some(nothing) = self.unmeasured(metric, label) {
            return nothing;
        }
        let Some(numbers) = axis.numbers() else { return String::new() };
        let mut points: Vec<_> = (0..numbers.len())
            .map(|run| (numbers[run], self.points[run].as_ref().and_then(|point| point.metric(metric))))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, last) = (points[0].0, points[points.len() - 1].0);
        let mut lines = Vec::new();
        if let Some(limit) = self.limit(metric) {
            let (name, colour) = (format!("limit {limit}"), colours::LIMIT.to_owned());
            let points = vec![(first, Some(limit)), (last, Some(limit))];
            lines.push(Line { name, colour, points, marked: false, dashed: true });
        }
        let colour = colours::LINE.to_owned();
        lines.push(Line { name: label.to_owned(), colour, points, marked: true, dashed: false });
        let (x, y) = (self.sweep.with_unit(&axis.name), label.split(", ").next().unwrap_or(label));
        let mut svg = Chart { title: label, x: &x, y, logarithmic: axis.is_logarithmic(), lines }.svg();
        if let Some(limit) = self.limit(metric) {
            let _ = writeln!(svg, "<p>Dashed: its limit, {limit}.</p>");
        }
        svg
    }

    /// Text in place of a metric that no run has a value of.
    fn unmeasured(&self, metric: usize, label: &str) -> Option<String> {
        if self.made().any(|(_, point)| point.metric(metric).is_some()) {
            return None;
        }
        let reason = "runs failed, or ended before the time from which it is measured";
        Some(format!("<h2>{}</h2>\n<p>No run has a value of this metric: {reason}.</p>\n", escaped(label)))
    }

    /// A metric over two parameters: numbers on colours, the smallest is the darkest.
    fn map(&self, down: &Axis, across: &Axis, metric: usize, label: &str) -> String {
        if let Some(nothing) = self.unmeasured(metric, label) {
            return nothing;
        }
        let values: Vec<f64> = self.made().filter_map(|(_, point)| point.metric(metric)).collect();
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let mut map = format!("<h2>{}</h2>\n", escaped(label));
        if let Some(limit) = self.limit(metric) {
            let _ = writeln!(map, "<p>Underlined: beyond the limit {limit}.</p>");
        }
        let (name, other) = (escaped(&down.name), escaped(&across.name));
        let _ = write!(map, "<div class=\"scroll\"><table class=\"map\">\n<tr><th>{name} \\ {other}");
        across.values.iter().for_each(|value| _ = write!(map, "<th class=\"number\">{}", shown(value)));
        for (row, value) in down.values.iter().enumerate() {
            let _ = write!(map, "\n<tr><th class=\"number\">{}", shown(value));
            for column in 0..across.values.len() {
                let point = self.points[row * across.values.len() + column].as_ref();
                map.push_str(&self.cell(point, metric, (low, high)));
            }
        }
        map.push_str("\n</table></div>\n");
        if low < high {
            let stops: Vec<_> = [0.0, 0.5, 1.0].map(colours::at).into();
            let (low, high, stops) = (four_digits(low), four_digits(high), stops.join(", "));
            let gradient = format!("linear-gradient(to right, {stops})");
            let _ = writeln!(map, "<p>{low}<span class=\"ramp\" style=\"background: {gradient}\"></span>{high}</p>");
        }
        map
    }

    fn cell(&self, point: Option<&Point>, metric: usize, (low, high): (f64, f64)) -> String {
        let Some(point) = point else { return "<td class=\"failed\">not run".to_owned() };
        if let Some(reason) = &point.failure {
            return format!("<td class=\"failed\" title=\"{}\">failed", escaped(reason));
        }
        let Some(value) = point.metric(metric) else { return "<td class=\"failed\">–".to_owned() };
        let place = if high > low { (value - low) / (high - low) } else { 0.0 };
        let (colour, text) = (colours::at(place), colours::text_on(place));
        let over = if self.limit(metric).is_some_and(|limit| value > limit) { " class=\"over\"" } else { "" };
        format!("<td{over} style=\"background: {colour}; color: {text}\">{}", four_digits(value))
    }

    /// Curves of all runs that are drawn, coloured by their order from the first value to the last.
    fn push_families(&self, page: &mut String) {
        let drawn: Vec<_> = self.made().filter(|(_, point)| !point.curves.is_empty()).collect();
        if drawn.is_empty() {
            return;
        }
        let ramp: Vec<_> = [0.0, 0.5, 1.0].map(colours::at).into();
        let (from, to) = (self.values(0), self.values(self.sweep.runs() - 1));
        let _ = writeln!(
            page,
            "<h2>Curves of {} runs</h2>\n<p>{}<span class=\"ramp\" style=\"background: linear-gradient(to right, {})\">\
             </span>{} (a pointer on a curve shows its values)</p>",
            drawn.len(),
            escaped(&from),
            ramp.join(", "),
            escaped(&to)
        );
        for plot in &self.sweep.structure().plots {
            self.push_plot(page, plot, &drawn);
        }
    }

    /// Charts of the signals of a plot that differ between runs. Signals that are the same in all runs are added,
    /// dashed.
    fn push_plot(&self, page: &mut String, plot: &Plot, drawn: &[(usize, &Point)]) {
        let signals = self.sweep.signals();
        let of_plot = plot.signals.iter().filter_map(|name| signals.iter().position(|signal| signal == name));
        let is_same = |place: &usize| drawn.iter().all(|(_, point)| point.curves[*place] == drawn[0].1.curves[*place]);
        let (same, differing): (Vec<usize>, Vec<usize>) = of_plot.partition(is_same);
        let last = (self.sweep.runs() - 1).max(1) as f64;
        for place in differing {
            let line = |(run, point): &(usize, &Point)| Line {
                name: self.values(*run),
                colour: colours::at(*run as f64 / last),
                points: point.curves[place].clone(),
                marked: false,
                dashed: false,
            };
            let common = same.iter().map(|&place| Line {
                name: signals[place].to_owned(),
                colour: colours::COMPARED.to_owned(),
                points: drawn[0].1.curves[place].clone(),
                marked: false,
                dashed: true,
            });
            let lines = drawn.iter().map(line).chain(common).collect();
            let unit = self.sweep.unit(signals[place]);
            let (x, y) = (time_label(), value_label(&plot.title, &BTreeSet::from([unit.as_str()]), false));
            let chart = Chart { title: signals[place], x: &x, y: &y, logarithmic: false, lines };
            page.push_str(&chart.svg());
            if !same.is_empty() {
                let names: Vec<_> = same.iter().map(|&place| signals[place]).collect();
                let _ = writeln!(page, "<p>Dashed, the same in all runs: {}.</p>", escaped(&names.join(", ")));
            }
        }
    }

    /// The values of a run in words.
    fn values(&self, run: usize) -> String {
        let pairs = self.sweep.axes().iter().zip(self.sweep.values(run));
        pairs.map(|(axis, value)| format!("{} = {}", axis.name, shown(value))).collect::<Vec<_>>().join(", ")
    }

    fn push_table(&self, page: &mut String) {
        page.push_str("<h2>Runs</h2>\n<div class=\"scroll\"><table id=\"runs\">\n<tr>");
        let metrics: Vec<_> = self.sweep.metrics(self.points).collect();
        let labels = metrics.iter().map(|(_, label)| *label);
        for name in self.sweep.axes().iter().map(|axis| axis.name.as_str()).chain(labels) {
            let _ = write!(page, "<th class=\"number\">{}", escaped(name));
        }
        page.push_str("<th>run");
        for (run, point) in self.made().take(MOST_ROWS) {
            page.push_str("\n<tr>");
            let values = self.sweep.values(run).into_iter().map(shown);
            let metrics = metrics.iter().map(|(k, _)| point.metric(*k).map_or("–".to_owned(), four_digits));
            values.chain(metrics).for_each(|text| _ = write!(page, "<td class=\"number\">{}", escaped(&text)));
            match &point.failure {
                None => page.push_str("<td>complete"),
                Some(reason) => _ = write!(page, "<td class=\"bad\">failed: {}", escaped(reason)),
            }
        }
        page.push_str("\n</table></div>\n");
        if self.made().count() > MOST_ROWS {
            let _ = writeln!(page, "<p>All runs are in {}.</p>", escaped(self.table));
        }
    }
}

/// A value for readers: a number has seven digits.
fn shown(value: &str) -> String {
    value.parse().map_or_else(|_| value.to_owned(), number)
}
