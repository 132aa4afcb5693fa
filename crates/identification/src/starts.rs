//! Points from which a search for a model begins.

use nalgebra::{DMatrix, DVector};

use crate::data::{Data, Segment};
use crate::layout::{Continuous, Layout, Place};
use crate::linear::{continuous, least_squares};

/// Lengths of the integral form, in rows.
const LENGTHS: [usize; 4] = [4, 10, 25, 60];

/// The unknowns of all starts that there are.
pub(crate) fn starts(data: &Data, layout: &Layout) -> Vec<Vec<f64>> {
    let integral = LENGTHS.iter().filter_map(|length| integral_form(data, layout, *length));
    let all = integral.chain(one_step(data).map(|model| layout.unknowns_of(&model)));
    all.filter(|unknowns| unknowns.iter().all(|value| value.is_finite())).collect()
}

/// Signals of a segment without holes: a cell that doesn't count is as that before.
pub(crate) fn filled(segment: &Segment) -> DMatrix<f64> {
    let mut y = segment.y.clone();
    for i in 0..y.nrows() {
        let first = (0..y.ncols()).find(|k| segment.mask[(i, *k)] != 0.0).unwrap_or(0);
        let mut before = y[(i, first)];
        for k in 0..y.ncols() {
            if segment.mask[(i, k)] != 0.0 {
                before = y[(i, k)];
            }
            y[(i, k)] = before;
        }
    }
    y
}

/// Integrals over time from the first row to each: of the signals, the inputs, and 1.
fn integrals(data: &Data, segment: &Segment, y: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, m) = (data.n, data.m);
    let mut sums = DMatrix::zeros(n + m + 1, segment.len());
    for k in 1..segment.len() {
        let length = segment.length(k - 1, &data.steps);
        for i in 0..n {
            sums[(i, k)] = sums[(i, k - 1)] + 0.5 * length * (y[(i, k - 1)] + y[(i, k)]);
        }
        for j in 0..m {
            sums[(n + j, k)] = sums[(n + j, k - 1)] + length * segment.u[(j, k - 1)];
        }
        sums[(n + m, k)] = sums[(n + m, k - 1)] + length;
    }
    sums
}

/// x(t + L) − x(t) = A ∫x + B ∫u + d L by least squares, each row with its unknowns.
pub(crate) fn integral_form(data: &Data, layout: &Layout, length: usize) -> Option<Vec<f64>> {
    let zero = vec![0.0; layout.count()];
    let known = layout.matrices(&zero);
    let prepared: Vec<_> = data
        .segments
        .iter()
        .filter(|segment| segment.len() > length)
        .map(|segment| {
            let y = filled(segment);
            (segment, integrals(data, segment, &y), y)
        })
        .collect();
    let rows: usize = prepared.iter().map(|(segment, ..)| segment.len() - length).sum();
    if rows == 0 {
        return None;
    }
    let mut unknowns = zero;
    for i in 0..data.n {
        let of_row: Vec<usize> = (0..layout.count()).filter(|k| row_of(layout.unknowns[*k].place) == i).collect();
        let mut left = DMatrix::zeros(rows, of_row.len());
        let mut right = DMatrix::zeros(rows, 1);
        let mut at = 0;
        for (segment, sums, y) in &prepared {
            for k in 0..segment.len() - length {
                let over = sums.column(k + length) - sums.column(k);
                right[at] = y[(i, k + length)] - y[(i, k)] - known_part(&known, i, segment.record, &over);
                for (column, unknown) in of_row.iter().enumerate() {
                    left[(at, column)] = factor_of(layout.unknowns[*unknown].place, segment.record, &over, data);
                }
                at += 1;
            }
        }
        if of_row.is_empty() {
            continue;
        }
        let solution = least_squares(&left, &right)?;
        of_row.iter().zip(solution.iter()).for_each(|(k, value)| unknowns[*k] = *value);
    }
    Some(layout.unknowns_of(&layout.matrices(&unknowns)))
}

pub(crate) fn row_of(place: Place) -> usize {
    match place {
        Place::A(i, _) | Place::B(i, _) | Place::D(i, _) => i,
    }
}

fn known_part(known: &Continuous, i: usize, record: usize, over: &DVector<f64>) -> f64 {
    let (n, m) = known.b.shape();
    let of_x: f64 = (0..n).map(|j| known.a[(i, j)] * over[j]).sum();
    let of_u: f64 = (0..m).map(|j| known.b[(i, j)] * over[n + j]).sum();
    of_x + of_u + known.d[(i, record)] * over[n + m]
}

fn factor_of(place: Place, record: usize, over: &DVector<f64>, data: &Data) -> f64 {
    match place {
        Place::A(_, j) => over[j],
        Place::B(_, j) => over[data.n + j],
        Place::D(_, of) if of == record => over[data.n + data.m],
        Place::D(..) => 0.0,
    }
}

/// One-step least squares over rows with the commonest step, with one input `late` rows later, and without the first
/// `without` rows of each segment: factors of signals, inputs and constants, and the residuals.
fn regression(data: &Data, (input, late): (usize, usize), without: usize) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let (n, m, records) = (data.n, data.m, data.records);
    let mut pairs = Vec::new();
    for segment in &data.segments {
        let is_common = |k: &usize| {
            let is_whole = segment.mask.column(*k).sum() + segment.mask.column(k + 1).sum() > 2.0 * n as f64 - 0.5;
            segment.step[*k] == data.steps.common && segment.rest[*k] == 0.0 && is_whole
        };
        pairs.extend((without..segment.len() - 1).filter(is_common).map(|k| (segment, k)));
    }
    if pairs.len() < n + m + records {
        return None;
    }
    let left = DMatrix::from_fn(pairs.len(), n + m + records, |row, column| {
        let (segment, k) = pairs[row];
        if column < n {
            segment.y[(column, k)]
        } else if column < n + m {
            segment.u[(column - n, if column - n == input { k - late } else { k })]
        } else {
            f64::from(column - n - m == segment.record)
        }
    });
    let right = DMatrix::from_fn(pairs.len(), n, |row, i| pairs[row].0.y[(i, pairs[row].1 + 1)]);
    let solution = least_squares(&left, &right)?;
    let residual = right - left * &solution;
    Some((solution, residual))
}

/// The number of rows, up to one, by which an input that is late explains the next row best.
pub(crate) fn further_delay(data: &Data, input: usize, most: usize) -> usize {
    let loss = |late: &usize| {
        let residual = regression(data, (input, *late), most).map(|(_, residual)| residual);
        residual.map_or(f64::INFINITY, |all| all.column_iter().map(|one| one.norm_squared().ln()).sum())
    };
    (0..=most).map(|late| (loss(&late), late)).min_by(|p, q| p.0.total_cmp(&q.0)).map_or(0, |(_, late)| late)
}

/// One-step least squares and the matrix logarithm, over rows with the commonest step.
pub(crate) fn one_step(data: &Data) -> Option<Continuous> {
    let (n, m, records) = (data.n, data.m, data.records);
    let solution = regression(data, (0, 0), 0)?.0.transpose();
    let right = solution.columns(n, m + records).into_owned();
    let (a, bd) = continuous(&solution.columns(0, n).into_owned(), &right)?;
    Some(Continuous { a, b: bd.columns(0, m).into_owned(), d: bd.columns(m, records).into_owned() })
}
