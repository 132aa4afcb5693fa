//! Overview of several runs: a verdict and a row for each.

use std::fmt::Write;
use std::time::Duration;

use super::measured::{Measured, four_digits};
use super::report::{Ending, Report};

/// Largest width of the table, in characters; longer rows continue below.
const WIDTH: usize = 120;

/// Verdict on a run, from the best to the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// It ended as expected, with no metric beyond its limit.
    Holds,
    /// A metric is beyond its limit, or an expected failure did not occur.
    Beyond,
    /// An FMU failed, or the loop could not be run at all.
    Failed,
    /// The user ended it.
    Interrupted,
}

impl Verdict {
    /// Text as it is printed.
    pub fn text(self) -> &'static str {
        if self == Verdict::Holds { "passes" } else { self.word() }
    }

    /// Value in JSON, for scripts.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Holds => "holds",
            Verdict::Beyond => "beyond limit",
            Verdict::Failed => "failed",
            Verdict::Interrupted => "interrupted",
        }
    }
}

impl Report<'_> {
    /// The verdict on the run.
    pub fn verdict(&self) -> Verdict {
        let expected = self.structure.expected_failure;
        match self.ending {
            Ending::Interrupted => Verdict::Interrupted,
            Ending::Failed(_) if expected.is_some_and(|it| (it.from..=it.until).contains(&self.end())) => {
                Verdict::Holds
            }
            Ending::Failed(_) => Verdict::Failed,
            Ending::Complete if expected.is_some_and(|it| it.until < self.end()) => Verdict::Beyond,
            Ending::Complete if self.measured.iter().any(|metric| metric.holds() == Some(false)) => Verdict::Beyond,
            Ending::Complete => Verdict::Holds,
        }
    }
}

/// A run in the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The loop.
    pub name: String,
    /// The verdict on it.
    pub verdict: Verdict,
    /// Computing time of the simulation; none if it did not begin.
    pub took: Option<Duration>,
    /// Metrics and notes, piece by piece.
    pub pieces: Vec<String>,
}

impl Row {
    /// The row of a run with its computing time.
    pub fn new(name: &str, report: &Report, took: Duration) -> Self {
        let (end, verdict) = (report.end(), report.verdict());
        let pieces = match report.ending {
            Ending::Failed(_) if verdict == Verdict::Holds => vec![format!("failed at t = {end} s, as expected")],
            // Metrics of a failed or incomplete run have no meaning.
            Ending::Failed(_) => vec![format!("failed at t = {end} s")],
            Ending::Interrupted => vec![format!("at t = {end} s")],
            Ending::Complete => complete(report),
        };
        Row { name: name.to_owned(), verdict, took: Some(took), pieces }
    }

    /// The row of a loop that was not run, and why.
    pub fn without_run(name: &str, verdict: Verdict, reason: &str) -> Self {
        Row { name: name.to_owned(), verdict, took: None, pieces: vec![reason.to_owned()] }
    }
}

/// Metrics and notes of a complete run.
fn complete(report: &Report) -> Vec<String> {
    let expected = report.structure.expected_failure.filter(|expected| expected.until < report.end());
    let failure = expected.map(|expected| format!("should have failed by t = {} s", expected.until));
    // Metrics of step responses would fill the table.
    let own = report.measured.iter().take(report.structure.metrics.len());
    failure.into_iter().chain(own.map(piece)).collect()
}

/// A metric without its span of time, and its limit.
fn piece(metric: &Measured) -> String {
    let label = metric.label.split(',').next().unwrap_or_default();
    let limit = match (metric.holds(), metric.limit) {
        (Some(true), Some(limit)) => format!(" ≤ {limit}"),
        (Some(false), Some(limit)) => format!(" > {limit}"),
        _ => String::new(),
    };
    format!("{label} {}{limit}", metric.value.map_or("–".to_owned(), four_digits))
}

/// The runs as a table with a row for each, and a summary.
pub fn table(rows: &[Row]) -> String {
    let widest = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or_default().max(4);
    let mut table = format!("{:widest$}  {:12} {:>8}  measured ≤ limit\n", "loop", "", "took");
    for Row { name, verdict, took, pieces } in rows {
        let took = took.map_or("–".to_owned(), |took| format!("{:.1} s", took.as_secs_f64()));
        let mut line = format!("{name:widest$}  {:12} {took:>8}", verdict.text());
        let margin = line.chars().count();
        for piece in pieces {
            if line.chars().count() + 2 + piece.chars().count() > WIDTH && line.chars().count() > margin {
                let _ = writeln!(table, "{line}");
                line = " ".repeat(margin);
            }
            let _ = write!(line, "  {piece}");
        }
        let _ = writeln!(table, "{line}");
    }
    table + &summary(rows)
}

fn summary(rows: &[Row]) -> String {
    let of = |verdict| rows.iter().filter(move |row| row.verdict == verdict).map(|row| row.name.as_str());
    let mut summary = format!("{} of {} loops pass", of(Verdict::Holds).count(), rows.len());
    for verdict in [Verdict::Beyond, Verdict::Failed, Verdict::Interrupted] {
        let names: Vec<&str> = of(verdict).collect();
        if !names.is_empty() {
            let _ = write!(summary, "; {}: {}", verdict.word(), names.join(", "));
        }
    }
    summary
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metric_is_reported_with_its_limit_where_it_has_both() {
        let text = |value, limit| piece(&Measured { label: "max |e|, t >= 5 s".into(), value, limit });
        assert_eq!(text(Some(0.5), Some(1.0)), "max |e| 0.5000 ≤ 1");
        assert_eq!(text(Some(2.0), Some(1.0)), "max |e| 2.000 > 1");
        assert_eq!(text(Some(2.0), None), "max |e| 2.000");
        assert_eq!(text(None, Some(1.0)), "max |e| –");
    }

    #[test]
    fn a_long_row_goes_on_below_itself() {
        let pieces = vec!["max |u_1| 1607 ≤ 1650".to_owned(); 8];
        let row = Row { name: "loop".into(), verdict: Verdict::Holds, took: Some(Duration::from_secs(2)), pieces };
        let table = table(&[row]);
        assert!(table.lines().all(|line| line.chars().count() <= WIDTH), "{table}");
        assert_eq!(table.matches("max |u_1| 1607 ≤ 1650").count(), 8);
        assert!(table.ends_with("1 of 1 loops pass"));
    }
}
