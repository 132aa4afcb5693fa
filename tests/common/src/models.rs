//! Models run without the C functions in between.

use adaptive_fmu::error::StepError;
use adaptive_fmu::execution::Execution;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::{NoStructure, System};

/// A model that was initialised.
pub struct Run(pub Execution);

impl Run {
    /// A run with these lines in its `[start]`, from this time.
    pub fn of<M: System<Structure = NoStructure>>(start: &str, time: f64) -> Self {
        let start = start.parse::<toml::Table>().unwrap();
        let mut execution = Execution::new(Model::new::<M>("Test", &start).unwrap());
        execution.set_time(time);
        execution.initialise().unwrap();
        Run(execution)
    }

    pub fn get(&self, name: &str) -> f64 {
        let variables = self.0.model().variables();
        self.0.block().reals[variables.index(variables.find(name).unwrap())]
    }

    pub fn integer(&self, name: &str) -> i32 {
        let variables = self.0.model().variables();
        self.0.block().integers[variables.index(variables.find(name).unwrap())]
    }

    pub fn set(&mut self, name: &str, value: f64) {
        let variables = self.0.model().variables();
        let index = variables.index(variables.find(name).unwrap());
        self.0.set_real(index, value);
    }

    pub fn set_integer(&mut self, name: &str, value: i32) {
        let variables = self.0.model().variables();
        let index = variables.index(variables.find(name).unwrap());
        self.0.set_integer(index, value);
    }

    pub fn set_boolean(&mut self, name: &str, value: bool) {
        self.set_integer(name, i32::from(value));
    }

    pub fn step(&mut self, step: f64) {
        self.0.step(self.0.time(), step).unwrap();
    }

    pub fn run(&mut self, steps: usize, step: f64) {
        (0..steps).for_each(|_| self.step(step));
    }

    pub fn failure(&mut self, step: f64) -> StepError {
        self.0.step(self.0.time(), step).expect_err("a step that can't be finished")
    }
}
