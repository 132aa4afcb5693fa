//! Stored results of a run: its metrics, and the curves that figures show of it.

use std::collections::HashMap;
use std::time::Duration;

use super::Curve;
use crate::figures::thinned;
use crate::results::{Ending, Measured, Report, Verdict, four_digits};
use crate::structure::{Metric, Structure};

/// Groups of points in a stored curve, in its first part, where peaks are, and in the rest.
const GROUPS: usize = 1500;
const FIRST: f64 = 0.05;
/// The most rows of a curve in its file, and the most points of a path.
const MOST_ROWS: usize = 2000;

/// A run that is over.
#[derive(Debug)]
pub struct Outcome {
    /// Its name in figures and claims.
    pub run: String,
    /// Verdict on it.
    pub verdict: Verdict,
    /// Its ending.
    pub ending: Ending,
    /// Time of the last point, s.
    pub end: f64,
    /// Duration of the computation.
    pub took: Duration,
    /// Its metrics.
    pub measured: Vec<Measured>,
    curves: HashMap<Curve, Samples>,
}

/// A curve of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// Points for figures, with all peaks.
    pub drawn: Vec<(f64, f64)>,
    /// Points at every so many communication points.
    pub rows: Vec<(f64, f64)>,
    /// Unit of measurement, if known.
    pub unit: Option<String>,
}

impl Outcome {
    /// Stores the curves of a run that figures show.
    ///
    /// # Errors
    /// When it lacks such a signal.
    pub fn new(run: &str, report: &Report, took: Duration, wanted: &[&Curve]) -> Result<Self, String> {
        let mut curves = HashMap::new();
        for curve in wanted.iter().filter(|curve| curve.run == run) {
            curves.insert((*curve).clone(), samples(report, curve)?);
        }
        Ok(Outcome {
            run: run.to_owned(),
            verdict: report.verdict(),
            ending: report.ending.clone(),
            end: report.end(),
            took,
            measured: report.measured.to_vec(),
            curves,
        })
    }

    /// Outcome of a loop before its run: metrics without values.
    pub fn before(run: &str, structure: &Structure) -> Self {
        let metrics = structure.metrics.iter();
        let measured =
            metrics.map(|Metric { label, limit, .. }| Measured { label: label.clone(), value: None, limit: *limit });
        Outcome::without_curves(run, Ending::Complete, Verdict::Holds, measured.collect())
    }

    pub(super) fn without_curves(run: &str, ending: Ending, verdict: Verdict, measured: Vec<Measured>) -> Self {
        let curves = HashMap::new();
        Outcome { run: run.to_owned(), verdict, ending, end: 0.0, took: Duration::ZERO, measured, curves }
    }

    /// A curve of it.
    pub fn curve(&self, curve: &Curve) -> Option<&Samples> {
        self.curves.get(curve)
    }

    /// Its ending in a few words.
    pub fn to_text(&self) -> String {
        match self.ending {
            Ending::Complete => format!("ran to {} s", self.end),
            Ending::Interrupted => format!("was interrupted at {} s", self.end),
            Ending::Failed(_) => format!("lost at t = {} s", four_digits(self.end)),
        }
    }
}

fn samples(report: &Report, curve: &Curve) -> Result<Samples, String> {
    let recording = report.recording;
    let column = |name: &str| recording.column(name).ok_or_else(|| format!("{}: no signal `{name}`", curve.run));
    let of = column(&curve.of)?;
    let values = match &curve.minus {
        Some(minus) => of.iter().zip(column(minus)?).map(|(of, minus)| of - minus).collect(),
        None => of.to_vec(),
    };
    let border = (FIRST * values.len() as f64) as usize;
    let drawn =
        [0..border, border..values.len()].map(|rows| thinned(&recording.times[rows.clone()], &values[rows], GROUPS));
    let every = recording.times.len().div_ceil(MOST_ROWS).max(1);
    Ok(Samples {
        drawn: drawn.concat(),
        rows: recording.times.iter().copied().zip(values.iter().copied()).step_by(every).collect(),
        unit: recording.measure(&curve.of).map(str::to_owned),
    })
}
