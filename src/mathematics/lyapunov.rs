//! The Lyapunov equation Aᵀ P + P A = −Q.

use nalgebra::{Complex, DMatrix};

use super::balanced::far_from_balanced;
use super::matrices::cholesky;
use crate::eigenvalues::complex as eigenvalues;
use crate::error::Invalid;

/// Doublings after which P of a Hurwitz matrix stands to rounding, whatever the spread of its eigenvalues in
/// floating point.
const DOUBLINGS: usize = 60;

/// Solves Aᵀ P + P A = −Q for a Hurwitz matrix A and a symmetric positive definite Q.
///
/// The Cayley transform U = (A + αI)(A − αI)⁻¹ turns it into P = Uᵀ P U + 2α (A − αI)⁻ᵀ Q (A − αI)⁻¹, whose series
/// is summed by doubling (R. A. Smith, Matrix equation XA + BX = C, SIAM J. Appl. Math. 16 (1968) 198–201).
///
/// # Errors
/// [`Invalid`] when A isn't Hurwitz (with its eigenvalues), or Q not symmetric positive definite.
pub fn solve(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>, Invalid> {
    solve_with_decay((a, q), ["A", "Q"]).map(|(p, _)| p)
}

/// The same, and the rate of the slowest decay of A, 1/s, which is known then; messages call the matrices by these names.
///
/// # Errors
/// As [`solve`].
pub fn solve_with_decay(
    (a, q): (&DMatrix<f64>, &DMatrix<f64>),
    [name, name_of_q]: [&str; 2],
) -> Result<(DMatrix<f64>, f64), Invalid> {
    let decay = slowest_decay(name, a)?;
    require_positive_definite(name_of_q, q)?;
    let unscaled = || Invalid::because(format!("{name} is too badly scaled for a Lyapunov equation"));
    let p = gramian(a, q).ok_or_else(unscaled)?;
    Ok((p, decay))
}

/// The integral of e^(Aᵀt) Q e^(At) over all t ≥ 0, which solves the same equation, for a Hurwitz matrix A and a
/// symmetric positive semidefinite Q. `None` when A is too badly scaled.
pub fn gramian(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let Some((balanced, scales)) = far_from_balanced(a) else { return gramian_as_given(a, q) };
    let scaled = DMatrix::from_fn(q.nrows(), q.ncols(), |i, j| q[(i, j)] * scales[i] * scales[j]);
    let p = gramian_as_given(&balanced, &scaled)?;
    Some(DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| p[(i, j)] / (scales[i] * scales[j])))
}

fn gramian_as_given(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let alpha = a.norm();
    let shifted = a - DMatrix::identity(n, n) * alpha;
    // A − αI has all its eigenvalues left of −α, so it is regular.
    let inverse = shifted.try_inverse()?;
    let mut u = (a + DMatrix::identity(n, n) * alpha) * &inverse;
    let mut p = inverse.transpose() * q * &inverse * (2.0 * alpha);
    for _ in 0..DOUBLINGS {
        let increment = u.transpose() * &p * &u;
        p += &increment;
        if increment.norm() <= f64::EPSILON * p.norm() {
            break;
        }
        u = &u * &u;
    }
    Some((&p + p.transpose()) * 0.5)
}

/// Refuses a matrix with an eigenvalue that isn't left of the imaginary axis.
///
/// # Errors
/// [`Invalid`] with the eigenvalues.
pub fn require_hurwitz(name: &str, a: &DMatrix<f64>) -> Result<(), Invalid> {
    slowest_decay(name, a).map(drop)
}

/// The rate of the slowest decay of a Hurwitz matrix, 1/s.
///
/// # Errors
/// [`Invalid`] with the eigenvalues of a matrix that isn't Hurwitz.
pub fn slowest_decay(name: &str, a: &DMatrix<f64>) -> Result<f64, Invalid> {
    let Some(eigenvalues) = eigenvalues(a) else {
        return Err(Invalid::because(format!("{name} is too badly scaled: its eigenvalues can't be found")));
    };
    if eigenvalues.iter().all(|lambda| lambda.re < 0.0) {
        return Ok(eigenvalues.iter().map(|lambda| -lambda.re).fold(f64::INFINITY, f64::min));
    }
    let list: Vec<_> = eigenvalues.iter().map(eigenvalue_text).collect();
    let allowed = "must be Hurwitz: every eigenvalue needs a negative real part";
    Err(Invalid::new(format!("eigenvalues of {name}"), list.join(", "), allowed))
}

/// An eigenvalue for a message.
pub(crate) fn eigenvalue_text(lambda: &Complex<f64>) -> String {
    format!("{} + {}j", short(lambda.re), short(lambda.im))
}

/// A number for a message.
fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e5).contains(&x.abs()) { format!("{x:.6}") } else { format!("{x:.4e}") }
}

/// Refuses a matrix that isn't symmetric and positive definite.
///
/// # Errors
/// [`Invalid`] naming it.
pub fn require_positive_definite(name: &str, q: &DMatrix<f64>) -> Result<(), Invalid> {
    let symmetric = (q - q.transpose()).norm() <= 1e-12 * q.norm();
    if symmetric && cholesky(q.clone()).is_some() {
        return Ok(());
    }
    Err(Invalid::new(name, "as set", "must be symmetric and positive definite"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residual(a: &DMatrix<f64>, p: &DMatrix<f64>, q: &DMatrix<f64>) -> f64 {
        (a.transpose() * p + p * a + q).norm() / (a.norm() * p.norm())
    }

    #[test]
    fn p_of_example_3_2_1_is_the_one_printed_in_the_thesis() {
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, -1.4]);
        let p = solve(&a, &DMatrix::identity(2, 2)).unwrap();
        // By hand: p12 = 1/2, p22 = (1/2 + p12)/1.4, p11 = 1.4 p12 + p22.
        let expected = [0.7 + 1.0 / 1.4, 0.5, 0.5, 1.0 / 1.4];
        assert!(p.iter().zip(expected).all(|(p, e)| (p - e).abs() < 1e-14), "{p}");
    }

    #[test]
    fn a_solution_satisfies_its_equation_over_a_wide_spread_of_eigenvalues() {
        let a = DMatrix::from_row_slice(3, 3, &[-1e-3, 4.0, 0.0, 0.0, -50.0, 700.0, 0.0, -700.0, -50.0]);
        let q = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1.0, 2.0, 3.0]));
        let p = solve(&a, &q).unwrap();
        assert!(residual(&a, &p, &q) < 1e-12, "{}", residual(&a, &p, &q));
    }

    #[test]
    fn an_unstable_matrix_is_refused_with_its_eigenvalues() {
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 2.0, -1.0]);
        let message = solve(&a, &DMatrix::identity(2, 2)).unwrap_err().to_string();
        assert!(message.contains("1.000000") && message.contains("Hurwitz"), "{message}");
    }

    #[test]
    fn a_hurwitz_matrix_with_a_multiple_eigenvalue_is_accepted() {
        // −2 three times, and −2 ± 0.177j (numpy).
        let rows = [
            [-2.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, -2.0, 0.0, 0.0, 0.0],
            [-6.203125, 3.40625, -0.40625, 2.40625, 3.203125],
            [-0.203125, -0.59375, -0.40625, -1.59375, -0.796875],
            [3.0, -2.0, -1.0, -1.0, -4.0],
        ];
        require_hurwitz("A_m", &DMatrix::from_row_slice(5, 5, &rows.concat())).unwrap();
    }

    #[test]
    fn an_indefinite_q_is_refused() {
        let a = -DMatrix::<f64>::identity(2, 2);
        let q = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
        assert!(solve(&a, &q).unwrap_err().to_string().contains("positive definite"));
    }
}
