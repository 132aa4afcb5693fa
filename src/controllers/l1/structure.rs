//! What the sizes of an L1 controller follow from, as its description says it.

use nalgebra::DMatrix;
use serde::Deserialize;

use crate::control::filter::{Filter, FilterDescription};
use crate::system::{Invalid, Unit};

/// Largest number of states: beyond it, solving the Lyapunov equation takes minutes.
const MOST_STATES: usize = 200;

/// What multiplies the estimates θ̂.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Regressor {
    /// φ(x) = x: θ̂ is m × n.
    State,
    /// φ(x) = ‖x‖∞: θ̂ is m × 1.
    InfinityNorm,
}

/// Which entries of the input gain ω are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InputGain {
    /// All.
    Full,
    /// Those of the diagonal; the others are zero.
    Diagonal,
}

/// Where the static state feedback −K_m x stands that gives the nominal plant its desired dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Baseline {
    /// There is none: the plant is written in the desired dynamics already.
    #[default]
    None,
    /// Beside the adaptive control, whose estimates see u_ad alone.
    Outside,
    /// Inside what the estimates see: the whole control, with K_m x as a known term.
    Inside,
}

/// The description of an L1 controller's structure.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // matrices have the names of the thesis
pub struct L1Structure {
    /// Nominal dynamics A of the plant, n rows of n numbers, where there is a baseline.
    A: Option<Vec<Vec<f64>>>,
    /// Input matrix B, n rows of m numbers.
    B: Vec<Vec<f64>>,
    /// Output matrix C, m rows of n numbers.
    C: Vec<Vec<f64>>,
    pub(super) regressor: Regressor,
    pub(super) input_gain: InputGain,
    #[serde(default)]
    pub(super) baseline: Baseline,
    #[serde(default)]
    filter: FilterDescription,
    #[serde(default)]
    units: Units,
}

/// Units of the signals, an element each; 1 where none are given.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Units {
    r: Vec<String>,
    x: Vec<String>,
    u: Vec<String>,
}

/// Known units of the signals.
#[derive(Debug)]
pub(super) struct Symbols {
    pub r: Vec<&'static str>,
    pub x: Vec<&'static str>,
    pub u: Vec<&'static str>,
}

/// The matrices of a structure, whose sizes fit each other.
#[derive(Debug)]
#[allow(non_snake_case)]
pub(super) struct Plant {
    /// Nominal dynamics, n × n; empty without a baseline.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × n.
    pub C: DMatrix<f64>,
}

impl L1Structure {
    /// Whether all entries of ω are estimated.
    pub(super) fn is_full(&self) -> bool {
        self.input_gain == InputGain::Full
    }

    /// # Errors
    /// What doesn't fit.
    #[allow(non_snake_case)]
    pub(super) fn plant(&self) -> Result<Plant, Invalid> {
        let (B, C) = (rows("B", &self.B)?, rows("C", &self.C)?);
        let (n, m) = B.shape();
        if n > MOST_STATES || m > n {
            let allowed = format!("must have 1 … {MOST_STATES} rows, and no more columns than rows");
            return Err(Invalid::new("B", format!("{n} x {m}"), allowed));
        }
        let of_size = |name: &str, matrix: &DMatrix<f64>, size: (usize, usize)| {
            let (rows, columns) = matrix.shape();
            let allowed = format!("must be {} x {}, as B is {n} x {m}", size.0, size.1);
            if (rows, columns) == size {
                Ok(())
            } else {
                Err(Invalid::new(name, format!("{rows} x {columns}"), allowed))
            }
        };
        of_size("C", &C, (m, n))?;
        let A = match (&self.A, self.baseline) {
            (None, Baseline::None) => DMatrix::zeros(0, 0),
            (Some(A), Baseline::Outside | Baseline::Inside) => {
                let A = rows("A", A)?;
                of_size("A", &A, (n, n))?;
                A
            }
            (None, _) => return Err(Invalid::because("A is missing: a baseline is designed for the nominal dynamics")),
            (Some(_), Baseline::None) => {
                let allowed = "belongs to a baseline (\"outside\" or \"inside\"), and there is none";
                return Err(Invalid::new("A", "given", allowed));
            }
        };
        Ok(Plant { A, B, C })
    }

    /// # Errors
    /// Which unit isn't known, or how many there must be.
    pub(super) fn units(&self, (n, m): (usize, usize)) -> Result<Symbols, Invalid> {
        let Units { r, x, u } = &self.units;
        Ok(Symbols { r: Unit::symbols("r", r, m)?, x: Unit::symbols("x", x, n)?, u: Unit::symbols("u", u, m)? })
    }

    /// # Errors
    /// Why it is no filter of this law.
    pub(super) fn filter(&self) -> Result<Filter, Invalid> {
        Filter::new(&self.filter)
    }
}

fn rows(name: &str, rows: &[Vec<f64>]) -> Result<DMatrix<f64>, Invalid> {
    let columns = rows.first().map_or(0, Vec::len);
    if columns == 0 {
        return Err(Invalid::new(name, "empty", "must be rows of equally many numbers"));
    }
    for (i, row) in rows.iter().enumerate() {
        let of_row = |value: String, allowed| Invalid::new(format!("row {} of {name}", i + 1), value, allowed);
        if row.len() != columns {
            let value = format!("{} numbers", row.len());
            return Err(of_row(value, format!("all rows must have equally many; the first has {columns}")));
        }
        if let Some(value) = row.iter().find(|value| !value.is_finite()) {
            return Err(of_row(value.to_string(), "must be finite numbers".to_owned()));
        }
    }
    Ok(DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j]))
}
