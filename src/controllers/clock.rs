//! The clock of a sampled controller: at instants of its own, whatever steps a master makes.
//!
//! Sample k belongs to the time t_0 + k T. The computations of a sample depend only on k, on the state after the last
//! one and on the present inputs, so that a master's communication points between two samples change no bit of it.

use crate::system::{Declaration, Discrete, Point, SamplingClock, Scalar, ScalarOf, Values, scalar, smaller};

/// The shortest sample time, s.
pub(super) const SHORTEST: f64 = 1e-9;
/// Communication points this near to a sample, in parts of the sample time, are the sample's own.
const EARLY: f64 = 1e-9;
/// A master's count of its points may run away from k T by this much of a step from one sample to the next, by rounding.
const ROUNDING: f64 = 1e-6;

/// Clock of samples.
#[derive(Debug)]
pub(super) struct Clock {
    /// T; 0 as long as it isn't known.
    pub period: ScalarOf<Discrete>,
    /// t_0, the number of samples that were taken, and how far the master's points are from t_0 + k T, by rounding.
    pub start: ScalarOf<Discrete>,
    pub count: ScalarOf<Discrete>,
    shift: ScalarOf<Discrete>,
}

impl Clock {
    /// Declares a clock with this sample time.
    pub fn declare(d: &mut Declaration, period: ScalarOf<Discrete>) -> Self {
        let [start, count, shift] =
            ["#sampling start", "#samples", "#sample shift"].map(|name| d.discrete(scalar(name, "").hidden()));
        d.sampling_clock(SamplingClock { period, start, count, shift });
        Clock { period, start, count, shift }
    }

    /// The time that the latest sample belongs to.
    pub fn latest<S: Scalar>(&self, v: &Values<S>) -> S {
        v[self.start] + v[self.count] * v[self.period]
    }

    /// Time of the next sample; infinity if there is none. It is slightly early, so that a point that rounding ends too
    /// soon still counts.
    pub fn next<S: Scalar>(&self, v: &Values<S>) -> S {
        let period = v[self.period];
        let due = v[self.start] + (v[self.count] + 1.0) * period + v[self.shift];
        let early = || due - (period * EARLY + due.abs() * (4.0 * f64::EPSILON));
        S::branch(self.is_known(v), early, || S::from(f64::INFINITY))
    }

    /// True if the sample time is known.
    pub fn is_known<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v[self.period].above(S::from(0.0))
    }

    /// A sample was taken.
    pub fn tick<S: Scalar>(&self, v: &mut Point<S>) {
        v[self.count] += 1.0;
    }

    /// Shifts the next samples to this master's points if a sample was taken at the communication point t.
    pub fn follow<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let away = t - self.latest(&v.values());
        let is_near = (away - v[self.shift]).abs().at_most(smaller(step, v[self.period]) * ROUNDING);
        v[self.shift] = S::select(is_near, away, v[self.shift]);
    }

    /// True if a communication step is longer than the sample time, so that several samples see the same inputs.
    pub fn is_overrun<S: Scalar>(&self, step: S, v: &Values<S>) -> S::Flag {
        self.is_known(v) & step.above(v[self.period] * (1.0 + ROUNDING))
    }

    /// Warning text for a step that is longer.
    pub fn overrun_warning<S: Scalar>(&self, step: S, v: &Values<S>, sample_time: &str) -> String {
        format!(
            "the communication step {} s is longer than the sample time {} s: several samples are taken of the same inputs, and \
             only the last one's control is used. Step no further than {sample_time}",
            step.scientific(3),
            v[self.period].scientific_at_most(3)
        )
    }
}
