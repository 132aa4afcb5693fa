//! Unknowns of a model with structure: which entry each is, and the matrices of a vector of them. All of it is scaled.

use nalgebra::DMatrix;

use crate::data::Scaling;
use crate::structure::{Entries, Entry};

/// Place of an unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    A(usize, usize),
    B(usize, usize),
    /// A row of d, and the record.
    D(usize, usize),
}

/// An unknown with its sign: 1, −1, or 0 where it may have any.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unknown {
    pub place: Place,
    pub sign: f64,
}

/// x' = A x + B u + d of each record, time in samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Continuous {
    pub a: DMatrix<f64>,
    pub b: DMatrix<f64>,
    /// A column a record.
    pub d: DMatrix<f64>,
}

/// The unknowns of (A, B, d), in the order of rows, and what is known.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    pub n: usize,
    pub m: usize,
    pub unknowns: Vec<Unknown>,
    known: Continuous,
}

impl Layout {
    pub fn new(entries: &Entries, scaling: &Scaling, records: usize) -> Self {
        let (n, m) = (scaling.x.len(), scaling.u.len());
        let known = Continuous { a: DMatrix::zeros(n, n), b: DMatrix::zeros(n, m), d: DMatrix::zeros(n, records) };
        let mut layout = Layout { n, m, unknowns: Vec::new(), known };
        for i in 0..n {
            (0..n).for_each(|j| layout.add(Place::A(i, j), entries.a[i][j], scaling));
        }
        for i in 0..n {
            (0..m).for_each(|j| layout.add(Place::B(i, j), entries.b[i][j], scaling));
        }
        for record in 0..records {
            (0..n).for_each(|i| layout.add(Place::D(i, record), entries.d[i], scaling));
        }
        layout
    }

    fn add(&mut self, place: Place, entry: Entry, scaling: &Scaling) {
        let sign = match entry {
            Entry::Known(value) => {
                *self.known.at(place) = value / factor(place, scaling);
                return;
            }
            Entry::Free => 0.0,
            Entry::Positive => 1.0,
            Entry::Negative => -1.0,
        };
        self.unknowns.push(Unknown { place, sign });
    }

    pub fn count(&self) -> usize {
        self.unknowns.len()
    }

    /// The matrices of a vector of unknowns.
    pub fn matrices(&self, p: &[f64]) -> Continuous {
        let mut model = self.known.clone();
        for (unknown, value) in self.unknowns.iter().zip(p) {
            *model.at(unknown.place) = *value;
        }
        model
    }

    /// The unknowns of matrices, each cut at 0 where it has the wrong sign.
    pub fn unknowns_of(&self, model: &Continuous) -> Vec<f64> {
        let value = |unknown: &Unknown| {
            let value = model.get(unknown.place);
            if unknown.sign * value < 0.0 { 0.0 } else { value }
        };
        self.unknowns.iter().map(value).collect()
    }

    /// A part of the unknowns; the others are known as a model has them.
    pub fn only(&self, keep: impl Fn(Place) -> bool, model: &Continuous) -> Self {
        let unknowns = self.unknowns.iter().copied().filter(|unknown| keep(unknown.place)).collect();
        Layout { n: self.n, m: self.m, unknowns, known: model.clone() }
    }

    /// A layout in which only these rows of d of each record are unknown.
    pub fn offsets(model: &Continuous, rows: &[usize], records: usize) -> Self {
        let (n, m) = model.b.shape();
        let places = (0..records).flat_map(|record| rows.iter().map(move |row| Place::D(*row, record)));
        let unknowns = places.map(|place| Unknown { place, sign: 0.0 }).collect();
        let of = |i: usize, _| if rows.contains(&i) { 0.0 } else { model.d[(i, 0)] };
        let known = Continuous { d: DMatrix::from_fn(n, records, of), ..model.clone() };
        Layout { n, m, unknowns, known }
    }
}

impl Continuous {
    fn at(&mut self, place: Place) -> &mut f64 {
        match place {
            Place::A(i, j) => &mut self.a[(i, j)],
            Place::B(i, j) => &mut self.b[(i, j)],
            Place::D(i, record) => &mut self.d[(i, record)],
        }
    }

    pub fn get(&self, place: Place) -> f64 {
        match place {
            Place::A(i, j) => self.a[(i, j)],
            Place::B(i, j) => self.b[(i, j)],
            Place::D(i, record) => self.d[(i, record)],
        }
    }

    /// Converts to units of the data, time in s.
    pub fn physical(&self, scaling: &Scaling) -> Self {
        let of = |place: Place| self.get(place) * factor(place, scaling);
        let (n, m) = self.b.shape();
        Continuous {
            a: DMatrix::from_fn(n, n, |i, j| of(Place::A(i, j))),
            b: DMatrix::from_fn(n, m, |i, j| of(Place::B(i, j))),
            d: DMatrix::from_fn(n, self.d.ncols(), |i, record| of(Place::D(i, record))),
        }
    }
}

/// The factor from the scaled entry to that in units of the data.
pub(crate) fn factor(place: Place, scaling: &Scaling) -> f64 {
    let Scaling { x, u, h } = scaling;
    match place {
        Place::A(i, j) => x[i] / (x[j] * h),
        Place::B(i, j) => x[i] / (u[j] * h),
        Place::D(i, _) => x[i] / h,
    }
}
