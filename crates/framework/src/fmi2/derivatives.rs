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
                return Err(Refused(format!("{}: `{}` is not an input", function.name(), name())));
            }
            if order != 1 {
                return Err(Refused(format!(
                    "{}: `{}`: order {order}; only order 1 is supported",
                    function.name(),
                    name()
                )));
            }
            if !value.is_finite() {
                return Err(Refused(format!(
                    "{}: `{}`: {} must be a finite number",
                    function.name(),
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
                return Err(Refused(format!("{}: `{}` is not an output", function.name(), self.name(reference))));
            }
            if order != 1 {
                let name = self.name(reference);
                return Err(Refused(format!(
                    "{}: `{name}`: order {order}; only order 1 is supported",
                    function.name()
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
    /// For unknowns that aren't calculated reals, knowns that are neither inputs nor states (inputs alone, in Initialization
    /// Mode), or a seed that isn't finite.
    pub fn get_directional_derivative(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        result: &mut [f64],
    ) -> Answer<Status> {
        let function = Function::GetDirectionalDerivative;
        let refuse = |instance: &Self, reference, reason: &str| {
            Err(Refused(format!("{}: `{}` {reason}", function.name(), instance.name(reference))))
        };
        for &unknown in unknowns {
            if !matches!(self.place(function, unknown, Type::Real)?.1, Access::Calculated { .. }) {
                return refuse(self, unknown, "is not calculated, so it has no derivative");
            }
        }
        let starts = self.phase() == Phase::Initialization;
        let variables = self.execution.model().variables();
        let (inputs, states) = (variables.reals(Section::Input), variables.reals(Section::State));
        for (&known, change) in knowns.iter().zip(seed) {
            let (place, _) = self.place(function, known, Type::Real)?;
            if starts && !inputs.contains(&place) {
                let reason = "is not an input: in Initialization Mode the start has derivatives by inputs alone";
                return refuse(self, known, reason);
            }
            if !inputs.contains(&place) && !states.contains(&place) {
                return refuse(self, known, "is neither an input nor a state");
            }
            if !change.is_finite() {
                return refuse(self, known, &format!("has the seed {change}, which must be finite"));
            }
        }
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

    /// The answer where derivatives were handed out, unless one of them is broken.
    fn answer_for(&mut self, function: Function, references: &[u32], broken: Option<(usize, f64)>) -> Status {
        broken.map_or(Status::Ok, |(k, value)| {
            let what = format!("the derivative of `{}`", self.name(references[k]));
            self.not_finite(function, &what, value)
        })
    }
}
