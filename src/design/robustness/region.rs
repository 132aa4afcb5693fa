//! Plants within the bounds as they stand: stable with a law or not, with time running on and sampled.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix, DVector};

use super::linear::{LinearLaw, Parts};
use super::place::Place;
use super::uncertain::Uncertain;
use crate::design::nominal::poles_of;

/// Corners that the ascent begins with, in addition to the nominal plant.
const STARTS: usize = 5;
/// Steps of the ascent.
const ROUNDS: usize = 5;
/// With many states it goes from the nominal one only, once, by so many poles.
const FEW_POLES: usize = 4;
/// Number of states above which fewer plants are drawn.
const FEW_STATES: usize = 8;
const FEWEST: usize = 8;
/// The largest bounds are found to this part of them, with so many halvings at most.
const ACCURACY: f64 = 0.01;
const HALVINGS: usize = 14;
/// The largest bounds, in parts of an entry, that are looked for.
pub const LARGEST: f64 = 0.9;

/// The plants that are tried, the nominal one first.
#[derive(Debug)]
pub struct Region {
    places: Vec<Place>,
    drawn: usize,
}

impl Region {
    /// Draws so many plants, always the same ones for a seed, and the corners to which the poles of this controller's
    /// loop move most.
    pub fn new(plant: &Uncertain, law: &impl LinearLaw, (plants, seed): (usize, u64)) -> Self {
        let mut places = vec![Place::nominal(plant.size())];
        let mut drawn = 0;
        if plant.is_uncertain() {
            let work = plant.size().0.div_ceil(FEW_STATES).pow(2);
            places.extend(plant.bounds.drawn((plants / work).max(FEWEST.min(plants)), seed));
            drawn = places.len() - 1;
            let worst = ascent(plant, law, &places);
            // What is most likely to be unstable comes first.
            places.splice(1..1, worst);
        }
        Region { places, drawn }
    }

    /// Number of the plants that were drawn by their density, where there is one.
    pub fn likely(&self) -> usize {
        self.drawn / 2
    }

    /// The plants.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// True if the loop of each plant is stable, with time running on and sampled with this step, 1/W.
    pub fn is_stable(&self, plant: &Uncertain, law: &impl LinearLaw, H: f64) -> bool {
        let parts = law.parts().delayed(&plant.delays);
        self.places.iter().all(|place| is_stable(plant, law, &parts, place, H))
    }

    /// The share of the bounds, up to `most`, within which all are stable, and those to which the poles move most within it: the
    /// worst directions of large bounds aren't those of small ones.
    pub fn largest_share(&self, plant: &Uncertain, law: &impl LinearLaw, H: f64, most: f64) -> f64 {
        let parts = law.parts().delayed(&plant.delays);
        largest(most, |share| {
            let scaled = plant.with_bounds_times(share);
            let are_stable = |places: &[Place]| places.iter().all(|place| is_stable(&scaled, law, &parts, place, H));
            are_stable(&self.places) && (share == 1.0 || are_stable(&ascent(&scaled, law, &self.places)))
        })
    }
}

/// The largest share for which something holds that holds for smaller ones, to a percent of it.
pub fn largest(most: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(most) {
        return most;
    }
    // The whole first: a share is below 1 only where something of the whole doesn't hold.
    let (mut low, mut high) = if most > 1.0 && holds(1.0) { (1.0, most) } else { (0.0, most.min(1.0)) };
    for _ in 0..HALVINGS {
        if high - low <= ACCURACY * high {
            break;
        }
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

fn is_stable(plant: &Uncertain, law: &impl LinearLaw, parts: &Parts, place: &Place, H: f64) -> bool {
    let [A_t, B_t] = plant.at(place);
    let runs_on = || slowest(&parts.closed(&A_t, &B_t)).is_some_and(|real| real < 0.0);
    let sampled = || {
        let radius = |step: DMatrix<f64>| Some(poles_of(&step)?.iter().map(|pole| pole.norm()).fold(0.0, f64::max));
        law.sampled(plant, &A_t, &B_t, H).and_then(radius).is_some_and(|radius| radius < 1.0)
    };
    runs_on() && sampled()
}

/// The largest real part of a pole.
fn slowest(closed: &DMatrix<f64>) -> Option<f64> {
    poles_of(closed)?.iter().map(|pole| pole.re).reduce(f64::max)
}

/// Corners of the bounds to which the poles of the loop move fastest to the right.
fn ascent(plant: &Uncertain, law: &impl LinearLaw, places: &[Place]) -> Vec<Place> {
    let parts = law.parts().delayed(&plant.delays);
    let loop_of = |place: &Place| {
        let [A_t, B_t] = plant.at(place);
        parts.closed(&A_t, &B_t)
    };
    let is_large = plant.size().0 > FEW_STATES;
    let (starts, rounds) = if is_large { (0, 1) } else { (STARTS, ROUNDS) };
    let starts =
        places[..1].iter().chain(places[1..].iter().filter(|place| plant.bounds.is_extreme(place)).take(starts));
    starts
        .map(|start| {
            let mut here = start.clone();
            let mut worst = (f64::NEG_INFINITY, start.clone());
            for _ in 0..rounds {
                let closed = loop_of(&here);
                let found = steepest(plant, &closed, &parts, if is_large { FEW_POLES } else { usize::MAX })
                    .into_iter()
                    .filter_map(|place| slowest(&loop_of(&place)).map(|real| (real, place)));
                let Some(next) = found.max_by(|one, other| one.0.total_cmp(&other.0)) else { break };
                if next.0 <= worst.0 {
                    break;
                }
                here = next.1.clone();
                worst = next;
            }
            worst.1
        })
        .collect()
}

/// For each of the rightmost poles, the place to which it moves fastest to the right: ∂λ = wᴴ ∂M v/(wᴴ v).
fn steepest(plant: &Uncertain, closed: &DMatrix<f64>, parts: &Parts, count: usize) -> Vec<Place> {
    let Some(mut poles) = poles_of(closed) else { return Vec::new() };
    poles.retain(|pole| pole.im >= 0.0);
    poles.sort_by(|one, other| other.re.total_cmp(&one.re));
    poles.truncate(count);
    let (n, complex) = (parts.entry.ncols(), closed.map(Complex::from));
    let (entry, control) = (parts.entry.map(Complex::from), parts.control.map(Complex::from));
    let corner = |pole: &Complex<f64>| {
        let v = eigenvector(&complex, *pole)?;
        let w = eigenvector(&complex.adjoint(), pole.conj())?;
        let turn = w.dotc(&v).inv();
        let rate = (w.adjoint() * &entry).map(|entry| entry * turn);
        let (of_x, of_u) = (v.rows(0, n).into_owned(), &control * &v);
        let of_A = DMatrix::from_fn(n, n, |i, j| (rate[i] * of_x[j]).re);
        let of_B = DMatrix::from_fn(n, of_u.len(), |i, j| (rate[i] * of_u[j]).re);
        Some(plant.bounds.farthest(&of_A, &of_B))
    };
    poles.iter().filter_map(corner).collect()
}

/// The eigenvector by two steps of inverse iteration from an approximate eigenvalue.
fn eigenvector(matrix: &DMatrix<Complex<f64>>, value: Complex<f64>) -> Option<DVector<Complex<f64>>> {
    let n = matrix.nrows();
    let near = value * (1.0 + 1e-10) + Complex::new(1e-12, 1e-12) * matrix.camax();
    let lu = (matrix - DMatrix::identity(n, n) * near).lu();
    let start = DVector::from_fn(n, |i, _| Complex::new(1.0 + 0.1 * i as f64, 0.3));
    let once = lu.solve(&start)?;
    let twice = lu.solve(&once.unscale(once.norm()))?;
    let norm = twice.norm();
    norm.is_finite().then(|| twice.unscale(norm))
}
