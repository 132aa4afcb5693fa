//! Message if no operating point was found: remaining residuals, and possible changes.

use nalgebra::{DMatrix, DVector};

use super::super::newton::End;
use super::super::operating_point::OperatingPoint;
use super::super::plan::Plan;
use super::{AtBound, Bound, at_bound};
use crate::error::Error;
use crate::model_description::Variable;
use crate::report::number;

/// The most residuals that a message lists.
const MOST: usize = 3;
/// Relative residual above which an equation is not solved, and the same relative to the largest residual.
const REMAINS: f64 = 1e-10;
const PART_OF_LARGEST: f64 = 1e-4;
/// Cosine between the residuals and the effects of an input above which the input lessens them.
const NO_EFFECT: f64 = 1e-3;

/// The message about the end of a search.
///
/// # Errors
/// When the FMU refuses to return to that point.
pub(super) fn message(bound: &mut Bound, plan: &Plan, point: &OperatingPoint, end: &End) -> Result<String, Error> {
    bound.set(&end.unknowns)?;
    let others: Vec<_> = plan.inputs.iter().filter(|input| !point.free.contains(&input.name)).copied().collect();
    let by_others = bound.by_inputs(&others)?;
    let rows = remaining(bound, end);
    let residuals: Vec<_> = rows.iter().take(MOST).map(|&row| residual(bound, end, row)).collect();
    let more = rows.len().saturating_sub(residuals.len());
    let more = if more > 0 { format!(" and {more} more residuals") } else { String::new() };
    let is = if rows.len() > 1 { "remain" } else { "remains" };
    let parts = [
        format!("{}, {}{more} {is}{}", searched(point, end), residuals.join(", "), rank(point, bound, end)),
        without_effect(bound, end),
        at_bounds(bound, end),
        proposed(&others, &by_others, end),
    ];
    Ok(parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(". "))
}

/// The unsolved equations, the worst first; a nonzero worst derivative is among the first.
fn remaining(bound: &Bound, end: &End) -> Vec<usize> {
    let relative = |row: usize| end.relative[row].abs();
    let least = REMAINS.max(PART_OF_LARGEST * end.relative.amax());
    let mut rows: Vec<_> =
        (0..end.residuals.len()).filter(|&row| relative(row).is_nan() || relative(row) > least).collect();
    rows.sort_by(|&one, &other| relative(other).total_cmp(&relative(one)));
    let derivative = rows.iter().position(|&row| row < bound.states.len());
    if let Some(place) = derivative.filter(|&place| place >= MOST) {
        let row = rows.remove(place);
        rows.insert(MOST - 1, row);
    }
    rows
}

fn searched(point: &OperatingPoint, end: &End) -> String {
    let what = if point.is_plain() { "steady state" } else { "operating point" };
    let starts = match end.new_starts {
        0 => String::new(),
        count => format!(", nor from {count} others near them"),
    };
    format!("no {what} was found from the start values{starts}. After {} Newton steps", end.steps)
}

/// A variable, its value and its wanted value.
fn residual(bound: &Bound, end: &End, row: usize) -> String {
    let (variable, target) = (bound.aim.equations()[row], bound.aim.targets[row]);
    let unit = variable.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    let value = format!("{} = {}{unit}", variable.name, number(end.residuals[row] + target));
    let is_plain = target == 0.0 && row < bound.states.len();
    if is_plain { value } else { format!("{value} instead of {}{unit}", number(target)) }
}

fn rank(point: &OperatingPoint, bound: &Bound, end: &End) -> String {
    let (equations, unknowns, rank) = (bound.aim.targets.len(), end.unknowns.len(), end.rank);
    match () {
        () if rank == unknowns && rank == equations => String::new(),
        () if point.is_plain() => format!("; A is singular there (rank {rank} of {unknowns})"),
        () => format!("; there, {equations} equations in {unknowns} unknowns have rank {rank}"),
    }
}

/// Free inputs that change no equation.
fn without_effect(bound: &Bound, end: &End) -> String {
    let first = bound.moving.len();
    let has_none = |k: &usize| end.jacobian.column(first + k).iter().all(|entry| *entry == 0.0);
    let inputs = bound.aim.plan.inputs.iter();
    let none: Vec<_> = inputs.enumerate().filter(|(k, _)| has_none(k)).map(|(_, input)| input.name.as_str()).collect();
    let Some(one) = none.first() else { return String::new() };
    let (has, its) = if none.len() > 1 { ("have", "their") } else { ("has", "its") };
    format!(
        "{} {has} no effect there, as beyond a limit inside the FMU. Start within {its} limits: --set {one}=VALUE",
        none.join(", ")
    )
}

fn at_bounds(bound: &Bound, end: &End) -> String {
    let shown = |AtBound { name, value, unit, is_largest }: AtBound| {
        let unit = unit.map_or(String::new(), |unit| format!(" {unit}"));
        let which = if is_largest { "largest" } else { "smallest" };
        format!("{name} is at its {which} value, {}{unit}", number(value))
    };
    at_bound(&bound.aim.unknowns(), end).into_iter().map(shown).collect::<Vec<_>>().join(", ")
}

/// Inputs whose change would lessen the residuals.
fn proposed(others: &[&Variable], by_others: &DMatrix<f64>, end: &End) -> String {
    let scale =
        |row: usize| if end.relative[row] == 0.0 { 1.0 } else { (end.residuals[row] / end.relative[row]).abs() };
    let lessens = |column: usize| {
        let usual = others[column].nominal.unwrap_or(1.0);
        let effect = DVector::from_fn(end.relative.len(), |row, _| by_others[(row, column)] * usual / scale(row));
        effect.dot(&end.relative).abs() > NO_EFFECT * effect.norm() * end.relative.norm()
    };
    let options: Vec<_> = (0..others.len()).filter(|&column| lessens(column)).collect();
    let options: Vec<_> = options.iter().map(|&column| format!("--free {}", others[column].name)).take(MOST).collect();
    match options.len() {
        0 => String::new(),
        1 => format!("An input that would help if it were free: {}", options[0]),
        _ => format!("Inputs that would help if they were free: {}", options.join(" ")),
    }
}
