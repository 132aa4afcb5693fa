//! Lists of names of variables.

use std::str::FromStr;

use adaptive_fmu::template::MOST;

/// Names, separated by commas; a comma within brackets, parentheses or apostrophes is part of a name, as in
/// `theta_hat[1,2]`, `der(q,2)` and `'a,b'`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names(pub Vec<String>);

impl FromStr for Names {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (mut depth, mut quoted) = (0_usize, false);
        let separates = |c: char| {
            match c {
                '\'' => quoted = !quoted,
                '[' | '(' if !quoted => depth += 1,
                ']' | ')' if !quoted => depth = depth.saturating_sub(1),
                _ => {}
            }
            c == ',' && depth == 0 && !quoted
        };
        let names: Vec<_> = text.split(separates).map(|name| name.trim().to_owned()).collect();
        if names.iter().any(String::is_empty) {
            return Err("must be names, separated by commas".to_owned());
        }
        Ok(Names(names))
    }
}

/// Number of signals, or their names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Which {
    /// Number of signals.
    Count(usize),
    /// Those of these names.
    Named(Names),
}

impl FromStr for Which {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<i64>() {
            Ok(count) if (1..=MOST).contains(&count) => Ok(Which::Count(count as usize)),
            Ok(_) => Err(format!("must be within 1 … {MOST}")),
            Err(_) => text.parse().map(Which::Named),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comma_in_brackets_separates_nothing() {
        let names: Names = "speed, theta[1,2],der(q,2),'a(,',x[3]".parse().unwrap();
        assert_eq!(names.0, ["speed", "theta[1,2]", "der(q,2)", "'a(,'", "x[3]"]);
        assert!(",a".parse::<Names>().is_err() && "".parse::<Names>().is_err());
        assert_eq!("3".parse(), Ok(Which::Count(3)));
        assert_eq!("y".parse(), Ok(Which::Named(Names(vec!["y".to_owned()]))));
    }
}
