//! Usual magnitudes of signals, which tolerances of their errors are relative to: those of a plant in SI units may be far from 1.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::{Plant, Text, list, round_up, rows};

/// Magnitudes within these are near enough to 1, the default.
const USUAL: std::ops::RangeInclusive<f64> = 0.1..=1e3;
/// Frequencies at which outputs follow their references, in parts of the bandwidth.
const FREQUENCIES: [f64; 2] = [0.1, 1.0];

/// Usual magnitudes of a plant's signals, where its outputs follow references.
#[derive(Debug, Clone, PartialEq)]
pub struct Magnitudes {
    /// States.
    pub x: Vec<f64>,
    /// Inputs.
    pub u: Vec<f64>,
    /// Outputs.
    pub y: Vec<f64>,
}

/// Magnitudes of the elements of a variable.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// A vector.
    List(Vec<f64>),
    /// A matrix.
    Rows(DMatrix<f64>),
}

impl From<&[f64]> for Values {
    fn from(values: &[f64]) -> Self {
        Values::List(values.to_vec())
    }
}

impl From<&Vec<f64>> for Values {
    fn from(values: &Vec<f64>) -> Self {
        Values::List(values.clone())
    }
}

impl From<&DMatrix<f64>> for Values {
    fn from(values: &DMatrix<f64>) -> Self {
        Values::Rows(values.clone())
    }
}

impl Magnitudes {
    /// Those of a plant whose outputs swing by their references, up to a bandwidth, rad/s: of its inputs what makes them swing,
    /// and of its states what comes of that. None where the inputs don't move the outputs independently of each other.
    pub fn new(plant: &Plant, references: &[f64], bandwidth: f64) -> Option<Self> {
        let (n, m, p) = plant.sizes();
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        let (mut x, mut u) = (vec![0.0; n], vec![0.0; m]);
        for frequency in FREQUENCIES.map(|part| part * bandwidth) {
            let moved = DMatrix::identity(n, n).map(|one: f64| Complex::new(0.0, one * frequency)) - complex(&plant.A);
            let states = moved.lu().solve(&complex(&plant.B))?;
            let outputs = complex(&plant.C) * &states + plant.D.as_ref().map_or(DMatrix::zeros(p, m), complex);
            let needed = if p == m { outputs.try_inverse()? } else { outputs.pseudo_inverse(0.0).ok()? };
            let states = states * &needed;
            let swing = |matrix: &DMatrix<Complex<f64>>, i: usize| -> f64 {
                matrix.row(i).iter().zip(references).map(|(entry, reference)| entry.norm() * reference).sum()
            };
            x.iter_mut().enumerate().for_each(|(i, x)| *x = f64::max(*x, swing(&states, i)));
            u.iter_mut().enumerate().for_each(|(j, u)| *u = f64::max(*u, swing(&needed, j)));
        }
        Some(Magnitudes { x, u, y: references.to_vec() })
    }
}

/// Magnitudes of the variables of a new unit, by those of the plant that it is for, its references and the bandwidth, rad/s;
/// nothing where all of them are near 1, or where no plant was given.
pub fn write_magnitudes<N: AsRef<str>>(
    text: &mut Text,
    plant: Option<&Plant>,
    (references, bandwidth): (&[f64], f64),
    of: impl FnOnce(&Magnitudes) -> Vec<(N, Values)>,
) {
    let Some(sizes) = plant.and_then(|plant| Magnitudes::new(plant, references, bandwidth)) else { return };
    let written: Vec<_> = of(&sizes).into_iter().filter_map(|(name, values)| Some((name, rounded(values)?))).collect();
    let is_far = |value: &f64| !USUAL.contains(value);
    if !written.iter().any(|(_, values)| values.iter().any(is_far)) {
        return;
    }
    text.table("magnitudes");
    text.comment("Usual magnitudes: integrators keep errors within their tolerance times these.");
    for (name, values) in &written {
        match values {
            Values::List(values) => text.set(name.as_ref(), list(values), ""),
            Values::Rows(values) => text.set(name.as_ref(), rows(values), ""),
        }
    }
}

impl Values {
    fn iter(&self) -> impl Iterator<Item = &f64> {
        match self {
            Values::List(values) => values.as_slice().iter(),
            Values::Rows(values) => values.as_slice().iter(),
        }
    }
}

/// With one digit each; an element that is 0 counts as the smallest other one. None where all are 0, or one is beyond numbers.
fn rounded(values: Values) -> Option<Values> {
    let smallest = values.iter().copied().filter(|value| value.is_normal()).reduce(f64::min)?;
    let each = |value: &f64| round_up(value.max(smallest));
    values.iter().all(|value| value.is_finite()).then(|| match &values {
        Values::List(values) => Values::List(values.iter().map(each).collect()),
        Values::Rows(values) => Values::Rows(values.map(|value| each(&value))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tank, m³, behind a valve in m³/s: x' = −x/T + u, y = g x.
    fn tank(time: f64, gain: f64) -> Plant {
        let of = |value: f64| DMatrix::from_element(1, 1, value);
        Plant { A: of(-1.0 / time), B: of(1.0), C: of(gain), ..Plant::integrators(1, 1, 1).unwrap() }
    }

    #[test]
    fn magnitudes_are_those_of_a_swing() {
        for (time, gain, reference, bandwidth) in [(100.0, 1e5, 2.0, 0.05), (1e-3, 0.3, 1e-6, 2e3)] {
            let found = Magnitudes::new(&tank(time, gain), &[reference], bandwidth).unwrap();
            let state = reference / gain;
            let control = state * f64::hypot(bandwidth, 1.0 / time);
            assert!(
                (found.x[0] / state - 1.0).abs() < 1e-12 && (found.u[0] / control - 1.0).abs() < 1e-12,
                "{found:?}"
            );
        }
    }

    #[test]
    fn other_units_are_other_magnitudes_by_their_factor() {
        let [n, m] = [3, 2];
        let plant = Plant {
            A: DMatrix::from_fn(n, n, |i, j| ((i * 5 + j * 7) % 11) as f64 - 5.0),
            B: DMatrix::from_fn(n, m, |i, j| ((i * 3 + j * 4) % 5) as f64 - 1.0),
            ..Plant::integrators(n, m, m).unwrap()
        };
        let (of_x, of_u) = ([1e-9, 1e6, 3.0], [1e-12, 1e4]);
        let scaled = Plant {
            A: DMatrix::from_fn(n, n, |i, j| plant.A[(i, j)] * of_x[i] / of_x[j]),
            B: DMatrix::from_fn(n, m, |i, j| plant.B[(i, j)] * of_x[i] / of_u[j]),
            C: DMatrix::from_fn(m, n, |i, j| plant.C[(i, j)] / of_x[j]),
            ..plant.clone()
        };
        let [own, other] = [&plant, &scaled].map(|plant| Magnitudes::new(plant, &[1.0, 2.0], 3.0).unwrap());
        let check = |own: &[f64], other: &[f64], by: &[f64]| {
            own.iter()
                .zip(other)
                .zip(by)
                .for_each(|((own, other), by)| assert!((other / (own * by) - 1.0).abs() < 1e-9))
        };
        check(&own.x, &other.x, &of_x);
        check(&own.u, &other.u, &of_u);
    }

    #[test]
    fn what_is_near_one_is_left_out() {
        for (gain, expected) in [(1.0, false), (1e5, true), (1e-5, true)] {
            let mut text = Text::default();
            write_magnitudes(&mut text, Some(&tank(1.0, gain)), (&[1.0], 1.0), |of| vec![("x", (&of.x).into())]);
            let state = if gain > 1.0 { "x = [1e-5]" } else { "x = [1e5]" };
            let text = text.finish().text;
            assert_eq!(text.contains("[magnitudes]") && text.contains(state), expected, "{text}");
        }
    }
}
