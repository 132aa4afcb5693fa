//! Derivatives of a unit's equations as C functions: in a direction, of the start in a direction, and the Jacobian.

use std::collections::HashMap;

use super::Unit;
use super::equations::{Head, SIGNALS_AND_RATES, Target, function};
use super::expression::Kind;
use crate::recording::{Leaf, Method, Node, Operation, Recording, Tape};
use crate::system::Section;

/// A Jacobian of more operations is computed direction by direction.
const LARGEST: usize = 6000;

/// All of them.
pub(super) fn write(unit: &Unit) -> String {
    let variables = unit.model.variables();
    let mut evaluate = unit.record(Method::Evaluate);
    let head = Head {
        what: "Changes of signals and rates in a direction: d holds changes of inputs and states, dt is that of time.",
        declaration: "static void unit_directional(real t, real dt, const real *v, const int *n, real *d)",
    };
    let knowns = [variables.reals(Section::Input), variables.reals(Section::State)];
    let places: Vec<usize> = SIGNALS_AND_RATES.iter().flat_map(|&section| variables.reals(section)).collect();
    let mut text = directional(unit, &head, &mut evaluate, &places, |leaf| match leaf {
        Leaf::Time => Some(Leaf::TimeChange),
        Leaf::Real(place) if knowns.iter().any(|range| range.contains(&(place as usize))) => Some(Leaf::Change(place)),
        _ => None,
    });
    let mut start = unit.record(Method::Start);
    let head = Head {
        what: "Changes of all that follows from the start in a direction: d holds changes of inputs.",
        declaration: "static void unit_start_directional(real t, const real *v, const int *n, real *d)",
    };
    let sections = [Section::State, Section::Discrete, Section::Connected, Section::Signal, Section::Derivative];
    let places: Vec<usize> = sections.iter().flat_map(|&section| variables.reals(section)).collect();
    text += &directional(unit, &head, &mut start, &places, |leaf| match leaf {
        Leaf::Real(place) if knowns[0].contains(&(place as usize)) => Some(Leaf::Change(place)),
        _ => None,
    });
    text + &jacobian(unit)
}

fn directional(
    unit: &Unit,
    head: &Head,
    recording: &mut Recording,
    places: &[usize],
    change: impl Fn(Leaf) -> Option<Leaf>,
) -> String {
    let nodes: Vec<Node> = places.iter().map(|&place| recording.reals[place]).collect();
    let tape = &mut recording.tape;
    let seeds = seeds(tape, &nodes, change);
    let tangents = tape.tangents(&nodes, |leaf| seeds.get(&leaf).copied());
    let zero = tape.number(0.0);
    let targets: Vec<Target> = places
        .iter()
        .zip(tangents)
        .map(|(&place, tangent)| {
            let variable = tangent.map(|_| format!("d_{}", unit.real_name(place)));
            Target::of(format!("d[{place}] ="), tangent.unwrap_or(zero), Kind::Real, variable)
        })
        .collect();
    function(unit, head, tape, &targets, &[])
}

/// The changes of the leaves that some nodes are made of, as leaves of the tape.
fn seeds(tape: &mut Tape, nodes: &[Node], change: impl Fn(Leaf) -> Option<Leaf>) -> HashMap<Leaf, Node> {
    let needed = tape.needed(nodes);
    let leaf = |(place, operation): (usize, &Operation)| match operation {
        Operation::Leaf(leaf) if needed[place] => Some((*leaf, change(*leaf)?)),
        _ => None,
    };
    let found: Vec<(Leaf, Leaf)> = tape.operations().iter().enumerate().filter_map(leaf).collect();
    found.into_iter().map(|(leaf, change)| (leaf, tape.leaf(change))).collect()
}

const JACOBIAN: Head = Head {
    what: "The Jacobian: derivatives of the rates by the states, column by column, and by time along the inputs' slopes.",
    declaration: "static void unit_jacobian(real t, const real *v, const int *n, const real *slopes, real *jacobian, \
                  real *by_time)",
};

/// ∂f/∂x by its pattern, and ∂f/∂t with inputs that move.
fn jacobian(unit: &Unit) -> String {
    if unit.model.variables().states() == 0 {
        return String::new();
    }
    written_out(unit).unwrap_or_else(|| jacobian_by_directions(unit, &JACOBIAN))
}

/// The Jacobian of a unit with states, operation by operation, where these aren't too many.
pub(super) fn written_out(unit: &Unit) -> Option<String> {
    let variables = unit.model.variables();
    if variables.states() == 0 {
        return None;
    }
    let Recording { mut tape, reals, .. } = unit.record(Method::Evaluate);
    let (states, inputs) = (variables.reals(Section::State), variables.reals(Section::Input));
    let rates: Vec<Node> = variables.reals(Section::Derivative).map(|place| reals[place]).collect();
    let (zero, one) = (tape.number(0.0), tape.number(1.0));
    let mut targets = Vec::new();
    for (column, rows) in unit.model.sparsity().columns().iter().enumerate() {
        let of_column: Vec<Node> = rows.iter().map(|&row| rates[row as usize]).collect();
        let state = Leaf::Real((states.start + column) as u32);
        let tangents = tape.tangents(&of_column, |leaf| (leaf == state).then_some(one));
        for tangent in tangents {
            targets.push(Target::result(format!("jacobian[{}] =", targets.len()), tangent.unwrap_or(zero)));
        }
    }
    let slopes = seeds(&mut tape, &rates, |leaf| match leaf {
        Leaf::Real(place) if inputs.contains(&(place as usize)) => Some(Leaf::Slope(place - inputs.start as u32)),
        _ => None,
    });
    let by_time = tape.tangents(&rates, |leaf| if leaf == Leaf::Time { Some(one) } else { slopes.get(&leaf).copied() });
    for (state, tangent) in by_time.into_iter().enumerate() {
        targets.push(Target::result(format!("by_time[{state}] ="), tangent.unwrap_or(zero)));
    }
    let wanted: Vec<Node> = targets.iter().map(|target| target.node).collect();
    let size = tape.needed(&wanted).into_iter().filter(|needed| *needed).count();
    (size <= LARGEST).then(|| function(unit, &JACOBIAN, &tape, &targets, &[]))
}

/// The Jacobian direction by direction: several columns in each, of which no two move the same rate.
fn jacobian_by_directions(unit: &Unit, head: &Head) -> String {
    let sparsity = unit.model.sparsity();
    let mut group_of = vec![0; sparsity.columns().len()];
    for (group, columns) in sparsity.groups().iter().enumerate() {
        columns.iter().for_each(|&column| group_of[column as usize] = group);
    }
    let table = super::tables::list("int unit_group_of[UNIT_STATES]", group_of.iter().map(ToString::to_string));
    let (what, declaration, groups) = (head.what, head.declaration, sparsity.groups().len());
    let body = format!(
        "    for (int group = 0; group <= {groups}; ++group) {{
        const int of_time = group == {groups};
        real d[UNIT_REALS] = {{ R(0.0) }};
        for (int i = 0; of_time && slopes != NULL && i < UNIT_INPUTS; ++i) {{
            d[FIRST_INPUT + i] = slopes[i];
        }}
        for (int j = 0; j < UNIT_STATES; ++j) {{
            d[FIRST_STATE + j] = unit_group_of[j] == group ? R(1.0) : R(0.0);
        }}
        unit_directional(t, of_time ? R(1.0) : R(0.0), v, n, d);
        for (int j = 0; j < UNIT_STATES; ++j) {{
            for (int k = unit_columns[j]; unit_group_of[j] == group && k < unit_columns[j + 1]; ++k) {{
                jacobian[k] = d[FIRST_RATE + unit_rows[k]];
            }}
            if (of_time) {{
                by_time[j] = d[FIRST_RATE + j];
            }}
        }}
    }}
"
    );
    format!("{table}/* {what} */\n{declaration}\n{{\n{body}}}\n")
}
