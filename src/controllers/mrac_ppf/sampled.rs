//! The controller sampled once a sample time by the implicit Euler method, so that it follows the stiff error dynamics
//! at any step.
//!
//! The nominal model is e⁺ = e + h (A x + B u + θ̂ᵀx + Iᵀψ − D) over the prediction time h, D being the mean rate of
//! x_m in it. With control and adaptation at its end, one equation a channel remains, for ε at the end:
//!
//! F(ε) = (ρ⁺ − h ρ'⁺) S(ε) + h ((σ̂(ε) − I)ᵀψ + ᾱ tanh(ε/φ) + K_ε ε) − e = 0,
//! σ̂(ε) = (I + γ_2 (β + h R) ε ψ)/(1 + γ_2 υ (β + h R) |ε|), R = 1/(ρ⁺ S'(ε)).
//!
//! F increases, from −∞ to ∞, so it has one root: |I| stays within |ψ|/υ. Its slope is at least h K_ε, which brackets the root.

use super::MracPpf;
use crate::mathematics::limits::within;
use crate::mathematics::performance::{Bounds, Performance, Transformed};
use crate::mathematics::root;
use crate::system::{Point, Scalar, Values};

/// Terms of F of a channel.
#[derive(Debug, Clone, Copy)]
struct Ahead<S> {
    h: S,
    performance: Performance<S>,
    bounds: Bounds<S>,
    e: S,
    beta: S,
    gamma_2: S,
    upsilon: S,
    alpha_bar: S,
    switching_width: S,
    K_epsilon: S,
}

impl MracPpf {
    /// Before the first sample: the control that leaves e/ρ as it is on the nominal plant.
    pub(super) fn hold_nominal_control<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.hold(v, |i, v| {
            let v = &v.values();
            let inside = self.inside(i, t, v);
            self.against_nominal(i, v) + self.model_rate(i, v) + inside.z * inside.performance.rate
        });
    }

    /// Takes a sample: computes the control until the next one from the present inputs, taken as measured a sample time
    /// before, and advances model and estimates by one.
    pub(super) fn sample<S: Scalar>(&self, v: &mut Point<S>) {
        let clock = &self.samples.sampling.clock;
        let (period, before) = (v[clock.period], clock.latest(&v.values()));
        let h = period * S::from_integer(v.get(self.prediction_steps));
        self.samples.advance_model((self.r, &self.angles), self.x_m, v);
        self.hold(v, |i, v| {
            // The model moves alike as long as the reference is constant: its mean rate is that of the last period.
            let mean_rate = (v[self.x_m][i] - v[self.samples.x_m_before][i]) / period;
            let values = &v.values();
            let ahead = self.ahead(i, before, h, values);
            let epsilon = ahead.root(|| self.elements(i, values));
            let wanted = self.against_nominal(i, values) + mean_rate + self.adapted(i, &ahead, epsilon, values);
            self.adapt(i, &ahead, epsilon, v);
            wanted
        });
        v.copy(self.x_m, self.samples.x_m_before);
        clock.tick(v);
    }

    /// Holds the control of a wanted rate of each channel, and shows it.
    fn hold<S: Scalar>(&self, v: &mut Point<S>, rate: impl Fn(usize, &mut Point<S>) -> S) {
        v[self.samples.control].fill(S::from(0.0));
        for i in 0..self.x.len() {
            let rate = rate(i, v);
            for k in 0..self.u.len() {
                v[self.samples.control][k] += rate * self.B_inverse[(k, i)];
            }
        }
        for k in 0..self.u.len() {
            v[self.samples.control][k] = within(v[self.samples.control][k], v[self.u_min][k], v[self.u_max][k]);
        }
        v.when(self.is_sampled(&v.values()), |v| v.copy(self.samples.control, self.u));
    }

    fn ahead<S: Scalar>(&self, i: usize, t: S, h: S, v: &Values<S>) -> Ahead<S> {
        Ahead {
            h,
            performance: self.funnel.performance(i, t + h, v),
            bounds: self.funnel.bounds(i, v),
            e: self.angles.difference(i, v[self.x][i] - v[self.samples.x_m_before][i]),
            beta: v[self.beta][i],
            gamma_2: v[self.gamma_2][i],
            upsilon: v[self.upsilon][i],
            alpha_bar: v[self.alpha_bar][i],
            switching_width: v[self.switching_width],
            K_epsilon: v[self.K_epsilon][i],
        }
    }

    /// ψ and I of a channel, element by element.
    fn elements<'a, S: Scalar>(&self, i: usize, v: &Values<'a, S>) -> impl Iterator<Item = (S, S)> + use<'a, S> {
        let (psi, integral) = (self.psi, self.integral);
        let v = *v;
        (0..psi.len()).map(move |j| (v[psi.at(j)], v[integral.at(j, i)]))
    }

    /// The part of B u that is adapted, at the end of the prediction time.
    fn adapted<S: Scalar>(&self, i: usize, ahead: &Ahead<S>, epsilon: S, v: &Values<S>) -> S {
        let at = ahead.inverse(epsilon);
        let sigma = self.elements(i, v).fold(S::from(0.0), |sum, element| {
            let (proportional, _) = ahead.proportional(epsilon, &at, element);
            sum + (proportional + element.1) * element.0
        });
        at.z * ahead.performance.rate - self.estimated(i, v) - sigma - self.robust(i, epsilon, v)
    }

    /// Advances the estimates of a channel by a sample time.
    fn adapt<S: Scalar>(&self, i: usize, ahead: &Ahead<S>, epsilon: S, v: &mut Point<S>) {
        let (at, period) = (ahead.inverse(epsilon), v[self.samples.sampling.clock.period]);
        for j in 0..self.x.len() {
            let element = (v[self.psi][j], v[self.integral.at(j, i)]);
            let sigma_hat = ahead.proportional(epsilon, &at, element).0 + element.1;
            let integral = self.integral_rate(i, j, (epsilon, at.R), sigma_hat, &v.values());
            v[self.theta_hat.at(j, i)] = self.theta_after(i, j, (epsilon, at.R), period, &v.values());
            v[self.integral.at(j, i)] += period * integral;
        }
    }
}

impl<S: Scalar> Ahead<S> {
    fn inverse(&self, epsilon: S) -> Transformed<S> {
        self.bounds.at(epsilon, self.performance.rho)
    }

    /// σ̂ − I of an element at the end, from its ψ and I, and its derivative.
    fn proportional(&self, epsilon: S, at: &Transformed<S>, (psi, integral): (S, S)) -> (S, S) {
        let (gain, dgain) = ((at.R * self.h + self.beta) * self.gamma_2, at.dR * self.h * self.gamma_2);
        let leaking = gain * epsilon.abs() * self.upsilon + 1.0;
        // σ̂ − I = g ε (ψ − sign(ε) υ I)/(1 + g υ |ε|), g = γ_2 (β + h R): nothing cancels where I is large.
        let driven = psi - epsilon.signum() * self.upsilon * integral;
        (gain * epsilon * driven / leaking, (dgain * epsilon + gain) * driven / (leaking * leaking))
    }

    /// F, and its derivative, from ψ and I of the channel.
    fn residual(&self, epsilon: S, elements: impl Iterator<Item = (S, S)>) -> (S, S) {
        let Ahead { h, performance: Performance { rho, rate, .. }, e, alpha_bar, switching_width, .. } = *self;
        let at = self.inverse(epsilon);
        let none = (S::from(0.0), S::from(0.0));
        let (sigma, dsigma) = elements.fold(none, |(sum, dsum), (psi, integral)| {
            let (proportional, dproportional) = self.proportional(epsilon, &at, (psi, integral));
            (sum + proportional * psi, dsum + dproportional * psi)
        });
        let sign = (epsilon / switching_width).tanh();
        let dswitched = (-sign * sign + 1.0) * alpha_bar / switching_width;
        let left = rho - h * rate;
        (
            at.z * left + (sigma + sign * alpha_bar + epsilon * self.K_epsilon) * h - e,
            at.dz * left + (dsigma + dswitched + self.K_epsilon) * h,
        )
    }

    /// The root of F.
    fn root<E: Iterator<Item = (S, S)>>(&self, elements: impl Fn() -> E) -> S {
        root::of_increasing(|epsilon| self.residual(epsilon, elements()), self.h * self.K_epsilon)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::slopes;

    /// A channel with bounds −δ_lo and δ_up, and its elements.
    fn channel<S: Scalar>(lower: f64, upper: f64) -> (Ahead<S>, [(S, S); 2]) {
        let number = |value: f64| S::from(value);
        let ahead = Ahead {
            h: number(0.02),
            performance: Performance::at(number(0.3), number(2.0), number(0.05), number(1.5)),
            bounds: Bounds { lower: number(lower), upper: number(upper) },
            e: number(0.2),
            beta: number(2.0),
            gamma_2: number(5e2),
            upsilon: number(0.05),
            alpha_bar: number(10.0),
            switching_width: number(0.01),
            K_epsilon: number(0.1),
        };
        (ahead, [(number(2.0), number(-0.4)), (number(-0.5), number(3.0))])
    }

    const EPSILONS: [f64; 8] = [-100.0, -20.0, -1.0, -0.003, 1e-9, 0.02, 0.7, 5.0];

    #[test]
    fn derivatives_are_the_exact_ones() {
        for (lower, upper) in [(1.0, 1.0), (0.3, 1.0), (1.0, 0.0)] {
            let functions = |at| {
                let (ahead, elements) = channel(lower, upper);
                let inverse = ahead.inverse(at);
                let (proportional, of_proportional) = ahead.proportional(at, &inverse, elements[0]);
                let (F, of_F) = ahead.residual(at, elements.into_iter());
                [inverse.z, inverse.dz, inverse.R, inverse.dR, proportional, of_proportional, F, of_F]
            };
            for epsilon in EPSILONS {
                let found = slopes(functions, epsilon);
                for (pair, what) in found.chunks(2).zip(["z", "R", "sigma_hat - I", "F"]) {
                    let [(value, exact), (slope, _)] = pair else { unreachable!() };
                    // Where a slope passes through zero, it is the difference of numbers as large as the value.
                    let size = slope.abs() + 1e-3 * value.abs();
                    assert!((exact - slope).abs() <= 1e-12 * size, "{what} at {epsilon}: {exact} is not {slope}");
                }
            }
        }
    }

    #[test]
    fn where_the_transformation_is_flat_the_derivative_is_that_of_the_rest() {
        let (ahead, elements) = channel::<f64>(1.0, 1.0);
        let F = |epsilon: f64| ahead.residual(epsilon, elements.into_iter());
        for epsilon in [-1e9, -1e3, 400.0, 1e6] {
            let (slope, secant) = (F(epsilon).1, (F(1.5 * epsilon).0 - F(0.5 * epsilon).0) / epsilon);
            assert!((slope / secant - 1.0).abs() < 1e-9, "at {epsilon}: {slope} is not {secant}");
        }
    }

    #[test]
    fn the_root_is_where_the_equation_holds() {
        for e in [-1.9, -0.2, 0.0, 0.2, 1.0, 5.0] {
            let (ahead, elements) = channel::<f64>(1.0, 1.0);
            let ahead = Ahead { e, ..ahead };
            let root = ahead.root(|| elements.into_iter());
            let width = 1e-12 * root.abs() + 1e-30;
            let around = [root - width, root + width];
            let [below, above] = around.map(|epsilon| ahead.residual(epsilon, elements.into_iter()).0);
            assert!(below <= 0.0 && above >= 0.0, "e = {e}: {root}, {below} … {above}");
        }
    }

    /// A channel as a careless user may have it, gains over decades, and its elements.
    fn drawn(random: &mut fastrand::Rng) -> (Ahead<f64>, [(f64, f64); 2]) {
        let mut between = |low: f64, high: f64| low * (high / low).powf(random.f64());
        let side = if between(1.0, 4.0) < 2.0 { -1.0 } else { 1.0 };
        let (upsilon, rho) = (between(1e-4, 10.0), between(1e-3, 1e3));
        let ahead = Ahead {
            h: between(1e-4, 1.0),
            performance: Performance { rho, rate: -between(1e-3, 3.0) * rho, ..Performance::at(0.0, rho, rho, 0.0) },
            bounds: Bounds { lower: between(0.03, 1.0), upper: between(0.03, 1.0) },
            e: rho * between(1e-5, 10.0),
            beta: between(1e-2, 1e2),
            gamma_2: between(1e-1, 1e6),
            upsilon,
            alpha_bar: between(1e-2, 1e4),
            switching_width: between(1e-5, 10.0),
            K_epsilon: between(1e-4, 1e3),
        };
        let elements = [1.0, 2.0].map(|_| {
            let psi = between(1e-2, 1e2);
            (psi, between(1e-3, 1.0) * psi / upsilon)
        });
        let upsilon = if between(1.0, 4.0) < 1.5 { 0.0 } else { upsilon };
        (Ahead { e: side * ahead.e, upsilon, ..ahead }, elements)
    }

    #[test]
    fn the_root_takes_few_evaluations_whatever_the_gains_are() {
        let mut random = fastrand::Rng::with_seed(50);
        let mut most = 0;
        for number in 0..20_000 {
            let (ahead, elements) = drawn(&mut random);
            let evaluations = std::cell::Cell::new(0);
            let root = ahead.root(|| {
                evaluations.set(evaluations.get() + 1);
                elements.into_iter()
            });
            let width = 1e-9 * root.abs();
            let [below, above] = [root - width, root + width].map(|at| ahead.residual(at, elements.into_iter()).0);
            // Where F is nothing but rounding, its sign is arbitrary.
            let rounding = 1e-14 * (ahead.e.abs() + ahead.performance.rho);
            assert!(below <= rounding && above >= -rounding, "{number}: {root} of {ahead:?}, {below} … {above}");
            most = most.max(evaluations.get());
        }
        assert!((10..=23).contains(&most), "{most} evaluations");
    }
}
