//! The root of a function that increases.

#![allow(non_snake_case)] // F is the name of the field

use crate::system::Scalar;

/// A root is looked for within so much to both sides of 0.
const BRACKET: f64 = 1e12;
/// As many as it takes from 1 to beyond BRACKET.
const DOUBLINGS: usize = 40;
const ITERATIONS: usize = 200;
/// Relative precision of the root.
const PRECISION: f64 = 1e-14;

/// Where a function that increases is 0, from its value and its derivative: by Newton's method within a bracket. A root at 0
/// itself is approached, and not met to the last bit.
pub fn of_increasing<S: Scalar>(F: impl Fn(S) -> (S, S)) -> S {
    let (zero, bracket) = (S::from(0.0), S::from(BRACKET));
    let (mut low, mut high) = ([S::from(-1.0)], [S::from(1.0)]);
    let is_below = |high: &[S]| F(high[0]).0.below(zero) & high[0].below(bracket);
    S::iterate(&mut high, DOUBLINGS, is_below, |high| high[0] *= 2.0);
    let is_above = |low: &[S]| F(low[0]).0.above(zero) & low[0].above(-bracket);
    S::iterate(&mut low, DOUBLINGS, is_above, |low| low[0] *= 2.0);
    // The place, the bracket, and how far the place has moved.
    let mut state = [zero, low[0], high[0], S::from(f64::INFINITY)];
    let moves = |state: &[S]| !state[3].at_most(state[0].abs() * PRECISION);
    S::iterate(&mut state, ITERATIONS, moves, |state| {
        let (place, low, high) = (state[0], state[1], state[2]);
        let (value, slope) = F(place);
        let (low, high) = S::branch(value.above(zero), || (low, place), || (place, high));
        let newton = place - value / slope;
        let is_within = newton.above(low) & newton.below(high);
        let next = S::branch(is_within, || newton, || (low + high) * 0.5);
        state.copy_from_slice(&[next, low, high, (next - place).abs()]);
    });
    state[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_is_found_wherever_it_lies_and_however_steep_the_function_is() {
        for root in [-3e11, -40.0, -1e-9, 0.0, 0.7, 12.0, 5e8] {
            let line = of_increasing(|x: f64| (x - root, 1.0));
            assert!((line - root).abs() <= 1e-13 * root.abs() + 1e-30, "{line} is not {root}");
        }
        for root in [-20.0, -0.3, 1e-6, 2.0, 90.0] {
            let steep = of_increasing(|x: f64| (x.sinh() - f64::sinh(root), x.cosh()));
            assert!((steep / root - 1.0).abs() < 1e-12, "{steep} is not {root}");
        }
    }

    #[test]
    fn without_a_root_the_end_of_the_bracket_is_reached() {
        assert!(of_increasing(|x: f64| (x.tanh() + 2.0, 0.0)) < -9e11);
    }
}
