//! A plant whose entries are known within bounds.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::bounds::Bounds;
use super::place::Place;
use crate::mathematics::balanced::balance;

/// Most uncertain entries whose signs are changed one by one.
const FEW_ENTRIES: usize = 60;
/// A sampled control is late by so many of its steps: half of one as it is constant, half of one as what it measures is.
const LATE: f64 = 1.0;
/// Most passes.
const PASSES: usize = 3;

/// x' = (A + ΔA) x + (B + ΔB) u, y = C x, with ΔA and ΔB within bounds, in balanced coordinates with time in 1/W.
#[derive(Debug, Clone)]
pub struct Uncertain {
    /// n × n.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × n.
    pub C: DMatrix<f64>,
    /// Bounds of A and B.
    pub bounds: Bounds,
    /// B⁺, m × n, of the coordinates of the file, in which laws without P take it.
    pub inverse: DMatrix<f64>,
    /// Dead time of the inputs, the longest, in 1/W.
    pub delay: f64,
    /// Dead time of each input, in 1/W.
    pub delays: Vec<f64>,
    /// x = S z: the diagonal of S.
    pub scales: DVector<f64>,
    /// W, rad/s.
    pub bandwidth: f64,
}

impl Uncertain {
    /// From matrices and bounds in the units of a file, and dead times, s; `None` where B has no inverse.
    pub fn new([A, B, C]: [&DMatrix<f64>; 3], bounds: &Bounds, delays: &[f64], bandwidth: f64) -> Option<Self> {
        let inverse = B.clone().pseudo_inverse(0.0).ok()?;
        let (A, B, C, scales) = balance(A, B, C);
        let scales = DVector::from_vec(scales);
        let delays: Vec<_> = delays.iter().map(|delay| delay * bandwidth).collect();
        let delay = delays.iter().copied().fold(0.0, f64::max);
        let bounds = bounds.clone();
        let mut plant =
            Uncertain { A: A / bandwidth, B: B / bandwidth, C, bounds, inverse, delay, delays, scales, bandwidth };
        let (of_A, of_B) = (plant.dynamics(&plant.bounds.A), plant.scaled(&plant.bounds.B) / bandwidth);
        plant.bounds = plant.bounds.with(of_A, of_B);
        plant.inverse = plant.feedback(&plant.inverse) * bandwidth;
        Some(plant)
    }

    /// S⁻¹ M S/W of a matrix that turns states into rates.
    pub fn dynamics(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        self.feedback(&self.scaled(matrix)) / self.bandwidth
    }

    /// M S of a matrix that turns states into something else.
    pub fn feedback(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * self.scales[j])
    }

    /// M S⁻¹, back into the units of the file.
    pub fn in_units(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / self.scales[j])
    }

    /// S M S of a weight of states.
    pub fn weight(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * self.scales[i] * self.scales[j])
    }

    fn scaled(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / self.scales[i])
    }

    /// States and inputs.
    pub fn size(&self) -> (usize, usize) {
        self.B.shape()
    }

    /// From a place with a value on to [neighbours](Bounds::neighbour) whose value is larger, where uncertain entries are few.
    /// `value` is none where a place doesn't count.
    pub fn worse(
        &self,
        mut place: Place,
        mut largest: f64,
        mut value: impl FnMut(&Place) -> Option<f64>,
    ) -> (Place, f64) {
        let count = self.bounds.entries().len();
        let few = if count <= FEW_ENTRIES { 2 * count } else { 0 };
        // What one entry does may depend on another that was looked at later.
        for _ in 0..PASSES {
            let before = largest;
            for number in 0..few {
                let Some(other) = self.bounds.neighbour(&place, number) else { continue };
                if let Some(found) = value(&other).filter(|found| *found > largest) {
                    (place, largest) = (other, found);
                }
            }
            if largest == before {
                break;
            }
        }
        (place, largest)
    }

    /// True if some entry is uncertain.
    pub fn is_uncertain(&self) -> bool {
        !self.bounds.entries().is_empty()
    }

    /// The same plant with each dead time longer by that of a control that is constant within communication steps, 1/W. Where there is
    /// no dead time, the loop has margins for that.
    pub fn with_later_controls(&self, step: f64) -> Self {
        let later = |&delay: &f64| if delay > 0.0 { delay + LATE * step } else { delay };
        Uncertain { delays: self.delays.iter().map(later).collect(), ..self.clone() }
    }

    /// The same plant with all bounds times a factor.
    pub fn with_bounds_times(&self, factor: f64) -> Self {
        Uncertain { bounds: self.bounds.times(factor), ..self.clone() }
    }

    /// A and B of the plant at a place within the bounds, in the coordinates and units of the file.
    pub fn in_file(&self, place: &Place) -> [DMatrix<f64>; 2] {
        let [A, B] = self.at(place);
        let scaled = |matrix: DMatrix<f64>| {
            DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * self.scales[i] * self.bandwidth)
        };
        [self.in_units(&scaled(A)), scaled(B)]
    }

    /// The plant at a place within the bounds.
    pub fn at(&self, place: &Place) -> [DMatrix<f64>; 2] {
        [&self.A + self.bounds.A.component_mul(&place.A), &self.B + self.bounds.B.component_mul(&place.B)]
    }
}
