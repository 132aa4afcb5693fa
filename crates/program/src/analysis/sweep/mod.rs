//! Sweeps: one loop with all combinations of some values.

mod axis;
mod page;

use serde::{Deserialize, Serialize};

pub use axis::{Axis, Spacing};
pub use page::SweepPage;

use crate::figures::{labelled, thinned};
use crate::fmu::Value;
use crate::parallel;
use crate::results::{Meter, measure};
use crate::simulation::{LoadedLoop, Place, Recording};
use crate::structure::{Settings, Structure};

/// The most runs of a sweep.
const MOST_RUNS: usize = 100_000;
/// The most runs whose curves are drawn.
const MOST_DRAWN: usize = 24;
/// Groups of points in a curve: about two pixels of a diagram each.
const GROUPS: usize = 300;
/// The most signals that are drawn.
const MOST_SIGNALS: usize = 12;

/// A sweep: a loop, and what is varied in it.
#[derive(Debug)]
pub struct Sweep {
    structure: Structure,
    settings: Settings,
    axes: Vec<Axis>,
    places: Vec<Place>,
    values: Vec<Vec<Value>>,
    /// Labels of all possible metrics: the loop's own, then those of steps.
    labels: Vec<String>,
    /// One a thread: other tools' libraries may not allow two instances at work at a time.
    loops: Vec<LoadedLoop>,
}

/// A run of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Reason why it ended early; none if it is complete.
    pub failure: Option<String>,
    /// The metrics, in the order of their labels; none of a failed run.
    pub metrics: Vec<Option<f64>>,
    /// Curves of the signals that are drawn; none for most points of a large sweep.
    pub curves: Vec<Vec<(f64, Option<f64>)>>,
}

impl Point {
    /// The metric at a place; `None` without a value.
    pub fn metric(&self, place: usize) -> Option<f64> {
        self.metrics.get(place).copied().flatten()
    }
}

impl Sweep {
    /// A sweep of a loop with one copy for each parallel run. Names may lack the component if only one has such a
    /// parameter.
    ///
    /// # Errors
    /// When a parameter doesn't exist, is named twice or can't be set, a value isn't allowed, or runs are too many.
    pub fn new(
        structure: Structure,
        settings: Settings,
        axes: Vec<Axis>,
        loops: Vec<LoadedLoop>,
    ) -> Result<Self, String> {
        let first = loops.first().ok_or("no loop was loaded")?;
        let (mut named, mut places, mut values): (Vec<Axis>, _, _) = (Vec::new(), Vec::new(), Vec::new());
        for axis in axes {
            let (name, place) = first.settable(&axis.name)?;
            if named.iter().any(|other| other.name == name) {
                return Err(format!("`{name}` is given twice"));
            }
            let value = |text: &String| {
                first.start_value(place, text).map_err(|allowed| format!("`{name}` = {text}: {allowed}"))
            };
            values.push(axis.values.iter().map(value).collect::<Result<_, _>>()?);
            named.push(Axis { name, ..axis });
            places.push(place);
        }
        let runs = named.iter().try_fold(1_usize, |runs, axis| runs.checked_mul(axis.values.len()));
        if runs.is_none_or(|runs| runs > MOST_RUNS) {
            return Err(format!("too many runs: at most {MOST_RUNS} are allowed"));
        }
        let labels = Meter::new(&structure, &mut first.signals())?.labels();
        Ok(Sweep { structure, settings, axes: named, places, values, labels, loops })
    }

    /// The loop.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The parameters, by their full names.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Number of runs.
    pub fn runs(&self) -> usize {
        self.axes.iter().map(|axis| axis.values.len()).product()
    }

    /// Returns the place of each parameter's value in a run; the last parameter changes from run to run.
    pub fn position(&self, mut run: usize) -> Vec<usize> {
        let mut position: Vec<usize> = Vec::new();
        for axis in self.axes.iter().rev() {
            position.insert(0, run % axis.values.len());
            run /= axis.values.len();
        }
        position
    }

    /// The values of a run, as they are set.
    pub fn values(&self, run: usize) -> Vec<&str> {
        self.axes.iter().zip(self.position(run)).map(|(axis, k)| axis.values[k].as_str()).collect()
    }

    /// The metrics that these runs have, by place and label: the loop's own, and those of steps where a reference stepped.
    pub fn metrics<'a>(&'a self, points: &'a [Option<Point>]) -> impl Iterator<Item = (usize, &'a str)> {
        let has = move |k: usize| points.iter().flatten().any(|point| point.metric(k).is_some());
        let all = self.labels.iter().map(String::as_str).enumerate();
        all.filter(move |(k, _)| *k < self.structure.metrics.len() || has(*k))
    }

    /// The signals that are drawn: those of the plots.
    pub fn signals(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for name in self.structure.plots.iter().flat_map(|plot| &plot.signals) {
            if !names.contains(&name.as_str()) && names.len() < MOST_SIGNALS {
                names.push(name);
            }
        }
        names
    }

    /// The unit of measurement of a variable; empty if it has none.
    fn unit(&self, name: &str) -> String {
        let variable = self.loops.first().and_then(|loaded| loaded.variable(name));
        variable.and_then(|(_, variable)| variable.unit.clone()).unwrap_or_default()
    }

    /// The name of a variable with its unit of measurement.
    fn with_unit(&self, name: &str) -> String {
        labelled(name, Some(self.unit(name)).filter(|unit| unit != "1").as_deref().unwrap_or_default())
    }

    /// True if the curves of a run are drawn: those of all runs, or of some at equal distances.
    pub fn is_drawn(&self, run: usize) -> bool {
        let last = self.runs() - 1;
        last < MOST_DRAWN || (0..MOST_DRAWN).any(|k| (k * last + (MOST_DRAWN - 1) / 2) / (MOST_DRAWN - 1) == run)
    }

    /// Makes the runs that aren't known, on all threads. Each result is passed to `done`; `is_interrupted` is called at
    /// every communication point.
    pub fn run(
        &self,
        known: &[Option<Point>],
        done: impl Fn(usize, &Point) + Sync,
        is_interrupted: impl Fn() -> bool + Sync,
    ) -> Vec<Option<Point>> {
        let missing: Vec<usize> = (0..self.runs()).filter(|&run| known.get(run).is_none_or(Option::is_none)).collect();
        if missing.len() >= LoadedLoop::FEWEST_FOLDED {
            self.fold();
        }
        let made = parallel::each(&self.loops, missing.len(), |loaded, k| {
            let point = self.run_one(loaded, missing[k], &is_interrupted)?;
            done(missing[k], &point);
            Some(point)
        });
        let mut points = known.to_vec();
        points.resize(self.runs(), None);
        missing.into_iter().zip(made).for_each(|(run, point)| points[run] = point);
        points
    }

    /// Compiles the equations for all parameters but those of the axes.
    fn fold(&self) {
        let other = |(place, values): (&Place, &Vec<Value>)| {
            let present = self.loops.first()?.value_of(*place);
            values.iter().find(|value| Some(*value) != present.as_ref()).map(|value| (*place, value.clone()))
        };
        let further: Vec<_> = self.places.iter().zip(&self.values).filter_map(other).collect();
        LoadedLoop::fold(&self.loops, &further, &[], self.settings);
    }

    fn run_one(&self, loaded: &LoadedLoop, run: usize, is_interrupted: &dyn Fn() -> bool) -> Option<Point> {
        if is_interrupted() {
            return None;
        }
        let mut interrupted = false;
        let position = self.position(run);
        let values = self.places.iter().zip(&self.values).zip(position);
        let values: Vec<_> = values.map(|((place, values), k)| (*place, values[k].clone())).collect();
        let recording = loaded.instantiate_with(&values).and_then(|closed| {
            let go_on = |time| {
                interrupted = is_interrupted() && time < self.settings.stop_time;
                !interrupted
            };
            closed.run(self.settings, go_on).map_err(|(error, _)| error)
        });
        let failed = |reason: String| Point {
            failure: Some(reason),
            metrics: vec![None; self.labels.len()],
            curves: Vec::new(),
        };
        match recording {
            Ok(_) if interrupted => None,
            Ok(recording) => Some(self.point(run, recording).unwrap_or_else(failed)),
            Err(error) => Some(failed(error.to_string())),
        }
    }

    fn point(&self, run: usize, mut recording: Recording) -> Result<Point, String> {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        let measured = measure(&self.structure, &mut recording)?;
        let value = |label: &String| measured.iter().find(|metric| metric.label == *label)?.value.and_then(finite);
        let metrics = self.labels.iter().map(value).collect();
        let curve = |name: &str| {
            let column = recording.column(name).ok_or_else(|| format!("there is no signal `{name}`"))?;
            let points = thinned(&recording.times, column, GROUPS);
            Ok(points.into_iter().map(|(time, value)| (time, finite(value))).collect())
        };
        let drawn = self.signals().into_iter().filter(|_| self.is_drawn(run));
        Ok(Point { failure: None, metrics, curves: drawn.map(curve).collect::<Result<_, String>>()? })
    }
}
