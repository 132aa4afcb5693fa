//! Matrices as descriptions give them, and their factors.

use nalgebra::allocator::Allocator;
use nalgebra::{Cholesky, DMatrix, DefaultAllocator, Dim, OMatrix};

use crate::error::Invalid;

/// The matrix of some rows.
///
/// # Errors
/// Rows of different lengths, none at all, and numbers that aren't finite.
pub fn rows(name: &str, rows: &[Vec<f64>]) -> Result<DMatrix<f64>, Invalid> {
    let columns = rows.first().map_or(0, Vec::len);
    if columns == 0 {
        return Err(Invalid::new(name, "empty", "must be rows of equal length"));
    }
    for (i, row) in rows.iter().enumerate() {
        let of_row = |value: String, allowed| Invalid::new(format!("row {} of {name}", i + 1), value, allowed);
        if row.len() != columns {
            let value = format!("{} numbers", row.len());
            return Err(of_row(value, format!("all rows must have equal length; the first has {columns} numbers")));
        }
        if let Some(value) = row.iter().find(|value| !value.is_finite()) {
            return Err(of_row(value.to_string(), "must be finite numbers".to_owned()));
        }
    }
    Ok(DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j]))
}

/// The same rows in a matrix of another size; new elements are 0.
pub fn resized(rows: &[Vec<f64>], (count, columns): (usize, usize)) -> Vec<Vec<f64>> {
    let element = |i: usize, j: usize| rows.get(i).and_then(|row| row.get(j)).copied().unwrap_or(0.0);
    (0..count).map(|i| (0..columns).map(|j| element(i, j)).collect()).collect()
}

/// The inverse of a matrix whose least singular value is above so many parts of the largest; or in how many parts it is.
///
/// # Errors
/// The least singular value in parts of the largest.
pub fn inverse(matrix: &DMatrix<f64>, least_allowed: f64) -> Result<DMatrix<f64>, f64> {
    let sizes = matrix.singular_values();
    let least = if sizes.max() > 0.0 { sizes.min() / sizes.max() } else { 0.0 };
    matrix.clone().try_inverse().filter(|_| least > least_allowed).ok_or(least)
}

/// The Cholesky factor of a symmetric matrix, where it is positive definite.
pub fn cholesky<D: Dim>(matrix: OMatrix<f64, D, D>) -> Option<Cholesky<f64, D>>
where
    DefaultAllocator: Allocator<D, D>,
{
    // A substitute of zero is never used. Without one, the compiled code takes the root of an arbitrary value and drops
    // it: an invalid operation that nobody asked for.
    Cholesky::new_with_substitute(matrix, 0.0)
}
