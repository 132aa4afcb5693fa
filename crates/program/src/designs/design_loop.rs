//! The loop of a description and the nominal plant that it was designed for.

use super::LOOP_TIMES;
use super::candidate::{PLANT, REFERENCE, surroundings};
use super::trial::{Noise, Trial};
use super::written::Written;
use crate::error::Error;
use crate::exporter::{Library, Source, describe};
use crate::fmu::Ready;
use crate::model::Description;
use crate::model_description::ModelDescription;
use crate::nominal::NominalPlant;
use crate::structure::{Structure, Wishes};
use crate::system::Words;
use crate::template::{Plant, Signals, round_up};

/// Duration of a run with noise, in 1/W.
const WITH_NOISE: f64 = 15.0;

/// Plant, references and controller of a loop whose signals have the names of the controller's.
#[derive(Debug)]
pub struct DesignLoop {
    /// The plant of `[nominal]`, with the names and units of the controller's signals.
    pub plant: Plant,
    /// Name of each control, and the larger of its limits.
    pub controls: Vec<(String, f64)>,
    /// Bandwidth that was asked for, rad/s.
    pub bandwidth: f64,
    /// Sizes of the steps of the references.
    references: Vec<f64>,
    /// Communication step, s.
    step: f64,
    /// Name and text of the controller's description.
    own: (String, String),
}

/// The description of a text, and its nominal plant.
///
/// # Errors
/// When the text is no description, or has no nominal plant.
pub(super) fn nominal_of(source: &Source) -> Result<(Description, NominalPlant), Error> {
    let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
    let description = Description::read(&source.text).map_err(|invalid| refuse(invalid.to_string()))?;
    let nominal = description.nominal.clone();
    let nominal = nominal.ok_or_else(|| refuse("there is no table [nominal] with the plant".to_owned()))?;
    Ok((description, nominal))
}

impl DesignLoop {
    /// The loop of a description.
    ///
    /// # Errors
    /// When the description has no nominal plant, or is called like another component of the loop.
    pub fn new(source: &Source, library: &Library) -> Result<Self, Error> {
        let (description, nominal) = nominal_of(source)?;
        let own = (description.name.clone(), source.text.clone());
        if [PLANT, REFERENCE].contains(&own.0.as_str()) {
            return Err(Error::Loop {
                file: source.file.clone(),
                reason: format!(
                    "{} is the name of another component of the loop. Give the controller another name",
                    own.0
                ),
            });
        }
        let (described, _) = describe(source, library)?;
        let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
        let xml = ModelDescription::read(&described.model_description).map_err(refuse)?;
        let plant = plant(&description, &nominal, &xml);
        let limit =
            |name: String| xml.variable(&name).and_then(|variable| variable.start.as_ref()?.parse().ok()).map(f64::abs);
        let control = |j: usize| {
            let name = plant.u.names.get(j).cloned().unwrap_or_else(|| format!("u[{}]", j + 1));
            let limits = ["u_min", "u_max"].map(|which| limit(format!("{which}[{}]", j + 1)).unwrap_or(f64::INFINITY));
            (name, limits[0].max(limits[1]))
        };
        let controls = (0..nominal.B.ncols()).map(control).collect();
        let references = nominal.reference.clone().unwrap_or_else(|| vec![1.0; nominal.C.nrows()]);
        let (bandwidth, step) = (nominal.bandwidth.unwrap_or(1.0), description.experiment.step);
        Ok(DesignLoop { plant, controls, bandwidth, references, step, own })
    }

    /// Its files, with references that step at a time, s.
    fn written(&self, step_time: f64) -> Result<Written, Error> {
        let surroundings = surroundings(&self.plant, &self.references, self.bandwidth, step_time)?;
        Ok(Written::new(surroundings.into_iter().chain([self.own.clone()])))
    }

    /// The loop for runs.
    ///
    /// # Errors
    /// When it can't be closed by the names of its signals.
    pub(super) fn trial(&self, units: &Ready) -> Result<Trial, Error> {
        Trial::new(&self.written(self.step)?, self.step, &self.plant, &self.references, units)
    }

    /// Standard deviation of each control at rest, with a standard deviation of the noise of all measured signals.
    ///
    /// # Errors
    /// When the loop can't be closed by the names of its signals, or a component fails.
    pub fn noise(&self, deviation: f64, units: &Ready) -> Result<Vec<f64>, Error> {
        let noise = [Noise { signal: None, deviation }];
        let written = (&self.written(self.step)?, self.step);
        let trial = Trial::with_noise(written, &self.plant, &self.references, units, &noise)?;
        Ok(trial.at_rest(WITH_NOISE / self.bandwidth).map_err(|reason| reason.error())?.deviations())
    }

    /// The loop with a name, as a user gets it, with a settling time, s, that is known or expected: its files, the
    /// structure and its text.
    ///
    /// # Errors
    /// When the loop can't be closed by the names of its signals.
    pub fn structure(
        &self,
        name: &str,
        settling: f64,
        library: &Library,
    ) -> Result<(Written, Structure, String), Error> {
        let [before, after] = LOOP_TIMES;
        let written = self.written(round_up(before * settling))?;
        let stop_time = Some(round_up((before + after) * settling));
        let wishes = Wishes { name: name.to_owned(), step: Some(self.step), stop_time, ..Wishes::default() };
        let (structure, text) = written.structure(library, wishes)?;
        Ok((written, structure, text))
    }
}

/// The plant of a description, whose signals have the names and units of the controller's.
fn plant(description: &Description, nominal: &NominalPlant, xml: &ModelDescription) -> Plant {
    let names = |variable: &str| -> Option<Vec<String>> {
        let Words::Each(words) = description.names.get(variable)? else { return None };
        words.iter().map(|word| word.name().map(str::to_owned)).collect()
    };
    let unit = |name: String| xml.variable(&name).and_then(|variable| variable.unit.clone()).unwrap_or_default();
    let signals = |variable: &str, count: usize| {
        let named = names(variable);
        let own = named.clone().unwrap_or_else(|| (1..=count).map(|i| format!("{variable}[{i}]")).collect());
        let units: Vec<_> = own.into_iter().map(unit).collect();
        let is_known = units.iter().any(|unit| !unit.is_empty());
        Signals {
            names: named.unwrap_or_default(),
            units: if is_known { units } else { Vec::new() },
            texts: Vec::new(),
        }
    };
    let outputs = |count: usize| {
        let of_reference = signals("r", count);
        let plain = |name: &String| name.strip_suffix("_reference").unwrap_or(name).to_owned();
        let own = signals("y", count);
        let names = if own.names.is_empty() { of_reference.names.iter().map(plain).collect() } else { own.names };
        Signals { names, ..of_reference }
    };
    let ((n, m), p) = (nominal.B.shape(), nominal.C.nrows());
    let outputs = outputs(p);
    Plant {
        A: nominal.A.clone(),
        B: nominal.B.clone(),
        C: nominal.C.clone(),
        D: None,
        x: signals("x", n),
        u: signals("u", m),
        y: outputs,
        limits: None,
        records: None,
        delay: if nominal.is_delayed() { nominal.delay.clone() } else { Vec::new() },
    }
}
