//! Prediction over windows: residuals, with the initial state projected out, and their Jacobian.
//!
//! The predictor is x̂⁺ = F x̂ + G u + Φ d + K (y − x̂); K = 0 is output error. The residual of a window is linear in its
//! initial state, which is eliminated by QR (variable projection). The Jacobian is that with the initial state fixed, also
//! projected (L. Kaufman, A variable projection method for solving separable nonlinear least squares problems, BIT 15 (1975) 49):
//! its gradient is exact.

use nalgebra::{DMatrix, DMatrixViewMut, DVector};

use crate::data::{Data, Segment, Steps};
use crate::layout::{Layout, Place};
use crate::linear::{back_substitute, orthonormalise, project_out};
use crate::sampled::{Sampled, Step, Tangents};

/// Rows times states of a window, at most: its Jacobian must fit into memory.
const MOST_ENTRIES: usize = 100_000;

/// Rows that are predicted from one initial state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub segment: usize,
    pub first: usize,
    pub len: usize,
}

/// All segments of data, each in so few windows of equal length that none is longer.
pub(crate) fn windows(data: &Data, longest: usize) -> Vec<Window> {
    let of = |(segment, whole): (usize, &Segment)| {
        let longest = longest.min(MOST_ENTRIES / data.states()).max(data.states() + 2);
        let count = whole.len().div_ceil(longest).max(1);
        let at = move |k: usize, len: usize| k * len / count;
        let len = whole.len();
        (0..count).map(move |k| Window { segment, first: at(k, len), len: at(k + 1, len) - at(k, len) })
    };
    data.segments.iter().enumerate().flat_map(of).collect()
}

/// A predictor for data: the sampled model, and the gain for one sample.
pub(crate) struct Predictor<'a> {
    pub data: &'a Data,
    pub sampled: Sampled,
    pub gain: Option<DMatrix<f64>>,
    /// The model, for what steps lack.
    pub model: crate::layout::Continuous,
}

/// The prediction of a window.
pub(crate) struct Prediction {
    /// Predicted states, a column a row.
    pub x: DMatrix<f64>,
    /// Measured minus predicted, 0 where a cell doesn't count; a column a row.
    pub e: DMatrix<f64>,
    /// Orthonormal span of the weighted sensitivity to the initial state.
    pub q: DMatrix<f64>,
}

impl Predictor<'_> {
    /// The gain for a step.
    pub fn gain_of(&self, step: &Step) -> Option<DMatrix<f64>> {
        let gain = self.gain.as_ref()?;
        Some(step.carried.as_ref().map_or_else(|| gain.clone(), |carried| carried * gain))
    }

    /// Prediction from the best initial state by these weights of the signals.
    pub fn predict(&self, window: Window, weights: &[f64]) -> Prediction {
        let n = self.data.states();
        let segment = &self.data.segments[window.segment];
        let gains: Vec<_> = self.sampled.steps.iter().map(|step| self.gain_of(step)).collect();
        // Column 0 is the response to the rest, the others that to the initial state.
        let mut state = DMatrix::zeros(n, 1 + n);
        state.columns_mut(1, n).fill_with_identity();
        let mut responses = DMatrix::zeros(n * window.len, 1 + n);
        for k in 0..window.len {
            responses.rows_mut(k * n, n).copy_from(&state);
            if k + 1 == window.len {
                break;
            }
            let row = window.first + k;
            let place = segment.step[row];
            let step = &self.sampled.steps[place];
            if segment.rest[row] != 0.0 {
                self.go_rest(segment, row, &mut state, |j| f64::from(j == 0));
            }
            let correction = gains[place].as_ref().map(|gain| {
                let before = responses.rows(k * n, n);
                let mut innovation = -before.into_owned();
                let mut first = innovation.column_mut(0);
                first += segment.y.column(row);
                for i in 0..n {
                    innovation.row_mut(i).scale_mut(segment.mask[(i, row)]);
                }
                gain * innovation
            });
            state = &step.f * &state;
            if let Some(correction) = correction {
                state += correction;
            }
            let mut first = state.column_mut(0);
            first += self.forcing(segment, row);
        }
        project_initial_state(self.data, window, weights, &responses)
    }

    /// The inputs and the constant in a step.
    fn forcing(&self, segment: &Segment, row: usize) -> DVector<f64> {
        let step = &self.sampled.steps[segment.step[row]];
        let mut sum = &step.g * segment.u.column(row) + step.o.column(segment.record);
        if !step.g2.is_empty() {
            let rest = segment.rest[row];
            let slope = slope(segment, row, &self.data.steps);
            sum += &step.g2 * &slope;
            // The main step begins later, by the rest.
            sum += &step.g * (slope * rest);
        }
        sum
    }

    /// Takes columns through what a step lacks, by the method of Runge and Kutta; `forced` is the part of the input in each.
    fn go_rest(&self, segment: &Segment, row: usize, state: &mut DMatrix<f64>, forced: impl Fn(usize) -> f64) {
        let rest = segment.rest[row];
        let mut input = &self.model.b * segment.u.column(row) + self.model.d.column(segment.record);
        if !self.sampled.steps[0].g2.is_empty() {
            input += &self.model.b * slope(segment, row, &self.data.steps) * (0.5 * rest);
        }
        let mut term = &self.model.a * &*state;
        for j in 0..state.ncols() {
            term.column_mut(j).axpy(forced(j), &input, 1.0);
        }
        let mut factor = rest;
        for order in 2..=5 {
            *state += &term * factor;
            term = &self.model.a * term;
            factor *= rest / f64::from(order);
        }
    }

    /// The weighted Jacobian of the residual by the unknowns of a layout and, behind them, of the gain; the initial state is
    /// fixed, then projected out. Transposed: a column a residual.
    pub fn jacobian(
        &self,
        window: Window,
        weights: &[f64],
        prediction: &Prediction,
        layout: &Layout,
        free_gain: bool,
    ) -> DMatrix<f64> {
        let n = self.data.states();
        let segment = &self.data.segments[window.segment];
        let count = layout.count() + if free_gain { n * n } else { 0 };
        let gains: Vec<_> = self.sampled.steps.iter().map(|step| self.gain_of(step)).collect();
        let mut s = DMatrix::<f64>::zeros(n, count);
        let mut next = s.clone();
        let mut jacobian = DMatrix::zeros(count, self.data.n * window.len);
        for k in 0..window.len {
            let row = window.first + k;
            self.write_row(segment, row, weights, &s, &mut jacobian.columns_mut(k * self.data.n, self.data.n));
            if k + 1 == window.len {
                break;
            }
            let place = segment.step[row];
            let step = &self.sampled.steps[place];
            let mut x = prediction.x.column(k).into_owned();
            // K acts on the innovation at the row itself, before what a step lacks.
            let corrected = gains[place].as_ref().map(|gain| masked(gain, segment, row) * &s);
            if segment.rest[row] != 0.0 {
                self.go_rest_with_tangents(segment, row, layout, &mut x, &mut s);
            }
            next.gemm(1.0, &step.f, &s, 0.0);
            if let Some(corrected) = corrected {
                next -= corrected;
            }
            std::mem::swap(&mut s, &mut next);
            let e = prediction.e.column(k).into_owned();
            self.add_tangents(segment, row, layout, &x, &e, &mut s);
            if free_gain {
                add_gain(step, layout.count(), &e, &mut s);
            }
        }
        project_out(&mut jacobian, &prediction.q);
        jacobian
    }

    /// Writes the weighted sensitivities of a row's residuals as columns.
    fn write_row(
        &self,
        segment: &Segment,
        row: usize,
        weights: &[f64],
        s: &DMatrix<f64>,
        columns: &mut DMatrixViewMut<f64>,
    ) {
        let seen = self.data.observed.as_ref().map(|observed| &observed.c * s);
        let seen = seen.as_ref().unwrap_or(s);
        for (i, weight) in weights.iter().enumerate() {
            let weight = -weight * segment.mask[(i, row)];
            if weight != 0.0 {
                columns.column_mut(i).iter_mut().zip(seen.row(i).iter()).for_each(|(to, from)| *to = weight * from);
            }
        }
    }

    /// Takes a state and its sensitivities through what a step lacks.
    fn go_rest_with_tangents(
        &self,
        segment: &Segment,
        row: usize,
        layout: &Layout,
        x: &mut DVector<f64>,
        s: &mut DMatrix<f64>,
    ) {
        let rest = segment.rest[row];
        let (a, u) = (&self.model.a, segment.u.column(row));
        let mut term = a * &*x + &self.model.b * u + self.model.d.column(segment.record);
        let mut term_s = a * &*s;
        for (column, unknown) in layout.unknowns.iter().enumerate() {
            match unknown.place {
                Place::A(i, j) => term_s[(i, column)] += x[j],
                Place::B(i, j) => term_s[(i, column)] += u[j],
                Place::D(i, record) if record == segment.record => term_s[(i, column)] += 1.0,
                Place::D(..) => {}
            }
        }
        let mut factor = rest;
        for order in 2..=5 {
            x.axpy(factor, &term, 1.0);
            *s += &term_s * factor;
            term_s = a * term_s;
            for (column, unknown) in layout.unknowns.iter().enumerate() {
                if let Place::A(i, j) = unknown.place {
                    term_s[(i, column)] += term[j];
                }
            }
            term = a * term;
            factor *= rest / f64::from(order);
        }
    }

    /// Adds what the unknowns of a layout do in a step from a state.
    fn add_tangents(
        &self,
        segment: &Segment,
        row: usize,
        layout: &Layout,
        x: &DVector<f64>,
        e: &DVector<f64>,
        s: &mut DMatrix<f64>,
    ) {
        let place = segment.step[row];
        let step = &self.sampled.steps[place];
        let mut u = segment.u.column(row).into_owned();
        let slope = (!step.g2.is_empty()).then(|| slope(segment, row, &self.data.steps));
        if let Some(slope) = &slope {
            u.axpy(segment.rest[row], slope, 1.0);
        }
        let by_a = self.sampled.tangents.get(place).map(|tangents| {
            let mut sum = &tangents.f * x + &tangents.g * &u + tangents.o.column(segment.record);
            self.add_special(tangents, slope.as_ref(), e, &mut sum);
            sum
        });
        let mut of_a = by_a.iter().flat_map(|sum| sum.as_slice().chunks_exact(x.len()));
        for (mut column, unknown) in s.column_iter_mut().zip(&layout.unknowns) {
            match unknown.place {
                Place::A(..) => {
                    let derivative = of_a.next().unwrap_or_default();
                    column.iter_mut().zip(derivative).for_each(|(to, from)| *to += from);
                }
                Place::B(i, j) => {
                    column.axpy(u[j], &step.phi.column(i), 1.0);
                    if let Some(slope) = &slope {
                        column.axpy(slope[j], &step.phi2.column(i), 1.0);
                    }
                }
                Place::D(i, record) if record == segment.record => column.axpy(1.0, &step.phi.column(i), 1.0),
                Place::D(..) => {}
            }
        }
    }

    /// Effects of entries of A through the slope of the input, and through a gain for another step.
    fn add_special(&self, tangents: &Tangents, slope: Option<&DVector<f64>>, e: &DVector<f64>, sum: &mut DVector<f64>) {
        if let Some(slope) = slope {
            sum.gemv(1.0, &tangents.g2, slope, 1.0);
        }
        if let (Some(carried), Some(gain)) = (&tangents.carried, &self.gain) {
            sum.gemv(1.0, carried, &(gain * e), 1.0);
        }
    }
}

/// A gain without the cells of a row that don't count.
fn masked(gain: &DMatrix<f64>, segment: &Segment, row: usize) -> DMatrix<f64> {
    let mut gain = gain.clone();
    for (j, mut column) in gain.column_iter_mut().enumerate() {
        column.scale_mut(segment.mask[(j, row)]);
    }
    gain
}

/// The slope of the input from a row to the next, in samples.
fn slope(segment: &Segment, row: usize, steps: &Steps) -> DVector<f64> {
    let length = segment.length(row, steps);
    (segment.u.column(row + 1) - segment.u.column(row)) / length
}

/// Adds what the entries of the gain do, which lie behind others, row by row.
fn add_gain(step: &Step, before: usize, e: &DVector<f64>, s: &mut DMatrix<f64>) {
    let n = e.len();
    for i in 0..n {
        for j in 0..n {
            let mut column = s.column_mut(before + i * n + j);
            match &step.carried {
                None => column[i] += e[j],
                Some(carried) => column.axpy(e[j], &carried.column(i), 1.0),
            }
        }
    }
}

/// The best initial state of a window, with constants where outputs have them, and what is left.
fn project_initial_state(data: &Data, window: Window, weights: &[f64], responses: &DMatrix<f64>) -> Prediction {
    let (n, signals, segment) = (data.states(), data.n, &data.segments[window.segment]);
    let seen = data.observed.as_ref().map(|observed| {
        let mut seen = DMatrix::zeros(signals * window.len, 1 + n);
        for k in 0..window.len {
            seen.rows_mut(k * signals, signals).copy_from(&(&observed.c * responses.rows(k * n, n)));
        }
        seen
    });
    let seen = seen.as_ref().unwrap_or(responses);
    let has_constants = data.observed.as_ref().is_some_and(|observed| observed.has_constants);
    let mut q = DMatrix::zeros(signals * window.len, n + if has_constants { signals } else { 0 });
    q.columns_mut(0, n).copy_from(&seen.columns(1, n));
    let mut r = DVector::zeros(signals * window.len);
    for k in 0..window.len {
        for i in 0..signals {
            let (at, row) = (k * signals + i, window.first + k);
            if has_constants {
                q[(at, n + i)] = 1.0;
            }
            let weight = weights[i] * segment.mask[(i, row)];
            q.row_mut(at).scale_mut(weight);
            r[at] = weight * (segment.y[(i, row)] - seen[(at, 0)]);
        }
    }
    let triangle = orthonormalise(&mut q);
    let best = back_substitute(&triangle, &(q.transpose() * &r));
    let mut with = DVector::from_element(1 + n, 1.0);
    with.rows_mut(1, n).copy_from(&best.rows(0, n));
    let x = DMatrix::from_column_slice(n, window.len, (responses * &with).as_slice());
    let mut predicted = DMatrix::from_column_slice(signals, window.len, (seen * with).as_slice());
    if has_constants {
        predicted.column_iter_mut().for_each(|mut column| column += best.rows(n, signals));
    }
    let mut e = segment.y.columns(window.first, window.len) - predicted;
    e.component_mul_assign(&segment.mask.columns(window.first, window.len));
    Prediction { x, e, q }
}
