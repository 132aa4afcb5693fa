//! Single wrong cells of a record.

use crate::data::Data;
use crate::marquardt::Fit;
use crate::problem::Problem;

/// A residual beyond this many standard deviations, computed from its median amount, is of a wrong cell.
const FAR: f64 = 6.0;
/// Standard deviation over median amount, of Gaussian noise.
const OVER_MEDIAN: f64 = 1.4826;

/// The most wrong cells of a signal within so many rows of each other.
const MOST_NEAR: usize = 3;
const NEAR: usize = 10;

/// A cell: segment, row in it, signal.
pub(crate) type Cell = (usize, usize, usize);

/// The cells that are wrong by a fit's residuals. A predictor with a gain goes on without such a cell, so that those after it aren't
/// taken for wrong ones.
pub(crate) fn wrong_cells(problem: &Problem, fit: &Fit) -> Vec<Cell> {
    let Some(predictor) = problem.predictor(&fit.unknowns, false) else { return Vec::new() };
    let (data, weights) = (problem.data, fit.value.weights());
    let predictions: Vec<_> =
        problem.windows.iter().map(|window| (*window, predictor.predict(*window, &weights))).collect();
    let limit = |i: usize| {
        let cells = predictions.iter().flat_map(|(window, prediction)| {
            let mask = &data.segments[window.segment].mask;
            let counts = (0..window.len).filter(move |k| mask[(i, window.first + k)] != 0.0);
            counts.map(move |k| prediction.e[(i, k)].abs())
        });
        FAR * OVER_MEDIAN * median(cells.collect())
    };
    let limits: Vec<f64> = (0..data.n).map(limit).collect();
    let mut wrong = Vec::new();
    for (window, prediction) in &predictions {
        let segment = &data.segments[window.segment];
        let mut error = prediction.e.column(0).into_owned() * 0.0;
        for k in 0..window.len {
            let row = window.first + k;
            // What the cells left out so far would have done to the prediction.
            let mut e = prediction.e.column(k) - &error;
            for i in 0..data.n {
                e[i] *= segment.mask[(i, row)];
                if e[i].abs() > limits[i].max(1e-9) {
                    wrong.push((window.segment, row, i));
                    e[i] = 0.0;
                }
            }
            if let (Some(gain), true) = (&predictor.gain, k + 1 < window.len) {
                let step = &predictor.sampled.steps[segment.step[row]];
                let gain = step.carried.as_ref().map_or_else(|| gain.clone(), |carried| carried * gain);
                // The difference of the two predictions goes on as their innovations differ.
                let mut difference = e - prediction.e.column(k);
                (0..data.n).for_each(|i| difference[i] *= segment.mask[(i, row)]);
                error = &step.f * error + gain * difference;
            }
        }
    }
    single(wrong)
}

/// Cells with few others near them: where there are many, the model lacks something.
fn single(cells: Vec<Cell>) -> Vec<Cell> {
    let near = |one: &Cell, other: &Cell| one.0 == other.0 && one.2 == other.2 && one.1.abs_diff(other.1) <= NEAR;
    let is_single = |cell: &&Cell| cells.iter().filter(|other| near(cell, other)).count() <= MOST_NEAR;
    cells.iter().filter(is_single).copied().collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::INFINITY;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Takes cells out of data.
pub(crate) fn take_out(data: &mut Data, cells: &[Cell]) {
    for &(segment, row, signal) in cells {
        data.segments[segment].mask[(signal, row)] = 0.0;
    }
}
