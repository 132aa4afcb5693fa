//! Poles of an estimated model, with what the uncertainty of its entries does to them.

use nalgebra::{Complex, DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::layout::{Layout, Place};
use crate::linear::{eigenvalues, null_vector};

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
    let mut found = eigenvalues(a).unwrap_or_default();
    found.sort_by(|p, q| p.norm().total_cmp(&q.norm()).then(q.im.total_cmp(&p.im)));
    let of = |value: &Complex<f64>| Pole {
        real: value.re,
        imaginary: value.im,
        covariance: covariance_of(a, *value, layout, covariance).unwrap_or([f64::INFINITY; 3]),
    };
    found.iter().map(of).collect()
}

/// ∂λ/∂A = w vᵀ / (wᵀ v) of right and left eigenvectors v and w.
fn derivative(a: &DMatrix<f64>, value: Complex<f64>) -> Option<DMatrix<Complex<f64>>> {
    let n = a.nrows();
    // A little beside the eigenvalue, where the matrix can be inverted.
    let beside = value + Complex::new(1e-10, 0.7e-10) * a.norm().max(f64::MIN_POSITIVE);
    let shifted =
        DMatrix::from_fn(n, n, |i, j| Complex::new(a[(i, j)], 0.0) - if i == j { beside } else { Complex::ZERO });
    let (right, left) = (null_vector(&shifted)?, null_vector(&shifted.transpose())?);
    let product = left.dot(&right);
    (product.norm() > 1e-14).then(|| left * right.transpose() / product)
}

fn covariance_of(
    a: &DMatrix<f64>,
    value: Complex<f64>,
    layout: &Layout,
    covariance: &DMatrix<f64>,
) -> Option<[f64; 3]> {
    let slope = derivative(a, value)?;
    let part = |unknown: &crate::layout::Unknown, real: bool| match unknown.place {
        Place::A(i, j) if real => slope[(i, j)].re,
        Place::A(i, j) => slope[(i, j)].im,
        _ => 0.0,
    };
    let vector = |real: bool| DVector::from_iterator(layout.count(), layout.unknowns.iter().map(|u| part(u, real)));
    let (re, im) = (vector(true), vector(false));
    let form = |p: &DVector<f64>, q: &DVector<f64>| p.dot(&(covariance * q));
    Some([form(&re, &re), form(&im, &im), form(&re, &im)])
}
