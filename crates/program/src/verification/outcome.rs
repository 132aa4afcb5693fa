//! Outcomes of samples, and their counts.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::requirement::Limit;

/// The outcome of a sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Outcome {
    /// A component refused the values, with the reason, so it isn't a run.
    Refused(String),
    /// The run didn't reach its end, with the reason.
    NotEnded(String),
    /// All metrics, in the order of their labels; none without a finite value.
    Ended(Vec<Option<f64>>),
}

/// The result of a sample in a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judged {
    /// All requirements are met.
    Passed,
    /// A requirement is violated.
    Failed,
    /// A metric of a requirement has no value.
    WithoutValue,
    /// The run didn't reach its end.
    NotEnded,
    /// The sample wasn't a run.
    Refused,
}

impl Judged {
    /// The word for it in tables.
    pub fn word(self) -> &'static str {
        match self {
            Judged::Passed => "passed",
            Judged::Failed => "failed",
            Judged::WithoutValue => "without value",
            Judged::NotEnded => "not ended",
            Judged::Refused => "refused",
        }
    }

    /// True if it counts as a failure.
    pub fn is_failure(self) -> bool {
        !matches!(self, Judged::Passed | Judged::Refused)
    }
}

/// Limits of metrics, by their places among all.
#[derive(Debug, Clone)]
pub struct Limits {
    /// The limits.
    pub of: Vec<Limit>,
    /// The place of the metric of each.
    pub places: Vec<usize>,
}

impl Limits {
    /// The result of a sample.
    pub fn judge(&self, outcome: &Outcome) -> Judged {
        let metrics = match outcome {
            Outcome::Refused(_) => return Judged::Refused,
            Outcome::NotEnded(_) => return Judged::NotEnded,
            Outcome::Ended(metrics) => metrics,
        };
        let values = || self.of.iter().zip(self.places.iter().map(|&place| metrics[place]));
        if values().any(|(limit, value)| value.is_some_and(|value| limit.is_violated(value))) {
            Judged::Failed
        } else if values().any(|(_, value)| value.is_none()) {
            Judged::WithoutValue
        } else {
            Judged::Passed
        }
    }

    /// The largest excess over a limit, in parts of it; positive if one is violated, infinite for a run without
    /// metrics.
    pub fn excess(&self, outcome: &Outcome) -> f64 {
        let Outcome::Ended(metrics) = outcome else { return f64::INFINITY };
        let excess =
            |(limit, &place): (&Limit, &usize)| metrics[place].map_or(f64::INFINITY, |value| limit.excess(value));
        self.of.iter().zip(&self.places).map(excess).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Counts of the outcomes so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    /// Number of runs.
    pub runs: u64,
    /// Runs that failed, for whatever reason.
    pub failures: u64,
    /// Failed runs that didn't reach their end.
    pub not_ended: u64,
    /// Failed runs in which a metric of a requirement has no value.
    pub without_value: u64,
    /// Samples that weren't runs.
    pub refused: u64,
    /// Number of runs that violate each limit, by its place.
    pub violated: BTreeMap<usize, u64>,
}

impl Tally {
    /// Counts a further outcome.
    pub fn add(&mut self, outcome: &Outcome, limits: &Limits) {
        let judged = limits.judge(outcome);
        if judged == Judged::Refused {
            self.refused += 1;
            return;
        }
        self.runs += 1;
        self.failures += u64::from(judged.is_failure());
        self.not_ended += u64::from(judged == Judged::NotEnded);
        self.without_value += u64::from(judged == Judged::WithoutValue);
        if let Outcome::Ended(metrics) = outcome {
            for (k, (limit, &place)) in limits.of.iter().zip(&limits.places).enumerate() {
                if metrics[place].is_some_and(|value| limit.is_violated(value)) {
                    *self.violated.entry(k).or_default() += 1;
                }
            }
        }
    }

    /// The part of the runs that failed.
    pub fn share(&self) -> f64 {
        self.failures as f64 / self.runs.max(1) as f64
    }

    /// True if more samples were refused than a study of this size may have.
    pub fn is_refused_too_often(&self, of: u64) -> bool {
        100 * self.refused > of
    }
}

#[cfg(test)]
mod tests {
    use super::super::requirement::Side;
    use super::*;

    fn limits() -> Limits {
        let limit = |label: &str, side, value| Limit { label: label.to_owned(), side, value };
        Limits { of: vec![limit("a", Side::AtMost, 1.0), limit("b", Side::AtLeast, 2.0)], places: vec![0, 2] }
    }

    #[test]
    fn each_outcome_has_one_result() {
        let some = |value: f64| Some(value).filter(|value| value.is_finite());
        let ended = |a: f64, b: f64| Outcome::Ended(vec![some(a), None, some(b)]);
        let outcomes = [
            (ended(1.0, 2.0), Judged::Passed),
            (ended(1.1, f64::NAN), Judged::Failed),
            (ended(0.5, 1.9), Judged::Failed),
            (ended(0.5, f64::NAN), Judged::WithoutValue),
            (Outcome::NotEnded("diverged".into()), Judged::NotEnded),
            (Outcome::Refused("m = 0".into()), Judged::Refused),
        ];
        let mut tally = Tally::default();
        for (outcome, judged) in &outcomes {
            assert_eq!(limits().judge(outcome), *judged);
            tally.add(outcome, &limits());
        }
        let violated = BTreeMap::from([(0, 1), (1, 1)]);
        assert_eq!(tally, Tally { runs: 5, failures: 4, not_ended: 1, without_value: 1, refused: 1, violated });
        assert!(!tally.is_refused_too_often(100) && tally.is_refused_too_often(99));
        assert!((limits().excess(&ended(1.5, 2.0)) - 0.5).abs() < 1e-15);
        assert_eq!(limits().excess(&ended(0.0, f64::NAN)), f64::INFINITY);
    }
}
