//! The law sampled once a sample time: by the implicit Euler method, so that the stiff dynamics that it gives the
//! error are followed whatever the step is.
//!
//! With the nominal model e⁺ = e + h (A x + B u + θ̂ᵀx + Iᵀψ − D) over the time h that the law looks ahead, D being the mean
//! rate of x_m in it, the law and the adaptation at its end leave one equation a channel, for ε at the end:
//!
//! F(ε) = (ρ⁺ − h ρ'⁺) S(ε) + h ((σ̂(ε) − I)ᵀψ + ᾱ tanh(ε/φ) + K_ε ε) − e = 0,
//! σ̂(ε) = (I + γ_2 (β + h R) ε ψ)/(1 + γ_2 υ (β + h R) |ε|), R = 1/(ρ⁺ S'(ε)).
//!
//! F increases, from −∞ to ∞, so it has one root.

use num_dual::{Dual64, DualNum};

use super::MracPpf;
use crate::control::limits::within;
use crate::control::performance::{Bounds, Performance};
use crate::system::{Point, Scalar, Values};

/// Beyond this the transformation is flat in every digit.
const FLAT: f64 = 300.0;
const BRACKET: f64 = 1e12;
const ITERATIONS: usize = 200;
/// Relative precision of the root.
const PRECISION: f64 = 1e-14;

/// What F of a channel is made of.
struct Ahead {
    h: f64,
    performance: Performance<f64>,
    bounds: Bounds<f64>,
    e: f64,
}

impl MracPpf {
    /// Before the first sample: the control that leaves e/ρ as it is on the nominal plant.
    pub(super) fn hold_nominal_control(&self, t: f64, v: &mut Point) {
        self.hold(v, |i, v| {
            let inside = self.inside(i, t, v);
            self.against_nominal(i, v) + self.model_rate(i, v) + inside.z * inside.performance.rate
        });
    }

    /// Takes a sample: computes the control until the next one from the present inputs, taken as measured a sample time
    /// before, and advances model and estimates by one.
    pub(super) fn sample(&self, v: &mut Point) {
        let (n, period, before) = (self.x.len(), v[self.samples.period], self.samples.latest(&v.values()));
        let h = period * f64::from(v.get(self.prediction_steps));
        self.samples.advance_model(self.r, self.x_m, v);
        // The model moves alike as long as the reference is held: its mean rate is taken from the time that ended.
        let mean_rate = |i: usize, v: &Values<f64>| (v[self.x_m][i] - v[self.samples.x_m_before][i]) / period;
        self.hold(v, |i, v| {
            let epsilon = self.epsilon_ahead(i, before, h, v);
            let ahead = self.ahead(i, before, h, v);
            let (z, _) = ahead.inverse(epsilon);
            let sigma: f64 = (0..n).map(|j| self.sigma_ahead(i, j, &ahead, epsilon, v) * v[self.psi][j]).sum();
            let w = z * ahead.performance.rate - self.estimated(i, v) - sigma - self.robust(i, epsilon, v);
            self.against_nominal(i, v) + mean_rate(i, v) + w
        });
        for i in 0..n {
            let values = v.values();
            let (epsilon, ahead) = (self.epsilon_ahead(i, before, h, &values), self.ahead(i, before, h, &values));
            let (_, R) = ahead.inverse(epsilon);
            for j in 0..n {
                let values = v.values();
                let sigma_hat = self.sigma_ahead(i, j, &ahead, epsilon, &values);
                let (theta, integral) = self.adaptation(i, j, (epsilon, R), sigma_hat, &values);
                v[self.theta_hat.at(j, i)] += period * theta;
                v[self.integral.at(j, i)] += period * integral;
            }
        }
        v.copy(self.x_m, self.samples.x_m_before);
        self.samples.tick(v);
    }

    /// Holds the control of a wanted rate of each channel, and shows it.
    fn hold(&self, v: &mut Point, rate: impl Fn(usize, &Values<f64>) -> f64) {
        v[self.samples.held].fill(0.0);
        for i in 0..self.x.len() {
            let rate = rate(i, &v.values());
            for k in 0..self.u.len() {
                v[self.samples.held][k] += self.B_inverse[(k, i)] * rate;
            }
        }
        for k in 0..self.u.len() {
            v[self.samples.held][k] = within(v[self.samples.held][k], v[self.u_min][k], v[self.u_max][k]);
        }
        if self.is_sampled(&v.values()) {
            v.copy(self.samples.held, self.u);
        }
    }

    fn ahead(&self, i: usize, t: f64, h: f64, v: &Values<f64>) -> Ahead {
        let e = v[self.x][i] - v[self.samples.x_m_before][i];
        Ahead { h, performance: self.funnel.performance(i, t + h, v), bounds: self.funnel.bounds(i, v), e }
    }

    /// σ̂ of an element at the end.
    fn sigma_ahead<S: Scalar>(&self, i: usize, j: usize, ahead: &Ahead, epsilon: S, v: &Values<f64>) -> S {
        let (_, R) = ahead.inverse(epsilon);
        let gain = (R * ahead.h + v[self.beta][i]) * v[self.gamma_2][i];
        (gain * epsilon * v[self.psi][j] + v[self.integral.at(j, i)])
            / (gain * epsilon.abs() * v[self.upsilon][i] + 1.0)
    }

    /// F
    fn residual(&self, i: usize, ahead: &Ahead, epsilon: Dual64, v: &Values<f64>) -> Dual64 {
        let Ahead { h, performance: Performance { rho, rate, .. }, e, .. } = *ahead;
        let (z, _) = ahead.inverse(epsilon);
        let sigma = (0..self.x.len()).fold(Dual64::from_re(0.0), |sum, j| {
            let integral = v[self.integral.at(j, i)];
            sum + (self.sigma_ahead(i, j, ahead, epsilon, v) - integral) * v[self.psi][j]
        });
        let switched = (epsilon / v[self.switching_width]).tanh() * v[self.alpha_bar][i];
        z * (rho - h * rate) + (sigma + switched + epsilon * v[self.K_epsilon][i]) * h - e
    }

    /// The root of F, by Newton's method within a bracket.
    fn epsilon_ahead(&self, i: usize, t: f64, h: f64, v: &Values<f64>) -> f64 {
        let ahead = self.ahead(i, t, h, v);
        let F = |epsilon: f64| self.residual(i, &ahead, Dual64::new(epsilon, 1.0), v);
        let (mut low, mut high) = (-1.0, 1.0);
        while F(high).re < 0.0 && high < BRACKET {
            high *= 2.0;
        }
        while F(low).re > 0.0 && low > -BRACKET {
            low *= 2.0;
        }
        let mut epsilon = 0.0;
        for _ in 0..ITERATIONS {
            let value = F(epsilon);
            if value.re > 0.0 {
                high = epsilon
            } else {
                low = epsilon
            }
            let newton = epsilon - value.re / value.eps;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let moved = (next - epsilon).abs();
            epsilon = next;
            if moved <= PRECISION * epsilon.abs() {
                break;
            }
        }
        epsilon
    }
}

impl Ahead {
    /// z = S(ε) and R = 1/(ρ S'(ε)).
    fn inverse<S: Scalar>(&self, epsilon: S) -> (S, S) {
        let Bounds { lower, upper } = self.bounds;
        let bounds = Bounds { lower: S::from(lower), upper: S::from(upper) };
        let limited = if epsilon.re().abs() > FLAT { S::from(FLAT * epsilon.re().signum()) } else { epsilon };
        let small = (-limited.abs() * 2.0).exp();
        let slope = small * (2.0 * (lower + upper)) / (small + 1.0).powi(2);
        (bounds.inverse(limited), (slope * self.performance.rho).recip())
    }
}
