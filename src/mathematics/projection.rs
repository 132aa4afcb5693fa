//! The projection operator of adaptive laws.
//!
//! J.-B. Pomet and L. Praly, Adaptive nonlinear regulation: estimation from the Lyapunov equation, IEEE Trans.
//! Automatic Control 37 (1992) 729–740, in its smooth scalar form.

use crate::system::Scalar;

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
    fn bounds_of_any_size_are_kept() {
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
}
