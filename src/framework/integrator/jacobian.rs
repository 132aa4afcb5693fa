//! Exact derivatives of the state equation, by dual numbers: several directions a pass, and several columns a direction
//! where no two of them move the same rate.

use std::sync::Arc;

use super::Problem;
use super::sparsity::Sparsity;
use crate::system::{Compiled, DIRECTIONS, Dual, Section, Variables, Wide};

/// Up to so many directions are taken one by one: a pass over wide numbers costs as much.
const FEW: usize = 3;

/// The derivatives of f(t, x) where a substep begins, and storage for them.
#[derive(Debug)]
pub struct Jacobian {
    sparsity: Arc<Sparsity>,
    block: Block,
    /// What is there of ∂f/∂x, as a kernel writes it.
    entries: Vec<f64>,
    /// Whether these are those of the last evaluation.
    by_kernel: bool,
    /// ∂f/∂x, by columns; as the block, empty until it is needed, in memory that is there from the begin.
    by_states: Vec<f64>,
    /// ∂f/∂t, with the change of the inputs in it.
    by_time: Vec<f64>,
}

/// The whole block over dual numbers.
#[derive(Debug)]
enum Block {
    Narrow(Vec<Dual>),
    Wide(Vec<Wide>),
}

impl Jacobian {
    /// Storage for a system.
    pub fn new(variables: &Variables, sparsity: &Arc<Sparsity>) -> Self {
        let (n, size) = (variables.states(), variables.reals(Section::Derivative).end);
        let few = sparsity.groups().len() < FEW;
        let block = if few { Block::Narrow(Vec::with_capacity(size)) } else { Block::Wide(Vec::with_capacity(size)) };
        let (entries, by_states) = (vec![0.0; sparsity.entries()], Vec::with_capacity(n * n));
        Jacobian { sparsity: Arc::clone(sparsity), block, entries, by_kernel: false, by_states, by_time: vec![0.0; n] }
    }

    /// ∂f/∂x, by columns.
    pub fn by_states(&self) -> &[f64] {
        &self.by_states
    }

    /// ∂f/∂t along the inputs.
    pub fn by_time(&self) -> &[f64] {
        &self.by_time
    }

    /// What is there of ∂f/∂x, column by column, where a kernel evaluated it.
    pub fn entries(&self) -> Option<&[f64]> {
        self.by_kernel.then_some(&self.entries)
    }

    /// Evaluates both where the problem stands.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number.
    pub fn evaluate(&mut self, problem: &Problem, t: f64) -> Result<(), usize> {
        let n = self.by_time.len();
        self.by_states.resize(n * n, 0.0);
        self.by_kernel = self.evaluate_by_kernel(problem, t);
        if !self.by_kernel {
            let (sparsity, results) = (&self.sparsity, (&mut self.by_states[..], &mut self.by_time[..]));
            match &mut self.block {
                Block::Narrow(block) => evaluate::<1>(block, sparsity, problem, t, results),
                Block::Wide(block) => evaluate::<DIRECTIONS>(block, sparsity, problem, t, results),
            }
        }
        let broken = self.by_states.iter().chain(&self.by_time).position(|derivative| !derivative.is_finite());
        broken.map_or(Ok(()), |place| Err(place % self.by_time.len()))
    }

    /// Evaluates both by compiled equations, where there are any; whether it did.
    fn evaluate_by_kernel(&mut self, problem: &Problem, t: f64) -> bool {
        let Some(kernel) = problem.kernel else { return false };
        let slopes = (!problem.held).then_some(problem.ramp.slopes);
        let block = (&*problem.reals, &*problem.integers);
        if !kernel.jacobian(t, block, slopes, &mut self.entries, &mut self.by_time) {
            return false;
        }
        let (n, mut entries) = (self.by_time.len(), self.entries.iter());
        for (column, rows) in self.sparsity.columns().iter().enumerate() {
            for (&row, entry) in rows.iter().zip(&mut entries) {
                self.by_states[column * n + row as usize] = *entry;
            }
        }
        true
    }

    /// How large ∂f/∂x is, with states in units of their nominal values: its largest sum of a row, 1/s.
    pub fn size(&self, nominals: &[f64]) -> f64 {
        let n = nominals.len();
        let row = |i: usize| {
            let entries = self.by_states[i..].iter().step_by(n).zip(nominals);
            entries.map(|(a, nominal)| a.abs() * nominal).sum::<f64>() / nominals[i]
        };
        (0..n).map(row).fold(0.0, f64::max)
    }
}

/// All passes: the last direction is that of time, the others are the groups of columns.
fn evaluate<const N: usize>(
    block: &mut Vec<Dual<N>>,
    sparsity: &Sparsity,
    problem: &Problem,
    t: f64,
    (by_states, by_time): (&mut [f64], &mut [f64]),
) where
    Dual<N>: Compiled<Integer = i32>,
{
    let variables = problem.variables;
    let (states, rates) = (variables.reals(Section::State), variables.reals(Section::Derivative));
    block.clear();
    block.extend(problem.reals[..rates.end].iter().map(|&value| Dual::from(value)));
    let (n, groups, equations) = (states.len(), sparsity.groups(), Dual::<N>::equations(problem.system));
    let mut first = 0;
    while first <= groups.len() {
        let directions = first..(first + N).min(groups.len() + 1);
        let of_time = directions.contains(&groups.len());
        let columns = |k: usize| groups.get(k).into_iter().flatten().map(|&column| column as usize);
        let mut time = Dual::from(t);
        for (place, k) in directions.clone().enumerate() {
            columns(k).for_each(|column| block[states.start + column].derivatives[place] = 1.0);
        }
        if of_time {
            let place = groups.len() - first;
            time.derivatives[place] = 1.0;
            if !problem.held {
                let inputs = &mut block[variables.reals(Section::Input)];
                inputs.iter_mut().zip(problem.ramp.slopes).for_each(|(input, &slope)| input.derivatives[place] = slope);
            }
        }
        equations.evaluate(time, block, problem.integers, variables.offsets());
        for (place, k) in directions.clone().enumerate() {
            for column in columns(k) {
                for &row in &sparsity.columns()[column] {
                    by_states[column * n + row as usize] = block[rates.start + row as usize].derivatives[place];
                }
                block[states.start + column].derivatives[place] = 0.0;
            }
        }
        if of_time {
            let place = groups.len() - first;
            by_time.iter_mut().zip(&block[rates.clone()]).for_each(|(change, rate)| *change = rate.derivatives[place]);
        }
        first += N;
    }
}
