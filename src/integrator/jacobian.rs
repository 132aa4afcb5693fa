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
    /// A vector and its image, for [`Jacobian::spectral_radius`].
    vectors: [Vec<f64>; 2],
}

impl Jacobian {
    /// Storage for a system.
    pub fn new(variables: &Variables) -> Self {
        let n = variables.states();
        Jacobian {
            dual: vec![Dual64::from_re(0.0); variables.reals(Section::Derivative).end],
            by_states: vec![0.0; n * n],
            by_time: vec![0.0; n],
            vectors: [vec![0.0; n], vec![0.0; n]],
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

    /// Estimate of the largest magnitude of the eigenvalues of ∂f/∂x, by a few steps of power iteration.
    pub fn spectral_radius(&mut self, nominals: &[f64]) -> f64 {
        let [v, image] = &mut self.vectors;
        // No direction that a system's symmetry could make orthogonal to the one that is looked for.
        v.iter_mut().zip(nominals).enumerate().for_each(|(i, (v, x))| *v = x * ((0.618 * i as f64).fract() - 0.45));
        let mut radius = 0.0;
        for _ in 0..ITERATIONS {
            image.fill(0.0);
            for (column, &x) in self.by_states.chunks_exact(v.len()).zip(&*v) {
                image.iter_mut().zip(column).for_each(|(sum, a)| *sum += a * x);
            }
            let length = norm(image, nominals);
            radius = length / norm(v, nominals);
            if length == 0.0 {
                break;
            }
            v.iter_mut().zip(&*image).for_each(|(v, &image)| *v = image / length);
        }
        radius
    }
}

/// Steps of the power iteration: enough to tell orders of magnitude apart.
const ITERATIONS: usize = 6;

/// One pass over dual numbers; the derivatives of the rates go into `column`.
fn pass(dual: &mut [Dual64], problem: &Problem, t: Dual64, column: &mut [f64]) {
    let (system, offsets) = (problem.system, problem.variables.offsets());
    system.outputs_dual(t, dual, problem.integers, offsets);
    system.derivatives_dual(t, dual, problem.integers, offsets);
    let rates = &dual[problem.variables.reals(Section::Derivative)];
    column.iter_mut().zip(rates).for_each(|(derivative, rate)| *derivative = rate.eps);
}

/// Root of the sum of squares in units of the nominal values.
pub fn norm(values: &[f64], nominals: &[f64]) -> f64 {
    values.iter().zip(nominals).map(|(value, nominal)| (value / nominal).powi(2)).sum::<f64>().sqrt()
}
