//! Units of measure, as FMI and SSP define them.

use roxmltree::Node;

use super::description::{attribute, child};

/// Base units whose exponents make a dimension.
const BASE: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// A unit: a value in base units is factor · value + offset.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitDefinition {
    /// Its name.
    pub name: String,
    /// Exponents of kg, m, s, A, K, mol, cd and rad; none where the file doesn't tell.
    pub dimension: Option<[i32; 8]>,
    /// Factor.
    pub factor: f64,
    /// Offset, in base units.
    pub offset: f64,
}

/// The map factor · value + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// Factor.
    pub factor: f64,
    /// Offset.
    pub offset: f64,
}

impl Affine {
    /// Leaves a value as it is, bit for bit.
    pub const IDENTITY: Affine = Affine { factor: 1.0, offset: 0.0 };

    /// The mapped value.
    pub fn of(self, value: f64) -> f64 {
        if self == Affine::IDENTITY { value } else { self.factor * value + self.offset }
    }

    /// This map, then another.
    pub fn then(self, next: Affine) -> Affine {
        Affine { factor: next.factor * self.factor, offset: next.factor * self.offset + next.offset }
    }
}

impl UnitDefinition {
    /// Reads a Unit element of FMI or SSP; the reason when a number is none.
    pub(super) fn read(node: Node) -> Result<Self, String> {
        let name = attribute(node, "name").ok_or("a Unit has no name")?;
        let Some(base) = child(node, "BaseUnit") else {
            return Ok(UnitDefinition { name, dimension: None, factor: 1.0, offset: 0.0 });
        };
        let wrong = |key: &str| {
            format!("unit `{name}`: {key} = {}: must be a number", attribute(base, key).unwrap_or_default())
        };
        let number = |key: &str, default: f64| {
            let value = base.attribute(key).map_or(Some(default), |text| text.trim().parse().ok());
            value.filter(|value| value.is_finite()).ok_or_else(|| wrong(key))
        };
        let (factor, offset) = (number("factor", 1.0)?, number("offset", 0.0)?);
        if factor == 0.0 {
            return Err(format!("unit `{name}`: factor = 0: no unit has that"));
        }
        let mut dimension = [0; BASE.len()];
        for (exponent, key) in dimension.iter_mut().zip(BASE) {
            *exponent = base.attribute(key).map_or(Ok(0), |text| text.trim().parse()).map_err(|_| wrong(key))?;
        }
        Ok(UnitDefinition { name, dimension: Some(dimension), factor, offset })
    }

    /// How a value in this unit becomes one in another; none when their dimensions differ. A unit of unknown
    /// dimension converts to no other: the value stays as it is.
    pub fn to(&self, other: &UnitDefinition) -> Option<Affine> {
        match (self.dimension, other.dimension) {
            (Some(one), Some(another)) if one != another => None,
            (Some(_), Some(_)) if (self.factor, self.offset) != (other.factor, other.offset) => {
                Some(Affine { factor: self.factor / other.factor, offset: (self.offset - other.offset) / other.factor })
            }
            _ => Some(Affine::IDENTITY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(name: &str, factor: f64, offset: f64) -> UnitDefinition {
        UnitDefinition { name: name.into(), dimension: Some([0, 0, 0, 0, 1, 0, 0, 0]), factor, offset }
    }

    #[test]
    fn a_temperature_converts_with_factor_and_offset() {
        let (celsius, fahrenheit) = (unit("degC", 1.0, 273.15), unit("degF", 5.0 / 9.0, 459.67 * 5.0 / 9.0));
        let there = celsius.to(&fahrenheit).unwrap();
        assert!((there.of(100.0) - 212.0).abs() < 1e-12 && (there.of(-40.0) + 40.0).abs() < 1e-12);
        let round = there.then(fahrenheit.to(&celsius).unwrap());
        assert!((round.of(37.0) - 37.0).abs() < 1e-12);
    }

    #[test]
    fn the_same_unit_leaves_every_bit() {
        let kelvin = unit("K", 1.0, 0.0);
        let same = kelvin.to(&kelvin).unwrap();
        assert!(same.of(-0.0).is_sign_negative() && same.of(0.1) == 0.1);
    }
}
