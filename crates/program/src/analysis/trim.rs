//! Search for an operating point of an FMU: states and free inputs at which derivatives are zero and variables have
//! their wanted values.

mod remaining;

use std::cmp::Ordering;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::aim::Aim;
use super::newton::{End, Equations, Unknown, solve};
use super::operating_point::OperatingPoint;
use super::plan::{Changes, Plan, references};
use crate::error::Error;
use crate::fmu::Instance;
use crate::model_description::Variable;

/// Largest change of an angle in a Newton step, rad: beyond it, linear equations are too inaccurate.
const LONGEST_TURN: f64 = 0.5;
/// Base units of an angle.
const ANGLE: [i32; 8] = [0, 0, 0, 0, 0, 0, 0, 1];

/// The result of a search for an operating point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trim {
    /// Inputs that were free.
    pub free: Vec<String>,
    /// Wanted variables, with their wanted values.
    pub wanted: Vec<Wanted>,
    /// States that had to keep their values.
    pub held: Vec<String>,
    /// Number of equations: one for each state, and for each wanted variable that is not a derivative.
    pub equations: usize,
    /// Number of unknowns: other states, and free inputs.
    pub unknowns: usize,
    /// Rank of the equations' Jacobian at the operating point, by the unknowns.
    pub rank: usize,
    /// Number of Newton steps.
    pub steps: usize,
    /// Number of new starts near the start values.
    pub new_starts: usize,
    /// Unknowns that can change without a change of the equations. If there are any, this operating point is one of
    /// many.
    pub can_move: Vec<String>,
    /// Free inputs that are at a bound.
    pub at_bound: Vec<AtBound>,
    /// True if all derivatives are zero.
    pub is_steady: bool,
}

/// A wanted variable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Wanted {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: Option<String>,
}

/// An input at its smallest or largest value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtBound {
    /// Name.
    pub name: String,
    /// Value of the bound.
    pub value: f64,
    /// Unit.
    pub unit: Option<String>,
    /// True if it is the largest value, false for the smallest.
    pub is_largest: bool,
}

impl Trim {
    /// True if there is no other operating point nearby.
    pub fn is_unique(&self) -> bool {
        self.rank == self.unknowns
    }
}

/// Moves an instance for model exchange, just initialised, to an operating point.
///
/// If several points solve the equations, one near the start values is found: each step is the shortest one that solves
/// the linear equations.
///
/// # Errors
/// When there is none near the start values, with the residuals that remain.
pub(super) fn find(instance: &Instance, plan: &Plan, point: &OperatingPoint, time: f64) -> Result<Trim, Error> {
    instance.finish_event()?;
    let description = instance.description();
    let aim = Aim::new(instance, plan, point, &description.variables)?;
    let mut bound = Bound::new(instance, &aim)?;
    let (unknowns, start) = (bound.unknowns(), bound.present()?);
    let end = solve(&mut bound, &unknowns, &start)?;
    if !end.is_solution {
        let function =
            if point.is_plain() { "the search for a steady state" } else { "the search for an operating point" };
        let message = remaining::message(&mut bound, plan, point, &end)?;
        return Err(Error::Unit { unit: instance.name().to_owned(), function, time, message });
    }
    Ok(found(&aim, &end))
}

fn found(aim: &Aim, end: &End) -> Trim {
    let names = |variables: &[&Variable]| variables.iter().map(|variable| variable.name.clone()).collect();
    let unknowns = aim.unknowns();
    let can_move: Vec<_> = unknowns.iter().zip(&end.can_move).filter(|(_, moves)| **moves).map(|(v, _)| *v).collect();
    let held: Vec<_> = aim.plan.states.iter().zip(&aim.is_fixed).filter(|(_, held)| **held).map(|(v, _)| *v).collect();
    Trim {
        free: names(&aim.plan.inputs),
        wanted: aim.wanted.iter().map(|&(variable, value)| wanted(variable, value)).collect(),
        held: names(&held),
        equations: aim.targets.len(),
        unknowns: unknowns.len(),
        rank: end.rank,
        steps: end.steps,
        new_starts: end.new_starts,
        can_move: names(&can_move),
        at_bound: at_bound(&unknowns, end),
        is_steady: aim.targets[..aim.plan.states.len()].iter().all(|target| *target == 0.0),
    }
}

fn wanted(variable: &Variable, value: f64) -> Wanted {
    Wanted { name: variable.name.clone(), value, unit: variable.unit.clone() }
}

fn at_bound(unknowns: &[&Variable], end: &End) -> Vec<AtBound> {
    let ends = unknowns.iter().zip(&end.at_bound).zip(&end.unknowns);
    let shown = |((variable, side), value): ((&&Variable, &Option<Ordering>), &f64)| {
        let (name, unit) = (variable.name.clone(), variable.unit.clone());
        side.map(|side| AtBound { name, value: *value, unit, is_largest: side == Ordering::Greater })
    };
    ends.filter_map(shown).collect()
}

/// The equations of an instance.
struct Bound<'a, 'b> {
    instance: &'a Instance,
    aim: &'a Aim<'b>,
    /// Places of the states that may move.
    moving: Vec<usize>,
    /// All states, including those that keep their values.
    states: Vec<f64>,
}

impl<'a, 'b> Bound<'a, 'b> {
    fn new(instance: &'a Instance, aim: &'a Aim<'b>) -> Result<Self, Error> {
        let states = if aim.is_fixed.is_empty() { Vec::new() } else { instance.states(aim.is_fixed.len())? };
        Ok(Bound { instance, aim, moving: aim.moving(), states })
    }

    fn unknowns(&self) -> Vec<Unknown> {
        let no_bounds = (f64::NEG_INFINITY, f64::INFINITY);
        let state = |&place: &usize| {
            let measure = self.aim.plan.states[place].measure.as_deref();
            let angle = measure.filter(|measure| measure.dimension == Some(ANGLE));
            let longest = angle.map_or(f64::INFINITY, |angle| LONGEST_TURN / angle.factor.abs());
            Unknown { usual: 1.0, longest, bounds: no_bounds, starts_anew: true }
        };
        let input = |input: &&Variable| {
            let usual = input.nominal.unwrap_or(1.0);
            Unknown { usual, longest: f64::INFINITY, bounds: input.bounds(), starts_anew: false }
        };
        self.moving.iter().map(state).chain(self.aim.plan.inputs.iter().map(input)).collect()
    }

    /// The unknowns as they are.
    fn present(&self) -> Result<DVector<f64>, Error> {
        let inputs = self.values(&self.aim.plan.inputs)?;
        let states = self.moving.iter().map(|&place| self.states[place]);
        Ok(DVector::from_iterator(self.moving.len() + inputs.len(), states.chain(inputs)))
    }

    fn values(&self, variables: &[&Variable]) -> Result<Vec<f64>, Error> {
        let mut values = vec![0.0; variables.len()];
        if !values.is_empty() {
            self.instance.get_real(&references(variables), &mut values)?;
        }
        Ok(values)
    }

    /// Sets the unknowns. This may cause events, which may even set the states anew.
    fn set(&mut self, unknowns: &DVector<f64>) -> Result<(), Error> {
        let (states, inputs) = unknowns.as_slice().split_at(self.moving.len());
        if !inputs.is_empty() {
            self.instance.set_real(&references(&self.aim.plan.inputs), inputs)?;
        }
        self.moving.iter().zip(states).for_each(|(&place, state)| self.states[place] = *state);
        if !self.states.is_empty() {
            self.instance.set_states(&self.states)?;
        }
        self.instance.begin_event()?;
        self.instance.finish_event()?;
        if !self.states.is_empty() {
            self.states = self.instance.states(self.states.len())?;
        }
        Ok(())
    }

    /// Derivatives of all equations by some inputs.
    fn by_inputs(&self, inputs: &[&'b Variable]) -> Result<DMatrix<f64>, Error> {
        self.all(inputs.len(), |plan| plan.with_inputs(inputs).by_inputs(self.instance))
    }

    /// Derivatives of all equations by the states that may move.
    fn by_states(&self) -> Result<DMatrix<f64>, Error> {
        if self.moving.is_empty() {
            return Ok(DMatrix::zeros(self.aim.targets.len(), 0));
        }
        let by_all = self.all(self.states.len(), |plan| plan.by_states(self.instance))?;
        Ok(by_all.select_columns(&self.moving))
    }

    /// Rows of all equations, from both plans.
    fn all(&self, columns: usize, of: impl Fn(&Plan<'b>) -> Result<Changes, Error>) -> Result<DMatrix<f64>, Error> {
        let Changes { derivatives, outputs } = of(&self.aim.plan)?;
        let mut parts = vec![derivatives, outputs];
        if !self.aim.others.outputs.is_empty() {
            parts.push(of(&self.aim.others)?.outputs);
        }
        let rows: Vec<_> = parts.iter().flat_map(|part| part.row_iter()).collect();
        Ok(DMatrix::from_fn(rows.len(), columns, |row, column| rows[row][column]))
    }
}

impl Equations for Bound<'_, '_> {
    type Error = Error;

    fn residuals(&mut self, unknowns: &mut DVector<f64>) -> Result<DVector<f64>, Error> {
        self.set(unknowns)?;
        for (k, &place) in self.moving.iter().enumerate() {
            unknowns[k] = self.states[place];
        }
        let count = self.states.len();
        let mut found = if count == 0 { Vec::new() } else { self.instance.state_derivatives(count)? };
        found.extend(self.values(&self.aim.shown().collect::<Vec<_>>())?);
        Ok(DVector::from_vec(found) - DVector::from_column_slice(&self.aim.targets))
    }

    fn jacobian(&mut self) -> Result<DMatrix<f64>, Error> {
        let (by_states, by_inputs) = (self.by_states()?, self.by_inputs(&self.aim.plan.inputs)?);
        let columns: Vec<_> = by_states.column_iter().chain(by_inputs.column_iter()).collect();
        Ok(DMatrix::from_fn(self.aim.targets.len(), columns.len(), |row, column| columns[column][row]))
    }

    fn may_go_on(&self, _: &Error) -> bool {
        self.instance.may_try_again()
    }
}
