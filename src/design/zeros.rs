//! Invariant zeros of a linear plant: frequencies at which the input may move the state while the output stays at 0.
//!
//! A. Emami-Naeini and P. Van Dooren, Computation of zeros of linear multivariable systems, Automatica 18 (1982)
//! 415–430: the part that the outputs determine is removed from the state until D has full rank. Size decides no zero.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use crate::eigenvalues;

/// Singular values below this part of the plant's largest entry count as 0.
const RANK: f64 = 1e-10;

/// The finite zeros of [A − s I, B; C, 0] for as many outputs as inputs. `None` where the outputs depend on each other at
/// every frequency, or eigenvalues can't be found.
pub fn invariant(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    // Units of inputs and outputs, which no zero depends on, are not to decide what counts as 0.
    let size = if A.amax() > 0.0 { A.amax() } else { 1.0 };
    let (mut B, mut C) = (B.clone(), C.clone());
    B.column_iter_mut().filter(|column| column.amax() > 0.0).for_each(|mut column| column *= size / column.amax());
    C.row_iter_mut().filter(|row| row.amax() > 0.0).for_each(|mut row| row *= size / row.amax());
    let tolerance = RANK * size;
    let whole = System { A: A.clone(), D: DMatrix::zeros(C.nrows(), B.ncols()), B, C };
    let System { A, B, C, D } = whole.reduced(tolerance);
    if D.nrows() != D.ncols() {
        return None;
    }
    if A.is_empty() {
        return Some(Vec::new());
    }
    let eliminated = D.lu().solve(&C)?;
    eigenvalues::complex(&(A - B * eliminated))
}

/// x' = A x + B u, y = C x + D u.
struct System {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    D: DMatrix<f64>,
}

impl System {
    /// The system with the same zeros whose D has full row rank.
    fn reduced(mut self, tolerance: f64) -> Self {
        loop {
            // Rows of D that are 0 determine states by themselves.
            let (U, rank) = compression(&self.D, tolerance);
            let (C, D) = (U.transpose() * &self.C, U.transpose() * &self.D);
            let p = C.nrows();
            (self.C, self.D) = (C.rows(0, rank).into_owned(), D.rows(0, rank).into_owned());
            let alone = C.rows(rank, p - rank).into_owned();
            if alone.nrows() == 0 {
                return self;
            }
            // The states that they determine come first.
            let (V, known) = compression(&alone.transpose(), tolerance);
            if known == 0 {
                return self;
            }
            let free = V.columns(known, V.ncols() - known).into_owned();
            let known = V.columns(0, known).into_owned();
            let (A, B) = (&self.A * &free, &self.B);
            // They stay at 0: their rates are outputs now.
            self.C = stacked(&(&self.C * &free), &(known.transpose() * &A));
            self.D = stacked(&self.D, &(known.transpose() * B));
            (self.A, self.B) = (free.transpose() * A, free.transpose() * B);
        }
    }
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(above.nrows() + below.nrows(), above.ncols().max(below.ncols()));
    all.rows_mut(0, above.nrows()).copy_from(above);
    all.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    all
}

/// An orthogonal U whose first columns span those of a matrix, and how many these are.
fn compression(matrix: &DMatrix<f64>, tolerance: f64) -> (DMatrix<f64>, usize) {
    let rows = matrix.nrows();
    if matrix.is_empty() || matrix.amax() <= tolerance {
        return (DMatrix::identity(rows, rows), 0);
    }
    // A square one, so that U is whole.
    let mut square = DMatrix::zeros(rows, rows.max(matrix.ncols()));
    square.columns_mut(0, matrix.ncols()).copy_from(matrix);
    let svd = square.svd(true, false);
    let mut order: Vec<_> = (0..svd.singular_values.len()).collect();
    order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
    let rank = svd.singular_values.iter().filter(|&&value| value > tolerance).count();
    let U = svd.u.unwrap_or_else(|| DMatrix::identity(rows, rows));
    (U.select_columns(&order), rank)
}
