//! The stimuli of a reference experiment: inputs at rest, with jumps of a part of their magnitudes at communication points.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::execution::Execution;
use crate::model::Model;
use crate::system::{Causality, Data, Element, Section, Variability, Variable};

/// Communication steps of an experiment, and those from row to row.
const STEPS: usize = 1000;
const APART: usize = 20;
/// The first row, and where between rows inputs jump: neither is where a law samples that does so every fourth communication step,
/// since tools differ in what they do where both coincide.
const FIRST: usize = 2;
const JUMP: usize = 11;
/// The item by which a law is evaluated at all times.
const CONTINUOUS: &str = "continuous";
/// Communication steps in the time between two samples, at least.
const PER_SAMPLE: f64 = 4.0;

/// An output, or an input: its name, and its place among the reals or integers of a block.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Named {
    pub name: String,
    pub place: usize,
}

/// An input, and the values that it has from communication points on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stimulus {
    pub input: Named,
    pub is_real: bool,
    /// The value at the start, and those from later points on.
    pub values: BTreeMap<usize, f64>,
}

impl Stimulus {
    /// The value at a communication point; the last before it if `before` is true.
    pub fn at(&self, point: usize, before: bool) -> f64 {
        let mut values = self.values.range(..=point).rev();
        let value = values.find(|(changed, _)| !before || **changed < point || point == 0);
        value.map_or(0.0, |(_, value)| *value)
    }
}

/// A parameter that an experiment sets: an item of a choice.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chosen {
    pub parameter: Named,
    pub item: String,
    pub number: i32,
}

/// An experiment that is ready to be run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plan {
    /// Communication step, s.
    pub step: f64,
    /// Their number.
    pub steps: usize,
    pub chosen: Vec<Chosen>,
    pub stimuli: Vec<Stimulus>,
    pub outputs: Vec<Named>,
    /// Communication points of rows.
    pub rows: Vec<usize>,
    /// Communication points at which inputs jump, with the stimuli that do.
    pub changes: BTreeMap<usize, Vec<usize>>,
}

impl Plan {
    /// Creates that of a model, whose inputs jump by a part of their magnitudes, in steps that are a part of its own ones.
    pub fn of(model: &Arc<Model>, amplitude: f64, part: f64) -> Self {
        let experiment = &model.description().experiment;
        let stimuli = stimuli(model, amplitude);
        // What has no inputs is shown for the whole of its experiment.
        let own = if stimuli.is_empty() { experiment.stop_time / STEPS as f64 } else { experiment.step };
        let steps = ((experiment.stop_time / own).round() as usize).clamp(1, STEPS);
        // In digits that a person reads: the first sample lies a little before its time.
        let step = rounded(part * sampled(model).map_or(own, |period| own.min(period / PER_SAMPLE)), 6);
        let mut changes: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (place, stimulus) in stimuli.iter().enumerate() {
            let points = stimulus.values.keys().filter(|point| **point > 0 && **point < steps);
            points.for_each(|point| changes.entry(*point).or_default().push(place));
        }
        let rows = (FIRST..=steps).step_by(APART).collect();
        Plan { step, steps, chosen: chosen(model), stimuli, outputs: outputs(model), rows, changes }
    }

    /// The time of a communication point, s.
    pub fn time(&self, point: usize) -> f64 {
        point as f64 * self.step
    }
}

/// A number in so many digits.
pub(super) fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

/// A law that samples at communication points is evaluated continuously where it offers that: else each step is another law.
fn chosen(model: &Model) -> Vec<Chosen> {
    let variables = model.variables();
    let choice = |v: &Variable| {
        let Data::Choice { items, start, .. } = &v.data else { return None };
        let number = items.iter().position(|(item, _)| item == CONTINUOUS)? as i32 + 1;
        let element = v.element(0);
        let parameter = Named { name: element.name(), place: variables.index(element) };
        (number != *start).then(|| Chosen { parameter, item: CONTINUOUS.to_owned(), number })
    };
    variables.iter().filter(|v| v.section == Section::Parameter).filter_map(choice).collect()
}

/// Sets the parameters of an experiment, and the inputs at its start.
pub(super) fn set_start(execution: &mut Execution, plan: &Plan) {
    plan.chosen.iter().for_each(|chosen| execution.set_integer(chosen.parameter.place, chosen.number));
    set_inputs(execution, plan, 0);
}

/// Sets the inputs of an instance to their values at a communication point.
pub(super) fn set_inputs(execution: &mut Execution, plan: &Plan, point: usize) {
    for stimulus in &plan.stimuli {
        let (place, value) = (stimulus.input.place, stimulus.at(point, false));
        if stimulus.is_real { execution.set_real(place, value) } else { execution.set_integer(place, value as i32) }
    }
}

/// The outputs that move continuously. Others count steps or depend on them, so that each master sees its own.
fn outputs(model: &Model) -> Vec<Named> {
    let variables = model.variables();
    let is_output =
        |v: &&Variable| v.causality == Causality::Output && v.variability == Variability::Continuous && v.is_real();
    let elements = variables.iter().filter(is_output).flat_map(|v| v.elements());
    elements.map(|element| Named { name: element.name(), place: variables.index(element) }).collect()
}

/// The inputs one after another: up, half as far down, and back; switches over and back.
fn stimuli(model: &Model, amplitude: f64) -> Vec<Stimulus> {
    let variables = model.variables();
    let inputs = variables.iter().filter(|v| v.section == Section::Input && v.causality == Causality::Input);
    let stimulus = |(k, element): (usize, Element)| {
        let input = Named { name: element.name(), place: variables.index(element) };
        let at = |interval: usize| APART * interval + JUMP;
        let (is_real, values) = match &element.variable.data {
            Data::Real { min, max, .. } => {
                let (rest, size) = (element.start(), amplitude * element.nominal());
                let [least, most] = [min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY)];
                let to = |part: f64| (rest + part * size).clamp(least, most);
                let first = 3 + 5 * k % 34;
                let values = [(0, rest), (at(first), to(1.0)), (at(first + 7), to(-0.5)), (at(first + 14), rest)];
                (true, BTreeMap::from(values))
            }
            Data::Boolean { start } => {
                let (rest, first) = (f64::from(u8::from(*start)), 20 + 3 * k % 20);
                (false, BTreeMap::from([(0, rest), (at(first), 1.0 - rest), (at(first + 8), rest)]))
            }
            Data::Integer { start, .. } | Data::Choice { start, .. } => {
                (false, BTreeMap::from([(0, f64::from(*start))]))
            }
        };
        Stimulus { input, is_real, values }
    };
    inputs.flat_map(|v| v.elements()).enumerate().map(stimulus).collect()
}

/// The time to the first sample behind the start, s, where the model has any that it knows in advance.
fn sampled(model: &Arc<Model>) -> Option<f64> {
    let mut execution = Execution::new(Arc::clone(model));
    execution.hand_over_integration();
    execution.initialise().ok()?;
    execution.begin_model_exchange().ok()?;
    execution.update_discrete().ok()?.next_time_event.filter(|time| *time > 0.0)
}
