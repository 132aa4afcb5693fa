//! Variables of a component that are read or set together, and the places of their values in the row of signals.

use crate::error::Error;
use crate::fmu::Instance;
use crate::model_description::Affine;
use crate::model_description::{ModelDescription, Variable};

/// Variables by type. The row has numbers only; a Boolean is 0 or 1.
#[derive(Debug, Default)]
pub(super) struct Ports {
    real: Port,
    integer: Port,
    boolean: Port,
    integers: Vec<i32>,
}

#[derive(Debug, Default)]
struct Port {
    references: Vec<u32>,
    places: Vec<usize>,
    conversions: Vec<Affine>,
    values: Vec<f64>,
}

/// The outputs that a row can have: all but texts.
pub(super) fn signals(description: &ModelDescription) -> impl Iterator<Item = (usize, &Variable)> {
    let outputs = description.variables.iter().enumerate();
    outputs.filter(|(_, variable)| variable.causality == "output" && variable.kind != "String")
}

impl Ports {
    /// Adds a variable with the place of its converted value in the row.
    pub fn add(&mut self, variable: &Variable, place: usize, conversion: Affine) {
        let port = match variable.kind.as_str() {
            "Real" => &mut self.real,
            "Boolean" => &mut self.boolean,
            _ => &mut self.integer,
        };
        port.references.push(variable.reference);
        port.places.push(place);
        port.conversions.push(conversion);
        port.values.push(0.0);
        self.integers.push(0);
    }

    /// The references of all, by their places in a row without gaps.
    pub fn references(&self) -> Vec<u32> {
        let ports = [&self.real, &self.integer, &self.boolean];
        let mut all: Vec<(usize, u32)> =
            ports.iter().flat_map(|port| port.places.iter().copied().zip(port.references.iter().copied())).collect();
        all.sort_unstable();
        all.into_iter().map(|(_, reference)| reference).collect()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        [&self.real, &self.integer, &self.boolean].iter().all(|port| port.is_empty())
    }

    /// Sets them from the row.
    pub fn take(&mut self, instance: &Instance, row: &[f64]) -> Result<(), Error> {
        let Ports { real, integer, boolean, integers } = self;
        if !real.is_empty() {
            real.fill(row);
            instance.set_real(&real.references, &real.values)?;
        }
        if !integer.is_empty() {
            let values = integer.filled(row, integers);
            instance.set_integer(&integer.references, values)?;
        }
        if !boolean.is_empty() {
            let values = boolean.filled(row, integers);
            instance.set_boolean(&boolean.references, values)?;
        }
        Ok(())
    }

    /// Reads them into the row.
    pub fn give(&mut self, instance: &Instance, row: &mut [f64]) -> Result<(), Error> {
        let Ports { real, integer, boolean, integers } = self;
        if !real.is_empty() {
            instance.get_real(&real.references, &mut real.values)?;
            real.places.iter().zip(&real.values).for_each(|(&place, value)| row[place] = *value);
        }
        if !integer.is_empty() {
            let values = &mut integers[..integer.references.len()];
            instance.get_integer(&integer.references, values)?;
            integer.places.iter().zip(values).for_each(|(&place, value)| row[place] = f64::from(*value));
        }
        if !boolean.is_empty() {
            let values = &mut integers[..boolean.references.len()];
            instance.get_boolean(&boolean.references, values)?;
            boolean.places.iter().zip(values).for_each(|(&place, value)| row[place] = f64::from(u8::from(*value != 0)));
        }
        Ok(())
    }
}

impl Port {
    fn is_empty(&self) -> bool {
        self.references.is_empty()
    }

    fn fill(&mut self, row: &[f64]) {
        let sources = self.places.iter().zip(&self.conversions);
        self.values
            .iter_mut()
            .zip(sources)
            .for_each(|(value, (&place, conversion))| *value = conversion.of(row[place]));
    }

    /// Whole numbers pass through the row unchanged, as it represents them exactly.
    fn filled<'a>(&mut self, row: &[f64], integers: &'a mut [i32]) -> &'a [i32] {
        self.fill(row);
        let integers = &mut integers[..self.values.len()];
        integers.iter_mut().zip(&self.values).for_each(|(integer, value)| *integer = *value as i32);
        integers
    }
}
