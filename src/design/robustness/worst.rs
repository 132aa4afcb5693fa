//! The worst of many plants.
#![allow(non_snake_case)] // matrices have the names of the field

use super::linear::LinearLaw;
use super::region::Region;
use super::respond::Course;
use super::uncertain::{Place, Uncertain};

/// Steps of all references.
#[derive(Debug, Clone, PartialEq)]
pub struct Stepped {
    /// From 10 % to 90 % of the step, the slowest, in 1/W.
    pub rise: f64,
    /// How far an output goes beyond its reference, in parts of the step.
    pub overshoot: f64,
    /// How far it goes the wrong way first, likewise.
    pub undershoot: f64,
    /// When all outputs stay within 2 % of the step about their ends, in 1/W.
    pub settling: f64,
    /// How far they end from the reference, in parts of the step.
    pub off: f64,
    /// The lowest and the highest value of each control, for steps of 1.
    pub control: Vec<[f64; 2]>,
}

impl Stepped {
    /// The steps of a plant in a loop; `None` where it isn't stable.
    pub fn new(law: &impl LinearLaw, plant: &Uncertain, place: &Place) -> Option<Self> {
        let parts = law.parts();
        let all = parts.delayed(&plant.delays).steps(&plant.at(place), &plant.C, &parts)?;
        let m = plant.B.ncols();
        let mut stepped = Stepped::none(m);
        for (i, courses) in all.iter().enumerate() {
            stepped.take(i, courses);
        }
        Some(stepped)
    }

    fn none(m: usize) -> Self {
        let control = vec![[0.0; 2]; m];
        Stepped { rise: 0.0, overshoot: 0.0, undershoot: 0.0, settling: 0.0, off: 0.0, control }
    }

    /// A step of one reference.
    fn take(&mut self, i: usize, courses: &[Course]) {
        let outputs = courses.len() - self.control.len();
        let Course { end, range: [lowest, highest], settling, rise } = courses[i];
        self.rise = self.rise.max(rise);
        self.overshoot = self.overshoot.max(highest - 1.0);
        self.undershoot = self.undershoot.max(-lowest);
        self.settling =
            courses[..outputs].iter().map(|course| course.settling).fold(self.settling.max(settling), f64::max);
        self.off = self.off.max((end - 1.0).abs());
        for ([low, high], course) in self.control.iter_mut().zip(&courses[outputs..]) {
            (*low, *high) = (low.min(course.range[0]), high.max(course.range[1]));
        }
    }
}

/// The worst of the plants of a region, in each respect by itself; `None` where one isn't stable.
pub fn worst(law: &impl LinearLaw, plant: &Uncertain, region: &Region) -> Option<Stepped> {
    let none = Stepped::none(plant.B.ncols());
    let parts = law.parts();
    let delayed = parts.delayed(&plant.delays);
    region.places().iter().try_fold(none, |mut worst, place| {
        let all = delayed.steps(&plant.at(place), &plant.C, &parts)?;
        all.iter().enumerate().for_each(|(i, courses)| worst.take(i, courses));
        Some(worst)
    })
}
