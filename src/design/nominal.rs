//! The plant that a design is for, in balanced coordinates and with time in 1/W.
#![allow(non_snake_case)] // matrices have the names of the field

use std::cell::OnceCell;

use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix};

use super::criteria::Unmoved;
use super::minimal::minimal;
use super::response::{Response, grid};
use super::zeros;
use crate::eigenvalues;
use crate::error::Invalid;
use crate::mathematics::balanced::balance;
use crate::template::Plant;

/// A zero that is so much faster than W and all poles counts as none.
const FAR: f64 = 1e4;
/// Poles with a real part above this count as unstable, slower ones as integrators: a multiple pole at 0 comes out of
/// rounding at up to 1e-4 of the fastest pole.
const UNSTABLE: f64 = 1e-3;
/// Padé's approximation of a dead time has this order.
pub const PADE: usize = 4;
/// Its coefficients from s⁰ on, in x = s τ: e^(−x) = N(x)/N(−x) with N(−x) = 1680 + 840 x + 180 x² + 20 x³ + x⁴, which is 1 plus
/// the second ones over N(−x).
pub const PADE_COEFFICIENTS: [[f64; PADE]; 2] = [[1680.0, 840.0, 180.0, 20.0], [0.0, -1680.0, 0.0, -40.0]];

/// A nominal plant.
#[derive(Debug)]
pub struct Nominal {
    /// State matrix with a rational approximation of the dead times, for poles and steps.
    pub A: DMatrix<f64>,
    /// Input matrix, likewise.
    pub B: DMatrix<f64>,
    /// Output matrix, likewise.
    pub C: DMatrix<f64>,
    /// Dead time of each input, in 1/W.
    pub delay: Vec<f64>,
    /// W, rad/s.
    pub bandwidth: f64,
    /// Poles of the plant without its dead times, in W.
    pub poles: Vec<Complex<f64>>,
    /// Invariant zeros, in W.
    pub zeros: Vec<Complex<f64>>,
    /// With exact dead times.
    pub response: Response,
    /// Its frequencies.
    pub frequencies: Vec<f64>,
    /// Poles and zeros that no feedback moves.
    pub unmoved: Unmoved,
    on_grid: OnceCell<Vec<DMatrix<Complex<f64>>>>,
}

impl Nominal {
    /// That of a plant, for a bandwidth, rad/s.
    ///
    /// # Errors
    /// Numbers that differ by too many powers of ten, and outputs that depend on each other.
    pub fn new(plant: &Plant, bandwidth: f64) -> Result<Self, Invalid> {
        let (A, B, C, _) = balance(&plant.A, &plant.B, &plant.C);
        let extreme = || Invalid::because("the entries of A, B and C differ by too many powers of ten");
        if !(A.norm_squared() + B.norm_squared() + C.norm_squared()).is_finite() {
            return Err(extreme());
        }
        let (A, B) = (A / bandwidth, B / bandwidth);
        let delay: Vec<_> = plant.delays().iter().map(|delay| delay * bandwidth).collect();
        let poles = poles_of(&A).ok_or_else(extreme)?;
        let fastest = poles.iter().map(|pole| pole.norm()).fold(1.0, f64::max);
        let mut zeros = zeros::invariant(&A, &B, &C).ok_or_else(|| {
            Invalid::because(
                "A, B, C: the controls must move the outputs independently of each other. Choose other inputs or outputs",
            )
        })?;
        zeros.retain(|zero| zero.norm() <= FAR * fastest);
        let response = Response::new(&A, &B, &C, &delay);
        let frequencies = grid(&poles, &zeros, &delay);
        let (A, B, C) = with_delays(&A, &B, &C, &delay);
        let unmoved = Unmoved::new(&poles, &zeros);
        let on_grid = OnceCell::new();
        Ok(Nominal { A, B, C, delay, bandwidth, poles, zeros, response, frequencies, unmoved, on_grid })
    }

    /// Inputs, which are as many as outputs.
    pub fn channels(&self) -> usize {
        self.B.ncols()
    }

    /// G at all frequencies.
    pub fn on_grid(&self) -> &[DMatrix<Complex<f64>>] {
        self.on_grid.get_or_init(|| self.frequencies.iter().map(|&omega| self.response.at(omega)).collect())
    }

    /// True if a pole is clearly on the right.
    pub fn is_unstable(&self) -> bool {
        self.poles.iter().any(|pole| pole.re > UNSTABLE)
    }

    /// The channel from a combination of the inputs to an output.
    pub fn channel(&self, inputs: &DMatrix<f64>, output: usize) -> Option<Channel<'_>> {
        let row = self.C.rows(output, 1).into_owned();
        let [A, B, C] = minimal(&self.A, &(&self.B * inputs), &row);
        if A.is_empty() {
            return None;
        }
        let (poles, zeros) = (poles_of(&A)?, zeros::invariant(&A, &B, &C)?);
        let unmoved = Unmoved::new(&poles, &zeros);
        let mix = inputs.map(Complex::from);
        let sign = sign(&A, &B, &C);
        let of = |G: &DMatrix<Complex<f64>>| (G.row(output) * &mix)[(0, 0)];
        let G = self.on_grid().iter().map(of).collect();
        let source = Source::Plant { inputs: mix, output };
        Some(Channel { A, B, C, sign, unmoved, G, source, plant: self })
    }

    /// A chain of integrators, which a channel of the plant is at high frequencies whatever the others do.
    pub fn chain(&self, gain: f64, length: usize) -> Channel<'_> {
        let mut A = DMatrix::zeros(length, length);
        (1..length).for_each(|i| A[(i - 1, i)] = 1.0);
        let (mut B, mut C) = (DMatrix::zeros(length, 1), DMatrix::zeros(1, length));
        (B[length - 1], C[0]) = (gain, 1.0);
        let source = Source::Chain { gain, length: length as i32 };
        let of = |omega: &f64| Complex::from(gain) / Complex::new(0.0, *omega).powi(length as i32);
        let G = self.frequencies.iter().map(of).collect();
        Channel { A, B, C, sign: gain.signum(), unmoved: Unmoved::default(), G, source, plant: self }
    }

    /// The plant as the one channel that it is.
    pub fn single(&self) -> Channel<'_> {
        let G = self.on_grid().iter().map(|G| G[(0, 0)]).collect();
        let source = Source::Plant { inputs: DMatrix::from_element(1, 1, Complex::new(1.0, 0.0)), output: 0 };
        let (A, B, C) = (self.A.clone(), self.B.clone(), self.C.clone());
        let sign = sign(&A, &B, &C);
        Channel { A, B, C, sign, unmoved: self.unmoved.clone(), G, source, plant: self }
    }
}

/// One output and what moves it.
#[derive(Debug)]
pub struct Channel<'a> {
    /// State matrix.
    pub A: DMatrix<f64>,
    /// A column.
    pub B: DMatrix<f64>,
    /// A row.
    pub C: DMatrix<f64>,
    /// The sign that a control with an integral must have to be stable.
    pub sign: f64,
    /// Poles and zeros that no feedback moves.
    pub unmoved: Unmoved,
    /// G at the plant's frequencies.
    pub G: Vec<Complex<f64>>,
    source: Source,
    plant: &'a Nominal,
}

/// Source of a channel's response.
#[derive(Debug)]
enum Source {
    /// A combination of the plant's inputs, and an output.
    Plant { inputs: DMatrix<Complex<f64>>, output: usize },
    /// gain/sⁿ
    Chain { gain: f64, length: i32 },
}

impl Channel<'_> {
    /// G(j ω).
    pub fn at(&self, omega: f64) -> Complex<f64> {
        match &self.source {
            Source::Plant { inputs, output } => (self.plant.response.at(omega).row(*output) * inputs)[(0, 0)],
            Source::Chain { gain, length } => Complex::from(*gain) / Complex::new(0.0, omega).powi(*length),
        }
    }

    /// The frequencies of G.
    pub fn frequencies(&self) -> &[f64] {
        &self.plant.frequencies
    }

    /// W, rad/s.
    pub fn bandwidth(&self) -> f64 {
        self.plant.bandwidth
    }
}

/// Eigenvalues of a matrix, balanced first.
pub fn poles_of(A: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    if !A.norm_squared().is_finite() {
        return None;
    }
    let mut balanced = A.clone();
    balance_parlett_reinsch(&mut balanced);
    eigenvalues::complex(&balanced)
}

/// The sign of N(0) in G = N/D with a monic D. The loop of an integral control k/s + … has the characteristic polynomial
/// s D (…) + N (…), monic too: where it is stable, its last coefficient, which k N(0) decides, is positive.
fn sign(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> f64 {
    let n = A.nrows();
    let mut whole = DMatrix::zeros(n + 1, n + 1);
    whole.view_mut((0, 0), (n, n)).copy_from(&-A);
    whole.view_mut((0, n), (n, 1)).copy_from(B);
    whole.view_mut((n, 0), (1, n)).copy_from(&-C);
    let lu = whole.lu();
    // Pivot by pivot: their product may overflow.
    lu.u().diagonal().iter().fold(lu.p().determinant::<f64>(), |sign, pivot| sign * pivot.signum())
}

/// The plant with each dead time approximated: e^(−s τ) = N(s)/N(−s) of order 4, which has gain 1 everywhere.
fn with_delays(
    A: &DMatrix<f64>,
    B: &DMatrix<f64>,
    C: &DMatrix<f64>,
    delay: &[f64],
) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
    let (mut A, mut B, mut C) = (A.clone(), B.clone(), C.clone());
    for (j, &tau) in delay.iter().enumerate().filter(|(_, delay)| **delay > 0.0) {
        let n = A.nrows();
        let grown = n + PADE;
        let column = B.column(j).into_owned();
        let [denominator, difference] = PADE_COEFFICIENTS;
        let (m, p) = (B.ncols(), C.nrows());
        (A, B, C) = (A.resize(grown, grown, 0.0), B.resize(grown, m, 0.0), C.resize(p, grown, 0.0));
        for k in 0..PADE {
            A.view_mut((0, n + k), (n, 1)).copy_from(&(&column * difference[k]));
            A[(grown - 1, n + k)] = -denominator[k] / tau;
            if k + 1 < PADE {
                A[(n + k, n + k + 1)] = 1.0 / tau;
            }
        }
        B[(grown - 1, j)] = 1.0 / tau;
    }
    (A, B, C)
}
