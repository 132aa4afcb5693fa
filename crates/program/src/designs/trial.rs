//! The loop of a candidate and a linear plant, as FMUs that are stepped in turn.

use super::series::{Course, Followed};
use super::written::Written;
use crate::error::{Error, Invalid};
use crate::fmu::Ready;
use crate::league::bench::{Benched, SENSOR, benched};
use crate::nominal::WorstPlant;
use crate::report::number;
use crate::simulation::{LoadedLoop, Place};
use crate::structure::{Settings, Structure, Wishes};
use crate::template::{Plant, named_outputs};

/// Names in the loop.
const PLANT: &str = "plant";
const REFERENCE: &str = "reference";
/// The most communication points of a run, and of all runs of a candidate: more would take minutes.
const MOST_POINTS: f64 = 2e6;
/// Elementary operations of the FMUs in all these runs, shared among the communication steps of each FMU. The limit counts
/// operations, not seconds, so it has the same results on every machine.
const MOST_WORK: f64 = 1e11;
/// The parameter of the FMUs that limits the work of one communication step.
const WORK_LIMIT: &str = "work_limit";
/// A run ends when its output exceeds the reference by this factor.
const LOST: f64 = 1e6;

/// Reason why a run has no result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotRun {
    /// It would take long, because of this.
    TooLong(String),
    /// It failed, for this reason.
    Failed(String),
}

impl std::fmt::Display for NotRun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NotRun::TooLong(why) => {
                write!(f, "its runs would take long: {why}")
            }
            NotRun::Failed(reason) => f.write_str(reason),
        }
    }
}

impl NotRun {
    /// The same as an error.
    pub fn error(&self) -> Error {
        Error::Argument(Invalid::because(self.to_string()))
    }
}

impl From<Error> for NotRun {
    fn from(error: Error) -> Self {
        NotRun::Failed(error.to_string())
    }
}

/// Noise of one measured signal, or of all.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// The output or state of the plant; all if there is none.
    pub signal: Option<String>,
    /// Standard deviation, at each communication step.
    pub deviation: f64,
}

/// True if an output of the plant has this name: one that is called like a state has another name.
fn is_of(output: &str, name: &str) -> bool {
    output.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest == "_output")
}

fn wishes(step: f64) -> Wishes {
    Wishes { name: "design".to_owned(), step: Some(step), ..Wishes::default() }
}

/// A loop of a controller, and perhaps an observer, with a linear plant and a reference.
#[derive(Debug)]
pub struct Trial {
    loaded: LoadedLoop,
    /// Communication step, s.
    pub step: f64,
    sizes: Vec<f64>,
    /// Start values of sensors, and limits of the FMUs' work.
    start: Vec<(Place, f64)>,
    /// Duration of all its runs together, s, if their work is limited.
    planned: Option<f64>,
    /// Places of outputs and controls among the signals.
    outputs: Vec<usize>,
    controls: Vec<usize>,
}

impl Trial {
    /// The loop of descriptions, with a communication step, s, for a plant with references of these sizes.
    ///
    /// # Errors
    /// When it can't be closed.
    pub fn new(written: &Written, step: f64, plant: &Plant, sizes: &[f64], units: &Ready) -> Result<Self, Error> {
        Self::of_structure(written.structure(units.library(), wishes(step))?.0, plant, sizes, units)
    }

    /// The same with sensors between the plant and the components that measure it.
    ///
    /// # Errors
    /// When it can't be closed, or no component measures the signal with noise.
    pub fn with_noise(
        (written, step): (&Written, f64),
        plant: &Plant,
        sizes: &[f64],
        units: &Ready,
        noise: &[Noise],
    ) -> Result<Self, Error> {
        let (plain, _) = written.structure(units.library(), wishes(step))?;
        let unit = plain.components.iter().find(|unit| unit.name == PLANT);
        let unit = unit.ok_or_else(|| plain.refuse(0, "there is no plant"))?;
        let described = units.fmu(&plain.description_of(&unit.fmu)?)?;
        let Benched { structure, measured, .. } = benched(&plain, plant.sizes().1, &described.description, 0)?;
        let mut trial = Self::of_structure(structure, plant, sizes, units)?;
        let sensor = |what: String, value: f64| Some((trial.place(&format!("{SENSOR}.{what}"))?, value));
        let deviation = |(k, name): (usize, &String)| {
            let known = |noise: &&Noise| noise.signal.as_ref().is_none_or(|of| is_of(name, of));
            let found = noise.iter().rfind(known)?;
            sensor(format!("noise_deviation[{}]", k + 1), found.deviation)
        };
        let noisy = measured.iter().enumerate().filter_map(deviation);
        trial.start = noisy.chain(sensor("sample_time".to_owned(), step)).collect();
        Ok(trial)
    }

    fn of_structure(structure: Structure, plant: &Plant, sizes: &[f64], units: &Ready) -> Result<Self, Error> {
        let loaded = LoadedLoop::of(&structure, |unit| units.fmu(&structure.description_of(&unit.fmu)?))?;
        let names = loaded.instantiate(&[])?.names().to_vec();
        let refuse = |what: String| Error::Loop { file: structure.file.clone(), reason: what };
        let place = |name: &str| names.iter().position(|known| known == name);
        let outputs = named_outputs(plant);
        let output = |i: usize| match outputs.get(i) {
            Some(name) => place(&format!("{PLANT}.{name}")),
            None => place(&format!("{PLANT}.y[{}]", i + 1)),
        };
        let control = |j: usize| {
            let input = plant.u.names.get(j).cloned().unwrap_or_else(|| format!("u[{}]", j + 1));
            let to = (PLANT.to_owned(), input);
            let from = structure.connections.iter().find(|connection| connection.to == to).map(|found| &found.from);
            from.and_then(|(unit, name)| place(&format!("{unit}.{name}")))
        };
        let (_, m, p) = plant.sizes();
        let outputs: Option<Vec<_>> = (0..p).map(output).collect();
        let controls: Option<Vec<_>> = (0..m).map(control).collect();
        let outputs = outputs.ok_or_else(|| refuse("an output of the plant isn't in the loop".to_owned()))?;
        let controls = controls.ok_or_else(|| refuse("an input of the plant isn't connected".to_owned()))?;
        let (step, start, sizes) = (structure.step, Vec::new(), sizes.to_vec());
        Ok(Trial { loaded, step, start, planned: None, sizes, outputs, controls })
    }

    /// The same with a limit of the work of its runs, which last so many seconds altogether.
    #[must_use]
    pub(super) fn within(mut self, seconds: f64) -> Self {
        let points = seconds / self.step;
        self.planned = Some(seconds);
        let units = self.loaded.units().iter().map(|unit| format!("{}.{WORK_LIMIT}", unit.name));
        let limits = units.filter_map(|name| Some((self.place(&name)?, MOST_WORK / points.max(1.0))));
        let limits: Vec<_> = limits.collect();
        self.start.extend(limits);
        self
    }

    /// Number of references.
    pub(super) fn references(&self) -> usize {
        self.sizes.len()
    }

    /// Size of a reference.
    pub(super) fn size(&self, i: usize) -> f64 {
        self.sizes[i]
    }

    fn place(&self, name: &str) -> Option<Place> {
        self.loaded.variable(name).map(|(place, _)| place)
    }

    /// Start values of the plant's variables for another plant.
    fn of_plant(&self, other: &WorstPlant) -> Vec<(Place, f64)> {
        let matrices = [("A", &other.A), ("B", &other.B)].into_iter();
        let entries = matrices.flat_map(|(name, rows)| {
            rows.iter().enumerate().flat_map(move |(i, row)| {
                row.iter().enumerate().map(move |(j, value)| (format!("{PLANT}.{name}[{},{}]", i + 1, j + 1), *value))
            })
        });
        entries.filter_map(|(name, value)| Some((self.place(&name)?, value))).collect()
    }

    /// Time of a step of a reference, s. It is one communication step, as a controller that starts without a jump would
    /// begin at the new reference; 0 in a loop that starts smoothly.
    fn step_time(&self) -> f64 {
        let height = self.place(&format!("{REFERENCE}.step_height[1,1]"));
        let is_smooth = height.is_some_and(|place| self.loaded.given(place).is_some());
        if is_smooth { 0.0 } else { self.step }
    }

    /// Start values for a step of the reference of one output, or of none.
    fn of_reference(&self, i: Option<usize>) -> Vec<(Place, f64)> {
        let own = (0..self.sizes.len())
            .filter(|&j| Some(j) != i)
            .flat_map(|j| [format!("{REFERENCE}.step_height[{},1]", j + 1), format!("{REFERENCE}.offset[{}]", j + 1)]);
        own.filter_map(|name| Some((self.place(&name)?, 0.0))).collect()
    }

    /// Simulates the loop with a plant [default: nominal]. The course starts when the reference of output `i` steps.
    ///
    /// # Errors
    /// When a component fails, or a signal grows without bound.
    pub fn course(&self, i: usize, other: Option<&WorstPlant>, duration: f64) -> Result<Course, NotRun> {
        let start = other.map(|other| self.of_plant(other)).unwrap_or_default();
        let step_time = self.step_time();
        let course = self.run(self.of_reference(Some(i)).into_iter().chain(start), duration + step_time)?;
        Ok(course.from(step_time))
    }

    /// The same with the nominal plant and constant references.
    ///
    /// # Errors
    /// When a component fails.
    pub fn at_rest(&self, duration: f64) -> Result<Course, NotRun> {
        self.run(self.of_reference(None), duration)
    }

    fn run(&self, start: impl IntoIterator<Item = (Place, f64)>, duration: f64) -> Result<Course, NotRun> {
        if duration.max(self.planned.unwrap_or(0.0)) / self.step > MOST_POINTS {
            let reason = format!("more than {MOST_POINTS:e} communication steps of {} s", number(self.step));
            return Err(NotRun::TooLong(reason));
        }
        let start: Vec<_> = start.into_iter().chain(self.start.iter().copied()).collect();
        let settings = Settings { start_time: 0.0, stop_time: duration, step: self.step };
        let mut course = Course::new(self.outputs.len(), self.controls.len());
        let largest = LOST * self.sizes.iter().copied().fold(0.0, f64::max);
        let mut is_lost = false;
        let ran = self.loaded.instantiate(&start)?.watch(settings, &[], |time, row| {
            course.times.push(time);
            for (values, &place) in course.outputs.iter_mut().zip(&self.outputs) {
                values.push(row[place]);
                is_lost |= row[place].is_nan() || row[place].abs() > largest;
            }
            course.controls.iter_mut().zip(&self.controls).for_each(|(values, &place)| values.push(row[place]));
            !is_lost
        });
        ran.map_err(|error| match error.to_string() {
            reason if self.planned.is_some() && reason.contains(WORK_LIMIT) => {
                NotRun::TooLong("communication steps with too many integration steps".to_owned())
            }
            reason => NotRun::Failed(reason),
        })?;
        if is_lost {
            return Err(NotRun::Failed("the output grows without bound".to_owned()));
        }
        Ok(course)
    }

    /// The worst of the steps of all references, and the course of the first.
    ///
    /// # Errors
    /// When a component fails.
    pub fn steps(&self, other: Option<&WorstPlant>, duration: f64) -> Result<(Followed, Course), NotRun> {
        let first = self.course(0, other, duration)?;
        let mut worst = first.followed(0, &self.sizes);
        for i in 1..self.sizes.len() {
            worst = worst.or_worse(&self.course(i, other, duration)?.followed(i, &self.sizes));
        }
        Ok((worst, first))
    }
}
