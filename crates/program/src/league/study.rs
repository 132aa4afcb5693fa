//! What a league is about: a file that a person writes.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::{exporter, near, output, text_file};

/// The file of this package's league.
const OWN: &str = "league.toml";

/// Plants in the order of the page, each with its controllers.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Title of the page.
    pub title: String,
    /// What it is about.
    pub about: String,
    /// How much is computed.
    #[serde(default)]
    pub budget: Budget,
    /// Which controller to take.
    #[serde(default)]
    pub advice: Vec<Advice>,
    /// The plants.
    pub plant: Vec<Plant>,
}

/// A line of advice, a branch of the tree of decisions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Advice {
    /// When it is meant.
    pub when: String,
    /// What to take; nothing where only what is within says so.
    #[serde(default)]
    pub take: String,
    /// Why; `{PLANT/CONTROLLER.QUANTITY}` stands for a number that was measured.
    #[serde(default)]
    pub because: String,
    /// What it rests on, as `PLANT/CONTROLLER.QUANTITY < NUMBER`.
    #[serde(default)]
    pub holds: Vec<String>,
    /// What to take where something else is true, too.
    #[serde(default)]
    pub within: Vec<Advice>,
}

impl Advice {
    fn check(&self) -> Result<(), String> {
        if self.take.is_empty() && (self.within.is_empty() || !self.holds.is_empty() || !self.because.is_empty()) {
            return Err(format!("advice, when `{}`: `take` is empty", self.when));
        }
        self.within.iter().try_for_each(Advice::check)
    }
}

/// How much is computed, the same for every pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Budget {
    /// Particles of the swarm that finds the gains.
    pub particles: usize,
    /// Generations of the swarm.
    pub generations: usize,
    /// Runs of a position, each with another noise; the mean counts.
    pub noises: u32,
    /// Length of a run of the search, s.
    pub tuning_time: f64,
    /// Smallest and largest factor of what a controller's gains are before the search.
    pub gain_range: [f64; 2],
    /// Random plants.
    pub plants: u32,
    /// By how much of their values the parameters of random plants differ at most, up and down.
    pub spread: f64,
    /// A margin is known to this part of its value.
    pub margin: f64,
    /// Relative tolerance of the integration; a failure is repeated with a hundredth of it.
    pub relative_tolerance: f64,
    /// Seed of the search and of the random plants.
    pub seed: u64,
}

impl Default for Budget {
    fn default() -> Self {
        Budget {
            particles: 15,
            generations: 10,
            noises: 2,
            tuning_time: 10.0,
            gain_range: [0.2, 5.0],
            plants: 100,
            spread: 0.3,
            margin: 0.05,
            relative_tolerance: 1e-4,
            seed: 1,
        }
    }
}

impl Budget {
    /// What shows that all of it works, and no more.
    #[must_use]
    pub fn quick(self) -> Self {
        Budget { particles: 4, generations: 2, noises: 1, tuning_time: 3.0, plants: 6, margin: 0.5, ..self }
    }
}

/// A plant with what is asked of its controllers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// Its name, which is a part of file names.
    pub name: String,
    /// What it is, in a few words.
    pub title: String,
    /// What a reader of its results must know. It changes none of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<String>,
    /// Its description: a unit of this package, or a file next to the study.
    pub unit: String,
    /// The description of its reference.
    pub reference: String,
    /// Start values, by their names in the loop.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
    /// Length of a run, s. What changes in the middle of a run changes at half of it.
    pub duration: f64,
    /// Time between the points at which a loop is judged, s.
    pub step: f64,
    /// From when on errors are judged, s.
    pub settled: f64,
    /// What is to follow what: pairs of signals.
    pub errors: Vec<[String; 2]>,
    /// The error of each pair that counts as a failure.
    pub error_limits: Vec<f64>,
    /// Magnitude of an output of the plant that counts as lost.
    pub envelope: f64,
    /// Its parameters that aren't known well.
    pub uncertain: Vec<String>,
    /// What a payload changes.
    #[serde(default)]
    pub payload: BTreeMap<String, Shift>,
    /// What is set for two seconds in the middle of a run.
    #[serde(default)]
    pub pulse: BTreeMap<String, f64>,
    /// The part of each control that is left from the middle of a run on.
    #[serde(default = "usual_loss")]
    pub left: f64,
    /// What is set from the middle of a run on, where a part of the plant fails.
    #[serde(default)]
    pub fault: BTreeMap<String, f64>,
    /// Its sensors and actuators.
    pub bench: Bench,
    /// Its controllers.
    pub controller: Vec<Entry>,
}

fn usual_loss() -> f64 {
    0.7
}

fn usual_sample_time() -> f64 {
    1e-3
}

/// A value in place of another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Shift {
    /// This value.
    To(f64),
    /// So many times the value.
    Times {
        /// The factor.
        times: f64,
    },
    /// So much more than the value.
    Plus {
        /// The addend.
        plus: f64,
    },
}

impl Shift {
    /// What becomes of a value.
    pub fn of(self, value: f64) -> f64 {
        match self {
            Shift::To(to) => to,
            Shift::Times { times } => times * value,
            Shift::Plus { plus } => value + plus,
        }
    }
}

/// Sensors and actuators.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bench {
    /// Smallest control that the actuators give, one a channel.
    pub u_min: Vec<f64>,
    /// Largest control, one a channel.
    pub u_max: Vec<f64>,
    /// Time constant of the actuators, s.
    pub lag: f64,
    /// Time from one sample of the sensors to the next, s.
    #[serde(default = "usual_sample_time")]
    pub sample_time: f64,
    /// Standard deviation of the noise of measured outputs, by name; a name without index stands for all its elements.
    #[serde(default)]
    pub noise: BTreeMap<String, f64>,
    /// Resolution of measured outputs, by name.
    #[serde(default)]
    pub resolution: BTreeMap<String, f64>,
    /// FMU before the actuators that limits their controls together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mixer: Option<Mixer>,
}

/// An FMU between a controller and the actuators, which limits their controls together: its inputs `u` are what the controller
/// asks for, its outputs `achieved` the part of it that is possible.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mixer {
    /// Its description: a unit of this package, or a file next to the study.
    pub unit: String,
    /// Its limits on the bench, by their names in the unit. A controller that has parameters of these names gets them too.
    pub set: BTreeMap<String, f64>,
    /// The same where it is to limit nothing.
    pub without: BTreeMap<String, f64>,
    /// Boolean parameter of a controller that turns its knowledge of these limits on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub switch: Option<String>,
}

/// A controller of a plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Its name, which is a part of file names; that of the law, so that a law has one name on all plants.
    pub name: String,
    /// Its description: a unit of this package, or a file beside the study.
    pub unit: String,
    /// Start values, by their names in the unit.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
    /// Gains that the search scales, by their names in the unit; all elements of a name together, and all names of one text,
    /// with spaces between them. Without any, the controller stays as it is.
    #[serde(default)]
    pub tune: Vec<String>,
    /// Inputs that stay as they are, without a connection.
    #[serde(default)]
    pub open: Vec<String>,
}

impl Study {
    /// The league of this package; the descriptions of its own are put into a folder.
    ///
    /// # Errors
    /// When they can't be written.
    pub fn own(folder: &Path) -> Result<Self, Error> {
        for (name, text) in exporter::league() {
            output::write(&folder.join(name), text)?;
        }
        Study::read(&folder.join(OWN))
    }

    /// A study's file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(file: &Path) -> Result<Self, Error> {
        Study::parse(&text_file::read(file).map_err(Error::file(file))?, file)
    }

    fn parse(text: &str, file: &Path) -> Result<Self, Error> {
        let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
        let study: Study = toml::from_str(text).map_err(|error| refuse(error.to_string().trim_end().to_owned()))?;
        study.check().map_err(refuse)?;
        Ok(study)
    }

    fn check(&self) -> Result<(), String> {
        let Budget { particles, generations, noises, plants, .. } = self.budget;
        if particles == 0 || generations == 0 || noises == 0 || plants == 0 {
            return Err("budget: particles, generations, noises and plants must be at least 1".to_owned());
        }
        let [low, high] = self.budget.gain_range;
        if !(low > 0.0 && low < high && high.is_finite()) {
            return Err(format!(
                "budget: gain_range = [{low}, {high}]: must be two factors above 0, the smaller first"
            ));
        }
        for (name, value) in [
            ("tuning_time", self.budget.tuning_time),
            ("spread", self.budget.spread),
            ("margin", self.budget.margin),
            ("relative_tolerance", self.budget.relative_tolerance),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(format!("budget: {name} = {value}: must be a finite number above 0"));
            }
        }
        self.advice.iter().try_for_each(Advice::check)?;
        each_once("plant", self.plant.iter().map(|plant| plant.name.as_str()))?;
        self.plant
            .iter()
            .try_for_each(|plant| plant.check().map_err(|reason| format!("plant {}: {reason}", plant.name)))
    }

    /// The pairs that are asked for by names, `PLANT`, `PLANT/CONTROLLER` or `/CONTROLLER`; all without any.
    ///
    /// # Errors
    /// When a name stands for none.
    pub fn chosen(&self, only: &[String]) -> Result<Vec<(&Plant, &Entry)>, String> {
        let pairs = || self.plant.iter().flat_map(|plant| plant.controller.iter().map(move |entry| (plant, entry)));
        let is_meant = |word: &str, (plant, entry): &(&Plant, &Entry)| {
            let (of, law) = word.split_once('/').unwrap_or((word, ""));
            (of.is_empty() || of == plant.name) && (law.is_empty() || law == entry.name)
        };
        for word in only {
            if word.is_empty() || !pairs().any(|pair| is_meant(word, &pair)) {
                let known: Vec<_> = pairs().map(|(plant, entry)| format!("{}/{}", plant.name, entry.name)).collect();
                return Err(format!("the league has no `{word}`; {}", near::choice(word, &known, "")));
            }
        }
        Ok(pairs().filter(|pair| only.is_empty() || only.iter().any(|word| is_meant(word, pair))).collect())
    }
}

impl Plant {
    fn check(&self) -> Result<(), String> {
        let Plant { errors, error_limits, duration, step, settled, .. } = self;
        if errors.is_empty() || errors.len() != error_limits.len() {
            return Err(format!(
                "there are {} errors and {} error_limits: must be the same number, at least 1",
                errors.len(),
                error_limits.len()
            ));
        }
        if !(*step > 0.0 && *settled >= 0.0 && settled < duration && duration.is_finite()) {
            let told = format!("step = {step}, settled = {settled}, duration = {duration}");
            return Err(format!("{told}: must satisfy 0 < step and 0 <= settled < duration, in s"));
        }
        let Bench { u_min, u_max, lag, sample_time, .. } = &self.bench;
        let has_room = u_min.len() == u_max.len() && u_min.iter().zip(u_max).all(|(low, high)| low < high);
        let has_time = lag.is_finite() && *lag >= 0.0 && sample_time.is_finite() && *sample_time > 0.0;
        if u_min.is_empty() || !has_room || !has_time {
            return Err(format!(
                "bench: u_min = {u_min:?}, u_max = {u_max:?}, lag = {lag}, sample_time = {sample_time}: u_min and \
                 u_max must have one value per channel, each u_min below its u_max; lag must be at least 0 s, and \
                 sample_time above 0 s"
            ));
        }
        if error_limits.iter().chain([&self.envelope]).any(|limit| !(limit.is_finite() && *limit > 0.0)) {
            return Err("error_limits and envelope must be finite numbers above 0".to_owned());
        }
        each_once("controller", self.controller.iter().map(|entry| entry.name.as_str()))
    }

    /// Magnitudes that controls are measured by: the larger limit of each.
    pub fn sizes(&self) -> Vec<f64> {
        let Bench { u_min, u_max, .. } = &self.bench;
        u_min.iter().zip(u_max).map(|(low, high)| low.abs().max(high.abs())).collect()
    }
}

/// Names that are parts of file names, each there once.
fn each_once<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), String> {
    let mut known = std::collections::BTreeSet::new();
    for name in names {
        let plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c));
        if !plain || name.starts_with('.') {
            return Err(format!(
                "{what} `{name}`: a name must consist of letters, digits, -, _ and dots, and not start with a dot"
            ));
        }
        if !known.insert(name) {
            return Err(format!("{what} `{name}` appears twice"));
        }
    }
    if known.is_empty() { Err(format!("there is no {what}")) } else { Ok(()) }
}
