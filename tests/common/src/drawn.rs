//! A unit in random hands: random inputs, random steps, and so a random state that it may really get into.

use adaptive_fmu::fmi2::calls::{Interface, Standard};
use adaptive_fmu::fmi2::{model_description, snapshot};
use adaptive_fmu::library::SOURCE;
use adaptive_fmu::model::Block;
use adaptive_fmu::system::{Causality, Data, Element};

use super::random::Random;
use super::{OK, Unit};

impl Random {
    /// A number in [0, 1].
    pub fn part(&mut self) -> f64 {
        0.5 * (self.next() + 1.0)
    }

    /// Between two numbers above 0, each order of magnitude as likely as another.
    pub fn log_uniform(&mut self, (low, high): (f64, f64)) -> f64 {
        low * (high / low).powf(self.part())
    }
}

/// The limits of a real input; its nominal value on each side where it has none.
fn limits(input: &Element) -> (f64, f64) {
    match &input.variable.data {
        Data::Real { min, max, .. } => (min.unwrap_or(-input.nominal()), max.unwrap_or(input.nominal())),
        _ => (-1.0, 1.0),
    }
}

impl Unit {
    fn inputs(&self) -> Vec<Element<'_>> {
        let visible = self.model.variables().visible();
        visible.filter(|element| element.variable.causality == Causality::Input).collect()
    }

    /// Useful lengths of a step, s: from a hundredth of the FMU's own communication step to thirty times it, or without
    /// inputs to a quarter of its experiment.
    pub fn lengths(&self) -> (f64, f64) {
        let experiment = &self.model.description().experiment;
        let longest = if self.inputs().is_empty() { 0.25 * experiment.stop_time } else { 30.0 * experiment.step };
        (0.01 * experiment.step, longest)
    }

    /// Sets random inputs, large or small, constant or moving within their limits; returns the rates of real ones.
    pub fn draw_inputs(&self, random: &mut Random, step: f64) -> Vec<f64> {
        let (size, moving) = (random.log_uniform((0.01, 1.0)), random.next() > 0.0);
        let mut slopes = Vec::new();
        for input in self.inputs() {
            let name = input.name();
            if !input.variable.is_real() {
                // Most of the time something that is enabled is looked at.
                assert_eq!(self.set_boolean(&name, random.next() > -0.7), OK, "{:?}", self.messages());
                continue;
            }
            let (low, high) = limits(&input);
            let centre = 0.0_f64.clamp(low, high);
            let [from, to] = [(); 2].map(|()| centre + size * (low + (high - low) * random.part() - centre));
            self.put(&name, from);
            let slope = if moving { (to - from) / step } else { 0.0 };
            if moving {
                assert_eq!(self.set_slope(&name, slope), OK, "{:?}", self.messages());
            }
            slopes.push(slope);
        }
        slopes
    }

    /// Started anew at a random time with this method of integration, where there is a choice, and run for one to eight
    /// steps. A step that is refused is taken back. The time then.
    pub fn draw_state(&self, random: &mut Random, method: i32) -> f64 {
        assert_eq!(self.reset(), OK);
        if self.model.variables().find("integration_method").is_some() {
            assert_eq!(self.set_integer("integration_method", method), OK);
        }
        let mut t = random.part() * self.model.description().experiment.stop_time;
        self.start(t);
        for _ in 0..=(7.99 * random.part()) as usize {
            let (state, step) = (self.save(), random.log_uniform(self.lengths()));
            self.draw_inputs(random, step);
            if self.step(t, step) == OK {
                t += step;
            } else {
                assert_eq!(self.restore(state), OK);
            }
            assert_eq!(self.free(state), OK);
        }
        self.messages();
        t
    }

    /// All values.
    pub fn block(&self) -> Block {
        let identity = snapshot::identity(model_description::guid(&self.model), Interface::CoSimulation, SOURCE);
        snapshot::deserialise(&self.fingerprint(), (identity, (Standard::Fmi2, Interface::CoSimulation)), &self.model)
            .unwrap()
            .block
    }
}
