//! Steps of the references, and the worst of many plants.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::linear::LinearLaw;
use super::respond::{Course, SETTLED};
use super::uncertain::{Place, Uncertain};

/// Band of the worst plants, in parts of that of the nominal one: sampling makes a ripple of 2 % one of 2.1 %.
const NARROWER: f64 = 0.9;

/// Steps of all references, the worst in each respect by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Stepped {
    /// From 10 % to 90 % of the step, the slowest, in 1/W.
    pub rise: f64,
    /// How far an output goes beyond its reference, in parts of the step.
    pub overshoot: f64,
    /// How far it goes the wrong way first, likewise.
    pub undershoot: f64,
    /// When all outputs stay within 2 % of their references about their ends, in 1/W.
    pub settling: f64,
    /// How far they end from the reference, in parts of the step.
    pub off: f64,
    /// The lowest and the highest value of each control.
    pub control: Vec<[f64; 2]>,
}

impl Stepped {
    /// The steps of references of these sizes with the nominal plant; `None` where the loop isn't stable.
    pub fn nominal(law: &impl LinearLaw, plant: &Uncertain, sizes: &[f64]) -> Option<Self> {
        Self::of(law, plant, &[Place::nominal(plant.size())], sizes, SETTLED)
    }

    /// The worst of plants at these places; `None` where one isn't stable.
    pub fn worst(law: &impl LinearLaw, plant: &Uncertain, places: &[Place], sizes: &[f64]) -> Option<Self> {
        Self::of(law, plant, places, sizes, NARROWER * SETTLED)
    }

    fn of(law: &impl LinearLaw, plant: &Uncertain, places: &[Place], sizes: &[f64], band: f64) -> Option<Self> {
        let control = vec![[0.0; 2]; plant.B.ncols()];
        let none = Stepped { rise: 0.0, overshoot: 0.0, undershoot: 0.0, settling: 0.0, off: 0.0, control };
        let parts = law.parts().for_references(sizes);
        let delayed = parts.delayed(&plant.delays);
        // Outputs in parts of their references.
        let C = DMatrix::from_fn(plant.C.nrows(), plant.C.ncols(), |i, j| plant.C[(i, j)] / sizes[i]);
        places.iter().try_fold(none, |mut worst, place| {
            let all = delayed.steps(&plant.at(place), &C, &parts, band)?;
            all.iter().enumerate().for_each(|(i, courses)| worst.take(i, courses));
            Some(worst)
        })
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
