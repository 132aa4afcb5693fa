//! Identified models as files.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// A linear model x' = A x + B u + offset, y = C x + D u, with what records leave uncertain of it. Unknown keys of a file are
/// refused by serde's message, which lists the known ones.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Rows of A.
    pub A: Vec<Vec<f64>>,
    /// Rows of B.
    pub B: Vec<Vec<f64>>,
    /// Rows of C.
    pub C: Vec<Vec<f64>>,
    /// Rows of D.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub D: Option<Vec<Vec<f64>>>,
    /// Names of the states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<String>,
    /// Names of the inputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// Names of the outputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<String>,
    /// Units of measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub units: Option<Units>,
    /// Lower limits of the inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_min: Option<Vec<f64>>,
    /// Upper limits of the inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_max: Option<Vec<f64>>,
    /// Dead time of each input, s.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub delay: Vec<f64>,
    /// The records' commonest step, s.
    pub sample_time: f64,
    /// The constant d of each record, in units of the states a second.
    pub offset: Vec<Vec<f64>>,
    /// The entries that were estimated.
    pub free: Vec<Free>,
    /// Their covariance, in units of the data.
    pub covariance: Vec<Vec<f64>>,
    /// Factors by which coloured residuals enlarge their standard errors; the covariance has them.
    pub kappa: Vec<f64>,
    /// Standard deviation of the noise of each measured signal.
    pub noise: Vec<f64>,
    /// Bound of effects on the plant that the model lacks, as each input.
    pub disturbance: Vec<f64>,
    /// Confidence level that was asked for.
    pub level: f64,
    /// Fits of the held-out part.
    pub fit: Fits,
    /// The largest of 20 autocorrelations of each residual, in units of 1/√N: below 3.7 of white noise.
    pub whiteness: Vec<f64>,
    /// The records.
    pub records: Vec<RecordOf>,
    /// Name of the method.
    pub method: String,
}

/// Units of measurement of signals.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Units {
    /// Units of the states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub x: Vec<String>,
    /// Units of the inputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub u: Vec<String>,
    /// Units of the outputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub y: Vec<String>,
}

/// An estimated entry: the matrix `A` or `B`, or `d`, with row and column from 1; a column of d is a record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Free(pub String, pub usize, pub usize);

/// Fits of the held-out part of records, % of the motion of each measured signal.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fits {
    /// Simulated over the whole of it; empty for unstable plants and where nothing is held out. NaN, null in a file, of a signal without
    /// motion.
    #[serde(default, deserialize_with = "or_nan")]
    pub held_out: Vec<f64>,
    /// Simulated over windows of the controller's time scale.
    #[serde(default, deserialize_with = "or_nan")]
    pub windows: Vec<f64>,
}

/// Numbers of which null is NaN, as it is written.
pub(crate) fn or_nan<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let all = Vec::<Option<f64>>::deserialize(deserializer)?;
    Ok(all.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}

/// A record that a model is from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordOf {
    /// Its file.
    pub file: String,
    /// Checksum of the file; this package doesn't compute it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// The number of rows.
    pub rows: usize,
    /// Time of the first row, s.
    pub from: f64,
    /// Time of the last row, s.
    pub to: f64,
}

/// Rows of a matrix.
pub(crate) fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        Model {
            A: vec![vec![-1.0, 0.1 + 0.2], vec![0.0, -2.0]],
            B: vec![vec![1.0], vec![3.0]],
            C: vec![vec![1.0, 0.0]],
            states: vec!["x".to_owned(), "v".to_owned()],
            free: vec![Free("A".to_owned(), 1, 2), Free("d".to_owned(), 2, 1)],
            covariance: vec![vec![0.25, 0.1], vec![0.1, 1e-9]],
            sample_time: 0.05,
            method: "output error".to_owned(),
            ..Model::default()
        }
    }

    #[test]
    fn a_file_gives_the_same_model_again() {
        let text = serde_json::to_string(&model()).unwrap();
        assert!(text.contains(r#""free":[["A",1,2],["d",2,1]]"#), "{text}");
        assert_eq!(serde_json::from_str::<Model>(&text).unwrap(), model());
        // A signal without motion has no fit.
        let fit = Fits { held_out: vec![f64::NAN, 95.0], windows: Vec::new() };
        let again: Fits = serde_json::from_str(&serde_json::to_string(&fit).unwrap()).unwrap();
        assert!(again.held_out[0].is_nan() && again.held_out[1] == 95.0);
    }

    #[test]
    fn unknown_keys_are_refused_with_the_known_ones() {
        let text = serde_json::to_string(&model()).unwrap().replace("covariance", "covarianc");
        let error = serde_json::from_str::<Model>(&text).unwrap_err().to_string();
        assert!(
            error.starts_with("unknown field `covarianc`, expected one of `A`, `B`, `C`, `D`, `states`"),
            "{error}"
        );
    }
}
