//! Options of an identification, and its results.

use serde::{Deserialize, Serialize};

use crate::finding::{Finding, Verdict};
use crate::model::Model;
use crate::poles::Pole;
use crate::residuals::Correlations;
use crate::sampled::Hold;
use crate::simulated::SimulatedCourse;
use crate::structure::Structure;

/// Options of an identification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Known entries of the model; all are free without.
    pub structure: Structure,
    /// Course of the inputs between rows.
    pub hold: Hold,
    /// Last part of each record that is held out.
    pub hold_out: f64,
    /// True if each record has a constant d of its own.
    pub offsets: bool,
    /// Confidence level, written to the model.
    pub level: f64,
    /// Dead time of each input, s; empty for none.
    pub delays: Vec<f64>,
    /// Inputs that are left out because they never move.
    pub fixed: Vec<String>,
    /// Longest window of output error, s; whole records without.
    pub longest_window: Option<f64>,
    /// Bandwidth of the controller to be designed, rad/s; without, from the model.
    pub bandwidth: Option<f64>,
    /// Number of states, where only outputs are measured; chosen without.
    pub order: Option<usize>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            structure: Structure::default(),
            hold: Hold::default(),
            hold_out: 0.3,
            offsets: true,
            level: 0.99,
            delays: Vec::new(),
            fixed: Vec::new(),
            longest_window: None,
            bandwidth: None,
            order: None,
        }
    }
}

/// An estimated entry with its uncertainty, in units of the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimated {
    /// The matrix, row and column from 1, as in [`Model::free`].
    pub entry: crate::model::Free,
    /// Its estimate.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
    /// The factor for coloured residuals in it.
    pub kappa: f64,
}

/// Fits of a model of one order, where the order is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OrderFit {
    /// Number of states.
    pub order: usize,
    /// Mean fit of the outputs over the held-out part, %; none where nothing is held out.
    pub held_out: Option<f64>,
    /// Bayesian information criterion; less is better.
    pub bic: f64,
    /// True if the sampled model belongs to a continuous one.
    pub is_continuous: bool,
}

/// A cell of a record that was left out as a wrong one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct WrongCell {
    /// Place of the record, from 0.
    pub record: usize,
    /// Place of the row in it, from 0.
    pub row: usize,
    /// Name of the signal.
    pub signal: String,
}

/// Results of an identification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// The model, as it is written to a file.
    pub model: Model,
    /// Findings, in the order in which they came up.
    pub findings: Vec<Finding>,
    /// The estimated entries.
    pub entries: Vec<Estimated>,
    /// Poles of the model, the slowest first.
    pub poles: Vec<Pole>,
    /// Condition number of the information with unit diagonal.
    pub condition: f64,
    /// The best fit of the held-out part that noise lets a model have, %, of each measured signal.
    #[serde(deserialize_with = "crate::model::or_nan")]
    pub ceiling: Vec<f64>,
    /// Bound of effects on the plant that no input can have, as derivatives of the states.
    pub unmatched: Vec<f64>,
    /// Start of each window of the held-out part, s, and the disturbance as inputs there.
    pub disturbance_over_time: Vec<(f64, Vec<f64>)>,
    /// Objective −2 ln likelihood of output error and of the innovation form, up to a common constant.
    pub losses: [Option<f64>; 2],
    /// Gain K of the predictor for one sample, in units of the data, where the innovation form counts.
    pub gain: Option<Vec<Vec<f64>>>,
    /// Cells that were left out as wrong.
    pub wrong_cells: Vec<WrongCell>,
    /// Fits by order, where only outputs are measured.
    pub orders: Vec<OrderFit>,
    /// Correlations of the residuals.
    pub correlations: Correlations,
    /// Measured signals as the model simulates them.
    #[serde(skip)]
    pub courses: Vec<SimulatedCourse>,
}

impl Identified {
    /// True if no finding forbids the use of the model for a design.
    pub fn is_sound(&self) -> bool {
        self.findings.iter().all(|finding| finding.verdict != Verdict::NotSound)
    }
}
