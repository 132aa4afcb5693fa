//! Angles that differ by whole turns.

use std::f64::consts::TAU;

use crate::system::Scalar;

/// The angle nearest to another one among those that differ from this one by whole turns, `to + wrap(angle − to)`. Turns are
/// added to the angle itself: near to its own result it is the same number, and what is added a thousand times rounds once.
pub fn nearest<S: Scalar>(angle: S, to: S) -> S {
    let from = angle - to;
    angle + ((from.wrap() - from) / TAU).round() * TAU
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn the_nearest_angle_is_at_most_half_a_turn_away_and_found_again() {
        for k in -40..40_i32 {
            for turns in -3..4 {
                let (to, angle) = (0.731 * f64::from(k), 0.731 * f64::from(k) * 0.9 + 1.0 + TAU * f64::from(turns));
                let found = nearest(angle, to);
                assert!((found - to).abs() <= PI + 1e-12, "{angle} near {to}: {found}");
                assert!((found - (to + (angle - to).wrap())).abs() < 1e-13 * (1.0 + to.abs()));
                assert_eq!(nearest(angle, found), found);
            }
        }
        assert_eq!(nearest(PI, 0.0), PI);
        assert_eq!(nearest(-PI, 0.0), PI);
        assert_eq!(nearest(0.25, 0.5), 0.25);
    }
}
