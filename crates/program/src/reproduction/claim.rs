//! Claims of an example, and their check.

use serde::{Deserialize, Serialize};

use super::outcome::Outcome;
use crate::results::{Ending, Measured, Verdict, four_digits};

/// A claim, in words and by metrics: `RUN: LABEL`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// Wording.
    pub text: String,
    /// Metrics that are within their limits.
    #[serde(default)]
    pub measured: Vec<String>,
    /// Limit for all of them, in place of their own.
    pub limit: Option<f64>,
    /// Metrics that are smaller, each,
    #[serde(default)]
    pub smaller: Vec<String>,
    /// than these.
    #[serde(default)]
    pub than: Vec<String>,
    /// A run that must end with a failure.
    pub fails: Option<String>,
    /// Remark on a claim that doesn't hold, or not for the reason that is given.
    #[serde(default)]
    pub remark: String,
}

/// A claim, and what was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// The claim in words.
    pub claim: String,
    /// Measured values.
    pub measured: String,
    /// True if it holds.
    pub holds: bool,
    /// Remark on it.
    pub remark: String,
}

impl Claim {
    /// Judges it by the runs.
    ///
    /// # Errors
    /// When it names a run or a metric that doesn't exist, or has no criterion.
    pub fn judge(&self, outcomes: &[Outcome]) -> Result<Judged, String> {
        let mut endings = Vec::new();
        let mut holds = true;
        for name in &self.measured {
            let metric = metric(name, outcomes)?;
            let limit = self.limit.or(metric.limit).ok_or_else(|| format!("`{name}` has no limit"))?;
            holds &= metric.value.is_some_and(|value| value <= limit);
            endings.push(format!("{} {} ({limit} allowed)", short(name, outcomes), shown(metric)));
        }
        if self.smaller.len() != self.than.len() {
            return Err(format!("`{}`: `smaller` and `than` must list as many metrics as each other", self.text));
        }
        for (small, large) in self.smaller.iter().zip(&self.than) {
            let (less, more) = (metric(small, outcomes)?, metric(large, outcomes)?);
            holds &= less.value.zip(more.value).is_some_and(|(less, more)| less < more);
            endings.push(format!("{small} {} against {} in {}", shown(less), shown(more), run_of(large)));
        }
        if let Some(run) = &self.fails {
            let outcome = outcome(run, outcomes)?;
            holds &= outcome.verdict == Verdict::Holds && matches!(outcome.ending, Ending::Failed(_));
            endings.push(outcome.to_text());
        }
        if endings.is_empty() {
            return Err(format!("`{}` has no criterion: give measured, smaller and than, or fails", self.text));
        }
        Ok(Judged { claim: self.text.clone(), measured: endings.join("; "), holds, remark: self.remark.clone() })
    }
}

fn run_of(name: &str) -> &str {
    name.split_once(": ").map_or(name, |(run, _)| run)
}

/// The name of a metric, without its run if there is only one.
fn short<'a>(name: &'a str, outcomes: &[Outcome]) -> &'a str {
    let alone = outcomes.len() == 1;
    name.split_once(": ").filter(|_| alone).map_or(name, |(_, label)| label)
}

fn shown(metric: &Measured) -> String {
    metric.value.map_or("–".to_owned(), four_digits)
}

fn outcome<'a>(run: &str, outcomes: &'a [Outcome]) -> Result<&'a Outcome, String> {
    outcomes.iter().find(|outcome| outcome.run == run).ok_or_else(|| format!("there is no run `{run}`"))
}

fn metric<'a>(name: &str, outcomes: &'a [Outcome]) -> Result<&'a Measured, String> {
    let (run, label) = name.split_once(": ").ok_or_else(|| format!("`{name}`: must be RUN: METRIC"))?;
    let found = outcome(run, outcomes)?.measured.iter().find(|metric| metric.label == label);
    found.ok_or_else(|| format!("`{run}` has no metric `{label}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcomes() -> Vec<Outcome> {
        let metric = |value, limit| vec![Measured { label: "rms e".into(), value: Some(value), limit }];
        let complete = |run: &str, measured| Outcome::without_curves(run, Ending::Complete, Verdict::Holds, measured);
        let lost = Outcome::without_curves("lost", Ending::Failed("lost".into()), Verdict::Holds, vec![]);
        vec![complete("fast", metric(0.1, Some(0.2))), complete("slow", metric(0.3, None)), lost]
    }

    fn judged(toml: &str) -> Result<Judged, String> {
        toml::from_str::<Claim>(&format!("text = 'c'\n{toml}")).unwrap().judge(&outcomes())
    }

    #[test]
    fn a_claim_holds_where_its_numbers_do() {
        for (toml, holds) in [
            ("measured = ['fast: rms e']", true),
            ("measured = ['fast: rms e']\nlimit = 0.05", false),
            ("measured = ['fast: rms e', 'slow: rms e']\nlimit = 0.25", false),
            ("smaller = ['fast: rms e']\nthan = ['slow: rms e']", true),
            ("smaller = ['slow: rms e']\nthan = ['fast: rms e']", false),
            ("fails = 'lost'", true),
            ("fails = 'fast'", false),
        ] {
            assert_eq!(judged(toml).unwrap().holds, holds, "{toml}");
        }
        assert!(judged("measured = ['fast: rms e']").unwrap().measured.contains("0.1000 (0.2 allowed)"));
    }

    #[test]
    fn a_claim_about_what_is_not_there_is_refused_by_name() {
        for (toml, named) in [
            ("", "no criterion"),
            ("measured = ['fast: max e']", "max e"),
            ("measured = ['other: rms e']", "other"),
            ("measured = ['slow: rms e']", "no limit"),
            ("smaller = ['fast: rms e']", "as many"),
            ("fails = 'other'", "other"),
        ] {
            assert!(judged(toml).unwrap_err().contains(named), "{toml}");
        }
    }
}
