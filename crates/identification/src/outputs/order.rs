//! The number of states, by how well models follow the held-out part.

use nalgebra::DMatrix;

use super::companion::Companion;
use super::output_error::OutputError;
use super::subspace::{Discrete, Span};
use crate::data::{Data, Segment};
use crate::finding::{Cause, Refusal};
use crate::marquardt::{Fit, Objective, search};
use crate::options::OrderFit;

/// The highest order that is tried.
const HIGHEST: usize = 10;
/// The fewest rows between two cuts.
pub(crate) const FEWEST: usize = 24;
/// Numbers that a record must have for each unknown.
const NUMBERS: usize = 5;
const FIRST_STEPS: usize = 10;
const MORE_STEPS: usize = 90;
/// An order is as good as the best where its held-out fit is within this, %, or this part of what is missing to 100 %.
const AS_GOOD: f64 = 0.05;
const AS_GOOD_OF_MISSING: f64 = 0.02;

/// The model of the chosen order.
pub(crate) struct Choice {
    pub model: Discrete,
    pub orders: Vec<OrderFit>,
}

/// Data cut where a step isn't the commonest: a sampled model has one.
pub(crate) fn uniform(data: Data) -> Data {
    let mut segments = Vec::new();
    for segment in &data.segments {
        let mut begun = 0;
        for k in 0..segment.len() {
            let is_last = k + 1 == segment.len();
            let is_odd = !is_last && (segment.step[k] != data.steps.common || segment.rest[k] != 0.0);
            if is_last || is_odd {
                segments.push(part(segment, begun, k + 1));
                begun = k + 1;
            }
        }
    }
    segments.retain(|segment| segment.len() >= FEWEST);
    Data { segments, ..data }
}

fn part(segment: &Segment, from: usize, to: usize) -> Segment {
    let columns = |all: &DMatrix<f64>| all.columns(from, to - from).into_owned();
    Segment {
        record: segment.record,
        first: segment.first + from,
        y: columns(&segment.y),
        u: columns(&segment.u),
        mask: columns(&segment.mask),
        step: segment.step[from..to - 1].to_vec(),
        rest: segment.rest[from..to - 1].to_vec(),
    }
}

/// The highest order for which there are numbers enough.
pub(crate) fn most(data: &Data) -> Result<usize, Refusal> {
    let (m, p) = (data.m, data.n);
    let numbers: f64 = data.segments.iter().map(|segment| segment.mask.sum()).sum();
    let unknowns = |n: usize| n * (m + p) + n * data.segments.len() + p * data.records;
    let allowed = (1..=HIGHEST).take_while(|n| (NUMBERS * unknowns(*n)) as f64 <= numbers).last();
    allowed.filter(|_| data.rows() > 0).ok_or_else(|| {
        let [all, least] = [unknowns(1), NUMBERS * unknowns(1)];
        let text = format!(
            "{} rows of {p} outputs with equal steps are {numbers} numbers for {all} unknowns of one state: at least {least} \
             are needed, {} rows without a cut",
            data.rows(),
            FEWEST.max(least.div_ceil(p))
        );
        Refusal::new(Cause::TooShort, text)
    })
}

/// A model of one order.
struct Tried {
    model: Discrete,
    fit: OrderFit,
}

impl Choice {
    /// The least order that follows the held-out part as well as others do; or the one that was asked for.
    pub fn new(data: &Data, tested: Option<&Data>, wanted: Option<usize>, most: usize) -> Result<Self, Refusal> {
        let orders = match wanted {
            Some(order) if order == 0 || order > most => {
                let text = format!("order {order}: must be within 1 … {most} for this record");
                return Err(Refusal::new(Cause::Request, text));
            }
            Some(order) => order..=order,
            None => 1..=most,
        };
        let rows = data.segments.iter().map(Segment::len).sum::<usize>();
        let long = Span::new(data, 40.min(rows / 20));
        let tried: Vec<Tried> = orders.filter_map(|order| tried(data, tested, order, long.as_ref())).collect();
        let usable = || tried.iter().filter(|tried| tried.fit.is_continuous);
        let best = usable().filter_map(|tried| tried.fit.held_out).fold(f64::NEG_INFINITY, f64::max);
        let allowed = AS_GOOD.max(AS_GOOD_OF_MISSING * (100.0 - best));
        let chosen = match tested {
            Some(_) => usable().find(|tried| tried.fit.held_out.is_some_and(|fit| fit >= best - allowed)),
            // Nothing is held out: the criterion counts.
            None => usable().min_by(|p, q| p.fit.bic.total_cmp(&q.fit.bic)),
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
        Ok(Choice { model: chosen.model.clone(), orders: tried.iter().map(|tried| tried.fit).collect() })
    }
}

/// The likelier of two starts, searched on.
fn tried(data: &Data, tested: Option<&Data>, order: usize, long: Option<&Span>) -> Option<Tried> {
    let rows = data.rows();
    let objective = OutputError { data, order };
    let short = Span::new(data, (2 * order + 4).max(8).min(rows / 20));
    let starts = [short.as_ref(), long].into_iter().flatten().filter_map(|span| span.model(data, order));
    let begun = starts.filter_map(|model| search(&objective, &OutputError::unknowns(&model), FIRST_STEPS));
    let first = begun.min_by(|p, q| p.value.loss.total_cmp(&q.value.loss))?;
    let found = search(&objective, &first.unknowns, MORE_STEPS)?;
    let model = objective.model(&found.unknowns);
    let (m, p) = (data.m, data.n);
    let count = (order * (m + p) + order * data.segments.len() + p * data.records) as f64;
    let bic = found.value.loss + count * (rows as f64).ln();
    let held_out = tested.and_then(|tested| held_out_fit(tested, order, &found));
    let is_continuous = Companion::new(&model).is_some();
    let fit = OrderFit { order, held_out, bic, is_continuous };
    Some(Tried { model, fit })
}

/// Mean fit of the outputs over data, initial states and constants fitted, %.
fn held_out_fit(data: &Data, order: usize, fit: &Fit) -> Option<f64> {
    let objective = OutputError { data, order };
    let value = objective.value(&fit.unknowns, &fit.value.weights())?;
    let deviation = |i: usize| {
        let cells = data.segments.iter().flat_map(|segment| {
            (0..segment.len()).filter(move |k| segment.mask[(i, *k)] != 0.0).map(move |k| segment.y[(i, k)])
        });
        crate::data::standard_deviation(cells)
    };
    let fits = (0..data.n).map(|i| 100.0 * (1.0 - value.rms[i] / deviation(i).max(f64::MIN_POSITIVE)));
    Some(fits.sum::<f64>() / data.n as f64)
}
