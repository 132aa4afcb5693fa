//! Clopper-Pearson bounds: rates of failure that are compatible with the counted failures.

use statrs::function::beta::beta_reg;

/// The most halvings of the interval around a bound.
const HALVINGS: usize = 200;

/// The upper bound of a rate: the true rate exceeds it with at most the probability `error`.
pub fn upper(failures: u64, runs: u64, error: f64) -> f64 {
    if failures >= runs {
        return 1.0;
    }
    let (a, b) = (failures as f64 + 1.0, (runs - failures) as f64);
    // The probability of at most so many failures decreases with the rate.
    rate(|p| beta_reg(b, a, 1.0 - p) > error)
}

/// The lower bound of a rate: the true rate is below it with at most the probability `error`.
pub fn lower(failures: u64, runs: u64, error: f64) -> f64 {
    if failures == 0 {
        return 0.0;
    }
    let (a, b) = (failures as f64, (runs - failures) as f64 + 1.0);
    rate(|p| beta_reg(a, b, p) < error)
}

/// The largest rate for which a condition is true.
fn rate(is_below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if is_below(middle) { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The probability of at most so many failures, summed up.
    fn at_most(failures: u64, runs: u64, p: f64) -> f64 {
        let mut logarithm = runs as f64 * (-p).ln_1p();
        let mut sum = logarithm.exp();
        for k in 0..failures {
            logarithm += ((runs - k) as f64 / (k + 1) as f64).ln() + p.ln() - (-p).ln_1p();
            sum += logarithm.exp();
        }
        sum
    }

    #[test]
    fn the_counted_failures_are_as_improbable_at_the_bounds_as_they_may_be() {
        let counts =
            [(0, 1), (0, 50), (25, 50), (49, 50), (346, 2000), (3, 500_000), (1000, 1_000_000), (17, 10_000_000)];
        for (failures, runs) in counts {
            for error in [0.025, 0.0125, 1e-4] {
                let found = at_most(failures, runs, upper(failures, runs, error));
                assert!((found / error - 1.0).abs() < 1e-6, "upper of {failures} in {runs}: {found} for {error}");
                if failures > 0 {
                    let found = 1.0 - at_most(failures - 1, runs, lower(failures, runs, error));
                    assert!((found / error - 1.0).abs() < 1e-5, "lower of {failures} in {runs}: {found} for {error}");
                }
            }
        }
    }

    #[test]
    fn nothing_and_everything_have_bounds_in_closed_form() {
        // 1 - error^(1/n); the other bound is its mirror image.
        let exact = -(0.0125_f64.ln() / 5e5).exp_m1();
        assert!((upper(0, 500_000, 0.0125) / exact - 1.0).abs() < 1e-9);
        assert!((lower(40, 40, 0.025) - 0.025_f64.powf(1.0 / 40.0)).abs() < 1e-12);
        assert_eq!((lower(0, 40, 0.025), upper(40, 40, 0.025)), (0.0, 1.0));
    }
}
