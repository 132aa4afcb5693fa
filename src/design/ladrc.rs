//! First designs of linear active disturbance rejection.
//!
//! The order of the controller needn't be the plant's relative degree: below a fast lag the plant is a chain of fewer
//! integrators. So orders 1, 2 and 3 are tried, and b_0 is what the plant has at some frequency, |G(j f)| fⁿ.
#![allow(non_snake_case)] // gains have the names of the field

use nalgebra::{Complex, DMatrix};

use super::controller::Controller;
use super::criteria::keeps_away;
use super::four_digits;
use super::nominal::{Channel, poles_of};
use super::response::logarithmic;
use super::search::{Asked, Law};
use super::step::Entry;

/// Poles of the control, in parts of the speed; the first of them that serves is taken.
const FACTORS: [f64; 4] = [1.0, 2.0, 5.0, 10.0];
/// Poles of the observer, in parts of those of the control.
const OBSERVERS: [f64; 3] = [10.0, 5.0, 3.0];
/// Frequencies at which the plant is taken for a chain of integrators: from half the speed to three times the observer's poles.
const FITTED: usize = 10;
/// A higher order must have so many times the integral gain.
const WORTH: f64 = 1.5;
/// Gain at high frequencies in parts of 1/|G| at the speed, by order: what noise of a measurement costs.
const NOISE: [f64; 3] = [100.0, 100.0, 1000.0];
/// The highest order.
const MOST_ORDER: usize = 3;

/// Gains of a channel; without their sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Order n.
    pub order: usize,
    /// Poles of the control, rad/s.
    pub omega_c: f64,
    /// Poles of the observer, rad/s.
    pub omega_o: f64,
    /// Input gain, in the output's unit of measurement per sⁿ and unit of the control.
    pub b_0: f64,
}

/// Linear active disturbance rejection.
#[derive(Debug)]
pub struct Ladrc;

impl Law for Ladrc {
    type Gains = Gains;
    const MODULUS: [f64; 2] = [2.0, 2.5];
    const ALONE: &'static [Option<usize>] = &[None];
    const TOGETHER: &'static [Option<usize>] = &[Some(1), Some(2), Some(3)];

    fn candidates(channel: &Channel, asked: &Asked, form: Option<usize>) -> impl Iterator<Item = (Gains, f64)> {
        let orders = form.map_or(1..=MOST_ORDER, |order| order..=order);
        let of = move |factor: f64| {
            let mut sound: Vec<_> = orders.clone().map(|order| of_order(channel, asked, order, factor)).collect();
            // The order that is taken first, then what is left.
            let best = |sound: &[Candidate]| sound.first().map_or(0.0, |candidate| candidate.integral);
            let chosen = (0..sound.len()).fold(0, |chosen, i| {
                if best(&sound[i]) >= WORTH * best(&sound[chosen]) && best(&sound[i]) > 0.0 { i } else { chosen }
            });
            let first = if sound.is_empty() { Vec::new() } else { sound.remove(chosen) };
            first.into_iter().chain(sound.into_iter().flatten()).map(|candidate| (candidate.gains, candidate.sign))
        };
        FACTORS.into_iter().flat_map(of)
    }

    fn controller(gains: &Gains, bandwidth: f64) -> Controller {
        gains.faster(bandwidth.recip()).controller()
    }

    fn response(gains: &Gains, bandwidth: f64) -> impl Fn(f64) -> Complex<f64> {
        let gains = gains.faster(bandwidth.recip());
        let shape = gains.shape();
        move |omega| shape(omega) / gains.b_0
    }
}

struct Candidate {
    gains: Gains,
    sign: f64,
    /// lim s K(s), in W.
    integral: f64,
}

/// Entry of the references: control and observer take ω_cⁿ r, if the references' derivatives aren't given.
pub fn entry(gains: &[Gains], S: &DMatrix<f64>, bandwidth: f64) -> Entry {
    let m = gains.len();
    let (states, mut first) = (gains.iter().map(|gains| gains.order + 1).sum(), 0);
    let (mut B, mut D) = (DMatrix::zeros(states, m), DMatrix::zeros(m, m));
    for (i, gains) in gains.iter().map(|gains| gains.faster(bandwidth.recip())).enumerate() {
        let wanted = gains.omega_c.powi(gains.order as i32);
        B[(first + gains.order - 1, i)] = wanted;
        D[(i, i)] = wanted / gains.b_0;
        first += gains.order + 1;
    }
    Entry { B, D: S * D }
}

impl Gains {
    /// With rates so many times as large.
    fn faster(self, factor: f64) -> Self {
        let (omega_c, omega_o) = (self.omega_c * factor, self.omega_o * factor);
        Gains { omega_c, omega_o, b_0: self.b_0 * factor.powi(self.order as i32), ..self }
    }

    fn rounded(self) -> Self {
        let [omega_c, omega_o, b_0] = [self.omega_c, self.omega_o, self.b_0].map(four_digits);
        Gains { omega_c, omega_o, b_0, ..self }
    }

    /// Gain of the control on the estimate of each derivative, from y on.
    fn feedback(&self) -> Vec<f64> {
        let n = self.order;
        (0..n).map(|i| binomial(n, i) * self.omega_c.powi((n - i) as i32)).collect()
    }

    /// Gain of the observer, from the output on.
    fn observer(&self) -> Vec<f64> {
        (1..=self.order + 1).map(|i| binomial(self.order + 1, i) * self.omega_o.powi(i as i32)).collect()
    }

    /// b_0 K(j ω): with e = y − z_1 and z_i = s^(i−1) z_1 − b_i(s) e, b_1 = 0, b_(i+1) = s b_i + β_i.
    fn shape(&self) -> impl Fn(f64) -> Complex<f64> + use<> {
        let (n, k, beta) = (self.order, self.feedback(), self.observer());
        move |omega| {
            let s = Complex::new(0.0, omega);
            let (mut power, mut b) = (Complex::new(1.0, 0.0), Complex::new(0.0, 0.0));
            let [mut of_output, mut of_error] = [b; 2];
            for i in 0..n {
                of_output += power * k[i];
                of_error += b * k[i];
                (power, b) = (power * s, b * s + beta[i]);
            }
            // (s + ω_c)ⁿ z_1 = Q e, where b is s b_n + β_n by now.
            let (P, Q) = (power + of_output, b + of_error);
            (of_output * Q - of_error * P + P * beta[n] / s) / (P + Q)
        }
    }

    /// lim s K(s).
    fn integral(&self) -> f64 {
        let (n, k, beta) = (self.order, self.feedback(), self.observer());
        let P = k[0];
        let Q = beta[n - 1] + (1..n).map(|i| k[i] * beta[i - 1]).sum::<f64>();
        beta[n] * P / (P + Q) / self.b_0
    }

    /// The observer with its control in it.
    fn controller(&self) -> Controller {
        let (n, size) = (self.order, self.order + 1);
        let (mut k, beta) = (self.feedback(), self.observer());
        k.push(1.0);
        let mut A = DMatrix::zeros(size, size);
        for i in 0..size {
            A[(i, 0)] -= beta[i];
            if i < n {
                A[(i, i + 1)] += 1.0;
            }
            A[(n - 1, i)] -= k[i];
        }
        let C = DMatrix::from_row_slice(1, size, &k) / self.b_0;
        Controller { A, B: DMatrix::from_column_slice(size, 1, &beta), C, D: DMatrix::zeros(1, 1) }
    }
}

/// The sound candidates of an order, those with most integral gain first.
fn of_order(channel: &Channel, asked: &Asked, order: usize, factor: f64) -> Vec<Candidate> {
    let mut sound = Vec::new();
    let omega_c = factor * asked.speed;
    let quiet = NOISE[order - 1] / channel.at(asked.speed).norm();
    for omega_o in OBSERVERS.map(|parts| parts * omega_c) {
        let unfitted = Gains { order, omega_c, omega_o, b_0: 1.0 };
        let shape: Vec<_> = channel.frequencies().iter().copied().map(unfitted.shape()).collect();
        let fast = channel.frequencies().iter().zip(&shape).filter(|(omega, _)| **omega > asked.speed);
        let loudest = fast.map(|(_, shape)| shape.norm()).fold(0.0, f64::max);
        for f in logarithmic(0.5 * asked.speed, 3.0 * omega_o, FITTED) {
            let gains = Gains { b_0: channel.at(f).norm() * f.powi(order as i32), ..unfitted };
            if !gains.b_0.is_normal() || loudest / gains.b_0 > quiet {
                continue;
            }
            if is_sound(channel, &gains, &shape, asked) {
                let written = gains.faster(channel.bandwidth()).rounded();
                sound.push(Candidate { gains: written, sign: channel.sign, integral: gains.integral() });
            }
        }
    }
    sound.sort_by(|one, other| other.integral.total_cmp(&one.integral));
    sound
}

fn is_sound(channel: &Channel, gains: &Gains, shape: &[Complex<f64>], asked: &Asked) -> bool {
    let (sign, factor) = (channel.sign, channel.sign / gains.b_0);
    if !keeps_away(shape.iter().zip(&channel.G).map(|(shape, G)| shape * G * factor), asked.modulus) {
        return false;
    }
    let closed = gains.controller().closed(&channel.A, &(&channel.B * sign), &channel.C);
    let merit = poles_of(&closed).and_then(|poles| channel.unmoved.merit(&poles));
    merit.is_some_and(|merit| !asked.all || merit.is_sound(asked.speed))
}

/// n over k.
fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |product, i| product * (n - i) as f64 / (i + 1) as f64)
}
