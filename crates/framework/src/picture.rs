//! Pictures of a design report: curves and marks, as numbers.

use serde::{Deserialize, Serialize};

/// Curves over one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// Title.
    pub title: String,
    /// Horizontal axis, with its unit.
    pub x: String,
    /// Vertical axis, with its unit.
    pub y: String,
    /// True if the horizontal axis is logarithmic.
    pub logarithmic: bool,
    /// Its curves, those of other plants before that of the nominal one.
    pub curves: Vec<Curve>,
}

/// A curve, or marks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Name of the signal.
    pub name: String,
    /// The plant that it belongs to, or a bound.
    pub of: CurveOf,
    /// Its points.
    pub points: Vec<[f64; 2]>,
}

/// The plant of a curve, and its form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CurveOf {
    /// The loop with the nominal plant.
    Nominal,
    /// The loop with a plant within the uncertainty.
    Worst,
    /// A reference or a limit.
    Bound,
    /// Single points of the nominal loop, without a line between them.
    Marks,
    /// Single points of a loop with a plant within the uncertainty.
    WorstMarks,
}
