//! The loop of a plant and a controller.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Once;

use super::bench::{CONTROLLER, DELAY_SAMPLES, PLANT, benched};
use super::condition::{Condition, Deviation};
use super::judged::{Judged, Outcome, Signals, Watch};
use super::mixer;
use super::study::{Budget, Entry, Plant};
use super::units::Units;
use crate::error::Error;
use crate::fmu::Value;
use crate::near;
use crate::simulation::{LoadedLoop, Place};
use crate::structure::{Draft, Found, LoopFiles, Order, Settings, Structure, Wishes};

/// Factor of gains that differ from the loop's own.
const OTHER_GAIN: f64 = 1.01;
/// The parameter of a component or a composite for the accuracy of integration.
const TOLERANCE: &str = "relative_tolerance";
/// Factors of tolerance and step with which a failure is repeated.
const FINER: (f64, f64) = (1e-2, 0.5);

/// A loop as a single FMU with sensors and actuators, which are ideal by default; and the same loop without them as
/// separate components.
#[derive(Debug)]
pub struct Pair<'a> {
    /// The plant.
    pub plant: &'a Plant,
    /// The controller.
    pub entry: &'a Entry,
    pub(super) budget: Budget,
    /// Measured outputs of the plant, one for each channel of the sensor.
    pub(super) measured: Vec<String>,
    whole: LoadedLoop,
    /// The same with delay lines, which slow down every evaluation. Its variables have the same places.
    delayed: LoadedLoop,
    /// True if these are single FMUs; else their components are stepped one after the other.
    is_one: bool,
    signals: Signals,
    separate: LoadedLoop,
    apart: Signals,
    /// Gains that the search found.
    gains: Vec<(Place, Value)>,
    gains_apart: Vec<(Place, Value)>,
    /// True once equations are compiled for the parameters that its runs have in common.
    pub(super) folded: Once,
    /// Checksum of the descriptions of its components.
    pub(super) checksum: String,
}

/// Form in which a pair runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Whole,
    Delayed,
    Separate,
}

impl<'a> Pair<'a> {
    /// Wires the components of a pair by the names of their signals. Files are in this folder, with the study.
    ///
    /// # Errors
    /// If an FMU isn't there, an input has no source, or the study names what the loop doesn't have.
    pub fn new(
        plant: &'a Plant,
        entry: &'a Entry,
        budget: Budget,
        folder: &Path,
        units: &Units,
    ) -> Result<Self, Error> {
        let plain = wired(plant, entry, folder)?;
        let refuse = |reason: String| Error::Loop { file: plain.file.clone(), reason };
        let unit = plain.components.iter().find(|unit| unit.name == PLANT);
        let unit = unit.ok_or_else(|| refuse(format!("there is no `{PLANT}`")))?;
        let described = units.fmu(&plain, unit)?;
        let [with_lines, benched] =
            [DELAY_SAMPLES, 0].map(|samples| benched(&plain, plant.bench.u_min.len(), &described.description, samples));
        let (mut benched, mut with_lines) = (benched?, with_lines?);
        if let Some(mixer) = &plant.bench.mixer {
            for structure in [&mut benched.structure, &mut with_lines.structure] {
                mixer::put(structure, mixer, folder)?;
            }
        }
        let ((whole, is_one), (delayed, _)) = (units.load(&benched.structure)?, units.load(&with_lines.structure)?);
        if whole.variables().map(|(name, ..)| name).ne(delayed.variables().map(|(name, ..)| name)) {
            return Err(refuse("a delay line changes the variables of the loop".to_owned()));
        }
        let separate = units.load_apart(&Structure { order: Order::Jacobi, ..plain.clone() })?;
        let checksum = units.checksum(&benched.structure)?;
        let asked: Vec<_> = benched.commands.iter().map(|name| format!("{CONTROLLER}.{name}")).collect();
        // Controls are judged after the mixer's limits.
        let achieved = plant.bench.mixer.as_ref().map(|_| (1..=asked.len()).map(mixer::achieved).collect::<Vec<_>>());
        let pair = Pair {
            signals: signals(&whole, plant, achieved.as_ref().unwrap_or(&asked)).map_err(refuse)?,
            apart: signals(&separate, plant, &asked).map_err(refuse)?,
            measured: benched.measured,
            gains: Vec::new(),
            gains_apart: Vec::new(),
            plant,
            entry,
            budget,
            whole,
            delayed,
            is_one,
            separate,
            folded: Once::new(),
            checksum,
        };
        pair.check(&described.description.variables.iter().map(|v| v.name.as_str()).collect::<Vec<_>>())
            .map_err(refuse)?;
        Ok(pair)
    }

    /// True if it runs as a single FMU; else as separate components, since a part has parts itself.
    pub fn is_one_unit(&self) -> bool {
        self.is_one
    }

    /// The gains that the search may scale, by their names in the loop.
    pub fn gains(&self) -> Vec<String> {
        self.tuned().into_iter().flatten().map(|(name, _)| name).collect()
    }

    /// Checks all names of the study before anything runs.
    fn check(&self, outputs: &[&str]) -> Result<(), String> {
        for condition in Condition::ALL {
            self.condition(condition)?;
        }
        let bench = &self.plant.bench;
        for name in bench.noise.keys().chain(bench.resolution.keys()) {
            if !outputs.iter().any(|output| is_of(output, name)) {
                let near = near::choice(name, outputs, "");
                return Err(format!("bench: the plant has no output `{name}`; {near}"));
            }
        }
        for name in &self.plant.uncertain {
            if self.elements(PLANT, name).is_empty() {
                let near = near::choice(name, &self.parameters(PLANT), "");
                return Err(format!("uncertain: the plant has no parameter `{name}`; {near}"));
            }
        }
        for name in self.entry.tune.iter().flat_map(|names| names.split_whitespace()) {
            let elements = self.elements(CONTROLLER, name);
            if elements.is_empty() {
                let near = near::choice(name, &self.parameters(CONTROLLER), "");
                return Err(format!("tune: the controller `{}` has no parameter `{name}`; {near}", self.entry.name));
            }
            if elements.iter().all(|place| self.nominal(*place) == 0.0) {
                return Err(format!(
                    "tune: `{name}` is 0, so scaling does not change it: give it a value with `set`, or remove it"
                ));
            }
        }
        Ok(())
    }

    /// The names of a component's Real parameters.
    fn parameters(&self, unit: &str) -> Vec<String> {
        let names = self.whole.tunable().into_iter();
        names.filter_map(|name| name.strip_prefix(unit)?.strip_prefix('.').map(str::to_owned)).collect()
    }

    /// The place of a variable of the composite.
    pub(super) fn place(&self, name: &str) -> Result<Place, String> {
        let found = self.whole.variable(name);
        found.map(|(place, _)| place).ok_or_else(|| {
            let known: Vec<_> = self.whole.variables().map(|(known, ..)| known).collect();
            format!("the loop has no variable `{name}`; {}", near::choice(name, &known, ""))
        })
    }

    /// The places of all elements of a component's Real variable.
    pub(super) fn elements(&self, unit: &str, name: &str) -> Vec<Place> {
        of_name(&self.whole, unit, name).into_iter().map(|(_, place)| place).collect()
    }

    /// The uncertain parameters.
    pub(super) fn uncertain(&self) -> Vec<Place> {
        self.plant.uncertain.iter().flat_map(|name| self.elements(PLANT, name)).collect()
    }

    /// The value that the loop gives a Real variable.
    pub(super) fn nominal(&self, place: Place) -> f64 {
        self.whole.start_of(place).unwrap_or(0.0)
    }

    /// The gains that a search scales, with their values: one list for each group.
    pub(super) fn tuned(&self) -> Vec<Vec<(String, f64)>> {
        let group = |names: &String| {
            let found = names.split_whitespace().flat_map(|name| of_name(&self.whole, CONTROLLER, name));
            found.map(|(name, place)| (name, self.nominal(place))).collect()
        };
        self.entry.tune.iter().map(group).collect()
    }

    /// Sets the controller's gains for all further runs.
    pub(super) fn take_gains(&mut self, gains: &BTreeMap<String, f64>) {
        let of = |loaded: &LoadedLoop| {
            let placed = gains.iter().filter_map(|(name, value)| Some((loaded.variable(name)?.0, Value::Real(*value))));
            placed.collect::<Vec<_>>()
        };
        (self.gains, self.gains_apart) = (of(&self.whole), of(&self.separate));
    }

    /// Runs the loop for some time; `is_interrupted` is called at every point.
    pub(super) fn run(
        &self,
        deviation: &Deviation,
        how: (Form, f64, f64),
        fineness: f64,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Outcome {
        self.run_while_cheap(deviation, how, (fineness, f64::INFINITY), is_interrupted)
    }

    /// The same, ended early once its cost is sure to exceed `most`.
    pub(super) fn run_while_cheap(
        &self,
        deviation: &Deviation,
        (form, duration, step): (Form, f64, f64),
        (fineness, most): (f64, f64),
        is_interrupted: &dyn Fn() -> bool,
    ) -> Outcome {
        let (loaded, signals, gains) = match form {
            Form::Whole => (&self.whole, &self.signals, &self.gains),
            Form::Delayed => (&self.delayed, &self.signals, &self.gains),
            Form::Separate => (&self.separate, &self.apart, &self.gains_apart),
        };
        let start = self.start(loaded, gains, deviation, fineness);
        let settings = Settings { start_time: 0.0, stop_time: duration, step };
        let mut watch = Watch::new(self.plant, signals, (duration, most));
        let watched = |closed: crate::simulation::ClosedLoop, watch: &mut Watch| {
            closed.watch(settings, &deviation.changes, |time, row| !is_interrupted() && watch.point(time, row))
        };
        if let Err(error) = loaded.instantiate_with(&start).and_then(|closed| watched(closed, &mut watch)) {
            watch.fail(watch.time(), error.to_string());
        }
        watch.outcome()
    }

    /// Start values of a run.
    fn start(
        &self,
        loaded: &LoadedLoop,
        gains: &[(Place, Value)],
        deviation: &Deviation,
        fineness: f64,
    ) -> Vec<(Place, Value)> {
        let tolerance = Value::Real(self.budget.relative_tolerance * fineness);
        let tolerances = loaded.variables().filter(|(name, ..)| name.rsplit('.').next() == Some(TOLERANCE));
        let tolerances = tolerances.map(|(_, place, _)| (place, tolerance.clone()));
        gains.iter().cloned().chain(tolerances).chain(deviation.start.iter().cloned()).collect()
    }

    /// Compiles the equations for all parameters but those that the search and random plants change, for all further runs as a
    /// single FMU. Where components refuse the values that show which these are, equations stay for any parameters.
    pub(super) fn fold(&self, mut deviation: Deviation) {
        let groups = self.tuned().into_iter().flatten();
        let gains = groups.filter_map(|(name, value)| Some((self.place(&name).ok()?, OTHER_GAIN * value)));
        gains.for_each(|(place, value)| deviation.set(place, value));
        let start = self.start(&self.whole, &[], &deviation, 1.0);
        let settings = Settings { start_time: 0.0, stop_time: self.plant.duration, step: self.plant.step };
        LoadedLoop::fold(std::slice::from_ref(&self.whole), &start, &deviation.changes, settings);
    }

    /// The confirmed outcome of a run as a single FMU.
    pub(super) fn judged(&self, deviation: &Deviation, is_interrupted: &dyn Fn() -> bool) -> Judged {
        self.stands(deviation, Form::Whole, self.plant.step, is_interrupted, |outcome| outcome.holds())
    }

    /// A confirmed outcome: a failed run is repeated more finely (step and tolerance), which counts if it passes.
    pub(super) fn stands(
        &self,
        deviation: &Deviation,
        form: Form,
        step: f64,
        is_interrupted: &dyn Fn() -> bool,
        holds: impl Fn(&Outcome) -> bool,
    ) -> Judged {
        let duration = self.plant.duration;
        let outcome = self.run(deviation, (form, duration, step), 1.0, is_interrupted);
        if holds(&outcome) || is_interrupted() {
            return Judged { outcome, mended: false };
        }
        // The step isn't refined if it is the value that is searched.
        let finer = if form == Form::Separate { step } else { FINER.1 * step };
        let again = self.run(deviation, (form, duration, finer), FINER.0, is_interrupted);
        let mended = holds(&again);
        Judged { outcome: if mended { again } else { outcome }, mended }
    }
}

/// True if a variable has this name, or is an element of that.
fn is_of(variable: &str, name: &str) -> bool {
    variable.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('['))
}

fn of_name(loaded: &LoadedLoop, unit: &str, name: &str) -> Vec<(String, Place)> {
    let full = format!("{unit}.{name}");
    let is_number = |variable: &crate::model_description::Variable| variable.kind == "Real" && variable.start.is_some();
    let found = loaded.variables().filter(|(known, _, variable)| is_of(known, &full) && is_number(variable));
    found.map(|(known, place, _)| (known, place)).collect()
}

/// The components of a pair as a loop, with the start values of the study.
fn wired(plant: &Plant, entry: &Entry, folder: &Path) -> Result<Structure, Error> {
    let mut found = Found::new(folder);
    let units =
        [("reference", &plant.reference), (PLANT, &plant.unit), (CONTROLLER, &entry.unit)].map(|(name, unit)| {
            let sibling = folder.join(unit);
            let file = if sibling.is_file() { sibling.display().to_string() } else { unit.clone() };
            found.unit(&format!("{name}={file}"))
        });
    let units = units.into_iter().collect::<Result<Vec<_>, _>>()?;
    let wishes = Wishes {
        name: format!("{}_{}", plant.name, entry.name),
        step: Some(plant.step),
        stop_time: Some(plant.duration),
        ..Wishes::default()
    };
    let draft = Draft::new(units, wishes)?;
    let text = draft.text();
    let mut structure = Structure::parse(&text, &LoopFiles::within(folder))?;
    structure.file = format!("{}/{}", plant.name, entry.name).into();
    let stays = |input: &str| entry.open.iter().any(|name| is_of(input, &format!("{CONTROLLER}.{name}")));
    if let Some((input, reason)) = draft.undecided().find(|(input, _)| !stays(input)) {
        let reason = format!("`{input}`: {reason}; list it in the entry's `open` to leave it unconnected");
        return Err(Error::Loop { file: structure.file, reason });
    }
    structure.metrics.clear();
    structure.plots.clear();
    let own = entry.set.iter().map(|(name, value)| (format!("{CONTROLLER}.{name}"), value));
    for (name, value) in plant.set.iter().map(|(name, value)| (name.clone(), value)).chain(own) {
        structure.set(&format!("{name}={value}"))?;
    }
    Ok(structure)
}

/// Places of a loop's signals in its row.
fn signals(loaded: &LoadedLoop, plant: &Plant, commands: &[String]) -> Result<Signals, String> {
    let closed = loaded.instantiate(&[]).map_err(|error| error.to_string())?;
    let place = |name: &str| {
        let place = closed.names().iter().position(|known| known == name);
        place.ok_or_else(|| format!("the loop has no output `{name}`; {}", near::choice(name, closed.names(), "")))
    };
    let pair = |[of, minus]: &[String; 2]| Ok::<_, String>([place(of)?, place(minus)?]);
    let outputs = closed.names().iter().enumerate().filter(|(_, name)| name.starts_with(&format!("{PLANT}.")));
    Ok(Signals {
        errors: plant.errors.iter().map(pair).collect::<Result<_, _>>()?,
        commands: commands.iter().map(|name| place(name)).collect::<Result<_, _>>()?,
        outputs: outputs.map(|(place, _)| place).collect(),
    })
}
