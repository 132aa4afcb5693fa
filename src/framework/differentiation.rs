//! Exact derivatives of recorded equations, as operations on their own tape: in a direction, of the start in a direction, and
//! the Jacobian.

use std::collections::HashMap;
use std::ops::Range;

use crate::recording::{Given, Instructions, Leaf, Node, Operation, Recording, Registers, Tape};
use crate::system::{Section, Variables};

/// Changes of values of the block in a direction, which the leaves [`Leaf::TimeChange`] and [`Leaf::Change`] are.
#[derive(Debug)]
pub struct Directional {
    /// The operations.
    pub tape: Tape,
    /// Places of real values, and their changes: nothing where a value doesn't change, whatever the numbers are.
    pub changes: Vec<(usize, Option<Node>)>,
}

/// Derivatives of the state equation.
#[derive(Debug)]
pub struct Jacobian {
    /// The operations.
    pub tape: Tape,
    /// ∂f/∂x by its pattern, column by column.
    pub entries: Vec<Node>,
    /// ∂f/∂t, with inputs that move along [`Leaf::Slope`].
    pub by_time: Vec<Node>,
}

/// Of signals and rates, from a recording that evaluates them, by time, inputs and states.
pub fn directional(variables: &Variables, evaluate: Recording) -> Directional {
    let knowns = [Section::Input, Section::State].map(|section| variables.reals(section));
    in_direction(variables, evaluate, &[Section::Signal, Section::Derivative], |leaf| match leaf {
        Leaf::Time => Some(Leaf::TimeChange),
        Leaf::Real(place) if is_in(&knowns, place) => Some(Leaf::Change(place)),
        _ => None,
    })
}

/// Of all that follows from the start, from its recording, by inputs.
pub fn start_directional(variables: &Variables, start: Recording) -> Directional {
    let inputs = variables.reals(Section::Input);
    let sections = [Section::State, Section::Discrete, Section::Connected, Section::Signal, Section::Derivative];
    in_direction(variables, start, &sections, |leaf| match leaf {
        Leaf::Real(place) if inputs.contains(&(place as usize)) => Some(Leaf::Change(place)),
        _ => None,
    })
}

fn is_in(ranges: &[Range<usize>], place: u32) -> bool {
    ranges.iter().any(|range| range.contains(&(place as usize)))
}

fn in_direction(
    variables: &Variables,
    recording: Recording,
    sections: &[Section],
    change: impl Fn(Leaf) -> Option<Leaf>,
) -> Directional {
    let Recording { mut tape, reals, .. } = recording;
    let places: Vec<usize> = sections.iter().flat_map(|&section| variables.reals(section)).collect();
    let nodes: Vec<Node> = places.iter().map(|&place| reals[place]).collect();
    let seeds = seeds(&mut tape, &nodes, change);
    let tangents = tape.tangents(&nodes, |leaf| seeds.get(&leaf).copied());
    Directional { tape, changes: places.into_iter().zip(tangents).collect() }
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

/// Of the state equation, from a recording that evaluates it: of each state the rates of some rows.
pub fn jacobian(variables: &Variables, columns: &[Vec<u32>], evaluate: Recording) -> Jacobian {
    let Recording { mut tape, reals, .. } = evaluate;
    let (states, inputs) = (variables.reals(Section::State), variables.reals(Section::Input));
    let rates: Vec<Node> = variables.reals(Section::Derivative).map(|place| reals[place]).collect();
    let (zero, one) = (tape.number(0.0), tape.number(1.0));
    let mut entries = Vec::with_capacity(columns.iter().map(Vec::len).sum());
    for (column, rows) in columns.iter().enumerate() {
        let of_column: Vec<Node> = rows.iter().map(|&row| rates[row as usize]).collect();
        let state = Leaf::Real((states.start + column) as u32);
        let tangents = tape.tangents(&of_column, |leaf| (leaf == state).then_some(one));
        entries.extend(tangents.into_iter().map(|tangent| tangent.unwrap_or(zero)));
    }
    let slopes = seeds(&mut tape, &rates, |leaf| match leaf {
        Leaf::Real(place) if inputs.contains(&(place as usize)) => Some(Leaf::Slope(place - inputs.start as u32)),
        _ => None,
    });
    let by_time = tape.tangents(&rates, |leaf| if leaf == Leaf::Time { Some(one) } else { slopes.get(&leaf).copied() });
    let by_time = by_time.into_iter().map(|tangent| tangent.unwrap_or(zero)).collect();
    Jacobian { tape, entries, by_time }
}

impl Jacobian {
    /// All its numbers: the entries, and then the change by time.
    pub fn nodes(&self) -> impl Iterator<Item = Node> {
        self.entries.iter().chain(&self.by_time).copied()
    }

    /// How many operations it takes.
    pub fn size(&self) -> usize {
        let wanted: Vec<Node> = self.nodes().collect();
        self.tape.needed(&wanted).into_iter().filter(|needed| *needed).count()
    }
}

/// What computes the changes of a block in a direction, again and again.
#[derive(Debug)]
pub struct Direction {
    instructions: Instructions,
    /// Where the changes go that it computes.
    changing: Vec<usize>,
    /// What doesn't change.
    fixed: Vec<usize>,
}

impl Direction {
    /// As operations have it.
    pub fn of(directional: &Directional) -> Self {
        let changes = directional.changes.iter();
        let (changing, nodes): (Vec<usize>, Vec<Node>) =
            changes.clone().filter_map(|&(place, node)| Some((place, node?))).unzip();
        let fixed = changes.filter(|(_, node)| node.is_none()).map(|&(place, _)| place).collect();
        Direction { instructions: Instructions::of(&directional.tape, &nodes), changing, fixed }
    }

    /// Writes the changes of all that follows where time and values change as these changes say.
    pub fn carry_out(&self, point: &Given, of_time: f64, changes: &mut [f64], registers: &mut Registers) {
        let leaf = |leaf: Leaf| match leaf {
            Leaf::TimeChange => of_time,
            Leaf::Change(place) => changes[place as usize],
            _ => point.leaf(leaf),
        };
        let found = self.instructions.carry_out(leaf, registers);
        self.changing.iter().zip(found).for_each(|(&place, change)| changes[place] = change);
        self.fixed.iter().for_each(|&place| changes[place] = 0.0);
    }
}
