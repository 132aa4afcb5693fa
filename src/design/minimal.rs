//! The part of a plant that one input moves and one output shows.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

/// Couplings to the remaining states below this part of the norm of A count as 0.
const REACHED: f64 = 1e-10;

/// A, b, c without what b doesn't move and c doesn't show.
pub fn minimal(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> [DMatrix<f64>; 3] {
    let [A, B, C] = reached(A, B, C);
    let [A, C, B] = reached(&A.transpose(), &C.transpose(), &B.transpose()).map(|matrix| matrix.transpose());
    [A, B, C]
}

/// The part that the first column of B moves.
fn reached(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> [DMatrix<f64>; 3] {
    let size = A.norm();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut next = B.column(0).into_owned();
    let mut least = 0.0;
    while basis.len() < A.nrows() {
        // Twice: once leaves the rounding of the larger parts.
        for _ in 0..2 {
            for v in &basis {
                next -= v * v.dot(&next);
            }
        }
        let left = next.norm();
        if left <= least {
            break;
        }
        basis.push(next / left);
        next = A * &basis[basis.len() - 1];
        least = REACHED * size;
    }
    if basis.is_empty() {
        return [DMatrix::zeros(0, 0), DMatrix::zeros(0, B.ncols()), DMatrix::zeros(C.nrows(), 0)];
    }
    let Q = DMatrix::from_columns(&basis);
    [Q.transpose() * A * &Q, Q.transpose() * B, C * Q]
}
