//! The clocks of sampled laws, by which C for targets counts samples.

/// The memory of a sampled law's clock: by handles, or by places.
#[derive(Debug, Clone, Copy)]
pub struct SamplingClock<T> {
    /// From sample to sample, s; 0 where there is none.
    pub period: T,
    /// When it began, s.
    pub start: T,
    /// Samples that were taken.
    pub count: T,
    /// How far a master's points are from the samples by rounding, s.
    pub shift: T,
}

impl<T> SamplingClock<T> {
    /// The same by other means.
    pub(crate) fn map<R>(self, to: impl Fn(T) -> R) -> SamplingClock<R> {
        SamplingClock { period: to(self.period), start: to(self.start), count: to(self.count), shift: to(self.shift) }
    }
}
