//! The plant that a unit is begun for: a file of matrices, or an FMU that is linearised.

use std::path::Path;
use std::sync::Arc;

use adaptive_fmu::analysis::{Linearisation, OperatingPoint, Quantity, linearise};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::fmu::Fmu;
use adaptive_fmu::model_description::{ModelDescription, Variable};
use adaptive_fmu::report::number;
use adaptive_fmu::sealed;
use adaptive_fmu::system::NO_LIMIT;
use adaptive_fmu::template::{MOST, Plant, Sizes};
use serde_json::{Value, json};

use super::UnitArguments;
use crate::command::hosting::HostingOptions;
use crate::command::identify::level;
use crate::command::linearise::{as_json, method_text, remarks};
use crate::command::names::{Names, Which};
use crate::command::number::positive;
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

/// Options for the region that the records of an identified plant leave.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct RegionOptions {
    /// Factor of the region of an identified plant, for wear and other loads [default: 3]
    #[arg(long, value_parser = positive, conflicts_with = "uncertainty")]
    margin: Option<f64>,
    /// Confidence level of that region [default: that of the model]
    #[arg(long, value_parser = level, conflicts_with = "uncertainty")]
    level: Option<f64>,
}

impl RegionOptions {
    /// The option that was given, with its value, where one was.
    pub fn given(&self) -> Option<(&'static str, f64)> {
        self.margin.map(|margin| ("--margin", margin)).or(self.level.map(|level| ("--level", level)))
    }

    /// Names the file of an identified plant, and sets its region.
    fn set(&self, plant: &mut Plant, file: &Path) -> Result<(), Error> {
        let Some(records) = &mut plant.records else {
            let allowed = "needs a plant with the covariance of its numbers, as `adaptive-fmu identify` writes it";
            return match self.given() {
                Some((option, value)) => Err(refuse(option, &number(value), allowed)),
                None => Ok(()),
            };
        };
        let model = &mut records.model;
        model.file = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        model.sha256 = Some(sealed::checksum_of_file(file)?);
        (model.margin, model.level) = (self.margin.or(model.margin), self.level.or(model.level));
        Ok(())
    }
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
    /// Time at which an FMU is linearised, s.
    pub at: Option<f64>,
    /// Its communication step, s.
    pub step: Option<f64>,
    /// Its start values.
    pub set: &'a [(String, String)],
    /// Its operating point, if one is sought.
    pub trim: TrimOptions,
    /// Process in which it runs.
    pub hosting: HostingOptions,
    /// Region of an identified plant.
    pub region: RegionOptions,
}

impl<'a> Asked<'a> {
    /// The options of `new`.
    pub fn of(arguments: &'a UnitArguments) -> Self {
        let UnitArguments { states, inputs, outputs, at, step, set, trim, hosting, region, .. } = arguments;
        let (states, inputs, outputs) = (states.as_ref(), inputs.as_ref(), outputs.as_ref());
        let (trim, hosting, region) = (trim.clone(), hosting.clone(), region.clone());
        Asked { states, inputs, outputs, at: *at, step: *step, set, trim, hosting, region }
    }
}

/// The plant of a file, with the signals that were asked for.
pub fn find(arguments: &Asked, file: &Path) -> Result<Plant, Error> {
    let is_fmu = file.extension().is_some_and(|extension| extension == "fmu");
    let states = named("--states", arguments.states)?;
    let (inputs, outputs) = (named("--inputs", arguments.inputs)?, named("--outputs", arguments.outputs)?);
    let chosen = [inputs.as_deref(), outputs.as_deref()];
    if is_fmu {
        let mut plant = linearised(arguments, file, states.unwrap_or_default(), chosen)?;
        arguments.region.set(&mut plant, file)?;
        return Ok(plant);
    }
    let has_time = arguments.at.is_some() || arguments.step.is_some();
    if states.is_some() || has_time || !arguments.set.is_empty() || !arguments.trim.is_empty() {
        let reason = "--states, --at, --step, --set, --free, --want and --hold are for an FMU as the plant; a file of \
            matrices is linear already";
        return Err(Error::Description { file: file.to_owned(), reason: reason.to_owned() });
    }
    let mut plant = Plant::read(file, chosen)?;
    arguments.region.set(&mut plant, file)?;
    Ok(plant)
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
    let shown = |input: &Quantity| {
        let unit = input.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
        format!("{} = {}{unit}", input.name, number(input.value))
    };
    let inputs: Vec<_> = linear.inputs.iter().filter(|input| is_free(&input.name)).map(shown).collect();
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
    if linear.inputs.is_empty() {
        let reason =
            "has no continuous input that a controller could drive. Choose an FMU with at least one as --plant";
        return Err(Error::Archive { file: file.to_owned(), reason: reason.to_owned() });
    }
    remark!(
        "{} was linearised at t = {} s{}, {}",
        linear.name,
        linear.time,
        inputs_there(&linear),
        method_text(linear.method)
    );
    linear.trim.iter().flat_map(remarks).for_each(|line| remark!("{line}"));
    let mut plant = as_json(&linear);
    let limits = |name: &str, bound: fn(&Variable) -> &Option<String>, none: f64| -> Vec<f64> {
        let declared = |input: &Quantity| bound(fmu.description.variable(&input.name)?).as_ref()?.parse().ok();
        let of = |input| declared(input).or_else(|| own_limit(&fmu.description, arguments.set, name, &input.name));
        // An input without a limit among others that have one has one that is never reached.
        let inputs = linear.inputs.iter();
        inputs.map(|input| of(input).filter(|bound: &f64| bound.abs() < NO_LIMIT).unwrap_or(none)).collect()
    };
    let (min, max) =
        (limits("u_min", |variable| &variable.min, -NO_LIMIT), limits("u_max", |variable| &variable.max, NO_LIMIT));
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

/// The limit of an input that is a parameter, as plants of this program have it: `u_min[i]` is that of the input i, of which
/// `u_acting[i]` acts.
fn own_limit(fmu: &ModelDescription, set: &[(String, String)], limit: &str, input: &str) -> Option<f64> {
    if !fmu.is_own() {
        return None;
    }
    let place =
        fmu.variables.iter().filter(|variable| variable.causality == "input").position(|it| it.name == input)?;
    fmu.variable(&format!("u_acting[{}]", place + 1))?;
    let parameter = fmu.variable(&format!("{limit}[{}]", place + 1))?;
    let given = set.iter().rfind(|(name, _)| *name == parameter.name).map(|(_, value)| value);
    given.or(parameter.start.as_ref())?.parse().ok()
}
