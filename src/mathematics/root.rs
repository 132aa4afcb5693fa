//! The root of a function that increases.

#![allow(non_snake_case)] // F is the name of the field

use crate::system::Scalar;

/// A root is looked for within so much to both sides of 0.
const BRACKET: f64 = 1e12;
/// The most evaluations of the function, with one more at 0; those of the tests take 22.
const ITERATIONS: usize = 24;
/// Part of the residual that a useful step of Newton's method leaves; otherwise the bracket is divided at its geometric mean.
const SERVES: f64 = 0.25;
/// The part of the bracket's far end that stands for the near one, which is 0 at first.
const FIRST: f64 = 1e-2;
/// Steps so small, in parts of the place, are near the root: so many of them end it, also where numbers are short.
const NEAR: f64 = 1e-3;
const LAST: f64 = 3.0;
/// A step after which the root is exact, since the digits double.
const EXACT: f64 = 1e-7;

/// The root of a function that increases, from its value and its derivative: by Newton's method within a bracket, in a bounded
/// number of iterations. `least` is a slope that it has at least between 0 and the root, on average.
pub fn of_increasing<S: Scalar>(F: impl Fn(S) -> (S, S), least: S) -> S {
    let (zero, bracket) = (S::from(0.0), S::from(BRACKET));
    let (at_zero, slope) = F(zero);
    let (side, size) = (S::select(at_zero.above(zero), S::from(-1.0), S::from(1.0)), at_zero.abs());
    let far = S::branch(size.below(least * bracket), || size / least * (1.0 + EXACT), || bracket);
    let first = S::branch(size.below(slope * far), || size / slope, || far);
    // The place, its bracket, the size of the residual before, and how many steps were small: all to the side of the root.
    let mut state = [first, zero, far, S::from(f64::INFINITY), zero];
    S::iterate(
        &mut state,
        ITERATIONS,
        |state| state[4].below(S::from(LAST)),
        |state| {
            let [place, low, high, before, small] = [state[0], state[1], state[2], state[3], state[4]];
            let (value, slope) = F(side * place);
            let value = side * value;
            let (low, high) = S::branch(value.above(zero), || (low, place), || (place, high));
            let newton = place - value / slope;
            let step = (newton - place).abs();
            let is_near = step.at_most(place * NEAR);
            let serves = newton.above(low) & newton.below(high) & value.abs().at_most(before * SERVES);
            let mean = || (S::select(low.above(zero), low, high * FIRST) * high).sqrt();
            let next = S::branch(is_near | serves, || newton, mean);
            let counted = S::select(is_near, small + 1.0, small);
            let counted = S::select(step.at_most(place * EXACT), S::from(LAST), counted);
            state.copy_from_slice(&[next, low, high, value.abs(), counted]);
        },
    );
    side * state[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_is_found_wherever_it_lies_and_however_steep_the_function_is() {
        for root in [-3e11, -40.0, -1e-9, 0.0, 0.7, 12.0, 5e8] {
            for least in [0.0, 1e-3, 1.0] {
                let line = of_increasing(|x: f64| (x - root, 1.0), least);
                assert!((line - root).abs() <= 1e-13 * root.abs(), "{line} is not {root}");
            }
        }
        for root in [-20.0, -0.3, 1e-6, 2.0, 90.0] {
            let steep = of_increasing(|x: f64| (x.sinh() - f64::sinh(root), x.cosh()), 1.0);
            assert!((steep / root - 1.0).abs() < 1e-12, "{steep} is not {root}");
        }
    }

    #[test]
    fn without_a_root_the_end_of_the_bracket_is_reached() {
        assert!(of_increasing(|x: f64| (x.tanh() + 2.0, 0.0), 0.0) < -9e11);
    }
}
