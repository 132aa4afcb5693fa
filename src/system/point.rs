//! Full access to an instance's values, for what happens outside the equations.

use std::ops::{Index, IndexMut};

use nalgebra::{DMatrixView, DMatrixViewMut};

use super::declaration::Warning;
use super::values::{Class, DiscreteHandle, Handle, MatrixOf, Offsets, ScalarOf, Span, Values, VectorOf};

/// A message of a system, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Log category.
    pub category: &'static str,
    /// The text.
    pub text: String,
}

/// Messages that wait to be logged. Empty, it holds no memory.
pub type MessageLog = Vec<Message>;

/// All values of an instance at one point in time, to read and write.
#[derive(Debug)]
pub struct Point<'a> {
    pub(super) reals: &'a mut [f64],
    pub(super) integers: &'a mut [i32],
    pub(super) offsets: &'a Offsets,
    pub(super) log: &'a mut MessageLog,
}

impl<'a> Point<'a> {
    pub(crate) fn new(
        reals: &'a mut [f64],
        integers: &'a mut [i32],
        offsets: &'a Offsets,
        log: &'a mut MessageLog,
    ) -> Point<'a> {
        Point { reals, integers, offsets, log }
    }

    fn range(&self, span: Span) -> std::ops::Range<usize> {
        let start = self.offsets.real[span.section as usize] + span.start;
        start..start + span.len
    }

    /// The values to read, as equations see them.
    pub fn values(&self) -> Values<'_, f64> {
        Values { reals: self.reals, integers: self.integers, offsets: self.offsets }
    }

    /// A vector of a size known when compiling.
    pub fn array<C: Class, const N: usize>(&self, vector: VectorOf<C>) -> [f64; N] {
        self.values().array(vector)
    }

    /// A matrix.
    pub fn matrix<C: Class>(&self, matrix: MatrixOf<C>) -> DMatrixView<'_, f64> {
        self.values().matrix(matrix)
    }

    /// A matrix, to write.
    pub fn matrix_mut<C: Class>(&mut self, matrix: MatrixOf<C>) -> DMatrixViewMut<'_, f64> {
        let range = self.range(matrix.span());
        DMatrixViewMut::from_slice(&mut self.reals[range], matrix.shape().0, matrix.shape().1)
    }

    /// Copies all values of one handle to another of the same size.
    ///
    /// # Panics
    /// When their sizes differ.
    pub fn copy(&mut self, from: impl Handle, to: impl Handle) {
        let (from, to) = (self.range(from.span()), self.range(to.span()));
        assert_eq!(from.len(), to.len(), "copied handles have the same size");
        self.reals.copy_within(from, to.start);
    }

    /// Writes all values of a handle.
    ///
    /// # Panics
    /// When the number of values isn't the handle's.
    pub fn set(&mut self, handle: impl Handle, values: impl AsRef<[f64]>) {
        let range = self.range(handle.span());
        self.reals[range].copy_from_slice(values.as_ref());
    }

    /// An integer, Boolean or choice.
    pub fn get<H: DiscreteHandle>(&self, handle: H) -> H::Value {
        self.values().get(handle)
    }

    /// Writes an integer, Boolean or choice.
    pub fn put<H: DiscreteHandle>(&mut self, handle: H, value: H::Value) {
        let (section, place) = handle.place();
        self.integers[self.offsets.integer[section as usize] + place] = H::encode(value);
    }

    /// Logs a warning the first time that it is given in a simulation.
    pub fn warn(&mut self, warning: Warning, text: impl FnOnce() -> String) {
        let flag = self.offsets.integer[super::Section::Memory as usize] + warning.flag;
        if self.integers[flag] == 0 {
            self.integers[flag] = 1;
            self.log.push(Message { category: warning.category, text: text() });
        }
    }

    /// Logs a message in a warning's category each time.
    pub fn say(&mut self, warning: Warning, text: String) {
        self.log.push(Message { category: warning.category, text });
    }
}

impl<C: Class> Index<ScalarOf<C>> for Point<'_> {
    type Output = f64;
    fn index(&self, handle: ScalarOf<C>) -> &f64 {
        &self.reals[self.range(handle.span()).start]
    }
}

impl<C: Class> IndexMut<ScalarOf<C>> for Point<'_> {
    fn index_mut(&mut self, handle: ScalarOf<C>) -> &mut f64 {
        let place = self.range(handle.span()).start;
        &mut self.reals[place]
    }
}

impl<C: Class> Index<VectorOf<C>> for Point<'_> {
    type Output = [f64];
    fn index(&self, handle: VectorOf<C>) -> &[f64] {
        &self.reals[self.range(handle.span())]
    }
}

impl<C: Class> IndexMut<VectorOf<C>> for Point<'_> {
    fn index_mut(&mut self, handle: VectorOf<C>) -> &mut [f64] {
        let range = self.range(handle.span());
        &mut self.reals[range]
    }
}
