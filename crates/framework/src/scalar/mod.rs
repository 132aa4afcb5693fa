//! Scalars that equations are written over.
//!
//! A scalar is a number, or a node of a [recording](crate::recording), from which exact derivatives follow. Equations
//! can't look at its value: what depends on one is *selected* by a flag, so that the same text serves both.

mod messages;
mod opaque;

use std::f64::consts::{PI, TAU};
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, DivAssign, Mul, MulAssign, Neg, Not, Sub, SubAssign};

pub use messages::{Message, MessageLog};
pub(crate) use messages::{REFERENCE, of_part};
pub use opaque::Opaque;

use crate::error::{self, Invalid};
use crate::report;

/// A condition over scalars: `bool`, or a node of a recording. Combined by `&`, `|` and `!`.
pub trait Flag:
    Copy
    + Send
    + Sync
    + 'static
    + std::fmt::Debug
    + From<bool>
    + Not<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
{
}

impl Flag for bool {}

/// A scalar that equations are written over: `f64`, or a node of a recording.
///
/// It has arithmetic, elementary functions, and *selection*. A condition is a [`Scalar::Flag`]; what depends on one is
/// chosen by [`Scalar::select`] between existing values, by [`Scalar::branch`] between two ways of computing them, or
/// carried out by [`Point::when`](crate::system::Point::when). For numbers these are ordinary branches, at the same
/// cost.
pub trait Scalar:
    nalgebra::Scalar
    + Copy
    + Send
    + Sync
    + From<f64>
    + num_traits::Zero
    + num_traits::One
    + std::fmt::Display
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + AddAssign<f64>
    + SubAssign<f64>
    + MulAssign<f64>
    + DivAssign<f64>
{
    /// A condition.
    type Flag: Flag;
    /// An integer, a Boolean as 0 or 1, or a choice by the number of its item.
    type Integer: Copy + Send + Sync + std::fmt::Debug + PartialEq + 'static;

    /// Sine.
    fn sin(self) -> Self;
    /// Cosine.
    fn cos(self) -> Self;
    /// Tangent.
    fn tan(self) -> Self;
    /// Hyperbolic cosine.
    fn cosh(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// Exponential function.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// ln(1 + x), sharp near 0.
    fn ln_1p(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Arc tangent.
    fn atan(self) -> Self;
    /// 1/x.
    fn recip(self) -> Self;
    /// Power with a whole exponent.
    fn powi(self, exponent: i32) -> Self;
    /// Power.
    fn powf(self, exponent: f64) -> Self;
    /// Power of a number that isn't negative, with an exponent of the equations.
    fn powd(self, exponent: Self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// 1 with the sign of the number.
    fn signum(self) -> Self;
    /// The largest whole number that is not above.
    fn floor(self) -> Self;
    /// The nearest whole number, halves away from zero.
    fn round(self) -> Self;
    /// The angle in (−π, π] that differs from this one by whole turns, rad: the remainder of IEEE 754 by 2π, with π for −π. It is
    /// exact, and as a function of the angle it has slope 1 everywhere.
    fn wrap(self) -> Self;

    /// True if it is below another; so with the others. Where one of both is no number, no comparison holds.
    fn below(self, other: Self) -> Self::Flag;
    /// True if it is above another.
    fn above(self, other: Self) -> Self::Flag {
        other.below(self)
    }
    /// True if it is at most as large as another.
    fn at_most(self, other: Self) -> Self::Flag;
    /// True if it is at least as large as another.
    fn at_least(self, other: Self) -> Self::Flag {
        other.at_most(self)
    }
    /// True if it equals another.
    fn equals(self, other: Self) -> Self::Flag;
    /// True if it is no number and no infinity.
    fn is_finite(self) -> Self::Flag {
        self.abs().below(Self::from(f64::INFINITY))
    }

    /// A condition as a number, 1 or 0.
    fn from_flag(flag: Self::Flag) -> Self {
        Self::select(flag, Self::from(1.0), Self::from(0.0))
    }
    /// An integer as a number.
    fn from_integer(integer: Self::Integer) -> Self;
    /// The integer that a whole number is.
    fn to_integer(self) -> Self::Integer;
    /// A known integer.
    fn integer(value: i32) -> Self::Integer;
    /// True if two integers are equal.
    fn same(one: Self::Integer, other: Self::Integer) -> Self::Flag;
    /// One of two integers.
    fn select_integer(flag: Self::Flag, yes: Self::Integer, no: Self::Integer) -> Self::Integer;

    /// The number in a text, with all its digits.
    fn to_text(self) -> String;
    /// The number in a text, rounded to what a person reads.
    fn rounded(self) -> String;
    /// The same, with digits cut instead of rounded: a magnitude that may be reached.
    fn rounded_at_most(self) -> String;
    /// The same, rounded away from 0: a magnitude that suffices.
    fn rounded_at_least(self) -> String;
    /// The number in a text, with an exponent and this number of decimals.
    fn scientific(self, digits: usize) -> String;
    /// The same, cut instead of rounded: the most that a text may advise.
    fn scientific_at_most(self, digits: usize) -> String;
    /// The number in a text, with this number of decimals.
    fn fixed(self, digits: usize) -> String;

    /// One of two values.
    fn select(flag: Self::Flag, yes: Self, no: Self) -> Self;
    /// The result of one of two ways; numbers take only that way.
    fn branch<T: Merge<Self>>(flag: Self::Flag, yes: impl FnOnce() -> T, no: impl FnOnce() -> T) -> T;

    /// The value at a place among some, counted from 0: of a fraction its whole part, beyond an end the one at that end, and
    /// the first where the place is no number.
    ///
    /// # Panics
    /// When there are no values.
    fn element(values: &[Self], place: Self) -> Self;
    /// Puts a value at such a place.
    ///
    /// # Panics
    /// As [`Scalar::element`].
    fn put_element(values: &mut [Self], place: Self, value: Self);

    /// Repeats a step on a state while a condition holds on it, at most `most` times. The step changes the state only.
    fn iterate(state: &mut [Self], most: usize, goes_on: impl Fn(&[Self]) -> Self::Flag, step: impl Fn(&mut [Self]));

    /// A function that is no arithmetic, one of [`Opaque`]. Its derivative is zero.
    fn opaque(function: Opaque, arguments: &[Self]) -> Self;

    #[doc(hidden)]
    fn carry_out<P: Changed<Self>>(flag: Self::Flag, place: &mut P, change: impl FnOnce(&mut P));
    #[doc(hidden)]
    fn log(flag: Self::Flag, log: &mut MessageLog, category: &'static str, text: impl FnOnce() -> String);
    #[doc(hidden)]
    fn refuse(flag: Self::Flag, log: &mut MessageLog, reason: impl FnOnce() -> Invalid);
}

/// A possible result of two ways: scalars, and arrays and tuples of them.
pub trait Merge<S: Scalar> {
    /// One of two.
    fn merge(flag: S::Flag, yes: Self, no: Self) -> Self;
}

impl<S: Scalar> Merge<S> for S {
    fn merge(flag: S::Flag, yes: S, no: S) -> S {
        S::select(flag, yes, no)
    }
}

impl<S: Scalar, T: Merge<S>, const N: usize> Merge<S> for [T; N] {
    fn merge(flag: S::Flag, yes: Self, no: Self) -> Self {
        let mut no = no.into_iter();
        yes.map(|yes| T::merge(flag, yes, no.next().expect("both have N")))
    }
}

macro_rules! merge_tuples {
    ($($name:ident $yes:ident $no:ident),*) => {
        impl<S: Scalar, $($name: Merge<S>),*> Merge<S> for ($($name,)*) {
            fn merge(flag: S::Flag, ($($yes,)*): Self, ($($no,)*): Self) -> Self {
                ($($name::merge(flag, $yes, $no),)*)
            }
        }
    };
}
merge_tuples!(A a b, B c d);
merge_tuples!(A a b, B c d, C e f);

/// Values that a conditional change may change: they can be copied before, and merged after it.
#[doc(hidden)]
pub trait Changed<S: Scalar> {
    /// The values as they are.
    fn copied(&self) -> (Vec<S>, Vec<S::Integer>);
    /// The values, to write.
    fn places(&mut self) -> (&mut [S], &mut [S::Integer]);
}

impl<S: Scalar> Changed<S> for &mut [S] {
    fn copied(&self) -> (Vec<S>, Vec<S::Integer>) {
        (self.to_vec(), Vec::new())
    }
    fn places(&mut self) -> (&mut [S], &mut [S::Integer]) {
        (self, &mut [])
    }
}

/// The smaller of two; the first where they are equal.
pub fn smaller<S: Scalar>(a: S, b: S) -> S {
    S::select(b.below(a), b, a)
}

/// The larger of two; the first where they are equal.
pub fn larger<S: Scalar>(a: S, b: S) -> S {
    S::select(b.above(a), b, a)
}

/// True if any condition holds.
pub fn any<S: Scalar>(flags: impl IntoIterator<Item = S::Flag>) -> S::Flag {
    flags.into_iter().fold(false.into(), |any, flag| any | flag)
}

/// The angle in (−π, π] that differs from one by whole turns.
#[inline]
pub(crate) fn wrapped(angle: f64) -> f64 {
    // Exact: a remainder always is, and so is the difference of two numbers of which one is at most twice the other.
    let rest = angle % TAU;
    if rest > PI {
        rest - TAU
    } else if rest <= -PI {
        rest + TAU
    } else {
        rest
    }
}

macro_rules! functions_of_numbers {
    ($($name:ident)*) => {$(
        #[inline]
        fn $name(self) -> f64 {
            f64::$name(self)
        }
    )*};
}

impl Scalar for f64 {
    type Flag = bool;
    type Integer = i32;

    functions_of_numbers!(sin cos tan cosh tanh exp ln ln_1p sqrt atan recip abs signum floor round);
    #[inline]
    fn wrap(self) -> f64 {
        wrapped(self)
    }
    #[inline]
    fn powi(self, exponent: i32) -> f64 {
        f64::powi(self, exponent)
    }
    #[inline]
    fn powf(self, exponent: f64) -> f64 {
        f64::powf(self, exponent)
    }
    #[inline]
    fn powd(self, exponent: f64) -> f64 {
        f64::powf(self, exponent)
    }
    fn below(self, other: Self) -> bool {
        self < other
    }
    fn at_most(self, other: Self) -> bool {
        self <= other
    }
    fn equals(self, other: Self) -> bool {
        self == other
    }
    fn from_integer(integer: i32) -> Self {
        f64::from(integer)
    }
    fn to_integer(self) -> i32 {
        self as i32
    }
    fn integer(value: i32) -> i32 {
        value
    }
    fn same(one: i32, other: i32) -> bool {
        one == other
    }
    fn select_integer(flag: bool, yes: i32, no: i32) -> i32 {
        if flag { yes } else { no }
    }
    fn to_text(self) -> String {
        error::Number(self).to_string()
    }
    fn rounded(self) -> String {
        report::number(self)
    }
    fn rounded_at_most(self) -> String {
        report::at_most(self)
    }
    fn rounded_at_least(self) -> String {
        report::at_least(self)
    }
    fn scientific(self, digits: usize) -> String {
        format!("{:.digits$e}", self)
    }
    fn scientific_at_most(self, digits: usize) -> String {
        format!("{:.digits$e}", report::no_more(self, digits + 1))
    }
    fn fixed(self, digits: usize) -> String {
        format!("{:.digits$}", self)
    }
    #[inline]
    fn select(flag: bool, yes: Self, no: Self) -> Self {
        if flag { yes } else { no }
    }
    #[inline]
    fn branch<R: Merge<Self>>(flag: bool, yes: impl FnOnce() -> R, no: impl FnOnce() -> R) -> R {
        if flag { yes() } else { no() }
    }
    fn element(values: &[Self], place: Self) -> Self {
        // A cast keeps to the numbers that there are, and makes 0 of what is none.
        values[(place as usize).min(values.len() - 1)]
    }
    fn put_element(values: &mut [Self], place: Self, value: Self) {
        values[(place as usize).min(values.len() - 1)] = value;
    }
    #[inline]
    fn iterate(state: &mut [Self], most: usize, goes_on: impl Fn(&[Self]) -> bool, step: impl Fn(&mut [Self])) {
        for _ in 0..most {
            if !goes_on(state) {
                break;
            }
            step(state);
        }
    }
    fn opaque(function: Opaque, arguments: &[Self]) -> Self {
        function.of(arguments.iter().copied())
    }
    #[inline]
    fn carry_out<P: Changed<Self>>(flag: bool, place: &mut P, change: impl FnOnce(&mut P)) {
        if flag {
            change(place);
        }
    }
    #[inline]
    fn log(flag: bool, log: &mut MessageLog, category: &'static str, text: impl FnOnce() -> String) {
        if flag {
            log.add(category, text());
        }
    }
    #[inline]
    fn refuse(flag: bool, log: &mut MessageLog, reason: impl FnOnce() -> Invalid) {
        if flag {
            log.refuse(reason());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_is_wrapped_exactly() {
        let (before, after) = (f64::next_down, f64::next_up);
        for (angle, wrapped) in [
            (0.0, 0.0),
            (-0.0, -0.0),
            (1.0, 1.0),
            (PI, PI),
            (-PI, PI),
            (after(PI), after(PI) - TAU),
            (before(-PI), before(-PI) + TAU),
            (after(-PI), after(-PI)),
            (TAU, 0.0),
            (-TAU, -0.0),
            (2.0 * TAU + 0.5, (2.0 * TAU + 0.5) - 2.0 * TAU),
        ] {
            assert_eq!(Scalar::wrap(angle).to_bits(), f64::to_bits(wrapped), "{angle}");
        }
        assert!(Scalar::wrap(f64::NAN).is_nan() && Scalar::wrap(f64::INFINITY).is_nan());
    }

    /// Whole numbers of any size are added without rounding: what is wrapped is what is left of a double by an integer division
    /// of its bits.
    #[test]
    fn a_wrapped_angle_is_the_remainder_of_whole_numbers() {
        let unit = 2_f64.powi(-51);
        let turn = (TAU / unit) as i128;
        assert_eq!(turn as f64 * unit, TAU);
        let mut angle = (0.37 / unit).round() * unit;
        while angle < 1e20 {
            for angle in [angle, -angle] {
                let whole = (angle / unit) as i128;
                assert_eq!(whole as f64 * unit, angle);
                let rest = whole.rem_euclid(turn);
                let rest = if 2 * rest > turn { rest - turn } else { rest };
                assert_eq!(Scalar::wrap(angle), rest as f64 * unit, "{angle}");
                assert!(Scalar::wrap(angle) > -PI && Scalar::wrap(angle) <= PI);
            }
            angle = (angle * 1.37 / unit).round() * unit;
        }
    }
}
