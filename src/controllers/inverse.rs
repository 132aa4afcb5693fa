//! Inverses of what turns channels into controls: each channel needs a direction of its own.

use nalgebra::DMatrix;

use crate::mathematics::matrices;
use crate::system::{Invalid, MatrixOf, Number, Parameter, Point, Prepared};

/// The least singular value, in parts of the largest one.
const LEAST_DIRECTION: f64 = 1e-12;

/// The inverse; or how small the least singular value is against the largest one, where there is none.
pub(super) fn inverse(matrix: &DMatrix<f64>) -> Result<DMatrix<f64>, f64> {
    matrices::inverse(matrix, LEAST_DIRECTION)
}

/// Prepares the inverse of a parameter.
///
/// # Errors
/// A matrix without an inverse.
pub(super) fn prepare(of: MatrixOf<Parameter>, inverse: MatrixOf<Prepared>, v: &mut Point) -> Result<(), Invalid> {
    let found = self::inverse(&v.matrix(of).into_owned()).map_err(|least| refused(&v.name(of), least))?;
    v.matrix_mut(inverse).copy_from(&found);
    Ok(())
}

/// Message about a matrix without an inverse.
pub(super) fn refused(name: &str, least: f64) -> Invalid {
    let allowed = format!("must be above {LEAST_DIRECTION:e}: each channel needs a direction of its own");
    Invalid::new(format!("{name}: least singular value in parts of the largest"), Number(least), allowed)
}
