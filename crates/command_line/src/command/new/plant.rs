//! The plant that a unit is begun for: a file of matrices, or an FMU that is linearised.

use std::path::Path;
use std::sync::Arc;

use adaptive_fmu::analysis::{Linearisation, OperatingPoint, Quantity, linearise};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::fmu::Fmu;
use adaptive_fmu::model_description::Variable;
use adaptive_fmu::report::number;
use adaptive_fmu::system::NO_LIMIT;
use adaptive_fmu::template::{MOST, Plant, Sizes};
use serde_json::{Value, json};

use super::UnitArguments;
use crate::command::hosting::HostingOptions;
use crate::command::linearise::{as_json, remarks, told};
use crate::command::names::{Names, Which};
use crate::command::trim::TrimOptions;

/// The sizes that were asked for where there is no plant.
pub fn sizes(arguments: &UnitArguments) -> Result<Sizes, Error> {
    if !arguments.trim.is_empty() {
        let reason = "--free, --want and --hold are for an FMU as the plant: give it with --plant FILE.fmu";
        return Err(Error::Argument(Invalid::because(reason)));
    }
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

/// Options for a plant in a file.
#[derive(Debug, Default)]
pub struct Asked<'a> {
    /// Names of the states of an FMU that declares none.
    pub states: Option<&'a Which>,
    /// Names of inputs and of outputs: not all of them.
    pub inputs: Option<&'a Which>,
    /// See `inputs`.
    pub outputs: Option<&'a Which>,
    /// When an FMU is linearised, s.
    pub at: Option<f64>,
    /// Its communication step, s.
    pub step: Option<f64>,
    /// Its start values.
    pub set: &'a [(String, String)],
    /// Its operating point, if one is sought.
    pub trim: TrimOptions,
    /// Process in which it runs.
    pub hosting: HostingOptions,
}

impl<'a> Asked<'a> {
    /// The options of `new`.
    pub fn of(arguments: &'a UnitArguments) -> Self {
        let UnitArguments { states, inputs, outputs, at, step, set, trim, hosting, .. } = arguments;
        let (states, inputs, outputs) = (states.as_ref(), inputs.as_ref(), outputs.as_ref());
        Asked { states, inputs, outputs, at: *at, step: *step, set, trim: trim.clone(), hosting: hosting.clone() }
    }
}

/// The plant of a file, with the signals that were asked for.
pub fn find(arguments: &Asked, file: &Path) -> Result<Plant, Error> {
    let is_fmu = file.extension().is_some_and(|extension| extension == "fmu");
    let states = named("--states", arguments.states)?;
    let (inputs, outputs) = (named("--inputs", arguments.inputs)?, named("--outputs", arguments.outputs)?);
    let chosen = [inputs.as_deref(), outputs.as_deref()];
    if is_fmu {
        return linearised(arguments, file, states.unwrap_or_default(), chosen);
    }
    let has_time = arguments.at.is_some() || arguments.step.is_some();
    if states.is_some() || has_time || !arguments.set.is_empty() || !arguments.trim.is_empty() {
        let reason = "--states, --at, --step, --set, --free, --want and --hold are for an FMU as the plant; a file of \
            matrices is linear already";
        return Err(Error::Description { file: file.to_owned(), reason: reason.to_owned() });
    }
    Plant::read(file, chosen)
}

fn named(option: &str, which: Option<&Which>) -> Result<Option<Vec<String>>, Error> {
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

/// The free inputs with the values that were found.
fn inputs_there(linear: &Linearisation) -> String {
    let is_free = |name: &String| linear.trim.iter().any(|trim| trim.free.contains(name));
    let told = |input: &Quantity| {
        let unit = input.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
        format!("{} = {}{unit}", input.name, number(input.value))
    };
    let inputs: Vec<_> = linear.inputs.iter().filter(|input| is_free(&input.name)).map(told).collect();
    if inputs.is_empty() { String::new() } else { format!(" and {}", inputs.join(", ")) }
}

/// The linear plant that an FMU is like, with its inputs' limits where all have them.
fn linearised(
    arguments: &Asked,
    file: &Path,
    states: Vec<String>,
    chosen: [Option<&[String]>; 2],
) -> Result<Plant, Error> {
    let fmu = Arc::new(Fmu::open_any(file, &arguments.hosting.hosting()?)?);
    let point = OperatingPoint {
        time: arguments.at,
        start: arguments.set.to_vec(),
        states,
        step: arguments.step,
        ..OperatingPoint::default()
    };
    let linear = linearise(&fmu, &arguments.trim.apply(point))?;
    remark!(
        "{} was linearised at t = {} s{}, {}",
        linear.name,
        linear.time,
        inputs_there(&linear),
        told(linear.method)
    );
    linear.trim.iter().flat_map(remarks).for_each(|line| remark!("{line}"));
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
    Plant::parse_for(&plant.to_string(), chosen).map_err(wrong)
}
