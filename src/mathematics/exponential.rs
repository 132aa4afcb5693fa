//! The matrix exponential, without allocating: for laws that step themselves in closed form.
//!
//! Scaling and squaring with a Taylor polynomial of degree 8 in three products (P. Bader, S. Blanes, F. Casas,
//! Computing the matrix exponential with an optimized Taylor polynomial approximation, Mathematics 7 (2019) 1174),
//! after balancing: positions, rates and estimates that differ by orders of magnitude would cost squarings.

use crate::mathematics::limits::within;
use crate::system::{Scalar, larger};

/// The largest norm that goes without scaling: the polynomial's error is then below 3e-14 of the norm.
const THETA: f64 = 0.125;
/// Sweeps of balancing, at most.
const SWEEPS: usize = 4;
/// Largest imbalance that is left as it is.
const BALANCED: f64 = 2.0;
/// More squarings than any finite norm needs.
const SQUARINGS: usize = 1100;

/// Size of the workspace for a matrix of order n.
pub const fn workspace(n: usize) -> usize {
    4 * n * n + n
}

/// Replaces a matrix of order n, stored by columns, by its exponential. Where an entry isn't finite, none of the result
/// need be.
///
/// # Panics
/// If the size of matrix or workspace isn't that of n and [`workspace`].
pub fn exponential<S: Scalar>(n: usize, matrix: &mut [S], workspace: &mut [S]) {
    assert!(matrix.len() == n * n && workspace.len() == self::workspace(n), "sizes of a matrix of order {n}");
    balance(n, matrix, &mut workspace[..n + n * n + 1]);
    let (scales, buffers) = workspace.split_at_mut(n);
    let norms = matrix.chunks_exact(n).map(|column| magnitude(column.iter()));
    let (squarings, factor) = scaling(norms.fold(S::from(0.0), larger));
    matrix.iter_mut().for_each(|x| *x *= factor);
    taylor(n, matrix, buffers);
    square(n, squarings, matrix, &mut buffers[..2 * n * n + 1]);
    for (column, &of_column) in matrix.chunks_exact_mut(n).zip(&*scales) {
        column.iter_mut().zip(&*scales).for_each(|(x, &of_row)| *x *= of_row / of_column);
    }
}

/// Number of squarings for a matrix of this norm after as many halvings, and the factor of these. No number of
/// squarings makes a norm finite that isn't.
fn scaling<S: Scalar>(norm: S) -> (S, S) {
    let mut state = [norm, S::from(0.0), S::from(1.0)];
    let is_large = |state: &[S]| state[0].above(S::from(THETA));
    S::iterate(&mut state, SQUARINGS, is_large, |state| {
        state[0] *= 0.5;
        state[1] += 1.0;
        state[2] *= 0.5;
    });
    (state[1], state[2])
}

/// Squares a matrix so many times, in a workspace for two of them and a number.
fn square<S: Scalar>(n: usize, times: S, matrix: &mut [S], workspace: &mut [S]) {
    workspace[0] = times;
    workspace[1..1 + n * n].copy_from_slice(matrix);
    let is_left = |state: &[S]| state[0].above(S::from(0.0));
    S::iterate(workspace, SQUARINGS, is_left, |state| {
        state[0] -= 1.0;
        let (matrix, square) = state[1..].split_at_mut(n * n);
        square.fill(S::from(0.0));
        add_product(n, matrix, matrix, square);
        matrix.copy_from_slice(square);
    });
    matrix.copy_from_slice(&workspace[1..1 + n * n]);
}

/// Scales variables so that rows and columns have norms alike. The workspace gets the size that each variable has in units
/// of its scaled one; behind these it is for the matrix, and for whether the last sweep has changed it.
fn balance<S: Scalar>(n: usize, matrix: &mut [S], workspace: &mut [S]) {
    let (zero, changed) = (S::from(0.0), n + n * n);
    workspace.fill(S::from(1.0));
    workspace[n..changed].copy_from_slice(matrix);
    let is_changed = |state: &[S]| state[changed].above(zero);
    S::iterate(workspace, SWEEPS, is_changed, |state| {
        let mut any = S::Flag::from(false);
        for i in 0..n {
            let (row, column) = norms(n, &state[n..], i);
            let is_coupled = row.above(zero) & column.above(zero);
            // Without a branch, so that no compiler divides zero by zero ahead of one.
            let [row, column] = [row, column].map(|norm| S::select(is_coupled, norm, S::from(1.0)));
            let factor = (row / column).sqrt();
            let is_off = !(factor.at_least(S::from(1.0 / BALANCED)) & factor.at_most(S::from(BALANCED)));
            scale(is_off, n, state, i, factor);
            any = any | is_off;
        }
        state[changed] = S::from_flag(any);
    });
    // What drives others and is driven by nothing (the constant of an affine system) may be as large as one likes.
    for i in 0..n {
        let matrix = &workspace[n..];
        let (row, column) = norms(n, matrix, i);
        let drives = row.equals(zero) & column.above(zero) & matrix[i + i * n].equals(zero);
        let one = S::from(1.0);
        let to_largest = || {
            let largest = others(n, i).map(|j| norms(n, matrix, j).1).fold(zero, larger);
            within(largest / column, S::from(f64::MIN_POSITIVE), one)
        };
        let factor = S::branch(drives, to_largest, || one);
        scale(drives, n, workspace, i, factor);
    }
    matrix.copy_from_slice(&workspace[n..changed]);
}

fn others(n: usize, i: usize) -> impl Iterator<Item = usize> {
    (0..n).filter(move |&j| j != i)
}

/// Sum of magnitudes.
fn magnitude<'a, S: Scalar>(numbers: impl Iterator<Item = &'a S>) -> S {
    numbers.fold(S::from(0.0), |sum, x| sum + x.abs())
}

/// Sums of magnitudes in a row and a column, the diagonal left out.
fn norms<S: Scalar>(n: usize, matrix: &[S], i: usize) -> (S, S) {
    (magnitude(others(n, i).map(|j| &matrix[i + j * n])), magnitude(others(n, i).map(|j| &matrix[j + i * n])))
}

/// Scales a variable, where a condition holds, of sizes with their matrix behind them.
fn scale<S: Scalar>(flag: S::Flag, n: usize, mut state: &mut [S], i: usize, factor: S) {
    S::carry_out(flag, &mut state, |state| {
        let (scales, matrix) = state.split_at_mut(n);
        scales[i] *= factor;
        for j in others(n, i) {
            matrix[i + j * n] /= factor;
            matrix[j + i * n] *= factor;
        }
    });
}

/// The polynomial of degree 8; its coefficients follow from those of the exponential by its products.
fn taylor<S: Scalar>(n: usize, a: &mut [S], buffers: &mut [S]) {
    let root = 177.0_f64.sqrt();
    let x3 = 2.0 / 3.0;
    let (x1, x2) = ((1.0 + root) * x3 / 88.0, (1.0 + root) * x3 / 352.0);
    let (x4, x5) = ((29.0 * root - 271.0) / (315.0 * x3), 11.0 * (root - 1.0) / (1260.0 * x3));
    let (x6, x7) = (11.0 * (root - 9.0) / (5040.0 * x3), (89.0 - root) / (5040.0 * x3 * x3));
    let y2 = (857.0 - 58.0 * root) / 630.0;

    buffers.fill(S::from(0.0));
    let (a2, rest) = buffers.split_at_mut(n * n);
    let (a4, rest) = rest.split_at_mut(n * n);
    let (left, right) = rest.split_at_mut(n * n);
    add_product(n, a, a, a2);
    for ((left, &a), &a2) in left.iter_mut().zip(&*a).zip(&*a2) {
        *left = a * x1 + a2 * x2;
    }
    add_product(n, a2, left, a4);
    let powers = || a2.iter().zip(&*a4);
    left.iter_mut().zip(powers()).for_each(|(left, (&a2, &a4))| *left = a2 * x3 + a4);
    for ((right, &a), (&a2, &a4)) in right.iter_mut().zip(&*a).zip(powers()) {
        *right = a * x5 + a2 * x6 + a4 * x7;
    }
    a.iter_mut().zip(powers()).for_each(|(a, (&a2, _))| *a += a2 * y2);
    for i in 0..n {
        right[i + i * n] += x4;
        a[i + i * n] += 1.0;
    }
    add_product(n, left, right, a);
}

/// c ← c + a b
fn add_product<S: Scalar>(n: usize, a: &[S], b: &[S], c: &mut [S]) {
    for (b, mut c) in b.chunks_exact(n).zip(c.chunks_exact_mut(n)) {
        for (a, &b) in a.chunks_exact(n).zip(b) {
            S::carry_out(!b.equals(S::from(0.0)), &mut c, |c| {
                c.iter_mut().zip(a).for_each(|(c, &a)| *c += a * b);
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn exponential_of(matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let n = matrix.nrows();
        let (mut result, mut space) = (matrix.clone(), vec![f64::NAN; workspace(n)]);
        exponential(n, result.as_mut_slice(), &mut space);
        result
    }

    #[test]
    fn a_rotation_turns() {
        let angle = 1234.5_f64;
        let e = exponential_of(&DMatrix::from_row_slice(2, 2, &[0.0, -angle, angle, 0.0]));
        let expected = [angle.cos(), angle.sin(), -angle.sin(), angle.cos()];
        assert!(e.iter().zip(expected).all(|(e, x)| (e - x).abs() < 1e-11), "{e}");
    }

    #[test]
    fn random_matrices_have_the_exponential_that_a_pade_approximation_gives() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
        };
        for n in 1..12 {
            for size in [1e-3, 0.3, 2.0, 20.0] {
                let matrix = DMatrix::from_fn(n, n, |_, _| size * random());
                let (ours, theirs) = (exponential_of(&matrix), matrix.exp());
                let error = (&ours - &theirs).norm() / theirs.norm();
                assert!(error < 1e-11, "n = {n}, size = {size}: {error:e}");
            }
        }
    }

    #[test]
    fn an_affine_system_of_very_different_magnitudes_is_accurate_in_each() {
        // x' = v, v' = −ω² x − 2 ζ ω v + c: from rest towards c/ω².
        let (omega, zeta, c, t): (f64, f64, f64, f64) = (4e3, 0.3, 1e12, 2e-3);
        let matrix = [0.0, 1.0, 0.0, -omega * omega, -2.0 * zeta * omega, c, 0.0, 0.0, 0.0];
        let e = exponential_of(&(DMatrix::from_row_slice(3, 3, &matrix) * t));
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        let (decay, sigma) = ((-zeta * omega * t).exp(), zeta * omega);
        let x = c / (omega * omega) * (1.0 - decay * ((damped * t).cos() + sigma / damped * (damped * t).sin()));
        let v = c / damped * decay * (damped * t).sin();
        assert!((e[(0, 2)] / x - 1.0).abs() < 1e-11 && (e[(1, 2)] / v - 1.0).abs() < 1e-11, "{e}");
        assert_eq!([e[(2, 0)], e[(2, 1)], e[(2, 2)]], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn what_is_not_finite_stays_so() {
        let e = exponential_of(&DMatrix::from_row_slice(2, 2, &[f64::NAN, 1.0, 1.0, 0.0]));
        assert!(e.iter().any(|x| !x.is_finite()));
    }
}
