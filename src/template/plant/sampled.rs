//! A plant that was sampled behind a zero-order hold, in continuous time.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix};
use serde_json::Value;

use crate::eigenvalues;
use crate::error::{Invalid, Number};
use crate::mathematics::logarithm::logarithm;

/// A matrix whose least singular value is so small a part of the largest is singular but for rounding.
const SINGULAR: f64 = 1e-13;
/// An eigenvalue within this angle of the negative real axis, rad, is on it.
const ON_AXIS: f64 = 1e-6;
/// The exponential of what was found may differ so much from what was given.
const PRECISION: f64 = 1e-9;

/// The sample time of a plant's file, s; none of one in continuous time.
///
/// # Errors
/// A value that is no time.
pub fn sample_time(value: Option<&Value>) -> Result<Option<f64>, Invalid> {
    let Some(value) = value.filter(|value| !value.is_null()) else { return Ok(None) };
    match value.as_f64() {
        Some(0.0) => Ok(None),
        Some(dt) if dt > 0.0 => Ok(Some(dt)),
        Some(dt) => Err(Invalid::new("dt", Number(dt), "must be a sample time above 0, in s")),
        None => Err(Invalid::because("dt: must be a number, the sample time in s")),
    }
}

/// A and B in continuous time, from those of the plant sampled every dt s behind a zero-order hold.
///
/// # Errors
/// Why no system in continuous time has these.
pub fn continuous(A: &DMatrix<f64>, B: &DMatrix<f64>, dt: f64) -> Result<[DMatrix<f64>; 2], Invalid> {
    let (n, m) = (A.nrows(), B.ncols());
    let mut balanced = A.clone();
    let extreme = || Invalid::because("A, B: the entries differ by too many powers of ten");
    if !(A.norm_squared() + B.norm_squared()).is_finite() {
        return Err(extreme());
    }
    let scales = balance_parlett_reinsch(&mut balanced);
    check(&balanced, dt)?;
    let own = DMatrix::from_diagonal(&scales);
    let other = DMatrix::from_diagonal(&scales.map(f64::recip));
    // Inputs of like size: powers of two round nothing.
    let inputs = &other * B;
    let size = if inputs.amax() > 0.0 { inputs.amax().log2().round().exp2() } else { 1.0 };
    let mut block = DMatrix::identity(n + m, n + m);
    block.view_mut((0, 0), (n, n)).copy_from(&balanced);
    block.view_mut((0, n), (n, m)).copy_from(&(inputs / size));
    let found = logarithm(&block).filter(|found| (found.exp() - &block).norm() <= PRECISION * block.norm());
    let mut rates = found.ok_or_else(extreme)? / dt;
    let rounding = ((n + m) as f64 * f64::EPSILON) / dt;
    rates.iter_mut().filter(|entry| entry.abs() <= rounding).for_each(|entry| *entry = 0.0);
    let (A, B) = (rates.view((0, 0), (n, n)), rates.view((0, n), (n, m)));
    Ok([&own * A * &other, &own * B * size])
}

/// Refuses a matrix without a principal logarithm.
fn check(A: &DMatrix<f64>, dt: f64) -> Result<(), Invalid> {
    let sizes = A.singular_values();
    if sizes.min() <= SINGULAR * sizes.max() {
        return Err(Invalid::because(
            "A has an eigenvalue at 0, which no plant in continuous time has when it is sampled: the model has a dead time. Leave \
             it out of the model and give it as delay, in s",
        ));
    }
    let found = eigenvalues::complex(A)
        .ok_or_else(|| Invalid::because("A is too badly scaled: its eigenvalues can't be found"))?;
    let is_negative = |value: &&Complex<f64>| value.arg().abs() > std::f64::consts::PI - ON_AXIS;
    found.iter().find(is_negative).map_or(Ok(()), |value| {
        Err(Invalid::because(format!(
            "A has the eigenvalue {} on the negative real axis, which no plant in continuous time has when it is sampled: the \
             plant was sampled too slowly, at dt = {} s, or the model has noise in place of a fast pole. Identify it with a \
             shorter sample time or a lower order",
            Number(value.re),
            Number(dt)
        )))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::Plant;

    /// Random numbers within ±1.
    fn random() -> impl FnMut() -> f64 {
        let mut seed = 1_u64;
        move || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    /// The sampled plant behind a zero-order hold, by the power series of the exponential and its integral.
    fn sampled(A: &DMatrix<f64>, B: &DMatrix<f64>, dt: f64) -> [DMatrix<f64>; 2] {
        let n = A.nrows();
        let (mut term, mut exponential, mut integral) =
            (DMatrix::identity(n, n), DMatrix::identity(n, n), DMatrix::identity(n, n) * dt);
        for k in 1..60 {
            term = &term * A * (dt / f64::from(k));
            exponential += &term;
            integral += &term * (dt / f64::from(k + 1));
        }
        [exponential, integral * B]
    }

    #[test]
    fn random_plants_come_back_from_sampling() {
        let mut random = random();
        for n in 1..=6 {
            for m in 1..=2 {
                for _ in 0..10 {
                    let A = DMatrix::from_fn(n, n, |_, _| 2.0 * random());
                    let B = DMatrix::from_fn(n, m, |_, _| 1e3 * random());
                    let dt = 0.1 + 0.09 * random();
                    let [discrete, of_inputs] = sampled(&A, &B, dt);
                    let [found, inputs] = continuous(&discrete, &of_inputs, dt).unwrap();
                    assert!((&found - &A).norm() <= 1e-9 * A.norm(), "{A} {found}");
                    assert!((&inputs - &B).norm() <= 1e-9 * B.norm(), "{B} {inputs}");
                }
            }
        }
    }

    #[test]
    fn integrators_and_states_of_any_unit_come_back_from_sampling() {
        let (dt, B) = (1e-3, DMatrix::from_row_slice(3, 1, &[0.0, 0.0, 5e-4]));
        let A = DMatrix::from_row_slice(3, 3, &[0.0, 1e6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, -40.0]);
        let [discrete, of_inputs] = sampled(&A, &B, dt);
        let [found, inputs] = continuous(&discrete, &of_inputs, dt).unwrap();
        let units = [1e6, 1.0, 1e6];
        for i in 0..3 {
            let near = |found: f64, given: f64, size: f64| (found - given).abs() <= 1e-9 * size;
            assert!(near(inputs[i] / units[i], B[i] / units[i], 1e-9), "{inputs}");
            assert!(
                (0..3).all(|j| near(found[(i, j)] * units[j] / units[i], A[(i, j)] * units[j] / units[i], 40.0)),
                "{found}"
            );
        }
    }

    #[test]
    fn the_hold_is_half_a_step_of_dead_time() {
        let plant = Plant::parse(r#"{"A": 0.9, "B": [1, 2], "C": 1, "delay": [0, 0.1], "dt": 0.02}"#).unwrap();
        assert_eq!(plant.delay, [0.01, 0.11]);
        assert!((plant.A[(0, 0)] - 50.0 * 0.9_f64.ln()).abs() < 1e-12);
        let plant = Plant::parse(r#"{"num": [0.1], "den": [1, -0.9], "dt": 0.02}"#).unwrap();
        assert!((plant.A[(0, 0)] - 50.0 * 0.9_f64.ln()).abs() < 1e-12 && plant.delay == [0.01]);
        let gain = -plant.C[(0, 0)] * plant.B[(0, 0)] / plant.A[(0, 0)];
        assert!((gain - 1.0).abs() < 1e-12, "{gain}");
        let plant = Plant::parse(r#"{"A": -0.9, "B": 1, "C": 1, "dt": 0}"#).unwrap();
        assert!(plant.delay.is_empty() && plant.A[(0, 0)] == -0.9);
    }

    #[test]
    fn what_no_plant_in_continuous_time_gives_is_refused() {
        for (json, named) in [
            (r#"{"A": [[0, 1], [0, 0.5]], "B": [0, 1], "C": [1, 0], "dt": 0.1}"#, "give it as delay"),
            (r#"{"num": [1], "den": [1, -0.5, 0, 0, 0, 0, 0], "dt": 0.1}"#, "give it as delay"),
            (
                r#"{"A": [[0.5, 0], [0, -0.2]], "B": [1, 1], "C": [1, 0], "dt": 0.1}"#,
                "the eigenvalue -0.2 on the negative real axis",
            ),
            (
                r#"{"A": [[-0.2, 1], [0, -0.2]], "B": [1, 1], "C": [1, 0], "dt": 0.1}"#,
                "sampled too slowly, at dt = 0.1 s",
            ),
            (r#"{"A": 0.5, "B": 1, "C": 1, "dt": -1}"#, "dt = -1: must be a sample time above 0"),
            (r#"{"A": 0.5, "B": 1, "C": 1, "dt": true}"#, "dt: must be a number"),
        ] {
            let refused = Plant::parse(json).unwrap_err().to_string();
            assert!(refused.contains(named), "{json}: {refused}");
        }
    }
}
