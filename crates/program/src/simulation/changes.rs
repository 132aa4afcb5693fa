//! Values that variables get during a run.

use crate::fmu::Value;
use crate::structure::Settings;

/// Part of a communication step by which a change may be late: times of points are rounded.
pub(crate) const ROUNDING: f64 = 1e-6;

/// A variable of a component, by places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    pub(crate) unit: usize,
    pub(crate) variable: usize,
}

/// A value that a variable gets during a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Time, s.
    pub at: f64,
    /// Its variable.
    pub place: Place,
    /// The value.
    pub value: Value,
}

/// Changes that are to come.
#[derive(Debug)]
pub(super) struct Coming(std::iter::Peekable<std::vec::IntoIter<Change>>);

impl Coming {
    /// Changes in the order of their times.
    pub fn new(own: &[Change], further: &[Change]) -> Self {
        let mut changes = [own, further].concat();
        changes.sort_by(|a, b| a.at.total_cmp(&b.at));
        Coming(changes.into_iter().peekable())
    }

    /// Those that are due at a communication point, by its number.
    pub fn due(&mut self, settings: Settings, k: usize) -> Vec<Change> {
        std::iter::from_fn(|| self.0.next_if(|change| is_due(change, settings, k))).collect()
    }

    /// The times from a communication point to the first at which a change is due, or to the end.
    pub fn unchanged(&mut self, settings: Settings, k: usize) -> impl Iterator<Item = f64> {
        let next = self.0.peek();
        let further =
            (k + 1..settings.steps()).take_while(move |&k| !next.is_some_and(|next| is_due(next, settings, k)));
        std::iter::once(k).chain(std::iter::once(k + 1)).chain(further.map(|k| k + 1)).map(move |k| settings.time(k))
    }
}

/// True if a change is due at a communication point that a step follows.
fn is_due(change: &Change, settings: Settings, k: usize) -> bool {
    let (time, next) = (settings.time(k), settings.time(k + 1));
    change.at <= time + ROUNDING * (next - time)
}
