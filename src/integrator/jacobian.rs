//! Exact derivatives of the state equation, by dual numbers.

use num_dual::Dual64;

use super::Problem;
use crate::system::{Section, Variables};

/// The derivatives of f(t, x) where a substep begins, and storage for them.
#[derive(Debug)]
pub struct Jacobian {
    /// The whole block over dual numbers.
    dual: Vec<Dual64>,
    /// ∂f/∂x, by columns.
    by_states: Vec<f64>,
    /// ∂f/∂t, with the change of the inputs in it.
    by_time: Vec<f64>,
}

impl Jacobian {
    /// Storage for a system.
    pub fn new(variables: &Variables) -> Self {
        let n = variables.states();
        Jacobian {
            dual: vec![Dual64::from_re(0.0); variables.reals(Section::Derivative).end],
            by_states: vec![0.0; n * n],
            by_time: vec![0.0; n],
        }
    }

    /// ∂f/∂x, by columns.
    pub fn by_states(&self) -> &[f64] {
        &self.by_states
    }

    /// ∂f/∂t along the inputs.
    pub fn by_time(&self) -> &[f64] {
        &self.by_time
    }

    /// Evaluates both where the problem stands, one pass a state and one for time.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number.
    pub fn evaluate(&mut self, problem: &Problem, t: f64) -> Result<(), usize> {
        let variables = problem.variables;
        let (states, n) = (variables.reals(Section::State), variables.states());
        self.dual.iter_mut().zip(&*problem.reals).for_each(|(dual, &value)| *dual = Dual64::from_re(value));
        for (state, column) in states.zip(self.by_states.chunks_exact_mut(n)) {
            self.dual[state].eps = 1.0;
            pass(&mut self.dual, problem, Dual64::from_re(t), column);
            self.dual[state].eps = 0.0;
        }
        if !problem.held {
            let inputs = &mut self.dual[variables.reals(Section::Input)];
            inputs.iter_mut().zip(problem.ramp.slopes).for_each(|(input, &slope)| input.eps = slope);
        }
        pass(&mut self.dual, problem, Dual64::new(t, 1.0), &mut self.by_time);
        let broken = self.by_states.iter().chain(&self.by_time).position(|derivative| !derivative.is_finite());
        broken.map_or(Ok(()), |place| Err(place % n))
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

/// One pass over dual numbers; the derivatives of the rates go into `column`.
fn pass(dual: &mut [Dual64], problem: &Problem, t: Dual64, column: &mut [f64]) {
    let (system, offsets) = (problem.system, problem.variables.offsets());
    system.outputs_dual(t, dual, problem.integers, offsets);
    system.derivatives_dual(t, dual, problem.integers, offsets);
    let rates = &dual[problem.variables.reals(Section::Derivative)];
    column.iter_mut().zip(rates).for_each(|(derivative, rate)| *derivative = rate.eps);
}
