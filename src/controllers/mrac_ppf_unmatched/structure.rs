//! The structure of an MRAC for unmatched uncertainty: the nominal plant, and by which state each row is driven that the
//! controls don't reach.
#![allow(non_snake_case)] // matrices have the names of the thesis

use nalgebra::DMatrix;
use serde::Deserialize;

use crate::controllers::l1::{Quantities, Units, input_and_output, nominal_dynamics};
use crate::mathematics::matrices;
use crate::system::Invalid;

/// Least singular value of the reached rows of B, and least entry of A by which a row is driven, in parts of the largest.
const LEAST: f64 = 1e-9;

/// Nominal plant x' = A x + B u, y = C x: n states, m controls and as many outputs.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UnmatchedStructure {
    /// Nominal dynamics, n rows of n numbers.
    A: Vec<Vec<f64>>,
    /// Input matrix, n rows of m numbers. Rows of zeros are the unmatched ones; the m others must have an inverse.
    B: Vec<Vec<f64>>,
    /// Matrix of the outputs that follow the reference, m rows of n numbers.
    C: Vec<Vec<f64>>,
    /// Unmatched rows: the numbers of each and of the state that drives it, the derivative of which the controls reach.
    #[serde(default)]
    unmatched: Vec<DrivenBy>,
    /// States that are angles, counted from 1: values that differ by whole turns are the same. Their unit is rad, and each is an output.
    #[serde(default)]
    pub(super) angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    pub(super) units: Units,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    pub(super) quantities: Quantities,
}

/// An unmatched row.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct DrivenBy {
    /// Its number, from 1.
    row: usize,
    /// The number of the state that drives it, from 1.
    driven_by: usize,
}

/// An unmatched row and the state that drives it, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Driven {
    pub row: usize,
    pub by: usize,
}

/// The nominal plant.
#[derive(Debug)]
pub(super) struct PlantMatrices {
    pub A: DMatrix<f64>,
    pub B: DMatrix<f64>,
    pub C: DMatrix<f64>,
    /// The rows that the controls reach, in their order.
    pub reached: Vec<usize>,
    /// The inverse of these rows of B.
    pub inverse: DMatrix<f64>,
    pub unmatched: Vec<Driven>,
}

impl UnmatchedStructure {
    /// # Errors
    /// Matrices that don't fit, or a plant that this law can't control.
    pub(super) fn plant(&self) -> Result<PlantMatrices, Invalid> {
        let (B, C) = input_and_output(&self.B, &self.C)?;
        let A = nominal_dynamics(&self.A, &B)?;
        let reached = reached_rows(&B);
        let m = B.ncols();
        if reached.len() != m {
            let allowed = format!("must be {m}, one a control: rows can't share a control");
            return Err(Invalid::new("rows of B that aren't zero", reached.len(), allowed));
        }
        let of_reached = B.select_rows(&reached);
        if !of_reached.norm_squared().is_finite() {
            return Err(Invalid::because("B: its entries must be small enough to be squared"));
        }
        let inverse = matrices::inverse(&of_reached, LEAST).map_err(|least| {
            let allowed = format!("must be above {LEAST:e}: the controls must move them independently of each other");
            let name = "rows of B that aren't zero: least singular value in parts of the largest";
            Invalid::new(name, format!("{least:.3e}"), allowed)
        })?;
        let unmatched = self.unmatched_rows(&A, &reached)?;
        Ok(PlantMatrices { A, B, C, reached, inverse, unmatched })
    }

    /// The unmatched rows as they are given: all of them, each driven by a state of its own that the controls reach.
    fn unmatched_rows(&self, A: &DMatrix<f64>, reached: &[usize]) -> Result<Vec<Driven>, Invalid> {
        let n = A.nrows();
        let mut found: Vec<Driven> = Vec::new();
        for DrivenBy { row, driven_by } in &self.unmatched {
            let within = |name: &str, number: usize| {
                let allowed = format!("must be within 1 … {n}");
                (1..=n).contains(&number).then(|| number - 1).ok_or_else(|| Invalid::new(name, number, allowed))
            };
            let driven = Driven { row: within("row", *row)?, by: within("driven_by", *driven_by)? };
            if reached.contains(&driven.row) {
                let allowed = "must be a row of zeros in B: the controls reach this one, so that it isn't unmatched";
                return Err(Invalid::new("row", row, allowed));
            }
            if !reached.contains(&driven.by) {
                let allowed = "must be a state whose row of B isn't zero: one integrator lies between a control and an \
                               unmatched row, not more";
                return Err(Invalid::new("driven_by", driven_by, allowed));
            }
            let entry = A[(driven.row, driven.by)];
            if entry.abs() <= LEAST * A.row(driven.row).amax() {
                let name = format!("A: row {row}, column {driven_by}");
                return Err(Invalid::new(name, entry, "must not be zero: by it the state drives the unmatched row"));
            }
            if found.iter().any(|known| known.row == driven.row || known.by == driven.by) {
                let allowed = "must be given once: each unmatched row is driven by a state of its own";
                return Err(Invalid::new("unmatched", format!("row {row}, driven by {driven_by}"), allowed));
            }
            found.push(driven);
        }
        let is_known = |row: &usize| reached.contains(row) || found.iter().any(|known| known.row == *row);
        if let Some(missing) = (0..n).find(|row| !is_known(row)) {
            let allowed = "must give the state that drives each row that is zero in B";
            return Err(Invalid::new("unmatched", format!("nothing of row {}", missing + 1), allowed));
        }
        Ok(found)
    }
}

/// The rows of B that aren't zero.
pub(super) fn reached_rows(B: &DMatrix<f64>) -> Vec<usize> {
    (0..B.nrows()).filter(|&row| B.row(row).iter().any(|&entry| entry != 0.0)).collect()
}
