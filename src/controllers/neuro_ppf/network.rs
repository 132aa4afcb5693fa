//! The networks' common layer of sigmoid neurons, and how its weights are given.

use nalgebra::DMatrix;
use serde::Deserialize;

use super::input_gain::MOST_CHANNELS;
use crate::controllers::angles::Angles;
use crate::system::{Invalid, Scalar};

/// The most neurons.
const MOST: usize = 1000;
/// The most inputs: coordinates, each as sine and cosine, and their rates.
const MOST_INPUTS: usize = 3 * MOST_CHANNELS;
/// As many as there are inputs at most, and one for the bias.
const PRIMES: [f64; MOST_INPUTS + 1] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0];

/// Rule for the weights of the neurons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WeightRule {
    /// Within ±1, neuron j's from the fractions of j √2, j √3, j √5, …
    SquareRoots,
    /// Within ±2, neuron j's from the fractions of j/g, j/g², … with g^(n + 2) = g + 1 for n inputs: points of a
    /// low-discrepancy sequence.
    QuasiRandom,
    /// As they are.
    Given,
}

/// The description of the layer.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NetworkStructure {
    /// Rule for the weights.
    rule: WeightRule,
    /// Number of neurons; with given weights, as many as these.
    #[serde(default)]
    neurons: Option<usize>,
    /// A row of weights a neuron, one an input, with rule = "given".
    #[serde(default)]
    weights: Vec<Vec<f64>>,
    /// A number a neuron, with rule = "given".
    #[serde(default)]
    biases: Vec<f64>,
}

/// Z_j(x) = 1/(1 + e^(−w_jᵀ x − b_j)), with sine and cosine of an angle in its place.
#[derive(Debug)]
pub(super) struct Network {
    /// Weights by columns: w_j in column j.
    weights: DMatrix<f64>,
    biases: Vec<f64>,
    angles: Angles,
}

impl Network {
    /// The network of a state of so many elements, some of them angles.
    ///
    /// # Errors
    /// Numbers of neurons and weights that contradict each other.
    pub fn new(structure: &NetworkStructure, states: usize, angles: &Angles) -> Result<Self, Invalid> {
        let angles = angles.clone();
        let inputs = states + angles.each().count();
        if structure.rule == WeightRule::Given {
            return Network::given(structure, inputs, angles);
        }
        let g = ratio(inputs + 1);
        let rule = |j: usize, k: usize| {
            if structure.rule == WeightRule::SquareRoots {
                2.0 * (j as f64 * PRIMES[k].sqrt()).fract() - 1.0
            } else {
                4.0 * (j as f64 * g.powi(-(k as i32 + 1))).fract() - 2.0
            }
        };
        if !structure.weights.is_empty() || !structure.biases.is_empty() {
            return Err(Invalid::because("weights, biases: allowed only with rule = \"given\""));
        }
        let neurons = size(structure.neurons.unwrap_or(0))?;
        Ok(Network {
            weights: DMatrix::from_fn(inputs, neurons, |k, j| rule(j + 1, k)),
            biases: (1..=neurons).map(|j| rule(j, inputs)).collect(),
            angles,
        })
    }

    fn given(structure: &NetworkStructure, inputs: usize, angles: Angles) -> Result<Self, Invalid> {
        let NetworkStructure { weights, biases, .. } = structure;
        let neurons = size(structure.neurons.unwrap_or(weights.len()))?;
        let mut invalid = Invalid::none();
        if weights.len() != neurons {
            invalid.and(Invalid::new("weights", format!("{} rows", weights.len()), format!("must be {neurons}")));
        }
        if let Some((j, row)) = weights.iter().enumerate().find(|(_, row)| row.len() != inputs) {
            let sines = if angles.each().next().is_some() { " (two an angle: its sine and cosine)" } else { "" };
            let allowed = format!("must be {inputs}, one an input of the network{sines}");
            invalid.and(Invalid::new(format!("weights, row {}", j + 1), format!("{} numbers", row.len()), allowed));
        }
        if biases.len() != neurons {
            invalid.and(Invalid::new("biases", format!("{} numbers", biases.len()), format!("must be {neurons}")));
        }
        if weights.iter().flatten().chain(biases).any(|number| !number.is_finite()) {
            invalid.and(Invalid::because("weights, biases: must be finite"));
        }
        invalid.into_result()?;
        let weights = DMatrix::from_fn(inputs, neurons, |k, j| weights[j][k]);
        Ok(Network { weights, biases: biases.clone(), angles })
    }

    pub fn neurons(&self) -> usize {
        self.biases.len()
    }

    /// Number of inputs of each neuron.
    pub fn width(&self) -> usize {
        self.weights.nrows()
    }

    /// Writes Z(x).
    pub fn outputs<S: Scalar>(&self, x: &[S], Z: &mut [S]) {
        let inputs = self.inputs(x);
        for (j, Z) in Z.iter_mut().enumerate() {
            let weights = self.weights.column(j);
            *Z = sigmoid(inputs.iter().zip(weights.iter()).fold(S::from(self.biases[j]), |sum, (&x, &w)| sum + x * w));
        }
    }

    /// The neurons' inputs, of which there are as many as weights: a turn of an angle changes none.
    fn inputs<S: Scalar>(&self, x: &[S]) -> [S; MOST_INPUTS] {
        let (mut inputs, mut place) = ([S::from(0.0); MOST_INPUTS], 0);
        for (k, &x) in x.iter().enumerate() {
            if self.angles.has(k) {
                (inputs[place], inputs[place + 1]) = (x.sin(), x.cos());
                place += 2;
            } else {
                inputs[place] = x;
                place += 1;
            }
        }
        inputs
    }
}

/// 1/(1 + e^(−a)), with the exponential that is at most 1, so that nothing overflows.
fn sigmoid<S: Scalar>(a: S) -> S {
    let below = || {
        let small = a.exp();
        small / (small + 1.0)
    };
    S::branch(a.above(S::from(0.0)), || ((-a).exp() + 1.0).recip(), below)
}

/// Zᵀθ
pub(super) fn sum<S: Scalar>(Z: &[S], theta: &[S]) -> S {
    Z.iter().zip(theta).fold(S::from(0.0), |sum, (&Z, &theta)| sum + Z * theta)
}

fn size(neurons: usize) -> Result<usize, Invalid> {
    if (1..=MOST).contains(&neurons) {
        return Ok(neurons);
    }
    Err(Invalid::new("neurons", neurons, format!("must be within 1 … {MOST}")))
}

/// The root g > 1 of g^(d + 1) = g + 1, which spreads points best in d dimensions.
fn ratio(dimensions: usize) -> f64 {
    // The iteration contracts to machine precision well before this.
    (0..64).fold(1.2, |g: f64, _| (g + 1.0).powf(1.0 / (dimensions as f64 + 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rule: WeightRule, neurons: usize) -> NetworkStructure {
        NetworkStructure { rule, neurons: Some(neurons), weights: vec![], biases: vec![] }
    }

    #[test]
    fn the_rules_give_the_weights_of_the_examples() {
        let robot = Network::new(&of(WeightRule::SquareRoots, 30), 4, &Angles::default()).unwrap();
        // 30 √7 = 79.372539…, 2 √11 = 6.633249…
        assert!((robot.weights[(3, 29)] - (2.0 * 0.372_539_331_937_7 - 1.0)).abs() < 1e-11);
        assert!((robot.biases[1] - (2.0 * 0.633_249_580_710_8 - 1.0)).abs() < 1e-11);
        assert!((ratio(4) - 1.167_303_978_261_418_7).abs() < 1e-15);
        let coupled = Network::new(&of(WeightRule::QuasiRandom, 80), 3, &Angles::default()).unwrap();
        let expected = |j: f64, k: i32| 4.0 * (j * 1.167_303_978_261_418_7_f64.powi(-k)).fract() - 2.0;
        assert!((coupled.weights[(2, 79)] - expected(80.0, 3)).abs() < 1e-11);
        assert!((coupled.biases[6] - expected(7.0, 4)).abs() < 1e-12);
    }

    #[test]
    fn a_neuron_far_from_its_middle_has_a_value_and_a_derivative() {
        for (a, value) in [(-1e4, 0.0), (0.0, 0.5), (1e4, 1.0)] {
            let [(found, slope)] = crate::recording::slopes(|a| [sigmoid(a)], a);
            assert_eq!((found, slope), (value, if a == 0.0 { 0.25 } else { 0.0 }));
        }
    }
}
