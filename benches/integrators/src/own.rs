//! Our own: a whole communication step of an instance, with everything around the integration.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::*;

use super::{Candidate, Memory};

/// Van der Pol oscillator with mu as its input.
struct VanDerPol {
    x0: VectorOf<Parameter>,
    mu: ScalarOf<Input>,
    x: VectorOf<State>,
}

impl System for VanDerPol {
    type Structure = NoStructure;
    const NAME: &'static str = "van-der-pol";
    const DOCUMENTATION: &'static str = "Van der Pol oscillator.";

    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(VanDerPol {
            x0: d.parameter(vector("x0", 2, "initial state").starts(&super::X0).fixed()),
            mu: d.input(scalar("mu", "damping")),
            x: d.state(vector("x", 2, "state").output()),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }

    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x1, x2] = v.array(self.x);
        dx.set(self.x, [x2, v[self.mu] * (-x1 * x1 + 1.0) * x2 - x1]);
    }
}

/// One instance; its whole memory is its block.
pub struct Own {
    method: &'static str,
    name: String,
    execution: Execution,
}

impl Own {
    pub fn new(method: &'static str) -> Self {
        let start = [("integration_method".to_owned(), method.into())].into_iter().collect();
        let model = Model::new::<VanDerPol>("VanDerPol", &start).expect("a model");
        let mut execution = Execution::new(model);
        execution.initialise().expect("a start");
        Own { method, name: format!("own {method}, whole step"), execution }
    }
}

impl Clone for Own {
    fn clone(&self) -> Self {
        let mut copy = Own::new(self.method);
        copy.execution.block_mut().copy_from(self.execution.block());
        copy
    }
}

impl Candidate for Own {
    fn name(&self) -> &str {
        &self.name
    }

    fn communication_step(&mut self, t: f64, h: f64, mu: f64, x: &mut [f64; 2]) {
        let variables = self.execution.model().variables();
        let (states, input) = (variables.reals(Section::State), variables.reals(Section::Input).start);
        self.execution.block_mut().reals[states.clone()].copy_from_slice(x);
        self.execution.block_mut().reals[input] = mu;
        self.execution.step(t, h).expect("a step");
        x.copy_from_slice(&self.execution.block().reals[states]);
    }
}

impl Memory for Own {
    fn save(&mut self) -> Vec<f64> {
        let block = self.execution.block();
        block.reals.iter().copied().chain(block.integers.iter().map(|&integer| f64::from(integer))).collect()
    }
    fn restore(&mut self, saved: &[f64]) {
        let block = self.execution.block_mut();
        let (reals, integers) = saved.split_at(block.reals.len());
        block.reals.copy_from_slice(reals);
        block.integers.iter_mut().zip(integers).for_each(|(integer, &saved)| *integer = saved as i32);
    }
}
