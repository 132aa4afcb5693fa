//! Coordinates in which the states of a plant are of like size: rows and columns of A, B and C that belong to a state have
//! equal sums. Scales are powers of two, so that nothing is rounded.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::eigenvalues;

/// Another scale is taken only where it leaves less than this part of the sum of a row and its column.
const GAINED: f64 = 0.95;
/// Passes over all states; more than any plant of finite numbers needs.
const MOST_PASSES: usize = 200;

/// Units are far from alike where balancing makes the norm of A so many times smaller.
const FAR: f64 = 1e3;

/// S⁻¹ A S and the diagonal of S, where the units of the states are so far from alike that digits would be lost; else `None`,
/// so that what is right as it is given keeps its digits.
pub fn far_from_balanced(A: &DMatrix<f64>) -> Option<(DMatrix<f64>, Vec<f64>)> {
    let n = A.nrows();
    if !A.norm_squared().is_finite() {
        return None;
    }
    let (balanced, _, _, scales) = balance(A, &DMatrix::zeros(n, 0), &DMatrix::zeros(0, n));
    (FAR * balanced.norm() < A.norm()).then_some((balanced, scales))
}

/// The least row-sum norm that A has in any units of the states: the spectral radius of |A|, or NaN where that isn't found.
pub fn least_norm(A: &DMatrix<f64>) -> f64 {
    let (n, magnitudes) = (A.nrows(), A.abs());
    let (balanced, _, _, _) = balance(&magnitudes, &DMatrix::zeros(n, 0), &DMatrix::zeros(0, n));
    let magnitudes = eigenvalues::complex(&balanced);
    magnitudes.map_or(f64::NAN, |all| all.iter().map(|value| value.norm()).fold(0.0, f64::max))
}

/// A, B and C with x = S z for a diagonal S of powers of two; and that diagonal.
pub fn balance(
    A: &DMatrix<f64>,
    B: &DMatrix<f64>,
    C: &DMatrix<f64>,
) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, Vec<f64>) {
    let (mut A, mut B, mut C) = (A.clone(), B.clone(), C.clone());
    let n = A.nrows();
    let mut scales = vec![1.0; n];
    for _ in 0..MOST_PASSES {
        let mut is_changed = false;
        for i in 0..n {
            let own = A[(i, i)].abs();
            let row = A.row(i).iter().chain(B.row(i).iter()).map(|entry| entry.abs()).sum::<f64>() - own;
            let column = A.column(i).iter().chain(C.column(i).iter()).map(|entry| entry.abs()).sum::<f64>() - own;
            if row == 0.0 || column == 0.0 {
                continue;
            }
            let factor = ((row / column).log2() * 0.5).round().exp2();
            if !factor.is_normal() || row / factor + column * factor >= GAINED * (row + column) {
                continue;
            }
            scales[i] *= factor;
            A.row_mut(i).scale_mut(1.0 / factor);
            B.row_mut(i).scale_mut(1.0 / factor);
            A.column_mut(i).scale_mut(factor);
            C.column_mut(i).scale_mut(factor);
            is_changed = true;
        }
        if !is_changed {
            break;
        }
    }
    (A, B, C, scales)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_norm_is_that_in_the_best_units() {
        // Through both states and back the product of the entries stays: √(8 · 2).
        for scale in [1e-9, 1.0, 1e6] {
            let A = DMatrix::from_row_slice(2, 2, &[0.0, 8.0 * scale, -2.0 / scale, 0.0]);
            assert!((least_norm(&A) / 4.0 - 1.0).abs() < 1e-12);
        }
        let chain = DMatrix::from_row_slice(2, 2, &[-3.0, 1e9, 0.0, -5.0]);
        assert!((least_norm(&chain) / 5.0 - 1.0).abs() < 1e-12);
    }
}
