//! Residuals of simulations, and their derivatives by differences.

use adaptive_fmu_identification::marquardt::{Objective, Sums, Value};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{Recorded, Task, Unknown};
use crate::error::{Error, Invalid};
use crate::fmu::{SHOWS_VARIABLES, set_starts};
use crate::near;
use crate::parallel;
use crate::report::number;
use crate::workers::{employed, results};

/// Step of differences, in parts of the scale of an unknown.
const DIFFERENCE: f64 = 1e-4;

/// Simulations of all records.
pub(super) struct Simulated<'a> {
    pub task: &'a Task<'a>,
    pub unknowns: Vec<Unknown>,
    references: Vec<u32>,
    /// Rows of each record that the search uses.
    pub seen: Vec<usize>,
}

/// A run for a worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Place of the record.
    pub record: usize,
    /// Values of the unknowns.
    pub point: Vec<f64>,
}

/// Its result: outputs, one after the other at each row, or the reason of its failure.
pub type Done = Result<Vec<f64>, String>;

/// Outputs of all records: a row an output, a column a row of the record.
type Courses = Vec<DMatrix<f64>>;

impl<'a> Simulated<'a> {
    pub fn new(task: &'a Task<'a>, unknowns: Vec<Unknown>) -> Result<Self, Error> {
        let variables = &task.fmu.description.variables;
        let reference = |name: &String| {
            let outputs = || variables.iter().filter(|v| v.kind == "Real" && v.causality != "parameter");
            outputs().find(|variable| variable.name == *name).map(|variable| variable.reference).ok_or_else(|| {
                let known: Vec<_> = outputs().map(|variable| variable.name.as_str()).collect();
                let allowed = format!("is not an output of the FMU; {}", near::choice(name, &known, SHOWS_VARIABLES));
                Error::Argument(Invalid::new("--outputs", name, allowed))
            })
        };
        let references = task.outputs.iter().map(reference).collect::<Result<_, _>>()?;
        let seen = |record: &Recorded| {
            let rows = record.inputs.times().len();
            (rows - (task.hold_out * rows as f64).round() as usize).max(1)
        };
        Ok(Simulated { task, unknowns, references, seen: task.records.iter().map(seen).collect() })
    }

    /// The outputs at a point.
    pub fn outputs_at(&self, point: &[f64]) -> Result<Courses, Error> {
        (0..self.task.records.len()).map(|record| self.simulate(record, point)).collect()
    }

    /// The outputs at some points, on all threads or by the workers of the command; `None` for a run that fails.
    fn outputs_at_each(&self, points: &[Vec<f64>]) -> Vec<Option<Courses>> {
        let records = self.task.records.len();
        let Some(workers) = employed() else {
            let threads = vec![(); parallel::cores()];
            return parallel::each(&threads, points.len(), |(), k| self.outputs_at(&points[k]).ok());
        };
        let jobs = points
            .iter()
            .flat_map(|point| (0..records).map(|record| Job { record, point: point.clone() }))
            .collect::<Vec<_>>();
        let made: Vec<Option<Done>> = results(&*workers, jobs, |_| ());
        let course = |done: &Option<Done>| {
            let columns = done.as_ref()?.as_ref().ok()?;
            let rows = self.references.len();
            Some(DMatrix::from_column_slice(rows, columns.len() / rows.max(1), columns))
        };
        made.chunks(records.max(1)).map(|of_point| of_point.iter().map(course).collect()).collect()
    }

    /// Does a job: the outputs of a record at a point, column by column, or the reason why the run fails.
    pub fn carry_out(&self, Job { record, point }: &Job) -> Done {
        let outputs = self.simulate(*record, point).map_err(|error| error.to_string());
        outputs.map(|outputs| outputs.as_slice().to_vec())
    }

    fn simulate(&self, place: usize, point: &[f64]) -> Result<DMatrix<f64>, Error> {
        let (fmu, record) = (self.task.fmu, &self.task.records[place]);
        let times = record.inputs.times();
        let mut instance = fmu.instantiate(&fmu.description.name)?;
        set_starts(&instance, self.task.start)?;
        for (unknown, q) in
            self.unknowns.iter().zip(point).filter(|(unknown, _)| unknown.record.is_none_or(|of| of == place))
        {
            instance.set_real(&[unknown.reference], &[unknown.value(*q)])?;
        }
        let mut courses = DMatrix::zeros(self.references.len(), times.len());
        instance.enter_initialization(times[0], times[times.len() - 1])?;
        record.inputs.set(&instance, times[0])?;
        instance.exit_initialization()?;
        for (row, &time) in times.iter().enumerate() {
            instance.get_real(&self.references, courses.column_mut(row).as_mut_slice())?;
            let Some(next) = times.get(row + 1) else { break };
            record.inputs.set(&instance, time)?;
            instance.do_step(time, next - time)?;
        }
        if let Some(value) = courses.iter().find(|value| !value.is_finite()) {
            let reason = format!("an output of the simulation of {} is {}", record.name, number(*value));
            return Err(Error::Archive { file: fmu.file().to_owned(), reason });
        }
        Ok(courses)
    }

    /// True where the record has a value that the search uses.
    pub fn counts(&self, record: usize, output: usize, row: usize) -> bool {
        row < self.seen[record] && self.task.records[record].outputs[output][row].is_finite()
    }

    /// Values that count, without their mean over each record if sensors may have constant errors.
    fn projected(&self, record: usize, courses: &DMatrix<f64>) -> DMatrix<f64> {
        let counts = |i: usize, row: usize| self.counts(record, i, row);
        let mut stored =
            DMatrix::from_fn(
                courses.nrows(),
                self.seen[record],
                |i, row| {
                    if counts(i, row) { courses[(i, row)] } else { 0.0 }
                },
            );
        if self.task.has_offsets {
            for i in 0..stored.nrows() {
                let count = (0..stored.ncols()).filter(|&row| counts(i, row)).count().max(1);
                let mean = stored.row(i).sum() / count as f64;
                (0..stored.ncols()).filter(|&row| counts(i, row)).for_each(|row| stored[(i, row)] -= mean);
            }
        }
        stored
    }

    /// Simulated minus measured values, all of them.
    pub fn differences(&self, record: usize, courses: &DMatrix<f64>) -> DMatrix<f64> {
        let measured = &self.task.records[record].outputs;
        DMatrix::from_fn(courses.nrows(), courses.ncols(), |i, row| courses[(i, row)] - measured[i][row])
    }

    /// Residuals of what the search sees.
    pub fn residuals(&self, point: &[f64]) -> Option<Courses> {
        let courses = self.outputs_at_each(&[point.to_vec()]).pop()??;
        Some(
            courses
                .iter()
                .enumerate()
                .map(|(record, of)| self.projected(record, &self.differences(record, of)))
                .collect(),
        )
    }

    /// Derivatives of the residuals by each unknown.
    pub fn derivatives(&self, point: &[f64]) -> Option<Vec<Courses>> {
        let moved = |k: usize, sign: f64| {
            let mut at = point.to_vec();
            at[k] += sign * DIFFERENCE;
            at
        };
        let points: Vec<_> = (0..point.len()).flat_map(|k| [moved(k, 1.0), moved(k, -1.0)]).collect();
        let mut all = self.outputs_at_each(&points).into_iter();
        let mut derivatives = Vec::new();
        while let (Some(above), Some(below)) = (all.next(), all.next()) {
            let of = |(record, (above, below)): (usize, (DMatrix<f64>, DMatrix<f64>))| {
                self.projected(record, &((above - below) / (2.0 * DIFFERENCE)))
            };
            derivatives.push(above?.into_iter().zip(below?).enumerate().map(of).collect());
        }
        Some(derivatives)
    }

    fn sums(&self, residuals: &[DMatrix<f64>]) -> Option<Value> {
        let mut sums = Sums::new(self.references.len());
        for (record, e) in residuals.iter().enumerate() {
            let mask =
                DMatrix::from_fn(e.nrows(), e.ncols(), |i, row| f64::from(u8::from(self.counts(record, i, row))));
            sums.add(e, &mask);
        }
        sums.value()
    }
}

impl Objective for Simulated<'_> {
    fn signals(&self) -> usize {
        self.references.len()
    }

    fn sign(&self, _unknown: usize) -> f64 {
        0.0
    }

    fn value(&self, point: &[f64], _weights: &[f64]) -> Option<Value> {
        self.sums(&self.residuals(point)?)
    }

    fn normal_equations(&self, point: &[f64], weights: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>, Value)> {
        let (residuals, derivatives) = (self.residuals(point)?, self.derivatives(point)?);
        let weighted = |one: &DMatrix<f64>, other: &DMatrix<f64>| -> f64 {
            (0..weights.len()).map(|i| one.row(i).dot(&other.row(i)) * weights[i].powi(2)).sum()
        };
        let product = |one: &[DMatrix<f64>], other: &[DMatrix<f64>]| -> f64 {
            one.iter().zip(other).map(|(one, other)| weighted(one, other)).sum()
        };
        let p = point.len();
        let information = DMatrix::from_fn(p, p, |i, j| product(&derivatives[i], &derivatives[j]));
        let gradient = DVector::from_fn(p, |i, _| product(&derivatives[i], &residuals));
        Some((information, gradient, self.sums(&residuals)?))
    }
}
