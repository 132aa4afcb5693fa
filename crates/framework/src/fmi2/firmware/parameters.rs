//! Start values of a controller, the time between its calls, and the parameters that stay variables.

use super::Options;
use crate::error::{Invalid, Number};
use crate::model::{Block, Model};
use crate::recording::{Leaf, Method, Node, Recording};
use crate::structure::Place;
use crate::system::{MessageLog, SamplingClock, Section, Variability, Variable};

/// The parameter by which a law is sampled.
const SAMPLE_TIME: &str = "sample_time";

/// The values that a law begins with, designed and prepared, and the time from call to call.
pub(super) fn prepared(model: &Model, options: &Options) -> Result<(Block, f64), Invalid> {
    let variables = model.variables();
    let mut block = model.start().clone();
    let sample_time = variables.find(SAMPLE_TIME).filter(|of| of.variable.section == Section::Parameter);
    let sample_time = sample_time.map(|of| variables.index(of));
    let asked = sample_time.map(|place| block.reals[place]).filter(|time| *time > 0.0);
    let period = options.period.or(asked).unwrap_or(model.description().experiment.step);
    if let (Some(place), None) = (sample_time, asked) {
        block.reals[place] = period;
    }
    model.prepare(&mut block, &mut MessageLog::new())?;
    Ok((block, period))
}

/// The number of calls from sample to sample.
pub(super) fn calls_from_sample_to_sample(
    model: &Model,
    start: &Block,
    clock: &SamplingClock<usize>,
    period: f64,
) -> Result<u32, Invalid> {
    let mut block = start.clone();
    if let Some(place) = model.variables().stepped() {
        block.integers[place] = 1;
    }
    model.equations().initialise(0.0, &mut block.point(model, &mut MessageLog::new()));
    let sample_time = block.reals[clock.period];
    if sample_time <= 0.0 {
        return Ok(0);
    }
    let calls = (sample_time / period).round();
    if calls < 1.0 || calls > f64::from(u16::MAX) || (calls * period - sample_time).abs() > 1e-9 * sample_time {
        let allowed = format!("must be its sample time, {} s, or that divided by a whole number", Number(sample_time));
        return Err(Invalid::new("period", Number(period), allowed));
    }
    Ok(calls as u32)
}

/// Flags of the parameters that stay variables, with what follows from them: reals and integers.
pub(super) fn calibrated(model: &Model, options: &Options) -> Result<(Vec<bool>, Vec<bool>), Invalid> {
    let variables = model.variables();
    let designed = model.designed();
    let is_free = |v: &Variable| {
        v.section == Section::Parameter
            && v.variability == Variability::Tunable
            && !variables.is_control(v)
            && !v.elements().any(|element| designed.contains(&Place::of(variables, element)))
    };
    let free: Vec<&Variable> = variables.iter().filter(|v| is_free(v)).collect();
    let mut reals = vec![false; model.start().reals.len()];
    let mut integers = vec![false; model.start().integers.len()];
    if let Some(unknown) = options.calibrate.iter().flatten().find(|name| !free.iter().any(|v| v.name == **name)) {
        let names: Vec<&str> = free.iter().map(|v| v.name.as_str()).collect();
        let allowed = format!("must be a parameter that can change at run time: {}", names.join(", "));
        return Err(Invalid::new("calibrate", format!("`{unknown}`"), allowed));
    }
    let is_asked = |v: &Variable| options.calibrate.as_ref().is_none_or(|names| names.contains(&v.name));
    for element in free.into_iter().filter(|v| is_asked(v)).flat_map(Variable::elements) {
        let places = if element.variable.is_real() { &mut reals } else { &mut integers };
        places[variables.index(element)] = true;
    }
    let relate = Recording::of(model.system(), Method::Relate, &variables.layout());
    let is_variable = |leaf: Leaf| match leaf {
        Leaf::Real(place) => reals[place as usize],
        Leaf::Integer(place) => integers[place as usize],
        _ => false,
    };
    let follows = |node: Node| !relate.tape.dependence(&[node], is_variable)[0].is_empty();
    let following: Vec<usize> = variables.reals(Section::Prepared).filter(|&k| follows(relate.reals[k])).collect();
    following.into_iter().for_each(|place| reals[place] = true);
    Ok((reals, integers))
}
