//! The uncertainty that is assumed of a plant, with words for it.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::bounds::Bounds;
use super::region::LARGEST;
use crate::design::{digits, percent};
use crate::nominal::{Identified, USUAL_LEVEL, USUAL_MARGIN, Uncertainty};

/// Confidence of the statement about plants that were not drawn.
const CONFIDENCE: f64 = 0.99;

/// Bounds of a plant, and where they are from.
#[derive(Debug, Clone)]
pub struct Assumed {
    /// In the units of the plant.
    pub bounds: Bounds,
    source: Source,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    /// Nothing is assumed.
    Nothing,
    /// A part of each entry.
    Part(f64),
    /// A bound of each entry.
    Elements,
    /// Confidence level, and factor of the region.
    Records(f64, f64),
}

impl Assumed {
    /// The uncertainty that a description gives.
    pub fn new(A: &DMatrix<f64>, B: &DMatrix<f64>, uncertainty: &Uncertainty) -> Self {
        let nothing = || (Bounds::none(B.shape()), Source::Nothing);
        let (bounds, source) = match uncertainty {
            Uncertainty::Unknown => nothing(),
            Uncertainty::Part(part) => (Bounds::by_part(A, B, *part), Source::Part(*part)),
            Uncertainty::Elements { A, B } => (Bounds::of_elements(A.clone(), B.clone()), Source::Elements),
            Uncertainty::Model(Identified { region: None, .. }) => nothing(),
            Uncertainty::Model(Identified { region: Some(region), level, margin, .. }) => {
                let (level, margin) = (level.unwrap_or(USUAL_LEVEL), margin.unwrap_or(USUAL_MARGIN));
                (Bounds::of_records(region, level, margin, B.shape()), Source::Records(level, margin))
            }
        };
        Assumed { bounds, source }
    }

    /// True if something is assumed.
    pub fn is_known(&self) -> bool {
        self.source != Source::Nothing
    }

    /// Words for all of it, as in "with 20 % of each element by itself".
    pub fn whole(&self) -> String {
        match self.source {
            Source::Nothing | Source::Elements => "the bounds of each element by itself".to_owned(),
            Source::Part(part) => format!("{} % of each element by itself", percent(100.0 * part)),
            Source::Records(level, margin) => {
                format!("{} times the {} % region of the records", digits(margin), percent(100.0 * level))
            }
        }
    }

    /// Words for a share of it.
    pub fn share(&self, share: f64) -> String {
        match self.source {
            Source::Nothing | Source::Elements => format!("{} of the bounds", digits(share)),
            Source::Part(part) => format!("{} %", percent(100.0 * part * share)),
            Source::Records(_, margin) => format!("{} times the region", digits(share * margin)),
        }
    }

    /// The option by which less is assumed.
    pub fn option(&self) -> &'static str {
        if matches!(self.source, Source::Records(..)) { "--margin" } else { "--uncertainty" }
    }

    /// The largest share that is looked at.
    pub fn most(&self) -> f64 {
        match self.source {
            Source::Part(part) if part > 0.0 => (LARGEST / part).max(1.0),
            _ => 1.0,
        }
    }

    /// A sentence on the other plants of the region where all of so many that were drawn by their density are stable; nothing for
    /// bounds, within which no plant is likelier than others.
    pub fn others(&self, drawn: usize) -> String {
        if !matches!(self.source, Source::Records(..)) || drawn == 0 {
            return String::new();
        }
        let most = 1.0 - (1.0 - CONFIDENCE).powf(1.0 / drawn as f64);
        format!(
            " At most {} % of the plants of the region are not stable (with {} % confidence).",
            digits(100.0 * most),
            percent(100.0 * CONFIDENCE)
        )
    }
}
