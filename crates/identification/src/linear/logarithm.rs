//! The principal logarithm of a real matrix.
//!
//! Square roots by the product form of the Denman–Beavers iteration until the matrix is near I, then a Padé approximant in
//! partial fractions (N. J. Higham, Functions of Matrices, SIAM 2008, sections 6.3 and 11.4).

use nalgebra::DMatrix;

use super::eigenvalues;

/// Square roots are taken until the distance to I is below this.
const NEAR: f64 = 0.1;
/// More roots than any sampled model needs.
const MOST_ROOTS: u32 = 40;
const MOST_ITERATIONS: usize = 40;
/// Nodes and weights of Gauss and Legendre on (0, 1): the approximant [7/7].
const NODES: [f64; 7] = [
    0.025446043828620757,
    0.12923440720030277,
    0.29707742431130141,
    0.5,
    0.70292257568869859,
    0.87076559279969723,
    0.97455395617137924,
];
const WEIGHTS: [f64; 7] = [
    0.064742483084434846,
    0.13985269574463833,
    0.19091502525255947,
    0.20897959183673469,
    0.19091502525255947,
    0.13985269574463833,
    0.064742483084434846,
];

/// log(F), real, its eigenvalues' imaginary parts within ±π. `None` where F has an eigenvalue that is 0 or negative.
pub fn logarithm(f: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = f.nrows();
    let found = eigenvalues(f)?;
    let scale = found.iter().map(|value| value.norm()).fold(0.0, f64::max);
    if found.iter().any(|value| value.re <= 0.0 && value.im.abs() <= 1e-9 * scale) {
        return None;
    }
    let identity = DMatrix::identity(size, size);
    let mut root = f.clone();
    let mut roots = 0;
    while (&root - &identity).norm() > NEAR {
        if roots == MOST_ROOTS {
            return None;
        }
        root = square_root(&root)?;
        roots += 1;
    }
    let x = &root - &identity;
    let mut sum = DMatrix::zeros(size, size);
    for (node, weight) in NODES.iter().zip(WEIGHTS) {
        sum += (&identity + &x * *node).lu().solve(&x)? * weight;
    }
    let sum = sum * 2.0_f64.powi(roots as i32);
    sum.iter().all(|entry| entry.is_finite()).then_some(sum)
}

/// The principal square root.
fn square_root(f: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = f.nrows();
    let identity = DMatrix::<f64>::identity(size, size);
    let (mut m, mut x) = (f.clone(), f.clone());
    let mut before = f64::INFINITY;
    for _ in 0..MOST_ITERATIONS {
        let inverse = m.clone().try_inverse()?;
        // The determinant brings the eigenvalues near 1 while they are far.
        let determinant = m.determinant().abs();
        let distance = (&m - &identity).norm();
        let scaling = if distance > 0.1 { determinant.powf(-1.0 / (2.0 * size as f64)) } else { 1.0 };
        let squared = scaling * scaling;
        x = (&x * scaling + &x * &inverse / scaling) * 0.5;
        m = &identity * 0.5 + (&m * squared + inverse / squared) * 0.25;
        let distance = (&m - &identity).norm();
        if !distance.is_finite() {
            return None;
        }
        if distance < 1e-14 * size as f64 || distance < 1e-8 && distance >= 0.5 * before {
            return Some(x);
        }
        before = distance;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::exponential;
    use super::*;

    #[test]
    fn it_inverts_the_exponential() {
        for size in 1..=7 {
            let a = DMatrix::from_fn(size, size, |i, j| 0.6 * ((i * 7 + j * 3 + size) as f64).sin());
            let f = exponential(&a, &[]).unwrap().0;
            assert!((logarithm(&f).unwrap() - a).amax() < 1e-11, "{size}");
        }
    }

    #[test]
    fn stiff_matrices_have_one_too() {
        let a = DMatrix::from_row_slice(3, 3, &[-12.0, 1.0, 0.3, 0.0, -0.01, 1.0, 0.0, -1.0, -0.02]);
        let f = exponential(&a, &[]).unwrap().0;
        assert!((logarithm(&f).unwrap() - a).amax() < 1e-7);
    }

    #[test]
    fn an_eigenvalue_on_the_negative_axis_has_none() {
        assert!(logarithm(&DMatrix::from_row_slice(2, 2, &[-0.5, 0.0, 0.0, 0.5])).is_none());
        assert!(logarithm(&DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 0.5])).is_none());
    }
}
