//! Configuration Mode: sizes of arrays that a master changes before the start.

use std::sync::Arc;

use crate::execution::Execution;
use crate::fmi2::calls::{Answer, Function, Phase, Refused};
use crate::fmi2::instance::Instance;
use crate::fmi2::shared::Shared;
use crate::system::{Causality, Section, Variable};

impl Instance {
    /// fmi3EnterConfigurationMode
    ///
    /// # Errors
    /// For a unit whose sizes are fixed.
    pub fn enter_configuration_mode(&mut self) -> Answer {
        let sizes = self.execution.model().sizes().values();
        if sizes.is_empty() {
            let name = self.called(Function::EnterConfigurationMode);
            return Err(Refused(format!("{name}: this FMU has no structural parameters")));
        }
        self.asked_sizes = sizes;
        self.phase = Phase::Configuration;
        Ok(())
    }

    /// fmi3ExitConfigurationMode: arrays have the sizes that were set. What has other sizes than before has its start values, the rest
    /// the values that it had.
    ///
    /// # Errors
    /// For sizes that don't fit each other: the instance stays in Configuration Mode.
    pub fn exit_configuration_mode(&mut self) -> Answer {
        let sizes = self.execution.model().sizes();
        if sizes.values() != self.asked_sizes {
            let unit = Shared::resized(&self.unit, &self.asked_sizes).map_err(|Refused(reason)| {
                let name = self.called(Function::ExitConfigurationMode);
                let each = sizes.list().iter().zip(&self.asked_sizes);
                let each: Vec<String> = each.map(|(size, asked)| format!("{} = {asked}", size.name)).collect();
                Refused(format!("{name} with {}: {reason}", each.join(", ")))
            })?;
            let former = self.take_unit(unit);
            self.keep_values(&former);
        }
        self.phase = Phase::Instantiated;
        Ok(())
    }

    /// Values that were set of what has the same size as before.
    fn keep_values(&mut self, former: &Execution) {
        let unit = Arc::clone(&self.unit);
        let (new, old) = (unit.model.variables(), former.model().variables());
        let is_set = |variable: &Variable| {
            matches!(variable.section, Section::Parameter | Section::Input) && variable.causality != Causality::Hidden
        };
        let places = new.iter().zip(old.iter()).filter(|(new, old)| is_set(new) && new.naming == old.naming);
        let places = places.flat_map(|(to, from)| to.elements().zip(from.elements()));
        let (values, start) = (former.block(), former.model().start());
        for (to, from) in places {
            let (place, before) = (new.index(to), old.index(from));
            if to.variable.is_real() && values.reals[before].to_bits() != start.reals[before].to_bits() {
                self.execution.set_real(place, values.reals[before]);
            } else if !to.variable.is_real() && values.integers[before] != start.integers[before] {
                self.execution.set_integer(place, values.integers[before]);
            }
        }
    }

    /// fmi3GetUInt64: in Configuration Mode the sizes that were set.
    ///
    /// # Errors
    /// For value references that aren't those of sizes, or another number of values.
    pub fn get_uint64(&self, references: &[u32], values: &mut [u64]) -> Answer {
        let found = self.numbers_of_sizes(Function::GetUInt64, references, values.len())?;
        let present = self.execution.model().sizes().values();
        let sizes = if self.phase == Phase::Configuration { &self.asked_sizes } else { &present };
        values.iter_mut().zip(found).for_each(|(value, number)| *value = sizes[number] as u64);
        Ok(())
    }

    /// fmi3SetUInt64
    ///
    /// # Errors
    /// For value references that aren't those of sizes, sizes beyond their limits, or another number of values; nothing is changed.
    pub fn set_uint64(&mut self, references: &[u32], values: &[u64]) -> Answer {
        let function = Function::SetUInt64;
        if !references.is_empty() && !self.execution.model().sizes().is_empty() {
            self.check(function)?;
        }
        let numbers = self.numbers_of_sizes(function, references, values.len())?;
        let mut asked = self.asked_sizes.clone();
        for ((number, value), reference) in numbers.into_iter().zip(values).zip(references) {
            let size = &self.execution.model().sizes().list()[number];
            let allowed = usize::try_from(*value).ok().filter(|value| (1..=size.most).contains(value));
            asked[number] = allowed.ok_or_else(|| {
                let (called, name, most) = (self.called(function), size.name, size.most);
                Refused(format!("{called}: `{name}` (value reference {reference}) = {value} must be within 1 … {most}"))
            })?;
        }
        self.asked_sizes = asked;
        Ok(())
    }

    /// Numbers of the sizes with these value references.
    fn numbers_of_sizes(&self, function: Function, references: &[u32], values: usize) -> Answer<Vec<usize>> {
        let (name, sizes) = (self.called(function), self.execution.model().sizes().list());
        if references.len() != values && !sizes.is_empty() {
            let (count, has) = (references.len(), if references.len() == 1 { "value" } else { "values" });
            return Err(Refused(format!("{name}: nValues = {values}, but these variables have {count} {has}")));
        }
        let number = |&reference: &u32| {
            let is_size = (reference as usize) < sizes.len();
            is_size.then_some(reference as usize).ok_or_else(|| {
                let has_none = format!("{name}: this FMU has no variable of type UInt64");
                let other = format!("{name}: value reference {reference} is that of no variable of type UInt64");
                Refused(if sizes.is_empty() { has_none } else { other })
            })
        };
        references.iter().map(number).collect()
    }
}
