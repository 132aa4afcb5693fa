//! Numbers as texts, for large files: the texts of the standard library, by the digits of `zmij`, in half the time.

use std::fmt::Write;

/// Fewer digits than these are those of one number at most, and it is the nearest.
const SEVERAL: usize = 16;
/// A number that isn't a multiple of 1 part in so many has too many decimal places to lie halfway between two others;
/// from `LARGE` on, it may.
const PARTS: f64 = (1_u64 << 30) as f64;
const LARGE: f64 = 1e15;

/// Appends a number as `{}` writes it: with the fewest digits that identify it, and without an exponent.
pub fn push(text: &mut String, number: f64) {
    let mut buffer = zmij::Buffer::new();
    let short = buffer.format(number);
    // Of two texts that are equally near to a number, the standard library takes another one.
    let may_be_halfway = || number.abs() >= LARGE || (number * PARTS).fract() == 0.0;
    // Numbers with an exponent, below 1e-5, are 2 of 1,000 in results.
    if !number.is_finite() || short.contains('e') || short.len() >= SEVERAL && may_be_halfway() {
        let _ = write!(text, "{number}");
    } else {
        text.push_str(short.strip_suffix(".0").unwrap_or(short));
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
