//! The held-out part of records: how well a model follows it, and the disturbance that it shows.

use nalgebra::{DMatrix, DVector};

use crate::cells::{Cell, ROUNDS, take_out, wrong_cells};
use crate::data::Data;
use crate::layout::{Continuous, Layout};
use crate::linear::{eigenvalues, pseudoinverse, pseudoinverse_of_units};
use crate::marquardt::{Fit, Objective, Value};
use crate::predictor::{Window, windows};
use crate::problem::Problem;
use crate::sampled::Hold;

/// A signal that moves by less than this many noises isn't judged.
pub(crate) const STILL: f64 = 2.0;
/// A model that follows less of the held-out motion, %, with residuals that aren't white, is none.
const LEAST_FIT: f64 = 50.0;
const WHITE: f64 = 3.7;
/// The fewest rows from which a disturbance is computed.
const FEWEST_ROWS: usize = 50;
/// A disturbance counts beyond this many standard errors.
const BEYOND: f64 = 2.5;

/// Fits of the held-out part, %.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeldOut {
    /// Over the whole of each record; `None` for unstable plants.
    pub whole: Option<Vec<f64>>,
    /// Over windows of the controller's time scale.
    pub windows: Vec<f64>,
    /// The best that noise lets a model have.
    pub ceiling: Vec<f64>,
    /// Standard deviation of each signal, scaled.
    pub deviation: Vec<f64>,
    /// True for signals that move.
    pub is_judged: Vec<bool>,
    /// Measured less simulated values, scaled, 0 where a cell doesn't count: over the whole, or over windows for unstable plants.
    pub errors: Vec<(Window, DMatrix<f64>)>,
}

impl HeldOut {
    /// The fit of a signal over the whole, or over windows for unstable plants, %.
    pub fn fit(&self, signal: usize) -> f64 {
        self.whole.as_ref().unwrap_or(&self.windows)[signal]
    }

    /// The better fit of a signal, over the whole or over windows, %.
    fn best(&self, signal: usize) -> f64 {
        self.whole.as_ref().map_or(self.windows[signal], |whole| whole[signal].max(self.windows[signal]))
    }

    /// The signal of which a model follows less than half, though its residuals aren't noise; and the best fit of it, %. Noise is that
    /// of one step: output error's contains what the model lacks.
    pub fn not_followed(&self, noise: &[f64], whiteness: &[f64]) -> Option<(usize, f64)> {
        let moves = |i: usize| self.deviation[i] >= STILL * noise[i];
        let bad = (0..noise.len()).filter(|&i| moves(i) && self.best(i) < LEAST_FIT && whiteness[i] > WHITE);
        bad.map(|i| (i, self.best(i))).min_by(|p, q| p.1.total_cmp(&q.1))
    }
}

/// Effects on a plant that its model lacks.
#[derive(Debug, Clone, Default)]
pub(crate) struct Disturbance {
    /// Effects as an input, in units of the data.
    pub matched: Vec<f64>,
    /// Effects as derivatives that no input can cause, by rows, in units of the data.
    pub unmatched: Vec<f64>,
    /// Start of each window (segment, row), and the disturbance as an input there.
    pub course: Vec<(Window, Vec<f64>)>,
}

/// True if errors of an initial state grow over these rows.
fn is_unstable(a: &DMatrix<f64>, rows: usize) -> bool {
    // A pole that can't be distinguished from 0 is an integrator.
    let found = eigenvalues(a).unwrap_or_default();
    found.iter().any(|pole| pole.re * rows as f64 > 1.0)
}

/// The bandwidth of a first design, in rad a sample: twice the slowest stable pole that can be distinguished from 0, or else the
/// largest pole; at most 1/3.
pub(crate) fn bandwidth(a: &DMatrix<f64>, rows: usize) -> f64 {
    let found = eigenvalues(a).unwrap_or_default();
    let is_zero = |amount: f64| amount * (rows as f64) < 1.0;
    let stable = found.iter().filter(|pole| pole.re < 0.0 && !is_zero(pole.norm())).map(|pole| pole.norm());
    let slowest = stable.fold(f64::INFINITY, f64::min);
    let largest = found.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    let wanted = if slowest.is_finite() { 2.0 * slowest } else { largest };
    if wanted > 0.0 { wanted.min(1.0 / 3.0) } else { 1.0 / 3.0 }
}

/// A model on data over windows, its offset fitted in these rows of d.
struct Simulation<'a> {
    problem: Problem<'a>,
    fit: Fit,
}

impl<'a> Simulation<'a> {
    fn new(data: &'a Data, layout: &'a Layout, hold: Hold, longest: usize, noise: &[f64]) -> Option<Self> {
        let problem = Problem::new(data, layout, hold, longest, false);
        let weights: Vec<f64> = noise.iter().map(|noise| 1.0 / noise.max(1e-10)).collect();
        let mut offsets = DVector::zeros(layout.count());
        // Linear in the offset: one step is exact.
        if !offsets.is_empty() {
            let (information, gradient, _) = problem.normal_equations(offsets.as_slice(), &weights)?;
            offsets = pseudoinverse(&information) * -gradient;
        }
        let unknowns = offsets.as_slice().to_vec();
        let loss = problem.value(&unknowns, &weights)?.loss;
        Some(Simulation { problem, fit: Fit { unknowns, value: Value { rms: noise.to_vec(), loss } } })
    }

    fn errors(&self) -> Option<Vec<(Window, DMatrix<f64>)>> {
        let predictor = self.problem.predictor(&self.fit.unknowns, false)?;
        let weights = self.fit.value.weights();
        let of = |window: &Window| (*window, predictor.predict(*window, &weights).e);
        Some(self.problem.windows.iter().map(of).collect())
    }
}

/// Rows of a window of the controller's time scale.
fn time_scale(bandwidth: f64) -> usize {
    (5.0 / bandwidth).ceil() as usize
}

/// Takes single wrong cells out of the held-out part, by windows; these cells.
pub(crate) fn take_wrong_out(
    model: &Continuous,
    data: &mut Data,
    hold: Hold,
    (offsets, bandwidth): (&[usize], f64),
    noise: &[f64],
) -> Vec<Cell> {
    let layout = Layout::offsets(model, offsets, data.records);
    let mut all = Vec::new();
    for _ in 0..ROUNDS {
        let simulation = Simulation::new(data, &layout, hold, time_scale(bandwidth), noise);
        let cells = simulation.map_or_else(Vec::new, |found| wrong_cells(&found.problem, &found.fit));
        if cells.is_empty() {
            break;
        }
        take_out(data, &cells);
        all.extend(cells);
    }
    all
}

/// Fit of each signal, %: 100 (1 − ‖y − ŷ‖/‖y − ȳ‖); NaN where it has no motion.
fn fits(data: &Data, errors: &[(Window, DMatrix<f64>)]) -> Vec<f64> {
    let (motion, _) = motion(data);
    let of = |i: usize| {
        let error: f64 = errors.iter().map(|(_, e)| e.row(i).norm_squared()).sum();
        if motion[i] > 0.0 { 100.0 * (1.0 - (error / motion[i]).sqrt()) } else { f64::NAN }
    };
    (0..data.n).map(of).collect()
}

/// ‖y − ȳ‖² and standard deviation of each signal; NaN of one without values.
fn motion(data: &Data) -> (Vec<f64>, Vec<f64>) {
    let of = |i: usize| {
        let all: Vec<f64> = data.cells(i).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        let sum: f64 = all.iter().map(|value| (value - mean).powi(2)).sum();
        (sum, (sum / all.len() as f64).sqrt())
    };
    (0..data.n).map(of).unzip()
}

/// Fits of a model on the held-out part. `noise` is the root mean square of output error's residuals.
pub(crate) fn held_out(
    model: &Continuous,
    data: &Data,
    hold: Hold,
    (offsets, bandwidth): (&[usize], f64),
    noise: &[f64],
) -> Option<HeldOut> {
    let layout = Layout::offsets(model, offsets, data.records);
    let over = |longest: usize| Simulation::new(data, &layout, hold, longest, noise)?.errors();
    let whole = if is_unstable(&model.a, data.rows()) { None } else { over(usize::MAX) };
    let in_windows = over(time_scale(bandwidth))?;
    let (_, deviation) = motion(data);
    let of = |(deviation, noise): (&f64, &f64)| {
        if *deviation > 0.0 { 100.0 * (1.0 - noise / deviation) } else { f64::NAN }
    };
    let ceiling = deviation.iter().zip(noise).map(of);
    Some(HeldOut {
        whole: whole.as_ref().map(|errors| fits(data, errors)),
        windows: fits(data, &in_windows),
        ceiling: ceiling.collect(),
        deviation: deviation.clone(),
        is_judged: deviation.iter().zip(noise).map(|(deviation, noise)| *deviation >= STILL * noise).collect(),
        errors: whole.unwrap_or(in_windows),
    })
}

/// The disturbance of the held-out part.
pub(crate) fn disturbance(
    model: &Continuous,
    data: &Data,
    hold: Hold,
    bandwidth: f64,
    noise: &[f64],
) -> Option<Disturbance> {
    let longest = FEWEST_ROWS.max((1.0 / bandwidth).ceil() as usize);
    // A constant of an output in each window would hide the disturbance.
    let mut data = data.clone();
    data.observed.iter_mut().for_each(|observed| observed.has_constants = false);
    let data = &data;
    let n = data.states();
    let rows: Vec<usize> = (0..n).collect();
    let layout = Layout::offsets(model, &rows, data.records);
    let weights: Vec<f64> = noise.iter().map(|noise| 1.0 / noise.max(1e-10)).collect();
    let start = vec![0.0; layout.count()];
    // In units of the data: a pseudoinverse depends on them.
    let scaling = data.state_scaling();
    let physical = model.physical(scaling).b;
    let inverse = pseudoinverse_of_units(&physical);
    let per_second = DVector::from_fn(n, |i, _| scaling.x[i] / scaling.h);
    let per_second = DMatrix::from_diagonal(&per_second);
    let rest = (DMatrix::identity(n, n) - physical * &inverse) * &per_second;
    let gain = inverse * per_second;
    let (mut inputs, mut others, mut course) = (Vec::new(), Vec::new(), Vec::new());
    for window in windows(data, longest) {
        let one = Problem { windows: vec![window], ..Problem::new(data, &layout, hold, longest, false) };
        let record = data.segments[window.segment].record;
        let (information, gradient, _) = one.normal_equations(&start, &weights)?;
        let own = |matrix: &DMatrix<f64>| matrix.view((record * n, record * n), (n, n)).into_owned();
        let covariance = pseudoinverse(&own(&information));
        let d = &covariance * -gradient.rows(record * n, n);
        let with_error = |map: &DMatrix<f64>| {
            let errors = (map * &covariance * map.transpose()).diagonal().map(|variance| variance.max(0.0).sqrt());
            (map * &d, errors)
        };
        inputs.push(with_error(&gain));
        others.push(with_error(&rest));
        course.push((window, inputs[inputs.len() - 1].0.as_slice().to_vec()));
    }
    Some(Disturbance { matched: bounds(&inputs), unmatched: bounds(&others), course })
}

/// |mean| + max (|value − mean| − 2.5 errors)₊ of each component.
fn bounds(all: &[(DVector<f64>, DVector<f64>)]) -> Vec<f64> {
    let Some((first, _)) = all.first() else { return Vec::new() };
    let of = |i: usize| {
        let mean = all.iter().map(|(value, _)| value[i]).sum::<f64>() / all.len() as f64;
        let beyond = all.iter().map(|(value, error)| (value[i] - mean).abs() - BEYOND * error[i]);
        mean.abs() + beyond.fold(0.0, f64::max)
    };
    (0..first.len()).map(of).collect()
}
