//! The adaptation gain Γ of an L1 law: so fast that the loop is the one that its filter was chosen for.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::closed::Law;
use crate::design::robustness::linear::LinearLaw;
use crate::design::robustness::place::Place;
use crate::design::robustness::uncertain::Uncertain;
use crate::design::step::exponential;

/// Distance of the loop from its limit at most, in parts of the reference.
const MOST_OFF: f64 = 0.03;
/// A disturbance at the input, in parts of what the estimates can cancel.
const DISTURBANCE: f64 = 0.3;
/// Doublings of Γ at most.
const DOUBLINGS: usize = 8;
/// Corners of the bounds at which the loop is compared with its limit.
const CORNERS: usize = 6;
/// Time in which it is, in 1/W, and points of it.
const TIME: f64 = 12.0;
const POINTS: usize = 1200;

/// Γ of a law with one input: doubled from a start until the loop at rest is near its limit for a step of the reference
/// and of a disturbance, at the nominal plant and at corners of the bounds.
pub fn near_limit(plant: &Uncertain, law: &Law, P: &DMatrix<f64>, start: f64, reference: f64, sigma_bound: f64) -> f64 {
    let mut places = vec![Place::nominal(plant.size())];
    places.extend(plant.bounds.corners(CORNERS, 1));
    let off = |gain: f64| {
        let at = |place| distance(plant, law, P, gain, place, [reference, DISTURBANCE * sigma_bound]);
        places.iter().map(at).try_fold(0.0, |largest, off| Some(f64::max(largest, off?)))
    };
    let gains = (0..=DOUBLINGS).map(|k| start * f64::powi(2.0, k as i32));
    let mut best = start;
    for gain in gains {
        best = gain;
        // A plant with which the loop isn't stable shows no limit.
        if off(gain).is_none_or(|off| off <= MOST_OFF * reference) {
            break;
        }
    }
    best
}

/// The largest difference of the output from that of the limit; `None` where numbers are too large.
fn distance(
    plant: &Uncertain,
    law: &Law,
    P: &DMatrix<f64>,
    gain: f64,
    place: &Place,
    [reference, disturbance]: [f64; 2],
) -> Option<f64> {
    let [A_t, B_t] = plant.at(place);
    let (n, m) = plant.size();
    let command = &law.K_g * reference;
    // States x, x̃, η̂, v.
    let N = 2 * n + 2 * m;
    let (mut own, mut forced) = (DMatrix::zeros(N, N), DMatrix::zeros(N, 2));
    let rate_of_x = &A_t - &B_t * &law.K_m;
    own.view_mut((0, 0), (n, n)).copy_from(&rate_of_x);
    own.view_mut((0, 2 * n + m), (n, m)).copy_from(&B_t);
    own.view_mut((n, 0), (n, n)).copy_from(&(&law.A_m - rate_of_x));
    own.view_mut((n, n), (n, n)).copy_from(&law.A_m);
    own.view_mut((n, 2 * n), (n, m)).copy_from(&plant.B);
    own.view_mut((n, 2 * n + m), (n, m)).copy_from(&-&B_t);
    own.view_mut((2 * n, n), (m, n)).copy_from(&(plant.B.transpose() * P * -gain));
    own.view_mut((2 * n, 2 * n), (m, m)).copy_from(&-&law.K);
    own.view_mut((2 * n + m, 2 * n), (m, m)).copy_from(&-&law.K);
    let ones = DVector::from_element(m, 1.0);
    let (commanded, disturbed) = (&law.K * &command * &ones, &B_t * &ones * disturbance);
    forced.view_mut((2 * n, 0), (m, 1)).copy_from(&commanded);
    forced.view_mut((2 * n + m, 0), (m, 1)).copy_from(&commanded);
    forced.view_mut((0, 1), (n, 1)).copy_from(&disturbed);
    forced.view_mut((n, 1), (n, 1)).copy_from(&-&disturbed);
    let parts = law.parts();
    let limit = parts.closed(&A_t, &B_t);
    let mut limit_forced = DMatrix::zeros(limit.nrows(), 2);
    limit_forced.column_mut(0).copy_from(&(&parts.reference * &ones * reference));
    limit_forced.column_mut(1).copy_from(&(&parts.entry * disturbed));
    let courses = [outputs(&own, &forced, &plant.C)?, outputs(&limit, &limit_forced, &plant.C)?];
    let largest = courses[0].iter().zip(&courses[1]).map(|(one, other)| (one - other).amax()).fold(0.0, f64::max);
    largest.is_finite().then_some(largest)
}

/// C of the first states, as x' = A x + b with each column b apart.
fn outputs(A: &DMatrix<f64>, b: &DMatrix<f64>, C: &DMatrix<f64>) -> Option<Vec<DMatrix<f64>>> {
    let (N, k) = b.shape();
    let mut whole = DMatrix::zeros(N + k, N + k);
    let h = TIME / POINTS as f64;
    whole.view_mut((0, 0), (N, N)).copy_from(&(A * h));
    whole.view_mut((0, N), (N, k)).copy_from(&(b * h));
    let over_h = exponential(whole)?;
    let mut state = DMatrix::zeros(N + k, k);
    state.view_mut((N, 0), (k, k)).fill_with_identity();
    let next = |_| {
        state = &over_h * &state;
        C * state.rows(0, C.ncols())
    };
    Some((0..POINTS).map(next).collect())
}
