//! Runs one FMU by the crate `fmi`, a master of another author: what it sets, when it steps and what it reads are told.
//!
//! `rust-importer INTERFACE FMU START POINTS`, where INTERFACE is `co-simulation` or `model-exchange`. START has a line
//! a start value, its name and number. POINTS has a line of names (`time`, `step`, inputs) and then their numbers, a
//! line a step. It prints a line of names (outputs) and then their numbers, at the start and after each step. All are
//! separated by tabs, with every digit that a number has; truth values are 0 and 1.

mod exchange;
mod table;

use std::error::Error;

use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{CoSimulation, Common};
use fmi::fmi2::schema::Causality;

use table::{Points, Variables};

type Answer<T> = Result<T, Box<dyn Error>>;

fn main() -> Answer<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [interface, fmu, start, points] = &words[..] else {
        return Err("usage: rust-importer co-simulation|model-exchange FMU START POINTS".into());
    };
    let import: Fmi2Import = fmi::import::from_path(fmu)?;
    let start = table::start_values(&std::fs::read_to_string(start)?)?;
    let points = Points::read(&std::fs::read_to_string(points)?)?;
    match interface.as_str() {
        "co-simulation" => co_simulation(&import, &start, &points),
        "model-exchange" => exchange::run(&import, &start, &points),
        other => Err(format!("interface `{other}`: co-simulation or model-exchange is allowed").into()),
    }
}

/// All steps, in co-simulation.
fn co_simulation(import: &Fmi2Import, start: &[(String, f64)], points: &Points) -> Answer<()> {
    let mut unit = import.instantiate_cs("unit", false, false)?;
    let inputs = Variables::named(import, &points.inputs)?;
    let outputs = Variables::of(import, Causality::Output)?;
    initialise(&mut unit, import, start, points)?;
    outputs.print_names();
    outputs.print(&mut unit)?;
    for row in &points.rows {
        inputs.set(&mut unit, &row.inputs)?;
        unit.do_step(row.time, row.step, true)?;
        outputs.print(&mut unit)?;
    }
    Common::terminate(&mut unit)?;
    Ok(())
}

/// Goes through Initialization Mode, with start values set before it and the first inputs in it.
fn initialise(unit: &mut impl Common, import: &Fmi2Import, start: &[(String, f64)], points: &Points) -> Answer<()> {
    let (names, values): (Vec<String>, Vec<f64>) = start.iter().cloned().unzip();
    Variables::named(import, &names)?.set(unit, &values)?;
    unit.setup_experiment(None, points.rows[0].time, None)?;
    Common::enter_initialization_mode(unit)?;
    Variables::named(import, &points.inputs)?.set(unit, &points.rows[0].inputs)?;
    Common::exit_initialization_mode(unit)?;
    Ok(())
}
