//! Sizes that can change without a new description.

use super::variable::{Data, Variable};

/// A size of a structure that can change before the start: FMI 3.0's structural parameter, of its arrays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Size {
    /// Name, as in the kind's documentation.
    pub name: &'static str,
    /// Number of what it is.
    pub description: &'static str,
    /// Its value in the structure.
    pub value: usize,
    /// Largest value; the smallest is 1.
    pub most: usize,
}

impl Variable {
    /// True if all elements have one unit, and names of the system.
    pub fn is_uniform(&self) -> bool {
        let has_one_unit = match &self.data {
            Data::Real { unit, .. } => unit.windows(2).all(|pair| pair[0] == pair[1]),
            _ => true,
        };
        has_one_unit && self.given.iter().all(Option::is_none)
    }
}
