//! Experiments with an FMU in co-simulation: responses to small changes of an input, or of a state's start value.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::operating_point::{OperatingPoint, prepared, simulated};
use super::plan::{Plan, references};
use super::sampled::{Experiment, Moved, Shape};
use crate::error::Error;
use crate::fmu::{Fmu, Instance, set_starts};
use crate::model_description::Variable;
use crate::system::NO_LIMIT;

/// The usual change of an input or a start value: this part of its magnitude, or of half its range, else of its nominal
/// value, else of 1, whichever is largest.
pub(super) const CHANGE: f64 = 1e-2;
/// Largest deviation of a start value from the value that was set, relative to its change.
const TAKEN: f64 = 1e-6;
/// Communication steps for which an FMU that starts at an operating point is compared with one simulated until there.
const COMPARED: usize = 10;

/// Subject of the experiments.
pub(super) trait Subject {
    /// Sizes.
    fn shape(&self) -> Shape;
    /// Communication step, s.
    fn step(&self) -> f64;
    /// The states whose start values can be set.
    fn starts(&self) -> Vec<usize>;
    /// An experiment with a part of the usual change, over `steps` communication steps: an input returns after half of
    /// them.
    fn experiment(&self, moved: Moved, part: f64, steps: usize) -> Result<Experiment, Error>;
}

/// A unit at an operating point.
#[derive(Debug)]
pub(super) struct Bench<'a> {
    fmu: &'a Arc<Fmu>,
    plan: &'a Plan<'a>,
    point: &'a OperatingPoint,
    start: f64,
    time: f64,
    states: Vec<f64>,
    inputs: Vec<f64>,
    /// The variable that sets the start value of each state.
    starts: Vec<Option<&'a Variable>>,
}

impl<'a> Bench<'a> {
    /// An FMU at the states of a simulation from `start` until `time`.
    pub fn new(
        fmu: &'a Arc<Fmu>,
        plan: &'a Plan<'a>,
        point: &'a OperatingPoint,
        (start, time): (f64, f64),
    ) -> Result<Self, Error> {
        let (states, inputs) = (vec![0.0; plan.states.len()], vec![0.0; plan.inputs.len()]);
        let starts = vec![None; states.len()];
        let mut bench = Bench { fmu, plan, point, start, time, states, inputs, starts };
        let instance = bench.arrived()?;
        instance.get_real(&references(&plan.states), &mut bench.states)?;
        instance.get_real(&references(&plan.inputs), &mut bench.inputs)?;
        // An FMU may allow one instance at a time.
        let came = bench.answer(instance, None, COMPARED);
        // An FMU that refuses values that its description allows is still moved by its inputs.
        bench.starts = bench.settable().unwrap_or(bench.starts);
        if time > start && !came.and_then(|(states, _)| bench.begins_as(&states)).unwrap_or(false) {
            bench.starts.fill(None);
        }
        Ok(bench)
    }

    /// An instance at the operating point.
    fn arrived(&self) -> Result<Instance, Error> {
        let instance = self.fmu.instantiate(&self.fmu.description.name)?;
        simulated(prepared(instance, self.point, self.start, self.time)?, self.start, self.time, self.step())
    }

    /// An instance that begins at a time with start values that add to those of the operating point.
    fn begun(&self, time: f64, values: &[(&Variable, f64)]) -> Result<Instance, Error> {
        let instance = self.fmu.instantiate(&self.fmu.description.name)?;
        set_starts(&instance, &self.point.start)?;
        values.iter().try_for_each(|(variable, value)| instance.set_real(&[variable.reference], &[*value]))?;
        prepared(instance, &OperatingPoint { start: Vec::new(), ..self.point.clone() }, time, time)
    }

    /// The start values at the operating point; none at the FMU's own start.
    fn start_values(&self) -> Vec<(&'a Variable, f64)> {
        let values = self.starts.iter().zip(&self.states).filter_map(|(start, value)| Some(((*start)?, *value)));
        if self.time > self.start { values.collect() } else { Vec::new() }
    }

    /// The variable that sets the start value of each state: the state if its description allows it, otherwise a
    /// parameter.
    fn settable(&self) -> Result<Vec<Option<&'a Variable>>, Error> {
        let is_settable = |variable: &Variable| {
            variable.initial.as_deref() == Some("exact") && variable.start.is_some() && variable.kind == "Real"
        };
        let own = self.plan.states.iter().map(|&state| Some(state).filter(|state| is_settable(state)));
        let own: Vec<Option<&Variable>> = own.collect();
        if own.iter().all(Option::is_some) {
            return Ok(own);
        }
        let parameters = self.parameters_of_start()?;
        Ok(own.into_iter().zip(parameters).map(|(own, parameter)| own.or(parameter)).collect())
    }

    /// Finds the parameter that is the start value of each state. It has the state's value, and the state follows when
    /// all such parameters change, each by another amount.
    fn parameters_of_start(&self) -> Result<Vec<Option<&'a Variable>>, Error> {
        let is_settable =
            |v: &&Variable| (v.causality.as_str(), v.kind.as_str()) == ("parameter", "Real") && v.start.is_some();
        let parameters: Vec<&Variable> = self.fmu.description.variables.iter().filter(is_settable).collect();
        let instance = self.begun(self.start, &[])?;
        let (mut states, mut values) = (vec![0.0; self.plan.states.len()], vec![0.0; parameters.len()]);
        instance.get_real(&references(&self.plan.states), &mut states)?;
        instance.get_real(&references(&parameters), &mut values)?;
        drop(instance);
        let candidates = parameters.into_iter().zip(values).filter(|(_, value)| states.contains(value));
        let candidates: Vec<(&Variable, f64)> = candidates.collect();
        let change =
            |k: usize| CHANGE * CHANGE * candidates[k].1.abs().max(1.0) * (1.0 + k as f64 / candidates.len() as f64);
        let changed = candidates.iter().enumerate().map(|(k, (variable, value))| (*variable, value + change(k)));
        let instance = self.begun(self.start, &changed.collect::<Vec<_>>())?;
        let mut moved = vec![0.0; states.len()];
        instance.get_real(&references(&self.plan.states), &mut moved)?;
        let parameter_of = |state: usize| {
            let follows = |k: &usize| {
                candidates[*k].1 == states[state]
                    && (moved[state] - states[state] - change(*k)).abs() <= TAKEN * change(*k)
            };
            (0..candidates.len()).find(follows).map(|k| candidates[k].0)
        };
        Ok((0..states.len()).map(parameter_of).collect())
    }

    /// True if the FMU, started with the states of the operating point, goes on as the one simulated until there.
    fn begins_as(&self, came: &DMatrix<f64>) -> Result<bool, Error> {
        if self.starts.iter().any(Option::is_none) {
            return Ok(false);
        }
        let began = self.answer(self.begun(self.time, &self.start_values())?, None, COMPARED)?.0;
        let is_near = |state: usize| {
            let change = self.change_of(self.plan.states[state], self.states[state]);
            (came.row(state) - began.row(state)).amax() <= TAKEN * change
        };
        Ok((0..self.states.len()).all(is_near))
    }

    /// The usual change of a variable.
    fn change_of(&self, variable: &Variable, value: f64) -> f64 {
        let (min, max) = variable.bounds();
        let half = Some(0.5 * (max - min)).filter(|half| *half < 0.5 * NO_LIMIT && variable.causality == "input");
        let usual = half.or(variable.nominal);
        CHANGE * usual.filter(|usual| *usual > 0.0).unwrap_or(1.0).max(value.abs())
    }

    /// States and outputs at communication points, while an input has a changed value for the first half of the steps.
    fn answer(
        &self,
        mut instance: Instance,
        input: Option<(usize, f64)>,
        steps: usize,
    ) -> Result<(DMatrix<f64>, DMatrix<f64>), Error> {
        let plan = self.plan;
        let mut states = DMatrix::zeros(plan.states.len(), steps + 1);
        let mut outputs = DMatrix::zeros(plan.outputs.len(), steps + 1);
        let (state_references, output_references) = (references(&plan.states), references(&plan.outputs));
        for k in 0..=steps {
            instance.get_real(&state_references, states.column_mut(k).as_mut_slice())?;
            instance.get_real(&output_references, outputs.column_mut(k).as_mut_slice())?;
            if k < steps {
                if let Some((input, changed)) = input {
                    let value = if k < steps / 2 { changed } else { self.inputs[input] };
                    instance.set_real(&[plan.inputs[input].reference], &[value])?;
                }
                instance.do_step(self.time + k as f64 * self.step(), self.step())?;
            }
        }
        Ok((states, outputs))
    }
}

impl Subject for Bench<'_> {
    fn shape(&self) -> Shape {
        let place = |output: &&Variable| self.plan.states.iter().position(|state| state.name == output.name);
        Shape {
            states: self.states.len(),
            inputs: self.inputs.len(),
            outputs: self.plan.outputs.iter().map(place).collect(),
        }
    }

    fn step(&self) -> f64 {
        self.point.step_of(self.fmu)
    }

    fn starts(&self) -> Vec<usize> {
        (0..self.starts.len()).filter(|state| self.starts[*state].is_some()).collect()
    }

    fn experiment(&self, moved: Moved, part: f64, steps: usize) -> Result<Experiment, Error> {
        let (variable, value) = match moved {
            Moved::Start(state) => (self.starts[state].unwrap_or(self.plan.states[state]), self.states[state]),
            Moved::Input(input) => (self.plan.inputs[input], self.inputs[input]),
        };
        let change = part * self.change_of(variable, value);
        // An FMU refuses values beyond the bounds of a variable, or clips them.
        let (least, most) = variable.bounds();
        let (raised, lowered) = ((value + change).min(most.max(value)), (value - change).max(least.min(value)));
        let answer = |changed: f64| match moved {
            Moved::Start(_) => {
                let values = [self.start_values(), vec![(variable, changed)]].concat();
                self.answer(self.begun(self.time, &values)?, None, steps)
            }
            Moved::Input(input) => self.answer(self.arrived()?, Some((input, changed)), steps),
        };
        let (above, below) = (answer(raised)?, answer(lowered)?);
        let (states, outputs) = ((above.0 - below.0) * 0.5, (above.1 - below.1) * 0.5);
        Ok(Experiment { moved, change: 0.5 * (raised - lowered), states, outputs })
    }
}
