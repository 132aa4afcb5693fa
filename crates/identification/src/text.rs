//! Numbers and lists in messages.

/// A number with three significant digits, without zeros at the end.
pub fn number(value: f64) -> String {
    digits(value, 3)
}

/// A number with this number of significant digits, without zeros at the end.
pub fn digits(value: f64, count: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{}", if value == 0.0 { 0.0 } else { value });
    }
    // Rounded first: 999.7 has one digit more than its logarithm has.
    let scientific = format!("{:.*e}", count - 1, value);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trim = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    if !(-5..=6).contains(&exponent) {
        return format!("{}e{exponent}", trim(mantissa));
    }
    let decimals = (count as i32 - 1 - exponent).max(0) as usize;
    let rounded: f64 = scientific.parse().unwrap_or(value);
    trim(&format!("{rounded:.decimals$}"))
}

/// A linear combination for people: `-4 position - 7 velocity + 2`. Terms of 0 are left out.
pub fn combination(terms: &[(f64, &str)], constant: f64) -> String {
    let mut text = String::new();
    let all = terms.iter().copied().chain([(constant, "")]).filter(|(factor, _)| *factor != 0.0);
    for (factor, name) in all {
        let sign = match (text.is_empty(), factor < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        let amount = number(factor.abs());
        let amount = if amount == "1" && !name.is_empty() { String::new() } else { amount };
        let space = if amount.is_empty() || name.is_empty() { "" } else { " " };
        text += &format!("{sign}{amount}{space}{name}");
    }
    if text.is_empty() { "0".to_owned() } else { text }
}

/// Row numbers as ranges: `3, 7 … 9`; at most eight of them.
pub fn ranges(sorted: &[usize]) -> String {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for &row in sorted {
        match runs.last_mut() {
            Some((_, last)) if row <= *last + 1 => *last = row,
            _ => runs.push((row, row)),
        }
    }
    let text = |&(first, last): &(usize, usize)| match last - first {
        0 => first.to_string(),
        1 => format!("{first}, {last}"),
        _ => format!("{first} … {last}"),
    };
    let mut texts: Vec<String> = runs.iter().take(8).map(text).collect();
    if runs.len() > 8 {
        texts.push(format!("and {} more", runs.len() - 8));
    }
    texts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.0, 12.0, 0.0123456, 999.7, -1234.6, 1e-7, 2.5e8, 57.2958, 0.1].map(number);
        assert_eq!(texts, ["0", "12", "0.0123", "1000", "-1230", "1e-7", "2.5e8", "57.3", "0.1"]);
    }

    #[test]
    fn combinations_read_as_equations() {
        assert_eq!(combination(&[(-4.0, "x"), (0.0, "y"), (1.0, "v")], -0.5), "-4 x + v - 0.5");
        assert_eq!(combination(&[(-1.0, "x")], 0.0), "-x");
        assert_eq!(combination(&[], 0.0), "0");
    }

    #[test]
    fn rows_are_listed_as_ranges() {
        assert_eq!(ranges(&[3, 7, 8, 9, 12, 13]), "3, 7 … 9, 12, 13");
        assert!(ranges(&(0..20).map(|k| 3 * k).collect::<Vec<_>>()).ends_with("21, and 12 more"));
    }
}
