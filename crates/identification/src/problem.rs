//! Prediction error of records with all states measured, as a function of the unknowns.

use nalgebra::{DMatrix, DVector};

use crate::data::Data;
use crate::layout::Layout;
use crate::linear::{self, spectral_radius};
use crate::marquardt::{MOST_GROWTH, Objective, Sums, Value, weighted};
use crate::predictor::{Prediction, Predictor, Window, windows};
use crate::sampled::{Hold, Sampled};

/// Prediction error as a function of the unknowns of a layout and, where it is free, of the predictor's gain behind them.
pub(crate) struct Problem<'a> {
    pub data: &'a Data,
    pub layout: &'a Layout,
    pub hold: Hold,
    pub windows: Vec<Window>,
    pub free_gain: bool,
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

    fn mask(&self, window: Window) -> DMatrix<f64> {
        self.data.segments[window.segment].mask.columns(window.first, window.len).into_owned()
    }

    /// Calls a function with the prediction of each window and its Jacobian, weighted, projected and transposed.
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
}

impl Objective for Problem<'_> {
    fn signals(&self) -> usize {
        self.data.n
    }

    fn sign(&self, unknown: usize) -> f64 {
        self.layout.unknowns.get(unknown).map_or(0.0, |unknown| unknown.sign)
    }

    fn value(&self, unknowns: &[f64], weights: &[f64]) -> Option<Value> {
        let predictor = self.predictor(unknowns, false)?;
        let mut sums = Sums::new(self.data.n);
        for window in &self.windows {
            let prediction = predictor.predict(*window, weights);
            sums.add(&prediction.e, &self.mask(*window));
        }
        sums.value()
    }

    fn normal_equations(&self, unknowns: &[f64], weights: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>, Value)> {
        let count = self.count();
        let (mut information, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let mut sums = Sums::new(self.data.n);
        self.for_each_jacobian(unknowns, weights, |window, prediction, jacobian| {
            sums.add(&prediction.e, &self.mask(window));
            information += linear::information(jacobian);
            gradient += jacobian * weighted(&prediction.e, weights);
        })?;
        let value = sums.value()?;
        information.iter().all(|entry| entry.is_finite()).then_some((information, gradient, value))
    }
}
