//! Handles, and the views through which equations see the flat block.

use std::marker::PhantomData;
use std::ops::{Index, IndexMut, Range};

use nalgebra::DMatrixView;
use serde::Serialize;

use super::names::Named;
use super::{Scalar, Section};
use crate::scalar::Changed;

/// Class of a variable in the equations; it decides where in the block the value is.
pub trait Class: Copy + 'static {
    /// Section of the values.
    const SECTION: Section;
}

/// The classes of variables.
pub mod class {
    use super::{Class, Section};

    macro_rules! classes {
        ($($(#[$doc:meta])* $name:ident),*) => {$(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Eq)]
            pub struct $name;
            impl Class for $name {
                const SECTION: Section = Section::$name;
            }
        )*};
    }
    classes! {
        /// A number of the user's: tunable, or fixed for a simulation.
        Parameter,
        /// A value that depends on parameters only; written by `prepare` and `relate`.
        Prepared,
        /// A value from outside.
        Input,
        /// A continuous state; its derivative is written by `derivatives`.
        State,
        /// A value that changes at events only.
        Discrete,
        /// An input of a composite's part.
        Connected,
        /// An output or a local signal; written by `outputs`.
        Signal,
        /// The time derivative of a state.
        Derivative,
        /// Memory of the simulation itself between steps.
        Memory
    }
}

/// Place of a handle's values in its section.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Span {
    /// The section of the block.
    pub section: Section,
    /// First value, relative to the system's own part of the section.
    pub start: usize,
    /// Number of values.
    pub len: usize,
}

impl Span {
    /// The range relative to the section.
    pub fn range(self) -> Range<usize> {
        self.start..self.start + self.len
    }
}

/// Anything that names values of the block.
pub trait Handle {
    /// Place of the values.
    fn span(&self) -> Span;
}

macro_rules! handle {
    ($(#[$doc:meta])* $name:ident { $($field:ident),* }, $len:expr) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub struct $name<C> {
            pub(super) start: usize,
            $(pub(super) $field: usize,)*
            pub(super) class: PhantomData<C>,
        }
        impl<C> Clone for $name<C> {
            fn clone(&self) -> Self {
                *self
            }
        }
        impl<C> Copy for $name<C> {}
        impl<C: Class> Handle for $name<C> {
            fn span(&self) -> Span {
                let len: fn(&Self) -> usize = $len;
                Span { section: C::SECTION, start: self.start, len: len(self) }
            }
        }
    };
}

handle!(
    /// Handle of a single value.
    ScalarOf {}, |_| 1
);
handle!(
    /// Handle of a vector.
    VectorOf { len }, |handle| handle.len
);
handle!(
    /// Handle of a matrix (stored by columns).
    MatrixOf { rows, columns }, |handle| handle.rows * handle.columns
);

impl<C: Class> VectorOf<C> {
    /// The handle of one element, counted from 0.
    pub fn at(self, index: usize) -> ScalarOf<C> {
        assert!(index < self.len, "element {index} of a vector of {}", self.len);
        ScalarOf { start: self.start + index, class: PhantomData }
    }

    /// The handle of some of its elements, counted from 0.
    pub fn part(self, range: Range<usize>) -> Self {
        assert!(range.end <= self.len, "elements {range:?} of a vector of {}", self.len);
        VectorOf { start: self.start + range.start, len: range.len(), class: PhantomData }
    }

    /// Number of elements.
    #[allow(clippy::len_without_is_empty)] // a declared vector is never empty
    pub fn len(self) -> usize {
        self.len
    }
}

impl<C: Class> MatrixOf<C> {
    /// The handle of one element, counted from (0, 0).
    pub fn at(self, row: usize, column: usize) -> ScalarOf<C> {
        assert!(row < self.rows && column < self.columns, "element ({row}, {column}) of a smaller matrix");
        ScalarOf { start: self.start + row + column * self.rows, class: PhantomData }
    }

    /// All its elements, in the order of storage (by columns).
    pub fn elements(self) -> VectorOf<C> {
        VectorOf { start: self.start, len: self.rows * self.columns, class: PhantomData }
    }

    /// Number of rows and of columns.
    pub fn shape(self) -> (usize, usize) {
        (self.rows, self.columns)
    }
}

macro_rules! rate {
    ($($handle:ident { $($field:ident),* }),*) => {$(
        impl $handle<class::State> {
            /// The handle of the time derivative of this state.
            pub fn rate(self) -> $handle<class::Derivative> {
                $handle { start: self.start, $($field: self.$field,)* class: PhantomData }
            }
        }
    )*};
}
rate!(ScalarOf {}, VectorOf { len }, MatrixOf { rows, columns });

/// Handle of a difference e = x − x_m; see [`super::Declaration::difference`].
#[derive(Debug, Clone, Copy)]
pub struct DifferenceOf {
    pub(super) x: VectorOf<class::Input>,
    pub(super) x_m: VectorOf<class::State>,
    pub(super) passed: VectorOf<class::Connected>,
    pub(super) is_passed: BooleanOf<class::Connected>,
}

/// A choice between named items: exported as an enumeration.
pub trait Choice: Copy + 'static {
    /// Name of the type.
    const TYPE: &'static str;
    /// Each item with its name and what it means, in the order of their numbers 1, 2, …
    const ITEMS: &'static [(Self, &'static str, &'static str)];
}

macro_rules! discrete_handle {
    ($(#[$doc:meta])* $name:ident<$($parameter:ident),*>) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub struct $name<$($parameter),*> {
            pub(super) start: usize,
            pub(super) class: PhantomData<($($parameter,)*)>,
        }
        impl<$($parameter),*> Clone for $name<$($parameter),*> {
            fn clone(&self) -> Self {
                *self
            }
        }
        impl<$($parameter),*> Copy for $name<$($parameter),*> {}
    };
}
discrete_handle!(
    /// Handle of an integer.
    IntegerOf<C>
);
discrete_handle!(
    /// Handle of a Boolean.
    BooleanOf<C>
);
discrete_handle!(
    /// Handle of a choice (an enumeration).
    ChoiceOf<C, E>
);

/// The value of a choice: one of the items of `E`.
#[derive(Debug, Clone, Copy)]
pub struct Chosen<S: Scalar, E> {
    number: S::Integer,
    items: PhantomData<E>,
}

impl<S: Scalar, E: Choice> Chosen<S, E> {
    /// True if it is this item.
    pub fn is(self, item: E) -> S::Flag {
        S::same(self.number, S::integer(number_of(item)))
    }
}

impl<S: Scalar<Integer = i32>, E: Choice> Chosen<S, E> {
    /// The item, where values are numbers.
    pub fn item(self) -> E {
        // Numbers outside the items are refused where they enter; the clamp keeps this total.
        let last = E::ITEMS.len() as i32;
        E::ITEMS[(self.number.clamp(1, last) - 1) as usize].0
    }
}

impl<S: Scalar, E: Choice> From<E> for Chosen<S, E> {
    fn from(item: E) -> Self {
        Chosen { number: S::integer(number_of(item)), items: PhantomData }
    }
}

/// The number of an item, counted from 1.
pub(super) fn number_of<E: Choice>(value: E) -> i32 {
    let same = |item: &E| std::mem::discriminant(item) == std::mem::discriminant(&value);
    1 + E::ITEMS.iter().position(|(item, ..)| same(item)).unwrap_or(0) as i32
}

/// A handle into the block of integers, with the type that its value has over a scalar.
pub trait DiscreteHandle: Copy {
    /// The value's type.
    type Value<S: Scalar>;
    /// Section, and place in it.
    fn place(self) -> (Section, usize);
    /// Converts from the stored integer.
    fn decode<S: Scalar>(stored: S::Integer) -> Self::Value<S>;
    /// Converts to the stored integer.
    fn encode<S: Scalar>(value: Self::Value<S>) -> S::Integer;
}

impl<C: Class> DiscreteHandle for IntegerOf<C> {
    type Value<S: Scalar> = S::Integer;
    fn place(self) -> (Section, usize) {
        (C::SECTION, self.start)
    }
    fn decode<S: Scalar>(stored: S::Integer) -> S::Integer {
        stored
    }
    fn encode<S: Scalar>(value: S::Integer) -> S::Integer {
        value
    }
}

impl<C: Class> DiscreteHandle for BooleanOf<C> {
    type Value<S: Scalar> = S::Flag;
    fn place(self) -> (Section, usize) {
        (C::SECTION, self.start)
    }
    fn decode<S: Scalar>(stored: S::Integer) -> S::Flag {
        !S::same(stored, S::integer(0))
    }
    fn encode<S: Scalar>(value: S::Flag) -> S::Integer {
        S::select_integer(value, S::integer(1), S::integer(0))
    }
}

impl<C: Class, E: Choice> DiscreteHandle for ChoiceOf<C, E> {
    type Value<S: Scalar> = Chosen<S, E>;
    fn place(self) -> (Section, usize) {
        (C::SECTION, self.start)
    }
    fn decode<S: Scalar>(stored: S::Integer) -> Chosen<S, E> {
        Chosen { number: stored, items: PhantomData }
    }
    fn encode<S: Scalar>(value: Chosen<S, E>) -> S::Integer {
        value.number
    }
}

/// Begin of each section in a system's own part of the block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Offsets {
    /// Sections of real values.
    pub real: [usize; Section::COUNT],
    /// Sections of integers, Booleans and choices.
    pub integer: [usize; Section::COUNT],
}

/// Values that equations read: parameters, prepared values, inputs, states, discrete values and, in `derivatives`,
/// signals.
#[derive(Debug)]
pub struct Values<'a, S: Scalar> {
    pub(super) reals: &'a [S],
    pub(super) integers: &'a [S::Integer],
    pub(super) offsets: &'a Offsets,
}

impl<S: Scalar> Clone for Values<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: Scalar> Copy for Values<'_, S> {}

impl<'a, S: Scalar> Values<'a, S> {
    pub(crate) fn new(reals: &'a [S], integers: &'a [S::Integer], offsets: &'a Offsets) -> Self {
        Values { reals, integers, offsets }
    }

    fn slice(&self, span: Span) -> &'a [S] {
        let start = self.offsets.real[span.section as usize] + span.start;
        &self.reals[start..start + span.len]
    }

    /// The name of a variable or of one element, for texts that users read: their own, if they gave it one. The text
    /// contains it as a reference until it leaves.
    pub fn name(&self, handle: impl Named) -> String {
        self.offsets.name(&handle)
    }

    /// A vector of a size known when compiling: `let [x1, x2] = v.array(self.x);`
    ///
    /// # Panics
    /// When the vector has another size.
    pub fn array<C: Class, const N: usize>(&self, vector: VectorOf<C>) -> [S; N] {
        self.slice(vector.span()).try_into().expect("a vector's declared size is the size it is read with")
    }

    /// A matrix.
    pub fn matrix<C: Class>(&self, matrix: MatrixOf<C>) -> DMatrixView<'a, S> {
        DMatrixView::from_slice(self.slice(matrix.span()), matrix.rows, matrix.columns)
    }

    /// An element of a difference, counted from 0: where the system is part of a composite that integrates the difference
    /// itself, that very number, without subtracting large ones.
    pub fn difference(&self, of: DifferenceOf, index: usize) -> S {
        let subtracted = || self[of.x.at(index)] - self[of.x_m.at(index)];
        S::branch(self.get(of.is_passed), || self[of.passed.at(index)], subtracted)
    }

    /// An integer, Boolean or choice.
    pub fn get<H: DiscreteHandle>(&self, handle: H) -> H::Value<S> {
        let (section, place) = handle.place();
        H::decode::<S>(self.integers[self.offsets.integer[section as usize] + place])
    }
}

impl<S: Scalar, C: Class> Index<ScalarOf<C>> for Values<'_, S> {
    type Output = S;
    fn index(&self, handle: ScalarOf<C>) -> &S {
        &self.reals[self.offsets.real[C::SECTION as usize] + handle.start]
    }
}

impl<S: Scalar, C: Class> Index<VectorOf<C>> for Values<'_, S> {
    type Output = [S];
    fn index(&self, handle: VectorOf<C>) -> &[S] {
        self.slice(handle.span())
    }
}

/// Values that equations write: one section of the block.
#[derive(Debug)]
pub struct Written<'a, S, C> {
    pub(super) section: &'a mut [S],
    pub(super) class: PhantomData<C>,
}

/// Values that `outputs` writes.
pub type Signals<'a, S> = Written<'a, S, class::Signal>;
/// Values that `derivatives` writes, by the handle of the state.
pub type Rates<'a, S> = Written<'a, S, class::Derivative>;

/// The handles by which a section is written.
pub trait WrittenBy<C> {
    /// Place of the values, relative to the section.
    fn place(&self) -> Range<usize>;
}

macro_rules! written_by {
    ($handle:ident) => {
        impl WrittenBy<class::Signal> for $handle<class::Signal> {
            fn place(&self) -> Range<usize> {
                self.span().range()
            }
        }
        impl WrittenBy<class::Derivative> for $handle<class::State> {
            fn place(&self) -> Range<usize> {
                self.span().range()
            }
        }
    };
}
written_by!(ScalarOf);
written_by!(VectorOf);
written_by!(MatrixOf);

impl<S: Scalar, C> Written<'_, S, C> {
    /// Writes all values of a handle.
    ///
    /// # Panics
    /// When the number of values isn't the handle's.
    pub fn set(&mut self, handle: impl WrittenBy<C>, values: impl AsRef<[S]>) {
        self.section[handle.place()].copy_from_slice(values.as_ref());
    }

    /// Carries out a change where a condition holds.
    pub fn when(&mut self, flag: S::Flag, change: impl FnOnce(&mut Self)) {
        S::carry_out(flag, self, change);
    }

    /// The values of a handle, to write (and read back what was written).
    pub fn slice(&mut self, handle: impl WrittenBy<C>) -> &mut [S] {
        &mut self.section[handle.place()]
    }
}

impl<S: Scalar, C> Changed<S> for Written<'_, S, C> {
    fn copied(&self) -> (Vec<S>, Vec<S::Integer>) {
        (self.section.to_vec(), Vec::new())
    }
    fn places(&mut self) -> (&mut [S], &mut [S::Integer]) {
        (self.section, &mut [])
    }
}

macro_rules! index_written {
    ($class:ty: $scalar:ty, $vector:ty) => {
        impl<S: Scalar> Index<$scalar> for Written<'_, S, $class> {
            type Output = S;
            fn index(&self, handle: $scalar) -> &S {
                &self.section[handle.start]
            }
        }
        impl<S: Scalar> IndexMut<$scalar> for Written<'_, S, $class> {
            fn index_mut(&mut self, handle: $scalar) -> &mut S {
                &mut self.section[handle.start]
            }
        }
        impl<S: Scalar> Index<$vector> for Written<'_, S, $class> {
            type Output = [S];
            fn index(&self, handle: $vector) -> &[S] {
                &self.section[handle.span().range()]
            }
        }
        impl<S: Scalar> IndexMut<$vector> for Written<'_, S, $class> {
            fn index_mut(&mut self, handle: $vector) -> &mut [S] {
                &mut self.section[handle.span().range()]
            }
        }
    };
}
index_written!(class::Signal: ScalarOf<class::Signal>, VectorOf<class::Signal>);
index_written!(class::Derivative: ScalarOf<class::State>, VectorOf<class::State>);
