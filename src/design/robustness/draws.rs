//! Plants within the bounds that are drawn: always the same ones for a seed.
#![allow(non_snake_case)] // matrices have the names of the field

use std::f64::consts::TAU;

use super::bounds::Bounds;
use super::place::Place;

impl Bounds {
    /// Corners of the bounds, or places on the surface of the region.
    pub fn corners(&self, count: usize, seed: u64) -> Vec<Place> {
        let mut random = Random(seed);
        let mut corner = || {
            self.of_normal(true, || random.normal()).unwrap_or_else(|| {
                let mut sign = |bound: f64| if bound > 0.0 { f64::signum(2.0 * random.next() - 1.0) } else { 0.0 };
                Place { A: self.A.map(&mut sign), B: self.B.map(&mut sign) }
            })
        };
        (0..count).map(|_| corner()).collect()
    }

    /// Places within the bounds, about half of them at corners: all corners of few uncertain entries. Those of a region are at its
    /// surface and by the density that the records leave, by turns.
    pub fn drawn(&self, count: usize, seed: u64) -> Vec<Place> {
        let mut random = Random(seed);
        let mut together = |number: usize| self.of_normal(number.is_multiple_of(2), || random.normal());
        if together(0).is_some() {
            return (0..count).filter_map(together).collect();
        }
        self.drawn_apart(count, random)
    }

    fn drawn_apart(&self, count: usize, mut random: Random) -> Vec<Place> {
        let all = 1_usize.checked_shl(self.entries().len() as u32).filter(|&all| all <= count);
        let place = |value: &mut dyn FnMut() -> f64| {
            let mut within = |bound: f64| if bound > 0.0 { value() } else { 0.0 };
            Place { A: self.A.map(&mut within), B: self.B.map(within) }
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

    /// A normal deviate (Box and Muller).
    fn normal(&mut self) -> f64 {
        let (one, other) = (1.0 - self.next(), self.next());
        // A uniform one of 0 has no logarithm.
        (-2.0 * one.max(f64::MIN_POSITIVE).ln()).sqrt() * (TAU * other).cos()
    }
}
