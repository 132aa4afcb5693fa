//! Units: SI exponents, and what a person prefers to see.

use crate::error::Invalid;

/// A unit in terms of SI base units (with the radian).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Its symbol.
    pub symbol: &'static str,
    /// Exponents of kg, m, s, A, K and rad.
    pub exponents: [i32; 6],
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

const fn unit(symbol: &'static str, exponents: [i32; 6]) -> Unit {
    Unit { symbol, exponents, display: None }
}

const fn displayed(symbol: &'static str, exponents: [i32; 6], display: &'static str, factor: f64) -> Unit {
    Unit { symbol, exponents, display: Some(DisplayUnit { symbol: display, factor }) }
}

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// Every unit that a variable may have, with its derivative by time at `per_second`.
const UNITS: &[(Unit, &str)] = &[
    (displayed("s", [0, 0, 1, 0, 0, 0], "ms", 1e3), "1"),
    (unit("1/s", [0, 0, -1, 0, 0, 0]), "1/s2"),
    (unit("Hz", [0, 0, -1, 0, 0, 0]), "1/s2"),
    (unit("1/s2", [0, 0, -2, 0, 0, 0]), ""),
    (displayed("rad", [0, 0, 0, 0, 0, 1], "deg", DEGREES), "rad/s"),
    (displayed("rad/s", [0, 0, -1, 0, 0, 1], "deg/s", DEGREES), "rad/s2"),
    (displayed("rad/s2", [0, 0, -2, 0, 0, 1], "deg/s2", DEGREES), "rad/s3"),
    (unit("rad/s3", [0, 0, -3, 0, 0, 1]), "rad/s4"),
    (unit("rad/s4", [0, 0, -4, 0, 0, 1]), ""),
    (displayed("m", [0, 1, 0, 0, 0, 0], "mm", 1e3), "m/s"),
    (unit("m/s", [0, 1, -1, 0, 0, 0]), "m/s2"),
    (unit("m/s2", [0, 1, -2, 0, 0, 0]), "m/s3"),
    (unit("m/s3", [0, 1, -3, 0, 0, 0]), ""),
    (unit("kg", [1, 0, 0, 0, 0, 0]), "kg/s"),
    (unit("kg/s", [1, 0, -1, 0, 0, 0]), ""),
    (unit("kg.m2", [1, 2, 0, 0, 0, 0]), ""),
    (unit("kg2.m4", [2, 4, 0, 0, 0, 0]), ""),
    (unit("kg.m", [1, 1, 0, 0, 0, 0]), ""),
    (unit("kg/m", [1, -1, 0, 0, 0, 0]), ""),
    (unit("kg/m3", [1, -3, 0, 0, 0, 0]), ""),
    (unit("m2", [0, 2, 0, 0, 0, 0]), ""),
    (unit("m3", [0, 3, 0, 0, 0, 0]), "m3/s"),
    (unit("m3/s", [0, 3, -1, 0, 0, 0]), ""),
    (unit("N", [1, 1, -2, 0, 0, 0]), "N/s"),
    (unit("N/s", [1, 1, -3, 0, 0, 0]), ""),
    (unit("N/m", [1, 0, -2, 0, 0, 0]), ""),
    (unit("N.s/m", [1, 0, -1, 0, 0, 0]), ""),
    (unit("N.m.s/rad", [1, 2, -1, 0, 0, -1]), ""),
    (unit("N.m.s2/rad2", [1, 2, 0, 0, 0, -2]), ""),
    (unit("N.m/rad", [1, 2, -2, 0, 0, -1]), ""),
    (unit("Pa", [1, -1, -2, 0, 0, 0]), "Pa/s"),
    (unit("Pa/s", [1, -1, -3, 0, 0, 0]), ""),
    (unit("J", [1, 2, -2, 0, 0, 0]), "W"),
    (unit("W", [1, 2, -3, 0, 0, 0]), ""),
    (displayed("A", [0, 0, 0, 1, 0, 0], "mA", 1e3), "A/s"),
    (unit("A/s", [0, 0, -1, 1, 0, 0]), ""),
    (unit("K", [0, 0, 0, 0, 1, 0]), "K/s"),
    (unit("K/s", [0, 0, -1, 0, 1, 0]), ""),
    (unit("J/K", [1, 2, -2, 0, -1, 0]), "W/K"),
    (unit("W/K", [1, 2, -3, 0, -1, 0]), ""),
    (unit("N.m", [1, 2, -2, 0, 0, 0]), "N.m/s"),
    (unit("N.m/s", [1, 2, -3, 0, 0, 0]), ""),
    (unit("N.m/V", [0, 0, 1, 1, 0, 0]), ""),
    (unit("N.m/V2", [-1, -2, 4, 2, 0, 0]), ""),
    (unit("s/rad", [0, 0, 1, 0, 0, -1]), ""),
    (unit("V", [1, 2, -3, -1, 0, 0]), "V/s"),
    (unit("V/s", [1, 2, -4, -1, 0, 0]), ""),
    (unit("1", [0, 0, 0, 0, 0, 0]), "1/s"),
];

impl Unit {
    /// The unit of a symbol.
    pub fn known(symbol: &str) -> Option<&'static Unit> {
        UNITS.iter().map(|(unit, _)| unit).find(|unit| unit.symbol == symbol)
    }

    /// Symbols of known units from a description, one an element; 1 for all where none are given.
    ///
    /// # Errors
    /// Which unit of the `name`d variable isn't known, or how many there must be.
    pub fn symbols(name: &str, units: &[String], len: usize) -> Result<Vec<&'static str>, Invalid> {
        if units.is_empty() {
            return Ok(vec!["1"; len]);
        }
        if units.len() != len {
            return Err(Invalid::new(format!("units of {name}"), units.len(), format!("must be {len}")));
        }
        let known = |unit: &String| {
            let known = Unit::known(unit).map(|unit| unit.symbol);
            known.ok_or_else(|| {
                let symbols: Vec<_> = UNITS.iter().map(|(unit, _)| unit.symbol).collect();
                Invalid::new(
                    format!("unit of {name}"),
                    format!("`{unit}`"),
                    format!("must be one of 1, {}", symbols.join(", ")),
                )
            })
        };
        units.iter().map(known).collect()
    }

    /// The unit of a time derivative; empty where none is known.
    pub fn per_second(symbol: &str) -> &'static str {
        UNITS.iter().find(|(unit, _)| unit.symbol == symbol).map_or("", |(_, rate)| rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_derivative_has_the_unit_of_its_state_divided_by_seconds() {
        for (state, rate) in UNITS.iter().filter(|(_, rate)| !rate.is_empty()) {
            let rate = Unit::known(rate).expect("a unit in the table");
            let mut exponents = state.exponents;
            exponents[2] -= 1;
            assert_eq!(rate.exponents, exponents, "{} per second is {}", state.symbol, rate.symbol);
        }
    }
}
