//! Result of a pair, as a file.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::condition::Condition;
use super::gains::Gains;
use super::judged::Judged;
use super::margins::Margins;
use super::pair::Pair;
use super::spread::Spread;
use super::study::{Budget, Entry, Plant};
use crate::error::Error;
use crate::sealed::{self, Sealed};

/// This version.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Result of a pair of plant and controller, as far as it is computed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Name of the plant.
    pub plant: String,
    /// Name of the controller.
    pub controller: String,
    /// The version of this package that computed it.
    pub version: String,
    /// The day, in UTC, on which its last part was computed. Earlier versions of this package didn't note it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub computed: Option<String>,
    /// Checksum of the study's settings for the pair.
    pub question: String,
    /// The study's settings for the pair, to name differences. Earlier versions of this package didn't note them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<Value>,
    /// Checksum of the descriptions of its components.
    pub units: String,
    /// True if its loop ran as a single FMU; else as separate components.
    pub as_one: bool,
    /// The gains that were found.
    pub gains: Option<Gains>,
    /// Outcome under each condition.
    pub conditions: Option<BTreeMap<Condition, Judged>>,
    /// Margins.
    pub margins: Option<Margins>,
    /// Outcomes of random plants.
    pub spread: Option<Spread>,
    /// Instructions per step of the controller, if they were counted outside the league.
    #[serde(skip)]
    pub instructions: Option<f64>,
}

/// A part of the work of a pair, in the order in which they are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The search of gains.
    Gains,
    /// The conditions.
    Conditions,
    /// The margins.
    Margins,
    /// The random plants.
    Spread,
}

impl Stage {
    /// All of them.
    pub const ALL: [Stage; 4] = [Stage::Gains, Stage::Conditions, Stage::Margins, Stage::Spread];

    /// Name for messages.
    pub fn word(self) -> &'static str {
        match self {
            Stage::Gains => "gains",
            Stage::Conditions => "conditions",
            Stage::Margins => "margins",
            Stage::Spread => "random plants",
        }
    }
}

impl Record {
    /// An empty record of a pair.
    pub fn new(pair: &Pair) -> Self {
        let (plant, controller) = (pair.plant.name.clone(), pair.entry.name.clone());
        let question = Record::question(pair.plant, pair.entry, &pair.budget);
        let of_plant = Plant { controller: Vec::new(), about: None, ..pair.plant.clone() };
        let asked = Some(json!({ "plant": of_plant, "controller": pair.entry, "budget": pair.budget }));
        let (version, units) = (VERSION.to_owned(), pair.checksum.clone());
        Record { plant, controller, version, question, asked, units, as_one: pair.is_one_unit(), ..Record::default() }
    }

    /// Checksum of a study's settings for a pair.
    pub fn question(plant: &Plant, entry: &Entry, budget: &Budget) -> String {
        // Other controllers of the plant have no part in it.
        let plant = Plant { controller: vec![entry.clone()], about: None, ..plant.clone() };
        sealed::checksum(serde_json::to_string(&(&plant, budget)).unwrap_or_default())
    }

    /// Differences in settings or version from an earlier record of the same pair; none if its work can be continued.
    pub fn differing(&self, earlier: &Record) -> Option<String> {
        let mut found = Vec::new();
        if self.version != earlier.version {
            found.push(format!("version was {}, is {}", earlier.version, self.version));
        }
        if self.question != earlier.question {
            let named = self.asked.as_ref().zip(earlier.asked.as_ref()).map(|(is, was)| sealed::differences(was, is));
            let unnamed = || vec!["the plant, controller or budget of the study differs".to_owned()];
            found.extend(named.filter(|named| !named.is_empty()).unwrap_or_else(unnamed));
        }
        if self.units != earlier.units {
            found.push("the descriptions of its FMUs differ".to_owned());
        }
        sealed::listed(&found)
    }

    /// Number of finished parts of the work, which are done in their order.
    pub fn done(&self) -> usize {
        let known = [self.gains.is_some(), self.conditions.is_some(), self.margins.is_some(), self.spread.is_some()];
        known.iter().take_while(|known| **known).count()
    }

    /// The next part of the work.
    pub fn next(&self) -> Option<Stage> {
        Stage::ALL.get(self.done()).copied()
    }

    /// Writes it. An earlier file is replaced atomically.
    ///
    /// # Errors
    /// If it can't be written.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let refuse = |error: serde_json::Error| Error::Loop { file: file.to_owned(), reason: error.to_string() };
        sealed::write(file, serde_json::to_value(self).map_err(refuse)?)
    }

    /// Reads it.
    ///
    /// # Errors
    /// If it can't be read, or was changed since it was written.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Loop { file: file.to_owned(), reason };
        let Sealed { content, fits } = sealed::read(file, "result of a league")?;
        if fits != Some(true) {
            return Err(refuse("its content doesn't match its checksum: the file was changed".to_owned()));
        }
        Record::deserialize::<Value>(content).map_err(|error| refuse(format!("can't be read: {error}")))
    }
}

impl Pair<'_> {
    /// Does the next part of the work. Returns true unless it was interrupted.
    ///
    /// # Errors
    /// If the study doesn't fit the loop.
    pub fn go_on(&mut self, record: &mut Record, is_interrupted: &(dyn Fn() -> bool + Sync)) -> Result<bool, String> {
        if let Some(gains) = &record.gains {
            self.take_gains(&gains.values);
        }
        match record.next() {
            None => return Ok(true),
            Some(Stage::Gains) => record.gains = self.search(is_interrupted)?,
            Some(Stage::Conditions) => record.conditions = self.conditions(is_interrupted)?,
            Some(Stage::Margins) => {
                let nominal = record.conditions.as_ref().and_then(|all| all.get(&Condition::Nominal));
                let nominal = nominal.ok_or("there is no nominal run")?;
                record.margins = self.margins(&nominal.outcome, is_interrupted)?;
            }
            Some(Stage::Spread) => record.spread = self.spread(is_interrupted)?,
        }
        record.computed = day(SystemTime::now());
        Ok(!is_interrupted())
    }

    fn conditions(
        &self,
        is_interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<BTreeMap<Condition, Judged>>, String> {
        let deviation = |condition: Condition| Ok((condition, self.condition(condition)?));
        let all = Condition::of(self.plant).into_iter().map(deviation).collect::<Result<Vec<_>, String>>()?;
        let workers = vec![(); crate::parallel::cores()];
        let judged = crate::parallel::each(&workers, all.len(), |(), k| self.judged(&all[k].1, is_interrupted));
        let done = all.iter().map(|(condition, _)| *condition).zip(judged).collect();
        Ok((!is_interrupted()).then_some(done))
    }
}

/// The day of a time, in UTC, as YYYY-MM-DD; none before 1970.
fn day(time: SystemTime) -> Option<String> {
    let days = time.duration_since(UNIX_EPOCH).ok()?.as_secs() / 86400;
    // Counted from a first of March, so that a leap day is the last one of its year: 400 years are 146097 days.
    let counted = days + 719_468;
    let (era, of_era) = (counted / 146_097, counted % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (year, month) = (era * 400 + year + u64::from(month >= 10), (month + 2) % 12 + 1);
    Some(format!("{year:04}-{month:02}-{day:02}"))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Compares with counting each day of 400 years by the lengths of months.
    #[test]
    fn days_follow_each_other_as_in_the_calendar() {
        let (mut year, mut month, mut date) = (1970, 1, 1);
        for count in 0..146_097 {
            let time = UNIX_EPOCH + Duration::from_secs(86400 * count + 86399 * (count % 2));
            assert_eq!(day(time).unwrap(), format!("{year:04}-{month:02}-{date:02}"));
            let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
            let length = match month {
                2 => 28 + i32::from(is_leap),
                4 | 6 | 9 | 11 => 30,
                _ => 31,
            };
            date += 1;
            if date > length {
                (month, date) = (month + 1, 1);
            }
            if month > 12 {
                (year, month) = (year + 1, 1);
            }
        }
        assert_eq!(day(UNIX_EPOCH - Duration::from_secs(1)), None);
    }
}
