//! Maximum-likelihood parameters of an FMU from records of its outputs.

mod objective;
mod result;
mod uncertainty;

use std::sync::Arc;

use adaptive_fmu_identification::marquardt::search;

use crate::error::{Error, Invalid};
use crate::fmu::{Fmu, SHOWS_VARIABLES};
use crate::model_description::{ModelDescription, Variable};
use crate::near;
use crate::simulation::Inputs;

pub use result::{Estimated, Found};

pub use objective::{Done, Job};

use objective::Simulated;

/// Steps of the search at most.
const STEPS: usize = 40;

/// A parameter that is sought.
#[derive(Debug, Clone, PartialEq)]
pub struct Sought {
    /// Name of a parameter or a start value of the FMU.
    pub name: String,
    /// Smallest and largest value, if they are given.
    pub range: Option<[f64; 2]>,
    /// True if each record has its own value, like an initial state.
    pub is_of_record: bool,
}

/// A record of an experiment with the plant.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Its name, for messages.
    pub name: String,
    /// Inputs over time.
    pub inputs: Inputs,
    /// Measured values of each output at these times; NaN for missing ones.
    pub outputs: Vec<Vec<f64>>,
}

/// An FMU, records, and the quantities to estimate.
#[derive(Debug)]
pub struct Task<'a> {
    /// The plant.
    pub fmu: &'a Arc<Fmu>,
    /// Start values that are known.
    pub start: &'a [(String, String)],
    /// Names of the outputs that were measured.
    pub outputs: &'a [String],
    /// Parameters that are sought.
    pub sought: &'a [Sought],
    /// The records.
    pub records: &'a [Recorded],
    /// Part of each record at its end that is held out.
    pub hold_out: f64,
    /// True if sensors may have a constant error in each record.
    pub has_offsets: bool,
}

/// A quantity to estimate: a parameter, of one record or of all.
#[derive(Debug, Clone, PartialEq)]
struct Unknown {
    name: String,
    reference: u32,
    unit: String,
    record: Option<usize>,
    range: Option<[f64; 2]>,
    start: f64,
}

impl Task<'_> {
    /// Estimates the likeliest values.
    ///
    /// # Errors
    /// Names that the FMU lacks, start values outside of their ranges, or runs that fail.
    pub fn run(&self) -> Result<Found, Error> {
        let unknowns = self.unknowns()?;
        let simulated = Simulated::new(self, unknowns)?;
        let start = vec![0.0; simulated.unknowns.len()];
        // A failure at the start has its own reason.
        simulated.outputs_at(&start)?;
        let refuse = || {
            Error::Argument(Invalid::because("no parameters follow the records: give other start values, or ranges"))
        };
        let fit = search(&simulated, &start, STEPS).ok_or_else(refuse)?;
        simulated.found(&fit).ok_or_else(refuse)
    }

    /// Does a job of a search of another process.
    ///
    /// # Errors
    /// Names that the FMU lacks, start values outside of their ranges, or a job of another task.
    pub fn carry_out(&self, job: &Job) -> Result<Done, Error> {
        let simulated = Simulated::new(self, self.unknowns()?)?;
        if job.record >= self.records.len() || job.point.len() != simulated.unknowns.len() {
            return Err(Error::Argument(Invalid::because("the job belongs to other records")));
        }
        Ok(simulated.carry_out(job))
    }

    fn unknowns(&self) -> Result<Vec<Unknown>, Error> {
        let description = &self.fmu.description;
        let mut unknowns = Vec::new();
        for sought in self.sought {
            let variable = settable(description, sought)?;
            let given = self.start.iter().rev().find(|(name, _)| *name == sought.name).map(|(_, value)| value);
            let value = given.or(variable.start.as_ref()).and_then(|value| value.trim().parse().ok());
            let refuse = || Error::Argument(Invalid::new("--set", &sought.name, "must be a number"));
            let start = inside(sought, value.ok_or_else(refuse)?)?;
            let records = if sought.is_of_record { (0..self.records.len()).map(Some).collect() } else { vec![None] };
            unknowns.extend(records.into_iter().map(|record| Unknown {
                name: sought.name.clone(),
                reference: variable.reference,
                unit: variable.unit.clone().unwrap_or_default(),
                record,
                range: sought.range,
                start,
            }));
        }
        Ok(unknowns)
    }
}

/// A Real variable that can be set before a simulation.
fn settable<'a>(description: &'a ModelDescription, sought: &Sought) -> Result<&'a Variable, Error> {
    let (name, option) = (&sought.name, if sought.is_of_record { "--initial" } else { "--free" });
    let is_settable = |v: &&Variable| v.kind == "Real" && v.causality != "input" && v.start.is_some();
    let all = || description.variables.iter().filter(is_settable);
    all().find(|variable| variable.name == *name).ok_or_else(|| {
        let known: Vec<_> = all().map(|variable| variable.name.as_str()).collect();
        let allowed =
            format!("is not a Real parameter or start value; {}", near::choice(name, &known, SHOWS_VARIABLES));
        Error::Argument(Invalid::new(option, name, allowed))
    })
}

/// A start value within its range.
fn inside(sought: &Sought, start: f64) -> Result<f64, Error> {
    match sought.range {
        Some([low, high]) if !(low < start && start < high) => {
            let allowed = format!("must begin between {low} and {high}: give a start value with --set");
            Err(Error::Argument(Invalid::new(&sought.name, start, allowed)))
        }
        _ => Ok(start),
    }
}

impl Unknown {
    /// The value at a point of the search, whose start is 0.
    fn value(&self, q: f64) -> f64 {
        match self.range {
            None => self.start + self.scale() * q,
            Some([low, high]) => {
                let begun = ((self.start - low) / (high - self.start)).ln();
                low + (high - low) / (1.0 + (-(begun + q)).exp())
            }
        }
    }

    /// Its derivative there.
    fn slope(&self, q: f64) -> f64 {
        match self.range {
            None => self.scale(),
            Some([low, high]) => {
                let value = self.value(q);
                (value - low) * (high - value) / (high - low)
            }
        }
    }

    fn scale(&self) -> f64 {
        if self.start == 0.0 { 1.0 } else { self.start.abs() }
    }
}
