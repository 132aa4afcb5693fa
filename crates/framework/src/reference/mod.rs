//! A reference experiment of a model: stimuli of its inputs, and what its outputs are then, by an integration of its equations that
//! no FMU integrates itself by. Whoever imports the FMU can compare what it does with that.

mod extrapolation;
mod stimuli;
mod trajectory;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::execution::Execution;
use crate::model::Model;
use stimuli::{Plan, rounded, set_inputs, set_start};
use trajectory::{Accuracy, Missing, Trajectory, trajectory};

/// Bound on the error of each step of the integration, relative to a state or its magnitude.
const TOLERANCE: f64 = 1e-11;
/// Deviation that each experiment allows, relative to an output's largest value.
const ALLOWED: f64 = 1e-4;
/// The change of the start by which an experiment's own sensitivity is found, and how many such changes are allowed to show.
const CHANGE: f64 = 1e-6;
const PER_CHANGE: f64 = 10.0;
/// Largest deviation that an experiment may allow: one that is more sensitive shows nothing.
const MOST_ALLOWED: f64 = 0.1;
/// Work that an integration may take at an export, in elementary operations by the integrator's estimate: about 0.2 s.
pub const EXPORT_WORK: f64 = 2e7;
/// Digits of results: far more than any tolerance needs.
const DIGITS: usize = 12;
/// Communication steps in parts of the model's own, and sizes of stimuli in parts of their inputs' magnitudes, as they are tried. The sizes
/// and their halves are no multiples of half a step of a quantised value in decimals, where rounding would decide.
const PARTS: [f64; 5] = [1.0, 0.25, 0.05, 0.01, 0.002];
const AMPLITUDES: [f64; 2] = [0.09368, 0.009368];
/// The fewest rows.
const FEWEST: usize = 5;
/// A row is left out if an event is as near as this part of a communication step: a tool may find the event on its other side.
const NEAR: f64 = 0.75;

/// Numbers over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Names of the columns behind that of the time.
    pub names: Vec<String>,
    /// Rows: the time, s, and the values. Two of the same time are a jump.
    pub rows: Vec<Vec<f64>>,
}

/// An experiment with its results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceExperiment {
    /// Stop time, s; the start is at 0.
    pub stop: f64,
    /// Communication step, s.
    pub step: f64,
    /// Deviation that is allowed, relative to an output's largest value.
    pub tolerance: f64,
    /// Parameters that it sets: items of choices, by names.
    pub chosen: Vec<(String, String)>,
    /// Values of the inputs; none where the model has no inputs.
    pub stimuli: Option<Table>,
    /// Values of the outputs.
    pub references: Table,
}

impl ReferenceExperiment {
    /// Creates that of a model: the longest of several that can be integrated with this work each, and if possible one in which the FMU
    /// warns of nothing.
    ///
    /// # Errors
    /// The reason why there is none.
    pub fn of(model: &Arc<Model>, work: f64) -> Result<Self, String> {
        let (mut reason, mut loud, mut reached) = (String::new(), None, f64::INFINITY);
        for part in PARTS {
            for amplitude in AMPLITUDES {
                let plan = Plan::of(model, amplitude, part);
                if plan.time(plan.steps) > reached {
                    break;
                }
                match Self::along(model, &plan, work) {
                    Ok((experiment, true)) => return Ok(experiment),
                    Ok((experiment, false)) => _ = loud.get_or_insert(experiment),
                    Err(missing) => {
                        reason = missing.reason;
                        reached = missing.reached.unwrap_or(reached);
                    }
                }
            }
            // A shorter one would warn of the same.
            if let Some(experiment) = loud {
                return Ok(experiment);
            }
        }
        Err(reason)
    }

    /// The experiment of a plan, and whether the FMU warns of nothing in it.
    fn along(model: &Arc<Model>, plan: &Plan, work: f64) -> Result<(Self, bool), Missing> {
        if plan.outputs.is_empty() {
            return Err("it has no output that is a continuous number".to_owned().into());
        }
        let exact = trajectory(model, plan, Accuracy { tolerance: TOLERANCE, change: 0.0, work })?;
        let (own, is_quiet) = own(model, plan)?;
        let changed = Accuracy { tolerance: 0.1 * CHANGE, change: CHANGE, work };
        let rows = clear(plan, &exact);
        if rows.len() < FEWEST {
            return Err("its outputs jump too often".to_owned().into());
        }
        let of_rows = |all: &[Vec<f64>]| rows.iter().map(|row| all[*row].clone()).collect::<Vec<_>>();
        let references = of_rows(&exact.rows);
        let (sensitivity, _) = deviation(&of_rows(&trajectory(model, plan, changed)?.rows), &references);
        let tolerance = rounded_up((PER_CHANGE * sensitivity).max(ALLOWED));
        if tolerance.is_nan() || tolerance > MOST_ALLOWED {
            let times = rounded(sensitivity / CHANGE, 1);
            return Err(format!("its results change by {times:e} times what its start is changed by").into());
        }
        let (off, (row, column)) = deviation(&of_rows(&own), &references);
        if off.is_nan() || off > tolerance {
            let (output, time) = (&plan.outputs[column].name, plan.time(plan.rows[rows[row]]));
            let (off, more) = (rounded(off, 2), format!("more than the {tolerance:e} that its sensitivity explains"));
            return Err(format!("its own `{output}` deviates by {off:e} from them at {time} s, {more}").into());
        }
        let with_time = |row: &usize| {
            let time = std::iter::once(plan.time(plan.rows[*row]));
            time.chain(exact.rows[*row].iter().copied()).map(|value| rounded(value, DIGITS)).collect()
        };
        let names = plan.outputs.iter().map(|output| output.name.clone()).collect();
        let references = Table { names, rows: rows.iter().map(with_time).collect() };
        let stimuli = (!plan.stimuli.is_empty()).then(|| given(plan));
        let chosen = plan.chosen.iter().map(|chosen| (chosen.parameter.name.clone(), chosen.item.clone())).collect();
        let (stop, step) = (plan.time(plan.steps), plan.step);
        Ok((ReferenceExperiment { stop, step, tolerance, chosen, stimuli, references }, is_quiet))
    }
}

/// The outputs at the rows as the FMU integrates itself in co-simulation, and whether it warns of nothing.
fn own(model: &Arc<Model>, plan: &Plan) -> Result<(Vec<Vec<f64>>, bool), String> {
    let mut execution = Execution::new(Arc::clone(model));
    let mut rows = Vec::with_capacity(plan.rows.len());
    set_start(&mut execution, plan);
    execution.initialise().map_err(|error| error.to_string())?;
    for point in 0..=plan.steps {
        if plan.rows.contains(&point) {
            let reals = &execution.block().reals;
            rows.push(plan.outputs.iter().map(|output| reals[output.place]).collect());
        }
        if plan.changes.contains_key(&point) {
            set_inputs(&mut execution, plan, point);
        }
        if point < plan.steps {
            execution.step(plan.time(point), plan.step).map_err(|error| error.to_string())?;
        }
    }
    Ok((rows, execution.log.is_empty()))
}

/// The rows that no event is near.
fn clear(plan: &Plan, exact: &Trajectory) -> Vec<usize> {
    let is_clear = |row: &usize| {
        let time = plan.time(plan.rows[*row]);
        exact.events.iter().all(|event| (event - time).abs() > NEAR * plan.step)
    };
    (0..plan.rows.len()).filter(is_clear).collect()
}

/// The largest deviation of some rows from others, relative to the largest value of its column; its row and column.
fn deviation(rows: &[Vec<f64>], exact: &[Vec<f64>]) -> (f64, (usize, usize)) {
    let mut worst = (0.0, (0, 0));
    for column in 0..exact.first().map_or(0, Vec::len) {
        let largest = exact.iter().map(|row| row[column].abs()).fold(0.0, f64::max);
        for (place, (row, exact)) in rows.iter().zip(exact).enumerate() {
            let off = (row[column] - exact[column]).abs();
            let off = if off == 0.0 { 0.0 } else { off / largest };
            if off.is_nan() {
                return (off, (place, column));
            }
            if off > worst.0 {
                worst = (off, (place, column));
            }
        }
    }
    worst
}

/// The number of one digit that isn't below another.
fn rounded_up(value: f64) -> f64 {
    let digit = rounded(value, 1);
    if digit >= value * (1.0 - 1e-9) { digit } else { rounded(digit + 10_f64.powf(value.log10().floor()), 1) }
}

/// The stimuli as a table that is piecewise constant.
fn given(plan: &Plan) -> Table {
    let row = |point: usize, before: bool| {
        let values = plan.stimuli.iter().map(|stimulus| stimulus.at(point, before));
        std::iter::once(plan.time(point)).chain(values).map(|value| rounded(value, DIGITS)).collect::<Vec<f64>>()
    };
    let mut rows = vec![row(0, false)];
    plan.changes.keys().for_each(|point| rows.extend([row(*point, true), row(*point, false)]));
    rows.push(row(plan.steps, false));
    Table { names: plan.stimuli.iter().map(|stimulus| stimulus.input.name.clone()).collect(), rows }
}
