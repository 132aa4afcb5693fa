//! Test vectors of a law: inputs of its first steps, and what the FMU gives with the same Runge-Kutta steps.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::functions::Structs;
use super::law::Law;
use crate::controls::InputHandling;
use crate::execution::Execution;
use crate::integrator::IntegrationMethod;
use crate::model::Model;
use crate::system::{Choice, Section};

/// The most steps that are recorded.
const VECTORS: usize = 100;
/// Amplitude, in its own unit, and frequency, in rad/s, of each input around its start without signals of a loop.
const SWING: f64 = 0.02;
const FREQUENCY: f64 = 3.0;

/// Signals of a loop: a column for each input that is connected.
pub type Signals = BTreeMap<String, Vec<f64>>;

/// Steps of a law: a row each, in the order of the structs.
#[derive(Debug)]
pub(super) struct Vectors {
    pub inputs: Vec<Vec<f64>>,
    pub outputs: Vec<Vec<f64>>,
    /// States after the last step.
    pub states: Vec<f64>,
    /// The largest sizes of outputs and of states in all steps.
    pub largest: [Vec<f64>; 2],
}

/// Inputs of a run: the signals of a loop, small ones, or the start values.
#[derive(Debug, Clone, Copy)]
pub(super) enum Source<'a> {
    Loop(&'a Signals),
    Small,
    Start,
}

/// Two runs whose inputs differ by a rounding are the same to so much of the largest value, or the vectors end: beyond, roundings
/// decide. A replay allows five times as much.
const SAME: f64 = 2e-12;
/// Smaller values than this part of the largest of all are compared with that part.
const LEAST: f64 = 1e-4;

impl Vectors {
    /// Those of a law's first steps with the signals of its loop; with small ones where there are none, where the first step is refused
    /// or where the loop is at rest, then with constant ones. None where all are refused. They end where a step is, or where roundings
    /// are amplified.
    pub fn of(law: &Law, structs: &Structs, model: &Arc<Model>, signals: Option<&Signals>) -> Option<Self> {
        let sources = signals.map(Source::Loop).into_iter().chain([Source::Small, Source::Start]);
        let mut first = None;
        for source in sources {
            let made = Self::from(law, structs, model, source);
            if made.moves() {
                return Some(made);
            }
            first = first.or_else(|| (!made.inputs.is_empty()).then_some(made));
        }
        first
    }

    /// True if an output changes: of a law at rest, any other would give the same.
    fn moves(&self) -> bool {
        self.outputs.iter().any(|row| *row != self.outputs[0])
    }

    fn from(law: &Law, structs: &Structs, model: &Arc<Model>, source: Source) -> Self {
        let places = |of: &super::members::Members| of.reals().map(|(_, place)| place).collect::<Vec<_>>();
        let (inputs, outputs, states) = (places(&structs.inputs), places(&structs.outputs), places(&structs.states));
        let start = || started(law, model, IntegrationMethod::Fixed);
        let mut runs = [start(), start()];
        let zeros = |places: &[usize]| vec![0.0; places.len()];
        let largest = [zeros(&outputs), zeros(&states)];
        let mut made = Vectors { inputs: Vec::new(), outputs: Vec::new(), states: zeros(&states), largest };
        for step in 0..VECTORS {
            let one = |(number, &place): (usize, &usize)| input(law, source, (number, place), step);
            let row: Vec<f64> = inputs.iter().enumerate().map(one).collect();
            let [exact, rounded] = &mut runs;
            let near: Vec<f64> = row.iter().map(|value| value * (1.0 + f64::EPSILON)).collect();
            let are_taken = taken(exact, law, (&inputs, &row), step) && taken(rounded, law, (&inputs, &near), step);
            if !are_taken {
                break;
            }
            let read =
                |run: &Execution, places: &[usize]| places.iter().map(|&k| run.block().reals[k]).collect::<Vec<_>>();
            let now = [read(exact, &outputs), read(exact, &states)];
            let other = [read(rounded, &outputs), read(rounded, &states)];
            let mut largest = made.largest.clone();
            for (largest, now) in largest.iter_mut().zip(&now) {
                largest.iter_mut().zip(now).for_each(|(largest, value)| *largest = largest.max(value.abs()));
            }
            let sizes = largest.each_ref().map(|of| sizes(of));
            let parts = |k: usize| now[k].iter().zip(&other[k]).zip(&sizes[k]);
            let is_same = |((one, other), size): ((&f64, &f64), &f64)| (one - other).abs() <= SAME * size;
            if step > 0 && ![0, 1].into_iter().flat_map(parts).all(is_same) {
                break;
            }
            made.inputs.push(row);
            let [outputs_now, states_now] = now;
            made.outputs.push(outputs_now);
            (made.states, made.largest) = (states_now, largest);
        }
        made.largest = made.largest.each_ref().map(|of| sizes(of));
        made
    }
}

/// Sizes that differences are compared with: the largest values, where these aren't roundings of the others.
fn sizes(largest: &[f64]) -> Vec<f64> {
    let most = largest.iter().copied().fold(0.0, f64::max);
    largest.iter().map(|size| size.max(LEAST * most)).collect()
}

/// Takes a step, the first after initialisation; false where that is refused.
pub(super) fn taken(run: &mut Execution, law: &Law, (places, values): (&[usize], &[f64]), step: usize) -> bool {
    places.iter().zip(values).for_each(|(&place, &value)| run.set_real(place, value));
    let time = |step: usize| step as f64 * law.period;
    let taken = (step > 0 || run.initialise().is_ok()) && run.step(time(step), time(step + 1) - time(step)).is_ok();
    if taken {
        run.evaluate();
    }
    taken
}

/// An instance with the start values of a law, which takes as many Runge-Kutta steps in a period where its method is the fixed one.
pub(super) fn started(law: &Law, model: &Arc<Model>, method: IntegrationMethod) -> Execution {
    let mut execution = Execution::new(Arc::clone(model));
    let variables = model.variables();
    let stepped = variables.stepped().map(|place| (place, execution.block().integers[place]));
    // Items of enumerations are counted from 1.
    let item = |place: Option<usize>| place.map_or(1, |place| place as i32 + 1);
    let method = IntegrationMethod::ITEMS.iter().position(|(item, ..)| *item == method);
    let sampled = InputHandling::ITEMS.iter().position(|(item, ..)| *item == InputHandling::Hold);
    let chosen =
        [("integration_method", item(method)), ("fixed_steps", law.substeps as i32), ("input_handling", item(sampled))];
    let chosen = chosen.map(|(name, value)| variables.find(name).map(|element| (variables.index(element), value)));
    let block = execution.block_mut();
    block.copy_from(&law.start);
    stepped.into_iter().chain(chosen.into_iter().flatten()).for_each(|(place, value)| block.integers[place] = value);
    execution
}

/// An input in a step.
pub(super) fn input(law: &Law, source: Source, (number, place): (usize, usize), step: usize) -> f64 {
    let start = law.start.reals[place];
    let signals = match source {
        Source::Loop(signals) => signals,
        Source::Small => return start + SWING * (FREQUENCY * step as f64 * law.period + number as f64).sin(),
        Source::Start => return start,
    };
    let variables = law.variables();
    let inputs = variables.visible().filter(|e| e.variable.is_real() && e.variable.section == Section::Input);
    let column = inputs.filter(|&e| variables.index(e) == place).find_map(|element| signals.get(&element.name()));
    column.and_then(|column| column.get(step).or(column.last())).copied().unwrap_or(start)
}

#[cfg(test)]
mod tests {
    use super::{LEAST, sizes};

    #[test]
    fn a_small_value_is_compared_with_its_own_size_unless_it_is_rounding_of_others() {
        assert_eq!(sizes(&[2.0, 1e-3, 1e-9, 0.0]), [2.0, 1e-3, 2.0 * LEAST, 2.0 * LEAST]);
    }
}
