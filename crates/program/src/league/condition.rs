//! Conditions: deviations from the nominal loop.

use serde::{Deserialize, Serialize};

use super::bench::{ACTUATOR, CONTROLLER, SENSOR};
use super::mixer::MIXER;
use super::pair::Pair;
use super::study::{Mixer, Plant, Shift};
use crate::fmu::Value;
use crate::simulation::{Change, Place};

/// Duration of a disturbance, s.
const PULSE: f64 = 2.0;
/// Relative error of the uncertain parameters in the conditions on them.
const OFF: f64 = 0.3;

/// A condition under which every controller runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// The loop as it was designed.
    Nominal,
    /// All uncertain parameters are larger by 30 %.
    Larger,
    /// The same parameters are smaller by 30 %.
    Smaller,
    /// The plant carries the payload.
    Payload,
    /// A disturbance acts for two seconds.
    Pulse,
    /// The actuators lose effectiveness in the middle of the run.
    Loss,
    /// A part of the plant fails in the middle of the run, if the study names one.
    Fault,
    /// Sensors have noise, and actuators a lag and limits.
    Bench,
    /// Larger parameters, payload, pulse, loss, fault and bench.
    Together,
}

impl Condition {
    /// All of them, in the order of the page.
    pub const ALL: [Condition; 9] = [
        Condition::Nominal,
        Condition::Larger,
        Condition::Smaller,
        Condition::Payload,
        Condition::Pulse,
        Condition::Loss,
        Condition::Fault,
        Condition::Bench,
        Condition::Together,
    ];

    /// Title in a few words.
    pub fn title(self) -> &'static str {
        match self {
            Condition::Nominal => "nominal",
            Condition::Larger => "+30 %",
            Condition::Smaller => "−30 %",
            Condition::Payload => "payload",
            Condition::Pulse => "pulse",
            Condition::Loss => "loss of effect",
            Condition::Fault => "fault",
            Condition::Bench => "bench",
            Condition::Together => "all together",
        }
    }

    /// Conditions that a plant has, in the order of the page.
    pub fn of(plant: &Plant) -> Vec<Condition> {
        let has = |condition: &Condition| *condition != Condition::Fault || !plant.fault.is_empty();
        Condition::ALL.into_iter().filter(has).collect()
    }

    fn includes(self, other: Condition) -> bool {
        self == other || self == Condition::Together && other != Condition::Smaller
    }
}

/// Values that are set at the start and during a run.
#[derive(Debug, Clone, Default)]
pub(super) struct Deviation {
    pub start: Vec<(Place, Value)>,
    pub changes: Vec<Change>,
}

impl Deviation {
    /// Sets a Real variable at the start.
    pub fn set(&mut self, place: Place, value: f64) {
        self.start.retain(|(known, _)| *known != place);
        self.start.push((place, Value::Real(value)));
    }

    /// The start value, if it was set here.
    fn get(&self, place: Place) -> Option<f64> {
        self.start.iter().find_map(|(known, value)| match value {
            Value::Real(value) if *known == place => Some(*value),
            _ => None,
        })
    }
}

impl Pair<'_> {
    /// Deviation for a condition in this loop.
    ///
    /// # Errors
    /// If the study names what the loop doesn't have.
    pub(super) fn condition(&self, condition: Condition) -> Result<Deviation, String> {
        let mut deviation = Deviation::default();
        let off = if condition.includes(Condition::Larger) { 1.0 + OFF } else { 1.0 - OFF };
        if condition.includes(Condition::Larger) || condition == Condition::Smaller {
            for place in self.uncertain() {
                self.shift(place, Shift::Times { times: off }, &mut deviation);
            }
        }
        if condition.includes(Condition::Payload) {
            for (name, shift) in &self.plant.payload {
                self.shift(self.place(name)?, *shift, &mut deviation);
            }
        }
        let middle = 0.5 * self.plant.duration;
        if condition.includes(Condition::Loss) {
            for place in self.elements(ACTUATOR, "gain") {
                deviation.changes.push(Change { at: middle, place, value: Value::Real(self.plant.left) });
            }
        }
        if condition.includes(Condition::Fault) {
            for (name, &value) in &self.plant.fault {
                deviation.changes.push(Change { at: middle, place: self.place(name)?, value: Value::Real(value) });
            }
        }
        if condition.includes(Condition::Pulse) {
            for (name, &value) in &self.plant.pulse {
                let place = self.place(name)?;
                let before = self.nominal(place);
                deviation.changes.push(Change { at: middle, place, value: Value::Real(before + value) });
                deviation.changes.push(Change { at: middle + PULSE, place, value: Value::Real(before) });
            }
        }
        deviation.changes.sort_by(|a, b| a.at.total_cmp(&b.at));
        if condition.includes(Condition::Bench) {
            self.put_on_bench(&mut deviation, 1)?;
        }
        Ok(deviation)
    }

    /// Adds real sensors and actuators, and noise with a seed.
    pub(super) fn put_on_bench(&self, deviation: &mut Deviation, seed: i32) -> Result<(), String> {
        let bench = &self.plant.bench;
        for (k, (low, high)) in bench.u_min.iter().zip(&bench.u_max).enumerate() {
            let k = k + 1;
            for unit in [ACTUATOR, CONTROLLER] {
                // A controller with these parameters knows the limits.
                for (name, value) in [("u_min", *low), ("u_max", *high)] {
                    match self.place(&format!("{unit}.{name}[{k}]")) {
                        Ok(place) => deviation.set(place, value),
                        Err(reason) if unit == ACTUATOR => return Err(reason),
                        Err(_) => {}
                    }
                }
            }
            deviation.set(self.place(&format!("{ACTUATOR}.time_constant[{k}]"))?, bench.lag);
        }
        if let Some(mixer) = &bench.mixer {
            self.mix(deviation, mixer)?;
        }
        for (k, output) in self.measured.iter().enumerate() {
            let of = |map: &std::collections::BTreeMap<String, f64>| {
                let base = output.split('[').next().unwrap_or_default();
                map.get(output).or_else(|| map.get(base)).copied().unwrap_or(0.0)
            };
            for (name, value) in [("noise_deviation", of(&bench.noise)), ("resolution", of(&bench.resolution))] {
                deviation.set(self.place(&format!("{SENSOR}.{name}[{}]", k + 1))?, value);
            }
        }
        deviation.set(self.place(&format!("{SENSOR}.sample_time"))?, bench.sample_time);
        deviation.start.push((self.place(&format!("{SENSOR}.seed"))?, Value::Integer(seed)));
        Ok(())
    }

    /// Sets the joint limits of all controls by the mixer, also in a controller with these parameters.
    fn mix(&self, deviation: &mut Deviation, mixer: &Mixer) -> Result<(), String> {
        for (name, value) in &mixer.set {
            deviation.set(self.place(&format!("{MIXER}.{name}"))?, *value);
            if let Ok(place) = self.place(&format!("{CONTROLLER}.{name}")) {
                deviation.set(place, *value);
            }
        }
        let switch = mixer.switch.as_ref().and_then(|name| self.place(&format!("{CONTROLLER}.{name}")).ok());
        deviation.start.extend(switch.map(|place| (place, Value::Boolean(true))));
        Ok(())
    }

    /// Shifts a variable, in addition to earlier shifts.
    pub(super) fn shift(&self, place: Place, shift: Shift, deviation: &mut Deviation) {
        let value = deviation.get(place).unwrap_or_else(|| self.nominal(place));
        deviation.set(place, shift.of(value));
    }
}
