//! Output error of a sampled model from measured outputs, as a function of all entries of F, G and C.
//!
//! These have n² directions that change the states' coordinates only. Damping keeps a search from moving along them.

use nalgebra::{DMatrix, DVector};

use super::subspace::Discrete;
use crate::data::Data;
use crate::linear::{back_substitute, information, orthonormalise, project_out, spectral_radius};
use crate::marquardt::{MOST_GROWTH, Objective, Sums, Value, weighted};

/// The objective for a number of states.
pub(crate) struct OutputError<'a> {
    pub data: &'a Data,
    pub order: usize,
}

/// The prediction of a record: its segments one after the other.
struct Prediction {
    segments: Vec<usize>,
    /// States of each segment, a column a row.
    states: Vec<DMatrix<f64>>,
    /// Residuals of all segments.
    e: DMatrix<f64>,
    mask: DMatrix<f64>,
    /// Orthonormal span of what initial states and the constant do.
    q: DMatrix<f64>,
}

impl OutputError<'_> {
    pub fn unknowns(model: &Discrete) -> Vec<f64> {
        let all = [&model.f, &model.g, &model.c].map(|matrix| matrix.transpose());
        all.iter().flat_map(|matrix| matrix.iter().copied()).collect()
    }

    pub fn model(&self, unknowns: &[f64]) -> Discrete {
        let (n, m, p) = (self.order, self.data.m, self.data.n);
        let (f, rest) = unknowns.split_at(n * n);
        let (g, c) = rest.split_at(n * m);
        Discrete {
            f: DMatrix::from_row_slice(n, n, f),
            g: DMatrix::from_row_slice(n, m, g),
            c: DMatrix::from_row_slice(p, n, c),
        }
    }

    fn allowed(&self, unknowns: &[f64]) -> Option<Discrete> {
        let model = self.model(unknowns);
        let longest = self.data.segments.iter().map(crate::data::Segment::len).max().unwrap_or(0);
        let radius = spectral_radius(&model.f);
        (radius.ln() * longest as f64 <= MOST_GROWTH.ln()).then_some(model)
    }

    /// The prediction of a record from the best initial states and constant.
    fn predict(&self, model: &Discrete, record: usize, weights: &[f64]) -> Option<Prediction> {
        let (n, p) = (self.order, self.data.n);
        let all = &self.data.segments;
        let segments: Vec<usize> = (0..all.len()).filter(|s| all[*s].record == record).collect();
        let rows: usize = segments.iter().map(|s| all[*s].len()).sum();
        if rows == 0 {
            return None;
        }
        let responses: Vec<DMatrix<f64>> = segments.iter().map(|s| self.responses(model, *s)).collect();
        let mut q = DMatrix::zeros(rows * p, n * segments.len() + p);
        let mut plain = DMatrix::zeros(p, rows);
        let mut mask = DMatrix::zeros(p, rows);
        let mut at = 0;
        for (place, s) in segments.iter().enumerate() {
            let segment = &all[*s];
            for k in 0..segment.len() {
                let outputs = &model.c * responses[place].rows(k * n, n);
                for i in 0..p {
                    let weight = weights[i] * segment.mask[(i, k)];
                    let row = (at + k) * p + i;
                    let mut own = q.view_mut((row, place * n), (1, n));
                    own.copy_from(&(outputs.view((i, 1), (1, n)) * weight));
                    q[(row, n * segments.len() + i)] = weight;
                    plain[(i, at + k)] = segment.mask[(i, k)] * (segment.y[(i, k)] - outputs[(i, 0)]);
                    mask[(i, at + k)] = segment.mask[(i, k)];
                }
            }
            at += segment.len();
        }
        let r = weighted(&plain, weights);
        let triangle = orthonormalise(&mut q);
        let part = q.transpose() * &r;
        let solution = back_substitute(&triangle, &part);
        let left = r - &q * part;
        let e = DMatrix::from_fn(p, rows, |i, k| left[k * p + i] / weights[i]);
        let states = responses.iter().enumerate().map(|(place, response)| {
            let mut with = DVector::from_element(1 + n, 1.0);
            with.rows_mut(1, n).copy_from(&solution.rows(place * n, n));
            DMatrix::from_column_slice(n, response.nrows() / n, (response * with).as_slice())
        });
        Some(Prediction { states: states.collect(), segments, e, mask, q })
    }

    /// States of a segment: the response to the inputs, and to each initial state; n rows a row of the record.
    fn responses(&self, model: &Discrete, segment: usize) -> DMatrix<f64> {
        let (n, segment) = (self.order, &self.data.segments[segment]);
        let mut state = DMatrix::zeros(n, 1 + n);
        state.columns_mut(1, n).fill_with_identity();
        let mut all = DMatrix::zeros(n * segment.len(), 1 + n);
        for k in 0..segment.len() {
            all.rows_mut(k * n, n).copy_from(&state);
            state = &model.f * state;
            let mut first = state.column_mut(0);
            first += &model.g * segment.u.column(k);
        }
        all
    }

    /// The weighted Jacobian of the residuals of a record, projected and transposed.
    fn jacobian(&self, model: &Discrete, prediction: &Prediction, weights: &[f64]) -> DMatrix<f64> {
        let (n, m, p) = (self.order, self.data.m, self.data.n);
        let dynamic = n * n + n * m;
        let mut jacobian = DMatrix::zeros(dynamic + p * n, prediction.e.len());
        let mut at = 0;
        for (place, s) in prediction.segments.iter().enumerate() {
            let segment = &self.data.segments[*s];
            let mut sensitivity = DMatrix::<f64>::zeros(n, dynamic);
            let mut next = sensitivity.clone();
            for k in 0..segment.len() {
                let x = prediction.states[place].column(k);
                let outputs = &model.c * &sensitivity;
                for i in 0..p {
                    let (row, weight) = ((at + k) * p + i, -weights[i] * segment.mask[(i, k)]);
                    let mut own = jacobian.column_mut(row);
                    own.iter_mut().zip(outputs.row(i).iter()).for_each(|(to, from)| *to = weight * from);
                    (0..n).for_each(|j| own[dynamic + i * n + j] = weight * x[j]);
                }
                next.gemm(1.0, &model.f, &sensitivity, 0.0);
                std::mem::swap(&mut sensitivity, &mut next);
                for a in 0..n {
                    (0..n).for_each(|b| sensitivity[(a, a * n + b)] += x[b]);
                    (0..m).for_each(|j| sensitivity[(a, n * n + a * m + j)] += segment.u[(j, k)]);
                }
            }
            at += segment.len();
        }
        project_out(&mut jacobian, &prediction.q);
        jacobian
    }
}

impl Objective for OutputError<'_> {
    fn signals(&self) -> usize {
        self.data.n
    }

    fn sign(&self, _: usize) -> f64 {
        0.0
    }

    fn least_damping(&self) -> f64 {
        1e-9
    }

    fn value(&self, unknowns: &[f64], weights: &[f64]) -> Option<Value> {
        let model = self.allowed(unknowns)?;
        let mut sums = Sums::new(self.data.n);
        for record in 0..self.data.records {
            if let Some(prediction) = self.predict(&model, record, weights) {
                sums.add(&prediction.e, &prediction.mask);
            }
        }
        sums.value()
    }

    fn normal_equations(&self, unknowns: &[f64], weights: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>, Value)> {
        let model = self.allowed(unknowns)?;
        let mut sums = Sums::new(self.data.n);
        let (mut sum, mut gradient) = (DMatrix::zeros(unknowns.len(), unknowns.len()), DVector::zeros(unknowns.len()));
        for record in 0..self.data.records {
            let Some(prediction) = self.predict(&model, record, weights) else { continue };
            let jacobian = self.jacobian(&model, &prediction, weights);
            sums.add(&prediction.e, &prediction.mask);
            sum += information(&jacobian);
            gradient += &jacobian * weighted(&prediction.e, weights);
        }
        let value = sums.value()?;
        sum.iter().all(|entry| entry.is_finite()).then_some((sum, gradient, value))
    }
}
