//! The design report on an FMU's page.

use std::fmt::Write;

use super::escaped;
use crate::drawing::{KEY, push_pictures};
use crate::report::{DesignReport, Finding, Verdict};

/// Appends the report, unless it has no findings.
pub fn push(page: &mut String, report: &DesignReport) {
    if report.findings.is_empty() {
        return;
    }
    let verdict = match report.verdict() {
        Verdict::Ok => "Sound: all checks pass with the start values.",
        Verdict::Warning => "Sound, with warnings about the start values.",
        Verdict::NotSound => "Not sound with the start values: a condition of the design is not met or can't be shown.",
    };
    let reason = report.reason().map_or(String::new(), |reason| format!(" Reasons: {}.", escaped(&reason)));
    let summary = report.summary.as_ref();
    let summary = summary.map_or(String::new(), |summary| format!(" With the nominal plant: {}.", escaped(summary)));
    let _ = writeln!(page, "<h2 id=\"report\">Design report</h2>\n<p>{verdict}{summary}{reason}</p>");
    if !report.pictures.is_empty() {
        page.push_str(KEY);
        push_pictures(page, &report.pictures);
    }
    let mut section = None;
    for finding in &report.findings {
        if section != Some(&finding.section) {
            close(page, section);
            let title = escaped(&finding.section);
            let _ = writeln!(page, "<h3>{title}</h3>\n<div class=\"scroll report\"><table>");
            section = Some(&finding.section);
        }
        push_finding(page, finding);
    }
    close(page, section);
}

fn close(page: &mut String, section: Option<&String>) {
    if section.is_some() {
        page.push_str("</table></div>\n");
    }
}

fn push_finding(page: &mut String, finding: &Finding) {
    let Finding { name, value, unit, verdict, note, .. } = finding;
    let verdict = if *verdict == Verdict::Ok { String::new() } else { format!("<b>{}</b>: ", verdict.text()) };
    let [name, value, unit, note] = [name, &value.lines().join("\n"), unit, note].map(|text| escaped(text));
    let _ = writeln!(page, "<tr><td>{name}<td>{value}<td>{unit}<td>{verdict}{note}");
}
