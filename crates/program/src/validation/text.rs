//! Formats of attribute values, by the types of XML Schema.

/// The type of an attribute.
#[derive(Debug, Clone, Copy)]
pub(super) enum Type {
    Any,
    Double,
    Int,
    Unsigned,
    Boolean,
    DateTime,
    OneOf(&'static [&'static str]),
    /// Numbers of variables with spaces between.
    Indices,
    /// Kinds of dependence with spaces between.
    Kinds,
}

pub(super) const KINDS: [&str; 5] = ["dependent", "constant", "fixed", "tunable", "discrete"];

/// A number as XML Schema writes it.
pub(super) fn double(text: &str) -> Option<f64> {
    match text.trim() {
        "INF" => Some(f64::INFINITY),
        "-INF" => Some(f64::NEG_INFINITY),
        "NaN" => Some(f64::NAN),
        number => {
            // Rust accepts further words, in upper and lower case.
            let plain = number.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
            number.parse().ok().filter(|_| plain)
        }
    }
}

/// A Boolean as XML Schema writes it.
pub(super) fn boolean(text: &str) -> Option<bool> {
    match text.trim() {
        "true" | "1" => Some(true),
        "false" | "0" => Some(false),
        _ => None,
    }
}

impl Type {
    /// Values that are allowed; none if the text is of this type.
    pub fn refusal(self, text: &str) -> Option<String> {
        let trimmed = text.trim();
        let (fits, allowed) = match self {
            Type::Any => return None,
            Type::Double => (double(text).is_some(), "a number"),
            Type::Int => (trimmed.parse::<i32>().is_ok(), "a 32-bit integer"),
            Type::Unsigned => (trimmed.parse::<u32>().is_ok(), "an integer from 0 to 4294967295"),
            Type::Boolean => (boolean(text).is_some(), "true or false"),
            Type::DateTime => (is_date_time(trimmed), "a time like 2026-01-31T12:00:00Z"),
            Type::Indices => {
                let fits = text.split_whitespace().all(|word| word.parse::<u32>().is_ok());
                (fits, "indices of variables from 1, separated by spaces")
            }
            Type::OneOf(words) => return (!words.contains(&trimmed)).then(|| one_of(words)),
            Type::Kinds => {
                let fits = text.split_whitespace().all(|word| KINDS.contains(&word));
                return (!fits).then(|| format!("words separated by spaces, each one of {}", one_of(&KINDS)));
            }
        };
        (!fits).then(|| allowed.to_owned())
    }
}

pub(super) fn one_of(words: &[&str]) -> String {
    words.join(", ")
}

/// True for `2026-01-31T12:00:00`, with or without parts of a second and a time zone.
fn is_date_time(text: &str) -> bool {
    let Some((date, time)) = text.split_once('T') else { return false };
    let number = |part: &str, from: u32, to: u32| {
        part.bytes().all(|byte| byte.is_ascii_digit())
            && part.parse().is_ok_and(|number: u32| (from..=to).contains(&number))
    };
    let date: Vec<&str> = date.strip_prefix('-').unwrap_or(date).split('-').collect();
    let [year, month, day] = date[..] else { return false };
    let (time, zone) = time.split_at(time.find(['Z', '+', '-']).unwrap_or(time.len()));
    let time: Vec<&str> = time.split(':').collect();
    let [hour, minute, second] = time[..] else { return false };
    let (second, fraction) = second.split_once('.').unwrap_or((second, "0"));
    let zone_fits = zone.is_empty()
        || zone == "Z"
        || zone[1..].split_once(':').is_some_and(|(hour, minute)| number(hour, 0, 14) && number(minute, 0, 59));
    year.len() >= 4
        && year.bytes().all(|byte| byte.is_ascii_digit())
        && [month, day, hour, minute, second].iter().all(|part| part.len() == 2)
        && number(month, 1, 12)
        && number(day, 1, 31)
        && number(hour, 0, 24)
        && number(minute, 0, 59)
        && number(second, 0, 59)
        && !fraction.is_empty()
        && fraction.bytes().all(|byte| byte.is_ascii_digit())
        && zone_fits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_xml_schema() {
        for (text, number) in [("1", 1.0), (" -2.5e-3 ", -2.5e-3), ("INF", f64::INFINITY), (".5", 0.5), ("+1.", 1.0)] {
            assert_eq!(double(text), Some(number));
        }
        for text in ["", "inf", "nan", "infinity", "1,5", "0x1", "1 2", "e", "1f"] {
            assert_eq!(double(text), None, "{text}");
        }
    }

    #[test]
    fn times_are_those_of_xml_schema() {
        for text in ["2026-01-31T12:00:00", "2026-01-31T12:00:00Z", "2026-01-31T12:00:00.25+02:00"] {
            assert!(is_date_time(text), "{text}");
        }
        for text in ["", "2026-01-31", "2026-13-31T12:00:00", "26-1-31T1:0:0", "2026-01-31T12:00:00ä", "31.1.2026"] {
            assert!(!is_date_time(text), "{text}");
        }
    }
}
