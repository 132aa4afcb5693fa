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

/// The values at places of the block behind each step to these times, taken in one go where that is possible, or singly.
pub fn rows(execution: &mut Execution, times: &[f64], places: &[usize], in_one_go: bool) -> Vec<Vec<f64>> {
    let row = |reals: &[f64]| -> Vec<f64> { places.iter().map(|&place| reals[place]).collect() };
    let mut rows = Vec::new();
    while rows.len() + 1 < times.len() {
        let left = &times[rows.len()..];
        let mut given = Vec::new();
        let taken = if in_one_go { execution.steps(left, false, &mut |_, reals, _| given.push(row(reals))) } else { 0 };
        rows.extend(given.into_iter().take(taken));
        if taken == 0 {
            execution.step(left[0], left[1] - left[0]).unwrap();
            rows.push(row(&execution.block().reals));
        }
    }
    rows
}
