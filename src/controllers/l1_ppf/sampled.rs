//! The barrier sampled once a sample time: by the implicit Euler method, so that it doesn't throw an error out of its funnel
//! however stiff it is against the step.
//!
//! With e⁺ = e + h u_ε over the time h that it looks ahead, and the barrier of the end, each channel has one equation for
//! ε at the end, within the bound ρ that stands:
//!
//! F(ε) = ρ S(ε) + h K_ε R(ε) ε − e = 0, R = 1/(ρ S'(ε)).
//!
//! F increases, from −∞ to ∞ where K_ε > 0, so it has one root. The barrier's output, −K_ε R(ε) ε, is constant until
//! the next sample.
#![allow(non_snake_case)] // R is the thesis' name

use super::L1Ppf;
use crate::controllers::sampling::{Evaluation, Sampling, prediction_steps};
use crate::mathematics::performance::Bounds;
use crate::mathematics::root;
use crate::system::{Declaration, Discrete, IntegerOf, Invalid, Parameter, Point, Scalar, Values, VectorOf, vector};

/// The clock of the barrier, and what it holds between samples.
#[derive(Debug)]
pub(super) struct Samples {
    pub sampling: Sampling,
    prediction_steps: IntegerOf<Parameter>,
    /// u_ε until the next sample.
    pub control: VectorOf<Discrete>,
}

/// Terms of F of a channel.
#[derive(Debug, Clone, Copy)]
struct Ahead<S> {
    h: S,
    rho: S,
    bounds: Bounds<S>,
    e: S,
    K_epsilon: S,
}

impl Samples {
    /// Declares the samples of m controls.
    pub fn declare(d: &mut Declaration, m: usize) -> Self {
        Samples {
            prediction_steps: d.parameter(prediction_steps()),
            sampling: Sampling::declare(d),
            control: d.discrete(vector("#held", m, "").hidden()),
        }
    }
}

impl L1Ppf {
    /// True if the barrier is sampled.
    pub(super) fn is_sampled<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        let chosen = v.get(self.law.is_stepped()) & !v.get(self.evaluation).is(Evaluation::Continuous);
        if self.samples.is_some() { chosen } else { false.into() }
    }

    /// Does something with the samples where there are any.
    pub(super) fn when_sampled<S: Scalar>(&self, v: &mut Point<S>, act: impl FnOnce(&Samples, &mut Point<S>)) {
        let Some(samples) = &self.samples else { return };
        let is_sampled = self.is_sampled(&v.values());
        v.when(is_sampled, |v| act(samples, v));
    }

    /// Refuses to sample where each control shows after two derivatives: there is no such form.
    pub(super) fn refuse_samples<S: Scalar>(&self, v: &mut Point<S>) {
        for item in [Evaluation::Automatic, Evaluation::Sampled] {
            v.refuse(v.get(self.evaluation).is(item), |v| {
                let name = if item == Evaluation::Sampled { "sampled" } else { "automatic" };
                let allowed =
                    "must be continuous: the barrier can be sampled only where there is a control for each state";
                Invalid::new(v.name(self.evaluation), name, allowed)
            });
        }
    }

    /// True if an error isn't judged now: at the start, before the first sample, and where its funnel opens to it at the
    /// next one.
    pub(super) fn waits_for_sample<S: Scalar>(&self, t: S, v: &Values<S>) -> S::Flag {
        let Some(samples) = &self.samples else { return false.into() };
        let is_start = t.at_most(v[samples.sampling.clock.start]);
        self.is_sampled(v) & (is_start | self.funnel.reopens(v))
    }

    /// Starts the clock at t. Until the first sample the barrier adds nothing, and no error is judged: where the plant is
    /// stepped first, a unit starts with what is measured at the end of its first step.
    pub(super) fn begin_sampling<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        if let Some(samples) = &self.samples {
            samples.sampling.begin(t, self.is_sampled(&v.values()), v);
            v[samples.control].fill(S::from(0.0));
        }
    }

    /// Takes a sample that is due at t.
    pub(super) fn sample_where_due<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let Some(samples) = &self.samples else { return };
        let is_due = samples.sampling.clock.next(&v.values()).at_most(t);
        v.when(is_due, |v| self.sample(samples, t, v));
    }

    /// Takes a sample: looks at the funnel, and finds what the barrier adds until the next sample.
    fn sample<S: Scalar>(&self, samples: &Samples, t: S, v: &mut Point<S>) {
        let h = v[samples.sampling.clock.period] * S::from_integer(v.get(samples.prediction_steps));
        v[samples.control].fill(S::from(0.0));
        let active = self.law.is_active(&v.values());
        v.when(active, |v| {
            self.funnel.look_from_now_on(v);
            self.funnel.event(t, |i, v| self.error(i, v), v);
            for i in 0..self.barrier_gain.len() {
                let asked = self.ahead(i, t, h, &v.values()).asked();
                for (j, of_channel) in self.reached(i) {
                    v[samples.control][j] += asked * of_channel;
                }
            }
        });
        samples.sampling.clock.tick(v);
    }

    fn ahead<S: Scalar>(&self, i: usize, t: S, h: S, v: &Values<S>) -> Ahead<S> {
        Ahead {
            h,
            rho: self.funnel.performance(i, t, v).rho,
            bounds: self.funnel.bounds(i, v),
            e: self.error(i, v),
            K_epsilon: v[self.barrier_gain][i],
        }
    }

    /// Takes the first step's length at a communication point if it is to be the sample time, and warns of steps that
    /// are longer than that.
    pub(super) fn keep_to_communication_points<S: Scalar>(
        &self,
        samples: &Samples,
        (t, step): (S, S),
        v: &mut Point<S>,
    ) {
        let first = |v: &mut Point<S>| {
            self.sample(samples, t, v);
            v.copy(samples.control, self.added.now);
            self.law.show_with_added(v);
        };
        samples.sampling.keep_to_communication_points((t, step), first, |_| {}, v);
    }

    /// Warns of a communication step that is longer than the sample time.
    pub(super) fn judge_sampling<S: Scalar>(&self, samples: &Samples, step: S, v: &mut Point<S>) {
        let Sampling { sample_time, clock } = &samples.sampling;
        let is_overrun = self.law.is_active(&v.values()) & clock.is_overrun(step, &v.values());
        self.law.judge_step_of_added(is_overrun, |v| clock.overrun_warning(step, v, &v.name(*sample_time)), v);
    }
}

impl<S: Scalar> Ahead<S> {
    /// F, and its derivative.
    fn residual(&self, epsilon: S) -> (S, S) {
        let at = self.bounds.at(epsilon, self.rho);
        let stiff = self.h * self.K_epsilon;
        (at.z * self.rho + stiff * at.R * epsilon - self.e, at.dz * self.rho + stiff * (at.R + at.dR * epsilon))
    }

    /// −K_ε R ε at the root of F.
    fn asked(&self) -> S {
        let zero = S::from(0.0);
        // R is least in the middle of the bounds.
        let least = self.h * self.K_epsilon * 2.0 / ((self.bounds.lower + self.bounds.upper) * self.rho);
        let root = || root::of_increasing(|epsilon| self.residual(epsilon), least);
        let epsilon = S::branch(self.K_epsilon.above(zero), root, || zero);
        -self.K_epsilon * self.bounds.at(epsilon, self.rho).R * epsilon
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::slopes;

    fn channel<S: Scalar>(e: f64, K_epsilon: f64, lower: f64) -> Ahead<S> {
        let bounds = Bounds { lower: S::from(lower), upper: S::from(1.0) };
        Ahead { h: S::from(0.01), rho: S::from(0.05), bounds, e: S::from(e), K_epsilon: S::from(K_epsilon) }
    }

    #[test]
    fn the_derivative_is_the_exact_one() {
        for lower in [1.0, 0.3, 0.0] {
            for epsilon in [-20.0, -1.0, -0.003, 1e-9, 0.02, 0.7, 5.0] {
                let residual = |epsilon| channel(0.03, 0.1, lower).residual(epsilon).into();
                let [(value, exact), (slope, _)] = slopes(residual, epsilon);
                let size = slope.abs() + 1e-3 * value.abs();
                assert!((exact - slope).abs() <= 1e-12 * size, "at {epsilon}: {slope}");
            }
        }
    }

    #[test]
    fn the_barrier_takes_back_no_more_than_the_error_in_the_time_that_it_looks_ahead() {
        for part in [0.01, 0.5, 0.9, 0.999, 1.0 - 1e-9, 1.5] {
            let ahead = channel::<f64>(part * 0.05, 0.1, 1.0);
            let (taken, back) = (-ahead.h * ahead.asked(), channel::<f64>(-part * 0.05, 0.1, 1.0).asked());
            assert!(taken > 0.0 && taken < ahead.e, "{taken} of {}", ahead.e);
            assert!((back + ahead.asked()).abs() < 1e-12 * back, "to both sides alike");
        }
    }

    #[test]
    fn in_short_steps_it_is_the_continuous_barrier() {
        let ahead = Ahead { h: 1e-12, ..channel::<f64>(0.04, 0.1, 1.0) };
        let (z, epsilon) = (0.8_f64, 0.5 * (1.8_f64 / 0.2).ln());
        let continuous = -0.1 / (0.05 * (1.0 - z * z)) * epsilon;
        assert!((ahead.asked() / continuous - 1.0).abs() < 1e-7, "{} is not {continuous}", ahead.asked());
    }

    #[test]
    fn without_a_gain_it_adds_nothing_wherever_the_error_is() {
        for e in [0.0, 0.02, 0.0499, 0.05, 3.0] {
            assert_eq!(channel::<f64>(e, 0.0, 1.0).asked(), 0.0);
        }
    }
}
