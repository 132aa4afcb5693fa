//! Checks after each step: estimates at their bounds, controls at their limits, and the length of the step.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::MracPpfUnmatched;
use crate::mathematics::projection::is_in_layer;
use crate::system::{Point, Scalar, Values, larger};

impl MracPpfUnmatched {
    /// Looks at the unit at t after a step.
    pub(super) fn supervise<S: Scalar>(&self, (t, step): (S, S), v: &mut Point<S>) {
        let (active, settling_time) = (self.in_command.is_active(&v.values()), v[self.settling_time]);
        self.supervised.look((t, step), settling_time, active, v);
        self.count_projections(active, v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        v.when(active, |v| {
            self.guarantee.look(t, self.funnel.error(), v);
            self.judge_step(step, v);
        });
    }

    /// Fastest rate, in 1/s, at which a barrier brings an error back, at the narrowest funnel and the nominal input
    /// gain. With a zero-order hold, the loop oscillates if the step exceeds 1/s to 2/s, depending on the order in
    /// which components are stepped.
    pub(super) fn stiffness<S: Scalar>(&self, v: &Values<S>) -> S {
        (0..self.x.len()).map(|i| self.barrier_rate(i, v)).fold(S::from(0.0), larger)
    }

    /// K_ε/ρ_∞² of a row.
    pub(super) fn barrier_rate<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let width = self.funnel.narrowest(i, v);
        v[self.K_epsilon][i] / (width * width)
    }

    fn judge_step<S: Scalar>(&self, step: S, v: &mut Point<S>) {
        let stiffness = self.stiffness(&v.values());
        let too_long = (step * stiffness).above(S::from(1.0));
        self.supervised.judge(too_long, v, |_| {
            format!(
                "the communication step {} s is too long for the barrier of a funnel, which brings its error back at {} 1/s. Use \
                 {} s or less, twice that where the plant is stepped first, or the loop as a single FMU",
                step.scientific(3),
                stiffness.scientific(3),
                stiffness.recip().scientific_at_most(1)
            )
        });
    }

    /// Counts estimates at their bounds, and warns of them.
    fn count_projections<S: Scalar>(&self, active: S::Flag, v: &mut Point<S>) {
        let tolerance = v[self.projection_tolerance];
        let is_in_its_layer = |estimate: S, bound: S| S::from_flag(is_in_layer(estimate, -bound, bound, tolerance));
        let mut count = S::from(0.0);
        for i in 0..self.x.len() {
            count += is_in_its_layer(v[self.sigma_hat][i], v[self.sigma_bound][i]);
            for j in 0..self.x.len() {
                count += is_in_its_layer(v[self.theta_hat.at(j, i)], v[self.theta_bound][i]);
            }
        }
        v.put(self.projection_active, count.to_integer());
        v.when(active & count.above(S::from(0.0)), |v| {
            v.warn(self.at_bounds, |v| {
                let [theta_bound, sigma_bound] = [self.theta_bound, self.sigma_bound].map(|it| v.name(it));
                format!(
                    "{} of the estimates at a bound: if this lasts, only the barriers act against the rest. Widen \
                     {theta_bound} or {sigma_bound} if tracking suffers",
                    count.to_text()
                )
            });
        });
    }
}
