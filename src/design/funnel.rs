//! First designs of funnel control with filtered errors: the gain for which the errors stay well inside their funnel while the
//! nominal plant follows a reference that starts smoothly.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector, RowDVector};

use super::channels::high_frequency;
use super::nominal::Nominal;
use super::step::exponential;
use super::{complex, four_digits};
use crate::error::Invalid;

/// Largest relative degree.
const MOST_DEGREE: usize = 3;
/// The largest condition of the input gain with scaled rows and columns.
const MOST_CONDITION: f64 = 1e6;
/// The error may take up so much of each funnel.
const MOST_PART: f64 = 0.7;
/// And in the end the error itself takes up so much of its own.
const MOST_LEFT: f64 = 0.45;
/// Gains in parts of R Wʳ that are tried: 10^(k/2).
const GAINS: i32 = 12;
/// Time constants of the error's filter, in 1/W.
const FILTERS: [f64; 2] = [0.5, 0.25];
/// Time for which a reference is followed, in 1/W.
const FOLLOWED: f64 = 15.0;
/// ψ_0 and ψ_∞ in parts of the reference, and the rate at which the bound narrows, in W.
pub const WIDE: f64 = 2.0;
/// See [`WIDE`].
pub const NARROW: f64 = 0.1;
/// See [`WIDE`].
pub const DECAY: f64 = 0.5;
/// Rate of the reference's smooth start, in W.
pub const SMOOTH_START: f64 = 2.0;
/// H at most in parts of the time in which an error moves through its funnel.
const STEP: f64 = 0.2;
/// With a control that is constant within steps, the errors may take up so much.
const MOST_SAMPLED: f64 = 0.8;
/// Number of halvings of the step for that, and the most samples that are tried.
const HALVINGS: i32 = 8;
const MOST_SAMPLES: f64 = 2e5;
/// Steps of the simulation at most.
const MOST_STEPS: usize = 20_000;

/// A design.
#[derive(Debug)]
pub struct Design {
    /// Relative degree r.
    pub degree: usize,
    /// Direction: from the outputs of the channels to the controls.
    pub G: DMatrix<f64>,
    /// Gain of every channel.
    pub g: f64,
    /// Time constant of the error's filter, s.
    pub tau: f64,
    /// The largest error in parts of its bound.
    pub largest_part: f64,
    /// The lowest and the highest value of each control.
    pub control: Vec<[f64; 2]>,
    /// Communication step at most, s.
    pub step: f64,
    /// True if the errors stay inside with a control that is constant within such steps.
    pub is_sampled: bool,
    /// How far the output is from the reference in the end, in parts of it.
    pub left: f64,
}

/// A funnel for references of one size.
///
/// # Errors
/// Why there is none.
pub fn design(plant: &Nominal, reference: f64) -> Result<Design, Invalid> {
    if plant.delay.iter().any(|&delay| delay > 0.0) {
        return Err(Invalid::because(
            "delay: a funnel controller takes no dead time. `new pid` or `new ladrc` may find a controller",
        ));
    }
    let (degree, G) = direction(plant)?;
    if let Some(zero) = plant.zeros.iter().find(|zero| zero.re > -1e-6 * zero.norm().max(1.0)) {
        return Err(Invalid::because(format!(
            "the plant has a zero at {} rad/s, not in the left half plane: what the outputs don't show would grow. `new pid` or \
             `new ladrc` may find a controller",
            complex(zero * plant.bandwidth)
        )));
    }
    let W = plant.bandwidth;
    for k in 0..=GAINS {
        for tau in FILTERS {
            let g = reference * 10_f64.powf(f64::from(k) / 2.0);
            let loop_ = Loop::new(plant, degree, &G, reference, g, tau);
            let followed = loop_.follow();
            if followed.largest_part <= MOST_PART && followed.left <= MOST_LEFT && followed.until >= FOLLOWED {
                let speed = g * tau.powi(degree as i32 - 1);
                let fitted = four_digits(g * W.powi(degree as i32));
                let longest = STEP * NARROW * reference / speed;
                let sampled = loop_.sampled(longest);
                return Ok(Design {
                    degree,
                    G: (&G / W.powi(degree as i32)).map(four_digits),
                    g: fitted,
                    tau: four_digits(tau / W),
                    largest_part: followed.largest_part,
                    control: followed.control,
                    step: sampled.unwrap_or(longest) / W,
                    is_sampled: sampled.is_some(),
                    left: followed.left * NARROW,
                });
            }
            if degree == 1 {
                break;
            }
        }
    }
    Err(Invalid::because(format!(
        "no gain keeps the error of the nominal plant within {MOST_PART} of its funnel while it follows a reference of {reference} \
         at {W} rad/s. Give a lower --bandwidth, or try `new pid` or `new ladrc`"
    )))
}

/// The relative degree of all outputs, and the inverse of the input gain, with time in 1/W.
fn direction(plant: &Nominal) -> Result<(usize, DMatrix<f64>), Invalid> {
    let dependent = || {
        Invalid::because(
            "A, B, C: the controls must move the outputs, or their derivatives, independently of each other. `new pid` or `new ladrc` may find a controller",
        )
    };
    let (degrees, gain) = high_frequency(plant).ok_or_else(dependent)?;
    let degree = degrees[0];
    if let Some(i) = degrees.iter().position(|&other| other != degree) {
        return Err(Invalid::because(format!(
            "the control shows in derivative {degree} of output 1 and in derivative {} of output {}. A funnel controller needs the \
             same for all. `new pid` or `new ladrc` may find a controller",
            degrees[i],
            i + 1
        )));
    }
    if degree > MOST_DEGREE {
        return Err(Invalid::because(format!(
            "the control shows in derivative {degree} of the outputs (relative degree {degree}). A funnel controller takes up to \
             {MOST_DEGREE}. `new pid` or `new ladrc` may find a controller"
        )));
    }
    // An input that acts on no output, and numbers beyond what a float holds.
    if gain.row_iter().any(|row| row.amax() == 0.0) || gain.column_iter().any(|column| column.amax() == 0.0) {
        return Err(dependent());
    }
    let mut scaled = gain.clone();
    scaled.row_iter_mut().for_each(|mut row| row.scale_mut(row.amax().recip()));
    scaled.column_iter_mut().for_each(|mut column| column.scale_mut(column.amax().recip()));
    if scaled.iter().any(|entry| !entry.is_finite()) {
        return Err(dependent());
    }
    let sizes = scaled.singular_values();
    let condition = sizes.max() / sizes.min();
    if condition.is_nan() || condition > MOST_CONDITION {
        return Err(dependent());
    }
    Ok((degree, gain.try_inverse().ok_or_else(dependent)?))
}

/// The nominal plant under funnel control.
struct Loop<'a> {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    /// C A^i, a matrix a derivative.
    outputs: Vec<DMatrix<f64>>,
    G: &'a DMatrix<f64>,
    reference: f64,
    g: f64,
    tau: f64,
}

/// How a reference was followed.
struct Followed {
    largest_part: f64,
    /// The largest error in parts of its bound, latest.
    left: f64,
    control: Vec<[f64; 2]>,
    /// When an error left its funnel, or the end.
    until: f64,
}

/// The control law at a state.
struct Answer {
    u: DVector<f64>,
    /// ∂u/∂x
    gradient: DMatrix<f64>,
    largest_part: f64,
    /// That of the errors themselves.
    error_part: f64,
}

impl<'a> Loop<'a> {
    fn new(plant: &Nominal, degree: usize, G: &'a DMatrix<f64>, reference: f64, g: f64, tau: f64) -> Self {
        let mut outputs = vec![plant.C.clone()];
        (1..degree).for_each(|i| outputs.push(&outputs[i - 1] * &plant.A));
        Loop { A: plant.A.clone(), B: plant.B.clone(), outputs, G, reference, g, tau }
    }

    /// u = −G g b(e_r), with e_1 = e/ψ, e_(i+1) = τ^i e^(i)/ψ + b(e_i) and b(e) = e/(1 − e²); `None` outside.
    fn answer(&self, t: f64, x: &DVector<f64>) -> Option<Answer> {
        let (m, n) = (self.B.ncols(), x.len());
        let psi = self.reference * ((WIDE - NARROW) * (-DECAY * t).exp() + NARROW);
        let r = smooth_start(t).map(|derivative| derivative * self.reference);
        let mut asked = DVector::zeros(m);
        let mut slopes = DMatrix::zeros(m, n);
        let (mut largest_part, mut error_part) = (0.0_f64, 0.0_f64);
        for i in 0..m {
            let (mut part, mut gradient) = (0.0, RowDVector::zeros(n));
            let mut power = 1.0;
            for (level, C) in self.outputs.iter().enumerate() {
                let row = C.row(i);
                let error = (row * x)[0] - r[level];
                let (inner, slope) = if level == 0 { (0.0, 0.0) } else { barrier(part) };
                gradient = row * (power / psi) + gradient * slope;
                part = power * error / psi + inner;
                if part.is_nan() || part.abs() >= 1.0 {
                    return None;
                }
                largest_part = largest_part.max(part.abs());
                if level == 0 {
                    error_part = error_part.max(part.abs());
                }
                power *= self.tau;
            }
            let (value, slope) = barrier(part);
            asked[i] = -self.g * value;
            slopes.set_row(i, &(gradient * (-self.g * slope)));
        }
        Some(Answer { u: self.G * asked, gradient: self.G * slopes, largest_part, error_part })
    }

    /// The longest step of which the control may be constant within each, from a given one on: halved until the errors of the
    /// sampled loop stay inside. A fast zero on the left needs shorter steps than the funnel itself.
    fn sampled(&self, longest: f64) -> Option<f64> {
        let stays = |step: &f64| self.stays_inside(*step);
        // What takes too many samples isn't tried.
        let mut halved =
            (0..HALVINGS).map(|k| longest * 0.5_f64.powi(k)).take_while(|step| FOLLOWED / step < MOST_SAMPLES);
        halved.find(stays)
    }

    fn stays_inside(&self, step: f64) -> bool {
        let (n, m) = self.B.shape();
        let mut whole = DMatrix::zeros(n + m, n + m);
        whole.view_mut((0, 0), (n, n)).copy_from(&(&self.A * step));
        whole.view_mut((0, n), (n, m)).copy_from(&(&self.B * step));
        let Some(over) = exponential(whole) else { return false };
        let (A, B) = (over.view((0, 0), (n, n)), over.view((0, n), (n, m)));
        let mut x = DVector::zeros(n);
        let samples = (FOLLOWED / step) as usize;
        (0..samples).all(|k| {
            let Some(now) = self.answer(k as f64 * step, &x) else { return false };
            x = A * &x + B * now.u;
            now.largest_part <= MOST_SAMPLED
        })
    }

    fn rates(&self, t: f64, x: &DVector<f64>) -> Option<DVector<f64>> {
        Some(&self.A * x + &self.B * self.answer(t, x)?.u)
    }

    /// Follows the reference from rest by the linearly implicit method of L. F. Shampine and M. W. Reichelt, The MATLAB ODE
    /// suite, SIAM J. Scientific Computing 18 (1997) 1–22, of order 2 with an estimate of order 3.
    fn follow(&self) -> Followed {
        let n = self.A.nrows();
        let d = (2.0 + 2.0_f64.sqrt()).recip();
        let (mut t, mut h, mut x) = (0.0_f64, 1e-4_f64, DVector::zeros(n));
        let mut scale = DVector::from_element(n, 0.0);
        let mut followed =
            Followed { largest_part: 0.0, left: 0.0, control: vec![[0.0; 2]; self.B.ncols()], until: 0.0 };
        for _ in 0..MOST_STEPS {
            if t >= FOLLOWED {
                break;
            }
            h = h.min(FOLLOWED - t).max(1e-12);
            let Some(now) = self.answer(t, &x) else { break };
            followed.largest_part = followed.largest_part.max(now.largest_part);
            followed.left = now.error_part;
            for ([lowest, highest], &u) in followed.control.iter_mut().zip(now.u.iter()) {
                (*lowest, *highest) = (lowest.min(u), highest.max(u));
            }
            let f0 = &self.A * &x + &self.B * &now.u;
            let jacobian = &self.A + &self.B * now.gradient;
            let dt = 1e-7 * h;
            let in_time = self.rates(t + dt, &x).map_or(DVector::zeros(n), |later| (later - &f0) / dt);
            let W = (DMatrix::identity(n, n) - jacobian * (h * d)).lu();
            let stages = || {
                let k1 = W.solve(&(&f0 + &in_time * (h * d)))?;
                let f1 = self.rates(t + 0.5 * h, &(&x + &k1 * (0.5 * h)))?;
                let k2 = W.solve(&(&f1 - &k1))? + &k1;
                let next = &x + &k2 * h;
                let f2 = self.rates(t + h, &next)?;
                let middle = (&k2 - &f1) * (6.0 + 2.0_f64.sqrt());
                let k3 = W.solve(&(&f2 - middle - (&k1 - &f0) * 2.0 + &in_time * (h * d)))?;
                Some((next, (k1 - k2 * 2.0 + k3) * (h / 6.0)))
            };
            let Some((next, error)) = stages() else {
                h *= 0.25;
                if h < 1e-11 {
                    break;
                }
                continue;
            };
            scale = scale.sup(&next.abs());
            let size = scale.amax().max(1e-300);
            let wrong =
                error.iter().zip(scale.iter()).map(|(e, s)| e.abs() / (1e-4 * s.max(1e-3 * size))).fold(0.0, f64::max);
            if wrong <= 1.0 {
                (t, x) = (t + h, next);
                followed.until = t;
            }
            h *= (0.8 / wrong.max(1e-9).cbrt()).clamp(0.2, 4.0);
        }
        followed
    }
}

/// b(e) = e/(1 − e²), and its derivative.
fn barrier(e: f64) -> (f64, f64) {
    let left = 1.0 - e * e;
    (e / left, (1.0 + e * e) / (left * left))
}

/// s(t) = 1 − e^(−a t) (1 + a t + (a t)²/2) and its first two derivatives.
fn smooth_start(t: f64) -> [f64; 3] {
    let (a, at) = (SMOOTH_START, SMOOTH_START * t);
    let decayed = (-at).exp();
    let half = 0.5 * at * at;
    [1.0 - decayed * (1.0 + at + half), a * decayed * half, a * a * decayed * (at - half)]
}
