//! The varied quantities of a loop: their places, and the values of each sample.

use super::distribution::{Cut, Vary};
use super::plant::DrawnPlant;
use super::random::Random;
use crate::fmu::Value;
use crate::report::number;
use crate::simulation::{Change, LoadedLoop, Place};
use crate::structure::{Event, Settings};
use crate::system::NO_LIMIT;

/// A component has noise if it has a parameter with the first name, and one whose name begins with the second.
const SEED: &str = ".seed";
const NOISE: &str = "noise";

/// A quantity of a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    /// A start value.
    Start(Place),
    /// The time of an event, by its place among all.
    Time(usize),
}

/// A quantity with a distribution of its own.
#[derive(Debug)]
struct Single {
    name: String,
    text: String,
    target: Target,
    cut: Cut,
}

/// All varied quantities of a loop.
#[derive(Debug)]
pub(super) struct Varied {
    singles: Vec<Single>,
    plants: Vec<DrawnPlant>,
    /// Seeds of noise.
    seeds: Vec<(String, Place)>,
    /// Events of each run.
    events: Vec<Change>,
}

/// A sample: start values, and changes during the run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    /// Start values.
    pub start: Vec<(Place, Value)>,
    /// Values that variables get during the run.
    pub changes: Vec<Change>,
}

impl Varied {
    /// The quantities of a loop, which was loaded without its events.
    ///
    /// # Errors
    /// When a name doesn't exist, is given twice or can't be set, or a distribution has no allowed values.
    pub fn new(
        loaded: &LoadedLoop,
        vary: &[Vary],
        plants: Vec<DrawnPlant>,
        events: &[Event],
        settings: Settings,
    ) -> Result<Self, String> {
        let changes = loaded.changes_of(events).map_err(|error| error.to_string())?;
        let mut varied = Varied { singles: Vec::new(), plants, seeds: Vec::new(), events: changes };
        for of in vary {
            let single = single(loaded, of, events, settings)?;
            if varied.names().any(|name| name == single.name) {
                return Err(format!("`{}` is varied twice", single.name));
            }
            varied.singles.push(single);
        }
        let mut names: Vec<_> = varied.names().collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(format!("`{}` is varied twice", twice[0]));
        }
        Ok(varied)
    }

    /// The same with a new seed for the noise of each run.
    #[must_use]
    pub fn with_noise(self, loaded: &LoadedLoop) -> Self {
        let names: Vec<String> = loaded.tunable();
        let is_noise = |name: &String, unit: &str| {
            name.strip_prefix(unit).and_then(|rest| rest.strip_prefix('.')).is_some_and(|name| name.starts_with(NOISE))
        };
        let has_noise = |unit: &str| names.iter().any(|name| is_noise(name, unit));
        let seeds = loaded.variables().filter(|(name, _, variable)| {
            variable.kind == "Integer"
                && variable.causality == "parameter"
                && name.strip_suffix(SEED).is_some_and(has_noise)
        });
        let seeds = seeds.map(|(name, place, _)| (name, place)).collect();
        Varied { seeds, ..self }
    }

    /// Names of the quantities.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let singles = self.singles.iter().map(|single| single.name.as_str());
        singles.chain(self.plants.iter().flat_map(|plant| plant.names().map(String::as_str)))
    }

    /// Distribution of each of them, in words.
    pub fn texts(&self) -> impl Iterator<Item = String> {
        let singles = self.singles.iter().map(|single| single.text.clone());
        singles.chain(self.plants.iter().flat_map(|plant| plant.names().map(|_| plant.text().to_owned())))
    }

    /// True for each whose logarithm is uniformly distributed.
    pub fn are_logarithmic(&self) -> impl Iterator<Item = bool> {
        let singles = self.singles.iter().map(|single| single.cut.is_logarithmic());
        singles.chain(self.plants.iter().flat_map(|plant| plant.names().map(|_| false)))
    }

    /// The values of a sample at these places in the distributions, all in the order of the names.
    pub fn values(&self, parts: &[f64]) -> Vec<f64> {
        let (of_singles, mut rest) = parts.split_at(self.singles.len());
        let mut values: Vec<f64> =
            self.singles.iter().zip(of_singles).map(|(it, part)| it.cut.quantile(*part)).collect();
        for plant in &self.plants {
            let (own, further) = rest.split_at(plant.names().count());
            values.extend(plant.values(own));
            rest = further;
        }
        values
    }

    /// Seeds of noise of a sample, by their names.
    pub fn seeds(&self, random: Random) -> impl Iterator<Item = (&str, i32)> {
        self.seeds.iter().map(move |(name, _)| (name.as_str(), random.seed(name)))
    }

    /// Values that entries of a plant have in every sample.
    pub fn constants(&self) -> impl Iterator<Item = (&str, f64)> {
        self.plants.iter().flat_map(DrawnPlant::constants)
    }

    /// The sample of these values.
    pub fn sample(&self, values: &[f64], random: Random) -> Sample {
        let mut sample = Sample { start: Vec::new(), changes: self.events.clone() };
        for (single, value) in self.singles.iter().zip(values) {
            match single.target {
                Target::Start(place) => sample.start.push((place, Value::Real(*value))),
                Target::Time(event) => sample.changes[event].at = *value,
            }
        }
        let places = self.plants.iter().flat_map(DrawnPlant::places);
        let drawn = places.zip(&values[self.singles.len()..]).map(|(place, value)| (place, Value::Real(*value)));
        sample.start.extend(drawn);
        let constants = self.plants.iter().flat_map(DrawnPlant::constant_places);
        sample.start.extend(constants.map(|(place, value)| (place, Value::Real(value))));
        let seeds = self.seeds.iter().map(|(name, place)| (*place, Value::Integer(random.seed(name))));
        sample.start.extend(seeds);
        sample
    }

    /// Start values of a sample, by their names.
    pub fn start_values<'a>(&'a self, values: &'a [f64]) -> impl Iterator<Item = (&'a str, f64)> {
        let named = self.names().zip(values.iter().copied());
        let is_start =
            |(k, _): &(usize, _)| self.singles.get(*k).is_none_or(|it| matches!(it.target, Target::Start(_)));
        named.enumerate().filter(is_start).map(|(_, named)| named)
    }

    /// The time of an event in a sample, if it is varied.
    pub fn event_time(&self, event: usize, values: &[f64]) -> Option<f64> {
        self.singles.iter().zip(values).find(|(it, _)| it.target == Target::Time(event)).map(|(_, value)| *value)
    }

    /// The sample without anything varied.
    pub fn nominal(&self) -> Sample {
        Sample { start: Vec::new(), changes: self.events.clone() }
    }
}

/// A quantity by its name: a start value, or the time of an event of the user.
fn single(loaded: &LoadedLoop, of: &Vary, events: &[Event], settings: Settings) -> Result<Single, String> {
    let Vary { name, distribution } = of;
    let wrong = |reason| format!("`{name}`: {reason}");
    if let Some(number) = name.strip_prefix("event[") {
        let event = asked_event(number, events).map_err(wrong)?;
        let Settings { start_time, stop_time, .. } = settings;
        let cut = distribution.cut(Some(events[event].time), (start_time, stop_time.next_down())).map_err(wrong)?;
        return Ok(Single { name: name.clone(), text: distribution.to_string(), target: Target::Time(event), cut });
    }
    let (name, place) = loaded.settable(name)?;
    let (_, variable) = loaded.variable(&name).ok_or_else(|| format!("there is no `{name}`"))?;
    if variable.kind != "Real" {
        return Err(format!("`{name}` is of type {}: only Real variables can be varied", variable.kind));
    }
    let end = |text: &Option<String>, none: f64| {
        let bound = text.as_ref().and_then(|text| text.parse().ok());
        bound.filter(|bound: &f64| bound.abs() < NO_LIMIT).unwrap_or(none)
    };
    let allowed = (end(&variable.min, f64::NEG_INFINITY), end(&variable.max, f64::INFINITY));
    let cut = distribution.cut(loaded.start_of(place), allowed).map_err(|reason| format!("`{name}`: {reason}"))?;
    Ok(Single { name, text: distribution.to_string(), target: Target::Start(place), cut })
}

/// The place of an event among all, from `N].time`, where N counts those of the user.
fn asked_event(text: &str, events: &[Event]) -> Result<usize, String> {
    let form = "must be event[N].time, where N counts the options --event";
    let number: usize = text.strip_suffix("].time").and_then(|number| number.parse().ok()).ok_or(form)?;
    let asked: Vec<usize> = (0..events.len()).filter(|&k| events[k].origin.is_argument()).collect();
    let place = number.checked_sub(1).and_then(|k| asked.get(k).copied());
    place.ok_or_else(|| match asked.len() {
        0 => format!("{form}; there is none"),
        1 => format!("{form}; there is one"),
        count => format!("{form}; there are {count}"),
    })
}

/// The times of the user's events, as written.
pub(super) fn timed(event: &Event, time: f64) -> String {
    format!("{time}: {}={}", event.name, event.text)
}

/// The number of a sample in words.
pub(super) fn listed(values: &[(&str, f64)]) -> String {
    values.iter().map(|(name, value)| format!("{name} = {}", number(*value))).collect::<Vec<_>>().join(", ")
}
