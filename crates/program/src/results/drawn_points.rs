//! Thinned points of a long run for its diagrams: from each group of neighbours, those at which a curve is extreme.

use std::ops::Range;

use super::metrics::Difference;
use crate::figures::{Shown, diagrams};
use crate::simulation::Recording;
use crate::structure::Structure;

/// Largest number of stored values, unless there are so many curves that this would be too few groups.
const VALUES: usize = 1 << 20;
/// Smallest number of groups that are stored in any case.
const LEAST_GROUPS: usize = 4;
/// Number of points that one curve needs of a group: its smallest and largest, and the first that isn't finite.
const OF_CURVE: usize = 3;

/// Stored points, in groups of neighbours.
#[derive(Debug)]
pub(super) struct DrawnPoints {
    curves: Vec<Shows>,
    points: Recording,
    groups: Vec<Group>,
    /// Largest number of the run's points in a group. It doubles when too many points are stored.
    size: usize,
    /// Largest number of stored points.
    most: usize,
}

/// A group of neighbours: number of stored points, and of all points.
#[derive(Debug, Clone, Copy)]
struct Group {
    stored: usize,
    of: usize,
}

/// Value of a curve or a metric in a row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shows {
    difference: Difference,
    magnitude: bool,
}

impl Shows {
    fn at(&self, points: &Recording, row: usize, start: f64) -> f64 {
        let value = self.difference.at(points, row, start);
        if self.magnitude { value.abs() } else { value }
    }
}

impl DrawnPoints {
    /// Returns an empty store for the diagrams and metrics of a loop with these signals.
    ///
    /// # Errors
    /// If a diagram names a signal that isn't there.
    pub fn new(structure: &Structure, signals: &Recording) -> Result<Self, String> {
        Self::with_most(structure, signals, VALUES)
    }

    fn with_most(structure: &Structure, signals: &Recording, values: usize) -> Result<Self, String> {
        let Recording { names, measures, .. } = signals;
        let none = Recording {
            names: names.clone(),
            measures: measures.clone(),
            columns: vec![Vec::new(); names.len()],
            ..Recording::default()
        };
        let curves = curves(structure, &none)?;
        let least = LEAST_GROUPS * (OF_CURVE * curves.len() + 2);
        let most = (values / (names.len() + 1)).max(least);
        Ok(DrawnPoints { curves, points: none, groups: Vec::new(), size: 2, most })
    }

    /// Chooses among further points.
    pub fn add(&mut self, points: &Recording) {
        let mut from = 0;
        while from < points.times.len() {
            // An incomplete group is filled first.
            let room = self.groups.last().map_or(0, |last| self.size.saturating_sub(last.of));
            let to = (from + if room > 0 { room } else { self.size }).min(points.times.len());
            let start = *self.points.times.first().or(points.times.first()).unwrap_or(&0.0);
            let chosen = self.chosen(points, from..to, start);
            self.groups.push(Group { stored: chosen.len(), of: to - from });
            self.points.times.extend(chosen.iter().map(|&row| points.times[row]));
            for (stored, column) in self.points.columns.iter_mut().zip(&points.columns) {
                stored.extend(chosen.iter().map(|&row| column[row]));
            }
            if room > 0 {
                self.merge(self.groups.len() - 2);
            }
            while self.points.times.len() > self.most && self.groups.len() > 1 {
                self.size *= 2;
                self.merge(0);
            }
            from = to;
        }
    }

    /// The stored points, in the order of their times.
    pub fn into_points(self) -> Recording {
        self.points
    }

    /// Both ends of a group, and for each curve the points where it is smallest and largest, and where it first isn't
    /// finite.
    fn chosen(&self, points: &Recording, rows: Range<usize>, start: f64) -> Vec<usize> {
        let mut chosen = vec![rows.start, rows.end - 1];
        // Two points are both ends.
        for curve in self.curves.iter().filter(|_| rows.len() > 2) {
            let (mut low, mut high, mut gap) = ((f64::INFINITY, None), (f64::NEG_INFINITY, None), None);
            for row in rows.clone() {
                let value = curve.at(points, row, start);
                if !value.is_finite() {
                    gap = gap.or(Some(row));
                    continue;
                }
                if value < low.0 {
                    low = (value, Some(row));
                }
                if value > high.0 {
                    high = (value, Some(row));
                }
            }
            chosen.extend([low.1, high.1, gap].into_iter().flatten());
        }
        chosen.sort_unstable();
        chosen.dedup();
        chosen
    }

    /// Merges neighbouring groups, from one on, if they fit into one. Choosing from their stored points gives the same
    /// as choosing from all their points.
    fn merge(&mut self, first: usize) {
        let from: usize = self.groups[..first].iter().map(|group| group.stored).sum();
        let start = self.points.times[0];
        let (mut merged, mut rows, mut begin) = (Vec::<Group>::new(), Vec::new(), from);
        let mut parts = self.groups[first..].iter().copied().peekable();
        while let Some(mut group) = parts.next() {
            while let Some(next) = parts.next_if(|next| group.of + next.of <= self.size) {
                group = Group { stored: group.stored + next.stored, of: group.of + next.of };
            }
            let chosen = self.chosen(&self.points, begin..begin + group.stored, start);
            begin += group.stored;
            merged.push(Group { stored: chosen.len(), ..group });
            rows.extend(chosen);
        }
        self.groups.truncate(first);
        self.groups.extend(merged);
        for column in std::iter::once(&mut self.points.times).chain(&mut self.points.columns) {
            rows.iter().enumerate().for_each(|(place, &row)| column[from + place] = column[row]);
            column.truncate(from + rows.len());
        }
    }
}

/// Curves of a loop's diagrams and metrics, each once.
fn curves(structure: &Structure, signals: &Recording) -> Result<Vec<Shows>, String> {
    let mut curves = Vec::new();
    let mut add = |of: &str, minus: Option<&str>, funnel, magnitude| {
        let shows = Shows { difference: Difference::new(&signals.names, of, minus, funnel)?, magnitude };
        if !curves.contains(&shows) {
            curves.push(shows);
        }
        Ok::<_, String>(())
    };
    for Shown { of, minus, magnitude, .. } in
        diagrams(structure, signals)?.into_iter().flat_map(|diagram| diagram.curves).map(|curve| curve.shown)
    {
        // A funnel is monotonic, so the ends of groups are enough.
        of.map_or(Ok(()), |of| add(&of, minus.as_deref(), None, magnitude))?;
    }
    for metric in &structure.metrics {
        add(&metric.of, metric.minus.as_deref(), metric.funnel, true)?;
    }
    Ok(curves)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::{Metric, PerformanceFunction, Plot, Settings, Statistic};

    const FUNNEL: PerformanceFunction = PerformanceFunction { start: 5.0, end: 0.5, rate: 0.1 };

    fn structure() -> Structure {
        let settings = Settings { start_time: 2.0, stop_time: 10.0, step: 1e-3 };
        let mut structure = Structure::bare("loop".into(), "loop".into(), String::new(), settings);
        let plot =
            |names: &[&str]| Plot { signals: names.iter().map(ToString::to_string).collect(), ..Plot::default() };
        structure.plots = vec![plot(&["p.y", "r.r"]), plot(&["c.u", "p.y"])];
        let metric = |funnel| Metric {
            label: "error".into(),
            statistic: Statistic::Max,
            of: "p.y".into(),
            minus: Some("r.r".into()),
            funnel,
            from: 0.0,
            limit: None,
        };
        structure.metrics = vec![metric(Some(FUNNEL)), metric(None)];
        structure
    }

    /// Signals with peaks of one point, one that isn't drawn, and a gap.
    fn whole(count: u32) -> Recording {
        let mut random = fastrand::Rng::with_seed(count.into());
        let times: Vec<f64> = (0..count).map(|k| 2.0 + f64::from(k) * 1e-3).collect();
        let mut noisy = |size: f64| times.iter().map(|t| t.sin() + size * (random.f64() - 0.5)).collect::<Vec<f64>>();
        let mut columns = vec![noisy(1e-3), noisy(1e-3), noisy(1e2), noisy(1.0)];
        columns[2][count as usize / 3] = f64::NAN;
        columns[0][count as usize / 2] = -700.0;
        columns[1][count as usize / 5] = f64::INFINITY;
        let names = ["p.y", "r.r", "c.u", "c.x"].map(str::to_owned).to_vec();
        Recording { measures: vec![String::new(); 4], names, times, columns, ..Recording::default() }
    }

    fn drawn(whole: &Recording, values: usize, block: usize) -> DrawnPoints {
        let mut drawn = DrawnPoints::with_most(&structure(), whole, values).unwrap();
        for from in (0..whole.times.len()).step_by(block) {
            let rows = from..(from + block).min(whole.times.len());
            let columns = whole.columns.iter().map(|column| column[rows.clone()].to_vec()).collect();
            drawn.add(&Recording { times: whole.times[rows.clone()].to_vec(), columns, ..Recording::default() });
        }
        drawn
    }

    /// The values of a curve, without gaps.
    fn finite<'a>(shows: &'a Shows, of: &'a Recording, rows: Range<usize>) -> impl Iterator<Item = f64> + use<'a> {
        rows.map(|row| shows.at(of, row, 2.0)).filter(|value| value.is_finite())
    }

    #[test]
    fn every_curve_has_the_extremes_of_all_neighbours_in_rows_of_the_run() {
        for (count, values, block) in [(20_000, 4000, 777), (20_000, 1, 20_000), (5000, 9000, 1), (31, 1, 7), (2, 1, 1)]
        {
            let (whole, case) = (whole(count), (count, values, block));
            let drawn = drawn(&whole, values, block);
            let points = &drawn.points;
            assert!(points.times.len() <= drawn.most, "{case:?}: {} points", points.times.len());
            assert_eq!(drawn.groups.iter().map(|group| group.of).sum::<usize>(), whole.times.len());
            // All signals in recorded rows, in their order, from the first to the last.
            let rows: Vec<_> =
                points.times.iter().map(|time| whole.times.binary_search_by(|t| t.total_cmp(time)).unwrap()).collect();
            assert!(
                rows.is_sorted_by(|a, b| a < b)
                    && rows.first() == Some(&0)
                    && rows.last() == Some(&(whole.times.len() - 1))
            );
            for (column, all) in points.columns.iter().zip(&whole.columns) {
                assert!(column.iter().zip(&rows).all(|(value, &row)| value.to_bits() == all[row].to_bits()));
            }
            let (mut begin, mut first) = (0, 0);
            for Group { stored: count, of } in &drawn.groups {
                for curve in &drawn.curves {
                    let ends = |values: Vec<f64>| {
                        (values.iter().copied().fold(f64::NAN, f64::min), values.into_iter().fold(f64::NAN, f64::max))
                    };
                    let of_stored = ends(finite(curve, points, begin..begin + count).collect());
                    let of_all = ends(finite(curve, &whole, first..first + of).collect());
                    assert_eq!(format!("{of_stored:?}"), format!("{of_all:?}"), "{case:?}, {curve:?}");
                }
                (begin, first) = (begin + count, first + of);
            }
            let gaps =
                |column: usize, of: &Recording| of.columns[column].iter().filter(|value| !value.is_finite()).count();
            assert_eq!([1, 2].map(|column| gaps(column, points)), [1, 2].map(|column| gaps(column, &whole)));
        }
    }

    #[test]
    fn what_is_drawn_and_what_is_measured_is_looked_at_once() {
        let drawn = DrawnPoints::with_most(&structure(), &whole(6), 1).unwrap();
        // y, r, u, |y - r| in its diagram and as a metric, and in parts of its funnel.
        assert_eq!(drawn.curves.len(), 5);
        let mut other = structure();
        other.plots[0].signals.push("p.z".into());
        assert!(DrawnPoints::new(&other, &whole(6)).unwrap_err().contains("`p.z`"));
    }

    #[test]
    fn a_long_run_keeps_as_many_points_as_one_a_tenth_as_long() {
        let counts = [10_000, 100_000].map(|count| drawn(&whole(count), 10_000, 5000).points.times.len());
        assert!(counts.iter().all(|count| (700..=2000).contains(count)), "{counts:?}");
    }
}
