//! Exact derivatives of an instance's equations, by dual numbers.

use num_dual::Dual64;

use super::Execution;
use crate::system::{Section, Values};

impl Execution {
    /// Derivatives in the direction that gives each of the `knowns` (inputs and states, by their places in the block) the
    /// change in `seed`: exact, by one pass with dual numbers at the present inputs and the valid parameters. Values at
    /// the places of the block.
    pub fn directional_derivative(&mut self, knowns: &[u32], seed: &[f64]) -> &[Dual64] {
        self.lift();
        for (&known, &change) in knowns.iter().zip(seed) {
            self.dual[known as usize].eps += change;
        }
        self.evaluate_dual(Dual64::from_re(self.time()));
        &self.dual
    }

    /// Takes the block over into dual numbers that don't change, with the valid parameters: those that wait to be
    /// taken over aren't in force.
    fn lift(&mut self) {
        let (variables, controls) = (self.model.variables(), self.model.controls());
        for (dual, &value) in self.dual.iter_mut().zip(&self.block.reals) {
            *dual = Dual64::from_re(value);
        }
        if let Some(valid) = controls.valid_reals {
            let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
            for (parameter, &value) in variables.reals(Section::Parameter).zip(&values[valid]) {
                self.dual[parameter] = Dual64::from_re(value);
            }
        }
        let valid = self.valid_integers();
        self.dual_integers.copy_from_slice(&self.block.integers);
        self.dual_integers.copy_within(valid, self.model.variables().integers(Section::Parameter).start);
        if self.values().get(self.model.controls().integer_inputs_wait) {
            let in_force = self.kept(self.model.controls().last_integer_inputs, Section::Input);
            self.dual_integers.copy_within(in_force, self.model.variables().integers(Section::Input).start);
        }
    }

    fn evaluate_dual(&mut self, t: Dual64) {
        let (system, offsets) = (self.model.system(), self.model.variables().offsets());
        system.outputs_dual(t, &mut self.dual, &self.dual_integers, offsets);
        system.derivatives_dual(t, &mut self.dual, &self.dual_integers, offsets);
    }

    /// Time derivatives of signals and states at the last communication point, exact, by one pass with dual
    /// numbers along the solution. Values at the places of the block.
    pub fn time_derivatives(&mut self) -> &[Dual64] {
        self.lift();
        let (variables, controls) = (self.model.variables(), self.model.controls());
        for (state, rate) in variables.reals(Section::State).zip(variables.reals(Section::Derivative)) {
            self.dual[state].eps = self.block.reals[rate];
        }
        // As the last step left them: what was set since then isn't in force yet.
        let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
        if let Some((slopes, last_inputs)) = controls.slopes.zip(controls.last_inputs) {
            for ((input, &value), &slope) in
                variables.reals(Section::Input).zip(&values[last_inputs]).zip(&values[slopes])
            {
                self.dual[input] = Dual64::new(value, slope);
            }
        }
        let (kept, present) =
            (self.kept(controls.last_integer_inputs, Section::Input), variables.integers(Section::Input));
        self.dual_integers.copy_within(kept, present.start);
        self.evaluate_dual(Dual64::new(self.time(), 1.0));
        &self.dual
    }
}
