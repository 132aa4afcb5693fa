//! Bytes as text (RFC 4648).

/// Usual digits with padding (section 4), for data in a script.
#[must_use]
pub fn padded(bytes: &[u8]) -> String {
    let text = digits(bytes, [b'+', b'/']);
    let missing = text.len().next_multiple_of(4) - text.len();
    text + &"=".repeat(missing)
}

/// Digits that paths and addresses allow, without padding (section 5), for checksums in a wheel's record.
#[must_use]
pub fn of_paths(bytes: &[u8]) -> String {
    digits(bytes, [b'-', b'_'])
}

/// Digits without padding; `last` are the two that differ.
fn digits(bytes: &[u8], last: [u8; 2]) -> String {
    const DIGITS: &[u8; 62] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789";
    let digit = |value: u32| {
        let place = value as usize;
        char::from(if place < DIGITS.len() { DIGITS[place] } else { last[place - DIGITS.len()] })
    };
    let of_three = |three: &[u8]| {
        let bits = three.iter().fold(0_u32, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - three.len()));
        (0..=three.len()).map(move |k| digit(bits >> (18 - 6 * k) & 63))
    };
    bytes.chunks(3).flat_map(of_three).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_as_the_standard_has_them() {
        // RFC 4648, section 10, and uses of the two last digits.
        let known =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (text, encoded) in known {
            assert_eq!(padded(text.as_bytes()), encoded);
            assert_eq!(of_paths(text.as_bytes()), encoded.trim_end_matches('='));
        }
        assert_eq!([padded(&[0xfb, 0xff, 0xfe]), of_paths(&[0xfb, 0xff, 0xfe])], ["+//+", "-__-"]);
    }
}
