//! Checks if the values of an algebraic loop converge.

/// The most iterations: a change that shrinks by a fifth in each is below the limit by then.
const MOST_ROUNDS: usize = 100;
/// The change in an iteration, relative to a value's largest magnitude, below which it has converged.
const SETTLED: f64 = 1e-9;
/// Growth of a value, from its largest magnitude after the first round, that counts as divergence.
const GROWTH: f64 = 1e3;

/// Changes of values from round to round.
#[derive(Debug)]
pub(super) struct Settling {
    last: Vec<f64>,
    /// Largest magnitude of each so far.
    largest: Vec<f64>,
    /// Largest magnitude of each after the first iteration.
    begun: Vec<f64>,
    rounds: usize,
    /// The value that changed most relative to its magnitude in the last iteration, and its change.
    moves_most: (usize, f64),
    grows: bool,
}

impl Settling {
    /// The values before the first round.
    pub fn new(row: &[f64]) -> Self {
        let largest = row.iter().map(|value| value.abs()).collect();
        Settling { last: row.to_vec(), largest, begun: Vec::new(), rounds: 0, moves_most: (0, 0.0), grows: false }
    }

    /// True if another round may help.
    pub fn goes_on(&self) -> bool {
        self.rounds < MOST_ROUNDS && !self.grows
    }

    /// Takes the values after an iteration. Returns true if they have converged.
    pub fn next(&mut self, row: &[f64]) -> bool {
        let mut most = 0.0;
        for (k, &value) in row.iter().enumerate() {
            let change = value - self.last[k];
            self.largest[k] = self.largest[k].max(value.abs());
            let scaled = if change == 0.0 { 0.0 } else { change.abs() / self.largest[k] };
            // NaN is the largest change of all.
            if scaled > most || scaled.is_nan() {
                (most, self.moves_most) = (if scaled.is_nan() { f64::INFINITY } else { scaled }, (k, change));
            }
        }
        self.last.copy_from_slice(row);
        self.rounds += 1;
        if self.begun.is_empty() {
            self.begun.clone_from(&self.largest);
        }
        let grown = |(largest, begun): (&f64, &f64)| *begun > 0.0 && largest / begun > GROWTH;
        self.grows = most.is_infinite() || self.largest.iter().zip(&self.begun).any(grown);
        most <= SETTLED
    }

    /// The place of the value that changed most relative to its magnitude in the last iteration, and its change.
    pub fn moves_most(&self) -> (usize, f64) {
        self.moves_most
    }

    /// Number of rounds.
    pub fn rounds(&self) -> usize {
        self.rounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Iterates value ← gain · value + 1 for the second of two values; none if it doesn't converge.
    fn rounds(gain: f64, start: f64) -> (Option<f64>, Settling) {
        let mut row = [7.0, start];
        let mut settling = Settling::new(&row);
        while settling.goes_on() {
            row[1] = gain * row[1] + 1.0;
            if settling.next(&row) {
                return (Some(row[1]), settling);
            }
        }
        (None, settling)
    }

    #[test]
    fn what_shrinks_settles_from_zero_and_from_far_off() {
        for start in [0.0, 1e6, -3.0] {
            for gain in [0.0, 0.5, -0.5, 0.8] {
                let settled = rounds(gain, start).0.unwrap();
                assert!((settled - 1.0 / (1.0 - gain)).abs() < 1e-8 * start.abs().max(5.0), "{gain} {start}");
            }
        }
    }

    #[test]
    fn what_grows_or_swings_is_reported_by_its_place_and_change() {
        let (settled, growing) = rounds(-10.0, 1.0);
        assert!(settled.is_none() && growing.rounds() < 10 && growing.moves_most().0 == 1);
        let (settled, swinging) = rounds(-1.0, 3.0);
        assert_eq!((settled, swinging.rounds(), swinging.moves_most()), (None, 100, (1, 5.0)));
        assert!(rounds(f64::NAN, 1.0).1.rounds() == 1);
    }
}
