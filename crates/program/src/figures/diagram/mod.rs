//! Diagrams for SVG files, pages, and programs that draw themselves. References, colours, dashes, axes and the range of
//! a first peak are decided here.

mod axis;
mod embedded;
mod of_loop;
mod space;
mod style;
mod svg;
mod thinned;

use std::borrow::Cow;
use std::collections::BTreeSet;

pub use axis::{labelled, padded_range, value_label};
pub use embedded::groups;
pub use of_loop::{bound, diagrams, of_plot};
pub use space::{Path, space};
pub use style::{COLOURS, Part, Style};
pub use svg::{figure, svg};
pub use thinned::thinned;

use axis::{Axis, decades};
use style::styles;

use crate::structure::{PerformanceFunction, Scale};

/// The largest part of the time of a peak at the start or at the end.
const PART: f64 = 0.05;
/// Ratio of a peak to all other values.
const PEAK: f64 = 4.0;
/// Part of a peak below which values are rounding errors.
const NOTHING: f64 = 1e-9;
/// Ratio of the values above which an automatic axis is logarithmic.
const DECADES: f64 = 100.0;
/// Ratio of the time that is shown of a peak to its duration.
const AROUND_PEAK: f64 = 1.6;

/// The signals that a curve shows, for programs that have them.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Shown {
    /// The signal; none of a funnel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Signal that is subtracted from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minus: Option<String>,
    /// True if magnitudes are shown.
    pub magnitude: bool,
    /// ρ_0, ρ_∞ and the rate of decay of a funnel, from the start on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub funnel: Option<[f64; 3]>,
}

impl Shown {
    /// A signal as it is.
    pub fn signal(name: &str) -> Self {
        Shown { of: Some(name.to_owned()), minus: None, magnitude: false, funnel: None }
    }

    /// A funnel.
    pub fn funnel(funnel: PerformanceFunction) -> Self {
        let PerformanceFunction { start, end, rate } = funnel;
        Shown { of: None, minus: None, magnitude: false, funnel: Some([start, end, rate]) }
    }
}

/// A curve before its style is decided.
#[derive(Debug, Clone)]
pub struct Given<'a> {
    /// Its name.
    pub name: String,
    /// Its unit of measurement; empty if unknown.
    pub unit: String,
    /// Its part in the diagram.
    pub part: Part,
    /// Signals that it shows.
    pub shown: Shown,
    /// Times, or another abscissa.
    pub times: Cow<'a, [f64]>,
    /// Its values.
    pub values: Cow<'a, [f64]>,
}

/// A curve of a diagram.
#[derive(Debug, Clone)]
pub struct Curve<'a> {
    /// Its name in the legend.
    pub name: String,
    /// Style of its line.
    pub style: Style,
    /// Signals that it shows.
    pub shown: Shown,
    /// Times, or another abscissa.
    pub times: Cow<'a, [f64]>,
    /// Its values.
    pub values: Cow<'a, [f64]>,
}

/// A peak at the start, or at the end of an unstable loop, next to which the rest would appear flat.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Peak {
    /// Time at which it begins.
    pub from: f64,
    /// Time at which it ends.
    pub until: f64,
    /// Its largest magnitude, with its sign.
    pub value: f64,
    /// The smallest value of the rest, a little lower.
    pub low: f64,
    /// The largest value of the rest, a little higher.
    pub high: f64,
}

/// A diagram: curves and their presentation.
#[derive(Debug, Clone)]
pub struct Diagram<'a> {
    /// Title.
    pub title: String,
    /// Words at the axis of times.
    pub x: String,
    /// Words at the axis of values.
    pub y: String,
    /// The ends of a logarithmic axis of values; none for a linear one.
    pub decades: Option<(f64, f64)>,
    /// Its curves in the order of the legend.
    pub curves: Vec<Curve<'a>>,
    /// The peak that has its own part.
    pub peak: Option<Peak>,
    /// Times at which variables got values.
    pub marks: Vec<Mark>,
}

/// A time that is marked in a diagram.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Mark {
    /// Time, s.
    pub time: f64,
    /// The event.
    pub text: String,
}

/// The label of the axis of time.
pub fn time_label() -> String {
    labelled("time", "s")
}

impl<'a> Diagram<'a> {
    /// Decides the styles of curves. Errors are differences of signals.
    pub fn new(title: &str, x: &str, scale: Scale, given: Vec<Given<'a>>) -> Self {
        let units: BTreeSet<&str> = given.iter().map(|curve| curve.unit.as_str()).collect();
        let errors = given.iter().filter(|curve| curve.shown.funnel.is_none());
        let errors = errors.clone().count() > 0 && errors.clone().all(|curve| curve.shown.minus.is_some());
        let y = value_label(title, &units, errors);
        let several = units.iter().filter(|unit| !unit.is_empty()).count() > 1;
        let parts: Vec<Part> = given.iter().map(|curve| curve.part).collect();
        let curve = |(Given { name, unit, shown, times, values, .. }, style)| {
            // With several units in one diagram, each curve names its own.
            let name = if several { labelled(&name, &unit) } else { name };
            Curve { name, style, shown, times, values }
        };
        let mut diagram = Diagram {
            title: title.to_owned(),
            x: x.to_owned(),
            y,
            decades: None,
            curves: given.into_iter().zip(styles(&parts)).map(curve).collect(),
            peak: None,
            marks: Vec::new(),
        };
        if diagram.is_logarithmic(scale) {
            diagram.decades = Some(decades(diagram.values()));
        } else {
            diagram.peak = diagram.find_peak();
        }
        diagram
    }

    /// All its values.
    fn values(&self) -> impl Iterator<Item = &f64> {
        self.curves.iter().flat_map(|curve| curve.values.iter())
    }

    fn is_logarithmic(&self, scale: Scale) -> bool {
        let finite = || self.values().filter(|value| value.is_finite());
        match scale {
            Scale::Linear => false,
            Scale::Logarithmic => finite().any(|value| *value > 0.0),
            Scale::ByValues => {
                let (least, largest) =
                    (finite().fold(f64::MAX, |a, b| a.min(*b)), finite().fold(0.0, |a: f64, b| a.max(*b)));
                least > 0.0 && largest >= DECADES * least
            }
        }
    }

    /// Its first and last time.
    pub fn span(&self) -> (f64, f64) {
        let ends = self.curves.iter().flat_map(|curve| [curve.times.first(), curve.times.last()]).flatten();
        let (start, end) = ends.fold((f64::MAX, f64::MIN), |(low, high), &time| (low.min(time), high.max(time)));
        if start < end {
            (start, end)
        } else if start == end {
            (start, start + 1.0)
        } else {
            (0.0, 1.0)
        }
    }

    /// The axis of values between two times.
    pub fn axis(&self, from: f64, to: f64) -> Axis {
        if let Some((low, high)) = self.decades {
            return Axis { low, high, logarithmic: true };
        }
        Axis::linear(padded_range(self.curves.iter().flat_map(|curve| curve.values[curve.rows(from, to)].iter())))
    }

    /// A peak in the first or the last part of the time that is many times as large as anything else.
    fn find_peak(&self) -> Option<Peak> {
        let (start, end) = self.span();
        let length = PART * (end - start);
        let times = || self.curves.iter().flat_map(|curve| curve.times.iter().copied());
        if let Some((outside, peak)) = self.peak_within(|time| time < start + length) {
            let last = outside.into_iter().fold(start, f64::max);
            let until = times().filter(|time| *time > last).fold(end, f64::min);
            return Some(Peak { from: start, until, ..peak });
        }
        let (outside, peak) = self.peak_within(|time| time > end - length)?;
        let first = outside.into_iter().fold(end, f64::min);
        let from = times().filter(|time| *time < first).fold(start, f64::max);
        Some(Peak { from, until: end, ..peak })
    }

    /// A peak within some of the time: the times at which values are outside of the range of the rest, and its value.
    fn peak_within(&self, within: impl Fn(f64) -> bool) -> Option<(Vec<f64>, Peak)> {
        let points = || self.curves.iter().flat_map(|curve| curve.times.iter().zip(curve.values.iter()));
        let finite = || points().filter(|(_, value)| value.is_finite());
        let larger = |a: f64, (_, b): (&f64, &f64)| if b.abs() > a.abs() { *b } else { a };
        let value = finite().filter(|(time, _)| within(**time)).fold(0.0, larger);
        let rest = finite().filter(|(time, _)| !within(**time)).fold(0.0, larger);
        if value.abs() < PEAK * rest.abs() || rest.abs() <= NOTHING * value.abs() {
            return None;
        }
        let (low, high) = padded_range(finite().filter(|(time, _)| !within(**time)).map(|(_, value)| value));
        let outside = finite().filter(|(time, value)| within(**time) && !(low..=high).contains(*value));
        let outside = outside.map(|(time, _)| *time).collect();
        Some((outside, Peak { from: f64::NAN, until: f64::NAN, value, low, high }))
    }

    /// Time ranges that are drawn side by side: the peak and the rest, or all.
    pub fn parts(&self) -> Vec<(f64, f64)> {
        let (start, end) = self.span();
        match self.peak {
            Some(Peak { from, until, .. }) if from <= start => {
                vec![(start, start + AROUND_PEAK * (until - start)), (until, end)]
            }
            Some(Peak { from, .. }) => vec![(start, from), (end - AROUND_PEAK * (end - from), end)],
            None => vec![(start, end)],
        }
    }

    /// Place of the peak among its parts.
    pub fn peak_part(&self) -> Option<usize> {
        self.peak.map(|peak| usize::from(peak.from > self.span().0))
    }
}

impl Curve<'_> {
    /// The rows from one time to another.
    pub fn rows(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let before = |time: f64| self.times.partition_point(|other| *other < time);
        before(from)..self.times.partition_point(|other| *other <= to).max(before(from))
    }
}

#[cfg(test)]
mod tests;
