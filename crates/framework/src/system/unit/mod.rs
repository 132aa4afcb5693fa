//! Units of measurement: any text is one; its value in base units is given if it is known.

mod base;

use std::collections::BTreeSet;
use std::sync::Mutex;

pub use base::{BASE_UNITS, Base};

use crate::error::Invalid;

/// A unit, and what a person prefers to see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Its symbol.
    pub symbol: &'static str,
    /// Value in base units, if known.
    pub base: Option<Base>,
    /// A unit for display.
    pub display: Option<DisplayUnit>,
}

/// A unit for display: displayed value = factor × value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplayUnit {
    /// Its symbol.
    pub symbol: &'static str,
    /// The factor.
    pub factor: f64,
}

/// A unit with its derivative by time, which no rule gives as people write it.
struct Common {
    symbol: &'static str,
    display: Option<DisplayUnit>,
    per_second: &'static str,
}

const fn plain(symbol: &'static str, per_second: &'static str) -> Common {
    Common { symbol, display: None, per_second }
}

const fn displayed(symbol: &'static str, display: &'static str, factor: f64, per_second: &'static str) -> Common {
    Common { symbol, display: Some(DisplayUnit { symbol: display, factor }), per_second }
}

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// The units of this package's systems, with their derivatives by time.
const COMMON: &[Common] = &[
    plain("s", "1"),
    plain("s2", "s"),
    plain("1/s", "1/s2"),
    plain("Hz", "1/s2"),
    plain("1/s2", "1/s3"),
    plain("1/s3", "1/s4"),
    plain("1/s4", ""),
    displayed("rad", "deg", DEGREES, "rad/s"),
    displayed("rad/s", "deg/s", DEGREES, "rad/s2"),
    displayed("rad/s2", "deg/s2", DEGREES, "rad/s3"),
    plain("rad/s3", "rad/s4"),
    plain("rad/s4", ""),
    plain("m", "m/s"),
    plain("m/s", "m/s2"),
    plain("m/s2", "m/s3"),
    plain("m/s3", "m/s4"),
    plain("m/s4", ""),
    plain("kg", "kg/s"),
    plain("kg/s", ""),
    plain("kg.m2", ""),
    plain("kg2.m4", ""),
    plain("kg.m", ""),
    plain("kg/m", ""),
    plain("kg/m3", ""),
    plain("m2", ""),
    plain("m3", "m3/s"),
    plain("m3/s", ""),
    plain("N", "N/s"),
    plain("N/s", ""),
    plain("N/m", ""),
    plain("N.s/m", ""),
    plain("N.m.s/rad", ""),
    plain("N.m.s2/rad2", ""),
    plain("N.m/rad", ""),
    plain("N.m.s2/rad", ""),
    plain("rad/(s2.N.m)", ""),
    plain("Pa", "Pa/s"),
    plain("Pa/s", ""),
    plain("J", "W"),
    plain("W", ""),
    plain("A", "A/s"),
    plain("A/s", ""),
    plain("K", "K/s"),
    plain("K/s", ""),
    plain("J/K", "W/K"),
    plain("W/K", ""),
    plain("N.m", "N.m/s"),
    plain("N.m/s", ""),
    plain("N.m/V", ""),
    plain("N.m/V2", ""),
    plain("s/rad", ""),
    plain("V", "V/s"),
    plain("V/s", ""),
    plain("1", "1/s"),
];

/// The longest text of a unit, in characters.
const LONGEST: usize = 100;

impl Unit {
    /// Symbols of units that are known, without those that a prefix or a quotient makes of others.
    pub fn known() -> impl Iterator<Item = &'static str> {
        COMMON.iter().map(|common| common.symbol).chain(base::symbols())
    }

    /// The unit of a text.
    pub fn of(symbol: &'static str) -> Self {
        let display = common(symbol).and_then(|common| common.display);
        Unit { symbol, base: Base::of(symbol), display }
    }

    /// Units of a description, one an element; 1 for all where none are given. Any text is a unit; an empty one is none.
    ///
    /// # Errors
    /// Which text of the `name`d variable can't be one, or how many there must be.
    pub fn symbols(name: &str, units: &[String], len: usize) -> Result<Vec<&'static str>, Invalid> {
        if units.is_empty() {
            return Ok(vec!["1"; len]);
        }
        if units.len() != len {
            return Err(Invalid::new(format!("units of {name}"), units.len(), format!("must be {len}")));
        }
        let symbol = |unit: &String| {
            if !Unit::is_text(unit) {
                let allowed =
                    format!("must be at most {LONGEST} characters, with no control character and no space around");
                return Err(Invalid::new(format!("unit of {name}"), format!("`{unit}`"), allowed));
            }
            Ok(interned(unit))
        };
        units.iter().map(symbol).collect()
    }

    /// True if a text can be a unit.
    pub fn is_text(text: &str) -> bool {
        text.chars().count() <= LONGEST && !text.contains(char::is_control) && text.trim() == text
    }

    /// The unit of a time derivative; empty where none is known.
    pub fn per_second(symbol: &'static str) -> &'static str {
        if let Some(common) = common(symbol) {
            return common.per_second;
        }
        match symbol.split_once('/') {
            None if symbol.is_empty() || symbol.contains([' ', '(', ')']) => "",
            None => interned(&format!("{symbol}/s")),
            Some((over, under)) if under.contains(['/', '(', ')', '.', '*', ' ']) || over.contains(['(', ')']) => "",
            Some((over, under)) => interned(&format!("{over}/({under}.s)")),
        }
    }
}

fn common(symbol: &str) -> Option<&'static Common> {
    COMMON.iter().find(|common| common.symbol == symbol)
}

/// A text that stays as long as the program runs: descriptions give few, and each is stored once.
fn interned(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    if let Some(common) = common(text) {
        return common.symbol;
    }
    let mut texts = TEXTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some(known) = texts.get(text) {
        return known;
    }
    let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
    texts.insert(text);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_derivative_has_the_unit_of_its_state_divided_by_seconds() {
        let others =
            ["km/h", "rpm", "degC", "bar", "%", "kg.m2", "N.m2"].map(|symbol| (symbol, Unit::per_second(symbol)));
        let table = COMMON.iter().map(|common| (common.symbol, common.per_second));
        for (state, rate) in table.chain(others).filter(|(_, rate)| !rate.is_empty()) {
            let (state, rate) = (Base::of(state).unwrap(), Base::of(rate).unwrap_or_else(|| panic!("{rate}")));
            let mut exponents = state.exponents;
            exponents[2] -= 1;
            assert_eq!((rate.exponents, rate.offset), (exponents, 0.0));
            assert!((rate.factor / state.factor - 1.0).abs() < 1e-15);
        }
        let unknown = ["N.m/(rad.s)", "m/s/h", "", "widgets per m"].map(Unit::per_second);
        assert_eq!((unknown, Unit::per_second("widget")), ([""; 4], "widget/s"));
    }

    #[test]
    fn the_units_of_this_package_are_base_units_and_their_products() {
        for Common { symbol, display, .. } in COMMON {
            let base = Base::of(symbol).unwrap_or_else(|| panic!("{symbol}"));
            assert_eq!((base.factor, base.offset), (1.0, 0.0), "{symbol}");
            if let Some(display) = display {
                let shown = Base::of(display.symbol).unwrap_or_else(|| panic!("{}", display.symbol));
                assert_eq!(shown.exponents, base.exponents);
                assert!((display.factor * shown.factor - 1.0).abs() < 1e-15, "{}", display.symbol);
            }
        }
    }

    #[test]
    fn a_text_is_stored_once() {
        let symbols = |text: &str| Unit::symbols("x", &[text.to_owned()], 1);
        assert!(std::ptr::eq(symbols("furlong").unwrap()[0], symbols("furlong").unwrap()[0]));
        assert_eq!((Unit::of(symbols("furlong").unwrap()[0]).base, symbols("").unwrap()), (None, vec![""]));
        let refused = symbols("a\tb").unwrap_err().to_string();
        assert!(refused.contains("unit of x") && refused.contains("control character"), "{refused}");
        assert!(symbols(&"x".repeat(101)).is_err() && symbols(" m").is_err());
    }
}
