//! Plants by where within their bounds the entries are.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

/// Place of each entry, in parts of its bound: from −1 to 1 of an entry that is within it by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Entries of A.
    pub A: DMatrix<f64>,
    /// Entries of B.
    pub B: DMatrix<f64>,
}

impl Place {
    /// The nominal plant.
    pub fn nominal((n, m): (usize, usize)) -> Self {
        Place { A: DMatrix::zeros(n, n), B: DMatrix::zeros(n, m) }
    }

    /// An entry: of A, then of B, by columns.
    pub fn at(&self, entry: usize) -> f64 {
        entry.checked_sub(self.A.len()).map_or_else(|| self.A[entry], |entry| self.B[entry])
    }

    /// The same with another value of an entry.
    #[must_use]
    pub fn with(mut self, entry: usize, value: f64) -> Self {
        match entry.checked_sub(self.A.len()) {
            None => self.A[entry] = value,
            Some(entry) => self.B[entry] = value,
        }
        self
    }
}
