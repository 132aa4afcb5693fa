//! The number of Runge-Kutta steps that a law needs in a period, on a target that takes a fixed number of them.

use std::sync::Arc;

use crate::error::{Error, Invalid};
use crate::fmu::{Fmu, Ready, Value};
use crate::integrator::IntegrationMethod;
use crate::simulation::{LoadedLoop, Place};
use crate::structure::{Component, Settings, Structure};
use crate::system::Choice;

/// With twice as many steps outputs may differ by so much, in parts of the largest of each.
const APART: f64 = 1e-3;
/// The most steps that are tried.
const MOST: u32 = 4096;
/// Periods in which they are.
const PERIODS: f64 = 2000.0;

/// The fewest steps of 1, 2, 4 … with which a component of a loop gives what it gives with twice as many, to 1e-3 of its largest
/// output, in the first 2,000 periods (s) of its loop. 1 of a component without states.
///
/// # Errors
/// When the loop can't be run, or 4096 steps aren't enough.
pub fn substeps(structure: &Structure, component: &Component, period: f64, units: &Ready) -> Result<u32, Error> {
    let fmu = |unit: &Component| -> Result<Arc<Fmu>, Error> { units.fmu(&structure.description_of(&unit.fmu)?) };
    let loaded = LoadedLoop::of(structure, fmu)?;
    let place = |name: &str| loaded.variable(&format!("{}.{name}", component.name)).map(|(place, _)| place);
    let Some((method, steps)) = place("integration_method").zip(place("fixed_steps")) else { return Ok(1) };
    let prefix = format!("{}.", component.name);
    let is_output = |(name, _, variable): &(String, Place, &crate::model_description::Variable)| {
        name.starts_with(&prefix)
            && variable.causality == "output"
            && variable.kind == "Real"
            && variable.variability == "continuous"
    };
    let outputs: Vec<String> = loaded.variables().filter(is_output).map(|(name, ..)| name).collect();
    let stop_time = structure.stop_time.min(PERIODS * period);
    let settings = Settings { start_time: 0.0, stop_time, step: period, order: structure.order };
    let fixed = IntegrationMethod::ITEMS.iter().position(|(item, ..)| *item == IntegrationMethod::Fixed);
    let fixed = Value::Integer(fixed.map_or(0, |place| place as i32 + 1));
    let run = |count: u32| -> Result<Vec<Vec<f64>>, Error> {
        let start = [(method, fixed.clone()), (steps, Value::Integer(count as i32))];
        let closed = loaded.instantiate_with(&start)?;
        let places: Vec<usize> =
            outputs.iter().filter_map(|name| closed.names().iter().position(|known| known == name)).collect();
        let mut rows = Vec::new();
        closed.watch(settings, &[], |_, row| {
            rows.push(places.iter().map(|&place| row[place]).collect::<Vec<f64>>());
            true
        })?;
        Ok(rows)
    };
    let (mut count, mut coarse) = (1, run(1));
    while count <= MOST {
        let fine = run(2 * count);
        // With too few steps a law may leave any range.
        if let (Ok(coarse), Ok(fine)) = (&coarse, &fine)
            && are_same(coarse, fine)
        {
            return Ok(count);
        }
        (count, coarse) = (2 * count, fine);
    }
    coarse?;
    let reason = format!(
        "its outputs still change with {MOST} Runge-Kutta steps in {period} s. Give a shorter --period, or --substeps N"
    );
    Err(Error::Argument(Invalid::because(format!("{}: {reason}", component.fmu))))
}

/// True if all outputs are nearly the same.
fn are_same(coarse: &[Vec<f64>], fine: &[Vec<f64>]) -> bool {
    let outputs = fine.first().map_or(0, Vec::len);
    (0..outputs).all(|k| {
        let largest = fine.iter().map(|row| row[k].abs()).fold(0.0, f64::max);
        coarse.iter().zip(fine).all(|(one, other)| (one[k] - other[k]).abs() <= APART * largest)
    })
}
