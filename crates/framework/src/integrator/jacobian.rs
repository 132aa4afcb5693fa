//! Exact derivatives of the state equation, from its recording.

use std::sync::Arc;

use super::Problem;
use super::sparsity::Sparsity;
use crate::kernel::Kernel;
use crate::recording::{Leaf, Registers};
use crate::system::Variables;

/// The derivatives of f(t, x) where a substep begins, and storage for them.
#[derive(Debug)]
pub struct Jacobian {
    sparsity: Arc<Sparsity>,
    registers: Registers,
    /// Nonzero entries of ∂f/∂x, column by column.
    entries: Vec<f64>,
    /// ∂f/∂x, by columns; empty until it is needed, in memory that is there from the begin.
    by_states: Vec<f64>,
    /// ∂f/∂t, with the change of the inputs in it.
    by_time: Vec<f64>,
    /// Sums of rows.
    sums: Vec<f64>,
}

impl Jacobian {
    /// Storage for a system.
    pub fn new(variables: &Variables, sparsity: &Arc<Sparsity>) -> Self {
        let n = variables.states();
        Jacobian {
            sparsity: Arc::clone(sparsity),
            registers: Registers::new(),
            entries: vec![0.0; sparsity.entries()],
            by_states: Vec::with_capacity(n * n),
            by_time: vec![0.0; n],
            sums: vec![0.0; n],
        }
    }

    /// Records what computes it, unless that was done, and takes the memory that it needs: a step takes none.
    pub fn prepare(&mut self, problem: &Problem) {
        let registers = self.sparsity.differentiator(problem.system, problem.variables).registers();
        self.registers.reserve(registers.saturating_sub(self.registers.len()));
    }

    /// ∂f/∂x, by columns.
    pub fn by_states(&self) -> &[f64] {
        &self.by_states
    }

    /// ∂f/∂t along the inputs.
    pub fn by_time(&self) -> &[f64] {
        &self.by_time
    }

    /// Nonzero entries of ∂f/∂x, column by column.
    pub fn entries(&self) -> &[f64] {
        &self.entries
    }

    /// Evaluates both at the problem's present point.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number.
    pub fn evaluate(&mut self, problem: &Problem, t: f64) -> Result<(), usize> {
        let n = self.by_time.len();
        self.by_states.resize(n * n, 0.0);
        if !self.evaluate_by_kernel(problem, t) {
            self.evaluate_by_recording(problem, t);
        }
        for (place, entry) in self.sparsity.places().zip(&self.entries) {
            self.by_states[place.column * n + place.row] = *entry;
        }
        let rows = self.sparsity.places().map(|place| place.row).chain(0..n);
        let broken = self.entries.iter().chain(&self.by_time).zip(rows).find(|(derivative, _)| !derivative.is_finite());
        broken.map_or(Ok(()), |(_, row)| Err(row))
    }

    /// Evaluates both by compiled equations. Returns false if there are none.
    fn evaluate_by_kernel(&mut self, problem: &Problem, t: f64) -> bool {
        let slopes = (!problem.constant_inputs).then_some(problem.ramp.slopes);
        let block = (&*problem.reals, &*problem.integers);
        let by = |kernel: &Kernel| kernel.jacobian(t, block, slopes, &mut self.entries, &mut self.by_time);
        problem.kernel.is_some_and(by)
    }

    fn evaluate_by_recording(&mut self, problem: &Problem, t: f64) {
        let leaf = |leaf: Leaf| match leaf {
            Leaf::Time => t,
            Leaf::Real(place) => problem.reals[place as usize],
            Leaf::Integer(place) => f64::from(problem.integers[place as usize]),
            Leaf::Slope(input) if !problem.constant_inputs => problem.ramp.slopes[input as usize],
            _ => 0.0,
        };
        let differentiator = self.sparsity.differentiator(problem.system, problem.variables);
        let results = (&mut self.entries[..], &mut self.by_time[..]);
        differentiator.carry_out(self.sparsity.columns(), leaf, &mut self.registers, results);
    }

    /// Size of ∂f/∂x, with states in units of their nominal values: its largest sum of a row, 1/s.
    pub fn size(&mut self, nominals: &[f64]) -> f64 {
        self.sums.fill(0.0);
        for (place, entry) in self.sparsity.places().zip(&self.entries) {
            self.sums[place.row] += entry.abs() * nominals[place.column];
        }
        self.sums.iter().zip(nominals).map(|(sum, nominal)| sum / nominal).fold(0.0, f64::max)
    }
}
