//! Runs of several loops on one page: what all of them measure, in one table and in common diagrams.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::page::{Curve, Report, beginning, diagram, ending};
use super::ssp::{Funnel, Metric};
use crate::exporter::escaped;

/// Runs side by side, one at least.
#[derive(Debug)]
pub struct Comparison<'a> {
    /// The runs.
    pub runs: Vec<Report<'a>>,
}

/// What all runs measure of: a signal, what is subtracted from it, and the funnel that the difference is to stay in.
struct Compared<'a> {
    of: &'a str,
    minus: Option<&'a str>,
    funnel: Option<Funnel>,
}

impl Comparison<'_> {
    /// The metrics of all runs: label, and a value a run.
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
        let number = |value: &Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.5}"));
        let width = self.runs.iter().map(|run| run.structure.name.len()).max().unwrap_or(0).max(12);
        let names: Vec<_> = self.runs.iter().map(|run| format!("{:>width$}", run.structure.name)).collect();
        let mut text = format!("{:32} {}\n", "", names.join(" "));
        for (label, values) in self.metrics() {
            let values: Vec<_> = values.iter().map(|value| format!("{:>width$}", number(value))).collect();
            let _ = writeln!(text, "{label:32} {}", values.join(" "));
        }
        text
    }

    /// The page.
    ///
    /// # Errors
    /// When a metric names a signal that isn't there.
    pub fn html(&self) -> Result<String, String> {
        let names: Vec<_> = self.runs.iter().map(|run| run.structure.name.as_str()).collect();
        let mut page = beginning(&names.join(", "), "Compared: what all of these loops measure.");
        for run in &self.runs {
            let (name, description) = (escaped(&run.structure.name), escaped(&run.structure.description));
            let _ = writeln!(page, "<p><b>{name}</b>: {description}</p>");
            if let Some(shortfall) = run.shortfall() {
                let _ = writeln!(page, "<p class=\"bad\">The run of {name} {}.</p>", escaped(&shortfall));
            }
        }
        for compared in self.compared() {
            let unit = self.runs[0].recording.measure(compared.of);
            let units = Vec::from_iter(unit);
            page.push_str(&diagram(compared.of, &self.signals(&compared)?, &units));
            if let (Some(minus), Some(funnel)) = (compared.minus, compared.funnel) {
                let title = format!("{} − {minus} in its funnel", compared.of);
                page.push_str(&diagram(&title, &self.errors(&compared, minus, funnel)?, &units));
            }
        }
        self.push_metrics(&mut page);
        ending(&mut page);
        Ok(page)
    }

    /// What the metrics of every run are about, in the order of the first.
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

    fn signals(&self, Compared { of, minus, .. }: &Compared) -> Result<Vec<Curve>, String> {
        let mut curves = Vec::new();
        for run in &self.runs {
            curves.push(Curve::new(&run.structure.name, &run.recording.times, column(run, of)?));
        }
        if let Some(minus) = minus {
            let first = &self.runs[0];
            curves.push(Curve::new(minus, &first.recording.times, column(first, minus)?).dashed());
        }
        Ok(curves)
    }

    fn errors(&self, Compared { of, .. }: &Compared, minus: &str, funnel: Funnel) -> Result<Vec<Curve>, String> {
        let mut curves = Vec::new();
        for run in &self.runs {
            let pairs = column(run, of)?.iter().zip(column(run, minus)?);
            let errors: Vec<f64> = pairs.map(|(of, minus)| of - minus).collect();
            curves.push(Curve::new(&run.structure.name, &run.recording.times, &errors));
        }
        let times = &self.runs[0].recording.times;
        let start = times.first().copied().unwrap_or_default();
        for (name, sign) in [("rho", 1.0), ("-rho", -1.0)] {
            let bound: Vec<f64> = times.iter().map(|time| sign * funnel.at(time - start)).collect();
            curves.push(Curve::new(name, times, &bound).dashed());
        }
        Ok(curves)
    }

    fn push_metrics(&self, page: &mut String) {
        page.push_str("<h2>Metrics</h2>\n<div class=\"scroll\"><table id=\"metrics\">\n<tr><th>metric");
        for run in &self.runs {
            let _ = write!(page, "<th class=\"number\">{}", escaped(&run.structure.name));
        }
        for (label, values) in self.metrics() {
            let _ = write!(page, "\n<tr><td>{}", escaped(&label));
            for value in values {
                let value = value.map_or("–".to_owned(), |value| format!("{value:.5}"));
                let _ = write!(page, "<td class=\"number\">{value}");
            }
        }
        page.push_str("\n</table></div>\n");
    }
}

fn column<'a>(run: &'a Report, name: &str) -> Result<&'a [f64], String> {
    let column = run.recording.column(name);
    column.ok_or_else(|| format!("{}: there is no signal `{name}`", run.structure.name))
}
