//! Derivatives of inputs and outputs.

use super::access::{Access, Type};
use super::calls::{Answer, Refused};
use super::calls::{Function, Phase};
use super::instance::{Instance, hand_out};
use super::types::Status;
use crate::error::Number;
use crate::system::Section;

impl Instance {
    /// fmi2SetRealInputDerivatives
    ///
    /// # Errors
    /// For what isn't a real input, another order than 1, or values that aren't finite.
    pub fn set_input_derivatives(&mut self, references: &[u32], orders: &[i32], values: &[f64]) -> Answer {
        let function = Function::SetRealInputDerivatives;
        for ((&reference, &order), value) in references.iter().zip(orders).zip(values) {
            let (_, access) = self.place(function, reference, Type::Real)?;
            let name = || self.name(reference);
            if access != Access::Input {
                return Err(Refused(format!("{}: `{}` is not an input", self.called(function), name())));
            }
            if order != 1 {
                return Err(Refused(format!(
                    "{}: `{}`: order {order}; only order 1 is supported",
                    self.called(function),
                    name()
                )));
            }
            if !value.is_finite() {
                return Err(Refused(format!(
                    "{}: `{}`: {} must be a finite number",
                    self.called(function),
                    name(),
                    Number(*value)
                )));
            }
        }
        let first = self.execution.model().variables().reals(Section::Input).start;
        for (&reference, &value) in references.iter().zip(values) {
            self.execution.set_input_slope(reference as usize - first, value);
        }
        Ok(())
    }

    /// fmi2GetRealOutputDerivatives
    ///
    /// # Errors
    /// For what isn't a real output, or another order than 1.
    pub fn get_output_derivatives(&mut self, references: &[u32], orders: &[i32], values: &mut [f64]) -> Answer<Status> {
        let function = Function::GetRealOutputDerivatives;
        for (&reference, &order) in references.iter().zip(orders) {
            let (_, access) = self.place(function, reference, Type::Real)?;
            if access != (Access::Calculated { output: true }) {
                return Err(Refused(format!("{}: `{}` is not an output", self.called(function), self.name(reference))));
            }
            if order != 1 {
                let name = self.name(reference);
                return Err(Refused(format!(
                    "{}: `{name}`: order {order}; only order 1 is supported",
                    self.called(function)
                )));
            }
        }
        let found = self.execution.time_derivatives();
        let broken = hand_out(references.iter().map(|&reference| found[reference as usize]), values);
        Ok(self.answer_for(function, references, broken))
    }

    /// fmi2GetDirectionalDerivative, at the present inputs; in Initialization Mode of the start values by the inputs.
    ///
    /// # Errors
    /// Refuses unknowns that aren't calculated reals, knowns that are neither inputs nor states (in Initialization
    /// Mode: that aren't inputs), and a seed that isn't finite.
    pub fn get_directional_derivative(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        result: &mut [f64],
    ) -> Answer<Status> {
        let function = Function::GetDirectionalDerivative;
        let starts = self.check_directions(function, unknowns, knowns)?;
        self.check_seed(function, knowns, seed)?;
        if starts {
            self.evaluate(function)?;
        }
        let found = if starts {
            self.execution.start_derivative(knowns, seed)
        } else {
            self.execution.directional_derivative(knowns, seed)
        };
        let broken = hand_out(unknowns.iter().map(|&unknown| found[unknown as usize]), result);
        Ok(self.answer_for(function, unknowns, broken))
    }

    /// fmi3GetAdjointDerivative: the seed, a number for each unknown, times the derivatives of these by each known.
    ///
    /// # Errors
    /// As for [`Instance::get_directional_derivative`].
    pub fn get_adjoint_derivative(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        result: &mut [f64],
    ) -> Answer<Status> {
        let function = Function::GetAdjointDerivative;
        let starts = self.check_directions(function, unknowns, knowns)?;
        self.check_seed(function, unknowns, seed)?;
        if starts {
            self.evaluate(function)?;
        }
        let found = self.execution.adjoint_derivative(starts, (unknowns, seed), knowns);
        let broken = hand_out(found.iter().copied(), result);
        Ok(self.answer_for(function, knowns, broken))
    }

    /// Refuses what has no derivative; true if derivatives are those of the start.
    fn check_directions(&self, function: Function, unknowns: &[u32], knowns: &[u32]) -> Answer<bool> {
        let refuse = |reference, reason: &str| {
            Err(Refused(format!("{}: `{}` {reason}", self.called(function), self.name(reference))))
        };
        for &unknown in unknowns {
            let (place, access) = self.place(function, unknown, Type::Real)?;
            if !matches!(access, Access::Calculated { .. }) {
                return refuse(unknown, "is not calculated, so it has no derivative");
            }
            if place >= self.execution.block().reals.len() {
                return refuse(unknown, "is an event indicator, whose derivatives aren't known");
            }
        }
        let starts = self.phase() == Phase::Initialization;
        let variables = self.execution.model().variables();
        let (inputs, states) = (variables.reals(Section::Input), variables.reals(Section::State));
        for &known in knowns {
            let (place, _) = self.place(function, known, Type::Real)?;
            if starts && !inputs.contains(&place) {
                let reason = "is not an input: in Initialization Mode the start has derivatives by inputs only";
                return refuse(known, reason);
            }
            let is_time = place == self.execution.model().time_place();
            if !inputs.contains(&place) && !states.contains(&place) && !is_time {
                return refuse(known, "is neither an input nor a state");
            }
        }
        Ok(starts)
    }

    fn check_seed(&self, function: Function, references: &[u32], seed: &[f64]) -> Answer {
        let broken = references.iter().zip(seed).find(|(_, change)| !change.is_finite());
        broken.map_or(Ok(()), |(&reference, change)| {
            let (name, variable) = (self.called(function), self.name(reference));
            Err(Refused(format!("{name}: `{variable}` has the seed {change}, which must be finite")))
        })
    }

    /// The answer after derivatives were returned: an error if one of them is broken.
    fn answer_for(&mut self, function: Function, references: &[u32], broken: Option<(usize, f64)>) -> Status {
        broken.map_or(Status::Ok, |(k, value)| {
            let what = format!("the derivative of `{}`", self.name(references[k]));
            self.not_finite(function, &what, value)
        })
    }
}
