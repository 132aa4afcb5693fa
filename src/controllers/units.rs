//! Units and quantities of the signals of controllers that know an output and its derivatives, and what follows from them.

use serde::Deserialize;

use crate::system::{Invalid, Unit, quantities};

/// Largest number of channels.
const MOST_CHANNELS: usize = 200;

/// Refuses a number of channels that is none.
///
/// # Errors
/// A number outside the allowed range.
pub(super) fn check_channels(m: usize) -> Result<(), Invalid> {
    if (1..=MOST_CHANNELS).contains(&m) {
        return Ok(());
    }
    Err(Invalid::new("channels", m, format!("must be within 1 … {MOST_CHANNELS}")))
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OutputUnits {
    /// Units of the measured output, and of its reference.
    y: Vec<String>,
    /// Units of the control.
    u: Vec<String>,
}

impl OutputUnits {
    /// Those of outputs and of controls, m each.
    ///
    /// # Errors
    /// A text that isn't a unit, or a wrong number of them.
    pub(super) fn symbols(&self, m: usize) -> Result<[Vec<&'static str>; 2], Invalid> {
        Ok([Unit::symbols("y", &self.y, m)?, Unit::symbols("u", &self.u, m)?])
    }
}

/// Quantities of the signals, an element each; descriptions count elements where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Quantities {
    /// Quantities of the measured output, and of its reference.
    y: Vec<String>,
    /// Quantities of the control.
    u: Vec<String>,
}

impl Quantities {
    /// Those of outputs and of controls, m each; none where none are given.
    ///
    /// # Errors
    /// A text that can't be a quantity, or a wrong number of them.
    pub(super) fn of_signals(&self, m: usize) -> Result<[Vec<String>; 2], Invalid> {
        Ok([quantities("y", &self.y, m)?, quantities("u", &self.u, m)?])
    }
}

/// Units of an output and its derivatives up to one.
pub(super) fn with_derivatives(y: &[&'static str], order: usize) -> Vec<Vec<&'static str>> {
    let rate = |units: &Vec<&'static str>| Some(units.iter().map(|unit| Unit::per_second(unit)).collect());
    std::iter::successors(Some(y.to_vec()), rate).take(order + 1).collect()
}

/// Those of a matrix that turns signals into others, in the order of storage, by columns.
///
/// # Errors
/// None that is known.
pub(super) fn of_matrix(to: &[&'static str], from: &[&'static str]) -> Result<Vec<&'static str>, Invalid> {
    let texts: Vec<_> = from.iter().flat_map(|from| to.iter().map(move |to| quotient(&[to], &[from]))).collect();
    Unit::symbols("matrix", &texts, texts.len())
}

/// The text of products of units over others; empty, none, where one isn't a plain product of powers, as `N.m/rad` is.
pub(super) fn quotient(over: &[&str], under: &[&str]) -> String {
    let signed = over.iter().map(|&unit| (unit, 1)).chain(under.iter().map(|&unit| (unit, -1)));
    let mut powers: Vec<(&str, i32)> = Vec::new();
    for (unit, sign) in signed {
        if unit.is_empty() || unit.contains(['(', ')', '*', '^', '·', ' ']) || unit.matches('/').count() > 1 {
            return String::new();
        }
        let (over, under) = unit.split_once('/').unwrap_or((unit, ""));
        let factors =
            over.split('.').map(|factor| (factor, sign)).chain(under.split('.').map(|factor| (factor, -sign)));
        for (factor, sign) in factors {
            let name = factor.trim_end_matches(|c: char| c.is_ascii_digit());
            let power = sign * factor[name.len()..].parse().unwrap_or(1);
            match powers.iter_mut().find(|(known, _)| *known == name) {
                _ if name.is_empty() => {}
                Some((_, sum)) => *sum += power,
                None => powers.push((name, power)),
            }
        }
    }
    let product = |sign: i32| {
        let factors = powers.iter().map(|(name, power)| (name, sign * power)).filter(|(_, power)| *power > 0);
        let texts = factors.map(|(name, power)| if power > 1 { format!("{name}{power}") } else { (*name).to_owned() });
        texts.collect::<Vec<_>>()
    };
    let (over, under) = (product(1), product(-1));
    let over = if over.is_empty() { "1".to_owned() } else { over.join(".") };
    match &under[..] {
        [] => over,
        [one] => format!("{over}/{one}"),
        many => format!("{over}/({})", many.join(".")),
    }
}

#[cfg(test)]
mod tests {
    use super::quotient;

    #[test]
    fn a_quotient_is_written_as_people_do() {
        for (over, under, text) in [
            (&["N"][..], &["m"][..], "N/m"),
            (&["1"], &["1"], "1"),
            (&["V"], &["rad", "1/s"], "V.s/rad"),
            (&["N.m"], &["rad", "s"], "N.m/(rad.s)"),
            (&["rad/s2"], &["rad"], "1/s2"),
            (&["rad/s2"], &["rad", "1/s"], "1/s"),
            (&["N.m"], &["rad/s2"], "N.m.s2/rad"),
            (&["m3/h"], &["m"], "m2/h"),
            (&["V"], &["m/(s.K)"], ""),
            (&[""], &["m"], ""),
        ] {
            assert_eq!(quotient(over, under), text);
        }
    }
}
