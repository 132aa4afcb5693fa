//! Usual magnitudes of signals, which tolerances of their errors are relative to: those of a plant in SI units may be far from 1.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::{Plant, Text, list, number, quoted, round_up, rows};

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
    /// and of its states what comes of that, each as far as the limits of the inputs allow. None where the inputs don't move the
    /// outputs independently of each other.
    pub fn new(plant: &Plant, references: &[f64], bandwidth: f64) -> Option<Self> {
        let (n, m, p) = plant.sizes();
        let limits = plant.limits.as_ref().map_or(vec![f64::INFINITY; m], |[min, max]| {
            min.iter().zip(max).map(|(min, max)| min.abs().max(max.abs())).collect()
        });
        let mut swings = Magnitudes { x: vec![0.0; n], u: vec![0.0; m], y: references.to_vec() };
        let mut allowed = Magnitudes { x: vec![0.0; n], u: limits.clone(), y: vec![0.0; p] };
        for frequency in FREQUENCIES.map(|part| part * bandwidth) {
            let [to_x, to_y] = responses(plant, frequency)?;
            if p == m {
                let needed = to_y.clone().try_inverse()?;
                raise(&mut swings.u, &needed, references);
                raise(&mut swings.x, &(&to_x * needed), references);
            } else {
                let u: Vec<_> = (0..m).map(|j| alone(&to_y, j, references)).collect();
                swings.u.iter_mut().zip(&u).for_each(|(most, u)| *most = most.max(*u));
                raise(&mut swings.x, &to_x, &u);
            }
            raise(&mut allowed.x, &to_x, &limits);
            raise(&mut allowed.y, &to_y, &limits);
        }
        let least = |swing: Vec<f64>, allowed: Vec<f64>| swing.iter().zip(allowed).map(|(a, b)| a.min(b)).collect();
        Some(Magnitudes { x: least(swings.x, allowed.x), u: least(swings.u, allowed.u), y: least(swings.y, allowed.y) })
    }
}

/// The size of an input with which no output exceeds its reference.
fn alone(to_y: &DMatrix<Complex<f64>>, input: usize, references: &[f64]) -> f64 {
    let size = |i: usize| references[i] / to_y[(i, input)].norm();
    (0..references.len()).map(size).fold(f64::INFINITY, f64::min)
}

/// From the inputs to the states and to the outputs at a frequency, rad/s; none at a pole.
fn responses(plant: &Plant, frequency: f64) -> Option<[DMatrix<Complex<f64>>; 2]> {
    let (n, m, p) = plant.sizes();
    let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
    let moved = DMatrix::from_diagonal_element(n, n, Complex::new(0.0, frequency)) - complex(&plant.A);
    let to_x = moved.lu().solve(&complex(&plant.B))?;
    let to_y = complex(&plant.C) * &to_x + plant.D.as_ref().map_or(DMatrix::zeros(p, m), complex);
    Some([to_x, to_y])
}

/// The largest size so far of what a matrix makes of signals of these sizes.
fn raise(largest: &mut [f64], matrix: &DMatrix<Complex<f64>>, sizes: &[f64]) {
    for (i, largest) in largest.iter_mut().enumerate() {
        let row = matrix.row(i);
        // What an input without a limit doesn't move stays 0.
        let terms = row.iter().zip(sizes).filter(|(entry, _)| entry.norm() > 0.0);
        *largest = largest.max(terms.map(|(entry, size)| entry.norm() * size).sum());
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
        match (values, plant.and_then(|plant| named_like(plant, name.as_ref()))) {
            // An element's name counts before that of its vector: `u` is the signal then.
            (Values::List(values), Some(names)) if names.len() == values.len() => {
                names.iter().zip(values).for_each(|(name, value)| text.set(&key(name), number(*value), ""));
            }
            (Values::List(values), _) => text.set(name.as_ref(), list(values), ""),
            (Values::Rows(values), _) => text.set(name.as_ref(), rows(values), ""),
        }
    }
}

/// The names of the elements of a variable, one of which is called as the variable is.
fn named_like<'a>(plant: &'a Plant, variable: &str) -> Option<&'a [String]> {
    let names = match variable {
        "x" => &plant.x.names,
        "u" => &plant.u.names,
        _ => return None,
    };
    names.iter().any(|name| name == variable).then_some(names)
}

/// A name as a key of TOML.
fn key(name: &str) -> String {
    let is_bare = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if is_bare { name.to_owned() } else { quoted(name) }
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
    fn limits_of_the_inputs_keep_signals_small() {
        let plant = Plant { limits: Some([vec![-2e-6], vec![1e-6]]), ..tank(1.0, 1.0) };
        let found = Magnitudes::new(&plant, &[1.0], 1.0).unwrap();
        // At the lower frequency the tank has all but all of its gain.
        assert!(found.u == [2e-6] && (found.x[0] / 2e-6 - 1.0).abs() < 0.01 && found.y == found.x, "{found:?}");
    }

    #[test]
    fn an_input_with_several_outputs_is_what_none_of_them_exceeds() {
        let both = DMatrix::from_column_slice(2, 1, &[1.0, 1e3]);
        let found = Magnitudes::new(&Plant { C: both, ..tank(1.0, 1.0) }, &[1.0, 1.0], 1.0).unwrap();
        assert!((found.x[0] / 1e-3 - 1.0).abs() < 1e-9, "{found:?}");
    }

    /// One of the signals has the name of the vector, so that it can't be set as a whole.
    #[test]
    fn inputs_of_which_one_is_called_u_have_a_number_each() {
        let written = |names: &[&str]| {
            let mut plant = Plant { C: DMatrix::from_element(1, 1, 1e5), ..tank(1.0, 1.0) };
            plant.u.names = names.iter().map(|name| (*name).to_owned()).collect();
            let mut text = Text::default();
            let values = vec![2e4; names.len()];
            write_magnitudes(&mut text, Some(&plant), (&[1.0], 1.0), |_| vec![("u", (&values).into())]);
            text.finish().text
        };
        assert!(written(&["u"]).contains("\nu = 2e4\n"), "{}", written(&["u"]));
        let both = written(&["pump.flow", "u"]);
        assert!(both.contains("\n\"pump.flow\" = 2e4\nu = 2e4\n"), "{both}");
        assert!(written(&["voltage"]).contains("\nu = [2e4]\n"));
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
