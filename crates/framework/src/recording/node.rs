//! The scalar that records.

use std::cell::RefCell;
use std::fmt;
use std::mem::ManuallyDrop;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, DivAssign, Mul, MulAssign, Neg, Not, Sub, SubAssign};

use super::tape::{Binary, Comparison, Node, Note, Operation, Tape, Unary};
use crate::error::Invalid;
use crate::scalar::{Changed, Flag, Merge, MessageLog, Opaque, Scalar};

thread_local! {
    /// The tape of the recording that runs in this thread: arithmetic has no other way to it. Between recordings it is empty,
    /// so that nothing is lost where it isn't dropped; a destructor would keep a library in its host until the thread ends.
    static TAPE: RefCell<ManuallyDrop<Tape>> = RefCell::new(ManuallyDrop::new(Tape::default()));
}

/// Records a function's operations, on a tape of its own that begins with memory for this number of operations.
pub(crate) fn on_tape<T>(operations: usize, record: impl FnOnce() -> T) -> (T, Tape) {
    let exchanged = |tape: Tape| ManuallyDrop::into_inner(TAPE.replace(ManuallyDrop::new(tape)));
    let mut tape = Tape::default();
    tape.reserve(operations);
    let before = exchanged(tape);
    let result = record();
    (result, exchanged(before))
}

fn add(operation: Operation) -> Node {
    TAPE.with_borrow_mut(|tape| tape.add(operation))
}

/// A number, represented by the node that computes it.
#[derive(Debug, Clone, Copy)]
pub struct Recorded(pub(super) Node);

/// A condition, represented by the node that computes it.
#[derive(Debug, Clone, Copy)]
pub struct Condition(pub(super) Node);

/// True if they are the same number, as nalgebra asks of constants. Other numbers aren't known yet: the tape notes that
/// equations looked at them.
impl PartialEq for Recorded {
    fn eq(&self, other: &Self) -> bool {
        TAPE.with_borrow_mut(|tape| match (tape.constant(self.0), tape.constant(other.0)) {
            (Some(one), Some(other)) => one == other,
            _ => {
                tape.looked = true;
                self.0 == other.0
            }
        })
    }
}

impl Recorded {
    /// The node that computes it.
    pub fn node(self) -> Node {
        self.0
    }

    /// The condition that it isn't 0.
    pub(crate) fn holds(self) -> Condition {
        Condition(self.0)
    }

    pub(crate) fn of(operation: Operation) -> Self {
        Recorded(add(operation))
    }

    fn unary(self, function: Unary) -> Self {
        Recorded::of(Operation::Unary(function, self.0))
    }

    fn binary(self, operation: Binary, other: Self) -> Self {
        Recorded::of(Operation::Binary(operation, self.0, other.0))
    }

    fn compare(self, comparison: Comparison, other: Self) -> Condition {
        Condition(add(Operation::Compare(comparison, self.0, other.0)))
    }
}

/// A reference within a message, which the number replaces when the message is sent.
impl fmt::Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{node {}}}", self.0.0)
    }
}

impl From<f64> for Recorded {
    fn from(value: f64) -> Self {
        Recorded::of(Operation::Constant(value.to_bits()))
    }
}

macro_rules! arithmetic {
    ($($trait:ident $method:ident $assign_trait:ident $assign:ident),*) => {$(
        impl $trait for Recorded {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                self.binary(Binary::$trait, other)
            }
        }
        impl $trait<f64> for Recorded {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                self.binary(Binary::$trait, other.into())
            }
        }
        impl $assign_trait for Recorded {
            fn $assign(&mut self, other: Self) {
                *self = self.$method(other);
            }
        }
        impl $assign_trait<f64> for Recorded {
            fn $assign(&mut self, other: f64) {
                *self = self.$method(other);
            }
        }
    )*};
}
arithmetic!(Add add AddAssign add_assign, Sub sub SubAssign sub_assign, Mul mul MulAssign mul_assign, Div div DivAssign div_assign);

impl Neg for Recorded {
    type Output = Self;
    fn neg(self) -> Self {
        self.unary(Unary::Neg)
    }
}

impl num_traits::Zero for Recorded {
    fn zero() -> Self {
        0.0.into()
    }
    fn is_zero(&self) -> bool {
        *self == Self::zero()
    }
}

impl num_traits::One for Recorded {
    fn one() -> Self {
        1.0.into()
    }
}

impl From<bool> for Condition {
    fn from(holds: bool) -> Self {
        Condition(add(Operation::Constant(f64::from(u8::from(holds)).to_bits())))
    }
}

impl Not for Condition {
    type Output = Self;
    fn not(self) -> Self {
        Condition(add(Operation::Not(self.0)))
    }
}

impl BitAnd for Condition {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Condition(add(Operation::And(self.0, other.0)))
    }
}

impl BitOr for Condition {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Condition(add(Operation::Or(self.0, other.0)))
    }
}

impl Flag for Condition {}

impl Condition {
    /// The node that computes it.
    pub fn node(self) -> Node {
        self.0
    }
}

macro_rules! functions {
    ($($name:ident $function:ident),*) => {$(
        fn $name(self) -> Self {
            self.unary(Unary::$function)
        }
    )*};
}

impl Scalar for Recorded {
    type Flag = Condition;
    type Integer = Recorded;

    functions!(
        sin Sin, cos Cos, tan Tan, cosh Cosh, tanh Tanh, exp Exp, ln Ln, ln_1p Ln1p, sqrt Sqrt, atan Atan, recip Recip,
        abs Abs, signum Signum, floor Floor, round Round, wrap Wrap
    );
    fn powi(self, exponent: i32) -> Self {
        Recorded::of(Operation::Powi(self.0, exponent))
    }
    fn powf(self, exponent: f64) -> Self {
        Recorded::of(Operation::Powf(self.0, exponent.to_bits()))
    }
    fn powd(self, exponent: Self) -> Self {
        self.binary(Binary::Pow, exponent)
    }
    fn below(self, other: Self) -> Condition {
        self.compare(Comparison::Below, other)
    }
    fn at_most(self, other: Self) -> Condition {
        self.compare(Comparison::AtMost, other)
    }
    fn equals(self, other: Self) -> Condition {
        self.compare(Comparison::Equals, other)
    }
    fn from_integer(integer: Self) -> Self {
        integer
    }
    fn to_integer(self) -> Self {
        self
    }
    fn integer(value: i32) -> Self {
        f64::from(value).into()
    }
    fn same(one: Self, other: Self) -> Condition {
        one.equals(other)
    }
    fn select_integer(flag: Condition, yes: Self, no: Self) -> Self {
        Self::select(flag, yes, no)
    }
    fn to_text(self) -> String {
        self.to_string()
    }
    fn rounded(self) -> String {
        format!("{{node {} rounded}}", self.0.0)
    }
    fn rounded_at_most(self) -> String {
        format!("{{node {} at most}}", self.0.0)
    }
    fn rounded_at_least(self) -> String {
        format!("{{node {} at least}}", self.0.0)
    }
    fn scientific_at_most(self, digits: usize) -> String {
        format!("{{node {} .{digits}c}}", self.0.0)
    }
    fn scientific(self, digits: usize) -> String {
        format!("{{node {} .{digits}e}}", self.0.0)
    }
    fn fixed(self, digits: usize) -> String {
        format!("{{node {} .{digits}f}}", self.0.0)
    }
    fn select(flag: Condition, yes: Self, no: Self) -> Self {
        Recorded::of(Operation::Select(flag.0, yes.0, no.0))
    }
    fn branch<T: Merge<Self>>(flag: Condition, yes: impl FnOnce() -> T, no: impl FnOnce() -> T) -> T {
        T::merge(flag, yes(), no())
    }
    fn element(values: &[Self], place: Self) -> Self {
        let reached = |found, (k, &value): (usize, &Self)| Self::select(place.at_least(counted(k)), value, found);
        values.iter().enumerate().skip(1).fold(values[0], reached)
    }
    fn put_element(values: &mut [Self], place: Self, value: Self) {
        let last = values.len() - 1;
        for (k, at) in values.iter_mut().enumerate() {
            let reached = if k == 0 { true.into() } else { place.at_least(counted(k)) };
            let passed = if k == last { false.into() } else { place.at_least(counted(k + 1)) };
            *at = Self::select(reached & !passed, value, *at);
        }
    }
    fn iterate(state: &mut [Self], most: usize, goes_on: impl Fn(&[Self]) -> Condition, step: impl Fn(&mut [Self])) {
        let start: Vec<Node> = state.iter().map(|number| number.0).collect();
        let open = TAPE.with_borrow_mut(|tape| tape.begin_iteration(start.len()));
        open.state().zip(&mut *state).for_each(|(node, number)| *number = Recorded(node));
        let goes_on = goes_on(state).0;
        step(state);
        let next = state.iter().map(|number| number.0).collect();
        let reached = TAPE.with_borrow_mut(|tape| tape.end_iteration(open, (goes_on, next), start, most));
        reached.into_iter().zip(state).for_each(|(node, number)| *number = Recorded(node));
    }
    fn opaque(function: Opaque, arguments: &[Self]) -> Self {
        Recorded::of(Operation::Opaque(function, arguments.iter().map(|argument| argument.0).collect()))
    }

    fn carry_out<P: Changed<Self>>(flag: Condition, place: &mut P, change: impl FnOnce(&mut P)) {
        let (reals, integers) = place.copied();
        under(flag, || change(place));
        let (now, integers_now) = place.places();
        for (now, before) in now.iter_mut().zip(reals).chain(integers_now.iter_mut().zip(integers)) {
            *now = Self::select(flag, *now, before);
        }
    }
    fn log(flag: Condition, log: &mut MessageLog, category: &'static str, text: impl FnOnce() -> String) {
        if log.is_unheard() {
            return;
        }
        let text = log.worded(text());
        note(flag, |condition| Note::Message { condition, category, text });
    }
    fn refuse(flag: Condition, log: &mut MessageLog, reason: impl FnOnce() -> Invalid) {
        if log.is_unheard() {
            return;
        }
        let reason = reason().reworded(|text| log.worded(text));
        note(flag, |condition| Note::Refusal { condition, reason });
    }
}

/// A place among values.
fn counted(place: usize) -> Recorded {
    Recorded::from(place as f64)
}

/// Records what happens where a condition holds.
fn under(flag: Condition, record: impl FnOnce()) {
    TAPE.with_borrow_mut(|tape| tape.conditions.push(flag.0));
    record();
    TAPE.with_borrow_mut(|tape| tape.conditions.pop());
}

fn note(flag: Condition, make: impl FnOnce(Node) -> Note) {
    TAPE.with_borrow_mut(|tape| {
        let conditions = tape.conditions.clone();
        let condition = conditions.into_iter().fold(flag.0, |all, one| tape.add(Operation::And(one, all)));
        if tape.constant(condition) != Some(0.0) {
            let note = make(condition);
            tape.notes.push(note);
        }
    });
}
