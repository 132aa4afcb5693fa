//! Connections from outputs to inputs, by their names.

use std::collections::{HashMap, HashSet};

use super::{DraftUnit, Signal};
use crate::catalogue::Role;
use crate::model_description::UnitDefinition;
use crate::model_description::Variable;

/// Largest numbers of outputs that are offered for an input, and of inputs that are searched by units.
const MOST_OFFERED: usize = 8;
const MOST_SEARCHED: usize = 100;

/// Inputs of this package's FMUs that not every loop needs, by the system's names of them.
const UNNEEDED: [&str; 3] = ["enabled", "u_manual", "d"];
/// Name suffixes of signals that replace another: from a sensor, from an observer.
const STAND_INS: [&str; 2] = ["_measured", "_estimate"];
/// Name suffix of an actuator's command.
const COMMAND: &str = "_command";

/// Decision about an input.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// It is connected to an output; with the reason if that has another name.
    Connected { from: Signal, why: Option<String> },
    /// The user must decide: the reason, and outputs that fit.
    Open { reason: String, offered: Vec<Signal> },
    /// Most loops leave it unconnected.
    Unneeded,
}

/// The inputs of all components, and the decision about each.
#[derive(Debug)]
pub struct Wires {
    pub inputs: Vec<(Signal, Input)>,
}

impl Wires {
    /// Looks for an output for each input.
    pub fn of(units: &[DraftUnit]) -> Self {
        let search = Search::new(units);
        let inputs = signals(units, "input");
        let mut inputs: Vec<_> = inputs.into_iter().map(|input| (input, search.by_name(input))).collect();
        let used: HashSet<Signal> = connections(&inputs).map(|(from, _)| from).collect();
        let mut searched = 0;
        for (input, found) in &mut inputs {
            if let Input::Open { offered, .. } = found
                && offered.is_empty()
                && searched < MOST_SEARCHED
            {
                searched += 1;
                *offered = search.by_unit(*input, &used);
            }
        }
        Wires { inputs }
    }

    /// Decides about an input.
    pub fn set(&mut self, input: Signal, decided: Input) {
        self.inputs.iter_mut().filter(|(signal, _)| *signal == input).for_each(|(_, own)| *own = decided.clone());
    }

    /// The connections, from outputs to inputs.
    pub fn connections(&self) -> impl Iterator<Item = (Signal, Signal)> {
        connections(&self.inputs)
    }

    /// The same for components in another order, which has the former place of each.
    pub fn moved(self, order: &[usize]) -> Self {
        let mut places = vec![0; order.len()];
        order.iter().enumerate().for_each(|(place, &unit)| places[unit] = place);
        let moved = |(unit, variable): Signal| (places[unit], variable);
        let input = |(signal, input): (Signal, Input)| {
            let input = match input {
                Input::Connected { from, why } => Input::Connected { from: moved(from), why },
                Input::Open { reason, offered } => {
                    Input::Open { reason, offered: offered.into_iter().map(moved).collect() }
                }
                Input::Unneeded => Input::Unneeded,
            };
            (moved(signal), input)
        };
        let mut inputs: Vec<_> = self.inputs.into_iter().map(input).collect();
        inputs.sort_by_key(|(signal, _)| *signal);
        Wires { inputs }
    }
}

fn connections(inputs: &[(Signal, Input)]) -> impl Iterator<Item = (Signal, Signal)> {
    inputs.iter().filter_map(|(to, input)| match input {
        Input::Connected { from, .. } => Some((*from, *to)),
        _ => None,
    })
}

/// The variables of a causality that a structure can name and a connection can pass on.
fn signals(units: &[DraftUnit], causality: &str) -> Vec<Signal> {
    let mut found = Vec::new();
    for (place, unit) in units.iter().enumerate() {
        let fits = |variable: &Variable| {
            variable.causality == causality && variable.kind != "String" && !variable.name.contains(char::is_control)
        };
        let variables = unit.description.variables.iter().enumerate();
        found.extend(variables.filter(|(_, variable)| fits(variable)).map(|(variable, _)| (place, variable)));
    }
    found
}

struct Search<'a> {
    units: &'a [DraftUnit],
    outputs: Vec<Signal>,
    /// Outputs by their names, and by their keys (names without conventions).
    named: HashMap<&'a str, Vec<Signal>>,
    alike: HashMap<String, Vec<Signal>>,
    inputs: HashSet<(usize, &'a str)>,
}

impl<'a> Search<'a> {
    fn new(units: &'a [DraftUnit]) -> Self {
        let name = |(unit, variable): Signal| units[unit].description.variables[variable].name.as_str();
        let outputs = signals(units, "output");
        let (mut named, mut alike): (HashMap<_, Vec<_>>, HashMap<_, Vec<_>>) = (HashMap::new(), HashMap::new());
        let has_name = |signal: &&Signal| !is_uninformative(&units[signal.0], name(**signal));
        for &output in outputs.iter().filter(has_name) {
            named.entry(name(output)).or_default().push(output);
            alike.entry(key(name(output))).or_default().push(output);
        }
        let inputs = signals(units, "input").into_iter().map(|input| (input.0, name(input))).collect();
        Search { units, outputs, named, alike, inputs }
    }

    fn variable(&self, (unit, variable): Signal) -> &'a Variable {
        &self.units[unit].description.variables[variable]
    }

    /// Outputs of other components with a name.
    fn named(&self, name: &str, input: Signal) -> Vec<Signal> {
        let all = self.named.get(name).into_iter().flatten();
        all.copied().filter(|output| output.0 != input.0).collect()
    }

    fn by_name(&self, input: Signal) -> Input {
        let (unit, name) = (&self.units[input.0], self.variable(input).name.as_str());
        let is_own = unit.description.is_own();
        let base = name.split('[').next().unwrap_or_default();
        let equal = self.named(name, input);
        if equal.is_empty() && is_own && UNNEEDED.contains(&base) {
            return Input::Unneeded;
        }
        if is_uninformative(unit, name) {
            let reason = format!("which signal goes through this {}?", unit.model.as_deref().unwrap_or("unit"));
            return Input::Open { reason, offered: Vec::new() };
        }
        // A sensor or an observer is there to be used; a sensor doesn't measure itself.
        if unit.role() != Some(Role::Sensor) {
            let of_ends = STAND_INS.iter().map(|end| self.named(&format!("{name}{end}"), input));
            let stand_ins: Vec<Signal> = of_ends.flatten().collect();
            if !stand_ins.is_empty() {
                let replaced = (!equal.is_empty()).then(|| format!("in place of `{name}` itself"));
                return self.decided(input, &stand_ins, replaced.or(Some("by its name".to_owned())));
            }
        }
        if !equal.is_empty() {
            let acted: Vec<Signal> = equal.iter().copied().filter(|output| self.is_acted(*output)).collect();
            return match acted[..] {
                [_] if equal.len() > 1 => self.decided(input, &acted, Some("behind its actuator".to_owned())),
                _ => self.decided(input, &equal, None),
            };
        }
        if let Some(commanded) = name.strip_suffix(COMMAND) {
            let commands = self.named(commanded, input);
            if !commands.is_empty() {
                return self.decided(input, &commands, Some("by its name".to_owned()));
            }
        }
        let alike = self.alike.get(&key(name)).into_iter().flatten().copied();
        let alike: Vec<Signal> = alike.filter(|output| output.0 != input.0).collect();
        match self.decided(input, &alike, Some("the names differ only in their form".to_owned())) {
            // Without a controller the signal is all that acts.
            Input::Open { .. } if unit.role() == Some(Role::Excitation) => Input::Unneeded,
            decided => decided,
        }
    }

    /// True if an output is an actuator's response to a command.
    fn is_acted(&self, output: Signal) -> bool {
        let command = format!("{}{COMMAND}", self.variable(output).name);
        self.inputs.contains(&(output.0, command.as_str()))
    }

    fn decided(&self, input: Signal, outputs: &[Signal], why: Option<String>) -> Input {
        let open = |reason: &str| Input::Open {
            reason: reason.to_owned(),
            offered: outputs.iter().copied().take(MOST_OFFERED).collect(),
        };
        match outputs {
            [] => open("no output has this name"),
            &[from] => match misfit(self.variable(from), self.variable(input)) {
                None => Input::Connected { from, why },
                Some(misfit) => open(&format!("the output with this name {misfit}")),
            },
            _ if why.is_some() => open("several outputs are possible"),
            _ => open("several outputs have this name"),
        }
    }

    /// Outputs of an input's type and unit, unconnected ones first.
    fn by_unit(&self, input: Signal, used: &HashSet<Signal>) -> Vec<Signal> {
        let own = self.variable(input);
        let fits = |output: &&Signal| {
            let variable = self.variable(**output);
            let dimension = |variable: &Variable| variable.measure.as_ref().and_then(|unit| unit.dimension);
            let same =
                dimension(variable).is_none() || dimension(own).is_none() || dimension(variable) == dimension(own);
            // A discrete output, such as a status, is no signal for a continuous input.
            let flows = variable.variability == "continuous" || own.variability != "continuous";
            output.0 != input.0 && same && flows && misfit(variable, own).is_none()
        };
        let mut all: Vec<Signal> = self.outputs.iter().filter(fits).copied().collect();
        all.sort_by_key(|output| used.contains(output));
        all.truncate(MOST_OFFERED);
        all
    }
}

/// True if a name is one that every sensor or actuator gives its channels.
fn is_uninformative(unit: &DraftUnit, name: &str) -> bool {
    unit.hands_on() && (name.starts_with("u[") || name.starts_with("y["))
}

/// Reason why an output can't go to an input, if there is one.
pub fn misfit(output: &Variable, input: &Variable) -> Option<String> {
    let fits = match (output.kind.as_str(), input.kind.as_str()) {
        ("Real" | "Integer", "Real") | ("Integer", "Integer") | ("Boolean", "Boolean") => true,
        ("Enumeration", "Enumeration") => output.items == input.items,
        _ => false,
    };
    if !fits {
        return Some(format!("has type {}, but the input has type {}", output.kind, input.kind));
    }
    let (unit, other) = output.measure.as_deref().zip(input.measure.as_deref())?;
    let name = |unit: &UnitDefinition| unit.name.clone();
    unit.to(other)
        .is_none()
        .then(|| format!("has unit {}, but the input has unit {}, of another dimension", name(unit), name(other)))
}

/// A name without what tools write differently: case, the path before it, brackets, "in" and "out".
fn key(name: &str) -> String {
    let text = name.to_lowercase();
    let text = text.rsplit('.').next().unwrap_or_default();
    let mut text: String = text
        .chars()
        .filter_map(|c| match c {
            '[' | '(' => Some('_'),
            ']' | ')' => None,
            ',' | ' ' | '-' => Some('_'),
            other => Some(other),
        })
        .collect();
    for end in ["_in", "_out", "_input", "_output", "_state"] {
        text = text.strip_suffix(end).map_or(text.clone(), str::to_owned);
    }
    for start in ["in_", "out_", "input_", "output_"] {
        text = text.strip_prefix(start).map_or(text.clone(), str::to_owned);
    }
    for start in ["ref_", "reference_", "setpoint_"] {
        text = text.strip_prefix(start).map_or(text.clone(), |rest| format!("{rest}_reference"));
    }
    for end in ["_ref", "_setpoint", "_sp"] {
        text = text.strip_suffix(end).map_or(text.clone(), |rest| format!("{rest}_reference"));
    }
    // x_1 is x1; but x_1_12 isn't x_11_2.
    let number = text.len() - text.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let (start, number) = text.split_at(text.len() - number);
    let alone = start.trim_end_matches('_');
    let is_index = !number.is_empty() && !alone.ends_with(|c: char| c.is_ascii_digit());
    let joined = if is_index { format!("{alone}{number}") } else { text.clone() };
    if joined.is_empty() { name.to_owned() } else { joined }
}

#[cfg(test)]
mod tests {
    use super::key;

    #[test]
    fn names_that_differ_in_their_form_only_have_one_key() {
        for (one, another) in [
            ("speed", "Speed"),
            ("speed", "motor.speed"),
            ("speed_in", "speed_out"),
            ("x[1]", "x1"),
            ("x[1,2]", "x_1_2"),
            ("speed_reference", "ref_speed"),
            ("speed_ref", "speed_setpoint"),
        ] {
            assert_eq!(key(one), key(another), "{one} {another}");
        }
        for (one, another) in
            [("speed", "speed_reference"), ("x[1]", "x[11]"), ("dx", "x"), ("r[1]", "dr[1]"), ("in", "out")]
        {
            assert_ne!(key(one), key(another), "{one} {another}");
        }
    }
}
