//! The result of a subset simulation in words, as JSON, and on the page.

use std::fmt::Write;

use serde_json::{Value, json};

use super::outcome::Outcome;
use super::plan::Verdict;
use super::subset::{Found, Level};
use super::summary::{Summary, rate, share, shown, thousands};
use crate::drawing::escaped;
use crate::report::number;
use crate::results::four_digits;

/// Parts of the failing samples below the values that are shown.
const PARTS: [f64; 3] = [0.05, 0.5, 0.95];
/// Rates below this are shown as one in so many.
const SMALL: f64 = 0.05;

/// Values of one quantity in the failing samples.
#[derive(Debug, Clone, PartialEq)]
pub struct FailingRange {
    /// Its name.
    pub name: String,
    /// Its distribution.
    pub distribution: String,
    /// Values that 5 %, half and 95 % of the failing samples don't exceed; none if no sample fails.
    pub values: Option<[f64; 3]>,
}

impl Summary<'_> {
    /// The verdict of a subset simulation, in one sentence.
    pub(super) fn rare_verdict(&self, found: &Found) -> String {
        let confidence = format!("with {} % confidence", shown(100.0 * self.plan.confidence()));
        let about = match found.rate() {
            0.0 => "no run fails".to_owned(),
            small if small < SMALL => format!("about {} runs fails", one_in(small)),
            large => format!("about {} of the runs fail", one_in(large)),
        };
        let ([low, high], allowed) = (self.interval(), self.plan.at_most().map(rate).unwrap_or_default());
        let between = match low {
            0.0 => format!("fewer than {} do", one_in(high)),
            low => format!("between {} and {} do", one_in(low), one_in(high)),
        };
        match self.ended.verdict {
            Some(Verdict::Passed) => format!("Passed: {about}; {confidence} fewer than {allowed} do."),
            Some(Verdict::Failed) => format!("Failed: {about}; {confidence} more than {allowed} do."),
            Some(Verdict::Undecided) => format!("Undecided: {about}; {confidence} {between}, while {allowed} may."),
            None => format!("{}{}; {confidence} {between}.", about[..1].to_uppercase(), &about[1..]),
        }
    }

    /// Sizes of a subset simulation, and violated limits in its failing samples.
    pub(super) fn rare_counts(&self, found: &Found) -> Vec<String> {
        let (levels, runs) = (found.levels.len(), thousands(self.ended.tally.runs));
        let plural = if levels == 1 { "level" } else { "levels" };
        let deviation = if found.failing.is_empty() || levels == 1 {
            String::new()
        } else {
            format!("; relative standard deviation of the rate {:.0} %", 100.0 * found.deviation)
        };
        let limits = self.study.limits();
        let violated = |(k, limit): (usize, _)| {
            let is_violated = |sample: &&u64| match &self.outcomes[**sample as usize] {
                Outcome::Ended(metrics) => {
                    metrics[limits.places[k]].is_some_and(|value| limits.of[k].is_violated(value))
                }
                _ => false,
            };
            let count = thousands(found.failing.iter().filter(is_violated).count() as u64);
            format!("{limit}: violated in {count} of {} failing samples", thousands(found.failing.len() as u64))
        };
        let sizes = format!("{levels} {plural} with {runs} runs{deviation}");
        let has_no_margin = |sample: &&u64| match &self.outcomes[**sample as usize] {
            Outcome::Ended(metrics) => limits.places.iter().any(|place| metrics[*place].is_none()),
            _ => true,
        };
        let sudden = found.failing.iter().filter(has_no_margin).count() as u64;
        let sudden = (sudden > 0).then(|| format!("{} failing samples end early or lack a metric", thousands(sudden)));
        let assumed =
            "assumed: margins get smaller before a run fails; plain runs, without --rare, show other failures";
        let lines = [sizes].into_iter().chain(limits.of.iter().enumerate().map(violated)).chain(sudden);
        lines.chain([assumed.to_owned()]).collect()
    }

    /// Values of the quantities in the failing samples of a subset simulation; none of another study.
    pub fn failing_ranges(&self) -> Option<Vec<FailingRange>> {
        let found = self.ended.rare.as_ref()?;
        let samples: Vec<Vec<f64>> = found.failing.iter().map(|sample| self.study.values(*sample)).collect();
        let named = self.study.names().into_iter().zip(self.study.distributions()).enumerate();
        let range = |(k, (name, distribution)): (usize, (&str, String))| {
            let mut values: Vec<f64> = samples.iter().map(|sample| sample[k]).collect();
            values.sort_by(f64::total_cmp);
            let at = |part: f64| values[(part * (values.len() - 1) as f64).round() as usize];
            let values = (!values.is_empty()).then(|| PARTS.map(at));
            FailingRange { name: name.to_owned(), distribution, values }
        };
        Some(named.map(range).collect())
    }

    /// Levels and ranges for scripts.
    pub(super) fn rare_json(&self, found: &Found) -> Value {
        let level = |level: &Level| {
            json!({ "margin": level.margin, "samples": level.samples, "within": level.within,
                    "accepted": level.accepted })
        };
        let range = |range: FailingRange| json!({ "name": range.name, "distribution": range.distribution, "values": range.values });
        json!({
            "levels": found.levels.iter().map(level).collect::<Vec<_>>(), "deviation": found.deviation,
            "failing": self.failing_ranges().unwrap_or_default().into_iter().map(range).collect::<Vec<_>>(),
        })
    }

    /// Writes levels and ranges as tables.
    pub(super) fn push_rare(&self, page: &mut String, found: &Found) {
        page.push_str(
            "<h2>Values in failing samples</h2>\n<table>\n<tr><th>parameter<th>distribution<th class=\"number\">5 % below\
             <th class=\"number\">median<th class=\"number\">95 % below",
        );
        for FailingRange { name, distribution, values } in self.failing_ranges().unwrap_or_default() {
            let _ = write!(page, "\n<tr><td>{}<td>{}", escaped(&name), escaped(&distribution));
            let shown = |value: f64| if value.is_nan() { "–".to_owned() } else { number(value) };
            let values = values.unwrap_or([f64::NAN; 3]);
            values.iter().for_each(|value| _ = write!(page, "<td class=\"number\">{}", shown(*value)));
        }
        page.push_str(
            "\n</table>\n<h2>Levels</h2>\n<p>Each level contains the samples of the one before that are nearest to a \
             limit. The failure rate is the product of their shares.</p>\n<table>\n<tr><th class=\"number\">level\
             <th class=\"number\">distance to the limit in parts of it<th class=\"number\">samples\
             <th class=\"number\">within this distance<th class=\"number\">accepted candidates in %",
        );
        for (k, Level { margin, samples, within, accepted }) in found.levels.iter().enumerate() {
            let accepted = accepted.map_or("–".to_owned(), |part| format!("{:.0}", 100.0 * part));
            let (margin, samples, within) = (four_digits(*margin), thousands(*samples), thousands(*within));
            let _ = write!(page, "\n<tr><td class=\"number\">{}<td class=\"number\">{margin}", k + 1);
            let _ = write!(page, "<td class=\"number\">{samples}<td class=\"number\">{within}");
            let _ = write!(page, "<td class=\"number\">{accepted}");
        }
        page.push_str("\n</table>\n");
    }
}

/// A rate as one in so many, with three digits; in per cent if it isn't small.
fn one_in(rate: f64) -> String {
    if rate >= SMALL {
        return format!("{} %", share(rate));
    }
    let inverse = 1.0 / rate;
    let unit = 10.0_f64.powf(inverse.log10().floor() - 2.0).max(1.0);
    format!("1 in {}", thousands((unit * (inverse / unit).round()) as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_one_in_a_round_number() {
        assert_eq!([1.0145e-6, 0.01, 0.3].map(one_in), ["1 in 986,000", "1 in 100", "30.0 %"]);
    }
}
