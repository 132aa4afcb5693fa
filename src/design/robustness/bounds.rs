//! Bounds of plants about the nominal one: of each entry of A and B by itself, or the region that records leave.
#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu_identification::chi_squared;
use nalgebra::{DMatrix, DVector};

use super::place::Place;
use crate::nominal::Covariance;

/// Eigenvalues of a correlation below this are rounding.
const LEAST: f64 = 1e-12;
/// Step of an ascent within a region, in parts of its radius.
const ASIDE: f64 = 0.5;

/// Bounds of the entries of A and B.
#[derive(Debug, Clone)]
pub struct Bounds {
    /// n × n.
    pub A: DMatrix<f64>,
    /// n × m.
    pub B: DMatrix<f64>,
    /// Region in which they move together; `None` where each is within its bound by itself.
    region: Option<Ellipsoid>,
}

/// An ellipsoid: places are in parts of the bounds of entries.
#[derive(Debug, Clone)]
struct Ellipsoid {
    /// The entries: those of A by columns, then those of B.
    entries: Vec<usize>,
    /// From the unit sphere to where single bounds are reached: rows of length 1.
    root: DMatrix<f64>,
    /// And back.
    inverse: DMatrix<f64>,
    /// The region is larger than what single bounds need.
    radius: f64,
    /// Its radius in standard deviations.
    deviations: f64,
}

impl Bounds {
    /// Bounds in parts of each entry: rows of A of 0 and ±1 that no input enters are kinematics, which are certain.
    pub fn by_part(A: &DMatrix<f64>, B: &DMatrix<f64>, part: f64) -> Self {
        let is_kinematic = |i: usize| {
            A.row(i).iter().all(|entry| [-1.0, 0.0, 1.0].contains(entry)) && B.row(i).iter().all(|entry| *entry == 0.0)
        };
        let mut dA = A.abs() * part;
        (0..A.nrows()).filter(|&i| is_kinematic(i)).for_each(|i| dA.row_mut(i).fill(0.0));
        Bounds { A: dA, B: B.abs() * part, region: None }
    }

    /// Bounds of each entry by itself.
    pub fn of_elements(A: DMatrix<f64>, B: DMatrix<f64>) -> Self {
        Bounds { A, B, region: None }
    }

    /// Nothing is uncertain.
    pub fn none((n, m): (usize, usize)) -> Self {
        Bounds::of_elements(DMatrix::zeros(n, n), DMatrix::zeros(n, m))
    }

    /// Bounds of entries that records leave uncertain, which hold for all of them together with the confidence level, and the region
    /// of this level; both times the margin.
    pub fn of_records(covariance: &Covariance, level: f64, margin: f64, (n, m): (usize, usize)) -> Self {
        let Covariance { entries, matrix } = covariance;
        let errors = matrix.diagonal().map(f64::sqrt);
        let p = entries.len();
        let correlation = DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] / (errors[i] * errors[j]));
        let eigen = correlation.symmetric_eigen();
        let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
        let root = &eigen.eigenvectors * DMatrix::from_diagonal(&roots);
        let back = roots.map(|root| if root * root > LEAST { root.recip() } else { 0.0 });
        let inverse = DMatrix::from_diagonal(&back) * eigen.eigenvectors.transpose();
        let z = deviations(level, (n, m));
        let mut bounds = Bounds::none((n, m));
        for (&entry, error) in entries.iter().zip(&errors) {
            *bounds.entry_mut(entry) = z * margin * error;
        }
        let deviations = chi_squared(level, p.max(1)).sqrt();
        let radius = deviations / z;
        bounds.region = (p > 0).then_some(Ellipsoid { entries: entries.clone(), root, inverse, radius, deviations });
        bounds
    }

    fn entry_mut(&mut self, entry: usize) -> &mut f64 {
        match entry.checked_sub(self.A.len()) {
            None => &mut self.A[entry],
            Some(entry) => &mut self.B[entry],
        }
    }

    /// The bound of an entry.
    fn entry(&self, entry: usize) -> f64 {
        entry.checked_sub(self.A.len()).map_or_else(|| self.A[entry], |entry| self.B[entry])
    }

    /// The uncertain entries: those of A, then those of B, by columns.
    pub fn entries(&self) -> Vec<usize> {
        let bounds = self.A.iter().chain(self.B.iter());
        bounds.enumerate().filter(|(_, bound)| **bound > 0.0).map(|(entry, _)| entry).collect()
    }

    /// All of them times a factor.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        self.with(&self.A * factor, &self.B * factor)
    }

    /// The same in other coordinates, whose axes are those of these.
    #[must_use]
    pub fn with(&self, A: DMatrix<f64>, B: DMatrix<f64>) -> Self {
        Bounds { A, B, region: self.region.clone() }
    }

    /// Bounds of the entries of L (ΔA − ΔB K).
    pub fn of_feedback(&self, L: &DMatrix<f64>, K: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(region) = &self.region else { return L.abs() * (&self.A + &self.B * K.abs()) };
        let n = self.A.nrows();
        DMatrix::from_fn(L.nrows(), n, |i, j| {
            region.bound(|entry| {
                let factor = match entry.checked_sub(n * n) {
                    None if entry / n == j => L[(i, entry % n)],
                    None => 0.0,
                    Some(entry) => -L[(i, entry % n)] * K[(entry / n, j)],
                };
                factor * self.entry(entry)
            })
        })
    }

    /// Bounds of the entries of L ΔB.
    pub fn of_inputs(&self, L: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(region) = &self.region else { return L.abs() * &self.B };
        let (n, m) = self.B.shape();
        DMatrix::from_fn(L.nrows(), m, |i, j| {
            region.bound(|entry| match entry.checked_sub(n * n) {
                Some(of_B) if of_B / n == j => L[(i, of_B % n)] * self.entry(entry),
                _ => 0.0,
            })
        })
    }

    /// The place to which a function rises most, by its slopes along the entries.
    pub fn farthest(&self, A: &DMatrix<f64>, B: &DMatrix<f64>) -> Place {
        let Some(region) = &self.region else {
            let sign = |slope: f64| if slope < 0.0 { -1.0 } else { 1.0 };
            return Place { A: A.map(sign), B: B.map(sign) };
        };
        let slope = |entry: usize| match entry.checked_sub(A.len()) {
            None => A[entry],
            Some(entry) => B[entry],
        };
        let slopes = region.entries.iter().map(|&entry| slope(entry) * self.entry(entry));
        let direction = region.root.tr_mul(&DVector::from_iterator(region.entries.len(), slopes));
        self.on_surface(region, direction)
    }

    /// True if a place is at a corner of the bounds, or on the surface of the region.
    pub fn is_extreme(&self, place: &Place) -> bool {
        match &self.region {
            None => place.A.iter().chain(place.B.iter()).all(|entry| entry.fract() == 0.0),
            Some(region) => region.back(place).norm() > 0.999,
        }
    }

    /// A neighbour of a place that is extreme: with the other sign of each entry in turn, or on the surface of the region towards each
    /// of its axes. `number` counts them, from 0 to twice the number of entries.
    pub fn neighbour(&self, place: &Place, number: usize) -> Option<Place> {
        let sign = if number.is_multiple_of(2) { -1.0 } else { 1.0 };
        match &self.region {
            None => {
                let entry = *self.entries().get(number / 2)?;
                (place.at(entry) != sign).then(|| place.clone().with(entry, sign))
            }
            Some(region) => {
                let mut at = region.back(place);
                *at.get_mut(number / 2)? += sign * ASIDE;
                Some(self.on_surface(region, at))
            }
        }
    }

    /// A place of the region, at its surface or by the density that records leave, from normal deviates; `None` where entries are
    /// independent.
    pub fn of_normal(&self, on_surface: bool, normal: impl FnMut() -> f64) -> Option<Place> {
        let region = self.region.as_ref()?;
        let along =
            DVector::from_iterator(region.entries.len(), std::iter::repeat_with(normal).take(region.entries.len()));
        Some(if on_surface {
            self.on_surface(region, along)
        } else {
            region.place(&(along / region.deviations), self.B.shape())
        })
    }

    /// Numbers by which a place is given, each from −1 to 1.
    pub fn dimensions(&self) -> usize {
        self.region.as_ref().map_or_else(|| self.entries().len(), |region| region.entries.len())
    }

    /// The place of such numbers; beyond a region, what of its surface is nearest to it.
    pub fn place(&self, numbers: &[f64]) -> Place {
        let Some(region) = &self.region else {
            let entries = self.entries();
            let nominal = Place::nominal(self.B.shape());
            return entries.into_iter().zip(numbers).fold(nominal, |place, (entry, part)| place.with(entry, *part));
        };
        let point = DVector::from_row_slice(numbers);
        if point.norm() > 1.0 { self.on_surface(region, point) } else { region.place(&point, self.B.shape()) }
    }

    fn on_surface(&self, region: &Ellipsoid, direction: DVector<f64>) -> Place {
        let length = direction.norm();
        region.place(&if length > 0.0 { direction / length } else { direction }, self.B.shape())
    }
}

impl Ellipsoid {
    /// The largest sum of the entries in parts of their bounds, each times a weight.
    fn bound(&self, weight: impl Fn(usize) -> f64) -> f64 {
        let weights = DVector::from_iterator(self.entries.len(), self.entries.iter().map(|&entry| weight(entry)));
        self.root.tr_mul(&weights).norm()
    }

    /// The place of a point of the unit sphere.
    fn place(&self, point: &DVector<f64>, size: (usize, usize)) -> Place {
        let parts = &self.root * point * self.radius;
        self.entries.iter().zip(&parts).fold(Place::nominal(size), |place, (&entry, part)| place.with(entry, *part))
    }

    fn back(&self, place: &Place) -> DVector<f64> {
        let parts = DVector::from_iterator(self.entries.len(), self.entries.iter().map(|&entry| place.at(entry)));
        &self.inverse * parts / self.radius
    }
}

/// Standard deviations within which all of n² + n m + m quantities lie together with this confidence (Bonferroni): the entries of
/// A and B, and a disturbance of each input.
pub fn deviations(level: f64, (n, m): (usize, usize)) -> f64 {
    let count = (n * (n + m) + m) as f64;
    chi_squared(1.0 - (1.0 - level) / count, 1).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two entries of A and one of B, with their covariance.
    fn covariance() -> Covariance {
        let matrix = DMatrix::from_row_slice(3, 3, &[0.04, 0.018, -0.002, 0.018, 0.01, 0.0005, -0.002, 0.0005, 0.09]);
        Covariance { entries: vec![0, 3, 5], matrix }
    }

    #[test]
    fn bounds_of_what_follows_from_the_entries_are_reached_within_the_region_and_not_exceeded() {
        let bounds = Bounds::of_records(&covariance(), 0.99, 2.0, (2, 1));
        let z = deviations(0.99, (2, 1));
        assert!((z - 3.188).abs() < 1e-3, "{z}");
        assert!((bounds.A[(0, 0)] - 2.0 * z * 0.2).abs() < 1e-12 && (bounds.B[(1, 0)] - 2.0 * z * 0.3).abs() < 1e-12);
        let (L, K) = (DMatrix::from_row_slice(1, 2, &[0.5, -2.0]), DMatrix::from_row_slice(1, 2, &[3.0, -4.0]));
        let single = bounds.of_feedback(&L, &K);
        // By the formula for linear combinations: z √(mᵀ Σ m), of L (ΔA − ΔB K).
        let combination = [[0.5, 0.0, -2.0 * -3.0], [0.0, -2.0, -2.0 * 4.0]];
        for (j, weights) in combination.into_iter().enumerate() {
            let weights = DVector::from_row_slice(&weights);
            let expected = 2.0 * z * (weights.transpose() * covariance().matrix * weights)[(0, 0)].sqrt();
            assert!((single[(0, j)] - expected).abs() < 1e-9 * expected, "{j}: {} for {expected}", single[(0, j)]);
        }
        let expected = 2.0 * z * 2.0 * 0.3;
        assert!((bounds.of_inputs(&L)[(0, 0)] - expected).abs() < 1e-9 * expected);
    }

    #[test]
    fn places_of_the_region_have_the_distance_of_its_level() {
        let bounds = Bounds::of_records(&covariance(), 0.95, 1.0, (2, 1));
        let inverse = covariance().matrix.try_inverse().unwrap();
        let squared = |place: &Place| {
            let change = covariance().entries.into_iter().map(|entry| place.at(entry) * bounds.entry(entry));
            let change = DVector::from_iterator(3, change);
            (change.transpose() * &inverse * &change)[(0, 0)]
        };
        let radius = chi_squared(0.95, 3);
        let mut deviates = [0.3, -1.2, 0.7].into_iter().cycle();
        let place = bounds.of_normal(true, || deviates.next().unwrap()).unwrap();
        assert!((squared(&place) - radius).abs() < 1e-9 && bounds.is_extreme(&place));
        let within = bounds.of_normal(false, || deviates.next().unwrap()).unwrap();
        assert!((squared(&within) - (0.09 + 1.44 + 0.49)).abs() < 1e-9 && !bounds.is_extreme(&within));
        for number in 0..6 {
            let other = bounds.neighbour(&place, number).unwrap();
            assert!((squared(&other) - radius).abs() < 1e-9 && other != place);
        }
        assert_eq!(bounds.neighbour(&place, 6), None);
        // Along a slope no place of the surface is farther.
        let slope = [DMatrix::from_row_slice(2, 2, &[1.0, 5.0, 5.0, -2.0]), DMatrix::from_row_slice(2, 1, &[5.0, 0.5])];
        let rise = |place: &Place| {
            let along = |slope: &DMatrix<f64>, bounds: &DMatrix<f64>, place: &DMatrix<f64>| {
                slope.component_mul(bounds).dot(place)
            };
            along(&slope[0], &bounds.A, &place.A) + along(&slope[1], &bounds.B, &place.B)
        };
        let farthest = rise(&bounds.farthest(&slope[0], &slope[1]));
        for number in 0..6 {
            let other = bounds.neighbour(&bounds.farthest(&slope[0], &slope[1]), number).unwrap();
            assert!(rise(&other) < farthest, "{number}");
        }
    }
}
