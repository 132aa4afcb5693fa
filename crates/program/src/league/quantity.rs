//! Numbers of a record by their names, for the page and for advice.

use super::condition::Condition;
use super::judged::Outcome;
use super::record::Record;
use super::study::{Plant, Study};
use crate::near;
use crate::results::four_digits;

/// Confidence interval of an estimate from a record.
type Estimated = fn(&Record) -> Option<[f64; 2]>;

/// A number from a record.
#[derive(Debug, Clone, Copy)]
pub struct Quantity {
    /// Its name in advice.
    pub name: &'static str,
    /// Title in a few words.
    pub title: &'static str,
    /// True if more of it is better.
    pub more_is_better: bool,
    of: fn(&Plant, &Record) -> Option<f64>,
    /// Confidence interval, if it is an estimate.
    interval: Option<Estimated>,
    /// True if it is a fraction, which is shown in percent.
    is_part: bool,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Quantity; 12] = [
        quantity("error", "error, nominal", false, |plant, record| {
            Some(under(record, Condition::Nominal)?.error(plant))
        }),
        quantity("bench_error", "error, bench", false, |plant, record| {
            Some(under(record, Condition::Bench)?.error(plant))
        }),
        quantity("effort", "effort", false, |plant, record| Some(under(record, Condition::Bench)?.commanded(plant))),
        quantity("variation", "variation of the control", false, |plant, record| {
            Some(under(record, Condition::Bench)?.moved(plant))
        }),
        quantity("held", "conditions passed", true, |_, record| {
            let passed = record.conditions.as_ref()?.values().filter(|judged| judged.outcome.holds()).count();
            Some(passed as f64)
        }),
        Quantity {
            interval: Some(|record| Some(record.spread.as_ref()?.rate().1)),
            is_part: true,
            ..quantity("failed", "random plants that fail", false, |_, record| Some(record.spread.as_ref()?.rate().0))
        },
        Quantity {
            interval: Some(|record| {
                let [low, high] = record.spread.as_ref()?.median().1;
                Some([low.unwrap_or(f64::INFINITY), high.unwrap_or(f64::INFINITY)])
            }),
            ..quantity("median", "median error", false, |_, record| record.spread.as_ref()?.median().0)
        },
        quantity("dead_time", "dead-time margin", true, |_, record| Some(record.margins?.dead_time.value)),
        quantity("lag", "lag margin", true, |_, record| Some(record.margins?.lag.value)),
        quantity("gain", "gain margin", true, |_, record| Some(record.margins?.gain.value)),
        quantity("step", "longest stable communication step", true, |_, record| Some(record.margins?.step.value)),
        quantity("instructions", "instructions per step", false, |_, record| record.instructions),
    ];

    /// The quantity of a name.
    ///
    /// # Errors
    /// If there is none.
    pub fn named(name: &str) -> Result<Quantity, String> {
        let names = || Quantity::ALL.iter().map(|quantity| quantity.name).collect::<Vec<_>>();
        let found = Quantity::ALL.into_iter().find(|quantity| quantity.name == name);
        found.ok_or_else(|| format!("there is no quantity `{name}`; {}", near::choice(name, &names(), "")))
    }

    /// The value for a record; none if it wasn't computed, or the run failed.
    pub fn of(&self, plant: &Plant, record: &Record) -> Option<f64> {
        (self.of)(plant, record)
    }

    /// A value as text for the page.
    pub fn to_text(&self, value: f64) -> String {
        if self.is_part { format!("{:.0} %", 100.0 * value) } else { four_digits(value) }
    }

    /// The 95 % confidence interval if it is an estimate; else the value as both ends.
    pub fn interval_of(&self, plant: &Plant, record: &Record) -> Option<[f64; 2]> {
        match self.interval {
            Some(interval) => interval(record),
            None => self.of(plant, record).map(|value| [value; 2]),
        }
    }
}

/// Outcome of a pair under a condition, if it didn't fail.
pub(super) fn under(record: &Record, condition: Condition) -> Option<&Outcome> {
    let outcome = &record.conditions.as_ref()?.get(&condition)?.outcome;
    outcome.holds().then_some(outcome)
}

const fn quantity(
    name: &'static str,
    title: &'static str,
    more_is_better: bool,
    of: fn(&Plant, &Record) -> Option<f64>,
) -> Quantity {
    Quantity { name, title, more_is_better, of, interval: None, is_part: false }
}

/// Meaning of `PLANT/CONTROLLER.QUANTITY`: the quantity, and plant and record if there is a record.
pub(super) type Meant<'a> = (Quantity, Option<(&'a Plant, &'a Record)>);

/// Meaning of `PLANT/CONTROLLER.QUANTITY`.
///
/// # Errors
/// If the league has no such pair, or there is no such quantity.
pub(super) fn meant<'a>(study: &'a Study, records: &'a [Record], word: &str) -> Result<Meant<'a>, String> {
    let parts = word.split_once('/').and_then(|(plant, rest)| Some((plant, rest.rsplit_once('.')?)));
    let (of, (law, quantity)) = parts.ok_or_else(|| format!("`{word}` must be PLANT/CONTROLLER.QUANTITY"))?;
    let quantity = Quantity::named(quantity)?;
    let (plant, _) = study.chosen(&[format!("{of}/{law}")])?[0];
    let record = records.iter().find(|record| record.plant == of && record.controller == law);
    Ok((quantity, record.map(|record| (plant, record))))
}
