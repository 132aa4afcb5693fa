//! The plant that a unit is begun for: a file of matrices, or an FMU that is linearised.

use std::path::Path;
use std::sync::Arc;

use adaptive_fmu::analysis::{OperatingPoint, Quantity, linearise};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::fmu::Fmu;
use adaptive_fmu::model_description::Variable;
use adaptive_fmu::system::NO_LIMIT;
use adaptive_fmu::template::{MOST, Plant, Sizes};
use serde_json::{Value, json};

use super::UnitArguments;
use crate::command::linearise::{as_json, told};
use crate::command::names::{Names, Which};

/// The sizes that were asked for where there is no plant.
pub fn sizes(arguments: &UnitArguments) -> Result<Sizes, Error> {
    let size = |option: &str, which: &Option<Which>| match which {
        None => Ok(None),
        Some(Which::Count(count)) => Ok(Some(*count)),
        Some(Which::Named(Names(names))) => {
            let allowed = format!("must be a number within 1 … {MOST}; names can be given only with --plant");
            Err(refuse(option, &names.join(","), &allowed))
        }
    };
    Ok(Sizes {
        states: size("--states", &arguments.states)?,
        inputs: size("--inputs", &arguments.inputs)?,
        outputs: size("--outputs", &arguments.outputs)?,
    })
}

/// The plant of a file, with the signals that were asked for.
pub fn find(arguments: &UnitArguments, file: &Path) -> Result<Plant, Error> {
    let is_fmu = file.extension().is_some_and(|extension| extension == "fmu");
    let states = named("--states", &arguments.states)?;
    let plant = if is_fmu {
        linearised(arguments, file, states.unwrap_or_default())?
    } else if states.is_some() || arguments.at.is_some() || arguments.step.is_some() || !arguments.set.is_empty() {
        let reason =
            "--states, --at, --step and --set are for an FMU as the plant; a file of matrices is linear already";
        return Err(Error::Description { file: file.to_owned(), reason: reason.to_owned() });
    } else {
        Plant::read(file)?
    };
    let (inputs, outputs) = (named("--inputs", &arguments.inputs)?, named("--outputs", &arguments.outputs)?);
    let wrong = |invalid: Invalid| Error::Description { file: file.to_owned(), reason: invalid.to_string() };
    plant.of_signals(inputs.as_deref(), outputs.as_deref()).map_err(wrong)
}

fn named(option: &str, which: &Option<Which>) -> Result<Option<Vec<String>>, Error> {
    match which {
        None => Ok(None),
        Some(Which::Named(Names(names))) => Ok(Some(names.clone())),
        Some(Which::Count(count)) => {
            Err(refuse(option, &count.to_string(), "must be names of the plant's signals, because --plant is given"))
        }
    }
}

fn refuse(option: &str, value: &str, allowed: &str) -> Error {
    Error::Argument(Invalid::new(option, value, allowed))
}

/// The linear plant that an FMU is like, with its inputs' limits where all have them.
fn linearised(arguments: &UnitArguments, file: &Path, states: Vec<String>) -> Result<Plant, Error> {
    let fmu = Arc::new(Fmu::open_any(file, &arguments.hosting.hosting()?)?);
    let point = OperatingPoint {
        time: arguments.at,
        steady_state: false,
        start: arguments.set.clone(),
        states,
        step: arguments.step,
    };
    let linear = linearise(&fmu, &point)?;
    remark!("{} was linearised at t = {} s, {}", linear.name, linear.time, told(linear.method));
    let mut plant = as_json(&linear);
    // An input without a limit among others that have one has one that is never reached.
    let limit = |bound: fn(&Variable) -> &Option<String>, none: f64| -> Vec<f64> {
        let of = |input: &Quantity| bound(fmu.description.variable(&input.name)?).as_ref()?.parse().ok();
        linear
            .inputs
            .iter()
            .map(|input| of(input).filter(|bound: &f64| bound.abs() < NO_LIMIT).unwrap_or(none))
            .collect()
    };
    let (min, max) = (limit(|variable| &variable.min, -NO_LIMIT), limit(|variable| &variable.max, NO_LIMIT));
    if min.iter().chain(&max).any(|limit| limit.abs() < NO_LIMIT) {
        (plant["u_min"], plant["u_max"]) = (json!(min), json!(max));
    }
    // A quantity's unit may be none.
    let units = |key: &str| -> Value {
        plant[key].as_array().map_or(Value::Null, |list| {
            list.iter().map(|signal| signal["unit"].as_str().unwrap_or("").to_owned()).collect::<Vec<_>>().into()
        })
    };
    plant["units"] = json!({ "x": units("states"), "u": units("inputs"), "y": units("outputs") });
    let wrong = |invalid: Invalid| Error::Description { file: file.to_owned(), reason: invalid.to_string() };
    Plant::parse(&plant.to_string()).map_err(wrong)
}
