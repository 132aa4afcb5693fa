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
    0.025_446_043_828_620_757,
    0.129_234_407_200_302_77,
    0.297_077_424_311_301_4,
    0.5,
    0.702_922_575_688_698_5,
    0.870_765_592_799_697_2,
    0.974_553_956_171_379_2,
];
const WEIGHTS: [f64; 7] = [
    0.064_742_483_084_434_85,
    0.139_852_695_744_638_33,
    0.190_915_025_252_559_47,
    0.208_979_591_836_734_7,
    0.190_915_025_252_559_47,
    0.139_852_695_744_638_33,
    0.064_742_483_084_434_85,
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
