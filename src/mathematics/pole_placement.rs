//! Placing the poles of A − B K.
//!
//! D. G. Luenberger, Canonical forms for linear multivariable systems, IEEE Trans. Automatic Control 12 (1967)
//! 290–293. Each input heads a chain of states b, A b, A² b, …; each chain gets poles of its own.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix, DVector, RowDVector};

use crate::error::Invalid;
use crate::mathematics::balanced::balance;

/// Smallest rest of a vector outside the states already reached, relative to ‖A‖ or ‖b‖, that counts as nonzero.
const REACHED: f64 = 1e-12;

/// Largest relative deviation of the characteristic polynomial of A − B K from the one asked for, at points as far from
/// the poles as these are from the imaginary axis.
const ACCURACY: f64 = 1e-6;

/// K such that A − B K has these poles: the poles of the first input's chain first, then those of the second, and so
/// on, conjugates adjacent. A chain is as long as its input's controllability index ([`controllability_indices`]).
///
/// The gain is unique: chains stay decoupled where the plant's are, so that row i of K is (re² + im², −2 re) on the
/// position and rate of a double integrator driven by input i.
///
/// The gain of an observer, A − L C, is L = place(Aᵀ, Cᵀ, poles)ᵀ.
///
/// # Errors
/// [`Invalid`] when (A, B) isn't controllable, the columns of B depend on each other, a pole isn't left of the
/// imaginary axis or stands apart from its conjugate, or the poles would be missed by rounding.
pub fn place(A: &DMatrix<f64>, B: &DMatrix<f64>, poles: &[Complex<f64>]) -> Result<DMatrix<f64>, Invalid> {
    place_as_given(A, B, poles).or_else(|reason| {
        let Some((A, B, scales)) = balanced(A, B) else { return Err(reason) };
        let K = place_as_given(&A, &B, poles).map_err(|_| reason)?;
        Ok(DMatrix::from_fn(K.nrows(), K.ncols(), |i, j| K[(i, j)] / scales[j]))
    })
}

/// A and B with states of like size, where the units that they are given in are far from it: what is right as it is given
/// keeps its digits. `None` where there is nothing to balance.
fn balanced(A: &DMatrix<f64>, B: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>, Vec<f64>)> {
    let fits = A.is_square() && A.nrows() == B.nrows() && A.iter().chain(B.iter()).all(|entry| entry.is_finite());
    if !fits {
        return None;
    }
    let (A, B, _, scales) = balance(A, B, &DMatrix::zeros(0, A.nrows()));
    scales.iter().any(|&scale| scale != 1.0).then_some((A, B, scales))
}

fn place_as_given(A: &DMatrix<f64>, B: &DMatrix<f64>, poles: &[Complex<f64>]) -> Result<DMatrix<f64>, Invalid> {
    let indices = indices_as_given(A, B)?;
    require_usable(poles, &indices)?;
    let too_bad = || {
        Invalid::because("A, B: too near to uncontrollable, or too badly scaled, for these poles in double precision")
    };
    let chain_inverse = chains(A, B, &indices).try_inverse().ok_or_else(too_bad)?;
    let (n, m) = B.shape();
    // Row q of the inverse is blind to every state of the chains but the last one of its own: with z = q x, the
    // derivatives of z below the index don't see the input, and the one of that order does, by the matrix M.
    let mut M = DMatrix::zeros(m, m);
    let mut closed = DMatrix::zeros(m, n);
    let mut end = 0;
    for (i, &index) in indices.iter().enumerate() {
        let of_chain = &poles[end..end + index];
        end += index;
        let q = chain_inverse.row(end - 1).into_owned();
        let highest = (1..index).fold(q.clone(), |row, _| row * A);
        M.set_row(i, &(highest * B));
        closed.set_row(i, &times_polynomial(q, A, of_chain));
    }
    let K = M.lu().solve(&closed).ok_or_else(too_bad)?;
    let error = characteristic_error(A - B * &K, poles);
    if error <= ACCURACY { Ok(K) } else { Err(too_bad()) }
}

/// For each input, how many states its chain b, A b, A² b, … adds to those that the chains have reached before, taking
/// the inputs in turn.
///
/// # Errors
/// [`Invalid`] when the sizes don't fit, an entry isn't finite, some state is out of reach or an input adds nothing.
pub fn controllability_indices(A: &DMatrix<f64>, B: &DMatrix<f64>) -> Result<Vec<usize>, Invalid> {
    indices_as_given(A, B).or_else(|reason| {
        let Some((A, B, _)) = balanced(A, B) else { return Err(reason) };
        indices_as_given(&A, &B).map_err(|_| reason)
    })
}

fn indices_as_given(A: &DMatrix<f64>, B: &DMatrix<f64>) -> Result<Vec<usize>, Invalid> {
    let (n, m) = B.shape();
    if A.shape() != (n, n) || m == 0 {
        let sizes = format!("{} x {}, {n} x {m}", A.nrows(), A.ncols());
        return Err(Invalid::new("sizes of A, B", sizes, "must be n x n and n x m"));
    }
    if let Some(entry) = A.iter().chain(B.iter()).find(|entry| !entry.is_finite()) {
        return Err(Invalid::new("an entry of A or B", entry, "must be finite"));
    }
    let size = A.norm();
    let mut indices = vec![0; m];
    let mut reached: Vec<DVector<f64>> = Vec::new();
    let mut heads: Vec<_> = B.column_iter().map(|b| Some((b.into_owned(), b.norm()))).collect();
    while heads.iter().any(Option::is_some) {
        for (head, index) in heads.iter_mut().zip(&mut indices) {
            let Some((mut v, scale)) = head.take() else { continue };
            // Twice: once leaves the rounding of the larger parts.
            for w in reached.iter().chain(&reached) {
                v -= w * w.dot(&v);
            }
            let left = v.norm();
            if left > REACHED * scale && reached.len() < n {
                v /= left;
                *head = Some((A * &v, size));
                reached.push(v);
                *index += 1;
            }
        }
    }
    if reached.len() < n {
        let allowed = format!("must be {n} for (A, B) to be controllable: the inputs can't move every state");
        return Err(Invalid::new("rank of [B, A B, A^2 B, …]", reached.len(), allowed));
    }
    if let Some(i) = indices.iter().position(|&index| index == 0) {
        let allowed = "must not be a combination of the columns before it";
        return Err(Invalid::new(format!("column {} of B", i + 1), format!("{:?}", B.column(i).as_slice()), allowed));
    }
    Ok(indices)
}

/// The chains side by side: b_1, A b_1, …, b_2, A b_2, …
fn chains(A: &DMatrix<f64>, B: &DMatrix<f64>, indices: &[usize]) -> DMatrix<f64> {
    let mut columns = Vec::with_capacity(A.ncols());
    for (i, &index) in indices.iter().enumerate() {
        columns.push(B.column(i).into_owned());
        for _ in 1..index {
            columns.push(A * &columns[columns.len() - 1]);
        }
    }
    DMatrix::from_columns(&columns)
}

/// q p(A) for the polynomial p with these roots, factor by factor.
pub(crate) fn times_polynomial(q: RowDVector<f64>, A: &DMatrix<f64>, roots: &[Complex<f64>]) -> RowDVector<f64> {
    let mut row = q;
    let mut k = 0;
    while k < roots.len() {
        let root = roots[k];
        let next = &row * A;
        if root.im == 0.0 {
            row = next - row * root.re;
            k += 1;
        } else {
            row = &next * A - next * (2.0 * root.re) + row * root.norm_sqr();
            k += 2;
        }
    }
    row
}

/// Refuses poles that chains of these lengths can't have.
fn require_usable(poles: &[Complex<f64>], indices: &[usize]) -> Result<(), Invalid> {
    let n: usize = indices.iter().sum();
    if poles.len() != n {
        return Err(Invalid::new("number of poles", poles.len(), format!("must be {n}, one for each state")));
    }
    let mut end = 0;
    for &index in indices {
        let mut k = end;
        end += index;
        while k < end {
            let pole = poles[k];
            let refuse = |allowed: String| Err(Invalid::new(format!("pole {}", k + 1), text(pole), allowed));
            if !(pole.re.is_finite() && pole.im.is_finite() && pole.re < 0.0) {
                return refuse("must be finite and have a negative real part".into());
            }
            if pole.im == 0.0 {
                k += 1;
                continue;
            }
            if poles.get(k + 1) != Some(&pole.conj()) {
                return refuse("must be followed by its conjugate".into());
            }
            if k + 1 == end {
                return refuse(format!(
                    "must be in the same chain as its conjugate; the inputs' chains have {indices:?} poles, in this \
                     order"
                ));
            }
            k += 2;
        }
    }
    Ok(())
}

/// Largest relative difference between det(sI − A) and the polynomial with these roots in the left half plane, at
/// their mirror images in the right one, where no factor is small.
fn characteristic_error(mut A: DMatrix<f64>, roots: &[Complex<f64>]) -> f64 {
    // Balancing needs squares of the entries, and never ends where these aren't finite.
    if !A.norm_squared().is_finite() {
        return f64::INFINITY;
    }
    balance_parlett_reinsch(&mut A);
    let A = A.map(Complex::from);
    let error = |root: &Complex<f64>| {
        let s = -root.conj();
        // Factor by factor, as the product itself may overflow.
        let lu = (DMatrix::identity(A.nrows(), A.nrows()) * s - &A).lu();
        let mut ratio = lu.p().determinant::<Complex<f64>>();
        for (pivot, root) in lu.u().diagonal().iter().zip(roots) {
            ratio *= pivot / (s - root);
        }
        (ratio - 1.0).norm()
    };
    // A comparison that isn't a number must not pass.
    roots.iter().map(error).fold(0.0, |largest, e| if e <= largest { largest } else { e })
}

fn text(pole: Complex<f64>) -> String {
    let sign = if pole.im < 0.0 { '-' } else { '+' };
    format!("{} {sign} {}j", pole.re, pole.im.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(re: f64, im: f64) -> [Complex<f64>; 2] {
        [Complex::new(re, im), Complex::new(re, -im)]
    }

    fn real(poles: &[f64]) -> Vec<Complex<f64>> {
        poles.iter().map(|&p| p.into()).collect()
    }

    fn assert_close(K: &DMatrix<f64>, expected: &[f64], tolerance: f64) {
        let expected = DMatrix::from_row_slice(K.nrows(), K.ncols(), expected);
        assert!((K - &expected).amax() <= tolerance * expected.amax(), "{K}");
    }

    /// q_i' = q'_i, q''_i = u_i with the state (q, q').
    fn integrators(m: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let mut A = DMatrix::zeros(2 * m, 2 * m);
        A.view_mut((0, m), (m, m)).fill_with_identity();
        let mut B = DMatrix::zeros(2 * m, m);
        B.view_mut((m, 0), (m, m)).fill_with_identity();
        (A, B)
    }

    #[test]
    fn each_double_integrator_gets_its_own_pair() {
        let (A, B) = integrators(2);
        let K = place(&A, &B, &[pair(-300.0, 5.0), pair(-400.0, 5.0)].concat()).unwrap();
        assert_eq!(K, DMatrix::from_row_slice(2, 4, &[90025.0, 0.0, 600.0, 0.0, 0.0, 160025.0, 0.0, 800.0]));
        let (A, B) = integrators(6);
        let poles: Vec<_> = [9.0, 10.5, 12.0, 13.5, 15.0, 16.5].iter().flat_map(|re| pair(-re, 0.1)).collect();
        let K = place(&A, &B, &poles).unwrap();
        assert_eq!((K[(2, 2)], K[(2, 8)], K[(2, 3)]), (12.0_f64 * 12.0 + 0.1 * 0.1, 24.0, 0.0));
    }

    /// State (psi, psi', phi, phi', tau1, tau2) of a twin rotor.
    fn twin_rotor() -> (DMatrix<f64>, DMatrix<f64>) {
        let mut A = DMatrix::zeros(6, 6);
        (A[(0, 1)], A[(1, 0)], A[(1, 1)], A[(1, 4)]) = (1.0, -0.32 / 0.068, -0.006 / 0.068, 0.0924 / 0.068);
        (A[(2, 3)], A[(3, 3)], A[(3, 5)]) = (1.0, -0.1 / 0.02, 0.09 / 0.02);
        (A[(4, 4)], A[(5, 5)]) = (-1.0 / 1.1, -1.0);
        let mut B = DMatrix::zeros(6, 2);
        (B[(4, 0)], B[(5, 1)]) = (1.0, 0.8);
        (A, B)
    }

    #[test]
    fn the_poles_of_each_axis_of_a_twin_rotor_are_placed_on_that_axis() {
        let (A, B) = twin_rotor();
        let K = place(&A, &B, &real(&[-15.0, -17.0, -20.0, -15.0, -17.0, -20.0])).unwrap();
        // control.acker (python-control 0.10.2) on each separate axis.
        let psi = [3573.4657499363384, 651.823911382735, 0.0, 0.0, 51.00267379679145, 0.0];
        let phi = [0.0, 0.0, 1416.6666666666667, 183.33333333333334, 0.0, 57.5];
        assert_close(&K, &[psi, phi].concat(), 1e-12);
        assert!((0..6).all(|j| (K[(0, j)] == 0.0) == (psi[j] == 0.0)), "no cross gain: {K}");
    }

    #[test]
    fn the_gain_of_a_single_input_is_the_known_one() {
        let A = DMatrix::from_row_slice(3, 3, &[1.0, 2.0, -1.0, 0.0, -3.0, 4.0, 2.0, 1.0, 0.5]);
        let B = DMatrix::from_row_slice(3, 1, &[1.0, 0.0, 2.0]);
        let K = place(&A, &B, &[real(&[-2.0]), pair(-3.0, 1.0).to_vec()].concat()).unwrap();
        // scipy.signal.place_poles and control.acker.
        assert_close(&K, &[5.444444444444444, 2.763888888888889, 0.5277777777777778], 1e-12);
    }

    #[test]
    fn coupled_chains_get_the_gain_of_exact_arithmetic() {
        // Both by the same form in exact rational arithmetic (sympy); the closed loop's poles checked with numpy.
        let A = [1.0, 2.0, 0.0, 1.0, 0.0, -1.0, 1.0, 3.0, 2.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, -2.0];
        let B = [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 2.0];
        let (A, B) = (DMatrix::from_row_slice(4, 4, &A), DMatrix::from_row_slice(4, 2, &B));
        let K = place(&A, &B, &[pair(-2.0, 1.0).to_vec(), real(&[-3.0, -6.0])].concat()).unwrap();
        let expected = [-99.0, 5.0, -122.0, -7.0, 152.0, 2.0, 240.0, 51.0].map(|k| k / 21.0);
        assert_close(&K, &expected, 1e-12);

        // Chains of three and one.
        let A = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, -1.0, 2.0, 1.0, 1.0, 2.0, 0.0, -1.0];
        let B = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 2.0];
        let (A, B) = (DMatrix::from_row_slice(4, 4, &A), DMatrix::from_row_slice(4, 2, &B));
        assert_eq!(controllability_indices(&A, &B).unwrap(), [3, 1]);
        let K = place(&A, &B, &[pair(-1.0, 3.0).to_vec(), real(&[-4.0, -2.0])].concat()).unwrap();
        assert_close(&K, &[42.5, 17.0, 8.0, 0.5, -1.5, 0.0, 0.0, 0.5], 1e-12);
    }

    #[test]
    fn any_controllable_pair_gets_its_poles() {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for (n, m) in [(1, 1), (3, 1), (4, 2), (5, 2), (6, 3), (7, 4), (8, 2)] {
            let (A, B) = (DMatrix::from_fn(n, n, |_, _| random()), DMatrix::from_fn(n, m, |_, _| random()));
            let mut poles: Vec<_> = (0..n).map(|k| -1.0 - 0.5 * k as f64).collect();
            let K = place(&A, &B, &real(&poles)).unwrap();
            if (n, m) == (8, 2) {
                // So close to uncontrollable that the closed loop's eigenvalues prove less than the gain itself, here
                // by mpmath with 60 digits.
                let first = [448.09722082577538, -46.3331844679965, -16.487348092201954, -134.52610033566446];
                assert_close(&K.view((0, 0), (1, 4)).into_owned(), &first, 1e-12);
                continue;
            }
            let mut found: Vec<_> = (A - B * K).complex_eigenvalues().iter().map(|lambda| lambda.re).collect();
            found.sort_by(f64::total_cmp);
            poles.sort_by(f64::total_cmp);
            assert!(found.iter().zip(&poles).all(|(f, p)| (f - p).abs() < 1e-10), "{n}, {m}: {found:?}");
        }
    }

    #[test]
    fn an_observer_gets_its_poles_by_duality() {
        // The characteristic polynomial of A − L C is s² + l1 s + l2.
        let A = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
        let C = DMatrix::from_row_slice(1, 2, &[1.0, 0.0]);
        let L = place(&A.transpose(), &C.transpose(), &pair(-4.0, 48.0_f64.sqrt())).unwrap().transpose();
        assert_close(&L, &[8.0, 64.0], 1e-14);
    }

    #[test]
    fn a_state_that_no_input_moves_is_named_by_the_rank() {
        let (A, B) = integrators(2);
        let message = place(&A, &B.columns(0, 1).into_owned(), &real(&[-1.0; 4])).unwrap_err().to_string();
        assert!(message.contains("= 2: must be 4") && message.contains("controllable"), "{message}");
        // Two first-order systems driven alike, and equal but for rounding.
        let A = DMatrix::from_row_slice(2, 2, &[-0.3, 0.0, 0.0, -0.1 - 0.2]);
        let message = place(&A, &DMatrix::from_element(2, 1, 0.7), &real(&[-1.0; 2])).unwrap_err().to_string();
        assert!(message.contains("= 1: must be 2"), "{message}");
    }

    #[test]
    fn inputs_that_do_the_same_are_refused() {
        let (A, _) = integrators(1);
        let B = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 1.0, 3.0]);
        let message = place(&A, &B, &real(&[-1.0; 2])).unwrap_err().to_string();
        assert!(message.contains("column 2 of B = [0.0, 3.0]"), "{message}");
    }

    #[test]
    fn poles_that_cannot_be_placed_are_named() {
        let (A, B) = integrators(2);
        let refused = |poles: &[Complex<f64>]| place(&A, &B, poles).unwrap_err().to_string();
        assert!(refused(&real(&[-1.0; 3])).contains("number of poles = 3: must be 4"));
        let apart = [pair(-1.0, 2.0), pair(-3.0, 2.0)].concat();
        let apart = [apart[0], apart[2], apart[1], apart[3]];
        assert!(refused(&apart).contains("pole 1 = -1 + 2j: must be followed by its conjugate"), "{}", refused(&apart));
        let straddling = [&real(&[-1.0])[..], &pair(-3.0, -2.0), &real(&[-1.0])].concat();
        let message = refused(&straddling);
        assert!(message.contains("pole 2 = -3 - 2j: must be in the same chain") && message.contains("[2, 2]"));
        for unusable in [f64::NAN, f64::NEG_INFINITY, 0.0, 2.0] {
            let message = refused(&real(&[-1.0, -1.0, -1.0, unusable]));
            assert!(message.contains("pole 4 =") && message.contains("negative real part"), "{message}");
        }
    }

    #[test]
    fn a_matrix_that_is_no_number_or_does_not_fit_is_refused() {
        let (mut A, B) = integrators(1);
        let message = place(&A, &DMatrix::zeros(3, 1), &real(&[-1.0; 2])).unwrap_err().to_string();
        assert!(message.contains("sizes of A, B = 2 x 2, 3 x 1"), "{message}");
        A[(1, 1)] = f64::NAN;
        assert!(place(&A, &B, &real(&[-1.0; 2])).unwrap_err().to_string().contains("NaN: must be finite"));
    }

    #[test]
    fn poles_that_rounding_would_miss_are_refused() {
        // Eight lags driven alike, with rates one percent apart: controllable, with gains of 1e14.
        let A = DMatrix::from_fn(8, 8, |i, j| if i == j { -(1.0 + 0.01 * i as f64) } else { 0.0 });
        let poles: Vec<_> = (0..8).map(|k| -(1.0 + f64::from(k))).collect();
        let message = place(&A, &DMatrix::from_element(8, 1, 1.0), &real(&poles)).unwrap_err().to_string();
        assert!(message.contains("too near to uncontrollable"), "{message}");
    }
}
