//! The number of runs of a study, its interim looks, and its verdict.

use serde::{Deserialize, Serialize};

use super::binomial::{lower, upper};
use super::subset::{Found, Sizes};

/// Number of runs of a study without an allowed rate of failure.
const USUAL_RUNS: u64 = 10_000;
/// The most runs of a subset simulation, and the rate that it reaches, unless the user asks for others.
const USUAL_RARE_RUNS: u64 = 20_000;
const USUAL_RATE: f64 = 1e-6;
/// The most runs of a study.
const MOST_RUNS: u64 = 100_000_000;
/// Numbers of runs at which a study looks, in parts of 1/p.
const LOOKS: [f64; 4] = [5.0, 10.0, 30.0, 100.0];

/// The verdict on a rate of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The rate is below the allowed one.
    Passed,
    /// The rate is above it.
    Failed,
    /// The runs don't decide it.
    Undecided,
}

/// The plan of a study. It is fixed before the first run, which makes the confidence valid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    at_most: Option<f64>,
    confidence: f64,
    /// Numbers of runs at which it looks, ascending; the last one is the total.
    looks: Vec<u64>,
    /// Sizes of a subset simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rare: Option<Sizes>,
}

/// The smallest rate of a subset simulation: places of samples have 16 digits.
const SMALLEST_RATE: f64 = 1e-12;

impl Plan {
    /// A plan with an allowed rate of failure, or none, a confidence, and the most runs, if given by the user.
    ///
    /// # Errors
    /// When a rate or a confidence isn't between 0 and 1, or runs are too many or none.
    pub fn new(at_most: Option<f64>, confidence: f64, runs: Option<u64>) -> Result<Self, String> {
        check(at_most, confidence)?;
        let planned = at_most.map(|rate| LOOKS.map(|look| (look / rate).ceil()));
        if let Some([.., last]) = planned.filter(|looks| runs.is_none() && looks[3] > MOST_RUNS as f64) {
            let rate = at_most.unwrap_or_default();
            return Err(format!(
                "--at-most {rate} may need {last:e} runs; at most {MOST_RUNS} are allowed. Choose a number with --runs"
            ));
        }
        let most = planned.map_or(USUAL_RUNS, |looks| looks[3].min(u64::MAX as f64) as u64);
        let most = if at_most.is_some() { runs.unwrap_or(most).min(most) } else { runs.unwrap_or(most) };
        if !(1..=MOST_RUNS).contains(&most) {
            return Err(format!("--runs {most}: must be within 1 … {MOST_RUNS}"));
        }
        let before = planned.into_iter().flatten().map(|look| look as u64).filter(|look| *look < most);
        Ok(Plan { at_most, confidence, looks: before.chain([most]).collect(), rare: None })
    }

    /// A plan of a subset simulation.
    ///
    /// # Errors
    /// See [`Plan::new`].
    pub fn rare(at_most: Option<f64>, confidence: f64, runs: Option<u64>) -> Result<Self, String> {
        check(at_most, confidence)?;
        let most = runs.unwrap_or(USUAL_RARE_RUNS);
        if most > MOST_RUNS {
            return Err(format!("--runs {most}: must be at most {MOST_RUNS}"));
        }
        let rate = at_most.unwrap_or(USUAL_RATE);
        if rate < SMALLEST_RATE {
            return Err(format!("--at-most {rate}: must be at least {SMALLEST_RATE} with --rare"));
        }
        let sizes = Sizes::new(most, rate)?;
        Ok(Plan { at_most, confidence, looks: vec![sizes.runs()], rare: Some(sizes) })
    }

    /// Sizes of its subset simulation, if it is one.
    pub(super) fn sizes(&self) -> Option<Sizes> {
        self.rare
    }

    /// The allowed rate of failure; none if the study only estimates it.
    pub fn at_most(&self) -> Option<f64> {
        self.at_most
    }

    /// The confidence.
    pub fn confidence(&self) -> f64 {
        self.confidence
    }

    /// The most runs.
    pub fn runs(&self) -> u64 {
        self.looks.last().copied().unwrap_or(1)
    }

    /// The number of runs at the next look.
    pub fn next_look(&self, runs: u64) -> Option<u64> {
        self.looks.iter().copied().find(|look| *look > runs)
    }

    /// The verdict at a look; none if the study goes on. The looks share the allowed probability of error.
    pub fn verdict(&self, failures: u64, runs: u64) -> Option<Verdict> {
        let rate = self.at_most.filter(|_| self.looks.contains(&runs))?;
        let error = self.error();
        if upper(failures, runs, error) < rate {
            Some(Verdict::Passed)
        } else if lower(failures, runs, error) > rate {
            Some(Verdict::Failed)
        } else {
            (runs == self.runs()).then_some(Verdict::Undecided)
        }
    }

    /// The bounds for a verdict: the true rate is below the first, or above the second, with at most the allowed
    /// probability of error.
    pub fn bounds(&self, failures: u64, runs: u64) -> [f64; 2] {
        [lower(failures, runs, self.error()), upper(failures, runs, self.error())]
    }

    /// The interval that contains the true rate with the confidence, at any end of the study.
    pub fn interval(&self, failures: u64, runs: u64) -> [f64; 2] {
        let error = 0.5 * self.error();
        [lower(failures, runs, error), upper(failures, runs, error)]
    }

    /// The verdict on the result of a subset simulation.
    pub(super) fn verdict_on(&self, found: &Found) -> Option<Verdict> {
        let [low, high] = found.bounds(1.0 - self.confidence);
        self.at_most.map(|rate| match () {
            () if high < rate => Verdict::Passed,
            () if low > rate => Verdict::Failed,
            () => Verdict::Undecided,
        })
    }

    /// The probability of error of one bound at one look.
    fn error(&self) -> f64 {
        (1.0 - self.confidence) / if self.at_most.is_some() { LOOKS.len() as f64 } else { 1.0 }
    }
}

/// Refuses rates and confidences that aren't between 0 and 1.
fn check(at_most: Option<f64>, confidence: f64) -> Result<(), String> {
    let is_part = |value: f64| value > 0.0 && value < 1.0;
    match at_most.filter(|rate| !is_part(*rate)) {
        Some(rate) => Err(format!("--at-most {rate}: must be above 0 and below 1")),
        None if !is_part(confidence) => Err(format!("--confidence {confidence}: must be above 0 and below 1")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::Random;
    use super::*;

    #[test]
    fn looks_are_after_five_to_a_hundred_times_the_inverse_rate() {
        let plan = Plan::new(Some(1e-4), 0.95, None).unwrap();
        assert_eq!(plan.looks, [50_000, 100_000, 300_000, 1_000_000]);
        assert_eq!(Plan::new(Some(1e-4), 0.95, Some(200_000)).unwrap().looks, [50_000, 100_000, 200_000]);
        assert_eq!(Plan::new(Some(1e-2), 0.95, Some(1_000_000)).unwrap().runs(), 10_000);
        assert_eq!(Plan::new(None, 0.95, None).unwrap().looks, [10_000]);
        assert_eq!(plan.next_look(50_000), Some(100_000));
        assert_eq!(plan.next_look(1_000_000), None);
    }

    #[test]
    fn what_is_no_rate_no_confidence_or_too_much_is_refused() {
        let refused = |at_most, confidence, runs| Plan::new(at_most, confidence, runs).unwrap_err();
        assert!(refused(Some(0.0), 0.95, None).contains("--at-most 0"));
        assert!(refused(Some(f64::NAN), 0.95, None).contains("--at-most NaN"));
        assert!(refused(None, 1.0, None).contains("--confidence 1"));
        assert!(refused(None, 0.95, Some(0)).contains("--runs 0"));
        assert!(refused(Some(1e-9), 0.95, None).contains("--runs"));
        assert_eq!(Plan::new(Some(1e-9), 0.95, Some(1000)).unwrap().looks, [1000]);
    }

    #[test]
    fn no_failure_settles_at_the_first_look_and_many_do() {
        let plan = Plan::new(Some(1e-4), 0.95, None).unwrap();
        assert_eq!(plan.verdict(0, 50_000), Some(Verdict::Passed));
        assert_eq!(plan.verdict(0, 49_999), None);
        assert_eq!(plan.verdict(5, 50_000), None);
        assert_eq!(plan.verdict(20, 50_000), Some(Verdict::Failed));
        assert_eq!(plan.verdict(100, 1_000_000), Some(Verdict::Undecided));
    }

    /// A study of runs that fail with a known rate: its verdict, and its interval.
    fn studied(plan: &Plan, rate: f64, seed: u64) -> (Option<Verdict>, [f64; 2]) {
        let (mut failures, mut runs) = (0, 0);
        while let Some(look) = plan.next_look(runs) {
            let fails = |sample: &u64| Random { seed, sample: *sample }.uniform("run") < rate;
            failures += (runs..look).filter(fails).count() as u64;
            runs = look;
            if let Some(verdict) = plan.verdict(failures, runs) {
                return (Some(verdict), plan.interval(failures, runs));
            }
        }
        (None, plan.interval(failures, runs))
    }

    #[test]
    fn intervals_hold_the_known_rate_also_where_a_study_ends_early() {
        for (at_most, runs, rate) in [
            (None, 500, 0.1),
            (None, 2000, 0.003),
            (Some(0.02), 5000, 0.01),
            (Some(0.02), 5000, 0.02),
            (Some(0.02), 5000, 0.03),
        ] {
            let plan = Plan::new(at_most, 0.95, Some(runs)).unwrap();
            let holds = |seed: &u64| {
                let [low, high] = studied(&plan, rate, *seed).1;
                low <= rate && rate <= high
            };
            let covered = (1..=100).filter(holds).count();
            assert!(covered >= 90, "{covered} of 100 intervals hold {rate} with {at_most:?}");
        }
    }

    #[test]
    fn verdicts_are_wrong_no_more_often_than_the_confidence_leaves() {
        let plan = Plan::new(Some(0.02), 0.9, None).unwrap();
        let verdicts = |rate: f64| (1..=200).map(|seed| studied(&plan, rate, seed).0).collect::<Vec<_>>();
        let count = |verdicts: &[Option<Verdict>], of| verdicts.iter().filter(|it| **it == Some(of)).count();
        let (below, above) = (verdicts(0.019), verdicts(0.021));
        assert!(count(&below, Verdict::Failed) <= 20 && count(&above, Verdict::Passed) <= 20);
        let (well, badly) = (verdicts(0.005), verdicts(0.06));
        assert!(count(&well, Verdict::Passed) >= 195 && count(&badly, Verdict::Failed) >= 195);
    }
}
