//! An identification as text, and its page, in one file that loads nothing: measured and simulated signals, residuals, and
//! poles and frequency responses with their uncertainty.

mod charts;
mod courses;
mod text;
mod units;

use std::fmt::Write;

use adaptive_fmu_identification::{Correlations, Model, Pole, SimulatedCourse, chi_squared, responses};

use charts::Figure;

pub use text::{finding_text, lines, meaning, text_of, written};
pub use units::convert;

use crate::drawing::{CHARTS, escaped};
use crate::figures::{beginning, ending, push_diagrams};
use crate::report::number;

/// The most signals of records that are shown.
const MOST_DIAGRAMS: usize = 40;
/// Charts are next to each other if there is space.
const STYLE: &str = "
  .charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(30em, 1fr)); gap: 0 1.5em; }
  figure { margin: 0.8em 0; }
  .charts .chart text { font-size: 18px; }
  figcaption { font-weight: bold; }
  @media (max-width: 50em) { .charts { grid-template-columns: 1fr; } }
";

/// A table of a page.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Title.
    pub title: String,
    /// Headings of the columns. The first column has names.
    pub heads: Vec<&'static str>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

/// A finding in words.
#[derive(Debug, Clone, PartialEq)]
pub struct FindingText {
    /// True if the model should not be used for a design.
    pub is_bad: bool,
    /// The finding.
    pub text: String,
}

/// An identification for its page.
#[derive(Debug)]
pub struct Report<'a> {
    /// Name of the model.
    pub name: &'a str,
    /// Method and records.
    pub about: String,
    /// Names of the measured signals with their units.
    pub signals: Vec<(String, String)>,
    /// Measured and simulated signals.
    pub courses: &'a [SimulatedCourse],
    /// Fits, entries.
    pub tables: Vec<Table>,
    /// Findings.
    pub findings: Vec<FindingText>,
    /// The linear model, if any.
    pub model: Option<&'a Model>,
    /// Its poles.
    pub poles: &'a [Pole],
    /// Correlations of the residuals, if known.
    pub correlations: Option<&'a Correlations>,
    /// Start of each window of the held-out part, and the disturbance as inputs there.
    pub disturbance: &'a [(f64, Vec<f64>)],
}

impl Report<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let mut page =
            beginning(self.name, &self.about).replace("</head>", &format!("<style>{CHARTS}{STYLE}</style>\n</head>"));
        for FindingText { is_bad, text } in &self.findings {
            let class = if *is_bad { " class=\"bad\"" } else { "" };
            let _ = writeln!(page, "<p{class}>{}</p>", escaped(text));
        }
        self.tables.iter().for_each(|table| table.push(&mut page));
        let mut diagrams = self.diagrams();
        let left_out = diagrams.len().saturating_sub(MOST_DIAGRAMS);
        diagrams.truncate(MOST_DIAGRAMS);
        diagrams.extend(self.disturbances());
        push_diagrams(&mut page, &diagrams);
        if left_out > 0 {
            let _ = writeln!(page, "<p>{left_out} more signals of records are not shown.</p>");
        }
        self.push_poles(&mut page);
        self.push_responses(&mut page);
        self.push_correlations(&mut page);
        ending(&mut page);
        page
    }

    fn push_poles(&self, page: &mut String) {
        let Some(model) = self.model.filter(|_| !self.poles.is_empty()) else { return };
        let text = format!(
            "Each ellipse, or dashed interval of a real pole, contains its pole with {} % confidence (first order).",
            number(100.0 * model.level)
        );
        push(page, "Poles", &text, vec![charts::poles(self.poles, model.level)]);
    }

    fn push_responses(&self, page: &mut String) {
        let Some(model) = self.model else { return };
        let errors = chi_squared(model.level, 1).sqrt();
        let all: Vec<_> = responses(model).iter().flat_map(|response| charts::bode(response, model, errors)).collect();
        let text = format!(
            "Dashed: bounds at each frequency with {} % confidence (first order). The highest frequency is the Nyquist \
             frequency.",
            number(100.0 * model.level)
        );
        push(page, "Frequency responses", &text, all);
    }

    fn push_correlations(&self, page: &mut String) {
        let (Some(found), Some(model)) = (self.correlations, self.model) else { return };
        let names: Vec<&str> = self.signals.iter().map(|(name, _)| name.as_str()).collect();
        let text = "Dashed: limits for 99 % of the values of white noise. Residuals correlated with earlier inputs show a delay, or \
                    dynamics that the model lacks.";
        push(page, "Residuals", text, charts::correlations(found, &names, &model.inputs));
    }
}

impl Table {
    fn push(&self, page: &mut String) {
        let heads = self.heads.iter().enumerate().map(|(k, head)| format!("<th{}>{}", class(k), escaped(head)));
        let _ = writeln!(
            page,
            "<h2>{}</h2>\n<div class=\"scroll\"><table>\n<tr>{}",
            escaped(&self.title),
            heads.collect::<String>()
        );
        for row in &self.rows {
            let cells = row.iter().enumerate().map(|(k, cell)| format!("<td{}>{}", class(k), escaped(cell)));
            let _ = writeln!(page, "<tr>{}", cells.collect::<String>());
        }
        page.push_str("</table></div>\n");
    }
}

/// Numbers are aligned at the right.
fn class(column: usize) -> &'static str {
    if column == 0 { "" } else { " class=\"number\"" }
}

/// Adds a part of a page, if it has charts.
fn push(page: &mut String, title: &str, text: &str, all: Vec<Figure>) {
    if all.is_empty() {
        return;
    }
    let _ = writeln!(page, "<h2>{title}</h2>\n<p>{}</p>\n<div class=\"charts\">", escaped(text));
    for figure in all {
        let title = escaped(&figure.title);
        let _ = writeln!(page, "<figure><figcaption>{title}</figcaption>\n{}</figure>", figure.drawing());
    }
    page.push_str("</div>\n");
}
