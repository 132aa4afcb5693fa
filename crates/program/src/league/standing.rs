//! Ranks of controllers, which differ only if intervals separate.

use super::record::Record;

/// The place of a controller among those of its plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rank {
    /// One more than the number of those that are certainly better.
    pub place: usize,
    /// True if others have the same place.
    pub shared: bool,
}

/// The places of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Rank by the fraction of random plants that fail.
    pub failures: Option<Rank>,
    /// Rank by the median error of random plants.
    pub error: Option<Rank>,
}

/// The standings of the controllers of a plant, in the order of their records.
pub fn standings(records: &[&Record]) -> Vec<Standing> {
    let failures: Vec<_> = records.iter().map(|record| record.spread.as_ref().map(|spread| spread.rate().1)).collect();
    let errors = records.iter().map(|record| {
        let [low, high] = record.spread.as_ref()?.median().1;
        Some([low.unwrap_or(f64::INFINITY), high.unwrap_or(f64::INFINITY)])
    });
    let (failures, errors) = (ranks(&failures), ranks(&errors.collect::<Vec<_>>()));
    failures.into_iter().zip(errors).map(|(failures, error)| Standing { failures, error }).collect()
}

/// The places of intervals: one is certainly better if all of it is below the other.
fn ranks(intervals: &[Option<[f64; 2]>]) -> Vec<Option<Rank>> {
    let place = |own: &Option<[f64; 2]>| {
        let [low, _] = (*own)?;
        Some(1 + intervals.iter().flatten().filter(|[_, other]| *other < low).count())
    };
    let places: Vec<_> = intervals.iter().map(place).collect();
    let shared = |own: usize| places.iter().flatten().filter(|place| **place == own).count() > 1;
    places.iter().map(|place| place.map(|place| Rank { place, shared: shared(place) })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rank_differs_only_where_intervals_separate() {
        let places = |intervals: &[Option<[f64; 2]>]| {
            ranks(intervals).into_iter().map(|rank| rank.map(|rank| (rank.place, rank.shared))).collect::<Vec<_>>()
        };
        assert_eq!(
            places(&[Some([0.0, 0.2]), Some([0.1, 0.3]), Some([0.25, 0.5]), None]),
            [Some((1, true)), Some((1, true)), Some((2, false)), None]
        );
        assert_eq!(
            places(&[Some([0.0, 0.1]), Some([0.1, 0.3])]),
            [Some((1, true)), Some((1, true))],
            "an end in common"
        );
        let lost = [f64::INFINITY; 2];
        assert_eq!(
            places(&[Some(lost), Some([0.1, 0.2]), Some(lost)]),
            [Some((2, true)), Some((1, false)), Some((2, true))]
        );
    }
}
