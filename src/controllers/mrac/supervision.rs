//! Supervision after each step: samples, controls at their limits, estimates at their bounds, and steps that are too long.

use super::Mrac;
use crate::controllers::sampling::Sampling;
use crate::system::{Point, Scalar, Values, larger};

impl Mrac {
    /// Looks at the unit at t after a step.
    pub(super) fn supervise<S: Scalar>(&self, (t, step): (S, S), v: &mut Point<S>) {
        let is_sampled = self.is_sampled(&v.values());
        v.when(is_sampled, |v| self.keep_to_communication_points(t, step, v));
        let (active, settling_time) = (self.in_command.is_active(&v.values()), v[self.design.settling_time]);
        self.supervised.look((t, step), settling_time, active, v);
        self.count_projections(v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        v.when(active, |v| self.judge_step(step, v));
    }

    /// At a communication point: takes the first step's length where it is to be the sample time.
    fn keep_to_communication_points<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let first = |v: &mut Point<S>| {
            self.discretise(v);
            self.sample(v);
        };
        let remnant = |v: &mut Point<S>| v.copy(self.x_m, self.samples.x_m_before);
        self.samples.sampling.keep_to_communication_points((t, step), first, remnant, v);
    }

    /// Warns of a step that is longer than the sample time, or too long for the oscillation of estimates and plant.
    fn judge_step<S: Scalar>(&self, step: S, v: &mut Point<S>) {
        let Sampling { sample_time, clock } = &self.samples.sampling;
        let overrun = clock.is_overrun(step, &v.values());
        self.supervised.judge(overrun, v, |v| clock.overrun_warning(step, v, &v.name(*sample_time)));
        let acts = larger(step, v[clock.period]);
        let frequency = v[self.adaptation_frequency];
        let [first, at_once] = self.design.longest_steps(frequency, &v.values());
        let too_long = acts.above(at_once) & !overrun;
        self.supervised.judge(too_long, v, |v: &Values<S>| {
            format!(
                "a control is constant for {} s, too long for the adaptation, which turns at {} rad/s with these signals. Use {} s or \
                 less, {} s where the plant is stepped first, a smaller {}, or the loop as a single FMU",
                acts.scientific(3),
                frequency.scientific(3),
                at_once.scientific_at_most(1),
                first.scientific_at_most(1),
                v.name(self.design.adaptation_gain)
            )
        });
    }
}
