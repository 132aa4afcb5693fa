//! Influences on failures: rates over one or two quantities, and first-order indices, from the samples themselves.

/// Limits of the number of groups for an index, which is the square root of the number of samples.
const FEWEST_GROUPS: usize = 4;
const MOST_GROUPS: usize = 32;

/// Runs with values in a range, and the failed ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bin {
    /// The least value.
    pub low: f64,
    /// The largest.
    pub high: f64,
    /// Number of runs.
    pub runs: u64,
    /// Failed runs.
    pub failures: u64,
}

/// Places of values in ascending order.
pub(super) fn order(values: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order
}

/// The group of each value; groups have equal numbers of values.
pub(super) fn groups(values: &[f64], count: usize) -> Vec<usize> {
    let mut groups = vec![0; values.len()];
    for (rank, place) in order(values).into_iter().enumerate() {
        groups[place] = rank * count / values.len();
    }
    groups
}

/// Failures over a quantity, in bins of equal numbers of runs.
pub(super) fn rates(values: &[f64], failed: &[bool], count: usize) -> Vec<Bin> {
    let count = count.min(values.len());
    let none = Bin { low: f64::INFINITY, high: f64::NEG_INFINITY, runs: 0, failures: 0 };
    let mut bins = vec![none; count];
    for ((group, value), failed) in groups(values, count).into_iter().zip(values).zip(failed) {
        let Bin { low, high, runs, failures } = bins[group];
        let failures = failures + u64::from(*failed);
        bins[group] = Bin { low: low.min(*value), high: high.max(*value), runs: runs + 1, failures };
    }
    bins
}

/// Numbers of runs over a metric, in bins of equal width; runs without a value are left out.
pub(super) fn histogram(values: &[f64], failed: &[bool], count: usize) -> Vec<Bin> {
    let finite = || values.iter().zip(failed).filter(|(value, _)| value.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (v, _)| (l.min(*v), h.max(*v)));
    if low > high {
        return Vec::new();
    }
    let count = if high > low { count } else { 1 };
    let end = |k: usize| low + (high - low) * k as f64 / count as f64;
    let mut bins: Vec<_> = (0..count).map(|k| Bin { low: end(k), high: end(k + 1), runs: 0, failures: 0 }).collect();
    for (value, failed) in finite() {
        let part = if high > low { (value - low) / (high - low) } else { 0.0 };
        let bin = &mut bins[((part * count as f64) as usize).min(count - 1)];
        bin.runs += 1;
        bin.failures += u64::from(*failed);
    }
    bins
}

/// The first-order index of a quantity: the part of a result's variance that it explains by itself, 0 to 1. It is
/// estimated from the means of groups of neighbouring values, corrected for their scatter (Kelley's ε²). None for a
/// result that doesn't vary, and for too few samples.
pub(super) fn first_order(values: &[f64], result: &[f64]) -> Option<f64> {
    let n = values.len();
    let count = (n as f64).sqrt() as usize / 2;
    let count = count.clamp(FEWEST_GROUPS, MOST_GROUPS);
    if n < 2 * count {
        return None;
    }
    let mean = result.iter().sum::<f64>() / n as f64;
    let total: f64 = result.iter().map(|value| (value - mean).powi(2)).sum();
    let (mut sums, mut numbers) = (vec![0.0; count], vec![0.0_f64; count]);
    for (group, value) in groups(values, count).into_iter().zip(result) {
        sums[group] += value - mean;
        numbers[group] += 1.0;
    }
    let between: f64 = sums.iter().zip(&numbers).map(|(sum, number)| sum * sum / number).sum();
    let within = (total - between) / (n - count) as f64;
    let index = (between - (count - 1) as f64 * within) / total;
    (total > 0.0).then(|| index.clamp(0.0, 1.0))
}

/// Ranks of values from 0 to 1; infinite ones are the last.
pub(super) fn ranks(values: &[f64]) -> Vec<f64> {
    let mut ranks = vec![0.0; values.len()];
    for (rank, place) in order(values).into_iter().enumerate() {
        ranks[place] = rank as f64 / values.len() as f64;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two uniform quantities.
    fn drawn(count: usize) -> [Vec<f64>; 2] {
        let mut random = fastrand::Rng::with_seed(1);
        let one = (0..count).map(|_| random.f64()).collect();
        [one, (0..count).map(|_| random.f64()).collect()]
    }

    #[test]
    fn indices_of_a_sum_are_the_parts_of_its_variance() {
        let [x, y] = drawn(20_000);
        // Variances 9/12 and 1/12.
        let sum: Vec<f64> = x.iter().zip(&y).map(|(x, y)| 3.0 * x + y).collect();
        let (of_x, of_y) = (first_order(&x, &sum).unwrap(), first_order(&y, &sum).unwrap());
        assert!((of_x - 0.9).abs() < 0.02 && (of_y - 0.1).abs() < 0.02, "{of_x}, {of_y}");
        // A joint effect has no first-order index.
        let product: Vec<f64> = x.iter().zip(&y).map(|(x, y)| (x - 0.5) * (y - 0.5)).collect();
        assert!(first_order(&x, &product).unwrap() < 0.01);
        assert_eq!(first_order(&x, &vec![1.0; x.len()]), None);
        assert_eq!(first_order(&x[..5], &sum[..5]), None);
    }

    #[test]
    fn rates_and_histograms_count_each_run_once() {
        let [x, _] = drawn(1000);
        let failed: Vec<bool> = x.iter().map(|x| *x > 0.75).collect();
        let bins = rates(&x, &failed, 8);
        assert!(bins.iter().all(|bin| bin.runs == 125) && bins[0].failures == 0 && bins[7].failures == 125);
        let histogram = histogram(&[x.clone(), vec![f64::NAN]].concat(), &[failed, vec![true]].concat(), 10);
        assert_eq!(histogram.iter().map(|bin| bin.runs).sum::<u64>(), 1000);
        assert!(histogram.windows(2).all(|pair| pair[0].high == pair[1].low));
        assert_eq!(ranks(&[3.0, f64::INFINITY, 1.0]), [1.0 / 3.0, 2.0 / 3.0, 0.0]);
    }
}
