//! The matrix exponential, without allocating: for laws that step themselves in closed form.
//!
//! Scaling and squaring with a Taylor polynomial of degree 8 in three products (P. Bader, S. Blanes, F. Casas,
//! Computing the matrix exponential with an optimized Taylor polynomial approximation, Mathematics 7 (2019) 1174),
//! after balancing: positions, rates and estimates that differ by orders of magnitude would cost squarings.

/// The largest norm that goes without scaling: the polynomial's error is then below 3e-14 of the norm.
const THETA: f64 = 0.125;
/// Sweeps of balancing, at most.
const SWEEPS: usize = 4;
/// What is closer to balance than this factor is left alone.
const BALANCED: f64 = 2.0;

/// Size of the workspace for a matrix of order n.
pub const fn workspace(n: usize) -> usize {
    4 * n * n + n
}

/// Replaces a matrix of order n, stored by columns, by its exponential. Where an entry isn't finite, none of the result
/// need be.
///
/// # Panics
/// When matrix or workspace have another size than n and [`workspace`] tell.
pub fn exponential(n: usize, matrix: &mut [f64], workspace: &mut [f64]) {
    assert!(matrix.len() == n * n && workspace.len() == self::workspace(n), "sizes of a matrix of order {n}");
    let (scales, buffers) = workspace.split_at_mut(n);
    balance(n, matrix, scales);
    let norm = matrix.chunks_exact(n).map(|column| column.iter().map(|x| x.abs()).sum()).fold(0.0, f64::max);
    // A norm that isn't finite makes no number of squarings finite either.
    let squarings = if norm > THETA { (norm / THETA).log2().ceil().min(1100.0) as i32 } else { 0 };
    let factor = 0.5_f64.powi(squarings);
    matrix.iter_mut().for_each(|x| *x *= factor);
    taylor(n, matrix, buffers);
    let square = &mut buffers[..n * n];
    for _ in 0..squarings {
        square.fill(0.0);
        add_product(n, matrix, matrix, square);
        matrix.copy_from_slice(square);
    }
    for (column, &of_column) in matrix.chunks_exact_mut(n).zip(&*scales) {
        column.iter_mut().zip(&*scales).for_each(|(x, of_row)| *x *= of_row / of_column);
    }
}

/// Scales variables so that rows and columns have norms alike. `scales` gets the size that each variable has in units of
/// its scaled one.
fn balance(n: usize, matrix: &mut [f64], scales: &mut [f64]) {
    scales.fill(1.0);
    for _ in 0..SWEEPS {
        let mut balanced = true;
        for i in 0..n {
            let (row, column) = norms(n, matrix, i);
            if !(row > 0.0 && column > 0.0) {
                continue;
            }
            let factor = (row / column).sqrt();
            if !(1.0 / BALANCED..=BALANCED).contains(&factor) {
                scale(n, matrix, scales, i, factor);
                balanced = false;
            }
        }
        if balanced {
            break;
        }
    }
    // What drives others and is driven by nothing (the constant of an affine system) may be as large as one likes.
    for i in 0..n {
        if let (0.0, column) = norms(n, matrix, i)
            && column > 0.0
            && matrix[i + i * n] == 0.0
        {
            let largest = (0..n).filter(|&j| j != i).map(|j| norms(n, matrix, j).1).fold(0.0, f64::max);
            scale(n, matrix, scales, i, (largest / column).clamp(f64::MIN_POSITIVE, 1.0));
        }
    }
}

/// Sums of magnitudes in a row and a column, the diagonal left out.
fn norms(n: usize, matrix: &[f64], i: usize) -> (f64, f64) {
    let others = || (0..n).filter(|&j| j != i);
    (others().map(|j| matrix[i + j * n].abs()).sum(), others().map(|j| matrix[j + i * n].abs()).sum())
}

fn scale(n: usize, matrix: &mut [f64], scales: &mut [f64], i: usize, factor: f64) {
    scales[i] *= factor;
    for j in (0..n).filter(|&j| j != i) {
        matrix[i + j * n] /= factor;
        matrix[j + i * n] *= factor;
    }
}

/// The polynomial of degree 8; its coefficients follow from those of the exponential by the products that it is made of.
fn taylor(n: usize, a: &mut [f64], buffers: &mut [f64]) {
    let root = 177.0_f64.sqrt();
    let x3 = 2.0 / 3.0;
    let (x1, x2) = ((1.0 + root) * x3 / 88.0, (1.0 + root) * x3 / 352.0);
    let (x4, x5) = ((29.0 * root - 271.0) / (315.0 * x3), 11.0 * (root - 1.0) / (1260.0 * x3));
    let (x6, x7) = (11.0 * (root - 9.0) / (5040.0 * x3), (89.0 - root) / (5040.0 * x3 * x3));
    let y2 = (857.0 - 58.0 * root) / 630.0;

    buffers.fill(0.0);
    let (a2, rest) = buffers.split_at_mut(n * n);
    let (a4, rest) = rest.split_at_mut(n * n);
    let (left, right) = rest.split_at_mut(n * n);
    add_product(n, a, a, a2);
    for ((left, &a), &a2) in left.iter_mut().zip(&*a).zip(&*a2) {
        *left = x1 * a + x2 * a2;
    }
    add_product(n, a2, left, a4);
    let powers = || a2.iter().zip(&*a4);
    left.iter_mut().zip(powers()).for_each(|(left, (&a2, &a4))| *left = x3 * a2 + a4);
    for ((right, &a), (&a2, &a4)) in right.iter_mut().zip(&*a).zip(powers()) {
        *right = x5 * a + x6 * a2 + x7 * a4;
    }
    a.iter_mut().zip(powers()).for_each(|(a, (&a2, _))| *a += y2 * a2);
    for i in 0..n {
        right[i + i * n] += x4;
        a[i + i * n] += 1.0;
    }
    add_product(n, left, right, a);
}

/// c ← c + a b
fn add_product(n: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
    for (b, c) in b.chunks_exact(n).zip(c.chunks_exact_mut(n)) {
        for (a, &b) in a.chunks_exact(n).zip(b) {
            if b != 0.0 {
                c.iter_mut().zip(a).for_each(|(c, &a)| *c += a * b);
            }
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
