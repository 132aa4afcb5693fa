//! The clocks of sampled laws, by which C for targets counts samples.

/// The memory of a sampled law's clock: by handles, or by places.
#[derive(Debug, Clone, Copy)]
pub struct SamplingClock<T> {
    /// Sample time, s; 0 if there is none.
    pub period: T,
    /// Time of the first sample, s.
    pub start: T,
    /// Samples that were taken.
    pub count: T,
    /// Distance of a master's points from the samples by rounding, s.
    pub shift: T,
}

impl<T> SamplingClock<T> {
    /// The same by other means.
    pub(crate) fn map<R>(self, to: impl Fn(T) -> R) -> SamplingClock<R> {
        SamplingClock { period: to(self.period), start: to(self.start), count: to(self.count), shift: to(self.shift) }
    }
}
