//! A transfer function as a plant of one input and one output.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde_json::{Map, Value};

use super::MOST;
use crate::error::Invalid;

/// The controllable companion form of num/den, coefficients from the highest power down: A, B, C and D. States have the unit of
/// the output, for time in units of the mean pole. With a sample time, num and den are polynomials in z; the form is that of
/// δ = (z − 1)/dt, whose states are nearly those in continuous time.
///
/// # Errors
/// Coefficients that are missing or make no proper transfer function.
pub fn read(table: &Map<String, Value>, dt: Option<f64>) -> Result<[DMatrix<f64>; 4], Invalid> {
    if let Some(key) =
        ["A", "B", "C", "D"].into_iter().find(|key| table.get(*key).is_some_and(|value| !value.is_null()))
    {
        return Err(Invalid::because(format!("{key}: give either A, B, C and D, or num and den")));
    }
    let (num, den) = (coefficients(table, "num")?, coefficients(table, "den")?);
    let n = den.len() - 1;
    if n == 0 || n > MOST as usize {
        return Err(Invalid::new("degree of den", n, format!("must be within 1 … {MOST}")));
    }
    if num.len() > den.len() {
        let allowed = format!("must be at most {n}, the degree of den");
        return Err(Invalid::new("degree of num", num.len() - 1, allowed));
    }
    let matrices = match dt {
        None => companion(&num, &den),
        Some(dt) => {
            let [A, B, C, D] = companion(&in_delta(&num, dt), &in_delta(&den, dt));
            [DMatrix::identity(n, n) + A * dt, B * dt, C, D]
        }
    };
    let extreme = || Invalid::because("num, den: the coefficients differ by too many powers of ten");
    let is_finite = matrices.iter().flat_map(|matrix| matrix.iter()).all(|entry| entry.is_finite());
    if is_finite { Ok(matrices) } else { Err(extreme()) }
}

fn companion(num: &[f64], den: &[f64]) -> [DMatrix<f64>; 4] {
    let (n, rate) = (den.len() - 1, rate(den));
    // Of the power k of s in units of the rate.
    let of = |list: &[f64], k: usize| list.len().checked_sub(k + 1).map_or(0.0, |place| list[place]);
    let scaled = |list: &[f64], k: usize| of(list, k) / den[0] * rate.powi(k as i32 - n as i32);
    let D = scaled(num, n);
    let numerator: Vec<_> = (0..n).map(|k| scaled(num, k) - D * scaled(den, k)).collect();
    let largest = numerator.iter().fold(0.0, |most: f64, entry| most.max(entry.abs()));
    let gain = if largest > 0.0 { largest } else { 1.0 };
    let A = DMatrix::from_fn(n, n, |i, j| match i {
        _ if i == n - 1 => -rate * scaled(den, j),
        _ if j == i + 1 => rate,
        _ => 0.0,
    });
    let B = DMatrix::from_fn(n, 1, |i, _| if i == n - 1 { rate * gain } else { 0.0 });
    let C = DMatrix::from_fn(1, n, |_, j| numerator[j] / gain);
    [A, B, C, DMatrix::from_element(1, 1, D)]
}

/// A polynomial in z = 1 + dt δ as one in δ.
fn in_delta(polynomial: &[f64], dt: f64) -> Vec<f64> {
    let mut shifted = polynomial.to_vec();
    for end in (1..shifted.len()).rev() {
        (1..=end).for_each(|k| shifted[k] += shifted[k - 1]);
    }
    let degree = shifted.len() - 1;
    shifted.iter().enumerate().map(|(place, entry)| entry * dt.powi((degree - place) as i32)).collect()
}

/// The geometric mean of the poles that aren't at 0, as a power of two, so that nothing is rounded; 1 where it is near.
fn rate(den: &[f64]) -> f64 {
    let zeros = den.iter().rev().take_while(|entry| **entry == 0.0).count();
    let last = den.len() - 1 - zeros;
    let mean = ((den[last] / den[0]).abs().log2() / last.max(1) as f64).round();
    if mean.abs() <= 2.0 { 1.0 } else { mean.exp2() }
}

/// Coefficients without leading zeros. python-control has a list in a list.
fn coefficients(table: &Map<String, Value>, key: &str) -> Result<Vec<f64>, Invalid> {
    let Some(mut value) = table.get(key).filter(|value| !value.is_null()) else {
        return Err(Invalid::because(format!("{key} is missing: a transfer function needs num and den")));
    };
    while let Value::Array(list) = value
        && let [inner @ Value::Array(_)] = &list[..]
    {
        value = inner;
    }
    let numbers: Option<Vec<_>> = match value {
        Value::Array(list) => list.iter().map(Value::as_f64).collect(),
        one => one.as_f64().map(|one| vec![one]),
    };
    let allowed = "must be a list of coefficients of one transfer function, the highest power first, as in [1, 0.5, 2]";
    let numbers = numbers.ok_or_else(|| Invalid::because(format!("{key}: {allowed}")))?;
    let numbers: Vec<_> = numbers.into_iter().skip_while(|entry| *entry == 0.0).collect();
    if numbers.is_empty() {
        return Err(Invalid::because(format!("{key}: must have a coefficient other than 0")));
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use nalgebra::Complex;

    use super::*;
    use crate::template::Plant;

    /// G(s) of matrices.
    fn response(plant: &Plant, s: Complex<f64>) -> Complex<f64> {
        let n = plant.A.nrows();
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        let inner = DMatrix::from_diagonal_element(n, n, s) - complex(&plant.A);
        let D = plant.D.as_ref().map_or(0.0, |D| D[(0, 0)]);
        (complex(&plant.C) * inner.lu().solve(&complex(&plant.B)).unwrap())[(0, 0)] + D
    }

    fn value(polynomial: &[f64], s: Complex<f64>) -> Complex<f64> {
        polynomial.iter().fold(Complex::from(0.0), |sum, entry| sum * s + entry)
    }

    #[test]
    fn a_transfer_function_has_its_own_frequency_response() {
        for (num, den) in [
            (&[3.0][..], &[1.0, 2.0][..]),
            (&[2.0], &[1.0, 0.5, 2.0, 0.0]),
            (&[0.0, 0.0, 1.0, -4.0], &[0.0, 2.0, 0.1, 5.0]),
            (&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0]),
            (&[1e-9, 2e-3], &[1e-12, 3e-7, 1e-2, 40.0]),
            (&[7.0], &[1e-3, 0.0, 0.0]),
        ] {
            let plant = Plant::parse(&format!(r#"{{"num": {num:?}, "den": {den:?}, "delay": 0.5}}"#)).unwrap();
            assert_eq!(plant.delay, [0.5]);
            for s in [1e-2, 1.0, 1e3, 1e5].map(|omega| Complex::new(0.3 * omega, omega)) {
                let (found, expected) = (response(&plant, s), value(num, s) / value(den, s));
                assert!(
                    (found - expected).norm() <= 1e-11 * expected.norm(),
                    "{num:?}/{den:?} at {s}: {found}, {expected}"
                );
            }
        }
    }

    #[test]
    fn states_of_a_plant_without_zeros_are_its_output_and_derivatives() {
        let plant = Plant::parse(r#"{"num": 6, "den": [2, 4, 8]}"#).unwrap();
        assert_eq!(plant.A, DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -4.0, -2.0]));
        assert_eq!(
            (plant.B, plant.C),
            (DMatrix::from_row_slice(2, 1, &[0.0, 3.0]), DMatrix::from_row_slice(1, 2, &[1.0, 0.0]))
        );
    }

    #[test]
    fn a_sampled_transfer_function_is_that_of_the_plant_at_rest_and_at_its_poles() {
        // (s + 3)/(s² + 0.4 s + 4), sampled every 0.05 s behind a zero-order hold, by its poles and residues.
        let (dt, pole) = (0.05, Complex::new(-0.2, 3.96_f64.sqrt()));
        let (z, residue) = ((pole * dt).exp(), (pole + 3.0) / (pole - pole.conj()));
        let sampled = residue * (z - 1.0) / pole;
        let num = [2.0 * sampled.re, -2.0 * (sampled * z.conj()).re];
        let den = [1.0, -2.0 * z.re, z.norm_sqr()];
        let plant = Plant::parse(&format!(r#"{{"num": {num:?}, "den": {den:?}, "dt": {dt}}}"#)).unwrap();
        for s in [Complex::from(0.0), Complex::new(0.0, 1.0), Complex::new(1.0, 7.0)] {
            let expected = (s + 3.0) / (s * s + s * 0.4 + 4.0);
            assert!((response(&plant, s) - expected).norm() < 1e-9, "{s}: {} {}", plant.A, plant.B);
        }
        assert!(plant.A.amax() < 10.0 && plant.D.is_none() && plant.delay == [0.025], "{}", plant.A);
    }

    #[test]
    fn what_is_no_proper_transfer_function_is_refused() {
        for (json, named) in [
            (r#"{"num": [1]}"#, "den is missing"),
            (r#"{"num": [1], "den": [0, 0]}"#, "den: must have a coefficient other than 0"),
            (r#"{"num": [0], "den": [1, 0]}"#, "num: must have a coefficient other than 0"),
            (r#"{"num": [1], "den": [2]}"#, "degree of den = 0"),
            (r#"{"num": [1, 0, 0], "den": [2, 1]}"#, "degree of num = 2: must be at most 1"),
            (r#"{"num": [1, "a"], "den": [2, 1]}"#, "num: must be a list of coefficients"),
            (r#"{"num": [[1], [2]], "den": [2, 1]}"#, "num: must be a list of coefficients"),
            (r#"{"num": [1], "den": [2, 1], "A": 1}"#, "A: give either"),
            (r#"{"num": [1], "den": [1e-300, 1e300, 1]}"#, "too many powers of ten"),
        ] {
            let refused = Plant::parse(json).unwrap_err().to_string();
            assert!(refused.contains(named), "{json}: {refused}");
        }
    }
}
