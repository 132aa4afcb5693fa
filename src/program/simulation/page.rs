//! The page of a run: plots that a reader can zoom, metrics and settings, in one file that loads nothing.

use std::fmt::Write;

use super::closed_loop::{Recording, Settings};
use super::diagram::{Diagram, diagrams, groups};
use super::metrics::Measured;
use super::recorded::TABLE;
use super::ssp::Structure;
use crate::exporter::escaped;

/// A browser that obeys this loads nothing from anywhere.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:";
/// A browser that obeys this loads nothing, and runs nothing.
const STILL: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";
/// How pages look.
pub const STYLE: &str = "
  body { font: 16px/1.5 system-ui, sans-serif; max-width: 75em; margin: 1.5em auto; padding: 0 1em; color: #1b1b1b; }
  h1 { font-size: 1.5em; margin-bottom: 0; }
  h2 { font-size: 1.1em; margin: 1.5em 0 .3em; }
  table { border-collapse: collapse; }
  td, th { border-bottom: 1px solid #ddd; padding: .25em 1.2em .25em 0; text-align: left; vertical-align: top; }
  .number { text-align: right; font-variant-numeric: tabular-nums; }
  .scroll { overflow-x: auto; }
  .bad { color: #b00020; font-weight: bold; }
  @media print { body { margin: 0; font-size: 12px; } .diagram, table { break-inside: avoid; } }
";
/// How diagrams look.
pub const DIAGRAMS: &str = "
  .diagram { display: flex; gap: .8em; }
  .plot { position: relative; flex: 1; min-width: 0; }
  .plot svg { display: block; overflow: hidden; user-select: none; touch-action: pan-y; cursor: crosshair; }
  .plot text { font-size: 12px; fill: #444; }
  .plot path { fill: none; }
  .plot .grid { stroke: #e4e4e4; }
  .plot .curve { stroke-width: 1.5; stroke-linejoin: round; }
  .plot .beneath { stroke-width: 3.2; stroke-opacity: .55; }
  .plot .mark { stroke: #888; }
  .plot .zoomed { fill: #0002; }
  .legend { flex: 0 0 15em; margin: .4em 0 0; display: flex; flex-direction: column; align-items: start; }
  .legend button, .peak { border: 0; padding: .15em 0; background: none; font: inherit; font-size: .85em; text-align: left;
    cursor: pointer; overflow-wrap: anywhere; }
  .legend svg { vertical-align: middle; margin-right: .5em; }
  .legend .hidden { opacity: .4; text-decoration: line-through; }
  .peak { display: block; margin-left: 76px; color: #0b5394; text-decoration: underline; }
  .peak[hidden] { display: none; }
  .told { position: absolute; top: 14px; padding: .1em .5em; background: #fffd; border: 1px solid #ccc; font-size: .8em;
    pointer-events: none; z-index: 1; }
  .told div::before { content: '\\25ac '; color: var(--colour); }
  @media (max-width: 50em) { .diagram { display: block; }
    .legend { flex-flow: row wrap; gap: 0 1.2em; margin: .2em 0 0 1em; } }
  @media print { .diagram { display: block; } .legend { flex-flow: row wrap; gap: 0 1.2em; } }
";
/// What draws the diagrams, and lets a reader zoom them.
pub const SCRIPT: &str = include_str!("page.js");

/// The beginning of a page that needs no script and loads nothing: title, what it is about, and how it looks beside what every
/// page has.
pub fn still(title: &str, about: &str, style: &str) -> String {
    let (title, about) = (escaped(title), escaped(about));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{STILL}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n<style>{STYLE}{style}</style>\n</head>\n\
         <body>\n<h1>{title}</h1>\n<p>{about}</p>\n"
    )
}

/// The end of such a page.
pub fn still_ending() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("<p>Made by adaptive-fmu {version}, from runs of FMUs.</p>\n</body>\n</html>\n")
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// At its stop time.
    Complete,
    /// Before it, because the user asked for it.
    Interrupted,
    /// Before it, because a unit failed: what it told.
    Failed(String),
}

impl Ending {
    /// In a word.
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
    /// How it was run.
    pub settings: Settings,
    /// Whether it was run as one unit: then there is no order of units.
    pub whole: bool,
    /// What was recorded, ideal models included.
    pub recording: &'a Recording,
    /// Its metrics.
    pub measured: &'a [Measured],
    /// How it ended.
    pub ending: &'a Ending,
    /// Which points were left out of the recording; none where it has all of them.
    pub thinned: Option<Thinned>,
}

/// A run of whose points some are kept for its diagrams, while all are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinned {
    /// Number of all its points.
    pub of: usize,
    /// How far the rows of its table lie apart, s; none where all points are rows.
    pub every: Option<f64>,
}

impl Report<'_> {
    /// Time of the last recorded point in s: a multiple of the communication step, without its rounding error.
    pub fn end(&self) -> f64 {
        let end = self.recording.times.last().unwrap_or(&self.settings.start_time);
        (end * 1e9).round() / 1e9
    }

    /// What is to be said of a run that did not come to its end; none of a complete one.
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
    /// When one names a signal that isn't there.
    pub fn diagrams(&self) -> Result<Vec<Diagram<'_>>, String> {
        diagrams(self.structure, self.recording)
    }

    fn push_thinned(&self, page: &mut String) {
        let (Some(Thinned { of, every }), kept) = (self.thinned, self.recording.times.len()) else { return };
        let rows = every.map_or_else(|| "has all points".to_owned(), |every| format!("has a row each {every} s"));
        let _ = writeln!(
            page,
            "<p id=\"thinned\">{kept} of {of} points are drawn: those of each group of neighbours in which a curve \
             is smallest or largest. {TABLE} {rows}; metrics are of all.</p>"
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
            let value = metric.value.map_or("–".to_owned(), |value| format!("{value:.5}"));
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
        let Settings { start_time, stop_time, step, order } = self.settings;
        let order = if self.whole { "none: the units are integrated as one".to_owned() } else { order.to_string() };
        let _ = writeln!(
            page,
            "<h2>Settings</h2>\n<div class=\"scroll\"><table id=\"settings\">\n<tr><th>start<td>{start_time} s\n\
             <tr><th>until<td>{stop_time} s\n<tr><th>communication step<td>{step} s\n<tr><th>order<td>{order}"
        );
        for component in &self.structure.components {
            let values: Vec<_> = component.values.iter().map(|v| format!("{} = {}", v.name, v.text)).collect();
            let values = if values.is_empty() { String::new() } else { format!(" with {}", values.join(", ")) };
            let text = escaped(&format!("{}{values}", component.fmu));
            let _ = writeln!(page, "<tr><th>unit {}<td>{text}", escaped(&component.name));
        }
        let version = env!("CARGO_PKG_VERSION");
        let _ = writeln!(page, "<tr><th>made by<td>adaptive-fmu {version}\n</table></div>");
    }
}

/// Adds diagrams to a page, each as the numbers that [`SCRIPT`] draws it of.
pub(super) fn push_diagrams(page: &mut String, diagrams: &[Diagram]) {
    let groups = groups(diagrams.iter().map(|diagram| diagram.curves.len()).sum());
    for diagram in diagrams {
        // Whatever a name holds, it ends no script.
        let numbers = diagram.with_points(groups).to_string().replace('<', "\\u003c");
        let _ = writeln!(
            page,
            "<h2>{}</h2>\n<div class=\"diagram\"><script type=\"application/json\">{numbers}</script></div>",
            escaped(&diagram.title)
        );
    }
}

/// A page up to its title and what it is about.
pub(super) fn beginning(name: &str, description: &str) -> String {
    let (name, description) = (escaped(name), escaped(description));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n\
         <title>{name}</title>\n<style>{STYLE}{DIAGRAMS}</style>\n</head>\n<body>\n<h1>{name}</h1>\n<p>{description}</p>\n"
    )
}

/// What draws the diagrams of a page, and its end.
pub(super) fn ending(page: &mut String) {
    let _ = writeln!(page, "<script>\n{SCRIPT}</script>\n</body>\n</html>");
}
