//! Maximum likelihood by the method of Levenberg and Marquardt, with weights that follow the residuals.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::data::Data;
use crate::layout::Layout;
use crate::linear::{gram, spectral_radius};
use crate::predictor::{Prediction, Predictor, Window, windows};
use crate::sampled::{Hold, Sampled};

/// The root mean square of a residual isn't taken to be below this part of the signal's standard deviation.
const LEAST_RMS: f64 = 1e-10;
/// The growth over a window, of errors in an initial state, that output error allows.
pub(crate) const MOST_GROWTH: f64 = 1e8;
const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-12;
/// Failed steps in a row after which a search ends.
const FAILURES: usize = 8;
/// A search ends when a step gains less in the objective.
const LEAST_GAIN: f64 = 1e-6;

/// Prediction error as a function of the unknowns of a layout and, where it is free, of the predictor's gain behind them.
pub(crate) struct Problem<'a> {
    pub data: &'a Data,
    pub layout: &'a Layout,
    pub hold: Hold,
    pub windows: Vec<Window>,
    pub free_gain: bool,
}

/// Residuals at a point.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Value {
    /// Root mean square of each signal's residual.
    pub rms: Vec<f64>,
    /// −2 ln likelihood of Gaussian noise of unknown variances, up to a constant.
    pub loss: f64,
}

/// A point of a search, with its residuals.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fit {
    pub unknowns: Vec<f64>,
    pub value: Value,
}

impl Value {
    pub fn weights(&self) -> Vec<f64> {
        self.rms.iter().map(|rms| 1.0 / rms.max(LEAST_RMS)).collect()
    }
}

impl<'a> Problem<'a> {
    pub fn new(data: &'a Data, layout: &'a Layout, hold: Hold, longest: usize, free_gain: bool) -> Self {
        Problem { data, layout, hold, windows: windows(data, longest), free_gain }
    }

    /// The number of unknowns but for the initial states.
    pub fn count(&self) -> usize {
        self.layout.count() + if self.free_gain { self.data.n * self.data.n } else { 0 }
    }

    /// The gain behind the unknowns.
    pub fn gain(&self, unknowns: &[f64]) -> Option<DMatrix<f64>> {
        let n = self.data.n;
        self.free_gain.then(|| DMatrix::from_row_slice(n, n, &unknowns[self.layout.count()..]))
    }

    /// The predictor at a point; `None` where it isn't finite, or errors of an initial state grow too much.
    pub fn predictor(&self, unknowns: &[f64], with_tangents: bool) -> Option<Predictor<'a>> {
        let model = self.layout.matrices(&unknowns[..self.layout.count()]);
        let steps = &self.data.steps;
        let sampled = if with_tangents {
            Sampled::with_tangents(&model, self.layout, &steps.lengths, steps.common, self.hold)?
        } else {
            Sampled::new(&model, &steps.lengths, steps.common, self.hold)?
        };
        let gain = self.gain(unknowns);
        let f = &sampled.steps[steps.common].f;
        let is_allowed = match &gain {
            Some(gain) => spectral_radius(&(f - gain)) < 1.0,
            None => {
                let longest = self.windows.iter().map(|window| window.len).max().unwrap_or(0);
                spectral_radius(f).ln() * longest as f64 <= MOST_GROWTH.ln()
            }
        };
        is_allowed.then_some(Predictor { data: self.data, sampled, gain, model })
    }

    /// Residuals at a point, with the initial states that are best by these weights.
    pub fn value(&self, unknowns: &[f64], weights: &[f64]) -> Option<Value> {
        let predictor = self.predictor(unknowns, false)?;
        let predictions = self.windows.iter().map(|window| (*window, predictor.predict(*window, weights)));
        self.value_of(predictions)
    }

    fn value_of(&self, predictions: impl Iterator<Item = (Window, Prediction)>) -> Option<Value> {
        let mut sums = Sums::new(self.data.n);
        predictions.for_each(|(window, prediction)| sums.add(self.data, window, &prediction));
        sums.value()
    }

    /// Calls a function with the prediction of each window and its Jacobian, weighted and projected.
    pub fn for_each_jacobian(
        &self,
        unknowns: &[f64],
        weights: &[f64],
        mut function: impl FnMut(Window, &Prediction, &DMatrix<f64>),
    ) -> Option<()> {
        let predictor = self.predictor(unknowns, true)?;
        for window in &self.windows {
            let prediction = predictor.predict(*window, weights);
            let jacobian = predictor.jacobian(*window, weights, &prediction, self.layout, self.free_gain);
            function(*window, &prediction, &jacobian);
        }
        Some(())
    }

    /// Normal equations at a point: JᵀJ, Jᵀr, and the residuals.
    pub fn normal_equations(&self, unknowns: &[f64], weights: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>, Value)> {
        let count = self.count();
        let (mut information, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let mut sums = Sums::new(self.data.n);
        self.for_each_jacobian(unknowns, weights, |window, prediction, jacobian| {
            sums.add(self.data, window, prediction);
            information += gram(jacobian);
            gradient += jacobian.transpose() * weighted(&prediction.e, weights);
        })?;
        let value = sums.value()?;
        information.iter().all(|entry| entry.is_finite()).then_some((information, gradient, value))
    }

    /// Searches from a point in so many steps at most. `None` where the point itself isn't allowed.
    pub fn search(&self, start: &[f64], steps: usize) -> Option<Fit> {
        let mut weights = self.value(start, &vec![1.0; self.data.n])?.weights();
        let mut fit = Fit { unknowns: start.to_vec(), value: self.value(start, &weights)? };
        let mut damping = FIRST_DAMPING;
        for _ in 0..steps {
            weights = fit.value.weights();
            let (information, gradient, value) = self.normal_equations(&fit.unknowns, &weights)?;
            fit.value = value;
            let Some(next) = self.step(&fit, &weights, (&information, &gradient), &mut damping) else { break };
            let gain = fit.value.loss - next.value.loss;
            fit = next;
            if gain < LEAST_GAIN {
                break;
            }
        }
        Some(fit)
    }

    /// The next point, which is better; `None` where none is found.
    fn step(
        &self,
        fit: &Fit,
        weights: &[f64],
        (information, gradient): (&DMatrix<f64>, &DVector<f64>),
        damping: &mut f64,
    ) -> Option<Fit> {
        for _ in 0..FAILURES {
            let trial = self.trial(&fit.unknowns, information, gradient, *damping);
            let better = trial.and_then(|unknowns| {
                let value = self.value(&unknowns, weights).filter(|value| value.loss < fit.value.loss)?;
                Some(Fit { unknowns, value })
            });
            if better.is_some() {
                *damping = (*damping / 10.0).max(LEAST_DAMPING);
                return better;
            }
            *damping *= 10.0;
        }
        None
    }

    /// A damped step, cut where an unknown with a sign would cross 0.
    fn trial(&self, at: &[f64], information: &DMatrix<f64>, gradient: &DVector<f64>, damping: f64) -> Option<Vec<f64>> {
        let sign = |k: usize| self.layout.unknowns.get(k).map_or(0.0, |unknown| unknown.sign);
        let mut is_held = vec![false; at.len()];
        loop {
            let step = damped(information, gradient, damping, &is_held)?;
            let outward = (0..at.len()).filter(|&k| !is_held[k] && at[k] == 0.0 && sign(k) * step[k] < 0.0);
            let outward: Vec<usize> = outward.collect();
            if outward.is_empty() {
                let moved = (0..at.len()).map(|k| {
                    let value = at[k] + step[k];
                    if sign(k) * value < 0.0 { 0.0 } else { value }
                });
                return Some(moved.collect());
            }
            outward.into_iter().for_each(|k| is_held[k] = true);
        }
    }
}

/// −(JᵀJ + μ diag) ⁻¹ Jᵀr, 0 for what is held.
fn damped(information: &DMatrix<f64>, gradient: &DVector<f64>, damping: f64, is_held: &[bool]) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..is_held.len()).filter(|k| !is_held[*k] && information[(*k, *k)] > 0.0).collect();
    let length: Vec<f64> = free.iter().map(|k| information[(*k, *k)].sqrt()).collect();
    let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        information[(free[i], free[j])] / (length[i] * length[j]) + if i == j { damping } else { 0.0 }
    });
    let right = DVector::from_fn(free.len(), |i, _| -gradient[free[i]] / length[i]);
    let solution = Cholesky::new(matrix)?.solve(&right);
    let mut step = DVector::zeros(is_held.len());
    free.iter().enumerate().for_each(|(i, k)| step[*k] = solution[i] / length[i]);
    step.iter().all(|entry| entry.is_finite()).then_some(step)
}

/// A residual, weighted, row after row.
pub(crate) fn weighted(e: &DMatrix<f64>, weights: &[f64]) -> DVector<f64> {
    DVector::from_iterator(e.len(), e.iter().enumerate().map(|(k, value)| value * weights[k % e.nrows()]))
}

/// Sums of squares of residuals.
struct Sums {
    squares: Vec<f64>,
    counts: Vec<f64>,
}

impl Sums {
    fn new(n: usize) -> Self {
        Sums { squares: vec![0.0; n], counts: vec![0.0; n] }
    }

    fn add(&mut self, data: &Data, window: Window, prediction: &Prediction) {
        let mask = data.segments[window.segment].mask.columns(window.first, window.len);
        for i in 0..data.n {
            self.squares[i] += prediction.e.row(i).norm_squared();
            self.counts[i] += mask.row(i).sum();
        }
    }

    fn value(&self) -> Option<Value> {
        let all = self.squares.iter().zip(&self.counts);
        let rms: Vec<f64> = all.map(|(square, count)| (square / count.max(1.0)).sqrt()).collect();
        let loss = rms.iter().zip(&self.counts).map(|(rms, count)| 2.0 * count * rms.max(LEAST_RMS).ln()).sum();
        rms.iter().all(|rms| rms.is_finite()).then_some(Value { rms, loss })
    }
}
