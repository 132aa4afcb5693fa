//! Connections that a user names: inputs and the outputs that go to them.

use super::wiring::{Input, Wires, misfit};
use super::{DraftUnit, Signal};
use crate::error::{Error, Invalid};
use crate::near;

/// The option that names them, in messages.
const OPTION: &str = "--connect";

/// Connects inputs as given, `component.input` from `component.output`, by the names of components in the loop.
///
/// # Errors
/// Components and variables that aren't there, an input that is given twice, and types or units that don't fit.
pub fn connect(
    wires: &mut Wires,
    units: &[DraftUnit],
    names: &[String],
    given: &[(String, String)],
) -> Result<(), Error> {
    let mut connected: Vec<Signal> = Vec::new();
    for (to, from) in given {
        let (inputs, outputs) = (signals(units, names, to, "input")?, signals(units, names, from, "output")?);
        if inputs.len() != outputs.len() {
            let allowed = format!("has {} elements, `{from}` has {}", inputs.len(), outputs.len());
            return Err(Error::Argument(Invalid::new(OPTION, to, allowed)));
        }
        for (input, output) in inputs.into_iter().zip(outputs) {
            let variable = |(unit, variable): Signal| &units[unit].description.variables[variable];
            let shown = |signal: Signal| format!("{}.{}", names[signal.0], variable(signal).name);
            if connected.contains(&input) {
                let allowed = "has two sources: connect it once";
                return Err(Error::Argument(Invalid::new(OPTION, shown(input), allowed)));
            }
            if let Some(misfit) = misfit(variable(output), variable(input)) {
                let allowed = format!("can't come from {}, which {misfit}", shown(output));
                return Err(Error::Argument(Invalid::new(OPTION, shown(input), allowed)));
            }
            connected.push(input);
            wires.set(input, Input::Connected { from: output, why: Some("as given".to_owned()) });
        }
    }
    Ok(())
}

/// The signals of a name in the loop: one, or all elements of an array.
fn signals(units: &[DraftUnit], names: &[String], shown: &str, causality: &str) -> Result<Vec<Signal>, Error> {
    let Some((component, name)) = shown.split_once('.') else {
        let allowed = format!("must be COMPONENT.{}", causality.to_uppercase());
        return Err(Error::Argument(Invalid::new(OPTION, shown, allowed)));
    };
    let Some(unit) = names.iter().position(|known| known == component) else {
        return Err(Error::unknown("component", component, names, ""));
    };
    let variables = || units[unit].description.variables.iter().enumerate();
    let wanted = || variables().filter(|(_, variable)| variable.causality == causality && variable.kind != "String");
    if let Some((place, _)) = wanted().find(|(_, variable)| variable.name == name) {
        return Ok(vec![(unit, place)]);
    }
    let elements: Vec<_> = wanted()
        .filter(|(_, variable)| variable.name.strip_prefix(name).is_some_and(|rest| rest.starts_with('[')))
        .map(|(place, _)| (unit, place))
        .collect();
    if !elements.is_empty() {
        return Ok(elements);
    }
    let known: Vec<_> = wanted().map(|(_, variable)| variable.name.as_str()).collect();
    let reason = match variables().find(|(_, variable)| variable.name == name) {
        Some((_, variable)) => format!("is no {causality} of {component}; its causality is {}", variable.causality),
        None => format!("is no {causality} of {component}"),
    };
    Err(Error::Argument(Invalid::new(OPTION, shown, format!("{reason}; {}", near::choice(name, &known, "")))))
}
