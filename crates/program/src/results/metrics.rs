//! Numbers that judge a run.

use super::ideal::Ideals;
use super::measured::Measured;
use super::steps::Steps;
use crate::simulation::{Recording, place};
use crate::structure::{Metric, PerformanceFunction, Statistic, Structure};

/// Adds the ideal models to a recording, then measures.
///
/// # Errors
/// If a metric or a model names a signal that isn't there.
pub fn measure(structure: &Structure, recording: &mut Recording) -> Result<Vec<Measured>, String> {
    let mut meter = Meter::new(structure, recording)?;
    meter.add(recording);
    Ok(meter.measured())
}

/// Measures a run, one part of it after the other.
#[derive(Debug)]
pub struct Meter {
    ideals: Ideals,
    gauges: Vec<Gauge>,
    steps: Steps,
    /// Start of the run, s.
    start: Option<f64>,
}

impl Meter {
    /// Returns a meter for a run with these signals. The recording gets the names of the ideal models.
    ///
    /// # Errors
    /// If a metric or a model names a signal that isn't there.
    pub fn new(structure: &Structure, recording: &mut Recording) -> Result<Self, String> {
        let ideals = Ideals::new(&structure.models, recording)?;
        let gauge = |metric| Gauge::new(metric, &recording.names);
        let gauges = structure.metrics.iter().map(gauge).collect::<Result<_, _>>()?;
        Ok(Meter { ideals, gauges, steps: Steps::new(structure, recording), start: None })
    }

    /// The labels of all possible metrics, some of which exist only if a reference steps.
    pub fn labels(&self) -> Vec<String> {
        self.gauges.iter().map(|gauge| gauge.metric.label.clone()).chain(self.steps.labels()).collect()
    }

    /// Adds the ideal models to further points, and measures them.
    pub fn add(&mut self, points: &mut Recording) {
        self.ideals.add(points);
        if let Some(&first) = points.times.first() {
            let start = *self.start.get_or_insert(first);
            self.gauges.iter_mut().for_each(|gauge| gauge.add(points, start));
            self.steps.add(points);
        }
    }

    /// The loop's metrics, then those of the references that stepped.
    pub fn measured(self) -> Vec<Measured> {
        self.gauges.into_iter().map(Gauge::measured).chain(self.steps.measured()).collect()
    }
}

/// A signal, or its difference from another one, relative to a funnel if there is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    of: usize,
    minus: Option<usize>,
    funnel: Option<PerformanceFunction>,
}

impl Difference {
    /// Returns the difference of signals with these names.
    ///
    /// # Errors
    /// If one isn't there.
    pub fn new(
        names: &[String],
        of: &str,
        minus: Option<&str>,
        funnel: Option<PerformanceFunction>,
    ) -> Result<Self, String> {
        let minus = minus.map(|name| place(names, name));
        Ok(Difference { of: place(names, of)?, minus: minus.transpose()?, funnel })
    }

    /// Its value in a row of a run that starts at some time.
    pub fn at(&self, points: &Recording, row: usize, start: f64) -> f64 {
        self.of(|place| points.columns[place][row], points.times[row] - start)
    }

    /// Its value from the signals' values by their places, `since` seconds after the start.
    pub fn of(&self, value: impl Fn(usize) -> f64, since: f64) -> f64 {
        let size = self.funnel.map_or(1.0, |funnel| funnel.at(since));
        (value(self.of) - self.minus.map_or(0.0, &value)) / size
    }
}

/// A metric that is being measured.
#[derive(Debug)]
struct Gauge {
    metric: Metric,
    difference: Difference,
    /// Number of points that were measured.
    count: usize,
    /// Their largest magnitude, or the sum of their squares.
    value: f64,
}

impl Gauge {
    fn new(metric: &Metric, names: &[String]) -> Result<Self, String> {
        let difference = Difference::new(names, &metric.of, metric.minus.as_deref(), metric.funnel)?;
        Ok(Gauge { metric: metric.clone(), difference, count: 0, value: 0.0 })
    }

    fn add(&mut self, points: &Recording, start: f64) {
        let from = self.metric.from - 1e-9;
        for (row, _) in points.times.iter().enumerate().filter(|(_, time)| **time >= from) {
            let value = self.difference.at(points, row, start);
            self.count += 1;
            match self.metric.statistic {
                Statistic::Max if value.abs() > self.value || value.is_nan() => self.value = value.abs(),
                Statistic::Max => {}
                Statistic::Rms => self.value += value * value,
            }
        }
    }

    fn measured(self) -> Measured {
        let Gauge { metric: Metric { label, statistic, limit, .. }, count, value, .. } = self;
        let value = match statistic {
            Statistic::Max => value,
            Statistic::Rms => (value / count as f64).sqrt(),
        };
        Measured { label, value: (count > 0).then_some(value), limit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(step: f64, count: u32) -> Recording {
        let times: Vec<f64> = (0..count).map(|k| f64::from(k) * step).collect();
        Recording { names: vec!["r".into()], columns: vec![times.clone()], times, ..Recording::default() }
    }

    fn value_of(metric: &Metric, recording: &Recording) -> Option<f64> {
        let mut gauge = Gauge::new(metric, &recording.names).unwrap();
        gauge.add(recording, recording.times[0]);
        gauge.measured().value
    }

    #[test]
    fn a_metric_counts_from_its_time_on() {
        let recording = ramp(1.0, 5);
        let metric = |statistic, from| Metric {
            label: "m".into(),
            statistic,
            of: "r".into(),
            minus: None,
            funnel: None,
            from,
            limit: None,
        };
        assert_eq!(value_of(&metric(Statistic::Max, 0.0), &recording), Some(4.0));
        assert_eq!(value_of(&metric(Statistic::Rms, 3.0), &recording), Some(12.5_f64.sqrt()));
        assert_eq!(value_of(&metric(Statistic::Max, 9.0), &recording), None);
    }

    #[test]
    fn an_error_is_measured_against_its_funnel() {
        let recording = ramp(1.0, 3);
        let funnel = Some(PerformanceFunction { start: 3.0, end: 1.0, rate: 2.0_f64.ln() });
        let of = || "r".to_owned();
        let metric = Metric {
            label: "m".into(),
            statistic: Statistic::Max,
            of: of(),
            minus: None,
            funnel,
            from: 0.0,
            limit: None,
        };
        // rho = 3, 2, 1.5 at e = 0, 1, 2.
        let value = value_of(&metric, &recording).unwrap();
        assert!((value - 2.0 / 1.5).abs() < 1e-15, "{value}");
    }
}
