//! Start values: texts as values of variables, within the limits that an FMU names.

use super::{Instance, Value};
use crate::error::{Error, Invalid, Number};
use crate::fmi2::model_description::DESIGNED;
use crate::model_description::Variable;

/// Command that shows all variables of an FMU, for messages that list some.
pub(crate) const SHOWS_VARIABLES: &str = "`adaptive-fmu info FILE.fmu`";

/// Converts a text to a value of a variable's type.
pub(crate) fn typed(text: &str, variable: &Variable) -> Result<Value, String> {
    let word = text.trim();
    match variable.kind.as_str() {
        "Real" => {
            let number = word.parse().ok().filter(|number: &f64| number.is_finite());
            number.map(Value::Real).ok_or_else(|| "must be a finite number".to_owned())
        }
        "Integer" => word.parse().map(Value::Integer).map_err(|_| "must be a whole number".to_owned()),
        "Boolean" => match word {
            "true" | "1" => Ok(Value::Boolean(true)),
            "false" | "0" => Ok(Value::Boolean(false)),
            _ => Err("must be true or false".to_owned()),
        },
        "Enumeration" => {
            let named = variable.items.iter().find(|(name, _)| name == word).map(|(_, number)| *number);
            let numbered =
                || word.parse().ok().filter(|given| variable.items.iter().any(|(_, number)| number == given));
            named.or_else(numbered).map(Value::Integer).ok_or_else(|| {
                let items: Vec<_> = variable.items.iter().map(|(name, number)| format!("{name} ({number})")).collect();
                format!("must be one of {}", items.join(", "))
            })
        }
        _ => Ok(Value::String(text.to_owned())),
    }
}

/// The value that an FMU gives a variable.
pub(crate) fn own_start(variable: &Variable) -> Option<Value> {
    typed(variable.start.as_ref()?, variable).ok()
}

/// Checks that a start value is within the limits of its parameter.
pub(crate) fn within_limits(value: Value, variable: &Variable) -> Result<Value, String> {
    let number = match value {
        Value::Real(number) => number,
        Value::Integer(number) => f64::from(number),
        _ => return Ok(value),
    };
    let bound = |bound: &Option<String>| bound.as_ref().and_then(|text| text.trim().parse::<f64>().ok());
    let (min, max) = (bound(&variable.min), bound(&variable.max));
    let is_allowed = min.is_none_or(|min| number >= min) && max.is_none_or(|max| number <= max);
    if is_allowed || variable.causality != "parameter" {
        return Ok(value);
    }
    Err(match (min.map(Number), max.map(Number)) {
        (Some(min), Some(max)) => format!("must be within {min} … {max}"),
        (Some(min), None) => format!("must be at least {min}"),
        (_, Some(max)) => format!("must be at most {max}"),
        (None, None) => return Ok(value),
    })
}

/// Sets start values of parameters and inputs.
pub(crate) fn set_starts(instance: &Instance, values: &[(String, String)]) -> Result<(), Error> {
    for (name, value) in values {
        let variables = &instance.description().variables;
        let settable: Vec<_> =
            variables.iter().filter(|v| v.causality == "parameter" || v.causality == "input").collect();
        let variable = settable.iter().find(|variable| variable.name == *name).ok_or_else(|| {
            let known = settable.iter().map(|variable| variable.name.as_str());
            Error::unknown("parameter or input", name, known, SHOWS_VARIABLES)
        })?;
        let typed = typed(value, variable)
            .and_then(|typed| within_limits(typed, variable))
            .map_err(|reason| Error::Argument(Invalid::because(format!("--set {name}={value}: {reason}"))))?;
        instance.set_start(variable.reference, &typed)?;
    }
    Ok(())
}

/// True if a variable is fixed because the design of its FMU, which has C sources, read it at export.
pub(crate) fn is_designed(variable: &Variable) -> bool {
    variable.variability == "constant" && variable.description.ends_with(DESIGNED)
}

/// Reason why a variable keeps its start value, or has none.
pub(crate) fn why_fixed(variable: &Variable) -> String {
    if is_designed(variable) {
        return format!(
            "the FMU was designed with the value {}. `adaptive-fmu export --values FILE.ssv` designs an FMU with \
             other values, `export --ssp LOOP` and `export --run LOOP` with those of a loop",
            variable.start.as_deref().unwrap_or_default()
        );
    }
    format!("it is a {} {}", variable.variability, variable.causality)
}
