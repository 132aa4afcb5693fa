//! Tuning settings from a loop's annotation.

use roxmltree::Node;
use serde::{Deserialize, Serialize};

use super::reader::Reader;
use crate::error::Error;
use crate::model_description::{attribute, elements};

/// Searched parameters and the objective.
#[derive(Debug, Clone, PartialEq)]
pub struct Tuning {
    /// Parameters.
    pub parameters: Vec<TunedParameter>,
    /// Terms of the objective.
    pub terms: Vec<SquareTerm>,
    /// Sample time of the sum, s.
    pub sample: f64,
    /// Stop time of the runs, s; none: that of the loop.
    pub until: Option<f64>,
}

/// A parameter and its bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct TunedParameter {
    /// Its name, `component.variable`.
    pub name: String,
    /// Lower bound; none: the smallest value that the FMU allows.
    pub low: Option<f64>,
    /// Upper bound; none: the largest value that the FMU allows.
    pub high: Option<f64>,
}

/// weight · (of − minus)²
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SquareTerm {
    /// Its weight.
    pub weight: f64,
    /// The signal.
    pub of: String,
    /// Signal that is subtracted from it.
    pub minus: Option<String>,
}

impl Reader<'_> {
    pub fn tuning(&self, node: Node) -> Result<Tuning, Error> {
        let optional = |node: Node, name| node.attribute(name).map(|_| self.number(node, name)).transpose();
        let parameter = |node: Node| {
            let (low, high) = (optional(node, "min")?, optional(node, "max")?);
            Ok(TunedParameter { name: self.required(node, "name")?, low, high })
        };
        let term = |node: Node| {
            let (of, minus) = (self.required(node, "of")?, attribute(node, "minus"));
            Ok(SquareTerm { weight: self.number_or(node, "weight", 1.0)?, of, minus })
        };
        let (sample, until) = (self.number(node, "sample")?, optional(node, "until")?);
        if sample <= 0.0 {
            return Err(self.refuse(node, &format!("sample = {sample}: must be above 0")));
        }
        Ok(Tuning {
            parameters: elements(node, "Parameter").map(parameter).collect::<Result<_, _>>()?,
            terms: elements(node, "Square").map(term).collect::<Result<_, _>>()?,
            sample,
            until,
        })
    }
}
