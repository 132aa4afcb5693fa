//! A first sampled model from measured outputs, from subspaces of block Hankel matrices (PO-MOESP: M. Verhaegen, Identification of
//! the deterministic part of MIMO state space models given in innovations form, Automatica 30 (1994) 61).

use nalgebra::{Complex, DMatrix, DVector};

use crate::data::{Data, Segment};
use crate::linear::{eigenvalues, least_squares, null_vector, symmetric};
use crate::starts::filled;

/// Poles of a larger amount are reflected; a search moves them out again.
const LARGEST_POLE: f64 = 0.999;

/// Rows of a Hankel matrix at a time.
const MOST_ROWS: usize = 4096;

/// x⁺ = F x + G u, y = C x and a constant, scaled.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Discrete {
    pub f: DMatrix<f64>,
    pub g: DMatrix<f64>,
    pub c: DMatrix<f64>,
}

/// The span of the extended observability matrix: left singular vectors, the strongest first, with their singular values.
pub(crate) struct Span {
    vectors: DMatrix<f64>,
    values: Vec<f64>,
}

/// Outputs and inputs of a segment without their means in the record.
fn centred(data: &Data) -> Vec<(DMatrix<f64>, DMatrix<f64>)> {
    let filled: Vec<DMatrix<f64>> = data.segments.iter().map(filled).collect();
    let mean = |record: usize, of: &dyn Fn(usize) -> DMatrix<f64>| {
        let places = (0..data.segments.len()).filter(|s| data.segments[*s].record == record);
        let (mut sum, mut count) = (DVector::zeros(of(0).nrows()), 0.0);
        for segment in places {
            let all = of(segment);
            sum += all.column_sum();
            count += all.ncols() as f64;
        }
        sum / f64::max(count, 1.0)
    };
    let subtract = |mut all: DMatrix<f64>, mean: DVector<f64>| {
        all.column_iter_mut().for_each(|mut column| column -= &mean);
        all
    };
    let of = |(place, segment): (usize, &Segment)| {
        let y = subtract(filled[place].clone(), mean(segment.record, &|s| filled[s].clone()));
        let u = subtract(segment.u.clone(), mean(segment.record, &|s| data.segments[s].u.clone()));
        (y, u)
    };
    data.segments.iter().enumerate().map(of).collect()
}

impl Span {
    /// The span with this number of block rows. `None` if the records are too short for them.
    pub fn new(data: &Data, blocks: usize) -> Option<Self> {
        let (p, m) = (data.n, data.m);
        let all = centred(data);
        let columns = |y: &DMatrix<f64>| (y.ncols() + 1).saturating_sub(2 * blocks);
        let count: usize = all.iter().map(|(y, _)| columns(y)).sum();
        let width = 2 * blocks * (m + p);
        if count < width {
            return None;
        }
        // Transposed: the factor R of QR is that of LQ. It is found part by part, since records may be long.
        let mut rows = all.iter().flat_map(|(y, u)| (0..columns(y)).map(move |k| (y, u, k)));
        let mut r = DMatrix::zeros(0, width);
        for first in (0..count).step_by(MOST_ROWS) {
            let before = r.nrows();
            let mut hankel = r.resize_vertically(before + MOST_ROWS.min(count - first), 0.0);
            for (mut row, (y, u, k)) in hankel.row_iter_mut().skip(before).zip(&mut rows) {
                let mut column = 0;
                for (signal, first) in [(u, k + blocks), (u, k), (y, k), (y, k + blocks)] {
                    for value in signal.columns(first, blocks).iter() {
                        row[column] = *value;
                        column += 1;
                    }
                }
            }
            r = hankel.qr().r();
        }
        let (past, future) = (blocks * m, blocks * (2 * m + p));
        let block = r.view((past, future), (blocks * (m + p), blocks * p)).transpose();
        let (values, vectors) = symmetric(&(&block * block.transpose()));
        Some(Span { vectors, values: values.into_iter().map(|value| value.max(0.0).sqrt()).collect() })
    }

    /// A model of an order.
    pub fn model(&self, data: &Data, order: usize) -> Option<Discrete> {
        let p = data.n;
        if order + p > self.vectors.nrows() {
            return None;
        }
        let mut o = self.vectors.columns(0, order).into_owned();
        for (mut column, value) in o.column_iter_mut().zip(&self.values) {
            column.scale_mut(value.sqrt());
        }
        let last = o.nrows() - p;
        let f = least_squares(&o.rows(0, last).into_owned(), &o.rows(p, last).into_owned())?;
        let (f, c) = (reflected(&f)?, o.rows(0, p).into_owned());
        let g = input_gain(data, &f, &c)?;
        Some(Discrete { f, g, c })
    }
}

/// F with its eigenvalues that are too large reflected.
fn reflected(f: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = f.nrows();
    let values = eigenvalues(f)?;
    if values.iter().all(|value| value.norm() <= LARGEST_POLE) {
        return Some(f.clone());
    }
    let complex = f.map(|entry| Complex::new(entry, 0.0));
    let mut vectors = DMatrix::zeros(n, n);
    let mut inner = DMatrix::zeros(n, n);
    for (k, value) in values.iter().enumerate() {
        let near = value + Complex::new(1e-9, 0.7e-9) * f.norm();
        let shifted = &complex - DMatrix::from_diagonal_element(n, n, near);
        vectors.set_column(k, &null_vector(&shifted)?);
        let is_outside = value.norm() > LARGEST_POLE;
        inner[(k, k)] = if is_outside { Complex::new(LARGEST_POLE * LARGEST_POLE, 0.0) / value.conj() } else { *value };
    }
    let reflected = vectors.clone().try_inverse().map(|inverse| (vectors * inner * inverse).map(|entry| entry.re));
    let is_good = |f: &DMatrix<f64>| f.iter().all(|entry| entry.is_finite()) && crate::linear::spectral_radius(f) < 1.0;
    // Where eigenvectors are too near each other, everything is drawn in.
    let radius = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
    Some(reflected.filter(is_good).unwrap_or_else(|| f * (LARGEST_POLE / radius)))
}

/// G by least squares, with initial states and constants.
fn input_gain(data: &Data, f: &DMatrix<f64>, c: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (n, m, p) = (f.nrows(), data.m, data.n);
    let (segments, rows) = (data.segments.len(), data.rows());
    let constants = n * m + n * segments;
    let mut left = DMatrix::zeros(rows * p, constants + p * data.records);
    let mut right = DMatrix::zeros(rows * p, 1);
    let mut at = 0;
    for (place, segment) in data.segments.iter().enumerate() {
        // A column for each entry of G, and for each initial state.
        let mut state = DMatrix::zeros(n, n * m + n);
        state.columns_mut(n * m, n).fill_with_identity();
        for k in 0..segment.len() {
            let outputs = c * &state;
            for i in (0..p).filter(|i| segment.mask[(*i, k)] != 0.0) {
                let row = at + i;
                left.view_mut((row, 0), (1, n * m)).copy_from(&outputs.view((i, 0), (1, n * m)));
                left.view_mut((row, n * m + n * place), (1, n)).copy_from(&outputs.view((i, n * m), (1, n)));
                left[(row, constants + segment.record * p + i)] = 1.0;
                right[row] = segment.y[(i, k)];
            }
            at += p;
            state = f * state;
            for j in 0..m {
                for a in 0..n {
                    state[(a, a * m + j)] += segment.u[(j, k)];
                }
            }
        }
    }
    let solution = least_squares(&left, &right)?;
    Some(DMatrix::from_fn(n, m, |a, j| solution[a * m + j]))
}
