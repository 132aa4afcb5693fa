//! The result of a study in words, as a table, and as JSON.

use std::fmt::Write;

use serde_json::{Value, json};

use super::accelerated::not_used;
use super::outcome::{Judged, Outcome};
use super::plan::{Plan, Verdict};
use super::sensitivity::{first_order, ranks};
use super::study::{Ended, Study};
use crate::results::four_digits;
use crate::text_file::csv_field;

/// Number of samples of each kind whose values are written as parameter sets.
const MOST_SETS: usize = 100;

/// A study with its outcomes.
#[derive(Debug)]
pub struct Summary<'a> {
    /// The study.
    pub study: &'a Study,
    /// Its plan.
    pub plan: &'a Plan,
    /// The outcome of each sample.
    pub outcomes: &'a [Outcome],
    /// Its end.
    pub ended: &'a Ended,
    /// Metrics of the nominal loop, if it reaches its end.
    pub as_it_is: Option<&'a [Option<f64>]>,
    /// True if a run simulates one continuous system.
    pub composite: bool,
}

/// Influence of one quantity on the failures.
#[derive(Debug, Clone, PartialEq)]
pub struct Index {
    /// Its name.
    pub name: String,
    /// Its distribution.
    pub distribution: String,
    /// First-order index of failing; none if no run or every run fails.
    pub of_failing: Option<f64>,
    /// First-order index of the distance to the nearest limit, by ranks.
    pub of_distance: Option<f64>,
}

/// Values and results of all runs.
#[derive(Debug)]
pub(super) struct Runs {
    /// A column for each quantity.
    pub columns: Vec<Vec<f64>>,
    /// True for each run that failed.
    pub failed: Vec<bool>,
    /// Excess of each over its nearest limit, positive beyond it.
    pub excess: Vec<f64>,
}

impl Summary<'_> {
    /// The verdict, in one sentence.
    pub fn verdict(&self) -> String {
        if let Some(found) = &self.ended.rare {
            return self.rare_verdict(found);
        }
        if self.plan.sizes().is_some() {
            return format!("{} runs so far; the failure rate follows at the end.", thousands(self.ended.tally.runs));
        }
        let (tally, percent) = (&self.ended.tally, percent(&self.interval()));
        let counted = format!("{} of {} runs fail", thousands(tally.failures), thousands(tally.runs));
        let share = if tally.failures == 0 { String::new() } else { format!(", {} %", share(tally.share())) };
        let confidence = format!("with {} % confidence", shown(100.0 * self.plan.confidence()));
        let rate = self.plan.at_most().map(rate).unwrap_or_default();
        match self.ended.verdict {
            Some(Verdict::Passed) => format!("Passed: {counted}{share}; {confidence} fewer than {rate} do."),
            Some(Verdict::Failed) => format!("Failed: {counted}{share}; {confidence} more than {rate} do."),
            Some(Verdict::Undecided) => {
                format!("Undecided: {counted}{share}; {confidence} {percent}, while {rate} may.")
            }
            None => format!("{counted}{share}; {confidence} {percent}."),
        }
    }

    /// The confidence interval of the failing part of runs.
    pub fn interval(&self) -> [f64; 2] {
        if let Some(found) = &self.ended.rare {
            return found.bounds(0.5 * (1.0 - self.plan.confidence()));
        }
        if self.plan.sizes().is_some() {
            return [0.0, 1.0];
        }
        self.plan.interval(self.ended.tally.failures, self.ended.tally.runs)
    }

    /// Counts of violated limits and of samples without a result, a sentence each.
    pub fn counts(&self) -> Vec<String> {
        let tally = &self.ended.tally;
        let violated = |(k, limit)| {
            let violated = tally.violated.get(&k).copied().unwrap_or_default();
            format!("{limit}: violated in {} runs", thousands(violated))
        };
        let mut counts: Vec<String> = match &self.ended.rare {
            Some(found) => self.rare_counts(found),
            None => self.study.limits().of.iter().enumerate().map(violated).collect(),
        };
        if tally.not_ended > 0 {
            counts.push(format!("{} runs did not reach their end", thousands(tally.not_ended)));
        }
        if tally.without_value > 0 {
            counts.push(format!("{} runs lack a value of a required metric", thousands(tally.without_value)));
        }
        if tally.refused > 0 {
            counts.push(format!("components refused {} samples, which are not runs", thousands(tally.refused)));
        }
        counts
    }

    /// Form of a run, and where runs were made.
    pub fn form(&self) -> String {
        let mut form = if self.composite {
            "Each run simulates the loop as one continuous system.".to_owned()
        } else {
            "Each run couples separate FMUs at the communication step.".to_owned()
        };
        if let Some(device) = &self.study.accelerated {
            let _ = write!(form, " {}", device.described(self.study.settings().step));
        } else if let Some(reason) = &self.study.by_processor {
            let _ = write!(form, " {}", not_used(reason));
        }
        form
    }

    /// Numbers of samples that are runs.
    pub(super) fn runs(&self) -> impl Iterator<Item = (u64, &Outcome)> {
        let all = self.outcomes.iter().enumerate().map(|(k, outcome)| (k as u64, outcome));
        all.filter(|(_, outcome)| !matches!(outcome, Outcome::Refused(_)))
    }

    /// The first samples that failed.
    pub fn failed(&self) -> Vec<u64> {
        let is_failure = |outcome: &Outcome| self.study.limits().judge(outcome).is_failure();
        self.runs().filter(|(_, outcome)| is_failure(outcome)).map(|(k, _)| k).take(MOST_SETS).collect()
    }

    /// The samples with the largest excess over a limit; those that don't reach their end are first.
    pub fn worst(&self) -> Vec<u64> {
        let mut order: Vec<(f64, u64)> =
            self.runs().map(|(k, outcome)| (self.study.limits().excess(outcome), k)).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        order.into_iter().map(|(_, k)| k).take(MOST_SETS).collect()
    }

    /// Result of a sample, in one line.
    pub fn described(&self, sample: u64) -> String {
        let limits = self.study.limits();
        match &self.outcomes[sample as usize] {
            Outcome::Refused(reason) => format!("refused: {reason}"),
            Outcome::NotEnded(reason) => format!("did not reach its end: {reason}"),
            Outcome::Ended(metrics) => {
                let one = |(limit, &place): (&_, &usize)| {
                    let value = metrics[place].map_or("no value".to_owned(), four_digits);
                    format!("{value} for {limit}")
                };
                limits.of.iter().zip(&limits.places).map(one).collect::<Vec<_>>().join("; ")
            }
        }
    }

    /// Values and results of all runs.
    pub(super) fn table(&self) -> Runs {
        let count = self.study.names().len();
        let mut runs = Runs { columns: vec![Vec::new(); count], failed: Vec::new(), excess: Vec::new() };
        for (k, outcome) in self.runs() {
            runs.columns.iter_mut().zip(self.study.values(k)).for_each(|(column, value)| column.push(value));
            runs.failed.push(self.study.limits().judge(outcome).is_failure());
            runs.excess.push(self.study.limits().excess(outcome));
        }
        runs
    }

    /// Influences on the failures, the most important quantity first.
    pub fn indices(&self) -> Vec<Index> {
        self.indices_of(&self.table())
    }

    pub(super) fn indices_of(&self, runs: &Runs) -> Vec<Index> {
        let failing: Vec<f64> = runs.failed.iter().map(|failed| f64::from(u8::from(*failed))).collect();
        // Samples of a subset simulation don't have the distributions.
        let (distance, is_plain) = (ranks(&runs.excess), self.plan.sizes().is_none());
        let named = self.study.names().into_iter().zip(self.study.distributions()).zip(&runs.columns);
        let index = |((name, distribution), column): ((&str, String), &Vec<f64>)| Index {
            name: name.to_owned(),
            distribution,
            of_failing: first_order(column, &failing).filter(|_| is_plain),
            of_distance: first_order(column, &distance).filter(|_| is_plain),
        };
        let mut indices: Vec<_> = named.map(index).collect();
        let size = |index: &Index| index.of_failing.or(index.of_distance).unwrap_or_default();
        indices.sort_by(|a, b| size(b).total_cmp(&size(a)));
        indices
    }

    /// All samples, a line each.
    pub fn csv(&self) -> String {
        let seeds = self.study.start_values(0).into_iter().filter(|(_, kind, _)| *kind == "Integer");
        let names = self.study.names().into_iter().map(str::to_owned).chain(seeds.map(|(name, ..)| name));
        let labels = self.study.labels().iter().cloned();
        let head = ["sample".to_owned()].into_iter().chain(names).chain(["result".to_owned()]);
        let head = head.chain(labels).chain(["message".to_owned()]);
        let mut csv = head.map(|name| csv_field(&name).into_owned()).collect::<Vec<_>>().join(",") + "\n";
        for (k, outcome) in self.outcomes.iter().enumerate() {
            let _ = write!(csv, "{k}");
            self.study.values(k as u64).iter().for_each(|value| _ = write!(csv, ",{value}"));
            self.study.seeds(k as u64).iter().for_each(|seed| _ = write!(csv, ",{seed}"));
            let _ = write!(csv, ",{}", self.study.limits().judge(outcome).word());
            let message = match outcome {
                Outcome::Ended(metrics) => {
                    let text = |value: &Option<f64>| value.map_or(String::new(), |value| value.to_string());
                    metrics.iter().for_each(|value| _ = write!(csv, ",{}", text(value)));
                    ""
                }
                Outcome::NotEnded(reason) | Outcome::Refused(reason) => {
                    csv.push_str(&",".repeat(self.study.labels().len()));
                    reason
                }
            };
            let _ = writeln!(csv, ",{}", csv_field(message));
        }
        csv
    }

    /// The result for scripts.
    pub fn json(&self) -> Value {
        let tally = &self.ended.tally;
        let limit = |(k, limit): (usize, &super::requirement::Limit)| {
            json!({ "label": limit.label, "side": limit.side, "value": limit.value,
                    "violated": tally.violated.get(&k).copied().unwrap_or_default() })
        };
        let index = |index: Index| {
            json!({ "name": index.name, "distribution": index.distribution,
                    "index_of_failing": index.of_failing, "index_of_distance": index.of_distance })
        };
        let metrics = |values: &[Option<f64>]| {
            let values = values.iter().map(|value| json!(value));
            self.study.labels().iter().cloned().zip(values).collect::<serde_json::Map<_, _>>()
        };
        json!({
            "loop": self.study.structure().name,
            "ended": if self.ended.interrupted { "interrupted" } else { "complete" },
            "verdict": self.ended.verdict, "sentence": self.verdict(),
            "runs": tally.runs, "failures": tally.failures, "share": self.share(), "interval": self.interval(),
            "at_most": self.plan.at_most(), "confidence": self.plan.confidence(),
            "not_ended": tally.not_ended, "without_value": tally.without_value, "refused": tally.refused,
            "one_system": self.composite,
            "accelerated": self.study.accelerated.as_ref().map(|device| device.json(self.study.settings().step)),
            "by_processor": self.study.by_processor,
            "rare": self.ended.rare.as_ref().map(|found| self.rare_json(found)),
            "requirements": self.study.limits().of.iter().enumerate().map(limit).collect::<Vec<_>>(),
            "varied": self.indices().into_iter().map(index).collect::<Vec<_>>(),
            "as_it_is": self.as_it_is.map(metrics),
        })
    }

    /// The estimated rate of failure; none after an interruption of a subset simulation.
    fn share(&self) -> Option<f64> {
        match &self.ended.rare {
            Some(found) => Some(found.rate()),
            None => Some(self.ended.tally.share()).filter(|_| self.plan.sizes().is_none()),
        }
    }

    /// Verdict on a sample.
    pub(super) fn judged(&self, sample: u64) -> Judged {
        self.study.limits().judge(&self.outcomes[sample as usize])
    }
}

/// A whole number with commas between thousands.
pub(super) fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number without needless digits.
pub(super) fn shown(value: f64) -> String {
    crate::report::number((value * 1e9).round() / 1e9)
}

/// A part in per cent, with three digits.
pub(super) fn share(part: f64) -> String {
    three_digits(100.0 * part, 100.0 * part)
}

/// A rate: one in so many, if that is a whole number.
pub(super) fn rate(rate: f64) -> String {
    let inverse = 1.0 / rate;
    if inverse >= 2.0 && (inverse - inverse.round()).abs() < 1e-6 * inverse {
        format!("1 in {}", thousands(inverse.round() as u64))
    } else {
        format!("{} %", share(rate))
    }
}

/// An interval of parts in per cent.
fn percent([low, high]: &[f64; 2]) -> String {
    format!("{} … {} %", three_digits(100.0 * low, 100.0 * high), three_digits(100.0 * high, 100.0 * high))
}

/// A value with as many decimals as three digits of another need.
fn three_digits(value: f64, of: f64) -> String {
    let decimals = if of > 0.0 { (2.0 - of.log10().floor()).clamp(0.0, 12.0) as usize } else { 0 };
    if value == 0.0 { "0".to_owned() } else { format!("{value:.decimals$}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_a_reader_expects_them() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!([1e-5, 0.01, 0.3].map(rate), ["1 in 100,000", "1 in 100", "30.0 %"]);
        assert_eq!(percent(&[0.1566, 0.1903]), "15.7 … 19.0 %");
        assert_eq!(percent(&[0.0, 8.76e-6]), "0 … 0.000876 %");
        assert_eq!((share(0.173), share(1.0)), ("17.3".to_owned(), "100".to_owned()));
    }
}
