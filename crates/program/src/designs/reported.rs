//! Design reports: with results of the FMUs' loop, and as text.

use std::ops::Deref;

use super::series::Followed;
use super::worst_case::{Steps, steps};
use crate::design::digits;
use crate::error::Error;
use crate::exporter::Source;
use crate::fmu::Ready;
use crate::model::Description;
use crate::report::{DesignReport, Finding, Verdict};
use crate::system::NO_LIMIT;
use crate::template::three_digits;

/// Widths of the columns of names, and of values that have a note in the same line.
const NAME: usize = 34;
const VALUE: usize = 30;
/// An output that ends farther from its reference, in parts of it, is worth a word.
const FAR: f64 = 0.01;
/// And one that ends even farther is worth a warning.
const MOST_OFF: f64 = 0.05;

/// Adds results of the FMUs' loop that the report of a description lacks: for kinds whose loop isn't linear, and where
/// limits act. FMUs are asked for only if one of them runs.
pub fn add_runs<U: Deref<Target = Ready>>(
    source: &Source,
    report: &mut DesignReport,
    units: impl FnOnce() -> Result<U, Error>,
) {
    let is_beyond = |finding: &Finding| finding.name.starts_with("range of ") && finding.verdict == Verdict::Warning;
    let acts = report.findings.iter().any(is_beyond);
    let has_plant = Description::read(&source.text).is_ok_and(|description| description.nominal.is_some());
    if !has_plant || report.summary.is_some() && !acts {
        return;
    }
    // The nominal verdict of a kind whose loop isn't linear is this one.
    let if_wrong = if report.summary.is_some() { Verdict::Warning } else { Verdict::NotSound };
    let ran = units().and_then(|units| steps(source, &units));
    report.section("Loop of the FMUs");
    match ran {
        Ok(Some(steps)) => report_steps(&steps, if_wrong, report),
        // Names of its own, by which nothing is connected.
        Err(Error::Loop { .. }) => {}
        Ok(None) if report.summary.is_some() => {}
        Ok(None) => {
            let note = "it takes too long for `check`. Use `new loop` and `run`";
            report.add("nominal loop", "not run", "", note);
        }
        Err(reason) => {
            let note = format!("simulated with its limits and its communication step: {reason}");
            report.judge("nominal loop", "fails", "", if_wrong, note);
        }
    }
}

fn report_steps(steps: &Steps, if_wrong: Verdict, report: &mut DesignReport) {
    let Steps { followed: Followed { settling, overshoot, off, peaks, .. }, controls, duration, .. } = steps;
    let at_limit: Vec<_> = controls.iter().zip(peaks).filter(|((_, limit), peak)| **peak >= 0.999 * limit).collect();
    let limited = at_limit.iter().map(|((name, _), _)| name.as_str()).collect::<Vec<_>>().join(", ");
    match settling {
        Some(time) => {
            let note = "to 2 % of a step of the reference, with the nominal plant, the limits of the control and the communication step";
            report.add("settling time", three_digits(*time), "s", note);
        }
        // A control at its limit makes a loop slow; without that, it isn't stable or has no rest.
        None if !limited.is_empty() => {
            let note = format!(
                "within {} s, with {limited} at a limit: use a smaller --reference or a lower --bandwidth",
                digits(*duration)
            );
            report.judge("settling time", "does not settle", "", Verdict::Warning, note);
        }
        None => {
            let note = format!(
                "within {} s with the nominal plant: use another --bandwidth or another kind",
                digits(*duration)
            );
            report.judge("settling time", "does not settle", "", if_wrong, note);
        }
    }
    report.add("overshoot", three_digits(100.0 * overshoot), "%", "beyond the reference");
    let rest = three_digits(100.0 * off);
    match limited.as_str() {
        _ if *off <= MOST_OFF => report.add("at rest", rest, "%", "distance from the reference"),
        "" => report.judge("at rest", rest, "%", Verdict::Warning, "distance from the reference: steady-state error"),
        limited => {
            let note = format!("distance from the reference, with {limited} at a limit: use a smaller --reference");
            report.judge("at rest", rest, "%", Verdict::Warning, note);
        }
    }
    let peak = |((name, limit), peak): (&(String, f64), &f64)| {
        let of = if *limit < NO_LIMIT { format!(" of {}", digits(*limit)) } else { String::new() };
        format!("peak of {name} {}{of}", digits(*peak))
    };
    let words = controls.iter().zip(peaks).map(peak).collect::<Vec<_>>().join(", ");
    controls.iter().zip(peaks).for_each(|((name, _), peak)| {
        report.add(&format!("peak of {name}"), three_digits(*peak), "", "largest size");
    });
    summarise(steps, &words, report);
}

/// The first line: what the loop does, and that other plants weren't tried where there are any.
fn summarise(steps: &Steps, peaks: &str, report: &mut DesignReport) {
    let Followed { settling, overshoot, off, .. } = &steps.followed;
    let settles = settling.map_or("does not settle".to_owned(), |time| format!("settles in {} s", digits(time)));
    let rests = if *off > FAR { format!(", ends {} % from the reference", digits(100.0 * off)) } else { String::new() };
    let words = format!("{settles}, overshoot {} %{rests}", digits(100.0 * overshoot));
    let summary = match report.summary.take() {
        Some(summary) => format!("{summary}; with the limits of the control: {words}"),
        None if steps.has_others => {
            let note = "only the nominal plant was simulated; --worst-case SECONDS simulates others";
            report.add("uncertain plants", "not tried", "", note);
            format!("{words}, {peaks}; other plants not tried")
        }
        None => format!("{words}, {peaks}"),
    };
    report.summarise(summary);
}

/// A report in lines; the first one is a summary.
pub fn lines(name: &str, report: &DesignReport) -> String {
    if report.findings.is_empty() {
        return format!("{name}: all values are within their limits; there is nothing else to check");
    }
    let reason = report.reason().map_or(String::new(), |reason| format!(": {reason}"));
    // What was tried with a plant is sound, where else nothing speaks against it.
    let verdict = match report.verdict() {
        Verdict::Ok if report.summary.is_some() => "sound",
        verdict => verdict.text(),
    };
    let summary = report.summary.as_ref().map_or(String::new(), |summary| format!(": {summary}"));
    let mut lines = vec![format!("{name}: {verdict}{summary}{reason}")];
    let mut section = None;
    for finding in &report.findings {
        if section != Some(&finding.section) {
            lines.push(format!("\n{}", finding.section));
            section = Some(&finding.section);
        }
        lines.extend(finding_lines(finding));
    }
    lines.join("\n")
}

fn finding_lines(Finding { name, value, unit, verdict, note, .. }: &Finding) -> Vec<String> {
    let lines = value.lines();
    let line = |(k, line): (usize, &String)| {
        let name = if k == 0 { name.as_str() } else { "" };
        let value = format!("{line} {unit}");
        let comment = if k == 0 && *verdict == Verdict::Ok { note.as_str() } else { "" };
        format!("  {name:NAME$} {value:VALUE$} {comment}").trim_end().to_owned()
    };
    let mut rows: Vec<_> = lines.iter().enumerate().map(line).collect();
    if *verdict != Verdict::Ok {
        rows.push(format!("    {}: {note}", verdict.text()));
    }
    rows
}
