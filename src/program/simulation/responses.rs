//! The linear system that a unit in co-simulation is like, where it gives no derivatives: from what small changes of its
//! inputs do to its states, which it shows at communication points.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::fmu::{Fmu, Instance};
use super::linearise::{OperatingPoint, prepared, simulated};
use super::logarithm::logarithm;
use super::plan::{Plan, references};
use crate::error::Error;
use crate::model_description::Variable;

/// Communication steps for which an input is changed, and for which it is back.
const STEPS: usize = 250;
/// An input is changed by this part of its magnitude, of half its range, or of 1, whichever is largest.
pub(super) const CHANGE: f64 = 1e-2;
/// Singular values of the responses below this part of the largest are rounding.
const RANK: f64 = 1e-9;
/// A signal that contributes less than this part of the largest contribution contributes nothing.
const NOTHING: f64 = 1e-6;
/// Above this misfit, relative to the responses, the linear system is none.
const WORST: f64 = 0.1;

/// How long an experiment takes, s.
pub(super) fn span(instance: &Instance) -> f64 {
    (2 * STEPS + 1) as f64 * instance.step()
}

/// What was found.
#[derive(Debug)]
pub(super) struct Responses {
    pub matrices: [DMatrix<f64>; 4],
    /// The largest difference between the unit's and the linear system's responses, relative to these.
    pub misfit: f64,
    /// Communication step, s.
    pub step: f64,
}

/// An experiment's answers: half the difference between an input that is raised and one that is lowered, by how much.
struct Experiment {
    input: usize,
    /// States at the communication points, and outputs behind them; a column a point.
    states: DMatrix<f64>,
    outputs: DMatrix<f64>,
    size: f64,
}

/// Finds the linear system about the states of a simulation from `start` until `time`.
///
/// # Errors
/// When the unit fails, the inputs don't move all states, or what moves is no linear system of these states.
pub(super) fn find(
    fmu: &Arc<Fmu>,
    plan: &Plan,
    point: &OperatingPoint,
    (start, time): (f64, f64),
) -> Result<Responses, Error> {
    let refuse = |reason: String| Error::Archive { file: fmu.file().to_owned(), reason };
    if plan.states.is_empty() || plan.inputs.is_empty() {
        return Err(refuse("has no states or no inputs: there is nothing to linearise".to_owned()));
    }
    let mut step = 0.0;
    let mut experiments = Vec::new();
    for (input, variable) in plan.inputs.iter().enumerate() {
        let at = || {
            let instance = fmu.instantiate(&fmu.description.name)?;
            simulated(prepared(instance, point, start, time)?, start, time)
        };
        let mut value = [0.0];
        let instance = at()?;
        instance.get_real(&[variable.reference], &mut value)?;
        let size = change_of(variable, value[0]);
        step = instance.step();
        let raised = response(instance, plan, variable, (value[0], size), time)?;
        let lowered = response(at()?, plan, variable, (value[0], -size), time)?;
        let states = (&raised.0 - &lowered.0) * 0.5;
        let outputs = (&raised.1 - &lowered.1) * 0.5;
        experiments.push(Experiment { input, states, outputs, size });
    }
    fitted(plan, &experiments, step).map_err(refuse)
}

/// By how much an input is changed.
fn change_of(variable: &Variable, value: f64) -> f64 {
    let bound = |text: &Option<String>| text.as_ref().and_then(|text| text.parse::<f64>().ok());
    let half = bound(&variable.min).zip(bound(&variable.max)).map(|(min, max)| 0.5 * (max - min));
    CHANGE * half.filter(|half| half.is_finite()).unwrap_or(1.0).max(value.abs())
}

/// States and outputs while an input is changed, and then back.
fn response(
    mut instance: Instance,
    plan: &Plan,
    input: &Variable,
    (value, change): (f64, f64),
    time: f64,
) -> Result<(DMatrix<f64>, DMatrix<f64>), Error> {
    let (step, points) = (instance.step(), 2 * STEPS + 1);
    let mut states = DMatrix::zeros(plan.states.len(), points);
    let mut outputs = DMatrix::zeros(plan.outputs.len(), points);
    let (state_references, output_references) = (references(&plan.states), references(&plan.outputs));
    for k in 0..points {
        instance.get_real(&state_references, states.column_mut(k).as_mut_slice())?;
        instance.get_real(&output_references, outputs.column_mut(k).as_mut_slice())?;
        if k + 1 < points {
            instance.set_real(&[input.reference], &[if k < STEPS { value + change } else { value }])?;
            instance.do_step(time + k as f64 * step, step)?;
        }
    }
    Ok((states, outputs))
}

/// The sampled system by least squares over all experiments, and the continuous one whose sampling it is.
fn fitted(plan: &Plan, experiments: &[Experiment], step: f64) -> Result<Responses, String> {
    let (n, m, p) = (plan.states.len(), plan.inputs.len(), plan.outputs.len());
    let points = 2 * STEPS * experiments.len();
    // One row a communication step: states and inputs at its beginning, states at its end; outputs with what they follow.
    let (mut known, mut next) = (DMatrix::zeros(points, n + m), DMatrix::zeros(points, n));
    let (mut seen, mut outputs) = (DMatrix::zeros(points, n + m), DMatrix::zeros(points, p));
    for (e, experiment) in experiments.iter().enumerate() {
        for k in 0..2 * STEPS {
            let row = e * 2 * STEPS + k;
            known.view_mut((row, 0), (1, n)).copy_from(&experiment.states.column(k).transpose());
            seen.view_mut((row, 0), (1, n)).copy_from(&experiment.states.column(k + 1).transpose());
            next.row_mut(row).copy_from(&experiment.states.column(k + 1).transpose());
            outputs.row_mut(row).copy_from(&experiment.outputs.column(k + 1).transpose());
            let input = if k < STEPS { experiment.size } else { 0.0 };
            known[(row, n + experiment.input)] = input;
            seen[(row, n + experiment.input)] = input;
        }
    }
    for (state, variable) in plan.states.iter().enumerate() {
        if next.column(state).amax() == 0.0 {
            return Err(format!("its inputs don't move `{}`: it can't be linearised from responses", variable.name));
        }
    }
    let sampled = solved(&known, &next)?;
    let misfit = misfit(&sampled, experiments);
    if misfit.is_nan() || misfit > WORST {
        return Err(format!(
            "answers small changes of its inputs otherwise than a linear system whose states are {} (by {:.1} % of the \
             largest answer): name all of its states by --states, or choose another operating point by --at or --set",
            plan.states.iter().map(|state| state.name.as_str()).collect::<Vec<_>>().join(", "),
            100.0 * misfit
        ));
    }
    let mut held = DMatrix::identity(n + m, n + m);
    held.view_mut((0, 0), (n, n + m)).copy_from(&sampled);
    let rates = logarithm(&held)
        .ok_or_else(|| format!("changes too much within its communication step, {step} s, for its rates to be told"))?
        / step;
    let mut shown = solved(&seen, &outputs)?;
    for (row, output) in plan.outputs.iter().enumerate() {
        if let Some(state) = plan.states.iter().position(|state| state.name == output.name) {
            shown.row_mut(row).fill(0.0);
            shown[(row, state)] = 1.0;
        }
    }
    let (rates, shown) = (cleaned(rates, &known), cleaned(shown, &known));
    let part = |matrix: &DMatrix<f64>, column: usize, columns: usize, rows: usize| {
        matrix.view((0, column), (rows, columns)).into_owned()
    };
    let matrices = [part(&rates, 0, n, n), part(&rates, n, m, n), part(&shown, 0, n, p), part(&shown, n, m, p)];
    Ok(Responses { matrices, misfit, step })
}

/// The matrix whose product with each row of `known`, as a column, is the row of `wanted`.
fn solved(known: &DMatrix<f64>, wanted: &DMatrix<f64>) -> Result<DMatrix<f64>, String> {
    // Signals may be of very different sizes.
    let sizes = DVector::from_fn(known.ncols(), |column, _| known.column(column).amax().max(f64::MIN_POSITIVE));
    let scaled = DMatrix::from_fn(known.nrows(), known.ncols(), |i, j| known[(i, j)] / sizes[j]);
    let singular = scaled.svd(true, true);
    let smallest = RANK * singular.singular_values.max();
    let (rank, count) = (singular.rank(smallest), known.ncols());
    if rank < count {
        return Err(format!(
            "shows in its answers to small changes of its inputs only {rank} of {count} independent signals (states and \
             inputs): states that depend on each other, or that no input moves, are to be left out by --states"
        ));
    }
    let solution = singular.solve(wanted, smallest)?;
    Ok(DMatrix::from_fn(wanted.ncols(), count, |i, j| solution[(j, i)] / sizes[j]))
}

/// A matrix without the entries that contribute nothing but rounding to their rows.
fn cleaned(mut matrix: DMatrix<f64>, known: &DMatrix<f64>) -> DMatrix<f64> {
    let size = |column: usize| known.column(column).amax();
    for mut row in matrix.row_iter_mut() {
        let largest = row.iter().enumerate().map(|(column, entry)| entry.abs() * size(column)).fold(0.0, f64::max);
        for (column, entry) in row.iter_mut().enumerate() {
            if entry.abs() * size(column) < NOTHING * largest {
                *entry = 0.0;
            }
        }
    }
    matrix
}

/// How far the sampled system's own responses are from the experiments', relative to the largest of each state.
fn misfit(sampled: &DMatrix<f64>, experiments: &[Experiment]) -> f64 {
    let n = sampled.nrows();
    let mut worst: f64 = 0.0;
    for state in 0..n {
        let largest = experiments.iter().map(|e| e.states.row(state).amax()).fold(0.0, f64::max);
        for experiment in experiments {
            let mut x = experiment.states.column(0).into_owned();
            for k in 0..2 * STEPS {
                let input = if k < STEPS { experiment.size } else { 0.0 };
                x = sampled.columns(0, n) * x + sampled.column(n + experiment.input) * input;
                let difference = (x[state] - experiment.states[(state, k + 1)]).abs() / largest;
                // A number that is none is the worst of all.
                worst = if difference > worst || difference.is_nan() { difference } else { worst };
            }
        }
    }
    worst
}
