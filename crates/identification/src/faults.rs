//! Faults of records that are seen before anything is estimated.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::layout::Place;
use crate::linear::least_squares;
use crate::record::{Record, Signals};
use crate::text::{combination, number};

/// Numbers that a record must have for each unknown.
pub(crate) const NUMBERS: usize = 5;
/// Part of the variance that a relation must explain to be one, of values and of their differences.
const RELATED: f64 = 0.999;
const RELATED_DIFFERENCES: f64 = 0.98;
/// Part of the rows at a limit that is reported.
const AT_LIMIT: f64 = 0.2;
/// Signals of so few levels are levels on purpose.
const LEVELS: usize = 3;

/// Names and units of signals in messages.
pub(crate) struct Names<'a> {
    pub signals: &'a Signals,
    pub input_units: Vec<String>,
    pub measured_units: Vec<String>,
}

impl<'a> Names<'a> {
    pub fn new(signals: &'a Signals, record: &Record) -> Self {
        let unit = |name: &String| record.column(name).and_then(|column| column.unit.clone()).unwrap_or_default();
        Names {
            signals,
            input_units: signals.inputs.iter().map(unit).collect(),
            measured_units: signals.measured.iter().map(unit).collect(),
        }
    }
}

impl Names<'_> {
    /// Name of an entry: `d(load_speed)/twist`, a part of the derivative of one signal by another.
    pub fn entry(&self, place: Place) -> String {
        let Signals { inputs, measured } = self.signals;
        match place {
            Place::A(i, j) => format!("d({})/{}", measured[i], measured[j]),
            Place::B(i, j) => format!("d({})/{}", measured[i], inputs[j]),
            Place::D(i, record) => format!("constant of d({}) in record {}", measured[i], record + 1),
        }
    }
}

/// A value with its unit.
fn with_unit(value: f64, unit: &str) -> String {
    if unit.is_empty() { number(value) } else { format!("{} {unit}", number(value)) }
}

/// Refuses fewer numbers than five an unknown.
pub(crate) fn too_short(data: &Data, unknowns: usize, what: &str) -> Result<(), Refusal> {
    let n = data.n;
    let gain = n * n;
    let initial = n * data.segments.len();
    let all = unknowns + gain + initial;
    let numbers: f64 = data.segments.iter().map(|segment| segment.mask.sum()).sum();
    let least = NUMBERS * all;
    if numbers.round() as usize >= least {
        return Ok(());
    }
    let text = format!(
        "{} rows of {n} {what} are {numbers} numbers for {all} unknowns ({unknowns}, {gain} of K, {initial} initial): \
         at least {least} are needed, {} rows",
        data.rows(),
        least.div_ceil(n)
    );
    Err(Refusal::new(Cause::TooShort, text))
}

/// An input as values of all rows.
fn input(data: &Data, j: usize) -> Vec<f64> {
    data.segments.iter().flat_map(|segment| segment.u.row(j).iter().copied().collect::<Vec<_>>()).collect()
}

/// Refuses inputs that never move, that move together, or that are feedback of the states without anything added.
pub(crate) fn inputs(data: &Data, names: &Names, offsets: bool, are_states: bool) -> Result<(), Refusal> {
    resting(data, names)?;
    still(data, names, offsets)?;
    together(data, names)?;
    if are_states { feedback(data, names) } else { Ok(()) }
}

/// Refuses measured signals that never move.
fn resting(data: &Data, names: &Names) -> Result<(), Refusal> {
    for (i, name) in names.signals.measured.iter().enumerate() {
        let least = data.cells(i).fold(f64::INFINITY, f64::min);
        let most = data.cells(i).fold(f64::NEG_INFINITY, f64::max);
        if least > most {
            return Err(Refusal::new(Cause::StillState, format!("{name} has no values")));
        }
        if most - least <= 1e-9 * least.abs().max(most.abs()) {
            let scale = data.scaling.x[i];
            let range = format!("{} … {}", number(least * scale), with_unit(most * scale, &names.measured_units[i]));
            let text = format!("{name} never moves ({range}): there is nothing to model. Leave it out, or excite it");
            return Err(Refusal::new(Cause::StillState, text));
        }
    }
    Ok(())
}

fn still(data: &Data, names: &Names, offsets: bool) -> Result<(), Refusal> {
    for j in 0..data.m {
        let range = |record: Option<usize>| {
            let of = data.segments.iter().filter(|segment| record.is_none_or(|record| segment.record == record));
            let row = of.map(|segment| segment.u.row(j));
            row.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), row| {
                (least.min(row.min()), most.max(row.max()))
            })
        };
        let moves = |(least, most): (f64, f64)| most - least > 1e-9 * least.abs().max(most.abs());
        // What is constant in each record can't be distinguished from that record's constant.
        let any = if offsets { (0..data.records).any(|record| moves(range(Some(record)))) } else { moves(range(None)) };
        if !any {
            let (least, most) = range(None);
            let (name, scale) = (&names.signals.inputs[j], data.scaling.u[j]);
            let text = if moves((least, most)) {
                format!(
                    "{name} is constant in each record, as the record's constant is: leave the constant out, or record several \
                     levels in one record"
                )
            } else {
                format!(
                    "{name} never moves ({} … {}): its effect can't be seen. Excite it, or leave it out as a fixed input",
                    number(least * scale),
                    with_unit(most * scale, &names.input_units[j])
                )
            };
            return Err(Refusal::new(Cause::StillInput, text));
        }
    }
    Ok(())
}

/// A relation of a signal to others and a constant for each record.
struct Relation {
    /// Factors of the others, then constants; scaled.
    factors: Vec<f64>,
    /// The part of the variance that it doesn't explain.
    rest: f64,
    residual: Vec<f64>,
}

fn relation(data: &Data, signal: &[f64], others: &DMatrix<f64>) -> Option<Relation> {
    let of_rows = data.segments.iter().flat_map(|segment| std::iter::repeat_n(segment.record, segment.len()));
    let records: Vec<usize> = of_rows.collect();
    let width = others.ncols();
    let left = DMatrix::from_fn(signal.len(), width + data.records, |row, column| {
        if column < width { others[(row, column)] } else { f64::from(records[row] == column - width) }
    });
    let right = DMatrix::from_column_slice(signal.len(), 1, signal);
    let solution = least_squares(&left, &right)?;
    let residual = &right - left * &solution;
    // Of what it does within records.
    let constants = left_constants(&records, data.records);
    let mean = least_squares(&constants, &right)?;
    let motion = (&right - constants * mean).norm_squared();
    Some(Relation {
        factors: solution.as_slice().to_vec(),
        rest: residual.norm_squared() / motion.max(f64::MIN_POSITIVE),
        residual: residual.as_slice().to_vec(),
    })
}

fn left_constants(records: &[usize], count: usize) -> DMatrix<f64> {
    DMatrix::from_fn(records.len(), count, |row, record| f64::from(records[row] == record))
}

impl Relation {
    /// The relation in units of the data. Terms that do next to nothing are left out.
    fn text(&self, names: &[&str], scales: &[f64], others: &DMatrix<f64>, scale: f64) -> String {
        let deviation = |j: usize| crate::data::standard_deviation(others.column(j).iter().copied());
        let matters = |j: &usize| (self.factors[*j] * deviation(*j)).abs() > 1e-3;
        let places: Vec<usize> = (0..names.len()).filter(matters).collect();
        let terms: Vec<(f64, &str)> =
            places.iter().map(|j| (self.factors[*j] * scale / scales[*j], names[*j])).collect();
        let is_single = self.factors.len() == names.len() + 1;
        let constant = if is_single { self.factors[names.len()] * scale } else { 0.0 };
        let constant = if (constant / scale).abs() > 1e-3 { constant } else { 0.0 };
        combination(&terms, constant)
    }
}

fn together(data: &Data, names: &Names) -> Result<(), Refusal> {
    let all: Vec<Vec<f64>> = (0..data.m).map(|j| input(data, j)).collect();
    // The last one that follows from others is the one to name.
    for j in (1..data.m).rev() {
        let before: Vec<usize> = (0..data.m).filter(|other| *other != j).collect();
        let others = DMatrix::from_fn(all[j].len(), before.len(), |row, column| all[before[column]][row]);
        let Some(found) = relation(data, &all[j], &others).filter(|found| found.rest < 1.0 - RELATED) else { continue };
        let known: Vec<&str> = before.iter().map(|other| names.signals.inputs[*other].as_str()).collect();
        let scales: Vec<f64> = before.iter().map(|other| data.scaling.u[*other]).collect();
        let text = format!(
            "{} = {} within {} %: their effects can't be distinguished. Move them independently",
            names.signals.inputs[j],
            found.text(&known, &scales, &others, data.scaling.u[j]),
            number(100.0 * found.rest.sqrt())
        );
        return Err(Refusal::new(Cause::DependentInputs, text));
    }
    Ok(())
}

fn feedback(data: &Data, names: &Names) -> Result<(), Refusal> {
    let all: Vec<f64> = data.segments.iter().flat_map(|segment| segment.y.iter().copied()).collect();
    let others = DMatrix::from_row_slice(data.rows(), data.n, &all);
    let ends: Vec<usize> = data
        .segments
        .iter()
        .scan(0, |at, segment| {
            *at += segment.len();
            Some(*at)
        })
        .collect();
    for j in 0..data.m {
        let u = input(data, j);
        let Some(found) = relation(data, &u, &others).filter(|found| found.rest < 1.0 - RELATED) else { continue };
        let differences = |values: &[f64]| {
            let within = (1..values.len()).filter(|row| ends.binary_search(row).is_err());
            within.map(|row| (values[row] - values[row - 1]).powi(2)).sum::<f64>()
        };
        if differences(&found.residual) > (1.0 - RELATED_DIFFERENCES) * differences(&u) {
            continue;
        }
        let known: Vec<&str> = names.signals.measured.iter().map(String::as_str).collect();
        let text = format!(
            "{} = {}: a feedback without anything added, so A and B can't be distinguished. Add levels to the input, \
             or change the gains half-way",
            names.signals.inputs[j],
            found.text(&known, &data.scaling.x, &others, data.scaling.u[j])
        );
        return Err(Refusal::new(Cause::Feedback, text));
    }
    Ok(())
}

/// Values in growing order without those that are the same.
fn distinct(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let span = sorted.last().unwrap_or(&0.0) - sorted.first().unwrap_or(&0.0);
    sorted.dedup_by(|p, q| (*p - *q).abs() <= 1e-9 * span);
    sorted
}

/// Warnings and notes: inputs at a limit, signals of few values.
pub(crate) fn warnings(data: &Data, names: &Names, findings: &mut Vec<Finding>) {
    for j in 0..data.m {
        let u = input(data, j);
        let values = distinct(&u);
        if values.len() <= LEVELS {
            continue;
        }
        let span = values[values.len() - 1] - values[0];
        for limit in [values[0], values[values.len() - 1]] {
            let part = u.iter().filter(|value| (*value - limit).abs() <= 1e-9 * span).count() as f64 / u.len() as f64;
            if part > AT_LIMIT {
                let text = format!(
                    "{} is at {} in {} % of the rows: is this what acted? The model needs what acted, not what was asked for",
                    names.signals.inputs[j],
                    with_unit(limit * data.scaling.u[j], &names.input_units[j]),
                    (100.0 * part).round()
                );
                findings.push(Finding::warning(Kind::InputAtLimit, text));
            }
        }
    }
    for i in 0..data.n {
        if let Some(step) = quantum(data, i) {
            let step = step * data.scaling.x[i];
            let unit = &names.measured_units[i];
            let text = format!(
                "{} has steps of {}: at least {} of its noise is that",
                names.signals.measured[i],
                with_unit(step, unit),
                with_unit(step / 12.0_f64.sqrt(), unit)
            );
            findings.push(Finding::note(Kind::Quantised, text));
        }
    }
}

/// The step of a signal of few distinct values, which are all multiples of it apart.
fn quantum(data: &Data, i: usize) -> Option<f64> {
    let all = data.cells(i).collect::<Vec<_>>();
    let values = distinct(&all);
    if values.len() < 2 || 4 * values.len() > all.len() {
        return None;
    }
    let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let is_multiple = |pair: &[f64]| {
        let times = (pair[1] - pair[0]) / step;
        (times - times.round()).abs() < 1e-3 * times
    };
    values.windows(2).all(is_multiple).then_some(step)
}
