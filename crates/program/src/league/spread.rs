//! Random plants: the same ones for every controller.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

use super::condition::Deviation;
use super::judged::Judged;
use super::pair::Pair;
use super::study::Shift;
use crate::parallel;

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_964;

/// Outcomes of random plants with sensors and actuators.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// The error of each in one number, if it didn't fail.
    pub errors: Vec<Option<f64>>,
    /// Number that failed at first, but not with a finer integration.
    pub mended: usize,
}

impl Spread {
    /// Number that failed.
    pub fn failed(&self) -> usize {
        self.errors.iter().filter(|error| error.is_none()).count()
    }

    /// The fraction that failed, and its 95 % confidence interval.
    pub fn rate(&self) -> (f64, [f64; 2]) {
        let count = self.errors.len();
        (self.failed() as f64 / count.max(1) as f64, interval(self.failed(), count))
    }

    /// The median error, with failures as the largest errors; none if half of all fail. Also its 95 % confidence
    /// interval, of which an end that is none is a failure.
    pub fn median(&self) -> (Option<f64>, [Option<f64>; 2]) {
        let mut errors: Vec<f64> = self.errors.iter().map(|error| error.unwrap_or(f64::INFINITY)).collect();
        errors.sort_by(f64::total_cmp);
        let count = errors.len();
        let at = |place: f64| {
            let place = place.clamp(0.0, count.saturating_sub(1) as f64) as usize;
            errors.get(place).copied().filter(|error| error.is_finite())
        };
        let (half, width) = (0.5 * count as f64, 0.5 * Z * (count as f64).sqrt());
        (at((half - 0.5).floor()), [at((half - width).floor() - 1.0), at((half + width).ceil())])
    }
}

/// Wilson's 95 % confidence interval of a fraction.
pub fn interval(found: usize, count: usize) -> [f64; 2] {
    if count == 0 {
        return [0.0, 1.0];
    }
    let (n, p) = (count as f64, found as f64 / count as f64);
    let (centre, half) = (p + Z * Z / (2.0 * n), Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt());
    [centre - half, centre + half].map(|end| (end / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

impl Pair<'_> {
    /// Runs the loop with random plants; none if the user interrupts.
    ///
    /// # Errors
    /// If the bench doesn't fit the loop.
    pub fn spread(&self, is_interrupted: &(dyn Fn() -> bool + Sync)) -> Result<Option<Spread>, String> {
        let deviations = (0..self.budget.plants).map(|k| self.random(k)).collect::<Result<Vec<_>, _>>()?;
        self.fold_once();
        let workers = vec![(); parallel::cores()];
        let judged = parallel::each(&workers, deviations.len(), |(), k| self.judged(&deviations[k], is_interrupted));
        let error = |Judged { outcome, .. }: &Judged| outcome.holds().then(|| outcome.error(self.plant));
        let mended = judged.iter().filter(|judged| judged.mended).count();
        Ok((!is_interrupted()).then(|| Spread { errors: judged.iter().map(error).collect(), mended }))
    }

    /// Compiles the equations for what all runs of a search or of random plants have in common, at the first of these.
    pub(super) fn fold_once(&self) {
        self.folded.call_once(|| self.random(0).into_iter().for_each(|deviation| self.fold(deviation)));
    }

    /// Plant k. Its numbers depend only on the seed, k and the plant's parameters, not on the controller.
    fn random(&self, k: u32) -> Result<Deviation, String> {
        let mut random = Rng::with_seed(self.budget.seed.wrapping_mul(1_000_003).wrapping_add(u64::from(k)));
        // The first numbers of neighbouring seeds are similar.
        (0..8).for_each(|_| _ = random.u64(..));
        let mut deviation = Deviation::default();
        for place in self.uncertain() {
            let times = 1.0 + self.budget.spread * (2.0 * random.f64() - 1.0);
            self.shift(place, Shift::Times { times }, &mut deviation);
        }
        self.put_on_bench(&mut deviation, 1000 + k.cast_signed())?;
        Ok(deviation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_has_its_published_values() {
        // Newcombe, Statistics in Medicine 17 (1998), table I.
        for (found, count, low, high) in
            [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]
        {
            let [below, above] = interval(found, count);
            assert!((below - low).abs() < 5e-5 && (above - high).abs() < 5e-5, "{found} of {count}: {below} {above}");
        }
        assert_eq!(interval(0, 0), [0.0, 1.0]);
    }

    #[test]
    fn a_median_counts_failures_as_the_largest_errors() {
        let spread = |errors: &[f64], failed: usize| Spread {
            errors: errors.iter().copied().map(Some).chain(std::iter::repeat_n(None, failed)).collect(),
            mended: 0,
        };
        let errors: Vec<f64> = (1..=100).map(f64::from).collect();
        let (median, [low, high]) = spread(&errors, 0).median();
        // The order statistics 40 and 61 of 100: their interval holds the median with 96.5 %.
        assert_eq!((median, low, high), (Some(50.0), Some(40.0), Some(61.0)));
        assert_eq!(spread(&errors[..45], 55).median().0, None);
        assert_eq!(spread(&errors[..55], 45).median(), (Some(50.0), [Some(40.0), None]));
    }
}
