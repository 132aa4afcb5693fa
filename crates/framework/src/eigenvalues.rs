//! Eigenvalues as a person reads them: with damping and natural frequency.

use nalgebra::linalg::Schur;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix};
use serde::{Deserialize, Serialize};

/// Iterations for each eigenvalue in which most matrices have all of theirs: three are usual.
const FEW_ITERATIONS: usize = 60;
/// Iterations in which the eigenvalues of any matrix that is scaled well enough are found, many times over.
const MOST_ITERATIONS: usize = 10_000;

/// An eigenvalue of a matrix of rates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Eigenvalue {
    /// Real part, 1/s.
    pub real: f64,
    /// Imaginary part, rad/s.
    pub imaginary: f64,
    /// Damping ratio; none of an eigenvalue 0.
    pub damping: Option<f64>,
    /// Natural frequency, rad/s.
    pub frequency: f64,
}

/// The eigenvalues of a square matrix, the slowest first.
///
/// # Errors
/// Why they can't be found, as what follows the matrix's name.
pub fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<Eigenvalue>, &'static str> {
    // Balancing needs squares of the entries, and never ends where these aren't finite.
    if !a.norm_squared().is_finite() {
        return Err("is not finite");
    }
    // States of very different sizes would drown the slow eigenvalues in the rounding errors of the fast ones.
    let mut balanced = a.clone();
    balance_parlett_reinsch(&mut balanced);
    // Rounding errors of the algorithm. A smaller part counts as zero, so it is neither stable nor unstable.
    let noise = 10.0 * a.nrows() as f64 * f64::EPSILON * balanced.norm();
    let found = complex(&balanced).ok_or("is too badly scaled: its eigenvalues can't be found")?;
    let eigenvalue = |real: f64, imaginary: f64| {
        let frequency = real.hypot(imaginary);
        if frequency <= noise {
            return Eigenvalue { real: 0.0, imaginary: 0.0, damping: None, frequency: 0.0 };
        }
        Eigenvalue { real, imaginary, damping: Some(-real / frequency), frequency }
    };
    let mut eigenvalues: Vec<_> = found.iter().map(|value| eigenvalue(value.re, value.im)).collect();
    eigenvalues.sort_by(|p, q| p.frequency.total_cmp(&q.frequency).then(q.imaginary.total_cmp(&p.imaginary)));
    Ok(eigenvalues)
}

/// The eigenvalues of a square matrix as they are found. `None` when it is too badly scaled.
pub fn complex(a: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    if a.is_empty() {
        return Some(Vec::new());
    }
    // At multiple eigenvalues the iteration may cycle within a few roundings. For the transpose it takes another path.
    let tolerances = [1.0, 4.0, 16.0, 64.0].map(|roundings| roundings * f64::EPSILON);
    let forms = tolerances.into_iter().flat_map(|eps| [(eps, false), (eps, true)]);
    let counts = [FEW_ITERATIONS * a.nrows(), MOST_ITERATIONS];
    let mut attempts = counts.into_iter().flat_map(|count| forms.clone().map(move |form| (form, count)));
    attempts.find_map(|((eps, is_transposed), count)| {
        let matrix = if is_transposed { a.transpose() } else { a.clone() };
        let found = Schur::try_new(matrix, eps, count)?.complex_eigenvalues();
        let found: Vec<_> = found.iter().copied().collect();
        // A block of two that are almost one may come out as none.
        found.iter().all(|value| value.re.is_finite() && value.im.is_finite()).then_some(found)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oscillator_has_its_natural_frequency_and_damping() {
        // x'' + 2 ζ ω x' + ω² x = 0 with ω = 5 and ζ = 0.2
        let found = eigenvalues(&DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -25.0, -2.0])).unwrap();
        assert_eq!(found.len(), 2);
        for eigenvalue in &found {
            assert!((eigenvalue.frequency - 5.0).abs() < 1e-12 && (eigenvalue.damping.unwrap() - 0.2).abs() < 1e-12);
        }
        assert!((found[0].imaginary - 24.0_f64.sqrt()).abs() < 1e-12 && found[1].imaginary < 0.0);
    }

    #[test]
    fn an_integrator_has_no_damping() {
        let found = eigenvalues(&DMatrix::from_row_slice(2, 2, &[-3.0, 0.0, 0.0, 0.0])).unwrap();
        assert_eq!(found[0], Eigenvalue { real: 0.0, imaginary: 0.0, damping: None, frequency: 0.0 });
        assert_eq!(found[1].damping, Some(1.0));
    }

    #[test]
    fn a_system_without_states_has_no_eigenvalues_and_one_that_is_not_finite_is_refused() {
        assert_eq!(eigenvalues(&DMatrix::zeros(0, 0)), Ok(vec![]));
        assert!(eigenvalues(&DMatrix::from_element(2, 2, f64::NAN)).is_err());
    }

    #[test]
    fn eigenvalues_of_several_times_over_are_found() {
        // (s + a)ⁿ in companion form: roundings spread its roots around −a, to a radius of a ε^(1/n).
        for n in 2..=14_u32 {
            for a in [1e-3, 0.7, 1.0, 3.0, 2e4] {
                let mut companion = DMatrix::from_fn(n as usize, n as usize, |i, j| f64::from(j == i + 1));
                let mut coefficient = 1.0;
                for k in 0..n {
                    coefficient *= f64::from(n - k) / f64::from(k + 1) * a;
                    companion[(n as usize - 1, (n - 1 - k) as usize)] = -coefficient;
                }
                balance_parlett_reinsch(&mut companion);
                let found = complex(&companion).unwrap_or_else(|| panic!("n = {n}, a = {a}"));
                let radius = 10.0 * a * f64::EPSILON.powf(1.0 / f64::from(n));
                assert!(found.iter().all(|lambda| (lambda + a).norm() < radius), "n = {n}, a = {a}: {found:?}");
            }
        }
    }
}
