//! Lower bounds of objectives during a run, so that a run that can't be better any more ends.

use super::Objective;
use crate::results::Difference;
use crate::structure::{Settings, SquareTerm, Statistic, Structure};

/// A floor must exceed a value by more than rounding errors of sums in another order.
const ROUNDING: f64 = 1e-9;

/// Lower bound of an objective from the points so far.
#[derive(Debug)]
pub struct Floor {
    /// Differences that it sums up, each with its weight.
    differences: Vec<(f64, Difference)>,
    kind: Kind,
    start: f64,
    value: f64,
}

#[derive(Debug)]
enum Kind {
    /// Σ weight · difference², at points that are so many seconds apart.
    Squares { sample: f64 },
    /// The largest magnitude from a time on.
    Largest { from: f64 },
}

impl Floor {
    /// A floor for runs of a loop with these signals; none if an objective may become smaller during a run, or needs an
    /// ideal model, which is known afterwards.
    pub fn new(objective: &Objective, structure: &Structure, signals: &[String], settings: Settings) -> Option<Self> {
        let (differences, kind) = match objective {
            Objective::Squares { terms, .. } if terms.iter().any(|term| term.weight < 0.0) => return None,
            Objective::Squares { terms, sample } => {
                let of = terms.iter().map(|SquareTerm { weight, of, minus }| {
                    Some((*weight, Difference::new(signals, of, minus.as_deref(), None).ok()?))
                });
                (of.collect::<Option<_>>()?, Kind::Squares { sample: *sample })
            }
            Objective::Metric(label) => {
                let metric = structure.metrics.iter().find(|metric| metric.label == *label)?;
                if metric.statistic != Statistic::Max {
                    return None;
                }
                let of = Difference::new(signals, &metric.of, metric.minus.as_deref(), metric.funnel).ok()?;
                (vec![(1.0, of)], Kind::Largest { from: metric.from })
            }
        };
        Some(Floor { differences, kind, start: settings.start_time, value: 0.0 })
    }

    /// Takes a further point. Returns true if the objective can still come below a value.
    pub fn add(&mut self, time: f64, row: &[f64], below: f64) -> bool {
        let since = time - self.start;
        let values = self.differences.iter().map(|(weight, of)| (weight, of.of(|place| row[place], since)));
        match self.kind {
            Kind::Squares { sample } if is_whole(since / sample) => {
                self.value += values.map(|(weight, value)| weight * value.powi(2)).sum::<f64>();
            }
            Kind::Largest { from } if time >= from => {
                self.value = values.map(|(_, value)| value.abs()).fold(self.value, f64::max);
            }
            _ => {}
        }
        // A floor that isn't a number decides nothing before the end of the run.
        self.value.is_nan() || self.value <= below * (1.0 + ROUNDING)
    }

    /// The floor so far.
    pub fn value(&self) -> f64 {
        self.value
    }
}

/// True if a time, in samples, is that of a sample.
pub(super) fn is_whole(samples: f64) -> bool {
    (samples - samples.round()).abs() < 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::Recording;
    use crate::structure::LoopFiles;

    fn settings(start_time: f64) -> Settings {
        Settings { start_time, stop_time: start_time + 2.0, step: 0.25 }
    }

    /// Squares with random weights: the floor ends at the objective, and never decreases.
    #[test]
    fn a_floor_of_squares_grows_to_the_objective() {
        let structure = LoopFiles::find("3.2.1-cosine").unwrap().structure().unwrap();
        let settings = settings(0.5);
        let signals = ["a".to_owned(), "b".to_owned()];
        let mut random = fastrand::Rng::with_seed(1);
        for sample in [0.25, 0.5, 1.0] {
            let terms = vec!["2 a - b".parse().unwrap(), "0.3 b".parse().unwrap()];
            let objective = Objective::Squares { terms, sample };
            let mut floor = Floor::new(&objective, &structure, &signals, settings).unwrap();
            let (mut times, mut columns) = (Vec::new(), vec![Vec::new(); 2]);
            let mut before = 0.0;
            for k in 0..=8 {
                let (time, row) = (0.5 + 0.25 * f64::from(k), [random.f64(), 3.0 * random.f64()]);
                assert!(floor.add(time, &row, f64::INFINITY) && floor.value() >= before);
                before = floor.value();
                times.push(time);
                columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            }
            let bare = Structure::bare(structure.file.clone(), String::new(), String::new(), settings);
            let names = signals.to_vec();
            let mut recording =
                Recording { names, measures: vec![String::new(); 2], times, columns, ..Recording::default() };
            let value = objective.value(&bare, &mut recording).unwrap();
            assert!((floor.value() / value - 1.0).abs() < 1e-12, "{} for {value}", floor.value());
            // It ends above its value, and goes on below.
            let mut again = Floor::new(&objective, &structure, &signals, settings).unwrap();
            let row = |k: usize| [recording.columns[0][k], recording.columns[1][k]];
            assert!((0..9).all(|k| again.add(recording.times[k], &row(k), value)));
            let mut again = Floor::new(&objective, &structure, &signals, settings).unwrap();
            assert!(!(0..9).all(|k| again.add(recording.times[k], &row(k), 0.5 * value)));
        }
    }

    #[test]
    fn what_may_become_smaller_has_no_floor() {
        let structure = LoopFiles::find("3.2.1-cosine").unwrap().structure().unwrap();
        let signals = ["a".to_owned()];
        let of = |objective: &Objective| Floor::new(objective, &structure, &signals, settings(0.0)).is_some();
        let squares = |text: &str| Objective::Squares { terms: vec![text.parse().unwrap()], sample: 0.1 };
        assert!(of(&squares("1 a")) && !of(&squares("-1 a")) && !of(&squares("1 model")));
        let rms = structure.metrics.iter().find(|metric| metric.statistic == Statistic::Rms).unwrap();
        assert!(!of(&Objective::Metric(rms.label.clone())));
    }
}
