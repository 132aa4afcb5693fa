//! Numbers as arguments.

/// Reads a finite number above 0.
///
/// # Errors
/// The numbers that are allowed.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "must be a finite number above 0".to_owned())
}

/// Reads a finite number.
///
/// # Errors
/// The numbers that are allowed.
pub fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| "must be a finite number".to_owned())
}

/// Reads a part of 1, also in per cent: at least 0 and below 1.
///
/// # Errors
/// The numbers that are allowed, or how to write one that is meant in per cent.
pub fn part(text: &str) -> Result<f64, String> {
    let in_per_cent = text.trim().strip_suffix('%');
    let given: Option<f64> = in_per_cent.unwrap_or(text).trim().parse().ok();
    let allowed = || "must be at least 0 and below 100 %, as 20% or 0.2".to_owned();
    let number = given.filter(|number| number.is_finite() && *number >= 0.0).ok_or_else(allowed)?;
    match in_per_cent {
        Some(_) if number < 100.0 => Ok(hundredth(number)),
        None if number < 1.0 => Ok(number),
        None if number < 100.0 => {
            Err(format!("{number} means {} %; write {number}% or {}", 100.0 * number, hundredth(number)))
        }
        _ => Err(allowed()),
    }
}

/// A hundredth with the digits of the number: 0.143 of 14.3.
fn hundredth(number: f64) -> f64 {
    format!("{number}e-2").parse().unwrap_or(number / 100.0)
}

#[cfg(test)]
mod tests {
    use super::part;

    #[test]
    fn an_uncertainty_is_a_part_or_in_per_cent() {
        let accepted = ["20%", "20 %", "0.2", "0", "0%", "99.9%"].map(|text| part(text).unwrap());
        assert_eq!(accepted, [0.2, 0.2, 0.2, 0.0, 0.0, 0.999]);
        assert_eq!(part("20").unwrap_err(), "20 means 2000 %; write 20% or 0.2");
        assert_eq!(part("1").unwrap_err(), "1 means 100 %; write 1% or 0.01");
        for refused in ["-0.1", "-5%", "nan", "NaN%", "inf", "100%", "100", "", "%", "a", "20%%"] {
            assert_eq!(part(refused).unwrap_err(), "must be at least 0 and below 100 %, as 20% or 0.2", "{refused}");
        }
    }
}
