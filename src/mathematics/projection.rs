//! The projection operator of adaptive laws.
//!
//! J.-B. Pomet and L. Praly, Adaptive nonlinear regulation: estimation from the Lyapunov equation, IEEE Trans.
//! Automatic Control 37 (1992) 729–740, in its smooth scalar form.

use crate::mathematics::limits::within;
use crate::system::{Scalar, larger};

/// Proj(v, y) for an estimate v within [lo, hi] that would change at rate y.
///
/// With centre c, half width h and d = (v − c)/h, f = ((1 + ε) d² − 1) / ε: where f > 0 and y points outwards, the
/// rate is y (1 − f), so that it fades to zero at the bound; else it is y. Where the bounds coincide, the estimate is
/// frozen.
pub fn projection<S: Scalar>(v: S, y: S, lo: S, hi: S, epsilon: S) -> S {
    let (h, away) = ((hi - lo) * 0.5, v - (lo + hi) * 0.5);
    let held_back = || {
        let d = away / h;
        let f = ((epsilon + 1.0) * d * d - 1.0) / epsilon;
        let outwards = f.above(S::from(0.0)) & (d * y).above(S::from(0.0));
        S::branch(outwards, || y * (-f + 1.0), || y)
    };
    // Not in the layer for certain, as √(1 + ε) ≤ 1 + ε: nothing needs to be divided.
    let is_inside = (away.abs() * (epsilon + 1.0)).at_most(h);
    S::branch(h.at_most(S::from(0.0)), || S::from(0.0), || S::branch(is_inside, || y, held_back))
}

/// The estimate to which a constant rate leads that moves it by `increment` where nothing holds it back: the solution of
/// v' = Proj(v, increment) after a time of 1, in closed form, so that a sampled law keeps the bounds at any step.
///
/// With d the distance from the centre in the increment's direction, in half widths, it is free up to 1/√(1 + ε); what is left
/// leads from there to tanh(artanh d + (1 + ε)/ε · increment/h). An estimate at its bound or beyond it, as after a bound was
/// tightened, is taken to that bound by an increment that points outwards. Where the bounds coincide, it is frozen.
pub fn projected<S: Scalar>(v: S, increment: S, lo: S, hi: S, epsilon: S) -> S {
    let (h, centre) = ((hi - lo) * 0.5, (lo + hi) * 0.5);
    let (free, towards) = (v + increment, increment.signum());
    let held_back = || {
        let (end, d) = ((free - centre) * towards / h, (v - centre) * towards / h);
        let inner = (epsilon + 1.0).sqrt().recip();
        let from = larger(inner, d);
        // tanh of a sum, from the tangents: d itself is that of artanh d, which is infinite at the bound.
        let further = ((end - from) * (epsilon + 1.0) / epsilon).tanh();
        let ahead = (from + further) / (from * further + 1.0);
        centre + towards * h * S::branch(d.below(S::from(1.0)), || ahead, || S::from(1.0))
    };
    let stays_inside = ((free - centre) * towards * (epsilon + 1.0).sqrt()).at_most(h);
    let moved = || within(S::branch(stays_inside, || free, held_back), lo, hi);
    S::branch(h.at_most(S::from(0.0)), || v, moved)
}

/// True if v is in the layer at a bound where [`projection`] holds back what points outwards; never where the bounds
/// coincide.
pub fn is_in_layer<S: Scalar>(v: S, lo: S, hi: S, epsilon: S) -> S::Flag {
    let (h, away) = ((hi - lo) * 0.5, v - (lo + hi) * 0.5);
    // (1 + ε) (away/h)² > 1 without a division by the width, which may be zero.
    h.above(S::from(0.0)) & (away.abs() * (epsilon + 1.0).sqrt()).above(h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_moves_freely_inside_and_never_out_of_its_bounds() {
        assert_eq!(projection(0.0, 7.0, -2.0, 4.0, 0.1), 7.0, "inside");
        assert_eq!(projection(3.99, -7.0, -2.0, 4.0, 0.1), -7.0, "back inside from near the bound");
        assert!(projection(4.0_f64, 7.0, -2.0, 4.0, 0.1).abs() < 1e-12, "at the upper bound");
        assert!(projection(-2.0_f64, -7.0, -2.0, 4.0, 0.1).abs() < 1e-12, "at the lower bound");
        let between = projection(3.95, 7.0, -2.0, 4.0, 0.1);
        assert!(between > 0.0 && between < 7.0, "fading between: {between}");
    }

    #[test]
    fn bounds_of_any_size_are_respected() {
        for largest in [1e-200, 1.0, 1e200] {
            assert!(projection(0.0_f64, -1.0, 0.0, largest, 0.1).abs() < 1e-12, "0 … {largest}");
            assert!(is_in_layer(0.0, 0.0, largest, 0.1) && !is_in_layer(0.4 * largest, 0.0, largest, 0.1));
        }
    }

    #[test]
    fn equal_bounds_freeze_an_estimate() {
        assert_eq!(projection(1.0, 5.0, 1.0, 1.0, 0.1), 0.0);
    }

    #[test]
    fn the_layer_is_where_the_rate_is_held_back() {
        for v in [-0.95, -0.5, 1.0, 2.8, 2.9, 2.99] {
            let outwards = (v - 1.0_f64).signum();
            let held_back = projection(v, outwards, -1.0, 3.0, 0.1) != outwards;
            assert_eq!(is_in_layer(v, -1.0, 3.0, 0.1), held_back, "{v}");
        }
    }

    /// Numbers within 0 … 1, the fractions of multiples of an irrational number.
    fn random() -> impl FnMut() -> f64 {
        let mut k = 0.0;
        move || {
            k += 1.0;
            (k * 0.754_877_666_246_692_7_f64 + (k * 0.569_840_290_998_053_3).fract() * 0.3).fract()
        }
    }

    /// v' = Proj(v, rate) over a time of 1, by the method of Runge and Kutta in small steps.
    fn integrated(start: f64, rate: f64, (lo, hi): (f64, f64), epsilon: f64) -> f64 {
        let slope = |v: f64| projection(v, rate, lo, hi, epsilon);
        let steps = 20_000;
        let h = 1.0 / f64::from(steps);
        (0..steps).fold(start, |v, _| {
            let k1 = slope(v);
            let k2 = slope(v + 0.5 * h * k1);
            let k3 = slope(v + 0.5 * h * k2);
            v + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(v + h * k3))
        })
    }

    #[test]
    fn a_projected_increment_is_the_integral_of_the_projected_rate() {
        let mut random = random();
        let (mut free, mut held_back) = (0, 0);
        for case in 0..300 {
            let (size, epsilon) = (10.0_f64.powf(4.0 * random() - 2.0), 10.0_f64.powf(1.5 * random() - 1.5));
            let lo = size * (random() - 0.5);
            let hi = lo + size * (0.1 + random());
            let start = lo + (hi - lo) * random();
            let increment = (hi - lo) * 2.0 * (2.0 * random() - 1.0);
            let found = projected(start, increment, lo, hi, epsilon);
            let expected = integrated(start, increment, (lo, hi), epsilon);
            let off = (found - expected).abs() / (hi - lo);
            assert!(off < 1e-6, "case {case}: {start} by {increment} in {lo} … {hi}, {epsilon}: {found}, {expected}");
            *(if found == start + increment { &mut free } else { &mut held_back }) += 1;
        }
        assert!(free > 50 && held_back > 50, "{free} free, {held_back} reduced");
    }

    #[test]
    fn two_increments_lead_where_their_sum_does() {
        let mut random = random();
        for _ in 0..200 {
            let (start, whole, part) = (3.0 * random() - 1.0, 4.0 * (2.0 * random() - 1.0), random());
            let by = |v: f64, increment: f64| projected(v, increment, -1.0, 2.0, 0.1);
            let (twice, once) = (by(by(start, part * whole), (1.0 - part) * whole), by(start, whole));
            assert!((twice - once).abs() < 1e-13, "{start} by {whole}: {twice}, {once}");
        }
    }

    #[test]
    fn no_increment_leads_beyond_a_bound() {
        let mut random = random();
        for _ in 0..2000 {
            let (lo, hi) = (-random() * 1e3, random() * 1e-3);
            let mut v = lo + (hi - lo) * random();
            for _ in 0..20 {
                v = projected(v, (2.0 * random() - 1.0) * 10.0_f64.powf(24.0 * random() - 12.0), lo, hi, 0.1);
                assert!((lo..=hi).contains(&v), "{v:e} in {lo:e} … {hi:e}");
            }
        }
        for huge in [1e200, f64::INFINITY] {
            assert_eq!((projected(0.5, huge, -1.0, 2.0, 0.1), projected(0.5, -huge, -1.0, 2.0, 0.1)), (2.0, -1.0));
        }
    }

    #[test]
    fn an_estimate_at_its_bound_or_beyond_is_taken_to_it_and_leaves_it_inwards() {
        for v in [2.0, 2.0 + 1e-15, 7.0] {
            assert_eq!(projected(v, 0.3, -1.0, 2.0, 0.1), 2.0, "{v}");
            assert_eq!(projected(-v + 1.0, -0.3, -1.0, 2.0, 0.1), -1.0, "{v}");
        }
        assert_eq!(projected(2.0, -0.25, -1.0, 2.0, 0.1), 1.75);
        assert_eq!(projected(7.0, -0.25, -1.0, 2.0, 0.1), 2.0, "never beyond, inwards either");
    }

    #[test]
    fn equal_bounds_freeze_an_estimate_whatever_it_is_moved_by() {
        assert_eq!(projected(1.0, 5.0, 1.0, 1.0, 0.1), 1.0);
        assert_eq!(projected(0.0, -5.0, 0.0, 0.0, 0.1), 0.0);
    }
}
