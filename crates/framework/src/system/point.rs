//! Full access to an instance's values, for what happens outside the equations.

use std::ops::{Index, IndexMut};

use nalgebra::{DMatrixView, DMatrixViewMut};

use super::declaration::Warning;
use super::erased::Equations;
use super::names::Named;
use super::values::{Class, DiscreteHandle, Handle, MatrixOf, Offsets, ScalarOf, Span, Values, VectorOf};
use crate::error::Invalid;
use crate::scalar::{Changed, MessageLog, Scalar};

/// All values of an instance at one point in time, to read and write.
#[derive(Debug)]
pub struct Point<'a, S: Scalar = f64> {
    pub(super) reals: &'a mut [S],
    pub(super) integers: &'a mut [S::Integer],
    pub(super) offsets: &'a Offsets,
    pub(super) log: &'a mut MessageLog,
}

impl<'a, S: Scalar> Point<'a, S> {
    pub(crate) fn new(
        reals: &'a mut [S],
        integers: &'a mut [S::Integer],
        offsets: &'a Offsets,
        log: &'a mut MessageLog,
    ) -> Point<'a, S> {
        Point { reals, integers, offsets, log }
    }

    fn range(&self, span: Span) -> std::ops::Range<usize> {
        let start = self.offsets.real[span.section as usize] + span.start;
        start..start + span.len
    }

    /// Writes signals and derivatives of the whole point.
    pub(crate) fn evaluate(&mut self, equations: &dyn Equations<S>, t: S) {
        equations.evaluate(t, self.reals, self.integers, self.offsets);
    }

    /// Writes signals only, of a part that begins elsewhere.
    pub(super) fn outputs_of(&mut self, equations: &dyn Equations<S>, t: S, offsets: &Offsets) {
        equations.outputs(t, self.reals, self.integers, offsets);
    }

    /// The values to read, as equations see them.
    pub fn values(&self) -> Values<'_, S> {
        Values { reals: self.reals, integers: self.integers, offsets: self.offsets }
    }

    /// See [`Values::name`].
    pub fn name(&self, handle: impl Named) -> String {
        self.offsets.name(&handle)
    }

    /// A vector of a size known when compiling.
    pub fn array<C: Class, const N: usize>(&self, vector: VectorOf<C>) -> [S; N] {
        self.values().array(vector)
    }

    /// A matrix.
    pub fn matrix<C: Class>(&self, matrix: MatrixOf<C>) -> DMatrixView<'_, S> {
        self.values().matrix(matrix)
    }

    /// A matrix, to write.
    pub fn matrix_mut<C: Class>(&mut self, matrix: MatrixOf<C>) -> DMatrixViewMut<'_, S> {
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
    pub fn set(&mut self, handle: impl Handle, values: impl AsRef<[S]>) {
        let range = self.range(handle.span());
        self.reals[range].copy_from_slice(values.as_ref());
    }

    /// An integer, Boolean or choice.
    pub fn get<H: DiscreteHandle>(&self, handle: H) -> H::Value<S> {
        self.values().get(handle)
    }

    /// Writes an integer, Boolean or choice.
    pub fn put<H: DiscreteHandle>(&mut self, handle: H, value: H::Value<S>) {
        let (section, place) = handle.place();
        self.integers[self.offsets.integer[section as usize] + place] = H::encode::<S>(value);
    }

    /// Carries out a change where a condition holds.
    pub fn when(&mut self, flag: S::Flag, change: impl FnOnce(&mut Self)) {
        S::carry_out(flag, self, change);
    }

    /// Logs a warning the first time that it is given in a simulation.
    pub fn warn(&mut self, warning: Warning, text: impl FnOnce(&Values<S>) -> String) {
        let flag = self.offsets.integer[super::Section::Memory as usize] + warning.flag;
        let is_first = S::same(self.integers[flag], S::integer(0));
        self.when(is_first, |v| {
            v.integers[flag] = S::integer(1);
            v.warn_each_time(warning, text);
        });
    }

    /// Logs a message in a warning's category each time.
    pub fn warn_each_time(&mut self, warning: Warning, text: impl FnOnce(&Values<S>) -> String) {
        let values = Values { reals: self.reals, integers: self.integers, offsets: self.offsets };
        S::log(true.into(), self.log, warning.category, || text(&values));
    }

    /// Refuses a number that isn't below another.
    pub fn require_below<C: Class, D: Class>(&mut self, low: ScalarOf<C>, high: ScalarOf<D>) {
        let is_below = self[low].below(self[high]);
        self.require_order(is_below, "must be below", low, high);
    }

    /// Refuses a number that is above another.
    pub fn require_at_most<C: Class, D: Class>(&mut self, low: ScalarOf<C>, high: ScalarOf<D>) {
        let is_at_most = self[low].at_most(self[high]);
        self.require_order(is_at_most, "must not be above", low, high);
    }

    fn require_order<C: Class, D: Class>(&mut self, holds: S::Flag, must: &str, low: ScalarOf<C>, high: ScalarOf<D>) {
        self.refuse(!holds, |v| {
            let allowed = format!("{must} {} = {}", v.name(high), v[high].to_text());
            Invalid::new(v.name(low), v[low].to_text(), allowed)
        });
    }

    /// Refuses a request, e.g. a start, under a condition.
    pub fn refuse(&mut self, flag: S::Flag, reason: impl FnOnce(&Values<S>) -> Invalid) {
        let values = Values { reals: self.reals, integers: self.integers, offsets: self.offsets };
        S::refuse(flag, self.log, || reason(&values));
    }
}

impl<S: Scalar> Changed<S> for Point<'_, S> {
    fn copied(&self) -> (Vec<S>, Vec<S::Integer>) {
        (self.reals.to_vec(), self.integers.to_vec())
    }
    fn places(&mut self) -> (&mut [S], &mut [S::Integer]) {
        (self.reals, self.integers)
    }
}

impl<S: Scalar, C: Class> Index<ScalarOf<C>> for Point<'_, S> {
    type Output = S;
    fn index(&self, handle: ScalarOf<C>) -> &S {
        &self.reals[self.range(handle.span()).start]
    }
}

impl<S: Scalar, C: Class> IndexMut<ScalarOf<C>> for Point<'_, S> {
    fn index_mut(&mut self, handle: ScalarOf<C>) -> &mut S {
        let place = self.range(handle.span()).start;
        &mut self.reals[place]
    }
}

impl<S: Scalar, C: Class> Index<VectorOf<C>> for Point<'_, S> {
    type Output = [S];
    fn index(&self, handle: VectorOf<C>) -> &[S] {
        &self.reals[self.range(handle.span())]
    }
}

impl<S: Scalar, C: Class> IndexMut<VectorOf<C>> for Point<'_, S> {
    fn index_mut(&mut self, handle: VectorOf<C>) -> &mut [S] {
        let range = self.range(handle.span());
        &mut self.reals[range]
    }
}
