//! Units of measurement, as FMI and SSP define them.

use roxmltree::Node;

use super::{attribute, child};
use crate::near;
use crate::system::{BASE_UNITS, Base, Unit};

/// A unit: a value in base units is factor · value + offset.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitDefinition {
    /// Its name.
    pub name: String,
    /// Exponents of kg, m, s, A, K, mol, cd and rad; none if neither the file nor its name gives them.
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
    /// Conversion that leaves a value unchanged, bit for bit.
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
    /// The unit that a text names.
    pub fn named(name: &str) -> Self {
        let base = Base::of(name);
        let (factor, offset) = base.map_or((1.0, 0.0), |base| (base.factor, base.offset));
        UnitDefinition { name: name.to_owned(), dimension: base.map(|base| base.exponents), factor, offset }
    }

    /// Reads a Unit element of FMI or SSP; without a BaseUnit, its name defines it. The error names a wrong number.
    pub(crate) fn read(node: Node) -> Result<Self, String> {
        let name = attribute(node, "name").ok_or("a Unit has no name")?;
        let Some(base) = child(node, "BaseUnit") else {
            return Ok(UnitDefinition::named(&name));
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
        let mut dimension = [0; BASE_UNITS.len()];
        for (exponent, key) in dimension.iter_mut().zip(BASE_UNITS) {
            *exponent = base.attribute(key).map_or(Ok(0), |text| text.trim().parse()).map_err(|_| wrong(key))?;
        }
        Ok(UnitDefinition { name, dimension: Some(dimension), factor, offset })
    }

    /// The unit of differences of values in this one.
    #[must_use]
    pub(crate) fn relative(self) -> Self {
        UnitDefinition { offset: 0.0, ..self }
    }

    /// Conversion of a value in this unit to another; none if their dimensions differ. The radian counts as a plain
    /// number, too. A unit of unknown dimension leaves the value as it is.
    pub fn to(&self, other: &UnitDefinition) -> Option<Affine> {
        let is_plain = self.is_number() && other.is_angle() || other.is_number() && self.is_angle();
        match (self.dimension, other.dimension) {
            (Some(one), Some(another)) if one != another && !is_plain => None,
            (Some(_), Some(_)) if (self.factor, self.offset) != (other.factor, other.offset) => {
                Some(Affine { factor: self.factor / other.factor, offset: (self.offset - other.offset) / other.factor })
            }
            _ => Some(Affine::IDENTITY),
        }
    }

    /// Reason why a person should check the conversion by [`to`](Self::to); none if it is certain.
    pub(crate) fn doubt(&self, other: &UnitDefinition) -> Option<&'static str> {
        if self.dimension.is_none() || other.dimension.is_none() {
            return (self.name != other.name)
                .then_some("at least one of which is unknown, so the number is passed on unchanged");
        }
        let is_changed = self.to(other).is_some_and(|conversion| conversion != Affine::IDENTITY);
        (is_changed && (self.is_number() || other.is_number())).then_some("the dimensionless number is converted")
    }

    /// A question about a similar known unit; none if this one is known.
    pub(crate) fn meant(&self) -> Option<String> {
        let is_unknown = self.dimension.is_none();
        is_unknown.then(|| near::question(&self.name, &Unit::known().collect::<Vec<_>>()))?
    }

    /// True if it is an angle, or a power of one.
    fn is_angle(&self) -> bool {
        self.dimension.is_some_and(|[others @ .., _]| others == [0; BASE_UNITS.len() - 1])
    }

    /// True if it is 1.
    fn is_number(&self) -> bool {
        self.dimension == Some([0; BASE_UNITS.len()]) && self.factor == 1.0 && self.offset == 0.0
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

    #[test]
    fn a_plain_number_is_an_angle_in_radians_and_nothing_else() {
        let [one, rad, deg, rate, metre, percent] = ["1", "rad", "deg", "rpm", "m", "%"].map(UnitDefinition::named);
        assert_eq!((one.to(&rad), rad.to(&one)), (Some(Affine::IDENTITY), Some(Affine::IDENTITY)));
        assert_eq!((one.doubt(&rad), rad.doubt(&one), one.doubt(&one), rad.doubt(&deg)), (None, None, None, None));
        // Conversions to and from plain numbers give a warning.
        assert_eq!((deg.to(&one).unwrap().of(180.0), one.to(&percent).unwrap().of(0.5)), (std::f64::consts::PI, 50.0));
        assert!(deg.doubt(&one).is_some() && one.doubt(&percent).is_some() && percent.doubt(&one).is_some());
        for other in [&metre, &rate] {
            assert_eq!((one.to(other), other.to(&one), percent.to(other)), (None, None, None));
        }
        assert_eq!((rad.to(&metre), percent.to(&rad), metre.to(&rate)), (None, None, None));
    }

    #[test]
    fn texts_that_are_not_known_are_compared() {
        let [widget, gadget, metre] = ["widget", "gadget", "m"].map(UnitDefinition::named);
        assert_eq!((widget.doubt(&widget), widget.to(&gadget)), (None, Some(Affine::IDENTITY)));
        assert!(widget.doubt(&gadget).is_some() && widget.doubt(&metre).is_some() && metre.doubt(&gadget).is_some());
    }
}
