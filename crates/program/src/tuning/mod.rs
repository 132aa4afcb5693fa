//! Tuning of parameters of a closed loop by a particle swarm.

mod check;
mod floor;
mod objective;
mod record;
mod swarm;

pub use floor::Floor;
pub use objective::Objective;
pub use record::{Question, Record, parameter_set, typed_set};
pub use swarm::{Best, Generation, Motion, Swarm, is_better};

use std::collections::HashSet;
use std::sync::Once;

use serde::{Deserialize, Serialize};

use crate::fmu::Value;
use crate::simulation::{LoadedLoop, Place};
use crate::structure::{Settings, Structure, TunedParameter};
use crate::system::NO_LIMIT;
use crate::workers::{Workers, results};
use crate::{near, parallel};

/// Place within the bounds of the values that show what parameters vary.
const INSIDE: f64 = 0.6180339887498949;

/// A parameter of the search, with its bounds in its own unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// Its name, `unit.variable`.
    pub name: String,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// A search: a loop, its varied parameters, and an objective.
#[derive(Debug)]
pub struct Search {
    structure: Structure,
    settings: Settings,
    objective: Objective,
    ranges: Vec<Range>,
    places: Vec<Place>,
    /// One a thread: other tools' libraries may not allow two instances at work at a time.
    loops: Vec<LoadedLoop>,
    /// The same with other parameters of the loop: the largest objective counts.
    others: Vec<Search>,
    /// Done once its equations are compiled for all parameters but the tuned ones.
    folded: Once,
}

/// A run of the loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The objective; its lower bound if the run ended early because it could be no better than it has to be.
    Value(f64),
    /// Reason why there is none.
    Failed(String),
    /// The user stopped it before its end.
    Interrupted,
}

/// A run for a worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Values of the parameters.
    pub position: Vec<f64>,
    /// The run may end when its objective can't come below this; none for a complete run.
    pub bound: Option<f64>,
}

impl Outcome {
    /// The objective, where there is one.
    pub fn value(&self) -> Option<f64> {
        if let Outcome::Value(value) = self { Some(*value) } else { None }
    }

    /// The worse of two: a stop by the user, then a failure, then the larger objective.
    fn or_worse(self, other: Self) -> Self {
        match (self, other) {
            (Outcome::Interrupted, _) | (_, Outcome::Interrupted) => Outcome::Interrupted,
            (Outcome::Failed(reason), _) | (_, Outcome::Failed(reason)) => Outcome::Failed(reason),
            (Outcome::Value(one), Outcome::Value(other)) => Outcome::Value(one.max(other)),
        }
    }
}

impl Search {
    /// A search in a loop with one copy for each parallel run.
    ///
    /// # Errors
    /// When there is nothing to tune, a parameter doesn't exist or has no bounds, or the objective doesn't fit the
    /// loop.
    pub fn new(
        structure: Structure,
        settings: Settings,
        objective: Objective,
        parameters: &[TunedParameter],
        loops: Vec<LoadedLoop>,
    ) -> Result<Self, String> {
        let first = loops.first().ok_or("no loop was loaded")?;
        if parameters.is_empty() {
            return Err(
                "there are 0 parameters to tune: give at least one, as --parameter UNIT.variable=LOW..HIGH".to_owned()
            );
        }
        let mut names = HashSet::new();
        if let Some(twice) = parameters.iter().find(|parameter| !names.insert(&parameter.name)) {
            return Err(format!("parameter `{}` is given twice", twice.name));
        }
        let found: Vec<_> = parameters.iter().map(|parameter| range(parameter, first)).collect::<Result<_, _>>()?;
        let (ranges, places) = found.into_iter().unzip();
        first.instantiate(&[]).map_err(|error| error.to_string())?;
        objective.check(&structure, first.signals(), settings)?;
        let (others, folded) = (Vec::new(), Once::new());
        Ok(Search { structure, settings, objective, ranges, places, loops, others, folded })
    }

    /// Compiles the equations for all parameters but the tuned ones.
    fn fold(&self) {
        let value =
            |(place, range): (&Place, &Range)| (*place, Value::Real(range.low + INSIDE * (range.high - range.low)));
        let further: Vec<_> = self.places.iter().zip(&self.ranges).map(value).collect();
        LoadedLoop::fold(&self.loops, &further, &[], self.settings);
    }

    /// Minimises the largest objective of this search and of others, which vary the same parameters in other loops.
    #[must_use]
    pub fn worst_of(self, others: Vec<Search>) -> Self {
        Search { others, ..self }
    }

    /// The parameters.
    pub fn ranges(&self) -> &[Range] {
        &self.ranges
    }

    /// The start values of the loop.
    pub fn present(&self) -> Option<Vec<f64>> {
        self.places.iter().map(|&place| self.loops[0].start_of(place)).collect()
    }

    /// The same, if they lie within the bounds.
    pub fn start(&self) -> Option<Vec<f64>> {
        let inside = |value: &f64, range: &Range| (range.low..=range.high).contains(value);
        self.present().filter(|values| values.iter().zip(&self.ranges).all(|(value, range)| inside(value, range)))
    }

    /// Has workers run the loop with each of the positions; see [`Search::run`]. Those not run count as interrupted.
    pub fn hand_out(
        &self,
        workers: &dyn Workers,
        positions: &[&[f64]],
        bounds: &[f64],
        done: impl Fn(&Outcome),
    ) -> Vec<Outcome> {
        let finite = |bound: f64| Some(bound).filter(|bound| bound.is_finite());
        let job = |(position, bound): (&&[f64], &f64)| Job { position: position.to_vec(), bound: finite(*bound) };
        let outcomes = results(workers, positions.iter().zip(bounds).map(job), done);
        outcomes.into_iter().map(|outcome| outcome.unwrap_or(Outcome::Interrupted)).collect()
    }

    /// Runs the loop with each of the positions, on all threads. A run ends as soon as its objective can't come below
    /// the position's bound any more. Each outcome is passed to `done`; `is_interrupted` is called at every
    /// communication point.
    ///
    /// # Panics
    /// When there are not as many bounds as positions.
    pub fn run(
        &self,
        positions: &[&[f64]],
        bounds: &[f64],
        done: impl Fn(&Outcome) + Sync,
        is_interrupted: impl Fn() -> bool + Sync,
    ) -> Vec<Outcome> {
        let mut worst = vec![Outcome::Value(f64::NEG_INFINITY); positions.len()];
        for search in &self.others {
            let outcomes = search.run_all(positions, bounds, |_, outcome| outcome, &is_interrupted);
            worst = worst.into_iter().zip(outcomes).map(|(one, other)| one.or_worse(other)).collect();
        }
        let report = |k: usize, outcome: Outcome| {
            let outcome = worst[k].clone().or_worse(outcome);
            done(&outcome);
            outcome
        };
        self.run_all(positions, bounds, report, &is_interrupted)
    }

    /// Runs this loop with each of the positions; `decided` handles an outcome on its thread.
    fn run_all(
        &self,
        positions: &[&[f64]],
        bounds: &[f64],
        decided: impl Fn(usize, Outcome) -> Outcome + Sync,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Vec<Outcome> {
        assert_eq!(bounds.len(), positions.len());
        if positions.len() >= LoadedLoop::FEWEST_FOLDED {
            self.folded.call_once(|| self.fold());
        }
        parallel::each(&self.loops, positions.len(), |loaded, k| {
            if is_interrupted() {
                return Outcome::Interrupted;
            }
            decided(k, self.run_one(loaded, (positions[k], bounds[k]), is_interrupted))
        })
    }

    fn run_one(
        &self,
        loaded: &LoadedLoop,
        (position, bound): (&[f64], f64),
        is_interrupted: &dyn Fn() -> bool,
    ) -> Outcome {
        let values: Vec<_> = self.places.iter().copied().zip(position.iter().copied()).collect();
        let (mut interrupted, mut beaten) = (false, None);
        let recording = loaded.instantiate(&values).and_then(|closed| {
            let mut floor = Floor::new(&self.objective, &self.structure, closed.names(), self.settings);
            let go_on = |time: f64, row: &[f64]| {
                interrupted = is_interrupted();
                let is_beaten = |floor: &mut Floor| (!floor.add(time, row, bound)).then(|| floor.value());
                beaten = floor.as_mut().and_then(is_beaten);
                !interrupted && beaten.is_none()
            };
            closed.run_while(self.settings, go_on).map_err(|(error, _)| error)
        });
        match (recording, beaten) {
            (Ok(_), _) if interrupted => Outcome::Interrupted,
            (Ok(_), Some(value)) => Outcome::Value(value),
            (Ok(mut recording), None) => {
                self.objective.value(&self.structure, &mut recording).map_or_else(Outcome::Failed, Outcome::Value)
            }
            (Err(error), _) => Outcome::Failed(error.to_string()),
        }
    }
}

/// The bounds of a parameter, given or else those of the FMU, and its place.
fn range(parameter: &TunedParameter, loaded: &LoadedLoop) -> Result<(Range, Place), String> {
    let TunedParameter { name, low, high } = parameter;
    let (place, variable) = loaded
        .variable(name)
        .ok_or_else(|| format!("there is no parameter `{name}`; {}", near::choice(name, &loaded.tunable(), "")))?;
    if variable.causality != "parameter" || variable.kind != "Real" {
        let (kind, causality) = (&variable.kind, &variable.causality);
        return Err(format!("`{name}` is a {causality} of type {kind}: only Real parameters can be tuned"));
    }
    let allowed = |bound: &Option<String>| bound.as_ref().and_then(|text| text.parse::<f64>().ok());
    let (min, max) = (allowed(&variable.min), allowed(&variable.max));
    let bound = |own: Option<f64>, of_fmu: Option<f64>, word: &str| {
        // A value that means no limit is no bound.
        own.or(of_fmu.filter(|bound| bound.abs() < NO_LIMIT)).ok_or_else(|| {
            format!("`{name}` has no {word} bound, and its FMU declares none: give both bounds, {name}=LOW..HIGH")
        })
    };
    let (low, high) = (bound(*low, min, "lower")?, bound(*high, max, "upper")?);
    if low >= high {
        return Err(format!("`{name}` = {low}..{high}: the lower bound must be below the upper one"));
    }
    let (least, most) = (min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY));
    if low < least || high > most {
        return Err(format!("`{name}` = {low}..{high}: must lie within {least}..{most}, as its FMU allows"));
    }
    Ok((Range { name: name.clone(), low, high }, place))
}
