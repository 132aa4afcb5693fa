//! Requirements of a run, as written by a user, and as limits of its metrics.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::near;
use crate::simulation::LoadedLoop;
use crate::structure::{Metric, Statistic, Structure};

const FORM: &str = "must be LABEL <= VALUE, LABEL >= VALUE or funnel";
/// The requirement of every funnel.
const FUNNEL: &str = "funnel";
/// Outputs of a component that monitors or prescribes a funnel: they count how often its error left it.
const EXITS: [&str; 2] = ["funnel_exits", "funnel_reopened"];
/// End of the label of a metric in percent.
const PERCENT: &str = ", %";
/// Short forms of metrics of steps: the word, the label's parts before and after the signal, and the label's unit.
const SHORT: [(&str, &str, &str, f64); 3] = [
    ("overshoot", "overshoot of ", PERCENT, 100.0),
    ("settling", "settling time of ", ", s", 1.0),
    ("rise", "rise time of ", ", s", 1.0),
];

/// The side of a value on which a metric must be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Upper limit.
    #[serde(rename = "<=")]
    AtMost,
    /// Lower limit.
    #[serde(rename = ">=")]
    AtLeast,
}

/// A requirement as it is written.
#[derive(Debug, Clone, PartialEq)]
pub enum Requirement {
    /// Errors stay within their funnels at all times.
    Funnel,
    /// A metric, by its label or its short form, on a side of a value.
    Metric {
        /// The label, or the short form.
        label: String,
        /// The side.
        side: Side,
        /// The value.
        value: f64,
        /// True if it is in percent.
        percent: bool,
    },
}

impl FromStr for Requirement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim() == FUNNEL {
            return Ok(Requirement::Funnel);
        }
        let places = [("<=", Side::AtMost), (">=", Side::AtLeast)];
        let last = places.into_iter().filter_map(|(sign, side)| Some((text.rfind(sign)?, side))).max_by_key(|it| it.0);
        let (place, side) = last.ok_or(FORM)?;
        let (label, written) = (text[..place].trim(), text[place + 2..].trim());
        let (number, percent) = written.strip_suffix('%').map_or((written, false), |number| (number, true));
        let value = number.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let value = value.ok_or_else(|| format!("`{written}` must be a finite number: {FORM}"))?;
        if label.is_empty() {
            return Err(FORM.to_owned());
        }
        Ok(Requirement::Metric { label: label.to_owned(), side, value, percent })
    }
}

/// A limit of a metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// The metric's label.
    pub label: String,
    /// The side of the value.
    pub side: Side,
    /// The value.
    pub value: f64,
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = if self.side == Side::AtMost { "<=" } else { ">=" };
        write!(f, "{} {side} {}", self.label, self.value)
    }
}

impl Limit {
    /// True if a metric violates it.
    pub fn is_violated(&self, metric: f64) -> bool {
        match self.side {
            Side::AtMost => metric > self.value,
            Side::AtLeast => metric < self.value,
        }
    }

    /// The excess of a metric over the limit in parts of it, positive if it is violated; in the metric's unit if the
    /// limit is 0.
    pub fn excess(&self, metric: f64) -> f64 {
        let beyond = if self.side == Side::AtMost { metric - self.value } else { self.value - metric };
        if self.value == 0.0 { beyond } else { beyond / self.value.abs() }
    }
}

/// Adds missing metrics of requirements to a loop: the number of exits from funnels.
///
/// # Errors
/// When no component has a funnel.
pub fn add_metrics(requirements: &[Requirement], structure: &mut Structure, loaded: &LoadedLoop) -> Result<(), String> {
    if !requirements.contains(&Requirement::Funnel) {
        return Ok(());
    }
    let counts = funnels(structure, loaded);
    if counts.is_empty() {
        return Err(
            "funnel: no component of the loop has a funnel, an output `funnel_exits` or `funnel_reopened`".to_owned()
        );
    }
    let metric = |of: String| Metric {
        label: exits(&of),
        statistic: Statistic::Max,
        of,
        minus: None,
        funnel: None,
        from: f64::NEG_INFINITY,
        limit: None,
    };
    structure.metrics.extend(counts.into_iter().map(metric));
    Ok(())
}

/// Outputs that count how often errors left their funnels.
fn funnels(structure: &Structure, loaded: &LoadedLoop) -> Vec<String> {
    let names = structure.components.iter().flat_map(|unit| EXITS.map(|count| format!("{}.{count}", unit.name)));
    // In a single FMU they are local.
    let is_shown = |causality: &str| matches!(causality, "output" | "local");
    names.filter(|name| loaded.variable(name).is_some_and(|(_, variable)| is_shown(&variable.causality))).collect()
}

/// The label of a metric that counts exits.
fn exits(output: &str) -> String {
    format!("max {output}")
}

/// The limits of requirements, in a loop with metrics of these labels [default: the loop's own limits].
///
/// # Errors
/// When a label doesn't exist, a limit is given twice, or there is no limit at all.
pub fn limits(
    requirements: &[Requirement],
    structure: &Structure,
    loaded: &LoadedLoop,
    labels: &[String],
) -> Result<Vec<Limit>, String> {
    let mut limits: Vec<Limit> = Vec::new();
    for requirement in requirements {
        match requirement {
            Requirement::Funnel => limits.extend(funnels(structure, loaded).iter().map(|output| Limit {
                label: exits(output),
                side: Side::AtMost,
                value: 0.0,
            })),
            Requirement::Metric { label, side, value, percent } => {
                let (label, unit) = labelled(label, labels)?;
                if *percent && !label.ends_with(PERCENT) {
                    return Err(format!("`{label}` isn't in %: give its limit without % instead of {value}%"));
                }
                limits.push(Limit { label, side: *side, value: if *percent { *value } else { unit * value } });
            }
        }
    }
    if requirements.is_empty() {
        let own = structure.metrics.iter().filter_map(|metric| Some((metric.label.clone(), metric.limit?)));
        limits.extend(own.map(|(label, value)| Limit { label, side: Side::AtMost, value }));
    }
    if limits.is_empty() {
        let known = near::choice("", labels, "");
        return Err(format!(
            "none of the loop's metrics has a limit. Give one with --require 'LABEL <= VALUE'; {known}"
        ));
    }
    let same = |one: &Limit, other: &Limit| one.label == other.label && one.side == other.side;
    let twice = limits.iter().enumerate().find(|(k, limit)| limits[..*k].iter().any(|other| same(other, limit)));
    twice.map_or(Ok(()), |(_, limit)| Err(format!("`{}` has two limits of the same side", limit.label)))?;
    Ok(limits)
}

/// The full label, and the factor from the user's value to its unit.
fn labelled(text: &str, labels: &[String]) -> Result<(String, f64), String> {
    if labels.iter().any(|label| label == text) {
        return Ok((text.to_owned(), 1.0));
    }
    let unknown = || format!("the loop has no metric `{text}`; {}", near::choice(text, labels, ""));
    let (word, signal) = text.split_once(char::is_whitespace).ok_or_else(unknown)?;
    let short = SHORT.iter().find(|(short, ..)| *short == word);
    let (_, before, after, unit) = short.ok_or_else(unknown)?;
    let signal = signal.trim();
    let of = |label: &String| label.strip_prefix(before)?.strip_suffix(after).map(str::to_owned);
    let is_meant = |name: &str| name == signal || name.strip_suffix(signal).is_some_and(|unit| unit.ends_with('.'));
    let found: Vec<_> = labels.iter().filter(|label| of(label).is_some_and(|name| is_meant(&name))).collect();
    match found[..] {
        [label] => Ok((label.clone(), *unit)),
        [] => {
            let known: Vec<_> = labels.iter().filter_map(of).map(|name| format!("{word} {name}")).collect();
            Err(format!("the loop has no metric `{text}`; {}", near::choice(text, &known, "")))
        }
        _ => {
            let names: Vec<_> = found.iter().filter_map(|label| of(label)).collect();
            Err(format!("`{text}`: `{signal}` is a signal of several components. Use one of {}", names.join(", ")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_operator_separates_the_label_from_the_value() {
        let read = |text: &str| text.parse::<Requirement>().unwrap();
        let metric =
            |label: &str, side, value| Requirement::Metric { label: label.to_owned(), side, value, percent: false };
        assert_eq!(read("rms e_1, t >= 5 s <= 0.05"), metric("rms e_1, t >= 5 s", Side::AtMost, 0.05));
        assert_eq!(read("max |u_1| >= -1e2"), metric("max |u_1|", Side::AtLeast, -100.0));
        let in_percent = |label: &str| Requirement::Metric {
            label: label.to_owned(),
            side: Side::AtMost,
            value: 10.0,
            percent: true,
        };
        assert_eq!(read("overshoot y[1] <= 10 %"), in_percent("overshoot y[1]"));
        assert_eq!(read(" funnel "), Requirement::Funnel);
        for wrong in ["max |u_1|", "max |u_1| < 1", "<= 1", "a <= b", "a <= inf"] {
            assert!(wrong.parse::<Requirement>().unwrap_err().contains("LABEL <= VALUE"), "{wrong}");
        }
    }

    #[test]
    fn labels_are_exact_or_short_forms_of_metrics_of_steps() {
        let labels = ["max |u_1|", "overshoot of plant.y[1], %", "settling time of plant.y[1], s"].map(str::to_owned);
        assert_eq!(labelled("max |u_1|", &labels), Ok(("max |u_1|".to_owned(), 1.0)));
        for text in ["overshoot y[1]", "overshoot plant.y[1]"] {
            assert_eq!(labelled(text, &labels), Ok(("overshoot of plant.y[1], %".to_owned(), 100.0)));
        }
        assert_eq!(labelled("settling y[1]", &labels).unwrap().0, "settling time of plant.y[1], s");
        assert!(labelled("max |u_2|", &labels).unwrap_err().contains("did you mean `max |u_1|`?"));
        assert!(labelled("overshoot y[2]", &labels).unwrap_err().contains("overshoot plant.y[1]"));
        let two = ["overshoot of a.y, %", "overshoot of b.y, %"].map(str::to_owned);
        assert!(labelled("overshoot y", &two).unwrap_err().contains("a.y, b.y"));
    }

    #[test]
    fn an_excess_is_positive_where_a_limit_is_violated() {
        let limit = |side, value| Limit { label: "m".to_owned(), side, value };
        assert!(
            (limit(Side::AtMost, 2.0).excess(3.0) - 0.5).abs() < 1e-15 && limit(Side::AtMost, 2.0).is_violated(3.0)
        );
        assert!(limit(Side::AtLeast, -2.0).excess(-3.0) == 0.5 && !limit(Side::AtLeast, -2.0).is_violated(-2.0));
        assert!(limit(Side::AtMost, 0.0).excess(1.0) == 1.0);
    }
}
