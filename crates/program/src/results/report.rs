//! The page of a run: plots that a reader can zoom, metrics and settings, in one file that loads nothing.

use std::fmt::Write;

use super::measured::{Measured, four_digits};
use super::table::TABLE;
use crate::drawing::escaped;
use crate::figures::{Diagram, beginning, diagrams, ending, push_diagrams};
use crate::simulation::Recording;
use crate::structure::{Settings, Structure};

/// Ending of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// It reached its stop time.
    Complete,
    /// The user interrupted it.
    Interrupted,
    /// An FMU failed, with the reason.
    Failed(String),
}

impl Ending {
    /// Value in JSON, for scripts.
    pub fn word(&self) -> &'static str {
        match self {
            Ending::Complete => "complete",
            Ending::Interrupted => "interrupted",
            Ending::Failed(_) => "failed",
        }
    }
}

/// A run, as its page shows it.
#[derive(Debug)]
pub struct Report<'a> {
    /// The loop.
    pub structure: &'a Structure,
    /// Settings of the run.
    pub settings: Settings,
    /// True if it was run as a single FMU, without an order of components.
    pub whole: bool,
    /// The recording, including ideal models.
    pub recording: &'a Recording,
    /// Its metrics.
    pub measured: &'a [Measured],
    /// Its ending.
    pub ending: &'a Ending,
    /// Thinning of the recording; none if it has all points.
    pub thinned: Option<Thinned>,
}

/// Thinning of a run: its diagrams use only some points, its metrics all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinned {
    /// Number of all its points.
    pub of: usize,
    /// Interval of its table's rows, s; none if all points are rows.
    pub every: Option<f64>,
}

impl Report<'_> {
    /// Time of the last recorded point in s: a multiple of the communication step, without its rounding error.
    pub fn end(&self) -> f64 {
        let end = self.recording.times.last().unwrap_or(&self.settings.start_time);
        (end * 1e9).round() / 1e9
    }

    /// Text on how an incomplete run ended; none for a complete one.
    pub fn shortfall(&self) -> Option<String> {
        let (end, stop) = (self.end(), self.settings.stop_time);
        match self.ending {
            Ending::Complete => None,
            Ending::Interrupted => Some(format!("was interrupted at t = {end} s of {stop} s")),
            Ending::Failed(reason) => Some(format!("failed at t = {end} s of {stop} s: {reason}")),
        }
    }

    /// The page, with its [diagrams](Report::diagrams).
    pub fn html(&self, diagrams: &[Diagram]) -> String {
        let Structure { name, description, .. } = self.structure;
        let mut page = beginning(name, description);
        if let Some(shortfall) = self.shortfall() {
            let _ = writeln!(page, "<p class=\"bad\">This run {}.</p>", escaped(&shortfall));
        }
        push_diagrams(&mut page, diagrams);
        self.push_thinned(&mut page);
        self.push_metrics(&mut page);
        self.push_warnings(&mut page);
        self.push_settings(&mut page);
        ending(&mut page);
        page
    }

    /// The diagrams of the run: those that its loop plots, and errors in their funnels.
    ///
    /// # Errors
    /// If one names a signal that isn't there.
    pub fn diagrams(&self) -> Result<Vec<Diagram<'_>>, String> {
        diagrams(self.structure, self.recording)
    }

    fn push_thinned(&self, page: &mut String) {
        let (Some(Thinned { of, every }), drawn) = (self.thinned, self.recording.times.len()) else { return };
        let rows = every.map_or_else(|| "has all points".to_owned(), |every| format!("has one row every {every} s"));
        let _ = writeln!(
            page,
            "<p id=\"thinned\">{drawn} of {of} points are drawn: from each group of neighbours, those at which a \
             curve is smallest or largest. {TABLE} {rows}; metrics use all points.</p>"
        );
    }

    fn push_metrics(&self, page: &mut String) {
        if self.measured.is_empty() {
            return;
        }
        let of = if *self.ending == Ending::Complete { "" } else { " until then" };
        let _ = writeln!(
            page,
            "<h2>Metrics{of}</h2>\n<div class=\"scroll\"><table id=\"metrics\">\n\
             <tr><th>metric<th class=\"number\">measured<th class=\"number\">limit<th>within its limit"
        );
        for metric in self.measured {
            let value = metric.value.map_or("–".to_owned(), four_digits);
            let limit = metric.limit.map_or(String::new(), |limit| limit.to_string());
            let holds = match metric.holds() {
                Some(true) => "<td>yes",
                Some(false) => "<td class=\"bad\">no",
                None => "<td>–",
            };
            let label = escaped(&metric.label);
            let _ = writeln!(page, "<tr><td>{label}<td class=\"number\">{value}<td class=\"number\">{limit}{holds}");
        }
        page.push_str("</table></div>\n");
    }

    fn push_warnings(&self, page: &mut String) {
        if self.recording.warnings.is_empty() {
            return;
        }
        page.push_str("<h2>Warnings</h2>\n<ul>\n");
        self.recording.warnings.iter().for_each(|warning| {
            let _ = writeln!(page, "<li>{}", escaped(warning));
        });
        page.push_str("</ul>\n");
    }

    fn push_settings(&self, page: &mut String) {
        let (Settings { start_time, stop_time, step }, order) = (self.settings, self.structure.order);
        let order = if self.whole { "none (loop as a single FMU)".to_owned() } else { order.to_string() };
        let _ = writeln!(
            page,
            "<h2>Settings</h2>\n<div class=\"scroll\"><table id=\"settings\">\n<tr><th>start<td>{start_time} s\n\
             <tr><th>until<td>{stop_time} s\n<tr><th>communication step<td>{step} s\n<tr><th>order<td>{order}"
        );
        for component in &self.structure.components {
            let values: Vec<_> = component.values.iter().map(|v| format!("{} = {}", v.name, v.text)).collect();
            let values = if values.is_empty() { String::new() } else { format!(" with {}", values.join(", ")) };
            let text = escaped(&format!("{}{values}", component.fmu));
            let _ = writeln!(page, "<tr><th>component {}<td>{text}", escaped(&component.name));
        }
        for event in &self.structure.events {
            let _ = writeln!(page, "<tr><th>event<td>{}", escaped(&event.written()));
        }
        let version = env!("CARGO_PKG_VERSION");
        let _ = writeln!(page, "<tr><th>generated by<td>adaptive-fmu {version}\n</table></div>");
    }
}
