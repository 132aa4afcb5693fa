//! Studies: the file, written by hand, that defines a league.

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
    /// Introduction of the page.
    pub about: String,
    /// Extent of the computation.
    #[serde(default)]
    pub budget: Budget,
    /// Advice on which controller to choose.
    #[serde(default)]
    pub advice: Vec<Advice>,
    /// The plants.
    pub plant: Vec<Plant>,
}

/// A line of advice, a branch of the tree of decisions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Advice {
    /// Situation that it applies to.
    pub when: String,
    /// Controller to choose; empty if only nested lines name one.
    #[serde(default)]
    pub take: String,
    /// Reason; `{PLANT/CONTROLLER.QUANTITY}` stands for a measured number.
    #[serde(default)]
    pub because: String,
    /// Claims that it depends on, as `PLANT/CONTROLLER.QUANTITY < NUMBER`.
    #[serde(default)]
    pub holds: Vec<String>,
    /// Nested lines for further conditions.
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

/// Extent of the computation, the same for every pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Budget {
    /// Particles of the swarm that finds the gains.
    pub particles: usize,
    /// Generations of the swarm.
    pub generations: usize,
    /// Runs per position, each with different noise; their mean counts.
    pub noises: u32,
    /// Length of a run of the search, s.
    pub tuning_time: f64,
    /// Smallest and largest factor of a controller's initial gains.
    pub gain_range: [f64; 2],
    /// Number of random plants.
    pub plants: u32,
    /// Largest relative deviation of random plants' parameters, up and down.
    pub spread: f64,
    /// Relative accuracy of a margin.
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
    /// A small budget that only shows that everything works.
    #[must_use]
    pub fn quick(self) -> Self {
        Budget { particles: 4, generations: 2, noises: 1, tuning_time: 3.0, plants: 6, margin: 0.5, ..self }
    }
}

/// A plant with the requirements on its controllers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// Its name, which is a part of file names.
    pub name: String,
    /// Title in a few words.
    pub title: String,
    /// Note for readers of the results, which it doesn't change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<String>,
    /// Its description: an FMU of this package, or a file next to the study.
    pub unit: String,
    /// The description of its reference.
    pub reference: String,
    /// Start values, by their names in the loop.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
    /// Duration of a run, s. Changes in the middle of a run occur at half of it.
    pub duration: f64,
    /// Interval between the points at which a loop is judged, s.
    pub step: f64,
    /// Time from which errors are judged, s.
    pub settled: f64,
    /// Pairs of a signal and its reference.
    pub errors: Vec<[String; 2]>,
    /// The error limit of each pair; a larger error is a failure.
    pub error_limits: Vec<f64>,
    /// Largest magnitude of the plant's outputs; a larger one is a failure.
    pub envelope: f64,
    /// Its uncertain parameters.
    pub uncertain: Vec<String>,
    /// Changes by a payload.
    #[serde(default)]
    pub payload: BTreeMap<String, Shift>,
    /// Values that are added for two seconds in the middle of a run.
    #[serde(default)]
    pub pulse: BTreeMap<String, f64>,
    /// Fraction of each control that is left from the middle of a run on.
    #[serde(default = "usual_loss")]
    pub left: f64,
    /// Values that are set from the middle of a run on, for a part of the plant that fails.
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

/// Change of a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Shift {
    /// The new value.
    To(f64),
    /// A multiple of the value.
    Times {
        /// The factor.
        times: f64,
    },
    /// An increment of the value.
    Plus {
        /// The addend.
        plus: f64,
    },
}

impl Shift {
    /// The changed value.
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
    /// Smallest control that the actuators give, one for each channel.
    pub u_min: Vec<f64>,
    /// Largest control, one for each channel.
    pub u_max: Vec<f64>,
    /// Time constant of the actuators, s.
    pub lag: f64,
    /// Sample time of the sensors, s.
    #[serde(default = "usual_sample_time")]
    pub sample_time: f64,
    /// Standard deviation of the noise of measured outputs, by name; a name without index stands for all its elements.
    #[serde(default)]
    pub noise: BTreeMap<String, f64>,
    /// Resolution of measured outputs, by name.
    #[serde(default)]
    pub resolution: BTreeMap<String, f64>,
    /// FMU before the actuators that limits their controls jointly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mixer: Option<Mixer>,
}

/// An FMU between a controller and the actuators, which limits their controls jointly: its inputs `u` are the
/// requested controls, its outputs `achieved` the possible ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mixer {
    /// Its description: an FMU of this package, or a file next to the study.
    pub unit: String,
    /// Its limits on the bench, by their names in the FMU. A controller with parameters of these names gets them too.
    pub set: BTreeMap<String, f64>,
    /// The same parameters without limits.
    pub without: BTreeMap<String, f64>,
    /// Boolean parameter of a controller that makes it consider these limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub switch: Option<String>,
}

/// A controller of a plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Its name, which is a part of file names: that of the control law, the same on all plants.
    pub name: String,
    /// Its description: an FMU of this package, or a file next to the study.
    pub unit: String,
    /// Start values, by their names in the FMU.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
    /// Gains that the search scales, by their names in the FMU: all elements of a name together, and all names in one
    /// text, separated by spaces. Without any, the controller stays as it is.
    #[serde(default)]
    pub tune: Vec<String>,
    /// Inputs that stay unconnected.
    #[serde(default)]
    pub open: Vec<String>,
}

impl Study {
    /// The league of this package, whose own descriptions are written into a folder.
    ///
    /// # Errors
    /// If they can't be written.
    pub fn own(folder: &Path) -> Result<Self, Error> {
        for (name, text) in exporter::league() {
            output::write(&folder.join(name), text)?;
        }
        Study::read(&folder.join(OWN))
    }

    /// Reads a study's file.
    ///
    /// # Errors
    /// If it is wrong, with the reason.
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

    /// The pairs with the given names, `PLANT`, `PLANT/CONTROLLER` or `/CONTROLLER`; all if there are none.
    ///
    /// # Errors
    /// If a name matches no pair.
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
            let text = format!("step = {step}, settled = {settled}, duration = {duration}");
            return Err(format!("{text}: must satisfy 0 < step and 0 <= settled < duration, in s"));
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

    /// Reference magnitudes of controls: the larger limit of each.
    pub fn sizes(&self) -> Vec<f64> {
        let Bench { u_min, u_max, .. } = &self.bench;
        u_min.iter().zip(u_max).map(|(low, high)| low.abs().max(high.abs())).collect()
    }
}

/// Checks that names are unique and fit into file names.
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
