//! Exact derivatives of an instance's equations, by dual numbers.

use super::Execution;
use crate::system::{Compiled, CompiledStart, Dual, MessageLog, Point, Section, Values};

impl Execution {
    /// Derivatives in the direction that gives each of the `knowns` (inputs and states, by their places in the block) the
    /// change in `seed`: exact, by one pass with dual numbers at the present inputs and the valid parameters. Values at
    /// the places of the block.
    pub fn directional_derivative(&mut self, knowns: &[u32], seed: &[f64]) -> &[Dual] {
        self.lift();
        for (&known, &change) in knowns.iter().zip(seed) {
            self.dual[known as usize].derivatives[0] += change;
        }
        self.evaluate_dual(Dual::from(self.time()));
        &self.dual
    }

    /// Derivatives of the start, at the present time, parameters and inputs, in the direction that gives each of the
    /// `inputs` (by their places in the block) the change in `seed`: exact, by one pass with dual numbers through the start
    /// itself. Values at the places of the block.
    pub fn start_derivative(&mut self, inputs: &[u32], seed: &[f64]) -> &[Dual] {
        self.lift();
        let (variables, start) = (self.model.variables(), self.model.start());
        for section in [Section::State, Section::Discrete] {
            let (reals, integers) = (variables.reals(section), variables.integers(section));
            for place in reals {
                self.dual[place] = Dual::from(start.reals[place]);
            }
            self.dual_integers[integers.clone()].copy_from_slice(&start.integers[integers]);
        }
        for (&input, &change) in inputs.iter().zip(seed) {
            self.dual[input as usize].derivatives[0] += change;
        }
        let t = Dual::from(self.time());
        // What is told and refused was told and refused when the start was computed.
        let mut unheard = MessageLog::new();
        let mut point = Point::new(&mut self.dual, &mut self.dual_integers, variables.offsets(), &mut unheard);
        Dual::start(self.model.system()).initialise(t, &mut point);
        self.evaluate_dual(t);
        &self.dual
    }

    /// Takes the block over into dual numbers that don't change, with the valid parameters: those that wait to be
    /// taken over aren't in force.
    fn lift(&mut self) {
        self.take_dual_numbers();
        let (variables, controls) = (self.model.variables(), self.model.controls());
        for (dual, &value) in self.dual.iter_mut().zip(&self.block.reals) {
            *dual = Dual::from(value);
        }
        if let Some(valid) = controls.valid_reals {
            let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
            for (parameter, &value) in variables.reals(Section::Parameter).zip(&values[valid]) {
                self.dual[parameter] = Dual::from(value);
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

    /// Takes memory for dual numbers, once.
    pub(super) fn take_dual_numbers(&mut self) {
        self.dual.resize(self.block.reals.len(), Dual::from(0.0));
        self.dual_integers.resize(self.block.integers.len(), 0);
    }

    fn evaluate_dual(&mut self, t: Dual) {
        let (system, offsets) = (self.model.system(), self.model.variables().offsets());
        Dual::equations(system).evaluate(t, &mut self.dual, &self.dual_integers, offsets);
    }

    /// Time derivatives of signals and states at the last communication point, exact, by one pass with dual
    /// numbers along the solution. Values at the places of the block.
    pub fn time_derivatives(&mut self) -> &[Dual] {
        self.lift();
        let (variables, controls) = (self.model.variables(), self.model.controls());
        for (state, rate) in variables.reals(Section::State).zip(variables.reals(Section::Derivative)) {
            self.dual[state].derivatives[0] = self.block.reals[rate];
        }
        // As the last step left them: what was set since then isn't in force yet.
        let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
        if let Some((slopes, last_inputs)) = controls.slopes.zip(controls.last_inputs) {
            for ((input, &value), &slope) in
                variables.reals(Section::Input).zip(&values[last_inputs]).zip(&values[slopes])
            {
                self.dual[input] = Dual::new(value, slope);
            }
        }
        let (kept, present) =
            (self.kept(controls.last_integer_inputs, Section::Input), variables.integers(Section::Input));
        self.dual_integers.copy_within(kept, present.start);
        self.evaluate_dual(Dual::new(self.time(), 1.0));
        &self.dual
    }
}
