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
    let h = (hi - lo) * 0.5;
    if h.re() <= 0.0 {
        return S::from(0.0);
    }
    let d = (v - (lo + hi) * 0.5) / h;
    let f = ((epsilon + 1.0) * d * d - 1.0) / epsilon;
    if f.re() > 0.0 && (d * y).re() > 0.0 { y * (-f + 1.0) } else { y }
}

/// Where v arrives when ∫ y dt = `increment` acts on it through [`projection`], y keeping its sign.
///
/// Inside its layer at a bound, d' = y (1 + ε)/ε (1 − d²) is solved by d = tanh(artanh d(0) + (1 + ε)/ε ∫ y/h dt).
pub fn projected(v: f64, increment: f64, lo: f64, hi: f64, epsilon: f64) -> f64 {
    let (h, c) = ((hi - lo) * 0.5, (lo + hi) * 0.5);
    if h <= 0.0 {
        return v;
    }
    let (outwards, way) = (1.0_f64.copysign(increment), increment.abs() / h);
    let (d, layer) = ((v - c) / h * outwards, 1.0 / (1.0 + epsilon).sqrt());
    let free = (layer - d).max(0.0);
    if way <= free {
        return v + increment;
    }
    let from = d.clamp(layer, 1.0);
    let gain = (1.0 + epsilon) / epsilon;
    // Rounding may put c + h beside a bound.
    (c + h * outwards * (from.atanh() + gain * (way - free)).tanh()).clamp(lo, hi)
}

/// Whether v is in the layer at a bound where [`projection`] holds back what points outwards.
pub fn is_in_layer(v: f64, lo: f64, hi: f64, epsilon: f64) -> bool {
    let h = (hi - lo) * 0.5;
    (1.0 + epsilon) * (v - (lo + hi) * 0.5).powi(2) > h * h
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
    fn equal_bounds_freeze_an_estimate() {
        assert_eq!(projection(1.0, 5.0, 1.0, 1.0, 0.1), 0.0);
    }

    #[test]
    fn the_closed_form_arrives_where_the_law_does() {
        let (lo, hi, epsilon) = (-1.0, 3.0, 0.1);
        for (start, increment) in [(1.0, 0.5), (1.0, 5.0), (2.95, 0.3), (2.99, -0.5), (-0.9, -0.01), (3.0, 1.0)] {
            let steps = 100_000;
            let y = increment / f64::from(steps);
            // Heun's method.
            let rate = |v: f64| projection(v, y, lo, hi, epsilon);
            let end = (0..steps).fold(start, |v, _| v + 0.5 * (rate(v) + rate(v + rate(v))));
            let arrived = projected(start, increment, lo, hi, epsilon);
            assert!((arrived - end).abs() < 1e-6, "from {start} by {increment}: {arrived}, not {end}");
        }
    }

    #[test]
    fn the_closed_form_never_leaves_the_bounds() {
        for increment in [1e-300, 1.0, 1e12, 1e300, -1e300] {
            for start in [-1.0, 0.0, 2.999_999_999_999, 3.0] {
                let arrived = projected(start, increment, -1.0, 3.0, 0.1);
                assert!((-1.0..=3.0).contains(&arrived), "from {start} by {increment}: {arrived}");
            }
        }
        // The sum of their centre and half their width, 0.1 + 0.6 and 0.1 + 0.8, is rounded up.
        for (lo, hi) in [(-0.5, 0.7), (-0.7, 0.9), (0.1, 0.3), (-0.1, 0.7)] {
            for arrived in [projected(lo, 1e9, lo, hi, 0.1), projected(hi, -1e9, lo, hi, 0.1)] {
                assert!((lo..=hi).contains(&arrived), "{arrived} within {lo} … {hi}");
            }
        }
        assert_eq!(projected(1.0, 5.0, 1.0, 1.0, 0.1), 1.0, "equal bounds freeze");
        assert!(is_in_layer(2.99, -1.0, 3.0, 0.1) && !is_in_layer(2.5, -1.0, 3.0, 0.1));
    }
}
