//! First designs of PID control, K(s) = K_p + K_i/s + K_d N s/(s + N).
//!
//! The simplest of I, PI and PID control that has a sound candidate is taken: no derivative where none is needed.
#![allow(non_snake_case)] // gains have the names of the field

use nalgebra::{Complex, DMatrix, DVector};

use super::controller::Controller;
use super::criteria::keeps_away;
use super::four_digits;
use super::nominal::{Channel, poles_of};
use super::search::{Asked, Law};
use super::step::Entry;

/// Frequencies at which the gain is 1, in parts of the speed.
const CROSSOVERS: [f64; 4] = [1.0, 1.5, 2.0, 3.0];
/// The filter of the derivative, in parts of that frequency.
const FILTER: f64 = 10.0;
/// Largest ratio of the gain at high frequencies to that one: the cost of measurement noise.
const NOISE: f64 = 10.0;
/// Corner of the integral part, in parts of that frequency.
const INTEGRAL: [f64; 10] = [0.1, 0.15, 0.2, 0.25, 0.35, 0.5, 0.7, 1.0, 1.5, 2.5];
/// Corner of the derivative part, likewise.
const DERIVATIVE: [f64; 7] = [0.25, 0.35, 0.5, 0.7, 1.0, 1.6, 3.0];
/// Candidates whose speeds are within this factor are equally fast: the one with more integral gain is taken.
const AS_FAST: f64 = 0.99;

/// Gains of a channel in 1/s, s and rad/s; without their sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Proportional gain.
    pub K_p: f64,
    /// Integral gain, 1/s.
    pub K_i: f64,
    /// Derivative gain, s.
    pub K_d: f64,
    /// Filter of the derivative, rad/s.
    pub N: f64,
}

/// PID control.
#[derive(Debug)]
pub struct Pid;

impl Law for Pid {
    type Gains = Gains;
    const MODULUS: [f64; 2] = [1.7, 2.0];
    const ALONE: &'static [Option<usize>] = &[Some(0), Some(1), Some(2)];
    const TOGETHER: &'static [Option<usize>] = &[None, Some(1), Some(2)];

    fn candidates(channel: &Channel, asked: &Asked, form: Option<usize>) -> impl Iterator<Item = (Gains, f64)> {
        let forms: &[usize] = form.as_ref().map_or(&[0, 1, 2], std::slice::from_ref);
        let first = forms.iter().map(|&form| sound(channel, asked, form)).find(|sound| !sound.is_empty());
        first.unwrap_or_default().into_iter()
    }

    fn controller(gains: &Gains, bandwidth: f64) -> Controller {
        gains.faster(bandwidth.recip()).controller()
    }

    fn response(gains: &Gains, bandwidth: f64) -> impl Fn(f64) -> Complex<f64> {
        let gains = gains.faster(bandwidth.recip());
        move |omega| gains.at(omega)
    }
}

impl Gains {
    /// With rates so many times as large.
    fn faster(self, factor: f64) -> Self {
        Gains { K_p: self.K_p, K_i: self.K_i * factor, K_d: self.K_d / factor, N: self.N * factor }
    }

    fn times(self, factor: f64) -> Self {
        Gains { K_p: self.K_p * factor, K_i: self.K_i * factor, K_d: self.K_d * factor, N: self.N }
    }

    fn rounded(self) -> Self {
        let [K_p, K_i, K_d, N] = [self.K_p, self.K_i, self.K_d, self.N].map(four_digits);
        Gains { K_p, K_i, K_d, N }
    }

    fn at(&self, omega: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega);
        s * (self.K_d * self.N) / (s + self.N) + self.K_p + self.K_i / s
    }

    /// x_1' = K_i y where there is an integral, and K_d N (y − w) with w' = N (y − w) where there is a derivative.
    fn controller(&self) -> Controller {
        let (K_p, K_d, N) = (self.K_p, self.K_d, self.N);
        let integral = (self.K_i > 0.0).then_some([0.0, self.K_i, 1.0]);
        let derivative = (K_d > 0.0).then_some([-N, N, -K_d * N]);
        let states: Vec<_> = integral.into_iter().chain(derivative).collect();
        let own = states.len();
        Controller {
            A: DMatrix::from_fn(own, own, |i, j| if i == j { states[i][0] } else { 0.0 }),
            B: DMatrix::from_fn(own, 1, |i, _| states[i][1]),
            C: DMatrix::from_fn(1, own, |_, j| states[j][2]),
            D: DMatrix::from_element(1, 1, K_p + K_d * N),
        }
    }
}

/// Entry of the references: the integral part takes r − y, the proportional one b r − y, the derivative c r − y.
pub fn entry(gains: &[Gains], weights: &[[f64; 2]], S: &DMatrix<f64>, bandwidth: f64) -> Entry {
    let m = gains.len();
    let rates = |(gains, [_, c]): (&Gains, &[f64; 2])| {
        let gains = gains.faster(bandwidth.recip());
        let integral = (gains.K_i > 0.0).then_some(-gains.K_i);
        let derivative = (gains.K_d > 0.0).then_some(-gains.N * c);
        integral.into_iter().chain(derivative).collect::<Vec<_>>()
    };
    let rates: Vec<_> = gains.iter().zip(weights).map(rates).collect();
    let mut B = DMatrix::zeros(rates.iter().map(Vec::len).sum(), m);
    let mut first = 0;
    for (i, rates) in rates.iter().enumerate() {
        rates.iter().enumerate().for_each(|(k, rate)| B[(first + k, i)] = *rate);
        first += rates.len();
    }
    let direct = gains.iter().zip(weights).map(|(gains, [b, c])| gains.K_p * b + gains.K_d * gains.N * c);
    Entry { B, D: S * DMatrix::from_diagonal(&DVector::from_iterator(m, direct)) }
}

/// Candidates of a form, I, PI or PID, before their gain is fitted to the plant.
fn shapes(form: usize, crossover: f64) -> Vec<Gains> {
    let N = FILTER * crossover;
    let integral = || INTEGRAL.map(|part| part * crossover).into_iter();
    match form {
        0 => vec![Gains { K_p: 0.0, K_i: 1.0, K_d: 0.0, N }],
        1 => integral().map(|omega_i| Gains { K_p: 1.0, K_i: omega_i, K_d: 0.0, N }).collect(),
        // (1 + ω_i/s)(1 + s/ω_d)/(1 + s/N)
        _ => {
            let pairs = integral().flat_map(|omega_i| DERIVATIVE.map(|part| (omega_i, part * crossover)));
            let gains = pairs.map(|(omega_i, omega_d)| {
                let K_p = 1.0 + omega_i / omega_d - omega_i / N;
                Gains { K_p, K_i: omega_i, K_d: (N / omega_d - K_p) / N, N }
            });
            gains.filter(|gains| gains.K_p >= 0.0 && gains.K_d >= 0.0).collect()
        }
    }
}

/// The sound candidates of a form, the fastest first.
fn sound(channel: &Channel, asked: &Asked, form: usize) -> Vec<(Gains, f64)> {
    let mut sound = Vec::new();
    for crossover in CROSSOVERS.map(|factor| factor * asked.speed) {
        let size = channel.at(crossover).norm();
        for shape in shapes(form, crossover) {
            let at_crossover = shape.at(crossover).norm();
            if shape.K_p + shape.K_d * shape.N > NOISE * at_crossover {
                continue;
            }
            let gains = shape.times((size * at_crossover).recip());
            if let Some(slowest) = slowest(channel, &gains, asked) {
                let written = gains.faster(channel.bandwidth()).rounded();
                sound.push((written, channel.sign, slowest.min(asked.speed)));
            }
        }
    }
    in_order(sound)
}

/// Least −Re of the poles of a loop, where it is sound.
fn slowest(channel: &Channel, gains: &Gains, asked: &Asked) -> Option<f64> {
    let sign = channel.sign;
    let loop_gains = channel.frequencies().iter().zip(&channel.G).map(|(&omega, G)| gains.at(omega) * G * sign);
    if !keeps_away(loop_gains, asked.modulus) {
        return None;
    }
    let closed = gains.controller().closed(&channel.A, &(&channel.B * sign), &channel.C);
    let merit = channel.unmoved.merit(&poles_of(&closed)?)?;
    (!asked.all || merit.is_sound(asked.speed)).then_some(merit.slowest)
}

/// The fastest first; of those that are as fast, the one with most integral gain.
fn in_order(mut sound: Vec<(Gains, f64, f64)>) -> Vec<(Gains, f64)> {
    let mut ordered = Vec::with_capacity(sound.len());
    while !sound.is_empty() {
        let fastest = sound.iter().map(|(.., slowest)| *slowest).fold(0.0, f64::max);
        let as_fast = (0..sound.len()).filter(|&i| sound[i].2 >= AS_FAST * fastest);
        let best = as_fast.max_by(|&i, &j| sound[i].0.K_i.total_cmp(&sound[j].0.K_i)).unwrap_or(0);
        let (gains, sign, _) = sound.swap_remove(best);
        ordered.push((gains, sign));
    }
    ordered
}
