//! The feedforward gain that gives each output the static gain one from its reference.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use crate::error::Invalid;

/// Smallest singular value of C A_m⁻¹ B, relative to the sum of its terms, that counts as nonzero.
const SINGULAR: f64 = 1e-12;

/// K_g = −(C A_m⁻¹ B)⁻¹ for x' = A_m x + B K_g r, y = C x, with a Hurwitz A_m, which messages call by this name.
///
/// # Errors
/// [`Invalid`] when C A_m⁻¹ B has no inverse.
pub fn gain(A_m: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>, name: &str) -> Result<DMatrix<f64>, Invalid> {
    let reason = || format!("C {name}^-1 B is singular: the output has no static gain to scale");
    let singular = || Invalid::because(reason());
    // A Hurwitz matrix is regular; one at the limits of floating point may not be.
    let inverse = A_m.clone().try_inverse().ok_or_else(singular)?;
    let static_gain = -(C * &inverse * B);
    let terms = C.abs() * inverse.abs() * B.abs();
    if smallest_singular_value(&static_gain, &terms) <= SINGULAR {
        return Err(singular());
    }
    static_gain.try_inverse().ok_or_else(singular)
}

/// Smallest singular value of a matrix whose rows and columns are scaled by the sizes of the terms its entries are
/// sums of, so that units of outputs and inputs don't matter. Zero for an empty row or column.
fn smallest_singular_value(matrix: &DMatrix<f64>, terms: &DMatrix<f64>) -> f64 {
    let rows: Vec<_> = terms.row_iter().map(|row| row.max()).collect();
    let scaled = DMatrix::from_fn(terms.nrows(), terms.ncols(), |i, j| terms[(i, j)] / rows[i]);
    let columns: Vec<_> = scaled.column_iter().map(|column| column.max()).collect();
    let relative = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / (rows[i] * columns[j]));
    if relative.iter().all(|entry| entry.is_finite()) { relative.singular_values().min() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_settles_at_its_reference() {
        let A_m = DMatrix::from_row_slice(3, 3, &[-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, -1.8]);
        let B = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.0, 0.0, 1.0, 1.0]);
        let C = DMatrix::from_row_slice(2, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let K_g = gain(&A_m, &B, &C, "A_m").unwrap();
        // Steady state: x1 = u1 and x2 = u1 + u2, so u1 = r1 and u2 = r2 − r1.
        assert!((K_g - DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0])).norm() < 1e-14);
    }

    #[test]
    fn outputs_and_inputs_in_other_units_are_no_obstacle() {
        let A_m = DMatrix::from_row_slice(2, 2, &[-1.0, 0.0, 0.0, -2.0]);
        let B = DMatrix::from_row_slice(2, 2, &[1e9, 0.0, 0.0, 1.0]);
        let C = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 1e-9]);
        let K_g = gain(&A_m, &B, &C, "A_m").unwrap();
        assert!((K_g[(0, 0)] - 1e-9).abs() < 1e-24 && (K_g[(1, 1)] - 2e9).abs() < 1e-5, "{K_g}");
    }

    #[test]
    fn an_output_that_ends_at_zero_whatever_the_input_is_refused() {
        // The velocity of a body on a spring settles at zero.
        for stiffness in [1.0, 0.3, 441.552049] {
            let A_m = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -stiffness, -1.4]);
            let B = DMatrix::from_row_slice(2, 1, &[0.0, 0.7]);
            let message = gain(&A_m, &B, &DMatrix::from_row_slice(1, 2, &[0.0, 1.0]), "A_m").unwrap_err().to_string();
            assert!(message.contains("C A_m^-1 B is singular"), "{message}");
        }
        // Two outputs that are the same signal.
        let A_m = -DMatrix::<f64>::identity(2, 2);
        let C = DMatrix::from_row_slice(2, 2, &[0.1, 0.3, 0.2, 0.6]);
        assert!(gain(&A_m, &DMatrix::identity(2, 2), &C, "A_m").is_err());
    }
}
