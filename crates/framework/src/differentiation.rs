//! Exact derivatives of recorded equations, as operations on their own tape: in a direction, of the start in a direction, and
//! the Jacobian.

use std::collections::HashMap;
use std::ops::Range;

use crate::recording::{Given, Instructions, Leaf, Node, Operation, Recording, Registers, Tape};
use crate::system::{Section, Variables};

/// A Jacobian of more operations is computed direction by direction: entry by entry it would be many megabytes. Below, that pays:
/// the robot's loop with its neuro-adaptive law takes five times as long direction by direction.
pub const LARGEST: usize = 60_000;
/// The same limit for C sources, where each operation is a line.
pub const LARGEST_IN_C: usize = 6000;

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

/// The changes of signals and rates by time, inputs and states, from a recording that evaluates them.
pub fn directional(variables: &Variables, evaluate: Recording) -> Directional {
    directional_of(variables, evaluate, &[Section::Signal, Section::Derivative])
}

fn directional_of(variables: &Variables, evaluate: Recording, sections: &[Section]) -> Directional {
    let knowns = [Section::Input, Section::State].map(|section| variables.reals(section));
    in_direction(variables, evaluate, sections, |leaf| match leaf {
        Leaf::Time => Some(Leaf::TimeChange),
        Leaf::Real(place) if is_in(&knowns, place) => Some(Leaf::Change(place)),
        _ => None,
    })
}

/// The changes of all that follows from the start by inputs, from its recording.
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

/// Adjoint derivatives as operations, where seeds are the leaves [`Leaf::Change`] of signals and rates.
#[derive(Debug)]
pub struct Adjoints {
    /// The operations.
    pub tape: Tape,
    /// The result by each of the knowns.
    pub nodes: Vec<Node>,
    /// Places of inputs, of states, and of time.
    pub knowns: Vec<usize>,
}

/// The adjoint derivatives from a recording that evaluates, with the place of time; none where it has iterations that depend on
/// inputs or states.
pub fn adjoints(variables: &Variables, time: usize, evaluate: Recording) -> Option<Adjoints> {
    let Recording { mut tape, reals, .. } = evaluate;
    let places = |sections: [Section; 2]| sections.into_iter().flat_map(|section| variables.reals(section));
    let of_place = |tape: &mut Tape, place: usize| (reals[place], tape.leaf(Leaf::Change(place as u32)));
    let wanted: Vec<_> =
        places([Section::Signal, Section::Derivative]).map(|place| of_place(&mut tape, place)).collect();
    let knowns: Vec<usize> = places([Section::Input, Section::State]).chain([time]).collect();
    let leaf = |place: usize| if place == time { Leaf::Time } else { Leaf::Real(place as u32) };
    let leaves: Vec<Node> = knowns.iter().map(|&place| tape.leaf(leaf(place))).collect();
    let found = tape.adjoints(&wanted, &leaves)?;
    let zero = tape.number(0.0);
    let nodes = found.into_iter().map(|node| node.unwrap_or(zero)).collect();
    Some(Adjoints { tape, nodes, knowns })
}

/// Seeds of signals and rates times their derivatives by inputs, states and time: the transposed of [`directional`].
#[derive(Debug)]
pub struct Adjoint {
    instructions: Instructions,
    /// The inputs and states, and time, that the results are by, by their places in the block.
    knowns: Vec<usize>,
}

impl Adjoint {
    /// Builds it from a recording that evaluates, with the place of time; none if the recording has iterations that
    /// depend on inputs or states.
    pub fn of(variables: &Variables, time: usize, evaluate: Recording) -> Option<Self> {
        let Adjoints { tape, nodes, knowns } = adjoints(variables, time, evaluate)?;
        Some(Adjoint { instructions: Instructions::of(&tape, &nodes), knowns })
    }

    /// Writes the result by each known to its place, from the seeds at theirs.
    pub fn carry_out(&self, point: &Given, seeds: &[f64], registers: &mut Registers, results: &mut [f64]) {
        let leaf = |leaf: Leaf| match leaf {
            Leaf::Change(place) => seeds[place as usize],
            _ => point.leaf(leaf),
        };
        let found = self.instructions.carry_out(leaf, registers);
        self.knowns.iter().zip(found).for_each(|(&place, result)| results[place] = result);
    }
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

/// Changes of the leaves that some nodes depend on, as leaves of the tape.
fn seeds(tape: &mut Tape, nodes: &[Node], change: impl Fn(Leaf) -> Option<Leaf>) -> HashMap<Leaf, Node> {
    let needed = tape.needed(nodes);
    let leaf = |(place, operation): (usize, &Operation)| match operation {
        Operation::Leaf(leaf) if needed[place] => Some((*leaf, change(*leaf)?)),
        _ => None,
    };
    let found: Vec<(Leaf, Leaf)> = tape.operations().iter().enumerate().filter_map(leaf).collect();
    found.into_iter().map(|(leaf, change)| (leaf, tape.leaf(change))).collect()
}

/// The Jacobian of the state equation, from a recording that evaluates it, where it has an entry in these rows of each column;
/// none where it has more operations than this.
pub fn jacobian(variables: &Variables, columns: &[Vec<u32>], evaluate: Recording, largest: usize) -> Option<Jacobian> {
    let Recording { mut tape, reals, .. } = evaluate;
    // Most added operations are needed. Beyond that number, the exact excess doesn't matter.
    let most = tape.operations().len() + 2 * largest;
    let (states, inputs) = (variables.reals(Section::State), variables.reals(Section::Input));
    let rates: Vec<Node> = variables.reals(Section::Derivative).map(|place| reals[place]).collect();
    let (zero, one) = (tape.number(0.0), tape.number(1.0));
    let mut entries = Vec::with_capacity(columns.iter().map(Vec::len).sum());
    for (column, rows) in columns.iter().enumerate() {
        let of_column: Vec<Node> = rows.iter().map(|&row| rates[row as usize]).collect();
        let state = Leaf::Real((states.start + column) as u32);
        let tangents = tape.tangents(&of_column, |leaf| (leaf == state).then_some(one));
        entries.extend(tangents.into_iter().map(|tangent| tangent.unwrap_or(zero)));
        if tape.operations().len() > most {
            return None;
        }
    }
    let slopes = seeds(&mut tape, &rates, |leaf| match leaf {
        Leaf::Real(place) if inputs.contains(&(place as usize)) => Some(Leaf::Slope(place - inputs.start as u32)),
        _ => None,
    });
    let by_time = tape.tangents(&rates, |leaf| if leaf == Leaf::Time { Some(one) } else { slopes.get(&leaf).copied() });
    let by_time = by_time.into_iter().map(|tangent| tangent.unwrap_or(zero)).collect();
    let jacobian = Jacobian { tape, entries, by_time };
    (jacobian.size() <= largest).then_some(jacobian)
}

impl Jacobian {
    /// All its numbers: the entries, and then the change by time.
    pub fn nodes(&self) -> impl Iterator<Item = Node> {
        self.entries.iter().chain(&self.by_time).copied()
    }

    /// The number of operations that it takes.
    fn size(&self) -> usize {
        let wanted: Vec<Node> = self.nodes().collect();
        self.tape.needed(&wanted).into_iter().filter(|needed| *needed).count()
    }
}

/// The instructions that compute a Jacobian.
#[derive(Debug)]
pub enum Differentiator {
    /// Each entry, and the rates' changes by time behind them.
    Entries(Instructions),
    /// The rates' changes in a direction. A direction takes a group of columns of which no two have an entry in the same row.
    Directions {
        /// The change of each rate.
        rates: Instructions,
        /// The group of each column.
        group_of: Vec<usize>,
        /// The number of groups.
        groups: usize,
        /// Begin of the states and of the inputs in the block.
        first: [usize; 2],
    },
}

impl Differentiator {
    /// Those for a pattern: the rows of each column, and the columns of each group; entry by entry up to this many operations.
    pub fn of(
        variables: &Variables,
        (columns, groups): (&[Vec<u32>], &[Vec<u32>]),
        evaluate: impl Fn() -> Recording,
        largest: usize,
    ) -> Self {
        if let Some(jacobian) = jacobian(variables, columns, evaluate(), largest) {
            return Differentiator::Entries(Instructions::of(&jacobian.tape, &jacobian.nodes().collect::<Vec<Node>>()));
        }
        let Directional { mut tape, changes } = directional_of(variables, evaluate(), &[Section::Derivative]);
        let zero = tape.number(0.0);
        let nodes: Vec<Node> = changes.into_iter().map(|(_, change)| change.unwrap_or(zero)).collect();
        let mut group_of = vec![0; columns.len()];
        for (group, columns) in groups.iter().enumerate() {
            columns.iter().for_each(|&column| group_of[column as usize] = group);
        }
        let first = [Section::State, Section::Input].map(|section| variables.reals(section).start);
        Differentiator::Directions { rates: Instructions::of(&tape, &nodes), group_of, groups: groups.len(), first }
    }

    /// The number of registers that they need.
    pub fn registers(&self) -> usize {
        match self {
            Differentiator::Entries(rates) | Differentiator::Directions { rates, .. } => rates.registers(),
        }
    }

    /// Writes the entries column by column, and the rates' changes by time, where values of leaves are found by a function;
    /// inputs move along [`Leaf::Slope`].
    pub fn carry_out(
        &self,
        columns: &[Vec<u32>],
        leaf: impl Fn(Leaf) -> f64,
        registers: &mut Registers,
        (entries, by_time): (&mut [f64], &mut [f64]),
    ) {
        let (rates, group_of, groups, [first_state, first_input]) = match self {
            Differentiator::Entries(instructions) => {
                let found = instructions.carry_out(leaf, registers);
                entries.iter_mut().chain(by_time).zip(found).for_each(|(number, found)| *number = found);
                return;
            }
            Differentiator::Directions { rates, group_of, groups, first } => (rates, group_of, *groups, *first),
        };
        for group in 0..=groups {
            let is_time = group == groups;
            let change = |which: Leaf| match which {
                Leaf::TimeChange => f64::from(u8::from(is_time)),
                Leaf::Change(place) => match (place as usize).checked_sub(first_state) {
                    Some(state) if state < group_of.len() => f64::from(u8::from(group_of[state] == group)),
                    _ if is_time => leaf(Leaf::Slope(place - first_input as u32)),
                    _ => 0.0,
                },
                _ => leaf(which),
            };
            let found = rates.carry_out(change, registers);
            if is_time {
                by_time.iter_mut().zip(found).for_each(|(number, found)| *number = found);
                return;
            }
            drop(found);
            let places = columns.iter().zip(group_of).flat_map(|(rows, of)| rows.iter().map(move |&row| (row, *of)));
            for ((row, _), entry) in places.zip(&mut *entries).filter(|((_, of), _)| *of == group) {
                *entry = rates.result(row as usize, registers);
            }
        }
    }
}

/// The instructions that compute the changes of a block in a direction.
#[derive(Debug)]
pub struct Direction {
    instructions: Instructions,
    /// The places whose changes are computed.
    changing: Vec<usize>,
    /// The places that don't change.
    fixed: Vec<usize>,
}

impl Direction {
    /// Compiles the operations into instructions.
    pub fn of(directional: &Directional) -> Self {
        let changes = directional.changes.iter();
        let (changing, nodes): (Vec<usize>, Vec<Node>) =
            changes.clone().filter_map(|&(place, node)| Some((place, node?))).unzip();
        let fixed = changes.filter(|(_, node)| node.is_none()).map(|&(place, _)| place).collect();
        Direction { instructions: Instructions::of(&directional.tape, &nodes), changing, fixed }
    }

    /// Writes the changes of all dependent values to `changes`, from the changes of time and of values there.
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
