//! Steps of the references, and the worst of many plants.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::linear::LinearLaw;
use super::place::Place;
use super::respond::{Course, SETTLED};
use super::uncertain::Uncertain;

/// Band of the worst plants, in parts of that of the nominal one: sampling makes a ripple of 2 % one of 2.1 %.
const NARROWER: f64 = 0.9;

/// Steps of all references, the worst in each respect by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Stepped {
    /// From 10 % to 90 % of the step, the slowest, in 1/W.
    pub rise: f64,
    /// Overshoot of an output beyond its reference, in parts of the step.
    pub overshoot: f64,
    /// Undershoot in the wrong direction at first, likewise.
    pub undershoot: f64,
    /// Time from which all outputs stay within a band about their ends, in 1/W.
    pub settling: f64,
    /// That band, in parts of the step.
    pub band: f64,
    /// Final deviation from the reference, in parts of the step.
    pub off: f64,
    /// The lowest and the highest value of each control.
    pub control: Vec<[f64; 2]>,
}

impl Stepped {
    /// The steps of references of these sizes with the nominal plant; `None` where the loop isn't stable.
    pub fn nominal(law: &impl LinearLaw, plant: &Uncertain, sizes: &[f64]) -> Option<Self> {
        Self::each(law, plant, &[Place::nominal(plant.size())], sizes, SETTLED, |_| ())
    }

    /// The worst of plants at these places, and in each [respect](Self::respects) the place that is it: of few uncertain entries
    /// one that no other sign of an entry makes worse. `None` where a plant at one of the places isn't stable.
    pub fn worst(
        law: &impl LinearLaw,
        plant: &Uncertain,
        places: &[Place],
        sizes: &[f64],
    ) -> Option<(Self, Vec<Place>)> {
        let band = NARROWER * SETTLED;
        let mut found = vec![(f64::NEG_INFINITY, 0); 2 + 2 * plant.B.ncols()];
        let mut number = 0;
        let mut worst = Self::each(law, plant, places, sizes, band, |one| {
            for (worst, value) in found.iter_mut().zip(one.respects()) {
                if value > worst.0 {
                    *worst = (value, number);
                }
            }
            number += 1;
        })?;
        let mut found: Vec<_> = found.into_iter().map(|(value, number)| (value, places[number].clone())).collect();
        for respect in 0..found.len() {
            let (value, place) = found[respect].clone();
            plant.worse(place, value, |other| {
                let stepped = Self::each(law, plant, std::slice::from_ref(other), sizes, band, |_| ())?;
                worst = worst.clone().or_worse(&stepped);
                // What is worse in one respect may be the worst in another.
                for (worst, value) in found.iter_mut().zip(stepped.respects()) {
                    if value > worst.0 {
                        *worst = (value, other.clone());
                    }
                }
                stepped.respects().nth(respect)
            });
        }
        Some((worst, found.into_iter().map(|(_, place)| place).collect()))
    }

    /// Settling time, overshoot, and how far each control goes up and down.
    pub fn respects(&self) -> impl Iterator<Item = f64> {
        let control = self.control.iter().flat_map(|[low, high]| [*high, -low]);
        [self.settling, self.overshoot].into_iter().chain(control)
    }

    /// The worst of the steps with each of these plants, which are looked at one by one too.
    fn each(
        law: &impl LinearLaw,
        plant: &Uncertain,
        places: &[Place],
        sizes: &[f64],
        band: f64,
        mut look: impl FnMut(&Self),
    ) -> Option<Self> {
        let parts = law.parts().for_references(sizes);
        let delayed = parts.delayed(&plant.delays);
        // Outputs in parts of their references.
        let C = DMatrix::from_fn(plant.C.nrows(), plant.C.ncols(), |i, j| plant.C[(i, j)] / sizes[i]);
        places.iter().try_fold(Self::at_rest(plant.B.ncols(), band), |worst, place| {
            let all = delayed.steps(&plant.at(place), &C, &parts, band)?;
            let mut one = Self::at_rest(plant.B.ncols(), band);
            all.iter().enumerate().for_each(|(i, courses)| one.take(i, courses));
            look(&one);
            Some(worst.or_worse(&one))
        })
    }

    /// Nothing moves.
    fn at_rest(controls: usize, band: f64) -> Self {
        let control = vec![[0.0; 2]; controls];
        Stepped { rise: 0.0, overshoot: 0.0, undershoot: 0.0, settling: 0.0, band, off: 0.0, control }
    }

    /// The worse of both in each respect.
    fn or_worse(mut self, other: &Self) -> Self {
        for (mine, theirs) in [
            (&mut self.rise, other.rise),
            (&mut self.overshoot, other.overshoot),
            (&mut self.undershoot, other.undershoot),
            (&mut self.settling, other.settling),
            (&mut self.off, other.off),
        ] {
            *mine = mine.max(theirs);
        }
        for ([low, high], other) in self.control.iter_mut().zip(&other.control) {
            (*low, *high) = (low.min(other[0]), high.max(other[1]));
        }
        self
    }

    /// A step of one reference.
    fn take(&mut self, i: usize, courses: &[Course]) {
        let (outputs, controls) = courses.split_at(courses.len() - self.control.len());
        let Course { end, range: [lowest, highest], rise, .. } = outputs[i];
        self.rise = self.rise.max(rise);
        self.overshoot = self.overshoot.max(highest - 1.0);
        self.undershoot = self.undershoot.max(-lowest);
        self.settling = outputs.iter().map(|course| course.settling).fold(self.settling, f64::max);
        self.off = self.off.max((end - 1.0).abs());
        for ([low, high], course) in self.control.iter_mut().zip(controls) {
            (*low, *high) = (low.min(course.range[0]), high.max(course.range[1]));
        }
    }
}
