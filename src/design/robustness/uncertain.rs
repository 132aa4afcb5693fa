//! A plant whose entries are known within bounds.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use crate::mathematics::balanced::balance;

/// Of so many uncertain entries the signs are changed one by one.
const FEW_ENTRIES: usize = 60;
/// A sampled control is late by so many of its steps: half of one as it is constant, half of one as what it measures is.
const LATE: f64 = 1.0;
/// So many times at most.
const PASSES: usize = 3;

/// x' = (A ± ΔA) x + (B ± ΔB) u, y = C x, entry by entry, in balanced coordinates with time in 1/W.
#[derive(Debug, Clone)]
pub struct Uncertain {
    /// n × n.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// m × n.
    pub C: DMatrix<f64>,
    /// Bounds, n × n.
    pub dA: DMatrix<f64>,
    /// Bounds, n × m.
    pub dB: DMatrix<f64>,
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

/// Bounds of each entry by a part of it: rows of A of 0 and ±1 that no input enters are kinematics, which are certain.
pub fn by_part(A: &DMatrix<f64>, B: &DMatrix<f64>, part: f64) -> [DMatrix<f64>; 2] {
    let is_kinematic = |i: usize| {
        A.row(i).iter().all(|entry| [-1.0, 0.0, 1.0].contains(entry)) && B.row(i).iter().all(|entry| *entry == 0.0)
    };
    let mut dA = A.abs() * part;
    (0..A.nrows()).filter(|&i| is_kinematic(i)).for_each(|i| dA.row_mut(i).fill(0.0));
    [dA, B.abs() * part]
}

impl Uncertain {
    /// From matrices and bounds in the units of a file, and dead times, s; `None` where B has no inverse.
    pub fn new(
        [A, B, C]: [&DMatrix<f64>; 3],
        [dA, dB]: [&DMatrix<f64>; 2],
        delays: &[f64],
        bandwidth: f64,
    ) -> Option<Self> {
        let inverse = B.clone().pseudo_inverse(0.0).ok()?;
        let (A, B, C, scales) = balance(A, B, C);
        let scales = DVector::from_vec(scales);
        let delays: Vec<_> = delays.iter().map(|delay| delay * bandwidth).collect();
        let delay = delays.iter().copied().fold(0.0, f64::max);
        let (dA, dB) = (dA.clone(), dB.clone());
        let mut plant =
            Uncertain { A: A / bandwidth, B: B / bandwidth, C, dA, dB, inverse, delay, delays, scales, bandwidth };
        (plant.dA, plant.dB) = (plant.dynamics(&plant.dA), plant.scaled(&plant.dB) / bandwidth);
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

    /// From a place with a value on to others whose value is larger, by trying either sign of each uncertain entry in turn, where
    /// these are few. `value` is none where a place doesn't count.
    pub fn worse(
        &self,
        mut place: Place,
        mut largest: f64,
        mut value: impl FnMut(&Place) -> Option<f64>,
    ) -> (Place, f64) {
        let entries = self.uncertain_entries();
        let few = if entries.len() <= FEW_ENTRIES { &entries[..] } else { &[] };
        // What one entry does may depend on the sign of another that was looked at later.
        for _ in 0..PASSES {
            let before = largest;
            for (entry, sign) in few.iter().flat_map(|&entry| [(entry, -1.0), (entry, 1.0)]) {
                if place.at(entry) == sign {
                    continue;
                }
                let other = place.with(entry, sign);
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

    /// The uncertain entries: those of A, then those of B, by columns.
    fn uncertain_entries(&self) -> Vec<usize> {
        let bounds = self.dA.iter().chain(self.dB.iter());
        bounds.enumerate().filter(|(_, bound)| **bound > 0.0).map(|(entry, _)| entry).collect()
    }

    /// True if some entry is uncertain.
    pub fn is_uncertain(&self) -> bool {
        self.dA.iter().chain(self.dB.iter()).any(|&bound| bound > 0.0)
    }

    /// The same plant with each dead time longer by that of a control that is constant within communication steps, 1/W. Where there is
    /// no dead time, the loop has margins for that.
    pub fn with_later_controls(&self, step: f64) -> Self {
        let later = |&delay: &f64| if delay > 0.0 { delay + LATE * step } else { delay };
        Uncertain { delays: self.delays.iter().map(later).collect(), ..self.clone() }
    }

    /// The same plant with all bounds times a factor.
    pub fn with_bounds_times(&self, factor: f64) -> Self {
        Uncertain { dA: &self.dA * factor, dB: &self.dB * factor, ..self.clone() }
    }

    /// A and B of the plant at a place within the bounds, in the coordinates and units of the file.
    pub fn in_file(&self, place: &Place) -> [DMatrix<f64>; 2] {
        let [A, B] = self.at(place);
        let scaled = |matrix: DMatrix<f64>| {
            DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * self.scales[i] * self.bandwidth)
        };
        [self.in_units(&scaled(A)), scaled(B)]
    }

    /// The plant at a place within the bounds, from −1 to 1 each.
    pub fn at(&self, place: &Place) -> [DMatrix<f64>; 2] {
        [&self.A + self.dA.component_mul(&place.A), &self.B + self.dB.component_mul(&place.B)]
    }
}

/// Where within its bounds each entry is, from −1 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Entries of A.
    pub A: DMatrix<f64>,
    /// Entries of B.
    pub B: DMatrix<f64>,
}

impl Place {
    /// The nominal plant.
    pub fn nominal((n, m): (usize, usize)) -> Self {
        Place { A: DMatrix::zeros(n, n), B: DMatrix::zeros(n, m) }
    }

    /// An entry: of A, then of B, by columns.
    fn at(&self, entry: usize) -> f64 {
        entry.checked_sub(self.A.len()).map_or_else(|| self.A[entry], |entry| self.B[entry])
    }

    /// The same with another value of an entry.
    #[must_use]
    fn with(&self, entry: usize, value: f64) -> Self {
        let mut place = self.clone();
        match entry.checked_sub(place.A.len()) {
            None => place.A[entry] = value,
            Some(entry) => place.B[entry] = value,
        }
        place
    }

    /// Corners of the bounds of a plant.
    pub fn corners(plant: &Uncertain, count: usize, seed: u64) -> Vec<Self> {
        let mut random = Random(seed);
        let mut sign = |bound: f64| if bound > 0.0 { f64::signum(2.0 * random.next() - 1.0) } else { 0.0 };
        (0..count).map(|_| Place { A: plant.dA.map(&mut sign), B: plant.dB.map(&mut sign) }).collect()
    }

    /// Places within the bounds of a plant, about half of them at corners: all corners of few uncertain entries. Always the same
    /// ones for a seed.
    pub fn drawn(plant: &Uncertain, count: usize, seed: u64) -> Vec<Self> {
        let mut random = Random(seed);
        let uncertain = plant.dA.iter().chain(plant.dB.iter()).filter(|bound| **bound > 0.0).count();
        let all = 1_usize.checked_shl(uncertain as u32).filter(|&all| all <= count);
        let place = |value: &mut dyn FnMut() -> f64| {
            let mut within = |bound: f64| if bound > 0.0 { value() } else { 0.0 };
            Place { A: plant.dA.map(&mut within), B: plant.dB.map(within) }
        };
        let corner = |number: usize| {
            let mut entry = 0;
            place(&mut || {
                entry += 1;
                if number >> (entry - 1) & 1 == 1 { 1.0 } else { -1.0 }
            })
        };
        let mut places: Vec<_> = (0..all.unwrap_or(0)).map(corner).collect();
        for k in places.len()..count {
            let at_corner = all.is_none() && k.is_multiple_of(2);
            places.push(place(&mut || {
                let value = 2.0 * random.next() - 1.0;
                if at_corner { f64::signum(value) } else { value }
            }));
        }
        places
    }
}

/// Numbers between 0 and 1 (splitmix64), the same on each machine.
#[derive(Debug)]
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 / u64::MAX as f64
    }
}
