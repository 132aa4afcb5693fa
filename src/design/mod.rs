//! First designs: from a nominal plant and a bandwidth W to gains whose nominal loop has margins.
//!
//! A design is searched for: candidates of a control law are tried at a speed v until the nominal loop is stable, keeps a
//! distance from −1 (the modulus margin), is damped, and is as fast as v. The search begins at v = W and goes to slower
//! loops; for an unstable plant, which a slow loop can't hold, to faster ones too; and last to loops that are slower still.
//!
//! Frequencies and times are in W and 1/W here, states in [balanced](crate::mathematics::balanced) coordinates: a plant in pascals and metres
//! gets the design that it gets in bar and millimetres.

pub mod channels;
pub mod controller;
pub mod criteria;
pub mod funnel;
pub mod funnel_loop;
pub mod l1;
pub mod ladrc;
pub mod limits;
pub mod minimal;
pub mod nominal;
pub mod pid;
pub mod reasons;
pub mod response;
pub mod robustness;
pub mod search;
pub mod step;
pub mod zeros;

use nalgebra::Complex;

use crate::report::number;
use crate::template::three_digits;

#[cfg(test)]
mod tests;

/// A number to four significant digits, as it is written into a description.
pub fn four_digits(value: f64) -> f64 {
    format!("{:.*e}", 3, value).parse().unwrap_or(value)
}

/// A number for people, to three significant digits.
pub fn digits(value: f64) -> String {
    number(three_digits(value))
}

/// A part in per cent for people, to a tenth.
pub fn percent(value: f64) -> String {
    digits((value * 10.0).round() / 10.0)
}

/// A complex number for people, without parts that are rounding.
pub fn complex(value: Complex<f64>) -> String {
    let counts = |part: f64| part.abs() > 1e-9 * value.norm();
    match (counts(value.re), counts(value.im)) {
        (_, false) => digits(value.re),
        (false, true) => format!("±{}j", digits(value.im.abs())),
        (true, true) => format!("{} ± {}j", digits(value.re), digits(value.im.abs())),
    }
}
