//! Dual numbers: values that carry exact derivatives in N directions (E. Hairer and G. Wanner's "automatic differentiation",
//! forward mode).
//!
//! The directions lie in an array of fixed length, so that an operation is a few vector instructions, whatever its operands
//! are: a type that leaves zero derivatives out was measured to compile to several times the code.

use std::fmt;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value with its derivatives in N directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize = 1> {
    /// The value.
    pub value: f64,
    /// Its derivatives.
    pub derivatives: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number that doesn't change.
    pub const fn constant(value: f64) -> Self {
        Dual { value, derivatives: [0.0; N] }
    }

    /// f(x) with the derivative f'(x).
    pub(super) fn chained(self, value: f64, slope: f64) -> Self {
        Dual { value, derivatives: self.derivatives.map(|derivative| derivative * slope) }
    }

    fn with(self, other: Self, value: f64, derivative: impl Fn(f64, f64) -> f64) -> Self {
        let mut derivatives = self.derivatives;
        derivatives.iter_mut().zip(other.derivatives).for_each(|(own, other)| *own = derivative(*own, other));
        Dual { value, derivatives }
    }
}

impl Dual<1> {
    /// A number that changes at this rate.
    pub const fn new(value: f64, derivative: f64) -> Self {
        Dual { value, derivatives: [derivative] }
    }

    /// Its derivative.
    pub const fn derivative(self) -> f64 {
        self.derivatives[0]
    }

    /// f(x) and f'(x) of a function.
    pub fn of(function: impl FnOnce(Self) -> Self, x: f64) -> (f64, f64) {
        let found = function(Dual::new(x, 1.0));
        (found.value, found.derivative())
    }
}

impl<const N: usize> From<f64> for Dual<N> {
    fn from(value: f64) -> Self {
        Dual::constant(value)
    }
}

impl<const N: usize> fmt::Display for Dual<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.value, f)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chained(-self.value, -1.0)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.with(other, self.value + other.value, |own, other| own + other)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.with(other, self.value - other.value, |own, other| own - other)
    }
}

// The product rule adds.
#[allow(clippy::suspicious_arithmetic_impl)]
impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.with(other, self.value * other.value, |a, b| a * other.value + self.value * b)
    }
}

// The quotient rule multiplies and subtracts. By a number that doesn't change it gives what division by that gives.
#[allow(clippy::suspicious_arithmetic_impl)]
impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        self.with(other, quotient, |a, b| (a - quotient * b) / other.value)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    fn add(self, other: f64) -> Self {
        Dual { value: self.value + other, ..self }
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    fn sub(self, other: f64) -> Self {
        Dual { value: self.value - other, ..self }
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    fn mul(self, other: f64) -> Self {
        self.chained(self.value * other, other)
    }
}

impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    fn div(self, other: f64) -> Self {
        Dual { value: self.value / other, derivatives: self.derivatives.map(|derivative| derivative / other) }
    }
}

macro_rules! assign {
    ($($trait:ident $method:ident $of:ident),*) => {$(
        impl<const N: usize> $trait for Dual<N> {
            fn $method(&mut self, other: Self) {
                *self = (*self).$of(other);
            }
        }
        impl<const N: usize> $trait<f64> for Dual<N> {
            fn $method(&mut self, other: f64) {
                *self = (*self).$of(other);
            }
        }
    )*};
}
assign!(AddAssign add_assign add, SubAssign sub_assign sub, MulAssign mul_assign mul, DivAssign div_assign div);

impl<const N: usize> num_traits::Zero for Dual<N> {
    fn zero() -> Self {
        Dual::constant(0.0)
    }
    fn is_zero(&self) -> bool {
        *self == Self::zero()
    }
}

impl<const N: usize> num_traits::One for Dual<N> {
    fn one() -> Self {
        Dual::constant(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar::Scalar;
    use num_dual::{Dual64, DualNum};

    /// Every function and operation against those of a library, at random places.
    #[test]
    fn derivatives_are_those_of_an_independent_implementation() {
        type Own = fn(Dual) -> Dual;
        type Other = fn(Dual64) -> Dual64;
        let pairs: [(Own, Other); 18] = [
            (|x| Scalar::sin(x), |x| x.sin()),
            (|x| Scalar::cos(x), |x| x.cos()),
            (|x| Scalar::tan(x), |x| x.tan()),
            (|x| Scalar::cosh(x), |x| x.cosh()),
            (|x| Scalar::tanh(x), |x| x.tanh()),
            (|x| Scalar::exp(x), |x| x.exp()),
            (|x| Scalar::ln(x), |x| x.ln()),
            (|x| Scalar::ln_1p(x), |x| x.ln_1p()),
            (|x| Scalar::sqrt(x), |x| x.sqrt()),
            (|x| Scalar::atan(x), |x| x.atan()),
            (|x| Scalar::recip(x), |x| x.recip()),
            (|x| Scalar::powi(x, -3), |x| x.powi(-3)),
            (|x| Scalar::powf(x, 1.7), |x| x.powf(1.7)),
            (|x| x * x - x / (x + 2.0), |x| x * x - x / (x + 2.0)),
            (|x| -x * 3.0 / 7.0 - 1.0, |x| -x * 3.0 / 7.0 - 1.0),
            (|x| Scalar::abs(-x), |x| num_traits::Signed::abs(&-x)),
            (|x| Scalar::powi(x, 0), |x| x.powi(0)),
            (|x| Dual::from(3.0) / x, |x| Dual64::from(3.0) / x),
        ];
        for k in 1..40 {
            let x = 0.07 * f64::from(k);
            for (own, other) in pairs {
                let (own, other) = (own(Dual::new(x, 1.3)), other(Dual64::new(x, 1.3)));
                assert!((own.value - other.re).abs() <= 1e-14 * other.re.abs(), "{own:?} {other}");
                assert!((own.derivative() - other.eps).abs() <= 1e-12 * (1.0 + other.eps.abs()), "{own:?} {other}");
            }
        }
    }

    #[test]
    fn directions_dont_mix() {
        let x = Dual { value: 0.5, derivatives: [1.0, 0.0, 2.0] };
        let y = Dual { value: 2.0, derivatives: [0.0, 1.0, 0.0] };
        let product = Scalar::sin(x * y);
        let slope = 1.0_f64.cos();
        assert_eq!(product.derivatives, [2.0 * slope, 0.5 * slope, 4.0 * slope]);
    }

    #[test]
    fn a_saturated_function_has_a_derivative_far_out() {
        let far = Scalar::tanh(Dual::new(800.0, 1.0));
        assert_eq!((far.value, far.derivative()), (1.0, 0.0));
    }
}
