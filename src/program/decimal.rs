//! Numbers as texts where there are many of them: those of the standard library, several times as fast.

use std::fmt::Write;

/// Fewer digits than these are those of one number at most, and it is the nearest.
const SEVERAL: usize = 16;
/// A number that isn't a multiple of 1 part in so many has more decimal places than can end it halfway between two others.
const PARTS: f64 = (1_u64 << 30) as f64;
/// Within this range, that is.
const RANGE: std::ops::Range<f64> = 1e-300..1e15;

/// Appends a number as `{}` writes it: with as few digits as tell it from all others, and without an exponent.
pub fn push(text: &mut String, number: f64) {
    let mut buffer = zmij::Buffer::new();
    let short = if number.is_finite() { buffer.format_finite(number) } else { "" };
    if short.is_empty() || may_be_halfway(number, short) {
        let _ = write!(text, "{number}");
        return;
    }
    match short.split_once('e').and_then(|(digits, exponent)| Some((digits, exponent.parse().ok()?))) {
        Some((digits, exponent)) => push_moved(text, digits, exponent),
        None => text.push_str(short.strip_suffix(".0").unwrap_or(short)),
    }
}

/// Whether two texts may be equally near to a number: of those, the standard library takes another one than this text.
fn may_be_halfway(number: f64, short: &str) -> bool {
    short.len() >= SEVERAL && (!RANGE.contains(&number.abs()) || (number * PARTS).fract() == 0.0)
}

/// Appends digits with the point behind the first of them, if there is one, moved by so many places.
fn push_moved(text: &mut String, digits: &str, places: i32) {
    let unsigned = digits.strip_prefix('-').inspect(|_| text.push('-')).unwrap_or(digits);
    let (whole, part) = unsigned.split_once('.').unwrap_or((unsigned, ""));
    let part = if part == "0" { "" } else { part };
    let zeros = |text: &mut String, count: usize| text.extend(std::iter::repeat_n('0', count));
    let count = places.unsigned_abs() as usize;
    if places < 0 {
        text.push_str("0.");
        zeros(text, count - 1);
        text.push_str(whole);
        text.push_str(part);
    } else if part.len() <= count {
        text.push_str(whole);
        text.push_str(part);
        zeros(text, count - part.len());
    } else {
        text.push_str(whole);
        text.push_str(&part[..count]);
        text.push('.');
        text.push_str(&part[count..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_the_standard_library_writes_them() {
        let mut random = fastrand::Rng::with_seed(1);
        let of_bits = (0..200_000).map(|_| f64::from_bits(random.u64(..))).collect::<Vec<_>>();
        let usual = (-12..22).flat_map(|power| (1..300).map(move |k| f64::from(k) * 10_f64.powi(power) / 7.0));
        let steps = (0..20_000).map(|k| f64::from(k) * 1e-3);
        let round = (-330..310).map(|power| format!("1e{power}").parse::<f64>().unwrap());
        // 2^-24 lies halfway between two of 16 digits.
        let mut bits = fastrand::Rng::with_seed(2);
        let halfway = (0..60 * 53).map(|k| (bits.u64(..) >> (11 + k % 53)) as f64 / 2_f64.powi(k / 53));
        let edges =
            [0.0, -0.0, 1.0, -1.5, f64::MIN_POSITIVE, 5e-324, f64::MAX, f64::NAN, f64::INFINITY, -1e-7, -2.5e17];
        let mut text = String::new();
        for number in of_bits.into_iter().chain(usual).chain(halfway).chain(steps).chain(round).chain(edges) {
            text.clear();
            push(&mut text, number);
            assert_eq!(text, format!("{number}"), "{:016x}", number.to_bits());
        }
    }
}
