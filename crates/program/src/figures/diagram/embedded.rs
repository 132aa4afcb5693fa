//! Diagrams as data: for the script of a page, with as many points as a reader can zoom to, and for programs that have
//! the signals.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::thinned::{simplified, thinned};
use super::{Curve, Diagram, Peak};

/// Groups of points for all curves of a page, and the most and the least for a curve.
const GROUPS: usize = 13_000;
const MOST_GROUPS: usize = 4000;
const LEAST_GROUPS: usize = 100;
/// Ratio of the groups that are considered first to those of the result.
const FINE: usize = 50;
/// Largest distance of a line between points from the curve, in parts of the height of the diagram.
const DISTANCE: f64 = 2e-4;
/// Parts of the time that each have a point, if one was recorded, so that a reader sees its value.
const PARTS: usize = 200;
/// Width of the screen of height 1 on which points are chosen: so wide that distances from lines are those of values.
const WIDTH: f64 = 1e4;
/// Digits of numbers.
const DIGITS: usize = 6;

/// Number of groups of points for each of so many curves on a page.
pub fn groups(curves: usize) -> usize {
    (GROUPS / curves.max(1)).clamp(LEAST_GROUPS, MOST_GROUPS)
}

impl Diagram<'_> {
    /// Data with points for `page.js`, which documents the keys.
    pub fn with_points(&self, groups: usize) -> Value {
        let curve = |curve: &Curve| {
            let (x, y): (Vec<f64>, Vec<f64>) = self.points(curve, groups).into_iter().unzip();
            let dashes = &curve.style.dashes;
            json!({ "name": curve.name, "colour": curve.style.colour, "dashes": dashes, "beneath": curve.style.beneath,
                    "x": x, "y": y })
        };
        let curves: Vec<Value> = self.curves.iter().map(curve).collect();
        json!({ "title": self.title, "x": self.x, "y": self.y, "decades": self.decades, "peak": self.peak,
                "marks": self.marks, "curves": curves })
    }

    /// Data for a program that has the signals.
    pub fn without_points(&self) -> Value {
        let curve = |curve: &Curve| {
            let mut data = json!({ "name": curve.name, "colour": curve.style.colour, "dashes": curve.style.dashes,
                                   "beneath": curve.style.beneath });
            if let (Value::Object(data), Ok(Value::Object(shown))) = (&mut data, serde_json::to_value(&curve.shown)) {
                data.extend(shown);
            }
            data
        };
        let signals = self.curves.iter().filter(|curve| curve.shown.minus.is_none());
        let signals: Vec<&String> = signals.filter_map(|curve| curve.shown.of.as_ref()).collect();
        let curves: Vec<Value> = self.curves.iter().map(curve).collect();
        json!({ "title": self.title, "signals": signals, "x": self.x, "y": self.y, "decades": self.decades,
                "peak": self.peak, "marks": self.marks, "parts": self.parts(), "curves": curves })
    }

    /// Points of a curve. All groups of a peak are there, as it appears on two scales.
    fn points(&self, curve: &Curve, groups: usize) -> Vec<(f64, f64)> {
        let rows = curve.values.len().min(curve.times.len());
        let place = |time: f64| curve.times.partition_point(|other| *other <= time).min(rows);
        let peak = self.peak.map_or(0..0, |Peak { from, until, .. }| place(from).saturating_sub(1)..place(until));
        let (parts, number) = (self.parts(), usize::from(self.peak_part() == Some(0)));
        let (from, to) = parts[number];
        let chosen = |rows: std::ops::Range<usize>, groups: usize| {
            thinned(&curve.times[rows.clone()], &curve.values[rows], groups.max(1))
        };
        // A smooth curve needs few of its points; only others are thinned by groups.
        let few = |rows: std::ops::Range<usize>| {
            let seen = |points: Vec<_>| self.seen(&points, (from, to), PARTS.min(groups / 2));
            let points = seen(chosen(rows.clone(), groups * FINE));
            if points.len() <= 2 * groups { points } else { seen(chosen(rows, groups)) }
        };
        let (before, behind) = (few(0..peak.start), few(peak.end..rows));
        let points = before.into_iter().chain(chosen(peak, groups / 3)).chain(behind);
        points.map(|(time, value)| (rounded(time, DIGITS + 1), rounded(value, DIGITS))).collect()
    }

    /// Returns the points that a reader can see from one time to another; the smallest and the largest are among them.
    fn seen(&self, points: &[(f64, f64)], (from, to): (f64, f64), parts: usize) -> Vec<(f64, f64)> {
        let across = self.axis(from, to).places();
        let place = |(time, value): &(f64, f64)| ((time - from) / (to - from) * WIDTH, across(*value));
        let mut drawn: Vec<(f64, f64)> = Vec::new();
        for part in points.chunk_by(|a, b| a.1.is_finite() == b.1.is_finite()) {
            if !part.iter().all(|(_, value)| value.is_finite()) {
                drawn.extend(part.first());
                continue;
            }
            let screen: Vec<_> = part.iter().map(place).collect();
            let part_at = |k: usize| ((part[k].0 - from) / (to - from) * parts as f64).floor() as i64;
            let by_value = |a: &usize, b: &usize| part[*a].1.total_cmp(&part[*b].1);
            let mut places = simplified(&screen, DISTANCE);
            let with_points: BTreeSet<i64> = places.iter().map(|&k| part_at(k)).collect();
            let is_first = |k: &usize| part_at(*k) > part_at(k - 1) && !with_points.contains(&part_at(*k));
            places.extend((1..part.len()).filter(is_first));
            places.extend((0..part.len()).min_by(by_value));
            places.extend((0..part.len()).max_by(by_value));
            places.sort_unstable();
            places.dedup();
            drawn.extend(places.into_iter().map(|place| part[place]));
        }
        drawn
    }
}

/// A number of so many digits.
fn rounded(number: f64, digits: usize) -> f64 {
    format!("{number:.*e}", digits - 1).parse().unwrap_or(number)
}
