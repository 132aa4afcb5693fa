//! Source of each input of a part.

use std::collections::{HashMap, HashSet};

use crate::error::Invalid;
use crate::near;
use crate::system::variable::{Causality, Data, Element, Naming, Section, Variable, Variables};
use crate::system::{Base, Declaration};

/// A connected input, and where its value comes from.
#[derive(Debug, Clone)]
pub(super) struct Link {
    /// Section and place of the source.
    pub from: (Section, usize),
    /// Place of the input among the connected values.
    pub to: usize,
    /// Both names, for messages.
    pub names: String,
}

/// Finds both ends of every connection.
pub(super) fn resolve(connections: &[(String, String)], variables: &Variables) -> Result<Vec<Link>, Invalid> {
    let elements = variables.visible().map(|element| (element.name(), element));
    let elements: HashMap<String, Element> = elements.collect();
    let mut invalid = Invalid::none();
    let mut links: Vec<Link> = Vec::new();
    for (from, to) in connections {
        match resolve_one(from, to, &elements, &links) {
            Ok(link) => links.push(link),
            Err(reason) => invalid.and(reason),
        }
    }
    invalid.into_result()?;
    Ok(links)
}

fn resolve_one(from: &str, to: &str, elements: &HashMap<String, Element>, links: &[Link]) -> Result<Link, Invalid> {
    let names = format!("{from} -> {to}");
    let refuse = |reason: String| Err(Invalid::because(format!("connection {names}: {reason}")));
    let unknown = |name: &str| {
        let mut known: Vec<_> = elements.keys().collect();
        known.sort_unstable();
        let meant = near::question(name, &known).map_or(String::new(), |question| format!("; {question}"));
        format!("there is no `{name}`{meant}")
    };
    let Some(source) = elements.get(from) else { return refuse(unknown(from)) };
    let Some(target) = elements.get(to) else { return refuse(unknown(to)) };
    if source.variable.causality != Causality::Output || !source.variable.is_real() {
        return refuse(format!("`{from}` is not a real output"));
    }
    if target.variable.section != Section::Connected {
        return refuse(format!("`{to}` is not a real input"));
    }
    let target_place = target.place();
    if let Some(other) = links.iter().find(|link| link.to == target_place) {
        return refuse(format!("`{to}` is connected already, by {}", other.names));
    }
    // A number without a unit fits any unit: general controllers don't know the plant's units. Values are passed on
    // unchanged, so units that would need a conversion don't fit either.
    let base = |element: &Element| Base::of(element.unit()).filter(|base| !base.is_number());
    if let (Some(given), Some(taken)) = (base(source), base(target))
        && given != taken
    {
        return refuse(format!("units don't fit, {} against {}", source.unit(), target.unit()));
    }
    Ok(Link { from: (source.variable.section, source.place()), to: target_place, names })
}

impl Variables {
    /// True for a part of a loop that isn't known here: it has inputs, and no feedback between parts of its own.
    pub(crate) fn is_open(&self) -> bool {
        !self.has_feedback && !self.reals(Section::Input).is_empty()
    }
}

/// True if the outputs of a part lead back to its inputs.
pub(super) fn has_feedback(connections: &[(String, String)]) -> bool {
    let part = |name: &str| name.split('.').next().map(String::from);
    let mut links: Vec<_> = connections.iter().map(|(from, to)| (part(from), part(to))).collect();
    // A part that nothing leads to is in no loop. Without it, others may be such parts.
    let mut before = usize::MAX;
    while links.len() < before {
        before = links.len();
        let reached: HashSet<_> = links.iter().map(|(_, to)| to.clone()).collect();
        links.retain(|(from, _)| reached.contains(from));
    }
    !links.is_empty()
}

/// Makes inputs that nothing is connected to inputs of the composite, and links them to their part's.
pub(super) fn open_inputs(links: &[Link], d: &mut Declaration) -> Vec<Link> {
    let is_open = |place: usize| links.iter().all(|link| link.to != place);
    let mut opened = Vec::new();
    for index in 0..d.variables.list.len() {
        let variable = d.variables.list[index].clone();
        let shown = variable.section == Section::Connected && variable.causality == Causality::Local;
        let open = (0..variable.len()).filter(|k| is_open(variable.start + k)).count();
        if !shown || open == 0 {
            continue;
        }
        d.variables.list[index].causality = Causality::Hidden;
        d.variables.list[index].name = format!("#{}", variable.name);
        d.variables.list[index].given = Vec::new();
        // A vector that is connected in part only falls apart into its elements.
        let whole = open == variable.len();
        let pieces =
            if whole { vec![variable.clone()] } else { (0..variable.len()).map(|k| single(&variable, k)).collect() };
        for piece in pieces {
            if is_open(piece.start) {
                opened.extend(open_input(piece, d));
            } else {
                d.variables.list.push(piece);
            }
        }
    }
    opened
}

/// Adds an input of the composite for a part's, and links the two.
fn open_input(part: Variable, d: &mut Declaration) -> Vec<Link> {
    let size = &mut d.variables.real_sizes[Section::Input as usize];
    let start = std::mem::replace(size, *size + part.len());
    let link = |k| Link { from: (Section::Input, start + k), to: part.start + k, names: part.name.clone() };
    let links = (0..part.len()).map(link).collect();
    d.variables.list.push(Variable { section: Section::Input, start, causality: Causality::Input, ..part });
    links
}

/// One element as a variable of its own.
fn single(variable: &Variable, offset: usize) -> Variable {
    let element = variable.element(offset);
    let mut single = variable.clone();
    (single.name, single.start) = (element.name(), element.place());
    single.description = vec![element.description().into_owned()];
    single.shown.no_limit = false;
    (single.naming, single.given) = (Naming::Scalar, Vec::new());
    if let Data::Real { start, unit, nominal, .. } = &mut single.data {
        *start = vec![element.start()];
        *unit = vec![element.unit()];
        *nominal = vec![element.nominal()];
    }
    single
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_has_feedback_and_a_chain_has_none() {
        let connected = |pairs: &[(&str, &str)]| {
            has_feedback(&pairs.iter().map(|&(from, to)| (from.into(), to.into())).collect::<Vec<_>>())
        };
        assert!(connected(&[("r.y", "law.r"), ("law.u[1]", "plant.u"), ("plant.x[1]", "law.x[1]")]));
        assert!(connected(&[("plant.y", "sensor.y"), ("law.u", "law.before")]), "a part may lead to itself");
        assert!(!connected(&[("motor.u", "plant.u"), ("plant.x", "sensor.x"), ("motor.u", "sensor.u")]));
        assert!(!connected(&[]));
    }
}
