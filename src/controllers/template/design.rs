//! Numbers that a new L1 controller starts with: a design that holds for plants about the nominal one.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix, DVector};

use crate::eigenvalues;
use crate::error::Invalid;
use crate::mathematics::filter::{Filter, FilterDescription};
use crate::mathematics::l1_design::L1Design;
use crate::mathematics::{feedforward, lyapunov, pole_placement};
use crate::template::{Plant, Request, round_down, round_up, three_digits};

/// Bounds of the input gain: a third to three times the nominal one.
pub const OMEGA: [f64; 2] = [0.3, 3.0];
/// Damping of poles at least.
const DAMPING: f64 = 0.8;
/// How much faster than the one before a pole of the same chain and speed is.
const SPREAD: f64 = 1.2;
/// Angle through which the adaptation may turn in a step, at the usual magnitudes of signals.
const PHASE: f64 = 3.0;
/// The largest numbers that the ideal model is simulated with.
const LARGEST: f64 = 1e50;
/// Speed where there is no plant, rad/s.
const USUAL_BANDWIDTH: f64 = 2.0;

/// The numbers.
#[derive(Debug)]
pub struct Design {
    /// Desired poles, as `pole_real` and `pole_imag` want them.
    pub poles: Vec<Complex<f64>>,
    /// k of K = k I, 1/s.
    pub feedback_gain: f64,
    /// Γ.
    pub adaptation_gain: f64,
    /// One an input.
    pub theta_bound: Vec<f64>,
    /// One an input.
    pub sigma_bound: Vec<f64>,
    /// Communication step, s.
    pub step: f64,
}

/// Bandwidth of a controlled plant, rad/s: that of the request; else twice the plant's slowest stable pole that isn't at
/// 0, or its largest one.
///
/// # Errors
/// A plant whose poles can't be found, or one with all poles at 0 where the request has no bandwidth.
pub fn bandwidth(plant: &Plant, request: &Request) -> Result<f64, Invalid> {
    if let Some(wanted) = request.bandwidth {
        return Ok(wanted);
    }
    if request.plant.is_none() {
        return Ok(USUAL_BANDWIDTH);
    }
    let poles = eigenvalues(&plant.A)?;
    let largest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    let stable = poles.iter().filter(|pole| pole.re < 0.0 && pole.norm() > 1e-6 * largest).map(|pole| pole.norm());
    let found = stable.reduce(f64::min).map_or(largest, |slowest| 2.0 * slowest);
    let unknown =
        || Invalid::because("all poles of the plant are at 0: give --bandwidth, the speed of the loop in rad/s");
    (found > 0.0).then(|| three_digits(found)).ok_or_else(unknown)
}

fn eigenvalues(A: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, Invalid> {
    eigenvalues::complex(A).ok_or_else(|| Invalid::because("A is too badly scaled: its eigenvalues can't be found"))
}

/// Poles of a closed loop: the plant's own, none slower than the bandwidth, all of them damped.
///
/// # Errors
/// Why the plant can't be controlled.
pub fn poles(A: &DMatrix<f64>, B: &DMatrix<f64>, bandwidth: f64) -> Result<Vec<Complex<f64>>, Invalid> {
    let chains = pole_placement::controllability_indices(A, B)?;
    let mut own = eigenvalues(A)?;
    own.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    if let [n] = chains[..] {
        return Ok(of_one_chain(&own, bandwidth, n));
    }
    // Conjugates must share a chain; real poles may stand anywhere.
    let mut placed: Vec<Vec<f64>> = chains.iter().map(|_| Vec::new()).collect();
    for speed in own.iter().map(|lambda| three_digits(lambda.norm().max(bandwidth))) {
        let free = (0..chains.len()).filter(|&i| placed[i].len() < chains[i]);
        let share = |i: usize| placed[i].len() as f64 / chains[i] as f64;
        if let Some(chain) = free.min_by(|&i, &j| share(i).total_cmp(&share(j))) {
            let last = placed[chain].last().copied().unwrap_or(0.0);
            placed[chain].push(apart(speed, last));
        }
    }
    Ok(placed.into_iter().flatten().map(|speed| Complex::new(-speed, 0.0)).collect())
}

fn of_one_chain(own: &[Complex<f64>], bandwidth: f64, n: usize) -> Vec<Complex<f64>> {
    let (mut poles, mut last) = (Vec::new(), 0.0);
    // Of conjugates, the one above stands for both.
    for lambda in own.iter().filter(|lambda| lambda.im >= 0.0) {
        let speed = three_digits(lambda.norm().max(bandwidth));
        let damping = if lambda.im > 0.0 { (-lambda.re / lambda.norm()).max(DAMPING) } else { 1.0 };
        if damping < 1.0 {
            let (re, im) = (three_digits(-damping * speed), three_digits((1.0 - damping * damping).sqrt() * speed));
            poles.extend([Complex::new(re, im), Complex::new(re, -im)]);
        } else {
            for _ in 0..if lambda.im > 0.0 { 2 } else { 1 } {
                last = apart(speed, last);
                poles.push(Complex::new(-last, 0.0));
            }
        }
    }
    poles.truncate(n);
    poles
}

/// A speed that isn't that of the pole before.
fn apart(speed: f64, last: f64) -> f64 {
    if speed > 1.05 * last { speed } else { three_digits(SPREAD * last) }
}

/// The design for references of a magnitude.
///
/// # Errors
/// Why there is none for this plant.
pub fn design(plant: &Plant, bandwidth: f64, reference: f64) -> Result<Design, Invalid> {
    let Plant { A, B, C, .. } = plant;
    let m = B.ncols();
    let poles = poles(A, B, bandwidth)?;
    let K_m = pole_placement::place(A, B, &poles)?;
    let A_m = A - B * &K_m;
    let K_g = feedforward::gain(&A_m, B, C, "A_m")?;
    let command = K_g * DVector::from_element(m, reference);
    let (x, u) = magnitudes(&A_m, B, &K_m, &command, bandwidth);
    let extreme = || {
        Invalid::because(
            "the plant, the bandwidth and the reference differ by too many powers of ten for a design in double precision: \
             choose other units, or more inputs (a control that acts through more than about 14 integrators has none)",
        )
    };
    if !(x.norm_squared().is_finite() && u.norm_squared().is_finite()) {
        return Err(extreme());
    }
    let matched = B.clone().pseudo_inverse(0.0).map_err(Invalid::because)? * A;
    // As much again as the nominal plant and its baseline have.
    let theta = K_m.abs() + matched.abs();
    let least = |i: usize| 0.1 * u[i] / x.amax();
    let theta_bound = (0..m).map(|i| round_up(theta.row(i).max().max(least(i)))).collect();
    let limit = |i: usize| plant.limits.as_ref().map(|[min, max]| min[i].abs().max(max[i].abs()));
    let sigma_bound = (0..m).map(|i| round_up(limit(i).unwrap_or(2.0 * u[i]))).collect();
    let feedback_gain = filter_gain(&A_m, B, &x, &(theta * 0.5), bandwidth)?;
    let fastest = poles.iter().map(|pole| pole.norm()).fold(feedback_gain, f64::max);
    let step = round_down((0.1 / fastest).min(1e-3));
    let P = lyapunov::solve(&A_m, &DMatrix::identity(A.nrows(), A.nrows()))?;
    let BPB = B.transpose() * P * B;
    if !BPB.norm_squared().is_finite() {
        return Err(extreme());
    }
    let lambda = BPB.symmetric_eigenvalues().max();
    let signals = 1.0 + x.norm_squared() + u.norm_squared();
    let adaptation_gain = round_down((PHASE / step).powi(2) / (lambda * signals));
    Ok(Design { poles, feedback_gain, adaptation_gain, theta_bound, sigma_bound, step })
}

/// The largest magnitudes of states and controls on the way to a reference, in the ideal model.
fn magnitudes(
    A_m: &DMatrix<f64>,
    B: &DMatrix<f64>,
    K_m: &DMatrix<f64>,
    command: &DVector<f64>,
    bandwidth: f64,
) -> (DVector<f64>, DVector<f64>) {
    const POINTS: usize = 500;
    let n = A_m.nrows();
    let mut whole = DMatrix::zeros(n + 1, n + 1);
    let h = 10.0 / bandwidth / POINTS as f64;
    whole.view_mut((0, 0), (n, n)).copy_from(&(A_m * h));
    whole.view_mut((0, n), (n, 1)).copy_from(&(B * command * h));
    // The exponential needs the sixth power.
    let size = whole.norm();
    if size.is_nan() || size > LARGEST {
        let unknown = DVector::from_element(n, f64::NAN);
        return (unknown, command * f64::NAN);
    }
    let over_h = whole.exp();
    let mut state = DVector::zeros(n + 1);
    state[n] = 1.0;
    let (mut x, mut u) = (DVector::zeros(n), command.abs());
    for _ in 0..POINTS {
        state = &over_h * state;
        let now = state.rows(0, n).into_owned();
        u = u.sup(&(command - K_m * &now).abs());
        x = x.sup(&now.abs());
    }
    (x, u)
}

/// The smallest filter gain by which the L1-norm condition holds for half the nominal uncertainty at the smallest input
/// gain, with states in parts of their magnitudes; or ten times the bandwidth, where none does.
fn filter_gain(
    A_m: &DMatrix<f64>,
    B: &DMatrix<f64>,
    x: &DVector<f64>,
    theta: &DMatrix<f64>,
    bandwidth: f64,
) -> Result<f64, Invalid> {
    let (m, filter) = (B.ncols(), Filter::new(&FilterDescription::default())?);
    let scale = DMatrix::from_diagonal(&x.map(|x| if x > 0.0 { x } else { 1.0 }));
    let inverse = scale.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(x.len(), x.len()));
    let lipschitz = (theta * &scale).row_iter().map(|row| row.sum()).fold(0.0, f64::max);
    let (A_m, B) = (&inverse * A_m * &scale, &inverse * B);
    let omega = DMatrix::from_diagonal_element(m, m, 0.5);
    for factor in [2.0, 5.0, 10.0, 20.0, 40.0] {
        let gain = round_up(factor * bandwidth);
        let K = DMatrix::from_diagonal_element(m, m, gain);
        let (omega_min, omega_max) = (omega.clone(), omega.clone());
        let (A_m, B, filter) = (A_m.clone(), B.clone(), filter.clone());
        let design = L1Design { A_m, B, K, filter, omega_min, omega_max, known: None, unmatched: None };
        if design.norms(&omega)?.matched.upper * lipschitz < 1.0 {
            return Ok(gain);
        }
    }
    Ok(round_up(10.0 * bandwidth))
}
