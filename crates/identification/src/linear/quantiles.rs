//! Quantiles of the chi-squared distribution.

/// The quantile of the chi-squared distribution, by bisection of its distribution function.
pub fn chi_squared(probability: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, degrees as f64 + 10.0);
    while below(high, degrees) < probability {
        high *= 2.0;
    }
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if below(middle, degrees) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// The chi-squared distribution function: the series of the incomplete gamma function.
fn below(x: f64, degrees: usize) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let (a, half) = (0.5 * degrees as f64, 0.5 * x);
    // Γ(a + 1), from ½ or 1 upwards, as a logarithm.
    let mut at = if degrees.is_multiple_of(2) { 1.0 } else { 0.5 };
    let mut log_gamma = if degrees.is_multiple_of(2) { 0.0 } else { 0.5 * std::f64::consts::PI.ln() };
    while at < a + 0.5 {
        log_gamma += f64::ln(at);
        at += 1.0;
    }
    let (mut term, mut sum, mut k) = (1.0, 1.0, a);
    while term > 1e-17 * sum {
        k += 1.0;
        term *= half / k;
        sum += term;
    }
    (a * half.ln() - half - log_gamma + f64::ln(sum)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_agree_with_tables() {
        for (degrees, value) in
            [(1, 6.6348966010212), (2, 9.2103403719762), (5, 15.086272469389), (24, 42.979820139351)]
        {
            assert!((chi_squared(0.99, degrees) - value).abs() < 1e-8, "{degrees}: {}", chi_squared(0.99, degrees));
        }
    }
}
