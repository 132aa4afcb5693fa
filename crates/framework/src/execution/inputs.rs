//! Inputs within a communication step.

use super::{Execution, InputHandling};
use crate::integrator::Workspace;
use crate::system::{Section, Values};

impl Execution {
    /// Gives the rate of one input for the next step.
    pub fn set_input_slope(&mut self, input: usize, slope: f64) {
        let (slopes, given) = (self.model.controls().given_slopes, self.model.controls().slopes_given);
        let Some(slopes) = slopes else { return };
        if !self.values().get(given) {
            self.point()[slopes].fill(0.0);
            self.point().put(given, true);
        }
        self.point()[slopes][input] = slope;
    }

    /// True if an input has another value than in the communication step before.
    pub(super) fn inputs_moved(&self) -> bool {
        let inputs = self.model.variables().reals(Section::Input);
        let previous = self.model.controls().previous_inputs;
        previous.is_some_and(|previous| self.block.reals[inputs] != self.values()[previous])
    }

    /// True if inputs have been constant in the communication step before, and are so in the next.
    pub(super) fn inputs_rest(&self) -> bool {
        let (controls, integers) = (self.model.controls(), &self.block.integers);
        let (inputs, in_force) = (
            self.model.variables().integers(Section::Input),
            self.copied_integers(controls.last_integer_inputs, Section::Input),
        );
        let slopes = controls.slopes.is_none_or(|slopes| self.values()[slopes].iter().all(|&slope| slope == 0.0));
        slopes
            && !self.values().get(controls.slopes_given)
            && !self.inputs_moved()
            && integers[inputs] == integers[in_force]
    }

    /// Decides the course of inputs during this step. Returns true if they change at all.
    pub(super) fn prepare_inputs(&mut self, workspace: &mut Workspace, step: f64, first: bool) -> bool {
        let controls = self.model.controls();
        let (Some(handling), Some(given_slopes), Some(slopes), Some(previous), Some(last_inputs)) = (
            controls.input_handling,
            controls.given_slopes,
            controls.slopes,
            controls.previous_inputs,
            controls.last_inputs,
        ) else {
            return false;
        };
        let (given, last) = (controls.slopes_given, controls.last_step);
        let inputs = self.model.variables().reals(Section::Input);
        let Workspace { reals, integers, ramp_values, ramp_slopes, .. } = workspace;
        let v = Values::new(reals, integers, self.model.variables().offsets());
        let present = &reals[inputs];
        ramp_values.copy_from_slice(present);
        let handling = if first || v[last] == 0.0 { InputHandling::Hold } else { v.get(handling).item() };
        if v.get(given) {
            ramp_slopes.copy_from_slice(&v[given_slopes]);
        } else if handling == InputHandling::Hold {
            ramp_slopes.fill(0.0);
        } else {
            let duration = if handling == InputHandling::Extrapolate { v[last] } else { step };
            let pairs = present.iter().zip(&v[previous]);
            ramp_slopes.iter_mut().zip(pairs).for_each(|(slope, (now, before))| *slope = (now - before) / duration);
            if handling == InputHandling::Interpolate {
                ramp_values.copy_from_slice(&v[previous]);
            }
        }
        let mut point = self.block.point(&self.model, &mut self.log);
        point.put(given, false);
        point.set(slopes, &*ramp_slopes);
        point.set(previous, present);
        for (i, (value, slope)) in ramp_values.iter().zip(&*ramp_slopes).enumerate() {
            point[last_inputs][i] = value + slope * step;
        }
        ramp_slopes.iter().any(|&slope| slope != 0.0)
    }
}
