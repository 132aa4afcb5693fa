//! Linear algebra that estimation needs.

mod exponential;
mod logarithm;
mod quantiles;

pub use exponential::exponential;
pub use logarithm::logarithm;
pub use quantiles::chi_squared;

use nalgebra::linalg::Schur;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, DVector, SymmetricEigen};

/// Iterations for each eigenvalue; three are usual.
const ITERATIONS: usize = 100;
/// Columns of a product that are computed together.
const PART: usize = 512;
/// Columns that are smaller than this part of what they were depend on those before.
const DEPENDENT: f64 = 1e-12;

/// The eigenvalues of a square matrix. `None` where they can't be found.
pub fn eigenvalues(a: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    if a.is_empty() {
        return Some(Vec::new());
    }
    if !a.norm_squared().is_finite() {
        return None;
    }
    let mut balanced = a.clone();
    balance_parlett_reinsch(&mut balanced);
    [1.0, 4.0, 16.0, 64.0].into_iter().find_map(|roundings| {
        let schur = Schur::try_new(balanced.clone(), roundings * f64::EPSILON, ITERATIONS * a.nrows())?;
        let found: Vec<_> = schur.complex_eigenvalues().iter().copied().collect();
        found.iter().all(|value| value.re.is_finite() && value.im.is_finite()).then_some(found)
    })
}

/// A with F = exp(A), and the B behind a zero-order hold of which a sampled model has G; `None` where F has an eigenvalue that is 0 or
/// negative.
pub fn continuous(f: &DMatrix<f64>, g: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let n = f.nrows();
    let a = logarithm(f)?;
    // exp([A I; 0 0]) is F and Φ.
    let mut whole = DMatrix::zeros(2 * n, 2 * n);
    whole.view_mut((0, 0), (n, n)).copy_from(&a);
    whole.view_mut((0, n), (n, n)).fill_with_identity();
    let phi = exponential(&whole, &[])?.0.view((0, n), (n, n)).into_owned();
    Some((a, phi.lu().solve(g)?))
}

/// The largest amount of an eigenvalue; infinite where there is none to be found.
pub fn spectral_radius(a: &DMatrix<f64>) -> f64 {
    eigenvalues(a).map_or(f64::INFINITY, |found| found.iter().map(|value| value.norm()).fold(0.0, f64::max))
}

/// Orthonormal columns that span a matrix, which they replace, and R of A = Q R. What depends on columns before it becomes 0.
pub fn orthonormalise(q: &mut DMatrix<f64>) -> DMatrix<f64> {
    let columns = q.ncols();
    let mut r = DMatrix::zeros(columns, columns);
    for j in 0..columns {
        let whole = q.column(j).norm();
        // Twice is enough.
        for _ in 0..2 {
            for i in 0..j {
                let (before, mut column) = q.columns_range_pair_mut(i, j);
                let part = before.dot(&column);
                r[(i, j)] += part;
                column.axpy(-part, &before, 1.0);
            }
        }
        let length = q.column(j).norm();
        if length > DEPENDENT * whole {
            r[(j, j)] = length;
            q.column_mut(j).unscale_mut(length);
        } else {
            q.column_mut(j).fill(0.0);
        }
    }
    r
}

/// Solution of R x = b for an upper triangle; what can't be determined is 0.
pub fn back_substitute(r: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    let mut x = b.clone();
    for i in (0..r.nrows()).rev() {
        let sum: f64 = (i + 1..r.ncols()).map(|j| r[(i, j)] * x[j]).sum();
        x[i] = if r[(i, i)] == 0.0 { 0.0 } else { (b[i] - sum) / r[(i, i)] };
    }
    x
}

/// Least squares: the columns of X for the columns of B, by singular values; small ones are left out.
pub fn least_squares(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    // Columns of unit length, so that units of unknowns don't decide what is small.
    let lengths: Vec<f64> = a.column_iter().map(|column| column.norm()).collect();
    if lengths.iter().any(|length| !length.is_finite()) {
        return None;
    }
    let scale = |length: f64| if length > 0.0 { length } else { 1.0 };
    let mut q = a.clone();
    for (mut column, length) in q.column_iter_mut().zip(&lengths) {
        column.unscale_mut(scale(*length));
    }
    let r = orthonormalise(&mut q);
    let right = q.transpose() * b;
    let svd = r.try_svd(true, true, f64::EPSILON, 1000)?;
    let largest = svd.singular_values.iter().copied().fold(0.0, f64::max);
    let mut x = svd.solve(&right, 1e-13 * largest).ok()?;
    for (mut row, length) in x.row_iter_mut().zip(&lengths) {
        row.unscale_mut(scale(*length));
    }
    Some(x)
}

/// The pseudoinverse with columns of unit length, and rows too unless there are more of them: units don't decide what is small.
pub fn pseudoinverse_of_units(a: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = |length: f64| if length > 0.0 { length } else { 1.0 };
    let columns: Vec<f64> = a.column_iter().map(|column| scale(column.norm())).collect();
    let mut unit = a.clone();
    unit.column_iter_mut().zip(&columns).for_each(|(mut column, length)| column.unscale_mut(*length));
    let is_wide = a.nrows() <= a.ncols();
    let rows: Vec<f64> = unit.row_iter().map(|row| if is_wide { scale(row.norm()) } else { 1.0 }).collect();
    unit.row_iter_mut().zip(&rows).for_each(|(mut row, length)| row.unscale_mut(*length));
    let mut inverse = pseudoinverse(&unit);
    inverse.row_iter_mut().zip(&columns).for_each(|(mut row, length)| row.unscale_mut(*length));
    inverse.column_iter_mut().zip(&rows).for_each(|(mut column, length)| column.unscale_mut(*length));
    inverse
}

/// The pseudoinverse.
pub fn pseudoinverse(a: &DMatrix<f64>) -> DMatrix<f64> {
    a.clone().pseudo_inverse(1e-12 * a.amax().max(f64::MIN_POSITIVE)).unwrap_or_else(|_| a.transpose() * 0.0)
}

/// Eigenvalues of a symmetric matrix in falling order, with their vectors.
pub fn symmetric(a: &DMatrix<f64>) -> (Vec<f64>, DMatrix<f64>) {
    if a.is_empty() {
        return (Vec::new(), a.clone());
    }
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(a.clone());
    let mut order: Vec<usize> = (0..eigenvalues.len()).collect();
    order.sort_by(|p, q| eigenvalues[*q].total_cmp(&eigenvalues[*p]));
    let sorted = order.iter().map(|place| eigenvalues[*place]).collect();
    (sorted, eigenvectors.select_columns(&order))
}

/// A vector that a nearly singular matrix makes small, by inverse iteration.
pub fn null_vector(matrix: &DMatrix<Complex<f64>>) -> Option<DVector<Complex<f64>>> {
    let lu = matrix.clone().lu();
    let start = |i: usize| Complex::new(1.0 + 0.3 * (i as f64 * 1.7).sin(), 0.2 * (i as f64 * 0.9).cos());
    let mut v = DVector::from_fn(matrix.nrows(), |i, _| start(i));
    for _ in 0..3 {
        v = lu.solve(&v)?;
        let length = v.norm();
        if !length.is_finite() || length == 0.0 {
            return None;
        }
        v.unscale_mut(length);
    }
    Some(v)
}

/// JᵀJ of a transposed Jacobian, part by part: its columns are rows of residuals, of which there may be many.
pub fn information(transposed: &DMatrix<f64>) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(transposed.nrows(), transposed.nrows());
    for first in (0..transposed.ncols()).step_by(PART) {
        let part = transposed.columns(first, PART.min(transposed.ncols() - first));
        sum.gemm(1.0, &part, &part.transpose(), 1.0);
    }
    sum
}

/// Takes what orthonormal columns span out of a Jacobian, transposed.
pub fn project_out(transposed: &mut DMatrix<f64>, q: &DMatrix<f64>) {
    let part = &*transposed * q;
    transposed.gemm(-1.0, &part, &q.transpose(), 1.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_squares_of_dependent_columns_is_the_shortest_solution() {
        let a = DMatrix::from_row_slice(3, 2, &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
        let b = DMatrix::from_row_slice(3, 1, &[2.0, 4.0, 6.0]);
        let x = least_squares(&a, &b).unwrap();
        assert!((x[0] + x[1] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn orthonormal_columns_and_their_triangle_give_the_matrix_again() {
        let a = DMatrix::from_fn(9, 4, |i, j| ((i * 5 + j * j + i * i * j) as f64).sin());
        let mut q = a.clone();
        let r = orthonormalise(&mut q);
        assert!((&q * &r - &a).amax() < 1e-14);
        assert!((q.transpose() * &q - DMatrix::identity(4, 4)).amax() < 1e-14);
        let x = back_substitute(&r, &(q.transpose() * a.column(1)));
        assert!((x - DVector::from_column_slice(&[0.0, 1.0, 0.0, 0.0])).amax() < 1e-13);
    }
}
