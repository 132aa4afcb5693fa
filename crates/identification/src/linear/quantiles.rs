//! Quantiles of the normal and the chi-squared distribution.

/// The quantile of the standard normal distribution, by P. J. Acklam's rational approximation and one step of Halley's
/// method.
pub fn normal(probability: f64) -> f64 {
    if probability < 0.5 {
        return -normal(1.0 - probability);
    }
    let rest = 1.0 - probability;
    if rest <= 0.0 {
        return f64::INFINITY;
    }
    // A start that is good to .5 % (Abramowitz and Stegun 26.2.23), then Newton's method for the tail.
    let t = (-2.0 * rest.ln()).sqrt();
    let mut z = t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    for _ in 0..8 {
        let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let step = (tail(z) - rest) / density;
        z += step;
        if step.abs() < 1e-13 * z.abs().max(1.0) {
            break;
        }
    }
    z
}

/// The probability that a standard normal number is above z, at least 0: half the complementary error function.
fn tail(z: f64) -> f64 {
    let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    if z < 3.0 {
        // Φ(z) − ½ = φ(z) (z + z³/3 + z⁵/15 + …)
        let (mut term, mut sum, mut k) = (z, z, 1.0);
        while term.abs() > 1e-17 * f64::abs(sum) {
            k += 2.0;
            term *= z * z / k;
            sum += term;
        }
        return 0.5 - density * sum;
    }
    // A continued fraction.
    let mut fraction = 0.0;
    for k in (1..=120).rev() {
        fraction = f64::from(k) / (z + fraction);
    }
    density / (z + fraction)
}

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
        for (probability, value) in [(0.5, 0.0), (0.995, 2.5758293035489), (0.00135, -2.9999769927034)] {
            assert!((normal(probability) - value).abs() < 1e-9, "{probability}: {}", normal(probability));
        }
        assert!((normal(1.0 - 1e-8) - 5.6120012441747).abs() < 1e-6);
        for (degrees, value) in
            [(1, 6.6348966010212), (2, 9.2103403719762), (5, 15.086272469389), (24, 42.979820139351)]
        {
            assert!((chi_squared(0.99, degrees) - value).abs() < 1e-8, "{degrees}: {}", chi_squared(0.99, degrees));
        }
    }
}
