//! Impulses and steps of linear systems whose modes may be many decades apart.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use crate::design::nominal::poles_of;
use crate::design::step::exponential;

/// Steps of the fastest mode that is left, in 1/|p|: for an integral, and for extremes.
const FINE: f64 = 0.04;
const COARSE: f64 = 0.1;
/// For extremes, after so many steps of such a size: what still oscillates then had its extremes, and decays.
const FIRST: f64 = 2_000.0;
const LATE: f64 = 0.9;
/// A mode is over when it has decayed by e to this power.
const OVER: f64 = 18.0;
/// Steps at most until the next mode is over.
const MOST_STEPS: f64 = 20_000.0;
/// Modes below this part of the fastest are at rest.
const NEGLIGIBLE: f64 = 1e-12;

/// Follows the state matrix X' = A X from X(0) until all modes are over, in such steps of the fastest
/// mode that is left, in 1/|p|, the first ones and later ones: each new X with the time since the one before. `None` where A isn't
/// stable, or its numbers are too large.
pub fn follow(
    A: &DMatrix<f64>,
    start: DMatrix<f64>,
    [step, late]: [f64; 2],
    mut look: impl FnMut(f64, &DMatrix<f64>),
) -> Option<()> {
    let mut poles = poles_of(A)?;
    let largest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    if poles.iter().any(|pole| pole.re >= -NEGLIGIBLE * largest) {
        return None;
    }
    // The next mode to be over comes last.
    poles.sort_by(|one, other| other.re.total_cmp(&one.re));
    let (mut state, mut time) = (start, 0.0);
    while let Some(pole) = poles.pop() {
        let until = OVER / -pole.re;
        let fastest = poles.iter().map(|pole| pole.norm()).fold(pole.norm(), f64::max);
        if until <= time {
            continue;
        }
        let all = ((until - time) * fastest / step).ceil();
        let first = if step < late { all.min(FIRST) } else { all };
        let rest = ((all - first) * step / late).ceil();
        // The steps of both parts, of which each is even.
        let part = (until - time) * first / all;
        for (duration, steps) in [(part, first.min(MOST_STEPS)), (until - time - part, rest.min(MOST_STEPS))] {
            if steps < 1.0 {
                continue;
            }
            let h = duration / steps;
            let over_h = exponential(A * h)?;
            for _ in 0..steps as usize {
                state = &over_h * &state;
                look(h, &state);
            }
        }
        time = until;
    }
    Some(())
}

/// ∫|C e^(A t) B| dt, entry by entry. `None` where A isn't stable.
pub fn absolute_integral(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut last = (C * B).abs();
    let mut integral = DMatrix::zeros(last.nrows(), last.ncols());
    follow(A, B.clone(), [FINE; 2], |h, state| {
        let now = (C * state).abs();
        integral += (&last + &now) * (0.5 * h);
        last.copy_from(&now);
    })?;
    Some(integral)
}

/// Course of a signal as an input steps to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Final value.
    pub end: f64,
    /// The lowest and the highest value.
    pub range: [f64; 2],
    /// Time from which it stays within a band about its end, in 1/W.
    pub settling: f64,
    /// From 10 % to 90 % of its end, in 1/W.
    pub rise: f64,
}

/// A signal of size 1 has settled within this of its end.
pub const SETTLED: f64 = 0.02;

/// The signals C x + d of a step of one input of x' = A x + b, from rest, settled within a band. `None` where A isn't stable.
pub fn step(A: &DMatrix<f64>, b: &DVector<f64>, C: &DMatrix<f64>, d: &DVector<f64>, band: f64) -> Option<Vec<Course>> {
    let rest = -A.clone().lu().solve(b)?;
    let end = C * &rest + d;
    // What is left to the end decays.
    let start = DMatrix::from_columns(&[-&rest]);
    let mut signals: Vec<_> = end.iter().zip(d.iter()).map(|(&end, &first)| Signal::new(end, first)).collect();
    let mut time = 0.0;
    follow(A, start, [COARSE, LATE], |h, state| {
        time += h;
        signals.iter_mut().zip((C * state).iter()).for_each(|(signal, left)| signal.is(time, *left, band));
    })?;
    Some(signals.into_iter().map(|signal| signal.course).collect())
}

/// A signal that is looked at while it moves.
struct Signal {
    course: Course,
    /// Time when it was at 10 % of its end first.
    began: Option<f64>,
    has_risen: bool,
}

impl Signal {
    fn new(end: f64, first: f64) -> Self {
        let course = Course { end, range: [end.min(first), end.max(first)], settling: 0.0, rise: 0.0 };
        Signal { course, began: None, has_risen: false }
    }

    /// It is so far from its end.
    fn is(&mut self, time: f64, left: f64, band: f64) {
        let Course { end, range: [lowest, highest], settling, rise } = &mut self.course;
        let value = *end + left;
        (*lowest, *highest) = (lowest.min(value), highest.max(value));
        if left.abs() > band {
            *settling = time;
        }
        let part = value / *end;
        if self.began.is_none() && part >= 0.1 {
            self.began = Some(time);
        }
        if let Some(began) = self.began.filter(|_| !self.has_risen && part >= 0.9) {
            (*rise, self.has_risen) = (time - began, true);
        }
    }
}
