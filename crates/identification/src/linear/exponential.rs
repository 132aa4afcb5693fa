//! The matrix exponential with its derivatives in many directions.
//!
//! Scaling and squaring with a Padé approximant of degree 13, differentiated step by step (A. H. Al-Mohy, N. J. Higham,
//! Computing the Fréchet derivative of the matrix exponential, SIAM J. Matrix Anal. Appl. 30 (2009) 1639). A derivative in
//! direction E is the upper right block of exp([M E; 0 M]), and is computed without the zeros of that.

use nalgebra::DMatrix;

/// The largest norm that goes without scaling: backward errors of value and derivative are below rounding.
const THETA: f64 = 4.74;
/// Coefficients of the approximant.
const PADE: [f64; 14] = [
    64764752532480000.0,
    32382376266240000.0,
    7771770303897600.0,
    1187353796428800.0,
    129060195264000.0,
    10559470521600.0,
    670442572800.0,
    33522128640.0,
    1323241920.0,
    40840800.0,
    960960.0,
    16380.0,
    182.0,
    1.0,
];
/// No finite norm that a model has needs more halvings.
const MOST_SQUARINGS: i32 = 60;

/// The powers and polynomials of a matrix that value and derivatives share.
struct Powers {
    m: DMatrix<f64>,
    squares: [DMatrix<f64>; 3],
    /// Inner polynomials of the odd and the even part.
    inner: [DMatrix<f64>; 2],
    /// The odd part without its last factor.
    w: DMatrix<f64>,
}

/// Sum of a polynomial's terms of degree 2, 4 and 6, with the coefficients of these places.
fn combine(squares: &[DMatrix<f64>; 3], places: [usize; 3]) -> DMatrix<f64> {
    &squares[0] * PADE[places[0]] + &squares[1] * PADE[places[1]] + &squares[2] * PADE[places[2]]
}

impl Powers {
    fn new(m: DMatrix<f64>) -> Self {
        let size = m.nrows();
        let second = &m * &m;
        let fourth = &second * &second;
        let sixth = &second * &fourth;
        let squares = [second, fourth, sixth];
        let inner = [combine(&squares, [9, 11, 13]), combine(&squares, [8, 10, 12])];
        let w = &squares[2] * &inner[0] + combine(&squares, [3, 5, 7]) + DMatrix::identity(size, size) * PADE[1];
        Powers { m, squares, inner, w }
    }

    /// The odd and the even part of the numerator.
    fn parts(&self) -> [DMatrix<f64>; 2] {
        let size = self.m.nrows();
        let even = &self.squares[2] * &self.inner[1] + combine(&self.squares, [2, 4, 6]);
        [&self.m * &self.w, even + DMatrix::identity(size, size) * PADE[0]]
    }

    /// Derivatives of these parts in a direction.
    fn derivatives(&self, e: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        let [second, fourth, sixth] = &self.squares;
        let d_second = &self.m * e + e * &self.m;
        let d_fourth = second * &d_second + &d_second * second;
        let d_sixth = fourth * &d_second + &d_fourth * second;
        let d = [d_second, d_fourth, d_sixth];
        let d_inner = [combine(&d, [9, 11, 13]), combine(&d, [8, 10, 12])];
        let d_w = sixth * &d_inner[0] + &d[2] * &self.inner[0] + combine(&d, [3, 5, 7]);
        let d_even = sixth * &d_inner[1] + &d[2] * &self.inner[1] + combine(&d, [2, 4, 6]);
        [&self.m * d_w + e * &self.w, d_even]
    }
}

/// exp(M), and its derivatives in the directions. `None` where M isn't finite or far too large.
pub fn exponential(m: &DMatrix<f64>, directions: &[DMatrix<f64>]) -> Option<(DMatrix<f64>, Vec<DMatrix<f64>>)> {
    let norm = m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    if !m.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let squarings = if norm > THETA { (norm / THETA).log2().ceil() as i32 } else { 0 };
    if squarings > MOST_SQUARINGS {
        return None;
    }
    let factor = 0.5_f64.powi(squarings);
    let powers = Powers::new(m * factor);
    let [odd, even] = powers.parts();
    let denominator = (&even - &odd).lu();
    let mut value = denominator.solve(&(&even + &odd))?;
    let mut derivatives = Vec::with_capacity(directions.len());
    for direction in directions {
        let [d_odd, d_even] = powers.derivatives(&(direction * factor));
        let right = &d_odd + &d_even + (&d_odd - &d_even) * &value;
        derivatives.push(denominator.solve(&right)?);
    }
    for _ in 0..squarings {
        for derivative in &mut derivatives {
            *derivative = &value * &*derivative + &*derivative * &value;
        }
        value = &value * &value;
    }
    value.iter().all(|entry| entry.is_finite()).then_some((value, derivatives))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oscillator_turns_and_its_derivative_follows_the_angle() {
        // exp([0 a; -a 0]) is the rotation by a; its derivative in a is the rotation's. Large angles take squarings.
        for a in [0.0_f64, 0.3, 3.0, 40.0] {
            let turn = DMatrix::from_row_slice(2, 2, &[0.0, a, -a, 0.0]);
            let direction = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, 0.0]);
            let (value, derivatives) = exponential(&turn, &[direction]).unwrap();
            let expected = DMatrix::from_row_slice(2, 2, &[a.cos(), a.sin(), -a.sin(), a.cos()]);
            let slope = DMatrix::from_row_slice(2, 2, &[-a.sin(), a.cos(), -a.cos(), -a.sin()]);
            assert!((value - expected).amax() < 1e-13, "{a}");
            assert!((&derivatives[0] - slope).amax() < 1e-12, "{a}");
        }
    }

    #[test]
    fn a_derivative_is_the_upper_right_block_of_the_block_exponential() {
        let m = DMatrix::from_fn(4, 4, |i, j| ((i * 7 + j * 3) as f64).sin());
        let e = DMatrix::from_fn(4, 4, |i, j| ((i * 2 + j * 5) as f64).cos());
        let mut block = DMatrix::zeros(8, 8);
        block.view_mut((0, 0), (4, 4)).copy_from(&m);
        block.view_mut((4, 4), (4, 4)).copy_from(&m);
        block.view_mut((0, 4), (4, 4)).copy_from(&e);
        let whole = exponential(&block, &[]).unwrap().0;
        let derivative = &exponential(&m, &[e]).unwrap().1[0];
        assert!((whole.view((0, 4), (4, 4)) - derivative).amax() < 1e-13 * derivative.amax());
    }

    #[test]
    fn what_is_not_finite_has_none() {
        assert!(exponential(&DMatrix::from_element(1, 1, f64::NAN), &[]).is_none());
        assert!(exponential(&DMatrix::from_element(1, 1, 1e300), &[]).is_none());
    }
}
