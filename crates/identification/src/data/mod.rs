//! Records as estimation takes them: cut where something is missing, scaled, with their distinct steps.

mod steps;

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::layout::{Continuous, Layout, Place};
use crate::options::Options;
use crate::record::{Record, Signals};
use crate::sampled::Hold;
use crate::structure::{Entries, Entry};
use crate::text::{number, ranges};

pub(crate) use steps::Steps;

/// A step this many times longer than 95 % of the steps is a gap.
const GAP: f64 = 3.0;
/// Times and steps that differ by at most this part of a step are alike.
pub(crate) const ALIKE: f64 = 0.02;

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
    /// Places in the steps, one from each row to the next.
    pub step: Vec<usize>,
    /// The rest of that step, in samples: 0 unless there are too many steps.
    pub rest: Vec<f64>,
}

impl Segment {
    pub fn len(&self) -> usize {
        self.y.ncols()
    }

    /// The length of a step, in samples.
    pub fn length(&self, row: usize, steps: &Steps) -> f64 {
        steps.lengths[self.step[row]] + self.rest[row]
    }

    /// The cells of a measured signal that count.
    pub fn cells(&self, signal: usize) -> impl Iterator<Item = f64> + '_ {
        (0..self.len()).filter(move |k| self.mask[(signal, *k)] != 0.0).map(move |k| self.y[(signal, k)])
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
    /// Means that were subtracted from measured signals and inputs, a column for each record.
    pub centre: DMatrix<f64>,
    /// Relation of states to the measured signals, if these aren't the states themselves.
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

    /// The cells of a measured signal that count.
    pub fn cells(&self, signal: usize) -> impl Iterator<Item = f64> + '_ {
        self.segments.iter().flat_map(move |segment| segment.cells(signal))
    }

    /// The data without records of which no rows are left, and the other records.
    pub fn of_records(mut self, records: &[Record]) -> (Self, Vec<&Record>) {
        let has_rows = |record: &usize| self.segments.iter().any(|segment| segment.record == *record);
        let used: Vec<usize> = (0..records.len()).filter(has_rows).collect();
        for segment in &mut self.segments {
            segment.record = used.partition_point(|record| *record < segment.record);
        }
        self.records = used.len();
        self.centre = DMatrix::zeros(self.n + self.m, used.len());
        (self, used.into_iter().map(|record| &records[record]).collect())
    }

    /// The same without the means of signals in each record, where free constants take them up: with means that are large, constants
    /// and entries of A could hardly be distinguished. A row whose constant isn't free must not have the signal.
    pub fn centred(mut self, entries: &Entries) -> Self {
        let is_taken_up = |of: &dyn Fn(usize) -> Entry| {
            (0..self.n).all(|i| entries.d[i] == Entry::Free || of(i) == Entry::Known(0.0))
        };
        let x = (0..self.n).map(|j| is_taken_up(&|i| entries.a[i][j]));
        let is_centred: Vec<bool> = x.chain((0..self.m).map(|j| is_taken_up(&|i| entries.b[i][j]))).collect();
        for signal in (0..self.n + self.m).filter(|signal| is_centred[*signal]) {
            for record in 0..self.records {
                let of_record = self.segments.iter().filter(|segment| segment.record == record);
                let cells: Vec<f64> = match signal.checked_sub(self.n) {
                    None => of_record.flat_map(|segment| segment.cells(signal)).collect(),
                    Some(input) => {
                        of_record.flat_map(|segment| segment.u.row(input).iter().copied().collect::<Vec<_>>()).collect()
                    }
                };
                self.centre[(signal, record)] = cells.iter().sum::<f64>() / cells.len().max(1) as f64;
            }
        }
        for segment in &mut self.segments {
            let centre = self.centre.column(segment.record);
            segment.y.column_iter_mut().for_each(|mut row| row -= centre.rows(0, self.n));
            segment.y.component_mul_assign(&segment.mask);
            segment.u.column_iter_mut().for_each(|mut row| row -= centre.rows(self.n, self.m));
        }
        self
    }

    /// A model of centred data for signals as they are: its constants are d − A x̄ − B ū.
    pub fn uncentred(&self, mut model: Continuous) -> Continuous {
        model.d -= &model.a * self.centre.rows(0, self.n) + &model.b * self.centre.rows(self.n, self.m);
        model
    }

    /// Derivatives of unknowns, so many with those behind a layout's, for signals as they are by those for centred ones.
    pub fn uncentring(&self, layout: &Layout, count: usize) -> DMatrix<f64> {
        let mut derivatives = DMatrix::identity(count, count);
        for (k, constant) in layout.unknowns.iter().enumerate() {
            let Place::D(row, record) = constant.place else { continue };
            for (l, unknown) in layout.unknowns.iter().enumerate() {
                match unknown.place {
                    Place::A(i, j) if i == row => derivatives[(k, l)] = -self.centre[(j, record)],
                    Place::B(i, j) if i == row => derivatives[(k, l)] = -self.centre[(self.n + j, record)],
                    _ => {}
                }
            }
        }
        derivatives
    }
}

/// A part of each record.
pub(crate) type Part = Vec<Range<usize>>;

/// Records as they are read: rows, and where they are cut.
pub(crate) struct Source<'a> {
    pub records: &'a [Record],
    /// Columns of the inputs, delayed, for each record.
    inputs: Vec<Vec<Vec<f64>>>,
    measured: Vec<Vec<&'a [f64]>>,
    /// First row of each record at which all inputs with their delays are known.
    begins: Vec<usize>,
    /// First signal of each record that has no values.
    without_values: Vec<Option<String>>,
    longest_delay: f64,
    /// Longest step of each record that is no gap, s.
    gaps: Vec<f64>,
    /// The fewest rows of a segment.
    pub fewest: usize,
}

impl<'a> Source<'a> {
    pub fn new(records: &'a [Record], signals: &Signals, options: &Options, fewest: usize) -> Result<Self, Refusal> {
        signals.check(records)?;
        records.iter().try_for_each(Record::check)?;
        let column = |record: &'a Record, name: &String| record.column(name).map_or(&[][..], |column| &column.values);
        let delay = |j: usize| options.delays.get(j).copied().unwrap_or(0.0);
        let inputs = records.iter().map(|record| {
            let names = signals.inputs.iter().enumerate();
            names.map(|(j, name)| delayed(&record.time, column(record, name), delay(j), options.hold)).collect()
        });
        let measured = |record| signals.measured.iter().map(|name| column(record, name)).collect();
        let longest = options.delays.iter().copied().fold(0.0, f64::max);
        let begins = |record: &Record| {
            let near = ALIKE * gap(&record.time) / GAP;
            record.time.partition_point(|time| time - record.time[0] < longest - near)
        };
        let without_values = |record: &'a Record| {
            let mut all = signals.inputs.iter().chain(&signals.measured);
            all.find(|name| column(record, name).iter().all(|value| value.is_nan())).cloned()
        };
        Ok(Source {
            records,
            without_values: records.iter().map(without_values).collect(),
            longest_delay: longest,
            inputs: inputs.collect(),
            measured: records.iter().map(measured).collect(),
            begins: records.iter().map(begins).collect(),
            gaps: records.iter().map(|record| gap(&record.time)).collect(),
            fewest,
        })
    }

    /// Ranges of rows without anything missing, of a part of a record; what was found on the way, if asked for.
    fn cut(&self, record: usize, part: &Range<usize>, findings: &mut Option<&mut Vec<Finding>>) -> Vec<Range<usize>> {
        let time = &self.records[record].time;
        let missing_input = |row: usize| self.inputs[record].iter().any(|column| column[row].is_nan());
        let missing_all = |row: usize| self.measured[record].iter().all(|column| column[row].is_nan());
        let (mut ranges, mut start) = (Vec::new(), None);
        let (mut gaps, mut missing) = (Vec::new(), Vec::new());
        let part = part.start.max(self.begins[record]).min(part.end)..part.end;
        for row in part.clone() {
            let is_missing = missing_input(row) || missing_all(row);
            let is_late = row > part.start && time[row] - time[row - 1] > self.gaps[record];
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
        let (long, short): (Vec<_>, Vec<_>) = ranges.into_iter().partition(|range| range.len() >= self.fewest);
        match findings {
            Some(findings) if long.is_empty() => {
                let text = format!("{} is left out: {}", self.records[record].name, self.too_short(record));
                findings.push(Finding::warning(Kind::LeftOut, text));
            }
            Some(findings) => {
                self.report_cuts(record, [&gaps, &missing], findings);
                self.report_cells(record, &part, &missing, findings);
                self.report_short(record, &short, findings);
            }
            None => {}
        }
        long
    }

    /// The reason for which a record has no rows.
    fn too_short(&self, record: usize) -> String {
        let (of, fewest) = (&self.records[record], self.fewest);
        let length = of.time[of.len() - 1] - of.time[0];
        if of.len() < fewest {
            format!("it has {} row{}, and at least {fewest} are needed", of.len(), if of.len() == 1 { "" } else { "s" })
        } else if let Some(name) = &self.without_values[record] {
            format!("{name} has no values")
        } else if self.begins[record] + fewest > of.len() {
            let delay = number(self.longest_delay);
            format!("a delay of {delay} s leaves fewer than {fewest} rows of its {} s", number(length))
        } else {
            format!("fewer than {fewest} consecutive rows have all values")
        }
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
                number(gap(&record.time))
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

    fn report_short(&self, record: usize, short: &[Range<usize>], findings: &mut Vec<Finding>) {
        let record = &self.records[record];
        let rows: Vec<usize> = short.iter().cloned().flatten().map(|row| record.place(row)).collect();
        if !rows.is_empty() {
            let text = format!(
                "{}: {} {}: fewer than {} rows between two cuts are left out",
                record.name,
                record.row_word(),
                ranges(&rows),
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
            return Err(Refusal::new(Cause::TooShort, format!("{}: {}", self.records[0].name, self.too_short(0))));
        }
        let scaling = match scaling {
            Some(scaling) => scaling.clone(),
            None => self.scaling(&cuts, Steps::commonest(&flat)),
        };
        let steps = Steps::new(&flat, scaling.h);
        if let Some(findings) = findings.filter(|_| !steps.is_single()) {
            let [least, most] = steps.extremes().map(|step| number(step * scaling.h));
            // Steps that differ only by a clock's rounding get no note.
            if least != most {
                findings.push(Finding::note(Kind::StepsDiffer, format!("steps differ: {least} … {most} s")));
            }
        }
        let segments = cuts.iter().zip(&all).map(|((record, range), lengths)| {
            let (step, rest) = lengths.iter().map(|length| steps.place(length / scaling.h)).unzip();
            self.segment(*record, range, &scaling, step, rest)
        });
        let (n, m) = (self.measured[0].len(), self.inputs[0].len());
        let (records, segments) = (self.records.len(), segments.collect());
        Ok(Data { n, m, segments, steps, scaling, records, centre: DMatrix::zeros(n + m, records), observed: None })
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

/// The longest step of a record that is no gap, s.
fn gap(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(((steps.len() as f64 - 1.0) * 0.95).round() as usize).map_or(f64::INFINITY, |step| GAP * step)
}

/// A column that acts later: its value at that time before. NaN where nothing was recorded yet. Times that differ by little of a step
/// are the same, since clocks are rounded.
fn delayed(time: &[f64], values: &[f64], delay: f64, hold: Hold) -> Vec<f64> {
    if delay == 0.0 {
        return values.to_vec();
    }
    let near = ALIKE * gap(time) / GAP;
    let late = |now: &f64| {
        let then = now - delay;
        let after = time.partition_point(|other| *other <= then + near);
        let Some(row) = after.checked_sub(1) else { return f64::NAN };
        if hold == Hold::ZeroOrder || after == time.len() {
            return values[row];
        }
        let part = (then - time[row]) / (time[after] - time[row]);
        if part < 1e-6 { values[row] } else { values[row] + (values[after] - values[row]) * part }
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
