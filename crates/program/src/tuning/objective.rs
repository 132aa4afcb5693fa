//! Objectives that are minimised.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::floor::is_whole;
use crate::near;
use crate::results::{Meter, measure};
use crate::simulation::Recording;
use crate::structure::{Settings, SquareTerm, Structure};

/// Objective of a run of a loop; the smaller the better.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Σ weight · (of − minus)², at points that are `sample` seconds apart, start and end included.
    Squares {
        /// Terms of the sum.
        terms: Vec<SquareTerm>,
        /// Time between the points, s.
        sample: f64,
    },
    /// A metric of the loop, by its label.
    Metric(String),
}

/// `WEIGHT SIGNAL`, or `WEIGHT SIGNAL - SIGNAL`.
impl FromStr for SquareTerm {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` must be WEIGHT SIGNAL, or WEIGHT SIGNAL - SIGNAL");
        let words: Vec<&str> = text.split_whitespace().collect();
        let (weight, of, minus) = match words[..] {
            [weight, of] => (weight, of, None),
            [weight, of, "-", minus] => (weight, of, Some(minus.to_owned())),
            _ => return Err(wrong()),
        };
        let weight = weight.parse().ok().filter(|weight: &f64| weight.is_finite()).ok_or_else(wrong)?;
        Ok(SquareTerm { weight, of: of.to_owned(), minus })
    }
}

impl Objective {
    /// Checks that it can evaluate runs of a loop.
    ///
    /// # Errors
    /// The signal or metric that doesn't exist, or a sample time that isn't a multiple of the communication step.
    pub fn check(&self, structure: &Structure, mut signals: Recording, settings: Settings) -> Result<(), String> {
        let (terms, sample) = match self {
            Objective::Metric(label) => {
                let known = Meter::new(structure, &mut signals)?.labels();
                let there = known.contains(label);
                let unknown = || format!("the loop has no metric `{label}`; {}", near::choice(label, &known, ""));
                return if there { Ok(()) } else { Err(unknown()) };
            }
            Objective::Squares { terms, .. } if terms.is_empty() => {
                return Err("there is nothing to minimise: choose an objective with --square or --metric".to_owned());
            }
            Objective::Squares { terms, sample } => (terms, *sample),
        };
        let named = terms.iter().flat_map(|term| [Some(&term.of), term.minus.as_ref()]).flatten();
        for name in named {
            let of_models = structure.models.iter().any(|model| model.name == *name);
            if !of_models && !signals.names.contains(name) {
                return Err(format!("there is no signal `{name}`; {}", near::choice(name, &signals.names, "")));
            }
        }
        let steps = sample / settings.step;
        if (steps - steps.round()).abs() > 1e-6 * steps || steps < 0.5 {
            return Err(format!(
                "sample = {sample} s: must be a multiple of the communication step, {} s",
                settings.step
            ));
        }
        Ok(())
    }

    /// Its value for a whole run.
    ///
    /// # Errors
    /// The reason why it has none.
    pub fn value(&self, structure: &Structure, recording: &mut Recording) -> Result<f64, String> {
        let measured = measure(structure, recording)?;
        let value = match self {
            Objective::Metric(label) => {
                let metric = measured.iter().find(|metric| metric.label == *label);
                metric.and_then(|metric| metric.value).ok_or_else(|| {
                    let reason = "it ended before the time from which that counts, its reference didn't step, or the signal didn't settle";
                    format!("the metric `{label}` has no value in this run: {reason}")
                })?
            }
            Objective::Squares { terms, sample } => {
                terms.iter().map(|term| term.sum(*sample, recording)).sum::<Result<f64, _>>()?
            }
        };
        if value.is_finite() { Ok(value) } else { Err(format!("the objective is {value}, not a finite number")) }
    }
}

impl SquareTerm {
    fn sum(&self, sample: f64, recording: &Recording) -> Result<f64, String> {
        let signal = |name: &String| recording.column(name).ok_or_else(|| format!("there is no signal `{name}`"));
        let (of, minus) = (signal(&self.of)?, self.minus.as_ref().map(signal).transpose()?);
        let start = recording.times.first().copied().unwrap_or_default();
        let counts = |time: f64| is_whole((time - start) / sample);
        let square = |k: usize| (of[k] - minus.map_or(0.0, |minus| minus[k])).powi(2);
        let points = recording.times.iter().enumerate().filter(|(_, time)| counts(**time));
        Ok(self.weight * points.map(|(k, _)| square(k)).sum::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(step: f64) -> Recording {
        let times: Vec<f64> = (0..=(1.0 / step) as usize).map(|k| k as f64 * step).collect();
        let (a, b) = (times.clone(), vec![0.5; times.len()]);
        Recording { names: vec!["p.a".into(), "p.b".into()], times, columns: vec![a, b], ..Recording::default() }
    }

    #[test]
    fn squares_are_summed_at_the_points_asked_for_whatever_the_communication_step() {
        let term: SquareTerm = "2 p.a - p.b".parse().unwrap();
        for step in [0.25, 0.05, 0.001] {
            let sum = term.sum(0.25, &recording(step)).unwrap();
            assert!((sum - 2.0 * (0.25 + 0.0625 + 0.0 + 0.0625 + 0.25)).abs() < 1e-12, "step {step}: {sum}");
        }
    }

    #[test]
    fn a_term_of_another_form_is_refused() {
        for text in ["", "1", "p.a", "one p.a", "inf p.a", "1 p.a p.b", "1 p.a + p.b", "1 p.a - p.b p.c"] {
            assert!(text.parse::<SquareTerm>().unwrap_err().contains("WEIGHT SIGNAL"), "{text}");
        }
        assert_eq!("1e-3 p.a".parse(), Ok(SquareTerm { weight: 1e-3, of: "p.a".into(), minus: None }));
    }
}
