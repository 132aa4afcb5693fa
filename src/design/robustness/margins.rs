//! Stability margins of a loop of output feedback.
#![allow(non_snake_case)] // matrices have the names of the field

use std::f64::consts::PI;

use nalgebra::{Complex, DMatrix};

use super::linear::OutputFeedback;
use super::uncertain::Uncertain;
use crate::design::criteria::sensitivity;
use crate::design::nominal::poles_of;
use crate::design::response::{Response, grid};
use crate::design::zeros;

/// Part of itself by which a gain may change between two points where it crosses: the line between them has an error of an
/// eighth of its square.
const SHORT: f64 = 0.05;
/// The most halvings of an interval of the grid.
const HALVINGS: usize = 12;

/// Margins of a stable loop; frequencies and times in W and 1/W.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// M_s, the largest singular value of (I + G K)⁻¹.
    pub modulus: f64,
    /// Frequency of that; infinite where it is 1.
    pub frequency: f64,
    /// The largest gain below 1 and the smallest above 1 of a channel, the others closed, at which the loop is no longer
    /// stable; none where there is none.
    pub gains: [Option<f64>; 2],
    /// Least phase margin of a channel, the others closed, in rad; none where no gain crosses 1.
    pub phase: Option<f64>,
    /// Delay margin of all inputs together; none where no gain crosses 1.
    pub delay: Option<f64>,
    /// Up to where all outputs follow: the least singular value of G K (I + G K)⁻¹ is above 1/√2.
    pub bandwidth: f64,
    /// The largest singular value of K (I + G K)⁻¹: what noise of the measurement does in the control.
    pub noise: f64,
    /// Invariant zeros of the plant.
    pub zeros: Vec<Complex<f64>>,
    /// Poles of the plant.
    pub poles: Vec<Complex<f64>>,
}

/// The margins of a law with the nominal plant; `None` where numbers are too large.
pub fn margins(plant: &Uncertain, law: &OutputFeedback, closed: &[Complex<f64>]) -> Option<Margins> {
    let Uncertain { A, B, C, delays, .. } = plant;
    let (poles, zeros) = (poles_of(A)?, zeros::invariant(A, B, C)?);
    let has_states = !law.controller.A.is_empty();
    let of_law = if has_states { poles_of(&law.controller.A)? } else { Vec::new() };
    let mut frequencies = grid(&[&poles[..], closed, &of_law].concat(), &zeros, delays);
    frequencies.extend(closed.iter().filter(|pole| pole.im > 0.0).flat_map(|pole| [pole.im, pole.norm()]));
    frequencies.sort_by(f64::total_cmp);
    let G = Response::new(A, B, C, delays);
    let K = Response::new(&law.controller.A, &law.controller.B, &law.controller.C, &[]);
    let direct = law.controller.D.map(Complex::from);
    let mut found = Margins {
        // Beyond all frequencies no plant follows.
        modulus: 1.0,
        frequency: f64::INFINITY,
        gains: [None; 2],
        phase: None,
        delay: None,
        bandwidth: f64::INFINITY,
        noise: 0.0,
        zeros,
        poles,
    };
    let at = |omega: f64| {
        let K = if has_states { K.at(omega) + &direct } else { direct.clone() };
        Point::new(omega, &G.at(omega), &K)
    };
    let mut last: Option<Point> = None;
    for point in frequencies.iter().filter_map(|&omega| at(omega)) {
        match &last {
            Some(last) => found.take_interval(last, &point, &at, HALVINGS),
            None => found.take(&point, None),
        }
        last = Some(point);
    }
    Some(found)
}

/// A loop at a frequency.
struct Point {
    omega: f64,
    modulus: f64,
    /// Gain of the open loop of each channel, the others closed.
    alone: Vec<Complex<f64>>,
    /// Eigenvalues of the open loop.
    together: Vec<Complex<f64>>,
    followed: f64,
    noise: f64,
}

impl Point {
    fn new(omega: f64, G: &DMatrix<Complex<f64>>, K: &DMatrix<Complex<f64>>) -> Option<Self> {
        let gain = G * K;
        if !gain.iter().all(|entry| entry.is_finite()) {
            return None;
        }
        let m = gain.nrows();
        let S = (&gain + DMatrix::identity(m, m)).try_inverse()?;
        let (followed, noise) = (&gain * &S, K * &S);
        if !followed.iter().chain(noise.iter()).all(|entry| entry.is_finite()) {
            return None;
        }
        let together =
            if m == 1 { vec![gain[(0, 0)]] } else { gain.clone().schur().eigenvalues()?.iter().copied().collect() };
        Some(Point {
            omega,
            modulus: sensitivity(&gain),
            alone: S.diagonal().iter().map(|own| own.inv() - 1.0).collect(),
            together,
            followed: followed.singular_values().min(),
            noise: noise.singular_values().max(),
        })
    }

    /// True if a gain crosses the axis or a magnitude of 1 before another point, and changes by more than `SHORT` of itself.
    fn crosses_far(&self, other: &Point) -> bool {
        let far = |before: Complex<f64>, after: Complex<f64>| {
            (after - before).norm() > SHORT * before.norm().min(after.norm())
        };
        let axis = self.alone_with(other).filter(|(before, after)| crosses_axis(*before, *after).is_some());
        let both = self.alone_with(other).chain(self.together_with(other));
        let magnitude = both.filter(|(before, after)| crosses_one(*before, *after).is_some());
        axis.chain(magnitude).any(|(before, after)| far(before, after))
    }

    /// Gains of single channels here and at another point.
    fn alone_with(&self, other: &Point) -> impl Iterator<Item = (Complex<f64>, Complex<f64>)> {
        self.alone.iter().copied().zip(other.alone.iter().copied())
    }

    /// Eigenvalues here, each with the nearest one at another point that is left.
    fn together_with(&self, other: &Point) -> impl Iterator<Item = (Complex<f64>, Complex<f64>)> {
        let mut left = other.together.clone();
        self.together.iter().map(move |&before| {
            let apart = |k: &usize| (left[*k] - before).norm();
            let nearest = (0..left.len()).min_by(|one, other| apart(one).total_cmp(&apart(other)));
            (before, left.swap_remove(nearest.expect("there are as many")))
        })
    }
}

impl Margins {
    /// Takes a point and, where a gain crosses far from the last one, points between: near a lightly damped mode the
    /// straight line between two points of the grid has an error of several percent.
    fn take_interval(&mut self, last: &Point, now: &Point, at: &impl Fn(f64) -> Option<Point>, halvings: usize) {
        let middle = if halvings > 0 && last.crosses_far(now) { at((last.omega * now.omega).sqrt()) } else { None };
        let Some(middle) = middle else { return self.take(now, Some(last)) };
        self.take_interval(last, &middle, at, halvings - 1);
        self.take_interval(&middle, now, at, halvings - 1);
    }

    fn take(&mut self, now: &Point, last: Option<&Point>) {
        if now.modulus > self.modulus {
            (self.modulus, self.frequency) = (now.modulus, now.omega);
        }
        self.noise = self.noise.max(now.noise);
        let Some(last) = last else { return };
        if now.followed < std::f64::consts::FRAC_1_SQRT_2 && self.bandwidth == f64::INFINITY {
            self.bandwidth = now.omega;
        }
        for (before, after) in last.alone_with(now) {
            if let Some(factor) = crosses_axis(before, after) {
                self.take_factor(factor);
            }
            if let Some((phase, _)) = crosses_one(before, after) {
                // To −1 either way.
                let margin = phase.min(2.0 * PI - phase);
                self.phase = Some(self.phase.map_or(margin, |least| least.min(margin)));
            }
        }
        for (before, after) in last.together_with(now) {
            if let Some((phase, part)) = crosses_one(before, after) {
                let delay = phase / (last.omega * (now.omega / last.omega).powf(part));
                self.delay = Some(self.delay.map_or(delay, |least| least.min(delay)));
            }
        }
    }

    /// Notes a factor of the gain that scales it to −1.
    fn take_factor(&mut self, factor: f64) {
        let [less, more] = &mut self.gains;
        if factor < 1.0 {
            *less = Some(less.map_or(factor, |largest| largest.max(factor)));
        } else {
            *more = Some(more.map_or(factor, |least| least.min(factor)));
        }
    }
}

/// The factor that scales a gain to −1 where it crosses the negative real axis.
fn crosses_axis(before: Complex<f64>, after: Complex<f64>) -> Option<f64> {
    if before.im * after.im > 0.0 || before.im == after.im {
        return None;
    }
    let real = before.re + (after.re - before.re) * before.im / (before.im - after.im);
    (real < 0.0).then_some(-1.0 / real)
}

/// The lag that a gain has left until −1, in rad, where its size crosses 1, and which part of the way that is.
fn crosses_one(before: Complex<f64>, after: Complex<f64>) -> Option<(f64, f64)> {
    let (one, other) = (before.norm().ln(), after.norm().ln());
    if one * other > 0.0 || one == other {
        return None;
    }
    let part = one / (one - other);
    // Its argument moves evenly, not the gain itself, which would cut the corner.
    let turned = before.arg() + part * (after / before).arg();
    Some(((turned + PI).rem_euclid(2.0 * PI), part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_of_one_size_are_followed_each() {
        let point = |together: [Complex<f64>; 2]| Point {
            omega: 1.0,
            modulus: 1.0,
            alone: Vec::new(),
            together: together.to_vec(),
            followed: 1.0,
            noise: 1.0,
        };
        let at = |turned: f64| [Complex::from_polar(1.0, 1.0 + turned), Complex::from_polar(1.0, -1.0 + turned)];
        let [one, other] = at(0.1);
        let (before, after) = (point(at(0.0)), point([other, one]));
        let pairs: Vec<_> = before.together_with(&after).collect();
        assert!(pairs.iter().all(|(before, after)| ((after / before).arg() - 0.1).abs() < 1e-12), "{pairs:?}");
    }

    #[test]
    fn only_a_far_crossing_needs_points_between() {
        let gain = |re: f64, im: f64| Complex::new(re, im);
        let point =
            |own| Point { omega: 1.0, modulus: 1.0, alone: vec![own], together: vec![own], followed: 1.0, noise: 1.0 };
        let far = |before, after| point(before).crosses_far(&point(after));
        assert!(far(gain(-0.2, 0.1), gain(-0.1, -0.1)), "the axis");
        assert!(far(gain(0.5, 0.5), gain(1.5, 0.5)), "a magnitude of 1");
        assert!(!far(gain(-0.2, 0.001), gain(-0.2, -0.001)), "near");
        assert!(!far(gain(-0.2, 0.2), gain(-0.1, 0.1)), "no crossing");
    }
}
