//! Records as estimation takes them: cut where something is missing, scaled, with their distinct steps.

mod steps;

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::record::{Record, Signals};
use crate::text::{number, ranges};

pub(crate) use steps::Steps;

/// A step this many times longer than 95 % of the steps is a gap.
const GAP: f64 = 3.0;

/// Units in which everything is estimated: each signal over its standard deviation, time in samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scaling {
    pub x: Vec<f64>,
    pub u: Vec<f64>,
    /// The commonest step, s.
    pub h: f64,
}

/// Consecutive rows without anything missing between them, scaled.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    /// Its record.
    pub record: usize,
    /// The row in the record of its first column.
    pub first: usize,
    /// Measured signals, a column a row.
    pub y: DMatrix<f64>,
    /// Inputs, a column a row.
    pub u: DMatrix<f64>,
    /// 1 where a cell counts, 0 where it doesn't.
    pub mask: DMatrix<f64>,
    /// From each row to the next: the place in the steps.
    pub step: Vec<usize>,
    /// The rest of that step, in samples: 0 unless there are too many steps.
    pub rest: Vec<f64>,
}

impl Segment {
    pub fn len(&self) -> usize {
        self.y.ncols()
    }
}

/// Records, prepared.
#[derive(Debug, Clone)]
pub(crate) struct Data {
    /// The number of measured signals.
    pub n: usize,
    pub m: usize,
    pub segments: Vec<Segment>,
    pub steps: Steps,
    pub scaling: Scaling,
    /// The number of records.
    pub records: usize,
    /// How states show in the measured signals, where these aren't the states themselves.
    pub observed: Option<Observed>,
}

/// Outputs of states that aren't measured.
#[derive(Debug, Clone)]
pub(crate) struct Observed {
    /// Scaled outputs of scaled states.
    pub c: DMatrix<f64>,
    /// Units of the states.
    pub scaling: Scaling,
    /// True if each output has a constant in each window, which is projected out with the initial state.
    pub has_constants: bool,
}

impl Data {
    /// The number of states.
    pub fn states(&self) -> usize {
        self.observed.as_ref().map_or(self.n, |observed| observed.c.ncols())
    }

    /// The number of unknowns of each window that are projected out.
    pub fn projected(&self) -> usize {
        let constants = self.observed.as_ref().filter(|observed| observed.has_constants).map_or(0, |_| self.n);
        self.states() + constants
    }

    /// Units of the states and inputs.
    pub fn state_scaling(&self) -> &Scaling {
        self.observed.as_ref().map_or(&self.scaling, |observed| &observed.scaling)
    }

    /// The number of rows in segments.
    pub fn rows(&self) -> usize {
        self.segments.iter().map(Segment::len).sum()
    }
}

/// A part of each record.
pub(crate) type Part = Vec<Range<usize>>;

/// Records as they are read: rows, and where they are cut.
pub(crate) struct Source<'a> {
    pub records: &'a [Record],
    /// For each record, columns of the inputs, delayed.
    inputs: Vec<Vec<Vec<f64>>>,
    measured: Vec<Vec<&'a [f64]>>,
    /// The longest step that is no gap, s.
    gap: f64,
    /// The fewest rows of a segment.
    fewest: usize,
}

impl<'a> Source<'a> {
    pub fn new(records: &'a [Record], signals: &Signals, delays: &[f64], fewest: usize) -> Result<Self, Refusal> {
        signals.check(records)?;
        records.iter().try_for_each(Record::check)?;
        let column = |record: &'a Record, name: &String| record.column(name).map_or(&[][..], |column| &column.values);
        let inputs = records.iter().map(|record| {
            let names = signals.inputs.iter().enumerate();
            let late = |(j, name)| delayed(&record.time, column(record, name), delays.get(j).copied().unwrap_or(0.0));
            names.map(late).collect()
        });
        let measured = |record| signals.measured.iter().map(|name| column(record, name)).collect();
        let mut all: Vec<f64> =
            records.iter().flat_map(|record| record.time.windows(2).map(|pair| pair[1] - pair[0])).collect();
        if all.is_empty() {
            return Err(Refusal::new(Cause::TooShort, "the record has one row"));
        }
        all.sort_by(f64::total_cmp);
        let gap = GAP * all[((all.len() - 1) as f64 * 0.95).round() as usize];
        Ok(Source { records, inputs: inputs.collect(), measured: records.iter().map(measured).collect(), gap, fewest })
    }

    /// Ranges of rows without anything missing, of a part of a record; what was found on the way, if asked for.
    fn cut(&self, record: usize, part: &Range<usize>, findings: &mut Option<&mut Vec<Finding>>) -> Vec<Range<usize>> {
        let time = &self.records[record].time;
        let missing_input = |row: usize| self.inputs[record].iter().any(|column| column[row].is_nan());
        let missing_all = |row: usize| self.measured[record].iter().all(|column| column[row].is_nan());
        let (mut ranges, mut start) = (Vec::new(), None);
        let (mut gaps, mut missing) = (Vec::new(), Vec::new());
        for row in part.clone() {
            let is_missing = missing_input(row) || missing_all(row);
            let is_late = row > part.start && time[row] - time[row - 1] > self.gap;
            if is_late {
                gaps.push(row);
            }
            if is_missing {
                missing.push(row);
            }
            if (is_missing || is_late)
                && let Some(begun) = start.take()
            {
                ranges.push(begun..row);
            }
            if !is_missing && start.is_none() {
                start = Some(row);
            }
        }
        ranges.extend(start.map(|begun| begun..part.end));
        if let Some(findings) = findings {
            self.report_cuts(record, [&gaps, &missing], findings);
            self.report_cells(record, part, &missing, findings);
            self.report_short(record, &ranges, findings);
        }
        ranges.retain(|range| range.len() >= self.fewest);
        ranges
    }

    fn report_cuts(&self, record: usize, [gaps, missing]: [&[usize]; 2], findings: &mut Vec<Finding>) {
        let record = &self.records[record];
        let places = |rows: &[usize]| ranges(&rows.iter().map(|row| record.place(*row)).collect::<Vec<_>>());
        let word = record.row_word();
        if !gaps.is_empty() {
            let text = format!(
                "{}: a gap before {word} {}: steps above {} s; the record is cut there",
                record.name,
                places(gaps),
                number(self.gap)
            );
            findings.push(Finding::note(Kind::Gap, text));
        }
        if !missing.is_empty() {
            let text =
                format!("{}: {word} {}: values are missing; the record is cut there", record.name, places(missing));
            findings.push(Finding::note(Kind::Gap, text));
        }
    }

    fn report_cells(&self, record: usize, part: &Range<usize>, missing: &[usize], findings: &mut Vec<Finding>) {
        let of = &self.records[record];
        let is_lone = |row: &usize| !missing.contains(row) && self.measured[record].iter().any(|c| c[*row].is_nan());
        let rows: Vec<usize> = part.clone().filter(is_lone).map(|row| of.place(row)).collect();
        if !rows.is_empty() {
            let text = format!(
                "{}: {} {}: some states are missing; their weight is 0 there",
                of.name,
                of.row_word(),
                ranges(&rows)
            );
            findings.push(Finding::note(Kind::MissingCells, text));
        }
    }

    fn report_short(&self, record: usize, cut: &[Range<usize>], findings: &mut Vec<Finding>) {
        let record = &self.records[record];
        for range in cut.iter().filter(|range| range.len() < self.fewest) {
            let (first, last) = (record.place(range.start), record.place(range.end - 1));
            let text = format!(
                "{}: {} {first} … {last}: fewer than {} rows between two cuts are left out",
                record.name,
                record.row_word(),
                self.fewest
            );
            findings.push(Finding::note(Kind::ShortWindow, text));
        }
    }

    /// Data of a part of each record. Without a scaling, that of these rows.
    pub fn data(
        &self,
        part: &Part,
        scaling: Option<&Scaling>,
        mut findings: Option<&mut Vec<Finding>>,
    ) -> Result<Data, Refusal> {
        let cuts: Vec<(usize, Range<usize>)> = part
            .iter()
            .enumerate()
            .flat_map(|(record, part)| {
                self.cut(record, part, &mut findings).into_iter().map(move |range| (record, range))
            })
            .collect();
        let lengths = |(record, range): &(usize, Range<usize>)| {
            let time = &self.records[*record].time[range.clone()];
            time.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>()
        };
        let all: Vec<Vec<f64>> = cuts.iter().map(lengths).collect();
        let flat: Vec<f64> = all.concat();
        if flat.is_empty() {
            let text = format!("no {} consecutive rows have all values", self.fewest);
            return Err(Refusal::new(Cause::TooShort, text));
        }
        let scaling = match scaling {
            Some(scaling) => scaling.clone(),
            None => self.scaling(&cuts, Steps::commonest(&flat)),
        };
        let steps = Steps::new(&flat, scaling.h);
        if let Some(findings) = findings.filter(|_| !steps.is_single()) {
            let [least, most] = steps.extremes();
            let text = format!("steps differ: {} … {} s", number(least * scaling.h), number(most * scaling.h));
            findings.push(Finding::note(Kind::StepsDiffer, text));
        }
        let segments = cuts.iter().zip(&all).map(|((record, range), lengths)| {
            let (step, rest) = lengths.iter().map(|length| steps.place(length / scaling.h)).unzip();
            self.segment(*record, range, &scaling, step, rest)
        });
        let (n, m) = (self.measured[0].len(), self.inputs[0].len());
        Ok(Data { n, m, segments: segments.collect(), steps, scaling, records: self.records.len(), observed: None })
    }

    fn segment(
        &self,
        record: usize,
        rows: &Range<usize>,
        scaling: &Scaling,
        step: Vec<usize>,
        rest: Vec<f64>,
    ) -> Segment {
        let (inputs, measured) = (&self.inputs[record], &self.measured[record]);
        let at = |row: usize| rows.start + row;
        let u = DMatrix::from_fn(inputs.len(), rows.len(), |j, row| inputs[j][at(row)] / scaling.u[j]);
        let mask = DMatrix::from_fn(measured.len(), rows.len(), |i, row| f64::from(!measured[i][at(row)].is_nan()));
        let value =
            |i: usize, row: usize| if mask[(i, row)] == 0.0 { 0.0 } else { measured[i][at(row)] / scaling.x[i] };
        let y = DMatrix::from_fn(measured.len(), rows.len(), value);
        Segment { record, first: rows.start, y, u, mask, step, rest }
    }

    fn scaling(&self, cuts: &[(usize, Range<usize>)], h: f64) -> Scaling {
        let deviation = |column: &dyn Fn(usize) -> &'a [f64]| {
            let values = cuts.iter().flat_map(|(record, range)| column(*record)[range.clone()].iter());
            standard_deviation(values.copied().filter(|value| value.is_finite()))
        };
        let positive = |value: f64| if value > 0.0 { value } else { 1.0 };
        let x = (0..self.measured[0].len()).map(|i| positive(deviation(&|record| self.measured[record][i])));
        let u = (0..self.inputs[0].len()).map(|j| {
            let values = cuts.iter().flat_map(|(record, range)| self.inputs[*record][j][range.clone()].iter());
            positive(standard_deviation(values.copied()))
        });
        Scaling { x: x.collect(), u: u.collect(), h }
    }
}

/// A column that acts later: its value at that time before. NaN where nothing was recorded yet.
fn delayed(time: &[f64], values: &[f64], delay: f64) -> Vec<f64> {
    if delay == 0.0 {
        return values.to_vec();
    }
    let late = |now: &f64| {
        let then = now - delay;
        let after = time.partition_point(|other| *other <= then + 1e-9 * delay.abs());
        after.checked_sub(1).map_or(f64::NAN, |row| values[row])
    };
    time.iter().map(late).collect()
}

/// The standard deviation; 0 of no values.
pub(crate) fn standard_deviation(values: impl Iterator<Item = f64>) -> f64 {
    let all = DVector::from_vec(values.collect());
    if all.is_empty() {
        return 0.0;
    }
    let mean = all.mean();
    (all.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
}

#[cfg(test)]
mod tests;
