//! A parameter of a sweep and its values.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Spacing of the values of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Spacing {
    /// Equal distances.
    Linear,
    /// Equal ratios.
    Logarithmic,
    /// The values of a list.
    List,
}

/// A parameter with its values.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// Its name.
    pub name: String,
    /// Spacing of the values.
    pub spacing: Spacing,
    /// Its values as they are set.
    pub values: Vec<String>,
}

/// The most values of a parameter.
const MOST: usize = 10_000;

const FORM: &str = "must be NAME=LOW..HIGH/logN, NAME=LOW..HIGH/linN, or NAME=A,B,C";

impl FromStr for Axis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, values) = text.split_once('=').ok_or(FORM)?;
        let (name, values) = (name.trim().to_owned(), values.trim());
        if name.is_empty() || values.is_empty() {
            return Err(FORM.to_owned());
        }
        let (spacing, values) = match values.split_once("..") {
            Some((low, rest)) => between(low, rest)?,
            None => (Spacing::List, values.split(',').map(|value| value.trim().to_owned()).collect()),
        };
        if values.iter().any(String::is_empty) {
            return Err(format!("a value is missing: {FORM}"));
        }
        if let Some(twice) = values.iter().enumerate().find(|(k, value)| values[..*k].contains(value)) {
            return Err(format!("{} is given twice", twice.1));
        }
        Ok(Axis { name, spacing, values })
    }
}

fn between(low: &str, rest: &str) -> Result<(Spacing, Vec<String>), String> {
    let (high, spacing) = rest.split_once('/').ok_or(FORM)?;
    let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    let (low, high) = number(low).zip(number(high)).ok_or("both ends must be finite numbers")?;
    let spacing = spacing.trim();
    let (kind, count) = match (spacing.strip_prefix("log"), spacing.strip_prefix("lin")) {
        (Some(count), _) => (Spacing::Logarithmic, count),
        (_, Some(count)) => (Spacing::Linear, count),
        _ => return Err(FORM.to_owned()),
    };
    let count = count.parse().ok().filter(|count: &usize| (2..=MOST).contains(count));
    let count = count.ok_or_else(|| format!("the number of values must be within 2 … {MOST}"))?;
    if low >= high {
        return Err(format!("{low}..{high}: the lower end must be below the upper one"));
    }
    if kind == Spacing::Logarithmic && low <= 0.0 {
        return Err(format!("{low}..{high}: logarithmic values must be above 0; use lin{count}"));
    }
    let last = count - 1;
    let value = |k: usize| {
        let part = k as f64 / last as f64;
        match kind {
            _ if k == 0 => low,
            _ if k == last => high,
            Spacing::Logarithmic => rounded(low * (high / low).powf(part)),
            _ => rounded(low + part * (high - low)),
        }
    };
    Ok((kind, (0..count).map(|k| value(k).to_string()).collect()))
}

/// A number with twelve digits, so that typing it into `run` gives the same value.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

impl Axis {
    /// Its values as numbers, if all of them are.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        self.values.iter().map(|value| value.parse().ok().filter(|number: &f64| number.is_finite())).collect()
    }

    /// True if a diagram has it on a logarithmic axis.
    pub fn is_logarithmic(&self) -> bool {
        let is_positive = || self.numbers().is_some_and(|numbers| numbers.iter().all(|number| *number > 0.0));
        self.spacing == Spacing::Logarithmic && is_positive()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn axis(text: &str) -> Axis {
        text.parse().unwrap()
    }

    #[test]
    fn values_lie_at_equal_ratios_or_distances_or_as_they_are_listed() {
        let swept = axis("controller.adaptation_gain=1e3..1e5/log3");
        assert_eq!((swept.name.as_str(), swept.spacing), ("controller.adaptation_gain", Spacing::Logarithmic));
        assert_eq!(swept.values, ["1000", "10000", "100000"]);
        assert_eq!(axis("k = 0..1/lin6").values, ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
        assert_eq!(axis("m[1,2]=-1..1/lin3").values, ["-1", "0", "1"]);
        assert_eq!(axis("method=stiff, explicit").values, ["stiff", "explicit"]);
        assert_eq!(axis("method=stiff,explicit").numbers(), None);
    }

    #[test]
    fn what_is_no_axis_is_refused_with_what_one_is() {
        let refused = |text: &str| text.parse::<Axis>().unwrap_err();
        for text in ["k", "k=", "=1,2", "k=1..2", "k=1..2/9", "k=1..2/exp3", "k=1,,2"] {
            assert!(refused(text).contains("NAME=LOW..HIGH/logN"), "{text}: {}", refused(text));
        }
        assert!(refused("k=0..1/log3").contains("above 0"));
        assert!(refused("k=2..1/lin3").contains("below the upper"));
        assert!(refused("k=1..2/lin1").contains("2 … 10000"));
        assert!(refused("k=1..inf/lin3").contains("finite"));
        assert!(refused("k=1,2,1").contains("twice"));
    }

    proptest! {
        #[test]
        fn any_range_gives_as_many_ascending_values_with_its_ends(
            low in 1e-9_f64..1e9, ratio in 1.001_f64..1e6, count in 2_usize..60, logarithmic: bool
        ) {
            let (high, kind) = (low * ratio, if logarithmic { "log" } else { "lin" });
            let numbers = axis(&format!("k={low}..{high}/{kind}{count}")).numbers().unwrap();
            prop_assert_eq!(numbers.len(), count);
            prop_assert_eq!((numbers[0], numbers[count - 1]), (low, high));
            prop_assert!(numbers.is_sorted_by(|a, b| a < b));
        }

        #[test]
        fn no_text_makes_it_panic(text in ".{0,40}") {
            let _ = text.parse::<Axis>();
        }
    }
}
