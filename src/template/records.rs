//! Uncertainty of a plant that was identified from records.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};
use serde::Deserialize;
use serde_json::{Map, Value};

use crate::error::{Invalid, Number};
use crate::nominal::{Covariance, Identified, USUAL_LEVEL, USUAL_MARGIN};

/// Margin of the bound of disturbances: records may lack the largest.
const MORE: f64 = 1.2;
/// Words in the method of a model whose states weren't measured.
const OUTPUTS_ONLY: &str = "outputs only";

/// The records of an identified plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Records {
    /// The model, with the covariance of A and B.
    pub model: Identified,
    /// Step of the records, s.
    pub sample_time: Option<f64>,
    /// True if each state was measured, not only outputs.
    pub measures_states: bool,
    /// The constant rate of each record, with its covariance.
    offsets: Vec<(DVector<f64>, DMatrix<f64>)>,
    /// Bound of what the model doesn't explain, as each input.
    disturbance: Vec<f64>,
}

/// Keys of a model's file that matter for a design.
#[derive(Debug, Deserialize)]
struct Written {
    sample_time: Option<f64>,
    #[serde(default)]
    offset: Vec<Vec<f64>>,
    free: Vec<(String, usize, usize)>,
    covariance: Vec<Vec<f64>>,
    #[serde(default)]
    disturbance: Vec<f64>,
    level: Option<f64>,
    #[serde(default)]
    method: String,
}

impl Records {
    /// Those of a model's file, with n states and m inputs; `None` of a file without a covariance.
    ///
    /// # Errors
    /// Keys whose sizes or values don't fit.
    pub fn read(table: &Map<String, Value>, (n, m): (usize, usize)) -> Result<Option<Self>, Invalid> {
        if table.get("covariance").is_none_or(Value::is_null) {
            return Ok(None);
        }
        let written: Written = serde_json::from_value(Value::Object(table.clone()))
            .map_err(|error| Invalid::because(error.to_string()))?;
        let Written { sample_time, offset, free, covariance, disturbance, level, method } = written;
        let p = free.len();
        if covariance.len() != p {
            let given = format!("{} rows", covariance.len());
            return Err(Invalid::new("covariance", given, format!("must be {p} rows, one for each entry of free")));
        }
        if let Some((i, row)) = covariance.iter().enumerate().find(|(_, row)| row.len() != p) {
            let given = format!("{} numbers", row.len());
            return Err(Invalid::new(format!("covariance, row {}", i + 1), given, format!("must be {p} numbers")));
        }
        let (of_rates, of_entries): (Vec<_>, Vec<_>) = (0..p).partition(|&k| free[k].0 == "d");
        let rows = of_entries.iter().enumerate();
        let rows: Vec<Vec<f64>> =
            rows.map(|(i, &k)| of_entries[..=i].iter().map(|&l| covariance[k][l]).collect()).collect();
        let entries: Vec<_> = of_entries.iter().map(|&k| free[k].clone()).collect();
        let region = Some(Covariance::read("", &entries, &rows, (n, m))?);
        if let Some(level) = level.filter(|level| !(*level > 0.0 && *level < 1.0)) {
            return Err(Invalid::new("level", Number(level), "must be above 0 and below 1"));
        }
        if offset.iter().any(|row| row.len() != n) || ![0, m].contains(&disturbance.len()) {
            return Err(Invalid::because(format!(
                "offset must be rows of {n} numbers, one for each state, and disturbance {m} numbers, one for each input"
            )));
        }
        let of_record = |(record, row): (usize, &Vec<f64>)| {
            let place = |i: usize| of_rates.iter().copied().find(|&k| free[k].1 == i + 1 && free[k].2 == record + 1);
            let entry = |i: usize, j: usize| place(i).zip(place(j)).map_or(0.0, |(k, l)| covariance[k][l]);
            (DVector::from_row_slice(row), DMatrix::from_fn(n, n, entry))
        };
        Ok(Some(Records {
            model: Identified {
                file: String::new(),
                sha256: None,
                level: Some(level.unwrap_or(USUAL_LEVEL)),
                margin: Some(USUAL_MARGIN),
                region,
            },
            sample_time: sample_time.filter(|step| *step > 0.0 && step.is_finite()),
            measures_states: !method.contains(OUTPUTS_ONLY),
            offsets: offset.iter().enumerate().map(of_record).collect(),
            disturbance,
        }))
    }

    /// The same for a plant of n states with some of its inputs only.
    #[must_use]
    pub fn of_inputs(mut self, places: &[usize], n: usize) -> Self {
        if let Some(Covariance { entries, matrix }) = self.model.region.take() {
            let new = |&entry: &usize| match entry.checked_sub(n * n) {
                None => Some(entry),
                Some(of_B) => Some(n * n + places.iter().position(|&place| place == of_B / n)? * n + of_B % n),
            };
            let used: Vec<_> = (0..entries.len()).filter(|&k| new(&entries[k]).is_some()).collect();
            let matrix = matrix.select_rows(&used).select_columns(&used);
            self.model.region = Some(Covariance { entries: entries.iter().filter_map(new).collect(), matrix });
        }
        self.disturbance = places.iter().filter_map(|&place| self.disturbance.get(place).copied()).collect();
        self
    }

    /// Confidence level of what is uncertain.
    pub fn level(&self) -> f64 {
        self.model.level.unwrap_or(USUAL_LEVEL)
    }

    /// Bounds of disturbances in the units of the inputs, with the pseudoinverse of B, by z standard errors.
    pub fn disturbances(&self, matched: &DMatrix<f64>, z: f64) -> Vec<f64> {
        let m = matched.nrows();
        let of_records = self.offsets.iter().map(|(rate, covariance)| {
            let error = (matched * covariance * matched.transpose()).diagonal().map(|square| square.max(0.0).sqrt());
            (matched * rate).abs() + error * z
        });
        let constant = of_records.fold(DVector::zeros(m), |largest, one| largest.sup(&one));
        let other = |j: usize| self.disturbance.get(j).copied().unwrap_or(0.0);
        (0..m).map(|j| MORE * constant[j].max(other(j))).collect()
    }
}
