//! Outcome of a run, and its failures.

use serde::{Deserialize, Serialize};

use super::study::Plant;
use crate::report::number;

/// Outcome of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Failure, if it failed.
    pub failure: Option<Failure>,
    /// Root mean square of each error, from the settled time on.
    pub rms: Vec<f64>,
    /// Largest magnitude of each error, from the same time on.
    pub worst: Vec<f64>,
    /// Root mean square of each command.
    pub effort: Vec<f64>,
    /// Largest magnitude of each command.
    pub peak: Vec<f64>,
    /// Total variation of each command, 1/s.
    pub variation: Vec<f64>,
    /// Objective that a search of gains minimizes.
    pub cost: f64,
}

/// A failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// Time, s.
    pub at: f64,
    /// Reason, for the user.
    pub reason: String,
}

/// A confirmed outcome: a failure was repeated with a hundredth of the tolerance and half the step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// The outcome.
    pub outcome: Outcome,
    /// True if the first run failed and the finer one, which then counts, didn't.
    pub mended: bool,
}

/// Weight of the commands and of their variation in the cost; that of the errors is 1.
const COMMANDS: f64 = 0.01;
/// Cost of a failure, times the remaining part of the run.
const FAILED: f64 = 1e6;
/// Allowed variation of commands near a margin: a multiple of the nominal variation plus a part of the nominal peak.
const LIVELIER: (f64, f64) = (3.0, 0.1);

/// Places of a run's signals in its row.
#[derive(Debug, Clone)]
pub(super) struct Signals {
    pub errors: Vec<[usize; 2]>,
    pub commands: Vec<usize>,
    pub outputs: Vec<usize>,
}

/// Watches a run.
pub(super) struct Watch<'a> {
    plant: &'a Plant,
    signals: &'a Signals,
    sizes: Vec<f64>,
    duration: f64,
    /// Time from which errors are judged, s.
    settled: f64,
    /// Bound of the cost: the run ends once it is sure to exceed it.
    most: f64,
    last: Option<(f64, Vec<f64>)>,
    judged: u32,
    points: u32,
    errors: f64,
    outcome: Outcome,
}

impl<'a> Watch<'a> {
    /// Watches a run of this length, which ends early once its cost is sure to exceed `most`.
    pub fn new(plant: &'a Plant, signals: &'a Signals, (duration, most): (f64, f64)) -> Self {
        let (errors, commands) = (vec![0.0; signals.errors.len()], vec![0.0; signals.commands.len()]);
        let outcome = Outcome {
            rms: errors.clone(),
            worst: errors,
            effort: commands.clone(),
            peak: commands.clone(),
            variation: commands,
            ..Outcome::default()
        };
        let sizes = plant.sizes();
        // A run that is shorter than the plant's own is judged at least in its second half.
        let settled = if duration < plant.duration { plant.settled.min(0.5 * duration) } else { plant.settled };
        let (last, judged, points, errors) = (None, 0, 0, 0.0);
        Watch { plant, signals, sizes, duration, settled, most, last, judged, points, errors, outcome }
    }

    /// Takes a point of the run. Returns true if the run goes on.
    pub fn point(&mut self, time: f64, row: &[f64]) -> bool {
        let lost = self.signals.outputs.iter().map(|&place| row[place].abs());
        if let Some(value) = lost.filter(|value| *value > self.plant.envelope).reduce(f64::max) {
            return self.fail(time, format!("an output of the plant is outside its envelope, at {}", number(value)));
        }
        let span = self.last.as_ref().map_or(0.0, |(before, _)| time - before);
        let is_judged = time >= self.settled;
        for (k, &[of, minus]) in self.signals.errors.iter().enumerate() {
            let (error, limit) = ((row[of] - row[minus]).abs(), self.plant.error_limits[k]);
            self.errors += span * (error / limit).powi(2);
            if is_judged {
                self.outcome.rms[k] += error * error;
                self.outcome.worst[k] = self.outcome.worst[k].max(error);
                if error > limit {
                    let name = &self.plant.errors[k][0];
                    return self
                        .fail(time, format!("the error of `{name}` is {}, above its limit {limit}", number(error)));
                }
            }
        }
        let commands: Vec<f64> = self.signals.commands.iter().map(|&place| row[place]).collect();
        for (k, &command) in commands.iter().enumerate() {
            self.outcome.effort[k] += command * command;
            self.outcome.peak[k] = self.outcome.peak[k].max(command.abs());
            let before = self.last.as_ref().map_or(command, |(_, before)| before[k]);
            self.outcome.variation[k] += (command - before).abs();
            self.errors += span * COMMANDS * (command / self.sizes[k]).powi(2);
        }
        self.judged += u32::from(is_judged);
        self.points += 1;
        self.last = Some((time, commands));
        self.least_cost() <= self.most
    }

    /// Lower bound of the cost of the whole run, also if it still fails.
    fn least_cost(&self) -> f64 {
        (self.errors + COMMANDS * self.moved(self.duration)).min(FAILED)
    }

    /// Total variation of all commands, in largest controls per second, over some time.
    fn moved(&self, time: f64) -> f64 {
        let moved = self.outcome.variation.iter().zip(&self.sizes).map(|(total, size)| total / (size * time));
        moved.sum()
    }

    /// Notes a failure. Returns false, since the run ends.
    pub fn fail(&mut self, at: f64, reason: String) -> bool {
        self.outcome.failure = Some(Failure { at, reason });
        false
    }

    /// Time of the latest point, s.
    pub fn time(&self) -> f64 {
        self.last.as_ref().map_or(0.0, |(time, _)| *time)
    }

    /// The outcome.
    pub fn outcome(mut self) -> Outcome {
        let (time, points) = (self.time().max(f64::MIN_POSITIVE), f64::from(self.points.max(1)));
        let root = |sum: &mut f64, count: f64| *sum = (*sum / count).sqrt();
        self.outcome.rms.iter_mut().for_each(|sum| root(sum, f64::from(self.judged.max(1))));
        self.outcome.effort.iter_mut().for_each(|sum| root(sum, points));
        self.outcome.cost = self.errors + COMMANDS * self.moved(time);
        if let Some(failure) = &self.outcome.failure {
            self.outcome.cost = FAILED * (1.0 - failure.at / self.duration) + self.outcome.cost.min(FAILED);
        }
        self.outcome.variation.iter_mut().for_each(|total| *total /= time);
        self.outcome
    }
}

impl Outcome {
    /// True if it didn't fail.
    pub fn holds(&self) -> bool {
        self.failure.is_none()
    }

    /// The same, compared with a nominal run: a control that chatters counts as a failure too.
    pub fn passes_compared_with(&self, nominal: &Outcome) -> bool {
        let (times, part) = LIVELIER;
        let calm = |k: usize| self.variation[k] <= times * nominal.variation[k] + part * nominal.peak[k];
        self.holds() && (0..self.variation.len()).all(calm)
    }

    /// The errors in one number: root mean square relative to their limits.
    pub fn error(&self, plant: &Plant) -> f64 {
        mean_square(self.rms.iter().zip(&plant.error_limits)).sqrt()
    }

    /// The commands in one number: root mean square relative to the largest control.
    pub fn commanded(&self, plant: &Plant) -> f64 {
        mean_square(self.effort.iter().zip(&plant.sizes())).sqrt()
    }

    /// The total variation of all commands in one number, in largest controls per second.
    pub fn moved(&self, plant: &Plant) -> f64 {
        let sizes = plant.sizes();
        self.variation.iter().zip(&sizes).map(|(total, size)| total / size).sum::<f64>() / sizes.len() as f64
    }
}

fn mean_square<'a>(pairs: impl ExactSizeIterator<Item = (&'a f64, &'a f64)>) -> f64 {
    let count = pairs.len() as f64;
    pairs.map(|(value, size)| (value / size).powi(2)).sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plant() -> Plant {
        toml::from_str(
            r#"name = "motor"
            title = "Motor"
            unit = "Motor.toml"
            reference = "Reference.toml"
            duration = 20.0
            step = 0.1
            settled = 5.0
            errors = [["plant.y", "reference.r"]]
            error_limits = [1.0]
            envelope = 100.0
            uncertain = []
            controller = []
            bench = { u_min = [-2.0], u_max = [2.0], lag = 0.0 }"#,
        )
        .unwrap()
    }

    /// A run of random errors and commands of these magnitudes, with the bound of its cost.
    fn outcome(seed: u64, [error, command]: [f64; 2], most: f64) -> Outcome {
        let (plant, mut random) = (plant(), fastrand::Rng::with_seed(seed));
        let signals = Signals { errors: vec![[0, 1]], commands: vec![2], outputs: vec![0] };
        let mut watch = Watch::new(&plant, &signals, (10.0, most));
        let mut rows = (0..=100).map(|k| (0.1 * f64::from(k), [error * random.f64(), 0.0, command * random.f64()]));
        while rows.next().is_some_and(|(time, row)| watch.point(time, &row)) {}
        watch.outcome()
    }

    /// A run ends early exactly if its full cost exceeds the bound.
    #[test]
    fn a_run_that_ends_for_its_cost_means_the_same_for_a_search_as_the_whole_one() {
        let (mut cut, mut whole) = (0, 0);
        for seed in 0..200 {
            // From calm runs to runs that fail once errors are judged.
            let sizes = [0.01 * 1.03_f64.powi(seed), 0.1 * 1.05_f64.powi(seed)];
            let seed = seed.cast_unsigned().into();
            let all = outcome(seed, sizes, f64::INFINITY);
            for most in [0.1, 0.8, 0.999, 1.001, 1.5, 10.0].map(|part| part * all.cost) {
                let bounded = outcome(seed, sizes, most);
                if all.cost <= most {
                    assert_eq!(bounded, all);
                    whole += 1;
                } else {
                    assert!(bounded.cost > most, "{} for {most}", bounded.cost);
                    cut += usize::from(bounded.cost < all.cost);
                }
            }
        }
        assert!(cut > 200 && whole > 200, "{cut} were cut short, {whole} weren't");
    }
}
