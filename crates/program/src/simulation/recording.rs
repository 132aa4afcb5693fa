//! Recording of a run.

use crate::near;

/// Outputs, and other signals that were asked for, at all communication points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Names, `unit.variable`.
    pub names: Vec<String>,
    /// Unit of measurement of each; empty if unknown.
    pub measures: Vec<String>,
    /// Times, s.
    pub times: Vec<f64>,
    /// One column for each name.
    pub columns: Vec<Vec<f64>>,
    /// Notes on what the loop may lack, and warnings of its components.
    pub warnings: Vec<String>,
    /// Further messages of components, if they are [recorded](crate::fmu::keep_details).
    pub details: Vec<String>,
}

impl Recording {
    /// The column of a signal.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let place = self.names.iter().position(|known| known == name)?;
        self.columns.get(place).map(Vec::as_slice)
    }

    /// The unit of measurement of a signal, if known.
    pub fn measure(&self, name: &str) -> Option<&str> {
        let place = self.names.iter().position(|known| known == name)?;
        self.measures.get(place).map(String::as_str).filter(|unit| !unit.is_empty())
    }

    /// Number of values, times included.
    pub fn values(&self) -> usize {
        self.times.len() * (self.columns.len() + 1)
    }

    pub(crate) fn push(&mut self, time: f64, row: &[f64]) {
        self.times.push(time);
        self.columns.iter_mut().zip(row).for_each(|(column, value)| column.push(*value));
    }
}

/// The place of a signal among all.
///
/// # Errors
/// When it isn't there.
pub(crate) fn place(names: &[String], name: &str) -> Result<usize, String> {
    let place = names.iter().position(|known| known == name);
    place.ok_or_else(|| format!("there is no signal `{name}`; {}", near::choice(name, names, "")))
}
