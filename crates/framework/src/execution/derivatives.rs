//! Exact derivatives of an instance's equations, from their recordings.

use super::Execution;
use crate::differentiation::Direction;
use crate::model::{Block, Model};
use crate::recording::{Given, Registers};
use crate::system::{Section, Values};

/// Storage for the computation of derivatives. It takes memory when they are first asked for.
#[derive(Debug)]
pub(super) struct Derivation {
    /// Point at which they are taken.
    block: Block,
    /// Direction in which they are taken; afterwards the changes of all values of the block.
    changes: Vec<f64>,
    registers: Registers,
}

impl Derivation {
    pub fn new() -> Self {
        let block = Block { reals: Vec::new(), integers: Vec::new() };
        Derivation { block, changes: Vec::new(), registers: Registers::new() }
    }

    /// Changes where time and values of the block change.
    fn along(&mut self, direction: &Direction, (time, of_time): (f64, f64)) -> &[f64] {
        let Derivation { block, changes, registers } = self;
        let point = Given { time, step: 0.0, reals: &block.reals, integers: &block.integers, crossed: &[] };
        direction.carry_out(&point, of_time, changes, registers);
        changes
    }
}

impl Execution {
    /// Derivatives in the direction that gives each of the `knowns` (inputs, states and time, by their places in the block) the
    /// change in `seed`: exact, at the present inputs and the valid parameters. Values at the places of the block.
    pub fn directional_derivative(&mut self, knowns: &[u32], seed: &[f64]) -> &[f64] {
        self.place_derivation();
        self.seed(knowns, seed);
        let of_time = self.derivation.changes[self.model.time_place()];
        self.along(Model::direction, of_time)
    }

    /// Derivatives of the start, at the present time, parameters and inputs, in the direction that gives each of the
    /// `inputs` (by their places in the block) the change in `seed`: exact, through the start itself. Values at the places
    /// of the block.
    pub fn start_derivative(&mut self, inputs: &[u32], seed: &[f64]) -> &[f64] {
        self.place_derivation();
        let (variables, start) = (self.model.variables(), self.model.start());
        for section in [Section::State, Section::Discrete] {
            let (reals, integers) = (variables.reals(section), variables.integers(section));
            self.derivation.block.reals[reals.clone()].copy_from_slice(&start.reals[reals]);
            self.derivation.block.integers[integers.clone()].copy_from_slice(&start.integers[integers]);
        }
        self.seed(inputs, seed);
        self.along(Model::start_direction, 0.0)
    }

    /// The seed of the `unknowns` times their derivatives by each of the `knowns`, all by their places in the block: of the start by
    /// inputs, or as [`Execution::directional_derivative`] has them.
    pub fn adjoint_derivative(&mut self, starts: bool, (unknowns, seed): (&[u32], &[f64]), knowns: &[u32]) -> Vec<f64> {
        if !starts && self.model.adjoint().is_some() {
            return self.adjoint_on_tape((unknowns, seed), knowns);
        }
        let by = |known: &u32| {
            let known = std::slice::from_ref(known);
            let column =
                if starts { self.start_derivative(known, &[1.0]) } else { self.directional_derivative(known, &[1.0]) };
            unknowns.iter().zip(seed).map(|(&unknown, seed)| seed * column[unknown as usize]).sum()
        };
        knowns.iter().map(by).collect()
    }

    fn adjoint_on_tape(&mut self, (unknowns, seed): (&[u32], &[f64]), knowns: &[u32]) -> Vec<f64> {
        self.place_derivation();
        self.seed(unknowns, seed);
        let time = self.time();
        let Derivation { block, changes, registers } = &mut self.derivation;
        let point = Given { time, step: 0.0, reals: &block.reals, integers: &block.integers, crossed: &[] };
        // A state that is asked for changes as it changes itself, and so does time.
        let (states, of_time) = (self.model.variables().reals(Section::State), self.model.time_place());
        let mut results = vec![0.0; changes.len()];
        if let Some(adjoint) = self.model.adjoint() {
            adjoint.carry_out(&point, changes, registers, &mut results);
        }
        let own = |known: usize| if states.contains(&known) || known == of_time { changes[known] } else { 0.0 };
        knowns.iter().map(|&known| results[known as usize] + own(known as usize)).collect()
    }

    /// Time derivatives of signals and states at the last communication point, exact, along the solution. Values at the
    /// places of the block.
    pub fn time_derivatives(&mut self) -> &[f64] {
        self.place_derivation();
        let (variables, controls) = (self.model.variables(), self.model.controls());
        let in_force = self.copied_integers(controls.last_integer_inputs, Section::Input);
        let Derivation { block, changes, .. } = &mut self.derivation;
        let rates = &self.block.reals[variables.reals(Section::Derivative)];
        changes[variables.reals(Section::State)].copy_from_slice(rates);
        // As the last step left them: what was set since then isn't in force yet.
        let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
        if let Some((slopes, last_inputs)) = controls.slopes.zip(controls.last_inputs) {
            let inputs = variables.reals(Section::Input);
            block.reals[inputs.clone()].copy_from_slice(&values[last_inputs]);
            changes[inputs].copy_from_slice(&values[slopes]);
        }
        block.integers.copy_within(in_force, variables.integers(Section::Input).start);
        self.along(Model::direction, 1.0)
    }

    /// Takes the block over, with the valid parameters: those that wait to be taken over aren't in force. Nothing changes yet.
    fn place_derivation(&mut self) {
        let (variables, controls) = (self.model.variables(), self.model.controls());
        let valid_integers = self.valid_integers();
        let inputs_wait = self.values().get(controls.integer_inputs_wait);
        let inputs_in_force = inputs_wait.then(|| self.copied_integers(controls.last_integer_inputs, Section::Input));
        let Derivation { block, changes, .. } = &mut self.derivation;
        changes.clear();
        changes.resize(self.block.reals.len(), 0.0);
        block.reals.clone_from(&self.block.reals);
        block.integers.clone_from(&self.block.integers);
        let values = Values::new(&self.block.reals, &self.block.integers, variables.offsets());
        if let Some(valid) = controls.valid_reals {
            block.reals[variables.reals(Section::Parameter)].copy_from_slice(&values[valid]);
        }
        block.integers.copy_within(valid_integers, variables.integers(Section::Parameter).start);
        if let Some(in_force) = inputs_in_force {
            block.integers.copy_within(in_force, variables.integers(Section::Input).start);
        }
    }

    fn along(&mut self, direction: impl Fn(&Model) -> &Direction, of_time: f64) -> &[f64] {
        let time = self.time();
        self.derivation.along(direction(&self.model), (time, of_time))
    }

    fn seed(&mut self, knowns: &[u32], seed: &[f64]) {
        knowns.iter().zip(seed).for_each(|(&known, &change)| self.derivation.changes[known as usize] += change);
    }
}
