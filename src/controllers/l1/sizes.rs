//! Sizes of an L1 controller that can change without a new description.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::structure::{Baseline, L1Structure, MOST_STATES};
use crate::system::Size;

impl L1Structure {
    /// Numbers of states and inputs. They can change where B and C follow from them: inputs act on the last states, and the first
    /// states are outputs.
    pub(super) fn sizes(&self) -> Vec<Size> {
        let (n, m) = (self.B.len(), self.C.len());
        let has_baseline = self.baseline != Baseline::None;
        let is_fixed =
            has_baseline || self.state_scale.is_some() || self.unmatched == Some(true) || self.B_um.is_some();
        if is_fixed || m > n || self.B != inputs_on_last_states(n, m) || self.C != first_states(n, m) {
            return Vec::new();
        }
        let size = |name, description, value| Size { name, description, value, most: MOST_STATES };
        vec![size("n", "number of states", n), size("m", "number of inputs and outputs, at most n", m)]
    }

    /// A controller for cascades of first-order lags with poles at -1, until A_m is set.
    pub(super) fn resize(&mut self, sizes: &[usize]) -> toml::Table {
        let &[n, m] = sizes else { return toml::Table::new() };
        (self.A, self.B, self.C) = (None, inputs_on_last_states(n, m), first_states(n, m));
        let A_m = matrix(n, n, |i, j| f64::from(u8::from(j == i + m)) - f64::from(u8::from(i == j)));
        toml::Table::from_iter([("A_m".to_owned(), A_m.into())])
    }
}

/// B = (0; I)
fn inputs_on_last_states(n: usize, m: usize) -> Vec<Vec<f64>> {
    matrix(n, m, |i, j| f64::from(u8::from(i + m == n + j)))
}

/// C = (I 0)
fn first_states(n: usize, m: usize) -> Vec<Vec<f64>> {
    matrix(m, n, |i, j| f64::from(u8::from(i == j)))
}

fn matrix(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    (0..rows).map(|i| (0..columns).map(|j| entry(i, j)).collect()).collect()
}
