//! Parameters of a loop that can be moved, with their controls and ranges.

use serde::{Serialize, Serializer};
use serde_json::Value as Json;

use crate::catalogue::Role;
use crate::fmu::Value;
use crate::library;
use crate::model::Description;
use crate::model_description::Variable;
use crate::simulation::{LoadedLoop, Place};
use crate::structure::Structure;
use crate::system::NO_LIMIT;

/// Number of sliders of a component that are shown at first.
const FIRST_OF_CONTROLLER: usize = 8;
const FIRST_OF_OTHERS: usize = 3;
/// Ratio of the ends above which a slider is logarithmic.
const DECADES: f64 = 1e3;
/// Factor between the start value and an end of the slider, for a parameter without limits.
const APART: f64 = 100.0;
/// Words of parameters that are about how equations are solved, not about the plant or controller.
const ABOUT_NUMBERS: [&str; 9] = [
    "tolerance",
    "_limit",
    "phase",
    "fixed_steps",
    "nominal",
    "tracking_time",
    "integration_method",
    "input_handling",
    "on_step_failure",
];
/// Words of parameters that users change first.
const FIRST: [&str; 7] = ["gain", "pole", "bandwidth", "rate", "frequency", "amplitude", "mass"];
/// Names of gains and of desired dynamics without these words.
const GAINS: [&str; 8] = ["A_m", "K_p", "K_i", "K_d", "omega_c", "omega_o", "k", "g"];
/// Ends of the names of limits, and of bounds.
const LIMITS: [&str; 5] = ["_min", "_max", "_bound", "_limit", "_limits"];

/// A parameter with its control.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Name in the loop, `unit.variable`.
    pub name: String,
    /// Name of the unit.
    pub unit: String,
    /// Description.
    pub description: String,
    /// Signals that an element of a matrix connects, `current ← voltage`, if they have names.
    pub acts: Option<String>,
    /// Its unit of measurement.
    pub measure: String,
    /// Its control on the page.
    #[serde(flatten)]
    pub control: Control,
    /// True if it is shown at first.
    pub first: bool,
    #[serde(skip)]
    pub(super) place: Place,
}

/// Control that moves a parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "control", rename_all = "lowercase")]
pub enum Control {
    /// A Real: a slider.
    Slider {
        /// Ends of the slider; none if the value stands for no limit.
        range: Option<(f64, f64)>,
        /// True if the slider is logarithmic.
        logarithmic: bool,
        /// True if it starts at zero.
        #[serde(skip)]
        is_zero: bool,
    },
    /// An Integer: a field with a whole number.
    Whole {
        /// Smallest and largest value that its FMU allows.
        limits: (Option<i32>, Option<i32>),
    },
    /// A Boolean: a box to tick.
    Tick,
    /// An Enumeration: one of its items.
    Choice {
        /// Their names for the page, which doesn't need their numbers.
        #[serde(serialize_with = "names")]
        items: Vec<(String, i32)>,
    },
}

impl Control {
    fn of(structure: &Structure, name: &str, variable: &Variable, start: &Value) -> Option<Self> {
        fn number<T: std::str::FromStr>(text: Option<&String>) -> Option<T> {
            text?.trim().parse().ok()
        }
        let (min, max) = (variable.min.as_ref(), variable.max.as_ref());
        Some(match (variable.kind.as_str(), start) {
            ("Real", Value::Real(start)) => {
                let tuned = structure.tuning.iter().flat_map(|tuning| &tuning.parameters);
                let tuned = tuned.into_iter().find(|parameter| parameter.name == name);
                let bounds = tuned.and_then(|parameter| parameter.low.zip(parameter.high));
                let (range, logarithmic) = range(*start, (number(min), number(max)), bounds);
                Control::Slider { range, logarithmic, is_zero: *start == 0.0 }
            }
            ("Integer", _) => Control::Whole { limits: (number(min), number(max)) },
            ("Boolean", _) => Control::Tick,
            ("Enumeration", _) => Control::Choice { items: variable.items.clone() },
            _ => return None,
        })
    }

    /// True if it may be among those that are shown at first. A slider without a range, or one that starts at zero, may
    /// not.
    fn can_matter(&self) -> bool {
        !matches!(self, Control::Slider { range: None, .. } | Control::Slider { is_zero: true, .. })
    }

    /// Converts a value from a page to this parameter's type.
    ///
    /// # Errors
    /// Values that are allowed.
    fn value(&self, given: &Json) -> Result<Value, String> {
        let whole = |number: &Json| number.as_i64().and_then(|number| i32::try_from(number).ok());
        match self {
            Control::Slider { .. } => {
                let number = given.as_f64().filter(|number| number.is_finite());
                number.map(Value::Real).ok_or_else(|| "must be a finite number".to_owned())
            }
            Control::Whole { .. } => {
                whole(given).map(Value::Integer).ok_or_else(|| "must be a whole number of 32 bits".to_owned())
            }
            Control::Tick => given.as_bool().map(Value::Boolean).ok_or_else(|| "must be true or false".to_owned()),
            Control::Choice { items } => {
                let found = given.as_str().and_then(|given| items.iter().find(|(name, _)| name == given));
                let names = || items.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
                found.map(|(_, number)| Value::Integer(*number)).ok_or_else(|| format!("must be one of {}", names()))
            }
        }
    }
}

impl Parameter {
    /// The parameters of a loop that a page can move, in the order of its components: all but Strings.
    pub fn of(structure: &Structure, loaded: &LoadedLoop) -> Vec<Self> {
        let mut parameters: Vec<Self> = loaded
            .variables()
            .filter(|(_, _, variable)| variable.causality == "parameter")
            .filter_map(|(name, place, variable)| Self::new(structure, loaded, name, place, variable))
            .collect();
        choose(structure, &mut parameters);
        // Those of a component stay together, as a page has a group for each.
        parameters.sort_by_key(|parameter| rank(parameter.own_name()));
        parameters
    }

    fn new(
        structure: &Structure,
        loaded: &LoadedLoop,
        name: String,
        place: Place,
        variable: &Variable,
    ) -> Option<Self> {
        // Parameters without a component belong to the composite only; other forms of the loop lack them.
        let unit = structure.unit_of(&name)?.name.clone();
        let control = Control::of(structure, &name, variable, &loaded.value_of(place)?)?;
        let (description, measure) = (variable.description.clone(), variable.unit.clone().unwrap_or_default());
        let acts = acts(structure, &unit, &name);
        Some(Parameter { name, unit, description, acts, measure, control, first: false, place })
    }

    /// Its name in its unit.
    fn own_name(&self) -> &str {
        &self.name[self.unit.len() + 1..]
    }

    /// A value that a page sends.
    ///
    /// # Errors
    /// A value of another type.
    pub(super) fn value(&self, given: &Json) -> Result<Value, String> {
        self.control.value(given).map_err(|reason| format!("`{}` = {given}: {reason}", self.name))
    }

    /// A value of it as a text that is read as a start value.
    pub(super) fn text(&self, value: &Value) -> String {
        let items: &[_] = if let Control::Choice { items } = &self.control { items } else { &[] };
        written(value, items).1
    }

    /// A value of it for a page.
    pub(super) fn to_json(&self, value: &Value) -> Json {
        match value {
            Value::Real(number) => (*number).into(),
            Value::Boolean(value) => (*value).into(),
            Value::Integer(number) if matches!(self.control, Control::Whole { .. }) => (*number).into(),
            other => self.text(other).into(),
        }
    }
}

/// A value for a parameter set: its type there and its text; `items` are those of its enumeration.
pub(super) fn written(value: &Value, items: &[(String, i32)]) -> (&'static str, String) {
    match value {
        Value::Real(number) => ("Real", number.to_string()),
        Value::Boolean(value) => ("Boolean", value.to_string()),
        Value::String(text) => ("String", text.clone()),
        Value::Integer(number) => match items.iter().find(|(_, item)| item == number) {
            Some((item, _)) => ("Enumeration", item.clone()),
            None => ("Integer", number.to_string()),
        },
    }
}

fn names<S: Serializer>(items: &[(String, i32)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(items.iter().map(|(name, _)| name))
}

/// The ends of a slider, and true if it is logarithmic.
fn range(start: f64, (min, max): (Option<f64>, Option<f64>), bounds: Option<(f64, f64)>) -> (Option<(f64, f64)>, bool) {
    let spans_decades = |low: f64, high: f64| low > 0.0 && high / low >= DECADES;
    if let Some((low, high)) = bounds {
        return (Some((low, high)), spans_decades(low, high));
    }
    if start.abs() >= NO_LIMIT {
        return (None, false);
    }
    let min = min.filter(|min| min.abs() < NO_LIMIT);
    let max = max.filter(|max| max.abs() < NO_LIMIT);
    if let (Some(min), Some(max)) = (min, max)
        && (min > 0.0 || start == 0.0 || max.abs().max(min.abs()) <= APART * start.abs())
    {
        return (Some((min, max)), spans_decades(min, max));
    }
    let (low, high) = match start {
        0.0 => (-1.0, 1.0),
        start if start > 0.0 => (start / APART, start * APART),
        start => (3.0 * start, -start),
    };
    let inside = |value: f64| value.max(min.unwrap_or(f64::NEG_INFINITY)).min(max.unwrap_or(f64::INFINITY));
    let (low, high) = (inside(low), inside(high));
    if low < high { (Some((low, high)), spans_decades(low, high)) } else { (None, false) }
}

/// Chooses those shown at first: the tuning parameters of the loop, and a few important ones of each component.
fn choose(structure: &Structure, parameters: &mut [Parameter]) {
    let tuned: Vec<&String> = structure.tuning.iter().flat_map(|it| &it.parameters).map(|it| &it.name).collect();
    parameters.iter_mut().for_each(|parameter| parameter.first = tuned.contains(&&parameter.name));
    for component in &structure.components {
        let most = match role(structure, &component.fmu) {
            Some(Role::Controller | Role::Observer) => FIRST_OF_CONTROLLER,
            Some(Role::Reference | Role::Excitation | Role::Sensor) => 2,
            _ => FIRST_OF_OTHERS,
        };
        let given = |name: &str| component.values.iter().any(|value| value.name == name);
        // Smaller is better; none for parameters that aren't shown at first.
        let worth = |parameter: &Parameter| {
            let (name, rank) = (parameter.own_name(), rank(parameter.own_name()));
            let is_turned = rank == Rank::Gain || given(name);
            let can_matter = parameter.control.can_matter() && !ABOUT_NUMBERS.iter().any(|word| name.contains(word));
            can_matter.then_some((rank == Rank::Limit, !is_turned))
        };
        let of_unit = (0..parameters.len()).filter(|&k| parameters[k].unit == component.name);
        let of_unit: Vec<usize> = of_unit.filter(|&k| worth(&parameters[k]).is_some()).collect();
        let (mut sliders, others): (Vec<usize>, Vec<usize>) =
            of_unit.into_iter().partition(|&k| matches!(parameters[k].control, Control::Slider { .. }));
        sliders.sort_by_key(|&k| worth(&parameters[k]));
        sliders.into_iter().take(most).chain(others).for_each(|k| parameters[k].first = true);
    }
}

/// Place of a parameter in lists: the most used come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    /// Poles, gains, and others that users change first.
    Gain,
    Other,
    Limit,
    Numbers,
}

pub(crate) fn rank(name: &str) -> Rank {
    let plain = name.split('[').next().unwrap_or(name);
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    if LIMITS.iter().any(|end| plain.ends_with(end)) {
        Rank::Limit
    } else if has(&ABOUT_NUMBERS) {
        Rank::Numbers
    } else if has(&FIRST) || GAINS.contains(&plain) {
        Rank::Gain
    } else {
        Rank::Other
    }
}

/// Signals that an element of a matrix connects, if the component's description names them.
fn acts(structure: &Structure, unit: &str, name: &str) -> Option<String> {
    let (matrix, indices) = name.strip_prefix(unit)?.strip_prefix('.')?.strip_suffix(']')?.split_once('[')?;
    let (to, from) = match matrix {
        "A" | "A_m" => ("x", "x"),
        "B" | "B_m" => ("x", "u"),
        "C" => ("y", "x"),
        "D" => ("y", "u"),
        _ => return None,
    };
    let (row, column) = indices.split_once(',')?;
    let component = structure.components.iter().find(|component| component.name == unit)?;
    let description = Description::read(&structure.description_of(&component.fmu).ok()?.text).ok()?;
    let named = |signal: &str, place: &str| {
        let place: usize = place.parse().ok()?;
        description.names.get(signal)?.each().get(place.checked_sub(1)?)?.name().map(str::to_owned)
    };
    Some(format!("{} ← {}", named(to, row)?, named(from, column)?))
}

/// Role of a component in its loop, if its kind is one of this package.
pub(super) fn role(structure: &Structure, fmu: &str) -> Option<Role> {
    let description = Description::read(&structure.description_of(fmu).ok()?.text).ok()?;
    Some(library::find(&description.model)?.role)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{Control, range};
    use crate::fmu::Value;

    #[test]
    fn a_value_must_be_of_its_parameters_type() {
        let whole = Control::Whole { limits: (Some(1), None) };
        assert_eq!(whole.value(&json!(3)), Ok(Value::Integer(3)));
        for wrong in [json!(3.5), json!("3"), json!(true), json!(3_000_000_000_i64), json!(null)] {
            assert!(whole.value(&wrong).is_err_and(|reason| reason.contains("whole number")), "{wrong}");
        }
        assert_eq!(Control::Tick.value(&json!(false)), Ok(Value::Boolean(false)));
        assert!(Control::Tick.value(&json!(0)).is_err() && Control::Tick.value(&json!("true")).is_err());
        let choice = Control::Choice { items: vec![("first".to_owned(), 1), ("second".to_owned(), 4)] };
        assert_eq!(choice.value(&json!("second")), Ok(Value::Integer(4)));
        assert_eq!(choice.value(&json!("third")), Err("must be one of first, second".to_owned()));
        assert!(choice.value(&json!(4)).is_err());
    }

    #[test]
    fn a_slider_goes_over_what_its_fmu_allows_and_over_decades_by_logarithms() {
        assert_eq!(range(0.5, (Some(0.0), Some(1.0)), None), (Some((0.0, 1.0)), false));
        assert_eq!(range(1.0, (Some(1e-3), Some(1e3)), None), (Some((1e-3, 1e3)), true));
        // The bounds of a search prevail.
        assert_eq!(range(1.0, (Some(0.0), None), Some((2.0, 3.0))), (Some((2.0, 3.0)), false));
    }

    #[test]
    fn a_slider_without_limits_lies_about_the_start_value_and_keeps_to_the_limit_that_there_is() {
        assert_eq!(range(2.0, (None, None), None), (Some((0.02, 200.0)), true));
        assert_eq!(range(2.0, (Some(1.0), None), None), (Some((1.0, 200.0)), false));
        assert_eq!(range(-2.0, (None, None), None), (Some((-6.0, 2.0)), false));
        assert_eq!(range(0.0, (Some(0.0), None), None), (Some((0.0, 1.0)), false));
    }

    #[test]
    fn a_number_that_means_no_limit_has_no_slider() {
        assert_eq!(range(-1e15, (None, None), None), (None, false));
    }
}
