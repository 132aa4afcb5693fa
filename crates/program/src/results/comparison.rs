//! Runs of several loops on one page: their common metrics, in one table and in common diagrams.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write;

use super::measured::four_digits;
use super::report::Report;
use crate::drawing::escaped;
use crate::figures::{Diagram, Given, Part, Shown, beginning, bound, ending, push_diagrams, time_label};
use crate::structure::{Metric, PerformanceFunction, Scale};

/// At least one run, side by side.
#[derive(Debug)]
pub struct Comparison<'a> {
    /// The runs.
    pub runs: Vec<Report<'a>>,
    /// Their names in tables and diagrams.
    pub labels: Vec<String>,
}

/// Largest width of the table, in characters.
const WIDTH: usize = 100;
/// Largest widths of the first column and of a run's column, and the smallest of a run's.
const WIDEST: (usize, usize) = (44, 24);
const NARROWEST: usize = 12;

/// Subject of a metric of all runs: a signal, its reference, and the funnel for the difference.
struct Compared<'a> {
    of: &'a str,
    minus: Option<&'a str>,
    funnel: Option<PerformanceFunction>,
}

impl Comparison<'_> {
    fn named(&self) -> impl Iterator<Item = (&Report<'_>, &str)> {
        self.runs.iter().zip(self.labels.iter().map(String::as_str))
    }

    /// The metrics of all runs: label, and a value for each run.
    pub fn metrics(&self) -> Vec<(String, Vec<Option<f64>>)> {
        let mut rows: Vec<(String, Vec<Option<f64>>)> = Vec::new();
        for metric in self.runs.iter().flat_map(|run| run.measured) {
            if rows.iter().all(|(label, _)| *label != metric.label) {
                let value = |run: &Report| run.measured.iter().find(|other| other.label == metric.label)?.value;
                rows.push((metric.label.clone(), self.runs.iter().map(value).collect()));
            }
        }
        rows
    }

    /// The table of metrics for a terminal.
    pub fn table(&self) -> String {
        let number = |value: &Option<f64>| value.map_or("–".to_owned(), four_digits);
        let wide = |text: &str| text.chars().count();
        let metrics = self.metrics();
        let mut text = String::new();
        // Long names are listed above it, and numbered within.
        let is_long = self.labels.iter().any(|label| wide(label) > WIDEST.1);
        let numbered = |place: usize| if is_long { format!("({})", place + 1) } else { self.labels[place].clone() };
        let names: Vec<String> = (0..self.runs.len()).map(numbered).collect();
        for (name, label) in names.iter().zip(&self.labels).filter(|_| is_long) {
            let _ = writeln!(text, "{name} {label}");
        }
        let first = metrics.iter().map(|(label, _)| wide(label)).max().unwrap_or(0).min(WIDEST.0);
        let width = names.iter().map(|name| wide(name)).max().unwrap_or(0).max(NARROWEST);
        // As many runs side by side as fit; a long label gets a separate line.
        let places: Vec<usize> = (0..names.len()).collect();
        for places in places.chunks(((WIDTH - first) / (width + 1)).max(1)) {
            let cells = |of: &dyn Fn(usize) -> String| -> String {
                places.iter().map(|&place| format!(" {:>width$}", of(place))).collect()
            };
            let _ = writeln!(text, "{:first$}{}", "", cells(&|place| names[place].clone()));
            for (label, values) in &metrics {
                let begin =
                    if wide(label) > first { format!("{label}\n{:first$}", "") } else { format!("{label:first$}") };
                let _ = writeln!(text, "{begin}{}", cells(&|place| number(&values[place])));
            }
        }
        text
    }

    /// The page.
    ///
    /// # Errors
    /// If a metric names a signal that isn't there.
    pub fn html(&self) -> Result<String, String> {
        let mut page = beginning(&self.labels.join(", "), "Metrics that all of these loops have.");
        for (run, label) in self.named() {
            let (name, description) = (escaped(label), escaped(&run.structure.description));
            let _ = writeln!(page, "<p><b>{name}</b>: {description}</p>");
            if let Some(shortfall) = run.shortfall() {
                let _ = writeln!(page, "<p class=\"bad\">The run of {name} {}.</p>", escaped(&shortfall));
            }
        }
        push_diagrams(&mut page, &self.diagrams()?);
        self.push_metrics(&mut page);
        ending(&mut page);
        Ok(page)
    }

    /// A diagram for each signal of a common metric, and for errors in their funnels.
    ///
    /// # Errors
    /// If a metric names a signal that isn't there.
    pub fn diagrams(&self) -> Result<Vec<Diagram<'_>>, String> {
        let mut diagrams = Vec::new();
        for compared in self.compared() {
            diagrams.push(self.signals(&compared)?);
            if let (Some(minus), Some(funnel)) = (compared.minus, compared.funnel) {
                diagrams.push(self.errors(&compared, minus, funnel)?);
            }
        }
        Ok(diagrams)
    }

    /// The subjects of metrics that every run has, in the order of the first run.
    fn compared(&self) -> Vec<Compared<'_>> {
        let key = |metric: &Metric| (metric.of.clone(), metric.minus.clone());
        let known = |run: &Report, metric: &Metric| run.structure.metrics.iter().any(|other| key(other) == key(metric));
        let metrics = || self.runs[0].structure.metrics.iter();
        let with_funnel = metrics().filter_map(|metric| metric.funnel.map(|funnel| (key(metric), funnel)));
        let funnels: BTreeMap<_, _> = with_funnel.collect();
        let mut found: Vec<Compared> = Vec::new();
        for metric in metrics().filter(|metric| self.runs.iter().all(|run| known(run, metric))) {
            let (of, minus) = (metric.of.as_str(), metric.minus.as_deref());
            if found.iter().all(|other| (other.of, other.minus) != (of, minus)) {
                found.push(Compared { of, minus, funnel: funnels.get(&key(metric)).copied() });
            }
        }
        found
    }

    fn signals(&self, Compared { of, minus, .. }: &Compared) -> Result<Diagram<'_>, String> {
        let mut given = Vec::new();
        for (run, label) in self.named() {
            given.push(curve(run, label, Part::Own, Shown::signal(of), Cow::Borrowed(column(run, of)?)));
        }
        if let Some(minus) = minus {
            let first = &self.runs[0];
            let values = Cow::Borrowed(column(first, minus)?);
            given.push(curve(first, minus, Part::Reference, Shown::signal(minus), values));
        }
        Ok(Diagram::new(of, &time_label(), Scale::Linear, given))
    }

    fn errors(
        &self,
        Compared { of, .. }: &Compared,
        minus: &str,
        funnel: PerformanceFunction,
    ) -> Result<Diagram<'_>, String> {
        let mut given = Vec::new();
        for (run, label) in self.named() {
            let pairs = column(run, of)?.iter().zip(column(run, minus)?);
            let errors = pairs.map(|(of, minus)| (of - minus).abs()).collect();
            let shown = Shown { minus: Some(minus.to_owned()), magnitude: true, ..Shown::signal(of) };
            given.push(curve(run, label, Part::Own, shown, errors));
        }
        given.push(bound(funnel, &self.runs[0].recording.times));
        let title = format!("|{of} − {minus}| in its funnel");
        Ok(Diagram::new(&title, &time_label(), Scale::Logarithmic, given))
    }

    fn push_metrics(&self, page: &mut String) {
        page.push_str("<h2>Metrics</h2>\n<div class=\"scroll\"><table id=\"metrics\">\n<tr><th>metric");
        for label in &self.labels {
            let _ = write!(page, "<th class=\"number label\">{}", escaped(label));
        }
        for (label, values) in self.metrics() {
            let _ = write!(page, "\n<tr><td>{}", escaped(&label));
            for value in values {
                let value = value.map_or("–".to_owned(), four_digits);
                let _ = write!(page, "<td class=\"number\">{value}");
            }
        }
        page.push_str("\n</table></div>\n");
    }
}

/// A curve of a run, with the unit of its signal.
fn curve<'a>(run: &'a Report, name: &str, part: Part, shown: Shown, values: Cow<'a, [f64]>) -> Given<'a> {
    let unit = shown.of.as_deref().and_then(|of| run.recording.measure(of)).unwrap_or_default().to_owned();
    let times = Cow::Borrowed(run.recording.times.as_slice());
    Given { name: name.to_owned(), unit, part, shown, times, values }
}

fn column<'a>(run: &'a Report, name: &str) -> Result<&'a [f64], String> {
    let column = run.recording.column(name);
    column.ok_or_else(|| format!("{}: there is no signal `{name}`", run.structure.name))
}
