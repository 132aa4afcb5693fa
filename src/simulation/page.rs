//! The page of a run: plots that a reader can zoom, metrics and settings, in one file that loads nothing.

use std::fmt::Write;

use plotly::color::Rgb;
use plotly::common::{Anchor, DashType, Line, Mode, Orientation, Title};
use plotly::layout::{Axis, HoverMode, Legend, Margin};
use plotly::{Configuration, Layout, Scatter};

use super::chart::COLOURS;
use super::closed_loop::{Recording, Settings};
use super::metrics::Measured;
use super::ssp::{Plot, Structure};
use super::thinned::thinned;
use crate::exporter::escaped;

/// Groups of points in a curve: about one a pixel of a wide screen.
const GROUPS: usize = 1500;
/// A browser that obeys this loads nothing from anywhere.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:";
/// How pages look.
pub const STYLE: &str = "
  body { font: 16px/1.5 system-ui, sans-serif; max-width: 75em; margin: 1.5em auto; padding: 0 1em; color: #1b1b1b; }
  h1 { font-size: 1.5em; margin-bottom: 0; }
  h2 { font-size: 1.1em; margin: 1.5em 0 .3em; }
  table { border-collapse: collapse; }
  td, th { border-bottom: 1px solid #ddd; padding: .25em 1.2em .25em 0; text-align: left; vertical-align: top; }
  .number { text-align: right; font-variant-numeric: tabular-nums; }
  .scroll { overflow-x: auto; }
  .plot { height: 400px; }
  .bad { color: #b00020; font-weight: bold; }
  @media print { body { margin: 0; font-size: 12px; } .plot, table { break-inside: avoid; } .modebar { display: none; } }
";
/// All plots show the same time; on paper they are as wide as the paper.
const SCRIPT: &str = "
const plots = [...document.querySelectorAll('.plotly-graph-div')];
const follow = plot => plots.forEach(other => {
  const range = plot.layout.xaxis.range, shown = other.layout.xaxis.range;
  if (range[0] !== shown[0] || range[1] !== shown[1]) Plotly.relayout(other, {'xaxis.range': [...range]});
});
plots.forEach(plot => plot.on('plotly_relayout', () => follow(plot)));
const print = width => plots.forEach(plot => Plotly.relayout(plot, {width: width, autosize: !width}));
addEventListener('beforeprint', () => print(680));
addEventListener('afterprint', () => print(null));
";
/// Travels with plotly.js, as its licence asks.
const LICENCE: &str = "The script below is plotly.js, under the MIT licence:

Copyright 2012-2025, Plotly, Inc.

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
documentation files (the \"Software\"), to deal in the Software without restriction, including without limitation the
rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
persons to whom the Software is furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
Software.

THE SOFTWARE IS PROVIDED \"AS IS\", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.";

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

    /// The page.
    ///
    /// # Errors
    /// When a plot names a signal that isn't there.
    pub fn html(&self) -> Result<String, String> {
        let Structure { name, description, plots, .. } = self.structure;
        let mut page = beginning(name, description);
        if let Some(shortfall) = self.shortfall() {
            let _ = writeln!(page, "<p class=\"bad\">This run {}.</p>", escaped(&shortfall));
        }
        for (number, plot) in plots.iter().enumerate() {
            let drawn = self.plot(plot)?.to_inline_html(Some(&format!("plot{number}")));
            let _ = writeln!(page, "<h2>{}</h2>\n<div class=\"plot\">{drawn}</div>", escaped(&plot.title));
        }
        self.push_metrics(&mut page);
        self.push_warnings(&mut page);
        self.push_settings(&mut page);
        ending(&mut page);
        Ok(page)
    }

    fn plot(&self, plot: &Plot) -> Result<plotly::Plot, String> {
        let unit = |name: &String| self.recording.measure(name);
        let mut units: Vec<&str> = plot.signals.iter().filter_map(unit).collect();
        units.sort_unstable();
        units.dedup();
        let mut curves = Vec::new();
        for name in &plot.signals {
            let column = self.recording.column(name).ok_or_else(|| format!("there is no signal `{name}`"))?;
            // With units of several kinds in one plot, each curve tells its own.
            let label = match unit(name) {
                Some(unit) if units.len() > 1 => format!("{name} in {unit}"),
                _ => name.clone(),
            };
            curves.push(Curve::new(&label, &self.recording.times, column));
        }
        Ok(drawn(&curves, &units))
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

/// A curve of a diagram.
pub(super) struct Curve {
    name: String,
    points: Vec<(f64, f64)>,
    dash: DashType,
}

impl Curve {
    /// Thinned, its peaks kept.
    pub fn new(name: &str, times: &[f64], values: &[f64]) -> Self {
        Curve { name: name.to_owned(), points: thinned(times, values, GROUPS), dash: DashType::Solid }
    }

    /// The same as a dashed line.
    pub fn dashed(self) -> Self {
        Curve { dash: DashType::Dash, ..self }
    }
}

/// A diagram of curves over time, whose values are in these units.
pub(super) fn drawn(curves: &[Curve], units: &[&str]) -> plotly::Plot {
    let mut plot = plotly::Plot::new();
    for (Curve { name, points, dash }, colour) in curves.iter().zip(COLOURS.iter().cycle()) {
        let (times, values) = points.iter().copied().unzip();
        let line = Line::new().color(Rgb::new(colour.0, colour.1, colour.2)).width(1.5).dash(dash.clone());
        plot.add_trace(Scatter::new(times, values).mode(Mode::Lines).name(escaped(name)).line(line));
    }
    plot.set_layout(layout(units));
    plot.set_configuration(Configuration::new().responsive(true).display_logo(false));
    plot
}

/// A page up to its title and what it is about.
pub(super) fn beginning(name: &str, description: &str) -> String {
    let (name, description) = (escaped(name), escaped(description));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n\
         <title>{name}</title>\n<style>{STYLE}</style>\n<!--\n{LICENCE}\n-->\n{}\n</head>\n<body>\n<h1>{name}</h1>\n\
         <p>{description}</p>\n",
        script()
    )
}

/// What makes the diagrams of a page move together, and its end.
pub(super) fn ending(page: &mut String) {
    let _ = writeln!(page, "<script>{SCRIPT}</script>\n</body>\n</html>");
}

/// plotly.js alone: the crate appends a script for formulas, which no plot here has, half as large again.
fn script() -> String {
    let scripts = plotly::Plot::offline_js_sources();
    let end = "</script>";
    scripts.split_inclusive(end).next().unwrap_or_default().to_owned()
}

fn layout(units: &[&str]) -> Layout {
    let value = match units {
        ["1"] => "value, no unit".to_owned(),
        [] => "value".to_owned(),
        units => format!("value in {}", units.join(", ")),
    };
    let title = |text: &str| Title::with_text(escaped(text));
    let legend = Legend::new().orientation(Orientation::Horizontal).x(0.0).y(-0.22).y_anchor(Anchor::Top);
    Layout::new()
        .auto_size(true)
        .show_legend(true)
        .legend(legend)
        .hover_mode(HoverMode::XUnified)
        .margin(Margin::new().left(64).right(16).top(32).bottom(48))
        .x_axis(Axis::new().title(title("t in s")))
        .y_axis(Axis::new().title(title(&value)))
}
