//! The principal logarithm of a matrix.

use nalgebra::DMatrix;

/// Square roots are taken until the matrix is so close to the identity.
const NEAR: f64 = 0.25;
/// A matrix without a principal logarithm needs more of them.
const MOST_ROOTS: usize = 60;
const MOST_ITERATIONS: usize = 60;
/// Points and weights of Gauss and Legendre's rule on 0 … 1, of which log(1 + x) = ∫ x/(1 + s x) ds is made: exact to
/// rounding within the distance above.
const RULE: [(f64, f64); 8] = [
    (0.01985507175123186, 0.05061426814518818),
    (0.10166676129318664, 0.11119051722668725),
    (0.2372337950418355, 0.15685332293894363),
    (0.4082826787521751, 0.181341891689181),
    (0.591717321247825, 0.181341891689181),
    (0.7627662049581645, 0.15685332293894363),
    (0.8983332387068134, 0.11119051722668725),
    (0.9801449282487681, 0.05061426814518818),
];

/// The logarithm whose eigenvalues have imaginary parts within ±π; none where the matrix has an eigenvalue that is zero
/// or negative.
///
/// Inverse scaling and squaring with Denman and Beavers' iteration for the square root (Higham, Functions of Matrices,
/// SIAM 2008, sections 6.3 and 11.5).
pub fn logarithm(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let identity = DMatrix::identity(n, n);
    let (mut root, mut roots) = (matrix.clone(), 0);
    while (&root - &identity).norm() > NEAR {
        if roots == MOST_ROOTS {
            return None;
        }
        root = square_root(&root)?;
        roots += 1;
    }
    let distance = &root - &identity;
    let mut sum = DMatrix::zeros(n, n);
    for (point, weight) in RULE {
        sum += (&identity + &distance * point).lu().solve(&distance)? * weight;
    }
    let logarithm = sum * 2.0_f64.powi(roots as i32);
    logarithm.iter().all(|entry| entry.is_finite()).then_some(logarithm)
}

fn square_root(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let (mut y, mut z) = (matrix.clone(), DMatrix::identity(n, n));
    for _ in 0..MOST_ITERATIONS {
        let next = (&y + z.clone().try_inverse()?) * 0.5;
        z = (&z + y.try_inverse()?) * 0.5;
        let change = (&next - &z.clone().try_inverse()?).norm();
        y = next;
        if !change.is_finite() {
            return None;
        }
        if change <= 1e-15 * n as f64 * y.norm() {
            break;
        }
    }
    ((&y * &y - matrix).norm() <= 1e-9 * matrix.norm()).then_some(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_undoes_the_exponential() {
        let mut seed = 7_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for n in 1..8 {
            for _ in 0..20 {
                let a = DMatrix::from_fn(n, n, |_, _| random());
                let found = logarithm(&a.exp()).expect("eigenvalues of a lie within ±π");
                assert!((&found - &a).norm() < 1e-9 * (1.0 + a.norm()), "n = {n}: {found} instead of {a}");
            }
        }
    }

    #[test]
    fn a_double_integrator_is_no_exception() {
        let (h, mut a) = (1e-3, DMatrix::zeros(3, 3));
        (a[(0, 1)], a[(1, 2)]) = (1.0, 2.0);
        let found = logarithm(&(&a * h).exp()).unwrap() / h;
        assert!((found - a).norm() < 1e-9);
    }

    #[test]
    fn a_negative_eigenvalue_has_none() {
        assert_eq!(logarithm(&DMatrix::from_diagonal_element(1, 1, -0.5)), None);
        assert_eq!(logarithm(&DMatrix::zeros(2, 2)), None);
    }
}
