//! Frequency responses of a model, with the uncertainty that its entries leave.

use std::f64::consts::PI;

use nalgebra::{Complex, DMatrix, DVector};

use crate::linear::eigenvalues;
use crate::model::{Free, Model};

/// Points in a decade, and in all at most.
const PER_DECADE: f64 = 40.0;
const MOST_DECADES: f64 = 8.0;
/// Factor from the lowest frequency to the slowest pole.
const BELOW: f64 = 10.0;
/// Poles below this part of the fastest are at rest.
const NEGLIGIBLE: f64 = 1e-6;

/// The response of an output to an input over frequency, dead time included.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Place of the input.
    pub input: usize,
    /// Place of the output.
    pub output: usize,
    /// Frequencies, rad/s.
    pub frequencies: Vec<f64>,
    /// Magnitude, dB.
    pub magnitude: Vec<f64>,
    /// Standard error of the magnitude, dB, first order.
    pub magnitude_error: Vec<f64>,
    /// Phase, degrees, without jumps.
    pub phase: Vec<f64>,
    /// Standard error of the phase, degrees, first order.
    pub phase_error: Vec<f64>,
}

/// Responses of all outputs to all inputs, from a tenth of the slowest pole to the highest frequency that the records can show: half a
/// turn a sample. Inputs that never act are left out.
pub fn responses(model: &Model) -> Vec<Response> {
    let matrices = Matrices::new(model);
    let frequencies = frequencies(&matrices.a, model.sample_time);
    let (outputs, inputs) = (matrices.c.nrows(), matrices.b.ncols());
    let mut all: Vec<Response> = (0..inputs * outputs)
        .map(|k| Response {
            input: k / outputs,
            output: k % outputs,
            frequencies: Vec::new(),
            magnitude: Vec::new(),
            magnitude_error: Vec::new(),
            phase: Vec::new(),
            phase_error: Vec::new(),
        })
        .collect();
    for frequency in frequencies {
        let Some(at) = matrices.at(frequency) else { continue };
        for response in &mut all {
            let (i, j) = (response.output, response.input);
            if at.values[(i, j)].norm() > 0.0 {
                response.push(frequency, at.values[(i, j)], matrices.error(&at, i, j));
            }
        }
    }
    all.retain(|response| !response.frequencies.is_empty());
    all
}

impl Response {
    fn push(&mut self, frequency: f64, value: Complex<f64>, [of_size, of_angle]: [f64; 2]) {
        let last = self.phase.last().copied().unwrap_or(0.0);
        let turned = value.arg().to_degrees() - last;
        self.frequencies.push(frequency);
        self.magnitude.push(20.0 * value.norm().log10());
        self.magnitude_error.push(20.0 * std::f64::consts::LOG10_E * of_size);
        self.phase.push(last + (turned + 180.0).rem_euclid(360.0) - 180.0);
        self.phase_error.push(of_angle.to_degrees());
    }
}

fn frequencies(a: &DMatrix<f64>, sample_time: f64) -> Vec<f64> {
    let poles: Vec<f64> = eigenvalues(a).unwrap_or_default().iter().map(|pole| pole.norm()).collect();
    let fastest = poles.iter().copied().fold(0.0, f64::max);
    let highest = if sample_time > 0.0 { PI / sample_time } else { 10.0 * fastest };
    if !(highest > 0.0 && highest.is_finite()) {
        return Vec::new();
    }
    let slowest = poles.into_iter().filter(|pole| *pole > NEGLIGIBLE * fastest).fold(highest, f64::min);
    let lowest = (slowest / BELOW).max(highest / 10_f64.powf(MOST_DECADES)).min(highest / BELOW);
    let count = (PER_DECADE * (highest / lowest).log10()).ceil();
    (0..=count as usize).map(|k| lowest * (highest / lowest).powf(k as f64 / count)).collect()
}

/// A model with its uncertain entries.
struct Matrices<'a> {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    delay: &'a [f64],
    /// Entries of A and B: whether of A, row and column from 0.
    free: Vec<(bool, usize, usize)>,
    covariance: DMatrix<f64>,
}

/// The response at a frequency.
struct At {
    values: DMatrix<Complex<f64>>,
    /// C (s − A)⁻¹ and (s − A)⁻¹ B, dead times included.
    from_states: DMatrix<Complex<f64>>,
    to_states: DMatrix<Complex<f64>>,
    turns: Vec<Complex<f64>>,
}

impl<'a> Matrices<'a> {
    fn new(model: &'a Model) -> Self {
        let matrix = |rows: &[Vec<f64>]| {
            let columns = rows.first().map_or(0, Vec::len);
            DMatrix::from_row_iterator(rows.len(), columns, rows.iter().flatten().copied())
        };
        let (a, b, c) = (matrix(&model.A), matrix(&model.B), matrix(&model.C));
        let d = model.D.as_deref().map_or_else(|| DMatrix::zeros(c.nrows(), b.ncols()), matrix);
        let of_dynamics = model.free.iter().enumerate().filter(|(_, Free(matrix, ..))| matrix == "A" || matrix == "B");
        let (places, free): (Vec<_>, Vec<_>) =
            of_dynamics.map(|(k, Free(matrix, row, column))| (k, (matrix == "A", row - 1, column - 1))).unzip();
        let covariance = DMatrix::from_fn(places.len(), places.len(), |i, j| model.covariance[places[i]][places[j]]);
        Matrices { a, b, c, d, delay: &model.delay, free, covariance }
    }

    fn at(&self, omega: f64) -> Option<At> {
        let complex = |matrix: &DMatrix<f64>| matrix.map(Complex::from);
        let n = self.a.nrows();
        let shifted = DMatrix::from_diagonal_element(n, n, Complex::new(0.0, omega)) - complex(&self.a);
        let inverse = shifted.try_inverse()?;
        let turn = |j: usize| Complex::from_polar(1.0, -omega * self.delay.get(j).copied().unwrap_or(0.0));
        let turns: Vec<_> = (0..self.b.ncols()).map(turn).collect();
        let from_states = complex(&self.c) * &inverse;
        let mut to_states = inverse * complex(&self.b);
        let mut values = complex(&self.c) * &to_states + complex(&self.d);
        for matrix in [&mut to_states, &mut values] {
            matrix.column_iter_mut().zip(&turns).for_each(|(mut column, turn)| column *= *turn);
        }
        Some(At { values, from_states, to_states, turns })
    }

    /// Standard errors of the logarithm of a response: of its real part, that of the size, and of its imaginary part, the angle.
    fn error(&self, at: &At, i: usize, j: usize) -> [f64; 2] {
        let value = at.values[(i, j)];
        let slope = |&(of_a, row, column): &(bool, usize, usize)| {
            let moved = match of_a {
                true => at.to_states[(column, j)],
                false if column == j => at.turns[j],
                false => Complex::new(0.0, 0.0),
            };
            at.from_states[(i, row)] * moved / value
        };
        let slopes: Vec<Complex<f64>> = self.free.iter().map(slope).collect();
        let error = |part: fn(&Complex<f64>) -> f64| {
            let part = DVector::from_iterator(slopes.len(), slopes.iter().map(part));
            part.dot(&(&self.covariance * &part)).max(0.0).sqrt()
        };
        [error(|slope| slope.re), error(|slope| slope.im)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(a: [[f64; 2]; 2]) -> Model {
        let free = [("A", 1, 1), ("A", 1, 2), ("A", 2, 1), ("A", 2, 2), ("B", 2, 1), ("d", 1, 1)];
        Model {
            A: a.map(|row| row.to_vec()).to_vec(),
            B: vec![vec![0.5], vec![3.0]],
            C: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
            delay: vec![0.02],
            sample_time: 0.05,
            free: free.map(|(matrix, i, j)| Free(matrix.to_owned(), i, j)).to_vec(),
            covariance: vec![vec![0.0; 6]; 6],
            ..Model::default()
        }
    }

    #[test]
    fn errors_are_those_of_differences_by_one_entry() {
        let a = [[-1.0, 2.0], [-30.0, -0.8]];
        for entry in 0..5 {
            let mut given = model(a);
            given.covariance[entry][entry] = 0.01;
            let moved = |delta: f64| {
                let mut moved = given.clone();
                match entry {
                    4 => moved.B[1][0] += delta,
                    _ => moved.A[entry / 2][entry % 2] += delta,
                }
                // At the frequencies of the model.
                let matrices = Matrices::new(&moved);
                frequencies(&Matrices::new(&given).a, 0.05)
                    .iter()
                    .map(|omega| matrices.at(*omega).unwrap().values)
                    .collect::<Vec<_>>()
            };
            let (above, below) = (moved(1e-5), moved(-1e-5));
            for response in responses(&given) {
                for (k, (above, below)) in above.iter().zip(&below).enumerate() {
                    let slope = (above[(response.output, 0)] / below[(response.output, 0)]).ln() / 2e-5 * 0.1;
                    let expected = 20.0 * std::f64::consts::LOG10_E * slope.re.abs();
                    assert!((response.magnitude_error[k] - expected).abs() < 1e-6 * (1.0 + expected), "{entry} {k}");
                    assert!((response.phase_error[k] - slope.im.abs().to_degrees()).abs() < 1e-5, "{entry} {k}");
                }
            }
        }
    }

    #[test]
    fn phases_do_not_jump_and_the_frequencies_are_those_that_a_record_shows() {
        let given = model([[-1.0, 2.0], [-30.0, -0.8]]);
        let [first, second] = &responses(&given)[..] else { panic!("one input, two outputs") };
        assert!((first.frequencies.last().unwrap() - PI / 0.05).abs() < 1e-9);
        let poles = eigenvalues(&Matrices::new(&given).a).unwrap();
        assert!((first.frequencies[0] - 0.1 * poles[0].norm()).abs() < 1e-9);
        for response in [first, second] {
            assert!(response.phase.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 90.0));
        }
        // The dead time turns by -180 · ω · τ / π degrees at the end, the resonance by more than -90.
        assert!(first.phase.last().unwrap() - first.phase[0] < -72.0 - 90.0);
        let mut still = given;
        still.B = vec![vec![0.0], vec![0.0]];
        assert_eq!(responses(&still), []);
    }
}
