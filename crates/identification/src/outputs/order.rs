//! The number of states, by how well models follow the held-out part.

use nalgebra::DMatrix;

use super::companion::Companion;
use super::output_error::OutputError;
use super::subspace::{Discrete, Span};
use crate::data::{ALIKE, Data, Segment, standard_deviation};
use crate::faults::NUMBERS;
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::held_out::STILL;
use crate::marquardt::{Fit, Objective, search};
use crate::options::OrderFit;
use crate::record::Record;
use crate::text::{digits, number};

/// The highest order that is tried.
const HIGHEST: usize = 10;
/// The fewest rows between two cuts.
pub(crate) const FEWEST: usize = 24;
/// Rows over which a search goes most of its way, and steps of what follows over all.
const ROWS_OF_BEGINNING: usize = 2000;
const WHOLE_STEPS: usize = 10;
/// Rows for each block row of a Hankel matrix.
const ROWS_OF_BLOCK: usize = 20;
const FIRST_STEPS: usize = 10;
const MORE_STEPS: usize = 90;
/// An order is as good as the best where its held-out fit is within this, %, or this part of what is missing to 100 %.
const AS_GOOD: f64 = 0.05;
const AS_GOOD_OF_MISSING: f64 = 0.02;

/// The model of the chosen order.
pub(crate) struct Choice {
    pub model: Discrete,
    pub orders: Vec<OrderFit>,
    /// True if the held-out part decided.
    pub is_by_fit: bool,
}

/// Data cut where a step isn't as the commonest one: a sampled model has one, which is the mean of those that are alike.
pub(crate) fn uniform(mut data: Data) -> Data {
    let mut segments = Vec::new();
    let (mut sum, mut count) = (0.0, 0.0);
    for segment in &data.segments {
        let mut begun = 0;
        for k in 0..segment.len() {
            let is_last = k + 1 == segment.len();
            if is_last || (segment.length(k, &data.steps) - 1.0).abs() > ALIKE {
                if k + 1 - begun >= FEWEST {
                    sum += (begun..k).map(|row| segment.length(row, &data.steps)).sum::<f64>();
                    count += (k - begun) as f64;
                    segments.push(part(segment, begun, k + 1, data.steps.common));
                }
                begun = k + 1;
            }
        }
    }
    if count > 0.0 {
        data.scaling.h *= sum / count;
    }
    Data { segments, ..data }
}

/// Findings about records that lose rows in this.
pub(crate) fn report(rows: &[usize], data: &Data, records: &[Record], findings: &mut Vec<Finding>) {
    for ((place, before), record) in rows.iter().enumerate().filter(|(_, before)| **before > 0).zip(records) {
        let of_record = data.segments.iter().filter(|segment| segment.record == place);
        let (after, step) = (of_record.map(Segment::len).sum::<usize>(), number(data.scaling.h));
        if after == 0 {
            let text =
                format!("{} is left out: fewer than {FEWEST} consecutive rows have steps of {step} s", record.name);
            findings.push(Finding::warning(Kind::LeftOut, text));
        } else if after < *before {
            let text = format!("{}: {} rows at steps other than {step} s are left out", record.name, before - after);
            findings.push(Finding::note(Kind::StepsDiffer, text));
        }
    }
}

/// The number of rows of each record.
pub(crate) fn rows(data: &Data) -> Vec<usize> {
    let mut rows = vec![0; data.records];
    data.segments.iter().for_each(|segment| rows[segment.record] += segment.len());
    rows
}

fn part(segment: &Segment, from: usize, to: usize, step: usize) -> Segment {
    let columns = |all: &DMatrix<f64>| all.columns(from, to - from).into_owned();
    Segment {
        record: segment.record,
        first: segment.first + from,
        y: columns(&segment.y),
        u: columns(&segment.u),
        mask: columns(&segment.mask),
        step: vec![step; to - 1 - from],
        rest: vec![0.0; to - 1 - from],
    }
}

/// Rows that a number of states needs: for numbers enough an unknown, and for the block rows of a first model.
fn needed(data: &Data, order: usize) -> usize {
    let (m, p) = (data.m, data.n);
    let unknowns = order * (m + p) + order * data.segments.len() + p * data.records;
    (NUMBERS * unknowns).div_ceil(p).max(ROWS_OF_BLOCK * (order.div_ceil(p) + 1))
}

/// The highest order for which there are rows enough.
pub(crate) fn most(data: &Data) -> Result<usize, Refusal> {
    let (p, rows) = (data.n, data.rows());
    if rows == 0 {
        let [least, most] = data.steps.extremes().map(|step| digits(step * data.scaling.h, 4));
        let text = format!(
            "the steps differ ({least} … {most} s): models from outputs need equal steps. Resample the records"
        );
        return Err(Refusal::new(Cause::TooShort, text));
    }
    let cells: f64 = data.segments.iter().map(|segment| segment.mask.sum()).sum();
    let counted = (cells / p as f64) as usize;
    (1..=HIGHEST).take_while(|order| needed(data, *order) <= counted).last().ok_or_else(|| {
        let text = format!("{counted} rows with equal steps: one state needs at least {}", needed(data, 1));
        Refusal::new(Cause::TooShort, text)
    })
}

/// A model of one order.
struct Tried {
    model: Discrete,
    found: Fit,
    fit: OrderFit,
}

impl Choice {
    /// The least order that follows the held-out part as well as others do; or the one that was asked for.
    pub fn new(data: &Data, tested: Option<&Data>, wanted: Option<usize>, most: usize) -> Result<Self, Refusal> {
        let orders = match wanted {
            Some(order) if order == 0 || order > most => {
                let rows =
                    if order > HIGHEST { String::new() } else { format!("; it needs {} rows", needed(data, order)) };
                let text = format!("order {order}: must be within 1 … {most} for this record{rows}");
                return Err(Refusal::new(Cause::Request, text));
            }
            Some(order) => order..=order,
            None => 1..=most,
        };
        let long = Span::new(data, 40.min(data.rows() / ROWS_OF_BLOCK));
        let mut tried: Vec<Tried> = orders.filter_map(|order| tried_order(data, order, long.as_ref())).collect();
        // What no order explains is noise.
        let noise: Vec<f64> = (0..data.n)
            .map(|i| tried.iter().map(|tried| tried.found.value.rms[i]).fold(f64::INFINITY, f64::min))
            .collect();
        for tried in &mut tried {
            tried.fit.held_out = tested.and_then(|tested| held_out_fit(tested, tried, &noise));
        }
        let usable = || tried.iter().filter(|tried| tried.fit.is_continuous);
        let best = usable().filter_map(|tried| tried.fit.held_out).fold(f64::NEG_INFINITY, f64::max);
        let allowed = AS_GOOD.max(AS_GOOD_OF_MISSING * (100.0 - best));
        let is_by_fit = best.is_finite();
        let chosen = if is_by_fit {
            usable().find(|tried| tried.fit.held_out.is_some_and(|fit| fit >= best - allowed))
        } else {
            // Nothing is held out, or it rests: the criterion counts.
            usable().min_by(|p, q| p.fit.bic.total_cmp(&q.fit.bic))
        };
        let chosen = chosen.ok_or_else(|| {
            if tried.is_empty() {
                return Refusal::new(
                    Cause::NoModel,
                    "no model of these outputs follows the record: is an input missing?",
                );
            }
            let text =
                "sampled too slowly: no sampled model of the record belongs to a continuous one (a pole is negative)";
            Refusal::new(Cause::SampledTooSlowly, text)
        })?;
        Ok(Choice { model: chosen.model.clone(), orders: tried.iter().map(|tried| tried.fit).collect(), is_by_fit })
    }
}

/// The likelier of two starts, searched on.
fn tried_order(data: &Data, order: usize, long: Option<&Span>) -> Option<Tried> {
    let rows = data.rows();
    let objective = OutputError { data, order };
    let short = Span::new(data, (2 * order + 4).max(8).min(rows / ROWS_OF_BLOCK));
    let starts = [short.as_ref(), long].into_iter().flatten().filter_map(|span| span.model(data, order));
    // Most of the way over a part of a long record.
    let part = beginning(data);
    let on = |data, start: &[f64], steps| search(&OutputError { data, order }, start, steps);
    let near = part.as_ref().unwrap_or(data);
    let begun = starts.filter_map(|model| on(near, &OutputError::unknowns(&model), FIRST_STEPS));
    let first = begun.min_by(|p, q| p.value.loss.total_cmp(&q.value.loss))?;
    let found = on(near, &first.unknowns, MORE_STEPS)?;
    let found = if part.is_some() { on(data, &found.unknowns, WHOLE_STEPS)? } else { found };
    let model = objective.model(&found.unknowns);
    let (m, p) = (data.m, data.n);
    let count = (order * (m + p) + order * data.segments.len() + p * data.records) as f64;
    let bic = found.value.loss + count * (rows as f64).ln();
    let is_continuous = Companion::new(&model).is_some();
    Some(Tried { model, found, fit: OrderFit { order, held_out: None, bic, is_continuous } })
}

/// The first segments of data, as many as have rows for most of a search. `None` where that are all.
fn beginning(data: &Data) -> Option<Data> {
    let mut rows = 0;
    let mut segments = Vec::new();
    for segment in &data.segments {
        let len = segment.len().min(ROWS_OF_BEGINNING - rows);
        if len >= FEWEST {
            segments.push(part(segment, 0, len, data.steps.common));
        }
        rows += len;
    }
    (rows < data.rows()).then(|| Data { segments, ..data.clone() })
}

/// Mean fit over data of the outputs that move there by more than noise, initial states and constants fitted, %. `None` where none does.
fn held_out_fit(data: &Data, tried: &Tried, noise: &[f64]) -> Option<f64> {
    let objective = OutputError { data, order: tried.fit.order };
    let value = objective.value(&tried.found.unknowns, &tried.found.value.weights())?;
    let deviations = (0..data.n).map(|i| standard_deviation(data.cells(i)));
    let moving = deviations.enumerate().filter(|(i, deviation)| *deviation > 0.0 && *deviation >= STILL * noise[*i]);
    let fits: Vec<f64> = moving.map(|(i, deviation)| 100.0 * (1.0 - value.rms[i] / deviation)).collect();
    (!fits.is_empty()).then(|| fits.iter().sum::<f64>() / fits.len() as f64)
}
