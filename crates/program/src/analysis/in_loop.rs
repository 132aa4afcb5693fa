//! A controller in its loop, as a target runs it: the Runge-Kutta steps that it needs in a period, and its inputs.

use std::sync::Arc;

use crate::error::{Error, Invalid};
use crate::fmi2::firmware::Signals;
use crate::fmu::{Fmu, Ready, Value};
use crate::integrator::IntegrationMethod;
use crate::model_description::{Affine, ModelDescription};
use crate::simulation::{LoadedLoop, Place};
use crate::structure::{Component, Settings, Structure};
use crate::system::Choice;

/// Largest change of outputs when the number of steps doubles, in parts of the largest value of each.
const APART: f64 = 1e-3;
/// The most steps that are tried.
const MOST: u32 = 4096;
/// Periods in which they are.
const PERIODS: f64 = 2000.0;

/// A controller in its loop: the Runge-Kutta steps that it needs in a period, and its input signals there.
#[derive(Debug)]
pub struct InLoop {
    /// Runge-Kutta steps; 1 of a controller that integrates nothing.
    pub substeps: u32,
    /// True if it integrates anything.
    pub integrates: bool,
    /// The signals of its connected inputs, a value a period.
    pub signals: Signals,
}

/// The time between calls of a controller on a target, s: its sample time or, without one, the step of its default
/// experiment.
pub fn period(unit: &ModelDescription, step: f64) -> f64 {
    let sample_time = || unit.variable("sample_time")?.start.as_ref()?.parse().ok();
    sample_time().filter(|time: &f64| *time > 0.0).unwrap_or(step)
}

/// Analyses a component of a loop with `steps` Runge-Kutta steps in a period (s). Without `steps`, it takes the fewest
/// of 1, 2, 4 … whose outputs agree with those of twice as many, to 1e-3 of the largest output, in the first 2,000
/// periods.
///
/// # Errors
/// When the loop can't be run, or 4096 steps aren't enough.
pub fn in_loop(
    structure: &Structure,
    component: &Component,
    (period, asked): (f64, Option<u32>),
    units: &Ready,
) -> Result<InLoop, Error> {
    let runs = Runs::of(structure, component, period, units)?;
    let sources = runs.loaded.sources(&component.name);
    let names: Vec<String> = sources.iter().map(|(_, signal, _)| signal.clone()).collect();
    let (substeps, rows) = match (asked, &runs.method) {
        (None, Some(_)) => runs.fewest(&names)?,
        // Up to the failure, if it fails with these steps.
        (asked, _) => (asked.unwrap_or(1), runs.rows(asked.unwrap_or(1), &names).0),
    };
    // The values at the end of a step, which a controller reads that is stepped last.
    let column =
        |k: usize, on_the_way: Affine| rows.iter().skip(1).map(|row| on_the_way.of(row[k])).collect::<Vec<f64>>();
    let columns = sources.into_iter().enumerate().map(|(k, (input, _, on_the_way))| (input, column(k, on_the_way)));
    let is_known = |column: &[f64]| !column.is_empty() && column.iter().all(|value| value.is_finite());
    let signals = columns.filter(|(_, column)| is_known(column)).collect();
    Ok(InLoop { substeps, integrates: runs.method.is_some(), signals })
}

/// Runs of a loop with a component that takes fixed steps.
struct Runs {
    loaded: LoadedLoop,
    settings: Settings,
    /// The component's variables that choose method and number of steps; none if it integrates nothing.
    method: Option<[Place; 2]>,
    outputs: Vec<String>,
    fmu: String,
}

impl Runs {
    fn of(structure: &Structure, component: &Component, period: f64, units: &Ready) -> Result<Self, Error> {
        let fmu = |unit: &Component| -> Result<Arc<Fmu>, Error> { units.fmu(&structure.description_of(&unit.fmu)?) };
        let loaded = LoadedLoop::of(structure, fmu)?;
        let place = |name: &str| loaded.variable(&format!("{}.{name}", component.name)).map(|(place, _)| place);
        let method = place("integration_method").zip(place("fixed_steps")).map(|(method, steps)| [method, steps]);
        let prefix = format!("{}.", component.name);
        let is_output = |(name, _, variable): &(String, Place, &crate::model_description::Variable)| {
            name.starts_with(&prefix)
                && variable.causality == "output"
                && variable.kind == "Real"
                && variable.variability == "continuous"
        };
        let outputs = loaded.variables().filter(is_output).map(|(name, ..)| name).collect();
        let settings = Settings { start_time: 0.0, stop_time: structure.stop_time, step: period };
        Ok(Runs { loaded, settings, method, outputs, fmu: component.fmu.clone() })
    }

    /// Signals at each point of a run in the first periods, which end if the run fails. Signals that the loop lacks are
    /// NaN.
    fn rows(&self, count: u32, signals: &[String]) -> (Vec<Vec<f64>>, Result<(), Error>) {
        let fixed = IntegrationMethod::ITEMS.iter().position(|(item, ..)| *item == IntegrationMethod::Fixed);
        let values = [fixed.map_or(0, |place| place as i32 + 1), count as i32].map(Value::Integer);
        let start: Vec<_> = self.method.into_iter().flatten().zip(values).collect();
        let mut rows = Vec::new();
        let mut run = || {
            let closed = self.loaded.instantiate_with(&start)?;
            let places: Vec<Option<usize>> =
                signals.iter().map(|name| closed.names().iter().position(|known| known == name)).collect();
            let settings =
                Settings { stop_time: self.settings.stop_time.min(PERIODS * self.settings.step), ..self.settings };
            closed.watch(settings, &[], |_, row| {
                rows.push(places.iter().map(|place| place.map_or(f64::NAN, |place| row[place])).collect::<Vec<f64>>());
                true
            })
        };
        let ended = run();
        (rows, ended)
    }

    /// The fewest Runge-Kutta steps, and further signals with them.
    fn fewest(&self, further: &[String]) -> Result<(u32, Vec<Vec<f64>>), Error> {
        let (outputs, names) = (self.outputs.len(), [&self.outputs, further].concat());
        let run = |count: u32| {
            let (rows, ended) = self.rows(count, &names);
            ended.map(|()| rows)
        };
        let (mut count, mut coarse) = (1, run(1));
        while count <= MOST {
            let fine = run(2 * count);
            // With too few steps a controller may leave any range.
            if let (Ok(coarse), Ok(fine)) = (&coarse, &fine)
                && are_same(coarse, fine, outputs)
            {
                return Ok((count, coarse.iter().map(|row| row[outputs..].to_vec()).collect()));
            }
            (count, coarse) = (2 * count, fine);
        }
        coarse?;
        let (fmu, period) = (&self.fmu, self.settings.step);
        let reason = format!(
            "its outputs still change with {MOST} Runge-Kutta steps in {period} s. Give a shorter --period, or --substeps N"
        );
        Err(Error::Argument(Invalid::because(format!("{fmu}: {reason}"))))
    }
}

/// True if the outputs, which come first in a row, are nearly the same.
fn are_same(coarse: &[Vec<f64>], fine: &[Vec<f64>], outputs: usize) -> bool {
    (0..outputs).all(|k| {
        let largest = fine.iter().map(|row| row[k].abs()).fold(0.0, f64::max);
        coarse.iter().zip(fine).all(|(one, other)| (one[k] - other[k]).abs() <= APART * largest)
    })
}
