//! A measured metric, and its number as text.

/// A measured metric.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Measured {
    /// Its name, with the unit of measurement.
    pub label: String,
    /// Its value; none if the run ended before its time.
    pub value: Option<f64>,
    /// The largest value that passes.
    pub limit: Option<f64>,
}

impl Measured {
    /// True if it is within its limit; none if there is no limit or no value.
    pub fn holds(&self) -> Option<bool> {
        self.limit.zip(self.value).map(|(limit, value)| value <= limit)
    }
}

/// A number with four digits.
pub fn four_digits(value: f64) -> String {
    if !(1e-4..1e6).contains(&value.abs()) {
        return if value == 0.0 { "0".to_owned() } else { format!("{value:.3e}") };
    }
    let decimals = (3.0 - value.abs().log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::four_digits;

    #[test]
    fn numbers_have_four_digits_of_any_size() {
        let numbers = [0.0, 0.000_123_46, 0.035_971, 2.784_4, 1_607.04, 123_456.7, 2.5e12, 3e-7, f64::NAN];
        let expected = ["0", "0.0001235", "0.03597", "2.784", "1607", "123457", "2.500e12", "3.000e-7", "NaN"];
        assert_eq!(numbers.map(four_digits), expected);
    }
}
