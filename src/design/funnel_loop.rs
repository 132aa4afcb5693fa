//! Plants under funnel control with filtered errors, which follow a reference that starts smoothly.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector, RowDVector};

use super::step::exponential;

/// Time for which a reference is followed, in 1/W.
pub const FOLLOWED: f64 = 15.0;
/// Rate of the reference's smooth start, in W.
pub const SMOOTH_START: f64 = 2.0;
/// Largest error, in parts of its bound, with a control that is constant within steps.
const MOST_SAMPLED: f64 = 0.8;
/// Number of halvings of the step for that, and the most samples that are tried.
const HALVINGS: i32 = 8;
const MOST_SAMPLES: f64 = 2e5;
/// Steps of the simulation at most.
const MOST_STEPS: usize = 20_000;

/// The funnel of a channel, with times in 1/W.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// Size of the reference.
    pub reference: f64,
    /// Bound of the error at the start.
    pub psi_0: f64,
    /// Bound of the error in the end.
    pub psi_inf: f64,
    /// Rate at which the bound narrows.
    pub decay_rate: f64,
    /// Time constant of the error's filter.
    pub tau: f64,
    /// Gain.
    pub g: f64,
}

impl Channel {
    /// ψ(t) = (ψ_0 − ψ_∞) e^(−l t) + ψ_∞.
    pub fn bound(&self, t: f64) -> f64 {
        (self.psi_0 - self.psi_inf) * (-self.decay_rate * t).exp() + self.psi_inf
    }
}

/// A plant under funnel control, with times in 1/W.
#[derive(Debug)]
pub struct Loop<'a> {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    /// C A^i, a matrix a derivative.
    outputs: Vec<DMatrix<f64>>,
    G: &'a DMatrix<f64>,
    channels: &'a [Channel],
}

/// Result of following a reference.
#[derive(Debug, Clone)]
pub struct Followed {
    /// The largest of all errors in parts of their bounds.
    pub largest_part: f64,
    /// The largest error in parts of its bound, latest.
    pub left: f64,
    /// The lowest and the highest value of each control.
    pub control: Vec<[f64; 2]>,
    /// Time when an error left its funnel, or the end.
    pub until: f64,
}

impl Followed {
    fn take(&mut self, now: &Answer) {
        self.largest_part = self.largest_part.max(now.largest_part);
        self.left = now.error_part;
        for ([lowest, highest], &u) in self.control.iter_mut().zip(now.u.iter()) {
            (*lowest, *highest) = (lowest.min(u), highest.max(u));
        }
    }

    /// True if all errors stayed inside.
    pub fn stayed(&self) -> bool {
        self.until >= FOLLOWED
    }

    /// Size of the largest error, more than 1 of one that leaves, the sooner the more; how far each control goes up and down.
    pub fn respects(&self) -> impl Iterator<Item = f64> {
        let error = if self.stayed() { self.largest_part } else { 1.0 + FOLLOWED - self.until };
        [error].into_iter().chain(self.control.iter().flat_map(|[low, high]| [*high, -low]))
    }

    /// The worse of both in each respect.
    #[must_use]
    pub fn or_worse(mut self, other: &Self) -> Self {
        self.largest_part = self.largest_part.max(other.largest_part);
        self.left = self.left.max(other.left);
        self.until = self.until.min(other.until);
        for ([low, high], other) in self.control.iter_mut().zip(&other.control) {
            (*low, *high) = (low.min(other[0]), high.max(other[1]));
        }
        self
    }
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
    /// A plant whose control shows in this derivative of each output, with a funnel for each channel.
    pub fn new([A, B, C]: [&DMatrix<f64>; 3], degree: usize, G: &'a DMatrix<f64>, channels: &'a [Channel]) -> Self {
        let mut outputs = vec![C.clone()];
        (1..degree).for_each(|i| outputs.push(&outputs[i - 1] * A));
        Loop { A: A.clone(), B: B.clone(), outputs, G, channels }
    }

    /// u = −G g b(e_r), with e_1 = e/ψ, e_(i+1) = τ^i e^(i)/ψ + b(e_i) and b(e) = e/(1 − e²); `None` outside.
    fn answer(&self, t: f64, x: &DVector<f64>) -> Option<Answer> {
        let (m, n) = (self.B.ncols(), x.len());
        let start = smooth_start(t);
        let mut asked = DVector::zeros(m);
        let mut slopes = DMatrix::zeros(m, n);
        let (mut largest_part, mut error_part) = (0.0_f64, 0.0_f64);
        for (i, channel) in self.channels.iter().enumerate() {
            let Channel { reference, tau, g, .. } = *channel;
            let psi = channel.bound(t);
            let (mut part, mut gradient) = (0.0, RowDVector::zeros(n));
            let mut power = 1.0;
            for (level, C) in self.outputs.iter().enumerate() {
                let row = C.row(i);
                let error = (row * x)[0] - reference * start[level];
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
                power *= tau;
            }
            let (value, slope) = barrier(part);
            asked[i] = -g * value;
            slopes.set_row(i, &(gradient * (-g * slope)));
        }
        Some(Answer { u: self.G * asked, gradient: self.G * slopes, largest_part, error_part })
    }

    /// The longest step of which the control may be constant within each, from a given one on: halved until the errors of the
    /// sampled loop stay inside. A fast zero on the left needs shorter steps than the funnel itself.
    pub fn sampled(&self, longest: f64) -> Option<f64> {
        let stays = |step: &f64| self.stays_inside(*step);
        // What takes too many samples isn't tried.
        let mut halved =
            (0..HALVINGS).map(|k| longest * 0.5_f64.powi(k)).take_while(|step| FOLLOWED / step < MOST_SAMPLES);
        halved.find(stays)
    }

    /// True if the errors stay well inside with a control that is constant within such steps.
    fn stays_inside(&self, step: f64) -> bool {
        let followed = self.follow_sampled(step);
        followed.stayed() && followed.largest_part <= MOST_SAMPLED
    }

    /// Follows the reference at the samples of a loop whose control is constant within such steps.
    pub fn follow_sampled(&self, step: f64) -> Followed {
        let (n, m) = self.B.shape();
        let mut followed = Followed { largest_part: 0.0, left: 0.0, control: vec![[0.0; 2]; m], until: 0.0 };
        let mut whole = DMatrix::zeros(n + m, n + m);
        whole.view_mut((0, 0), (n, n)).copy_from(&(&self.A * step));
        whole.view_mut((0, n), (n, m)).copy_from(&(&self.B * step));
        let Some(over) = exponential(whole) else { return followed };
        let (A, B) = (over.view((0, 0), (n, n)), over.view((0, n), (n, m)));
        let mut x = DVector::zeros(n);
        for k in 0..(FOLLOWED / step) as usize {
            followed.until = k as f64 * step;
            let Some(now) = self.answer(followed.until, &x) else { return followed };
            followed.take(&now);
            x = A * &x + B * now.u;
        }
        followed.until = FOLLOWED;
        followed
    }

    fn rates(&self, t: f64, x: &DVector<f64>) -> Option<DVector<f64>> {
        Some(&self.A * x + &self.B * self.answer(t, x)?.u)
    }

    /// Follows the reference from rest by the linearly implicit method of L. F. Shampine and M. W. Reichelt, The MATLAB ODE
    /// suite, SIAM J. Scientific Computing 18 (1997) 1–22, of order 2 with an estimate of order 3.
    pub fn follow(&self) -> Followed {
        self.watch(|_, _, _| ())
    }

    /// The same, for who looks at each time, 1/W, the outputs and the controls.
    pub fn watch(&self, mut look: impl FnMut(f64, DVector<f64>, &DVector<f64>)) -> Followed {
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
            look(t, &self.outputs[0] * &x, &now.u);
            followed.take(&now);
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
pub fn smooth_start(t: f64) -> [f64; 3] {
    let (a, at) = (SMOOTH_START, SMOOTH_START * t);
    let decayed = (-at).exp();
    let half = 0.5 * at * at;
    [1.0 - decayed * (1.0 + at + half), a * decayed * half, a * a * decayed * (at - half)]
}
