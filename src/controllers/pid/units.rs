//! Units of a PID controller's signals, and those of its gains, which follow from them.

use serde::Deserialize;

use crate::controllers::units::quotient;
use crate::system::{Invalid, Unit};

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Units {
    /// Units of the measured output, and of its reference.
    y: Vec<String>,
    /// Units of the control.
    u: Vec<String>,
    /// Units of the channels' demands, which S turns into the control; if not given, those of the control.
    v: Vec<String>,
}

/// Known units.
#[derive(Debug)]
#[allow(non_snake_case)] // gains have the names of the field
pub(super) struct Symbols {
    pub y: Vec<&'static str>,
    pub u: Vec<&'static str>,
    pub v: Vec<&'static str>,
    pub K_p: Vec<&'static str>,
    pub K_i: Vec<&'static str>,
    pub K_d: Vec<&'static str>,
    /// In the order of storage, by columns.
    pub S: Vec<&'static str>,
}

impl Units {
    /// # Errors
    /// A text that isn't a unit, or a wrong number of them.
    pub(super) fn symbols(&self, m: usize) -> Result<Symbols, Invalid> {
        let (y, u) = (Unit::symbols("y", &self.y, m)?, Unit::symbols("u", &self.u, m)?);
        let v = if self.v.is_empty() { u.clone() } else { Unit::symbols("v", &self.v, m)? };
        let gains = |behind: &str| {
            let texts: Vec<_> = v.iter().zip(&y).map(|(v, y)| quotient(&[v], &[y, behind])).collect();
            Unit::symbols("v", &texts, m)
        };
        let of_S: Vec<_> = v.iter().flat_map(|v| u.iter().map(|u| quotient(&[u], &[v]))).collect();
        Ok(Symbols {
            K_p: gains("1")?,
            K_i: gains("s")?,
            K_d: gains("1/s")?,
            S: Unit::symbols("S", &of_S, m * m)?,
            y,
            u,
            v,
        })
    }
}
