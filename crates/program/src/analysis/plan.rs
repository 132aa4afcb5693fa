//! The variables of a linear system, and their sensitivities to each other.

use nalgebra::DMatrix;

use crate::error::Error;
use crate::fmu::Instance;
use crate::model_description::ModelStructure;
use crate::model_description::{ModelDescription, Variable};

/// Method that finds derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Derivatives {
    /// The FMU's own, which are exact.
    Exact,
    /// Central differences about the present states and inputs, in model exchange.
    Differences,
}

/// Change of a value in a difference, in parts of its magnitude, or of its nominal value if that is larger: the third
/// root of the rounding error, which balances it against the truncation error.
pub(super) const DIFFERENCE: f64 = 6e-6;

/// The variables of the matrices.
#[derive(Debug, Clone)]
pub(super) struct Plan<'a> {
    pub states: Vec<&'a Variable>,
    pub derivatives: Vec<&'a Variable>,
    pub inputs: Vec<&'a Variable>,
    pub outputs: Vec<&'a Variable>,
    pub by: Derivatives,
}

/// Slopes of the derivatives of states, and of outputs, with one column a known.
#[derive(Debug)]
pub(super) struct Changes {
    pub derivatives: DMatrix<f64>,
    pub outputs: DMatrix<f64>,
}

pub(super) fn references(variables: &[&Variable]) -> Vec<u32> {
    variables.iter().map(|variable| variable.reference).collect()
}

impl<'a> Plan<'a> {
    pub fn new(description: &'a ModelDescription, structure: &ModelStructure, by: Derivatives) -> Self {
        let variables = &description.variables;
        let is_input = |v: &&Variable| v.causality == "input" && v.kind == "Real" && v.variability == "continuous";
        let outputs = variables.iter().filter(|v| v.causality == "output" && v.kind == "Real");
        Plan {
            states: structure.states.iter().map(|(state, _)| &variables[*state]).collect(),
            derivatives: structure.states.iter().map(|(_, derivative)| &variables[*derivative]).collect(),
            inputs: variables.iter().filter(is_input).collect(),
            outputs: if structure.outputs.is_empty() {
                // Some tools leave the list out.
                outputs.collect()
            } else {
                structure.outputs.iter().map(|&k| &variables[k]).filter(|v| v.kind == "Real").collect()
            },
            by,
        }
    }

    /// The same with other inputs.
    pub fn with_inputs(&self, inputs: &[&'a Variable]) -> Self {
        Plan { inputs: inputs.to_vec(), ..self.clone() }
    }

    /// Slopes with respect to the states.
    pub fn by_states(&self, instance: &Instance) -> Result<Changes, Error> {
        if self.by == Derivatives::Exact {
            let mut changes = self.exact(instance, &self.states)?;
            self.equate_states(&mut changes);
            return Ok(changes);
        }
        let (nominals, states) = (instance.nominals(self.states.len())?, instance.states(self.states.len())?);
        let unbounded = vec![(f64::NEG_INFINITY, f64::INFINITY); states.len()];
        let changes = self.differences(instance, &states, &nominals, &unbounded, |values| instance.set_states(values));
        instance.set_states(&states)?;
        changes
    }

    /// Slopes with respect to the inputs.
    pub fn by_inputs(&self, instance: &Instance) -> Result<Changes, Error> {
        if self.by == Derivatives::Exact {
            return self.exact(instance, &self.inputs);
        }
        let references = references(&self.inputs);
        let mut inputs = vec![0.0; references.len()];
        instance.get_real(&references, &mut inputs)?;
        let nominals = vec![1.0; inputs.len()];
        let bounds: Vec<_> = self.inputs.iter().map(|input| input.bounds()).collect();
        let set = |values: &[f64]| instance.set_real(&references, values);
        let changes = self.differences(instance, &inputs, &nominals, &bounds, set);
        instance.set_real(&references, &inputs)?;
        changes
    }

    fn exact(&self, instance: &Instance, knowns: &[&Variable]) -> Result<Changes, Error> {
        let unknowns = [references(&self.derivatives), references(&self.outputs)].concat();
        let mut changes = self.none(knowns.len());
        for (k, known) in knowns.iter().enumerate() {
            let column = instance.directional_derivative(&unknowns, &[known.reference], &[1.0])?;
            changes.set(k, &column);
        }
        Ok(changes)
    }

    /// Sets the slopes of outputs that are states themselves: some FMUs give none.
    fn equate_states(&self, changes: &mut Changes) {
        for (row, output) in self.outputs.iter().enumerate() {
            if let Some(column) = self.states.iter().position(|state| state.reference == output.reference) {
                changes.outputs.row_mut(row).fill(0.0);
                changes.outputs[(row, column)] = 1.0;
            }
        }
    }

    fn differences(
        &self,
        instance: &Instance,
        values: &[f64],
        nominals: &[f64],
        bounds: &[(f64, f64)],
        set: impl Fn(&[f64]) -> Result<(), Error>,
    ) -> Result<Changes, Error> {
        let mut changes = self.none(values.len());
        let mut moved = values.to_vec();
        for k in 0..values.len() {
            let step = DIFFERENCE * values[k].abs().max(nominals[k].abs());
            let mut at = |value: f64| {
                moved[k] = value;
                set(&moved)?;
                let mut found = instance.state_derivatives(self.derivatives.len())?;
                let mut outputs = vec![0.0; self.outputs.len()];
                instance.get_real(&references(&self.outputs), &mut outputs)?;
                found.extend(outputs);
                Ok::<_, Error>(found)
            };
            // Beyond a bound an FMU refuses a value, or clips it.
            let (least, most) = bounds[k];
            let (above, below) =
                ((values[k] + step).min(most.max(values[k])), (values[k] - step).max(least.min(values[k])));
            let (more, less) = (at(above)?, at(below)?);
            at(values[k])?;
            // What was really set, rounded.
            let moved_by = if above > below { above - below } else { step };
            let column: Vec<f64> = more.iter().zip(&less).map(|(a, b)| (a - b) / moved_by).collect();
            changes.set(k, &column);
        }
        Ok(changes)
    }

    fn none(&self, columns: usize) -> Changes {
        Changes {
            derivatives: DMatrix::zeros(self.derivatives.len(), columns),
            outputs: DMatrix::zeros(self.outputs.len(), columns),
        }
    }
}

impl Changes {
    /// Sets a column: first the derivatives, then the outputs.
    fn set(&mut self, column: usize, values: &[f64]) {
        let (derivatives, outputs) = values.split_at(self.derivatives.nrows());
        self.derivatives.column_mut(column).copy_from_slice(derivatives);
        self.outputs.column_mut(column).copy_from_slice(outputs);
    }
}
