//! Poles of an estimated model, with what the uncertainty of its entries does to them.

use nalgebra::{Complex, DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::layout::{Layout, Place, Unknown};
use crate::linear::{eigenvalues, null_vector};
use crate::model::{Free, Model};

/// A pole with its covariance, first order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pole {
    /// Real part, 1/s.
    pub real: f64,
    /// Imaginary part, rad/s.
    pub imaginary: f64,
    /// Variances of real and imaginary part, and their covariance.
    pub covariance: [f64; 3],
}

impl Pole {
    /// Its amount, rad/s.
    pub fn frequency(&self) -> f64 {
        self.real.hypot(self.imaginary)
    }

    /// Standard error of the real part.
    pub fn error(&self) -> f64 {
        self.covariance[0].max(0.0).sqrt()
    }

    pub(crate) fn scaled(self, factor: f64) -> Self {
        let [real, imaginary] = [self.real, self.imaginary].map(|part| part * factor);
        Pole { real, imaginary, covariance: self.covariance.map(|part| part * factor * factor) }
    }
}

/// The poles of A, the slowest first, with a layout's entries and their covariance.
pub(crate) fn poles(a: &DMatrix<f64>, layout: &Layout, covariance: &DMatrix<f64>) -> Vec<Pole> {
    let place = |unknown: &Unknown| match unknown.place {
        Place::A(i, j) => Some((i, j)),
        _ => None,
    };
    sorted(a, &layout.unknowns.iter().map(place).collect::<Vec<_>>(), covariance)
}

/// The poles of A, the slowest first, with the covariance of unknowns, some of which are these entries of A.
fn sorted(a: &DMatrix<f64>, places: &[Option<(usize, usize)>], covariance: &DMatrix<f64>) -> Vec<Pole> {
    let mut found = eigenvalues(a).unwrap_or_default();
    found.sort_by(|p, q| p.norm().total_cmp(&q.norm()).then(q.im.total_cmp(&p.im)));
    let of = |value: &Complex<f64>| Pole {
        real: value.re,
        imaginary: value.im,
        covariance: covariance_of(a, *value, places, covariance).unwrap_or([f64::INFINITY; 3]),
    };
    found.iter().map(of).collect()
}

/// The poles of a model, the slowest first, with the covariance that its entries leave.
pub fn poles_of(model: &Model) -> Vec<Pole> {
    let n = model.A.len();
    let a = DMatrix::from_fn(n, n, |i, j| model.A[i][j]);
    let count = model.free.len();
    let covariance = DMatrix::from_fn(count, count, |i, j| model.covariance[i][j]);
    let place = |Free(matrix, row, column): &Free| (matrix == "A").then(|| (row - 1, column - 1));
    sorted(&a, &model.free.iter().map(place).collect::<Vec<_>>(), &covariance)
}

/// ∂λ/∂A = w vᵀ / (wᵀ v) of right and left eigenvectors v and w.
fn derivative(a: &DMatrix<f64>, value: Complex<f64>) -> Option<DMatrix<Complex<f64>>> {
    let n = a.nrows();
    // A little away from the eigenvalue, where the matrix can be inverted.
    let shifted = value + Complex::new(1e-10, 0.7e-10) * a.norm().max(f64::MIN_POSITIVE);
    let shifted =
        DMatrix::from_fn(n, n, |i, j| Complex::new(a[(i, j)], 0.0) - if i == j { shifted } else { Complex::ZERO });
    let (right, left) = (null_vector(&shifted)?, null_vector(&shifted.transpose())?);
    let product = left.dot(&right);
    (product.norm() > 1e-14).then(|| left * right.transpose() / product)
}

fn covariance_of(
    a: &DMatrix<f64>,
    value: Complex<f64>,
    places: &[Option<(usize, usize)>],
    covariance: &DMatrix<f64>,
) -> Option<[f64; 3]> {
    let slope = derivative(a, value)?;
    let vector = |part: fn(Complex<f64>) -> f64| {
        DVector::from_iterator(places.len(), places.iter().map(|place| place.map_or(0.0, |entry| part(slope[entry]))))
    };
    let (re, im) = (vector(|slope| slope.re), vector(|slope| slope.im));
    let form = |p: &DVector<f64>, q: &DVector<f64>| p.dot(&(covariance * q));
    Some([form(&re, &re), form(&im, &im), form(&re, &im)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Scaling;
    use crate::record::Signals;
    use crate::structure::Structure;

    #[test]
    fn the_covariance_of_a_pole_is_that_of_its_derivatives() {
        let a = DMatrix::from_row_slice(3, 3, &[-1.0, 2.0, 0.3, -2.5, -0.4, 0.1, 0.2, 0.6, -3.0]);
        let signals = Signals::new(&["u"], &["x", "y", "z"]);
        let entries = Structure::default().entries(&signals, false).unwrap();
        let layout = Layout::new(&entries, &Scaling { x: vec![1.0; 3], u: vec![1.0], h: 1.0 }, 1);
        // Only one entry is uncertain: its derivative, by differences, is the whole of the standard error.
        for entry in 0..9 {
            let mut covariance = DMatrix::zeros(layout.count(), layout.count());
            covariance[(entry, entry)] = 0.01;
            let moved = |delta: f64| {
                let mut a = a.clone();
                a[(entry / 3, entry % 3)] += delta;
                poles(&a, &layout, &covariance)
            };
            let (above, below, here) = (moved(1e-5), moved(-1e-5), moved(0.0));
            for k in 0..3 {
                let real = (above[k].real - below[k].real) / 2e-5 * 0.1;
                let imaginary = (above[k].imaginary - below[k].imaginary) / 2e-5 * 0.1;
                let expected = [real * real, imaginary * imaginary, real * imaginary];
                for (found, expected) in here[k].covariance.iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-8, "{found} {expected}");
                }
            }
        }
    }
}
