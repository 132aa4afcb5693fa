//! Operations of a controller's functions: what its equations take at most, on any processor.

use std::ops::{Add, Mul};

use super::driver::Driver;
use super::equations;
use super::functions::{Structs, Written, rolled};
use super::law::Law;
use crate::fmi2::source::blocks::{Block, Blocks, ROOT, arm, placed};
use crate::recording::{Binary, Node, Operation, Recording, Unary};

/// Operations on numbers at most, whichever arms selections take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Work {
    /// Additions, subtractions, multiplications, comparisons and selections.
    pub simple: u64,
    /// Divisions and square roots.
    pub divisions: u64,
    /// Calls of functions of <math.h> in addition to roots and magnitudes.
    pub functions: u64,
}

impl Work {
    /// Upper bound of one or the other.
    fn or(self, other: Work) -> Work {
        let [simple, divisions, functions] =
            [self.simple.max(other.simple), self.divisions.max(other.divisions), self.functions.max(other.functions)];
        Work { simple, divisions, functions }
    }
}

impl Add for Work {
    type Output = Work;

    fn add(self, other: Work) -> Work {
        let [simple, divisions, functions] =
            [self.simple + other.simple, self.divisions + other.divisions, self.functions + other.functions];
        Work { simple, divisions, functions }
    }
}

impl Mul<u64> for Work {
    type Output = Work;

    fn mul(self, times: u64) -> Work {
        Work { simple: self.simple * times, divisions: self.divisions * times, functions: self.functions * times }
    }
}

/// A function of the C file, its calls in a step, and the operations of each.
#[derive(Debug)]
pub(super) struct Row {
    pub what: &'static str,
    pub calls: String,
    pub work: Work,
}

/// A row for each function that computes anything, and what a step takes at most in which nothing but its samples and the integration
/// happens: no start, no hand-over, no calibration.
pub(super) fn rows(law: &Law, structs: &Structs) -> (Vec<Row>, Work) {
    let recorded = &law.recorded;
    let of = |recording: &Recording, written: &[Written], conditions: Vec<Node>| {
        of(law, structs, recording, (written, conditions))
    };
    let changes = |recording: &Recording| {
        // A whole number is brought within its range.
        let whole = Work { simple: 3 * law.changed(recording).1.len() as u64, ..Work::default() };
        let refusals = law.refusals(recording).into_iter().map(|(condition, _)| condition).collect();
        whole + of(recording, &equations::changed(law, structs, recording), refusals)
    };
    let states = law.rates().len() as u64;
    // Four rates; the states along them four times, and their sum three times, where the last ones count once.
    let sums = Work { simple: 13 * states + 3, divisions: 1, functions: 0 };
    let rates = of(&recorded.rates, &equations::with_rates(law, structs), Vec::new());
    let integrated = if states > 0 { rates * 4 + sums } else { Work::default() };
    let substeps = u64::from(law.substeps);
    let sample = recorded.sample.as_ref().map(&changes).unwrap_or_default();
    let every = if law.every == 1 { "1".to_owned() } else { format!("1 in {} steps", law.every) };
    let signals = || of(&recorded.signals, &equations::signals(law, structs), Vec::new());
    let evaluated = if law.evaluates_with_rates() { rates } else { signals() };
    // Each input is compared once, each state and output twice, with a magnitude; limits of an output take four comparisons; a
    // step is divided by its substeps.
    let (inputs, outputs) = (structs.inputs.reals().count() as u64, structs.outputs.reals().count() as u64);
    let compared = Work { simple: inputs + 2 * states + 6 * outputs, divisions: u64::from(states > 0), functions: 0 };
    let completed = changes(&recorded.completed) + changes(&recorded.check) + compared;
    let indicators = law.indicators.iter().map(|&k| recorded.indicators.results[k]).collect();
    let sides = of(&recorded.indicators, &[], indicators);
    let constants = of(&recorded.constants, &equations::of_step(law), Vec::new());
    let [side_calls, evaluations] = Driver::of(law, structs).calls(law);
    let of_each = [
        ("what the steps below don't change", "1, and after an event".to_owned(), constants, 1),
        ("a Runge-Kutta step", substeps.to_string(), integrated, substeps),
        ("a sample", every, sample, 1),
        ("outputs", evaluations.to_string(), evaluated, evaluations),
        ("flags and checks", "1".to_owned(), completed, 1),
        ("sides of indicators", side_calls.to_string(), sides, side_calls),
        ("an event, as a hand-over", "at most 8".to_owned(), changes(&recorded.event), 0),
        ("a change of parameters", "after a calibration".to_owned(), changes(&recorded.parameters_changed), 0),
        ("the start", "in the first step".to_owned(), changes(&recorded.start), 0),
    ];
    let whole = of_each.iter().fold(Work::default(), |sum, (.., work, times)| sum + *work * *times);
    let rows = of_each.into_iter().map(|(what, calls, work, _)| Row { what, calls, work });
    (rows.filter(|row| row.work != Work::default()).collect(), whole)
}

/// Operations that values and conditions need at most, whichever arms selections take.
fn of(law: &Law, structs: &Structs, recording: &Recording, (written, conditions): (&[Written], Vec<Node>)) -> Work {
    let wanted: Vec<Node> = written.iter().map(|one| one.node).chain(conditions).collect();
    let rolled = rolled(law, structs, "", recording, (&wanted, &written.iter().collect::<Vec<_>>()));
    of_nodes(&rolled.operations, wanted.iter().filter_map(|node| rolled.moved[node.index()]))
}

fn of_nodes(operations: &[Operation], nodes: impl Iterator<Item = Node>) -> Work {
    let placed = placed(operations, &nodes.map(|node| (node, None)).collect::<Vec<_>>());
    within(&placed.operations, &placed.blocks, ROOT)
}

fn within(operations: &[Operation], blocks: &Blocks, block: Block) -> Work {
    let of_place = |place: usize| match operations[place] {
        Operation::Select(..) if blocks.decided(place).is_some() => Work::default(),
        Operation::Select(..) if blocks.has_arms(place) => {
            let [taken, other] = [true, false].map(|holds| within(operations, blocks, arm(place, holds)));
            Work { simple: 1, ..Work::default() } + taken.or(other)
        }
        ref operation => of_operation(operation),
    };
    blocks.places(block).into_iter().fold(Work::default(), |sum, place| sum + of_place(place))
}

fn of_operation(operation: &Operation) -> Work {
    let simple = |simple| Work { simple, ..Work::default() };
    match operation {
        Operation::Constant(_) | Operation::Leaf(_) | Operation::Part(..) | Operation::Carried(_) => Work::default(),
        Operation::Unary(Unary::Neg | Unary::Abs, _) => simple(1),
        Operation::Unary(Unary::Signum, _) => simple(2),
        Operation::Unary(Unary::Wrap, _) => Work { functions: 1, ..simple(5) },
        Operation::Unary(Unary::Sqrt | Unary::Recip, _) | Operation::Binary(Binary::Div, ..) => {
            Work { divisions: 1, ..Work::default() }
        }
        Operation::Unary(..) | Operation::Binary(Binary::Pow, ..) | Operation::Powf(..) | Operation::Opaque(..) => {
            Work { functions: 1, ..Work::default() }
        }
        // By squares and products.
        Operation::Powi(_, exponent) => Work {
            divisions: u64::from(*exponent < 0),
            ..simple(2 * u64::from(32 - exponent.unsigned_abs().leading_zeros()))
        },
        Operation::Binary(..)
        | Operation::Compare(..)
        | Operation::Not(_)
        | Operation::And(..)
        | Operation::Or(..)
        | Operation::Select(..) => simple(1),
        // A loop over lanes. Each is counted and compared, and reads its inputs and writes its results in memory.
        Operation::Iterate { body, most, start, .. } if start.is_empty() => {
            let inputs = body.operations.iter().filter(|one| matches!(one, Operation::Carried(_))).count();
            let of_loop = simple((2 + inputs + body.next.len()) as u64);
            (of_nodes(&body.operations, body.next.iter().copied()) + of_loop) * *most as u64
        }
        Operation::Iterate { body, most, .. } => {
            body.operations.iter().fold(Work::default(), |sum, one| sum + of_operation(one)) * *most as u64
        }
    }
}
