//! A measured metric.

/// A measured metric.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Measured {
    /// What it is.
    pub label: String,
    /// Its value; none where no time was left to measure in.
    pub value: Option<f64>,
    /// The largest value that is as it should be.
    pub limit: Option<f64>,
}

impl Measured {
    /// True if it is within its limit; none where there is no limit, or no value yet.
    pub fn holds(&self) -> Option<bool> {
        self.limit.zip(self.value).map(|(limit, value)| value <= limit)
    }
}
