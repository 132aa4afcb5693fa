//! Single wrong cells of a record.

use nalgebra::DVector;

use crate::data::Data;
use crate::finding::{Finding, Kind};
use crate::marquardt::Fit;
use crate::options::WrongCell;
use crate::problem::Problem;
use crate::record::{Record, Signals};
use crate::text::ranges;

/// Rounds in which wrong cells are looked for.
pub(crate) const ROUNDS: usize = 3;
/// Part of the rows with wrong cells above which that is a warning.
const MANY: f64 = 0.02;
/// A residual beyond this many standard deviations, computed from its median amount, is of a wrong cell.
const FAR: f64 = 6.0;
/// Standard deviation over median amount, of Gaussian noise.
const OVER_MEDIAN: f64 = 1.4826;

/// The most wrong cells of a signal, and number of rows within which they count as near each other.
const MOST_NEAR: usize = 3;
const NEAR: usize = 10;
/// A cell that is this many times further off than those near it is a wrong one.
const BEYOND_OTHERS: f64 = 3.0;

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
        let mut error = DVector::zeros(data.n);
        for k in 0..window.len {
            let row = window.first + k;
            // What the cells left out so far would have done to the prediction.
            let mut e = prediction.e.column(k) - &error;
            for i in 0..data.n {
                e[i] *= segment.mask[(i, row)];
                let limit = limits[i].max(1e-9);
                if e[i].abs() > limit {
                    wrong.push(((window.segment, row, i), e[i].abs() / limit));
                    e[i] = 0.0;
                }
            }
            if k + 1 == window.len {
                break;
            }
            let step = &predictor.sampled.steps[segment.step[row]];
            if let Some(gain) = predictor.gain_of(step) {
                // The difference of the two predictions goes on as their innovations differ.
                let mut difference = e - prediction.e.column(k);
                (0..data.n).for_each(|i| difference[i] *= segment.mask[(i, row)]);
                error = &step.f * error + gain * difference;
            }
        }
    }
    single(&wrong)
}

/// Cells, each with its residual in units of the limit, that have few others of their signal near them, or are far beyond these: where
/// there are many, the model lacks something. One that a much larger one near it, of any signal, may have drawn along waits for the
/// next round.
fn single(cells: &[(Cell, f64)]) -> Vec<Cell> {
    let near = |one: &Cell, other: &Cell| one.0 == other.0 && one.1.abs_diff(other.1) <= NEAR && one != other;
    let is_single = |(cell, amount): &&(Cell, f64)| {
        let others = || cells.iter().filter(|(other, _)| near(cell, other));
        let of_signal = || others().filter(|(other, _)| other.2 == cell.2);
        let is_drawn = others().any(|(_, other)| *other > BEYOND_OTHERS * amount);
        let is_far = of_signal().all(|(_, other)| *amount > BEYOND_OTHERS * other);
        !is_drawn && (is_far || of_signal().count() < MOST_NEAR)
    };
    cells.iter().filter(is_single).map(|(cell, _)| *cell).collect()
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

/// Findings about cells that were taken out.
pub(crate) fn report(data: &Data, cells: &[Cell], records: &[&Record], findings: &mut Vec<Finding>) {
    for (place, record) in records.iter().enumerate() {
        let of_record = cells.iter().filter(|(segment, ..)| data.segments[*segment].record == place);
        let mut at: Vec<usize> =
            of_record.map(|(segment, row, _)| record.place(data.segments[*segment].first + row)).collect();
        at.sort_unstable();
        at.dedup();
        if at.is_empty() {
            continue;
        }
        let many = at.len() as f64 > MANY * record.len() as f64;
        let text = format!(
            "{}: {} {}: wrong cells, far from what the model predicts, are left out",
            record.name,
            record.row_word(),
            ranges(&at)
        );
        let make = if many { Finding::warning } else { Finding::note };
        findings.push(make(Kind::WrongCells, text));
    }
}

/// The cells as results list them.
pub(crate) fn listed(data: &Data, cells: &[Cell], signals: &Signals) -> Vec<WrongCell> {
    let of = |&(segment, row, signal): &Cell| {
        let segment = &data.segments[segment];
        WrongCell { record: segment.record, row: segment.first + row, signal: signals.measured[signal].clone() }
    };
    cells.iter().map(of).collect()
}
