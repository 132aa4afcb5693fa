//! Units of measurement of records: models are in base units, with which numbers of different signals fit each other.

use adaptive_fmu_identification::Record;

use crate::error::{Error, Invalid};
use crate::system::{Base, Unit};

/// Prefixes that a base unit may have.
const PREFIXES: [char; 10] = ['k', 'm', 'u', 'µ', 'M', 'c', 'd', 'h', 'G', 'n'];

/// Converts the columns whose unit is known, by the table or by `given` (column and unit), to base units; returns a line for each
/// that was converted.
///
/// # Errors
/// A column that the record lacks, or a unit that isn't known.
pub fn convert(record: &mut Record, given: &[(String, String)]) -> Result<Vec<String>, Error> {
    for (name, unit) in given {
        if Base::of(unit).is_none() {
            let allowed = "must be NAME=UNIT with a unit as rad/s, rpm, mm or degC";
            return Err(Error::Argument(Invalid::new("--unit", format!("{name}={unit}"), allowed)));
        }
        let known = record.columns.iter().map(|column| column.name.clone()).collect();
        let unknown = || Error::Unknown { what: "column", name: name.clone(), known, all: "" };
        let column = record.columns.iter_mut().find(|column| column.name == *name).ok_or_else(unknown)?;
        column.unit = Some(unit.clone());
    }
    let mut lines = Vec::new();
    for column in &mut record.columns {
        let Some((unit, base)) = column.unit.clone().and_then(|unit| Some((unit.clone(), Base::of(&unit)?))) else {
            continue;
        };
        if base.factor == 1.0 && base.offset == 0.0 {
            continue;
        }
        let Some(to) = symbol(&unit, base) else { continue };
        column.values.iter_mut().for_each(|value| *value = base.factor * *value + base.offset);
        lines.push(format!("{} was converted from {unit} to {to}", column.name));
        column.unit = Some(to);
    }
    Ok(lines)
}

/// The base unit of the same quantity, without a prefix where there was one; none where there is no text for it.
fn symbol(unit: &str, base: Base) -> Option<String> {
    let is_base = |text: &&str| {
        Base::of(text).is_some_and(|of| of.exponents == base.exponents && of.factor == 1.0 && of.offset == 0.0)
    };
    let plain = unit.strip_prefix(PREFIXES).filter(is_base);
    plain.or_else(|| Unit::known().find(|unit| is_base(unit))).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn record(units: &[&str]) -> Record {
        let mut record = Record::new(
            "r",
            vec![0.0, 1.0],
            units.iter().map(|unit| ((*unit).to_owned(), vec![1.0, f64::NAN])).collect(),
        );
        record.columns.iter_mut().zip(units).for_each(|(column, unit)| column.unit = Some((*unit).to_owned()));
        record
    }

    #[test]
    fn units_become_base_units() {
        let all = ["rpm", "mm", "kN.m", "kJ", "bar", "degC", "%", "deg/s", "V", "rad/s", "counts", "mA"];
        let mut record = record(&all);
        let lines = convert(&mut record, &[]).unwrap();
        let expected = [
            ("rad/s", PI / 30.0),
            ("m", 1e-3),
            ("N.m", 1e3),
            ("J", 1e3),
            ("Pa", 1e5),
            ("K", 274.15),
            ("1", 0.01),
            ("rad/s", PI / 180.0),
            ("V", 1.0),
            ("rad/s", 1.0),
            ("counts", 1.0),
            ("A", 1e-3),
        ];
        for (column, (unit, value)) in record.columns.iter().zip(expected) {
            assert_eq!(column.unit.as_deref(), Some(unit), "{}", column.name);
            assert!((column.values[0] - value).abs() < 1e-12 * value && column.values[1].is_nan(), "{}", column.name);
        }
        assert_eq!(lines.len(), 9);
        assert_eq!(lines[0], "rpm was converted from rpm to rad/s");
    }

    #[test]
    fn units_that_are_given_count() {
        let mut record = record(&["V", "x"]);
        convert(&mut record, &[("x".to_owned(), "rpm".to_owned())]).unwrap();
        assert_eq!(record.columns[1].unit.as_deref(), Some("rad/s"));
        let refused = |name: &str, unit: &str| {
            convert(&mut self::record(&["V", "x"]), &[(name.to_owned(), unit.to_owned())]).unwrap_err().to_string()
        };
        assert!(refused("x", "turns/fortnight").contains("--unit = x=turns/fortnight: must be NAME=UNIT"));
        assert!(refused("y", "V").contains("`y`"));
    }
}
