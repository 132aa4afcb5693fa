//! Single operations as C writes them.

use crate::recording::{Binary, Comparison, Unary};

/// Precedence of an expression's outermost operator in C.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Binding {
    /// a ? b : c
    Selection,
    /// a || b
    Or,
    /// a && b
    And,
    /// a == b
    Equality,
    /// a < b
    Relation,
    /// a + b, a - b
    Sum,
    /// a * b, a / b
    Product,
    /// -a, !a, (real)a
    Unary,
    /// A name, a number, a call.
    Atom,
}

/// The type of an expression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `real`
    Real,
    /// `int`: whole numbers and conditions.
    Whole,
}

/// An expression.
#[derive(Debug, Clone)]
pub struct Expression {
    /// C text.
    pub text: String,
    /// Its outermost operator.
    pub binding: Binding,
    /// Its type.
    pub kind: Kind,
    /// The number that it is, where that is known.
    pub known: Option<f64>,
    /// Number of operations.
    pub size: usize,
    /// True if it has an operation that isn't defined for every number, or whose result may have none.
    pub is_partial: bool,
}

impl Expression {
    fn new(text: String, binding: Binding, kind: Kind, size: usize) -> Self {
        Expression { text, binding, kind, known: None, size, is_partial: false }
    }

    /// The same, partial where any of these is.
    fn made_of(self, parts: &[&Self]) -> Self {
        Expression { is_partial: parts.iter().any(|part| part.is_partial), ..self }
    }

    /// The same, partial.
    fn partial(self) -> Self {
        Expression { is_partial: true, ..self }
    }

    /// A name, or an element of an array.
    pub fn atom(text: impl Into<String>, kind: Kind) -> Self {
        Expression::new(text.into(), Binding::Atom, kind, 0)
    }

    /// A number that is known.
    pub fn number(value: f64) -> Self {
        let text = number(value);
        let binding = if text.starts_with('-') { Binding::Unary } else { Binding::Atom };
        Expression { known: Some(value), ..Expression::new(text, binding, Kind::Real, 0) }
    }

    /// Text, in parentheses if its precedence is lower than this.
    fn at_least(&self, binding: Binding) -> String {
        if self.binding >= binding { self.text.clone() } else { format!("({})", self.text) }
    }

    /// Text, in parentheses unless its precedence is higher than this.
    fn above(&self, binding: Binding) -> String {
        if self.binding > binding { self.text.clone() } else { format!("({})", self.text) }
    }

    fn is_whole_number(&self) -> bool {
        self.known.is_some_and(|value| value == value.trunc() && value.abs() < 1e9)
    }

    /// Expression as a `real`.
    pub fn real(&self) -> Self {
        match self.kind {
            Kind::Real => self.clone(),
            Kind::Whole => {
                let text = format!("(real){}", self.at_least(Binding::Unary));
                Expression::new(text, Binding::Unary, Kind::Real, self.size).made_of(&[self])
            }
        }
    }

    /// Expression as an `int`.
    pub fn whole(&self) -> Self {
        match (self.kind, self.known) {
            (Kind::Whole, _) => self.clone(),
            (_, Some(value)) if self.is_whole_number() => {
                let binding = if value < 0.0 { Binding::Unary } else { Binding::Atom };
                Expression::new(format!("{}", value as i64), binding, Kind::Whole, 0)
            }
            _ => {
                let text = format!("whole({})", self.text);
                Expression::new(text, Binding::Atom, Kind::Whole, self.size + 1).made_of(&[self])
            }
        }
    }

    /// Expression as a condition.
    pub fn condition(&self) -> Self {
        match (self.kind, self.known) {
            (Kind::Whole, _) => self.clone(),
            (_, Some(value)) => Expression::atom(if value != 0.0 { "1" } else { "0" }, Kind::Whole),
            _ => {
                let text = format!("{} != R(0.0)", self.above(Binding::Equality));
                Expression::new(text, Binding::Equality, Kind::Whole, self.size + 1).made_of(&[self])
            }
        }
    }

    /// A call of the runtime's function of one number.
    pub fn of_one(name: &str, x: &Self) -> Self {
        let x = x.real();
        Expression::new(format!("{name}({})", x.text), Binding::Atom, Kind::Real, x.size + 1).made_of(&[&x])
    }

    /// A call of a function of one number.
    pub fn unary(function: Unary, x: &Self) -> Self {
        let (x, size) = (x.real(), x.size + 1);
        let call = |name: &str| Expression::of_one(name, &x);
        let of_library = |name: &str| call(&format!("F({name})"));
        match function {
            Unary::Neg => {
                let operand =
                    if x.text.starts_with('-') { format!("({})", x.text) } else { x.at_least(Binding::Unary) };
                Expression::new(format!("-{operand}"), Binding::Unary, Kind::Real, size).made_of(&[&x])
            }
            Unary::Recip => Expression::binary(Binary::Div, &Expression::number(1.0), &x),
            Unary::Signum => call("sign"),
            Unary::Sin => of_library("sin"),
            Unary::Cos => of_library("cos"),
            Unary::Tan => of_library("tan").partial(),
            Unary::Cosh => of_library("cosh").partial(),
            Unary::Sinh => of_library("sinh").partial(),
            Unary::Tanh => of_library("tanh"),
            Unary::Exp => of_library("exp").partial(),
            Unary::Ln => of_library("log").partial(),
            Unary::Ln1p => of_library("log1p").partial(),
            Unary::Sqrt => of_library("sqrt").partial(),
            Unary::Atan => of_library("atan"),
            Unary::Abs => of_library("fabs"),
            Unary::Floor => of_library("floor"),
            Unary::Round => of_library("round"),
            Unary::Wrap => call("wrapped"),
        }
    }

    /// An operation on two numbers. Operations are carried out in the order of the recording: numbers that are rounded don't
    /// associate.
    pub fn binary(operation: Binary, a: &Self, b: &Self) -> Self {
        let (a, b) = (a.real(), b.real());
        let size = a.size + b.size + 1;
        let joined = |sign: &str, binding| {
            let text = format!("{} {sign} {}", a.at_least(binding), b.above(binding));
            Expression::new(text, binding, Kind::Real, size).made_of(&[&a, &b])
        };
        match operation {
            Binary::Add => joined("+", Binding::Sum),
            Binary::Sub => joined("-", Binding::Sum),
            Binary::Mul => joined("*", Binding::Product),
            Binary::Div if b.known.is_some_and(|divisor| divisor.abs() >= 1e-30) => joined("/", Binding::Product),
            Binary::Div => joined("/", Binding::Product).partial(),
            Binary::Pow => {
                Expression::new(format!("F(pow)({}, {})", a.text, b.text), Binding::Atom, Kind::Real, size).partial()
            }
        }
    }

    /// A power with a whole exponent; small ones are written out, in the order in which squares are multiplied.
    pub fn powi(x: &Self, exponent: i32) -> Self {
        let (x, size) = (x.real(), x.size + 2);
        let factor = x.above(Binding::Product);
        match exponent {
            1 => x,
            2 => Expression::new(format!("{factor} * {factor}"), Binding::Product, Kind::Real, size).made_of(&[&x]),
            _ => Expression::new(format!("power({}, {exponent})", x.text), Binding::Atom, Kind::Real, size).partial(),
        }
    }

    /// A power.
    pub fn powf(x: &Self, exponent: f64) -> Self {
        Expression::binary(Binary::Pow, x, &Expression::number(exponent))
    }

    /// A comparison; of whole numbers, as such.
    pub fn compare(comparison: Comparison, a: &Self, b: &Self) -> Self {
        let is_whole = |e: &Self| e.kind == Kind::Whole || e.is_whole_number();
        let whole = is_whole(a) && is_whole(b) && (a.kind == Kind::Whole || b.kind == Kind::Whole);
        let [a, b] = [a, b].map(|e| if whole { e.whole() } else { e.real() });
        let (sign, binding) = match comparison {
            Comparison::Below => ("<", Binding::Relation),
            Comparison::AtMost => ("<=", Binding::Relation),
            Comparison::Equals => ("==", Binding::Equality),
        };
        // Compilers ask for parentheses around comparisons of comparisons.
        let text = format!("{} {sign} {}", a.above(Binding::Relation), b.above(Binding::Relation));
        Expression::new(text, binding, Kind::Whole, a.size + b.size + 1).made_of(&[&a, &b])
    }

    /// True if a condition doesn't hold.
    pub fn not(a: &Self) -> Self {
        let a = a.condition();
        let text = format!("!{}", a.at_least(Binding::Unary));
        Expression::new(text, Binding::Unary, Kind::Whole, a.size + 1).made_of(&[&a])
    }

    /// True if both conditions hold.
    pub fn and(a: &Self, b: &Self) -> Self {
        let (a, b) = (a.condition(), b.condition());
        let text = format!("{} && {}", a.at_least(Binding::And), b.at_least(Binding::And));
        Expression::new(text, Binding::And, Kind::Whole, a.size + b.size + 1).made_of(&[&a, &b])
    }

    /// True if one condition holds; what both hold in is in parentheses, as compilers ask for.
    pub fn or(a: &Self, b: &Self) -> Self {
        let (a, b) = (a.condition(), b.condition());
        let side = |e: &Self| if e.binding == Binding::Or { e.text.clone() } else { e.above(Binding::And) };
        let text = format!("{} || {}", side(&a), side(&b));
        Expression::new(text, Binding::Or, Kind::Whole, a.size + b.size + 1).made_of(&[&a, &b])
    }

    /// One of two.
    pub fn select(condition: &Self, yes: &Self, no: &Self) -> Self {
        let is_flag = |e: &Self| e.known.is_some_and(|value| value == 0.0 && value.is_sign_positive() || value == 1.0);
        let fits = |e: &Self| e.kind == Kind::Whole || is_flag(e);
        let kind = if fits(yes) && fits(no) && (yes.kind == Kind::Whole || no.kind == Kind::Whole) {
            Kind::Whole
        } else {
            Kind::Real
        };
        let condition = condition.condition();
        let [yes, no] = [yes, no].map(|e| if kind == Kind::Whole { e.whole() } else { e.real() });
        let size = condition.size + yes.size + no.size + 1;
        let part = |e: &Self| e.above(Binding::Selection);
        let text = format!("{} ? {} : {}", part(&condition), part(&yes), part(&no));
        Expression::new(text, Binding::Selection, kind, size).made_of(&[&condition, &yes, &no])
    }

    /// One of two whole numbers, where both are.
    pub fn whole_selection(condition: &Self, yes: &Self, no: &Self) -> Option<Self> {
        let is_whole = |e: &Self| e.kind == Kind::Whole || e.is_whole_number();
        (is_whole(yes) && is_whole(no)).then(|| {
            let [yes, no] = [yes.whole(), no.whole()];
            let whole = Expression::select(condition, &yes, &no);
            Expression { kind: Kind::Whole, ..whole }
        })
    }

    /// A call of a function of the runtime.
    pub fn call(name: &str, arguments: &[Self]) -> Self {
        let size = arguments.iter().map(|argument| argument.size).sum::<usize>() + 1;
        let arguments: Vec<String> = arguments.iter().map(|argument| argument.real().text).collect();
        Expression::new(format!("{name}({})", arguments.join(", ")), Binding::Atom, Kind::Real, size).partial()
    }
}

/// A number in C: the shortest digits that give exactly this number.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        return "(real)NAN".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { "(real)INFINITY" } else { "-(real)INFINITY" }.to_owned();
    }
    let sign = if value.is_sign_negative() { "-" } else { "" };
    let magnitude = value.abs();
    // Numbers that float can't hold are the largest and the smallest that it can.
    let wrap = match magnitude {
        m if m > f64::from(f32::MAX) => "LARGE",
        m if m > 0.0 && m < f64::from(f32::MIN_POSITIVE) => "SMALL",
        _ => "R",
    };
    format!("{sign}{wrap}({magnitude:?})")
}

#[cfg(test)]
mod tests {
    use super::{Comparison, Expression, Kind, number};

    #[test]
    fn numbers_that_float_cannot_hold_are_marked_in_c() {
        let cases = [
            (0.1, "R(0.1)"),
            (-2.5, "-R(2.5)"),
            (-0.0, "-R(0.0)"),
            (f64::from(f32::MAX), "R(3.4028234663852886e38)"),
            (3.5e38, "LARGE(3.5e38)"),
            (-1e300, "-LARGE(1e300)"),
            (f64::from(f32::MIN_POSITIVE), "R(1.1754943508222875e-38)"),
            (1e-38, "SMALL(1e-38)"),
            (f64::INFINITY, "(real)INFINITY"),
            (f64::NEG_INFINITY, "-(real)INFINITY"),
            (f64::NAN, "(real)NAN"),
        ];
        cases.iter().for_each(|(value, text)| assert_eq!(number(*value), *text));
    }

    #[test]
    fn only_whole_numbers_are_compared_as_such() {
        let below = |value: f64| {
            let n = Expression::atom("n", Kind::Whole);
            Expression::compare(Comparison::Below, &n, &Expression::number(value)).text
        };
        let texts = [2.0, -3.0, 0.5, 3e9].map(below);
        assert_eq!(texts, ["n < 2", "n < -3", "(real)n < R(0.5)", "(real)n < R(3000000000.0)"]);
    }
}
