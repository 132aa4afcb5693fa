//! Numbers as arguments.

/// Reads a finite number above 0.
///
/// # Errors
/// The numbers that are allowed.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "must be a finite number above 0".to_owned())
}
