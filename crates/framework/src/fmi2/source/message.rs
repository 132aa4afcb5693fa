//! Texts with numbers in them, as generated C holds them.

use std::fmt::Write;

use crate::recording::Node;

/// A text with marks where numbers go: the byte 1, then how a number is written.
#[derive(Debug, PartialEq, Eq)]
pub struct MessageFormat {
    /// The text.
    pub text: String,
    /// The numbers, in the order of their marks.
    pub numbers: Vec<Node>,
}

impl MessageFormat {
    /// A text of a recording, in which numbers are referred to as `{node 12}`, with how they are written behind.
    pub fn of(text: &str) -> Self {
        let mut pieces = text.split("{node ");
        let mut format = MessageFormat { text: pieces.next().unwrap_or_default().to_owned(), numbers: Vec::new() };
        for piece in pieces {
            let (reference, rest) = piece.split_once('}').unwrap_or((piece, ""));
            let (number, how) = reference.split_once(' ').unwrap_or((reference, ""));
            format.numbers.push(Node::at(number.parse().unwrap_or_default()));
            format.text.push('\u{1}');
            format.text += &mark(how);
            format.text += rest;
        }
        format
    }
}

/// Mark of a number's format: `n` with all its digits; for a person `r` rounded, `d` cut, `u` rounded up; with the
/// given number of decimals `e` with an exponent, `c` the same and cut, `f` without.
fn mark(how: &str) -> String {
    match how.strip_prefix('.') {
        Some(digits) if digits.ends_with(['e', 'c']) => digits.chars().rev().collect(),
        Some(digits) => format!("f{}", digits.trim_end_matches('f')),
        None => match how {
            "rounded" => "r",
            "at most" => "d",
            "at least" => "u",
            _ => "n",
        }
        .to_owned(),
    }
}

/// A text as C writes it, whatever a compiler takes its source to be encoded in.
pub fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for byte in text.bytes() {
        match byte {
            b'\\' => quoted.push_str("\\\\"),
            // A quote is written by its number, so that quotes in C are those of texts; ?? would begin a trigraph.
            b' '..=b'~' if !matches!(byte, b'"' | b'?') => quoted.push(byte as char),
            _ => _ = write!(quoted, "\\{byte:03o}"),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_marked_in_their_order() {
        let format = MessageFormat::of("x = {node 12}, about {node 3 rounded}, {node 7 .3e} or {node 8 .2f} {m}");
        assert_eq!(format.text, "x = \u{1}n, about \u{1}r, \u{1}e3 or \u{1}f2 {m}");
        assert_eq!(format.numbers, [12, 3, 7, 8].map(Node::at));
        let format = MessageFormat::of("{node 1 .1c} or less, within {node 2 at most}, above {node 3 at least}");
        assert_eq!(format.text, "\u{1}c1 or less, within \u{1}d, above \u{1}u");
    }

    #[test]
    fn any_text_is_a_text_of_c() {
        assert_eq!(quoted("a \"b\" \\ ??= 1 … 2\n\u{1}n"), r#""a \042b\042 \\ \077\077= 1 \342\200\246 2\012\001n""#);
    }
}
