//! Margins: the largest delay, lag, gain and step that the loop tolerates.

use serde::{Deserialize, Serialize};

use super::bench::{ACTUATOR, DELAY_SAMPLES};
use super::condition::Deviation;
use super::judged::Outcome;
use super::pair::{Form, Pair};
use crate::parallel;

/// The margins of a loop of the nominal plant with ideal sensors and actuators.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Margins {
    /// Dead time of the actuators, s.
    pub dead_time: Margin,
    /// Time constant of a lag of the actuators, s.
    pub lag: Margin,
    /// Factor of the controls.
    pub gain: Margin,
    /// Divisor of the controls.
    pub divided: Margin,
    /// Communication step with all components stepped simultaneously (Jacobi), s.
    pub step: Margin,
}

/// The largest tolerated value within the range of the search. All smaller values are assumed to be tolerated too.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// The largest value at which the loop passed; if it passed at none, the smallest that was tried.
    pub value: f64,
    /// Kind of bound that the value is.
    pub bound: Bound,
}

/// Kind of bound that a margin's value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// The margin is between a value that passed and one that failed.
    Within,
    /// The largest value that was tried passed.
    AtLeast,
    /// The smallest value that was tried failed.
    Below,
}

/// Kind of margin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    DeadTime,
    Lag,
    Gain,
    Divided,
    Step,
}

impl Kind {
    const ALL: [Kind; 5] = [Kind::DeadTime, Kind::Lag, Kind::Gain, Kind::Divided, Kind::Step];

    /// The smallest and the largest value that are tried.
    fn range(self) -> (f64, f64) {
        match self {
            Kind::DeadTime | Kind::Lag | Kind::Step => (4e-4, 0.3),
            Kind::Gain => (1.05, 100.0),
            Kind::Divided => (1.05, 30.0),
        }
    }
}

impl Pair<'_> {
    /// All margins, with commands compared with those of a nominal run; none if the user interrupts.
    ///
    /// # Errors
    /// If the actuators lack a variable.
    pub fn margins(
        &self,
        nominal: &Outcome,
        is_interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Margins>, String> {
        let workers = vec![(); parallel::cores()];
        let found =
            parallel::each(&workers, Kind::ALL.len(), |(), k| self.margin(Kind::ALL[k], nominal, is_interrupted));
        let found = found.into_iter().collect::<Result<Vec<Margin>, String>>()?;
        let [dead_time, lag, gain, divided, step] = found[..] else { return Ok(None) };
        Ok((!is_interrupted()).then_some(Margins { dead_time, lag, gain, divided, step }))
    }

    fn margin(
        &self,
        kind: Kind,
        nominal: &Outcome,
        is_interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Margin, String> {
        let tolerates = |value: f64| -> Result<bool, String> {
            let holds = |outcome: &Outcome| outcome.passes_compared_with(nominal);
            let (deviation, form, step) = match kind {
                Kind::Step => (Deviation::default(), Form::Separate, value),
                Kind::DeadTime => (self.disturbed(kind, value)?, Form::Delayed, self.plant.step),
                _ => (self.disturbed(kind, value)?, Form::Whole, self.plant.step),
            };
            Ok(holds(&self.stands(&deviation, form, step, is_interrupted, holds).outcome))
        };
        bisected(kind.range(), self.budget.margin, || !is_interrupted(), tolerates)
    }

    fn disturbed(&self, kind: Kind, value: f64) -> Result<Deviation, String> {
        let mut deviation = Deviation::default();
        let (name, value) = match kind {
            Kind::DeadTime => {
                // A delay is a whole number of samples of at most a millisecond.
                let samples = (value / 1e-3).ceil().min(DELAY_SAMPLES as f64);
                deviation.set(self.place(&format!("{ACTUATOR}.sample_time"))?, value / samples);
                ("delay", value)
            }
            Kind::Lag => ("time_constant", value),
            Kind::Divided => ("gain", 1.0 / value),
            Kind::Gain | Kind::Step => ("gain", value),
        };
        for place in self.elements(ACTUATOR, name) {
            deviation.set(place, value);
        }
        Ok(deviation)
    }
}

/// The largest tolerated value within a range, to a relative accuracy, by bisection of the ratio.
fn bisected(
    (low, high): (f64, f64),
    part: f64,
    goes_on: impl Fn() -> bool,
    tolerates: impl Fn(f64) -> Result<bool, String>,
) -> Result<Margin, String> {
    if !tolerates(low)? {
        return Ok(Margin { value: low, bound: Bound::Below });
    }
    if tolerates(high)? {
        return Ok(Margin { value: high, bound: Bound::AtLeast });
    }
    let (mut tolerated, mut lost) = (low, high);
    while lost > (1.0 + part) * tolerated && goes_on() {
        let middle = (tolerated * lost).sqrt();
        if tolerates(middle)? {
            tolerated = middle;
        } else {
            lost = middle;
        }
    }
    Ok(Margin { value: tolerated, bound: Bound::Within })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_margin_is_found_to_its_part_and_ends_of_the_range_are_reported() {
        let found = |most: f64| bisected((1e-3, 1.0), 0.05, || true, |value| Ok(value <= most)).unwrap();
        for most in [0.0011, 0.02, 0.3, 0.97] {
            let Margin { value, bound } = found(most);
            assert!(value <= most && 1.05 * value >= most && bound == Bound::Within, "{most}: {value}");
        }
        assert_eq!(found(0.0), Margin { value: 1e-3, bound: Bound::Below });
        assert_eq!(found(2.0), Margin { value: 1.0, bound: Bound::AtLeast });
        assert_eq!(bisected((1.0, 2.0), 0.1, || true, |_| Err("no".into())), Err("no".to_owned()));
    }
}
