//! Results that are the same throughout a step: those parts of the state equation that follow from parameters, inputs and discrete
//! values. A step computes them once, not in every Runge-Kutta stage.

use std::rc::Rc;

use super::functions::PARAMETERS;
use super::law::{EVALUATED, Law, Places, Recorded, is_in, leaves};
use crate::fmi2::source::blocks::is_total;
use crate::fmi2::source::expression::Kind;
use crate::fmi2::source::loops::element;
use crate::fmi2::source::names::Names;
use crate::recording::{Guard, Leaf, Node, Operation, Recording, guards, needed};
use crate::system::Section;

/// Sections whose values change between steps only, or by events.
const CONSTANT: [Section; 5] =
    [Section::Parameter, Section::Prepared, Section::Input, Section::Discrete, Section::Memory];

/// A result that is the same throughout a step: a member of a struct in C.
#[derive(Debug)]
pub(super) struct Constant {
    pub node: Node,
    pub kind: Kind,
    /// The name of the member.
    pub name: String,
}

/// Operations that signals and rates have in common from which they are computed together, and the Runge-Kutta steps in a period from
/// which it takes little: four evaluations each, and one more for signals.
const WORTH_SHARING: usize = 10;
const MANY_SUBSTEPS: u32 = 10;

impl Law<'_> {
    /// True if signals are computed with the rates: by one more evaluation in a step of many. What both need is there once then.
    pub fn evaluates_with_rates(&self) -> bool {
        self.evaluates_once && self.shared >= WORTH_SHARING && self.substeps >= MANY_SUBSTEPS
    }
}

/// True if nothing reads signals before the end of a step, whose constants are known where there are states.
pub(super) fn evaluates_once(law: &Law) -> bool {
    let variables = law.variables();
    let is_signal = |leaf: Leaf| match leaf {
        Leaf::Real(place) => {
            let place = place as usize;
            is_in(&EVALUATED, |section| variables.reals(section), place) && law.constant(place).is_none()
        }
        Leaf::Integer(place) => is_in(&EVALUATED, |section| variables.integers(section), place as usize),
        _ => false,
    };
    let reads = |recording: &Recording, nodes: &[Node]| leaves(recording, nodes).into_iter().any(is_signal);
    let changes = |recording: &Recording| {
        let (reals, integers) = law.changed(recording);
        reads(recording, &reals.into_iter().chain(integers).map(|(_, node)| node).collect::<Vec<_>>())
    };
    let Recorded { indicators, event, parameters_changed, .. } = &law.recorded;
    let results: Vec<Node> = law.indicators.iter().map(|&k| indicators.results[k]).collect();
    let is_earlier = reads(indicators, &results) || changes(event) || changes(parameters_changed);
    law.every == 0 && !law.rates().is_empty() && !is_earlier
}

/// The number of operations that signals and the state equation of a law have in common.
pub(super) fn shared(law: &Law) -> usize {
    let nodes = |of: Places| of.into_iter().map(|(_, node)| node).collect::<Vec<_>>();
    let [of_rates, of_signals] = [nodes(law.rates()), [nodes(law.signals()), nodes(law.whole_signals())].concat()];
    let tape = &law.recorded.rates.tape;
    let operations = tape.operations().iter().zip(tape.needed(&of_rates)).zip(tape.needed(&of_signals));
    operations.filter(|((operation, one), other)| *one && *other && operation.operands().next().is_some()).count()
}

/// The evaluation of a law in parts: constants of a step with their recording, and those in which they are given, by number.
pub(super) fn split(law: &Law) -> (Vec<Constant>, [Recording; 3]) {
    let evaluate = &law.recorded.evaluate;
    let of_signals = || [law.signals(), law.whole_signals()].concat();
    let wanted = law.rates().into_iter().chain(law.evaluates_once.then(of_signals).into_iter().flatten());
    let wanted: Vec<Node> = wanted.map(|(_, node)| node).collect();
    let found = constants(evaluate.tape.operations(), &wanted, &|leaf| is_constant(law, leaf));
    let nodes: Vec<Node> = found.iter().map(|(node, _)| *node).collect();
    let [mut before, mut rates] = [evaluate.clone(), evaluate.clone()];
    rates.tape = rates.tape.with_given(&nodes);
    let mut names = Names::other_than(&PARAMETERS);
    let signals = law.variables().reals(Section::Signal);
    let of_signals: Vec<(Node, &String)> =
        signals.map(|place| (evaluate.reals[place], &law.real_names[place])).collect();
    let constant = |(node, guard): (Node, Rc<Guard>)| {
        let kind = kind(evaluate.tape.operation(node));
        let signal = of_signals.iter().find(|(of, _)| *of == node);
        let name = match signal {
            Some((_, name)) => names.of(name),
            None => names.numbered(if kind == Kind::Real { "a" } else { "c" }, node.index()),
        };
        Constant { node: before.tape.where_needed(node, &guard), kind, name }
    };
    let constants = found.into_iter().map(constant).collect();
    let signals = if law.evaluates_once { rates.clone() } else { evaluate.clone() };
    (constants, [before, rates, signals])
}

fn is_constant(law: &Law, leaf: Leaf) -> bool {
    let variables = law.variables();
    match leaf {
        Leaf::Real(place) => is_in(&CONSTANT, |section| variables.reals(section), place as usize),
        Leaf::Integer(place) => is_in(&CONSTANT, |section| variables.integers(section), place as usize),
        Leaf::Step => true,
        _ => false,
    }
}

/// The largest parts of wanted nodes that follow from nothing but constant leaves and whose computation is worth a member; each with the
/// condition under which it is computed.
fn constants(operations: &[Operation], wanted: &[Node], is_constant: &dyn Fn(Leaf) -> bool) -> Vec<(Node, Rc<Guard>)> {
    let needed = needed(operations, wanted);
    let all: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
    let guards = guards(operations, &needed, &all);
    let (mut moves, mut may_trap) = (vec![false; operations.len()], vec![false; operations.len()]);
    for (place, operation) in operations.iter().enumerate().filter(|(place, _)| needed[*place]) {
        moves[place] = match operation {
            Operation::Leaf(leaf) => !is_constant(*leaf),
            Operation::Opaque(..) | Operation::Carried(_) => true,
            _ => operation.operands().any(|node| moves[node.index()]),
        };
        may_trap[place] = !is_total(operation) || operation.operands().any(|node| may_trap[node.index()]);
    }
    // What isn't always needed is computed only where it can't trap, or where it is known that it is needed.
    let is_known = |guard: &Guard| guard.terms().flatten().all(|(node, _)| !moves[node.index()]);
    let is_one = |place: usize| {
        !moves[place] && (!may_trap[place] || is_known(&guards[place])) && is_worth_it(operations, place)
    };
    let mut is_left = vec![false; operations.len()];
    wanted.iter().for_each(|node| is_left[node.index()] = true);
    let mut found = Vec::new();
    for place in (0..operations.len()).rev() {
        if is_left[place] && is_one(place) {
            let guard = if may_trap[place] { Rc::clone(&guards[place]) } else { Rc::new(Guard::always()) };
            found.push((Node::at(place), guard));
        } else if is_left[place] {
            operations[place].operands().for_each(|node| is_left[node.index()] = true);
        }
    }
    found.reverse();
    found
}

/// Simple operations that are worth a member: a number is read as fast as it is computed by one.
const WORTH: usize = 2;

/// True for a number or a condition that takes more than one simple operation.
fn is_worth_it(operations: &[Operation], place: usize) -> bool {
    match &operations[place] {
        Operation::Leaf(_) | Operation::Constant(_) | Operation::Carried(_) | Operation::Iterate { .. } => false,
        // A whole number has an expression of its own.
        Operation::Select(_, yes, no) if [yes, no].into_iter().all(|&node| may_be_whole(operations, node)) => false,
        _ => cost(operations, place) >= WORTH,
    }
}

/// Simple operations that a result takes, up to [`WORTH`]; any other counts as that many.
fn cost(operations: &[Operation], place: usize) -> usize {
    let own = match &operations[place] {
        Operation::Leaf(_) | Operation::Constant(_) => return 0,
        operation if is_total(operation) => 1,
        _ => return WORTH,
    };
    operations[place].operands().fold(
        own,
        |sum, operand| {
            if sum >= WORTH { sum } else { sum + cost(operations, operand.index()) }
        },
    )
}

fn may_be_whole(operations: &[Operation], node: Node) -> bool {
    let operation = &operations[node.index()];
    match operation {
        Operation::Select(_, yes, no) => [yes, no].into_iter().all(|&node| may_be_whole(operations, node)),
        Operation::Leaf(Leaf::Integer(_) | Leaf::Crossed(_)) | Operation::Constant(_) => true,
        _ => kind(operation) == Kind::Whole,
    }
}

/// The type of what isn't a selection of whole numbers.
fn kind(operation: &Operation) -> Kind {
    match operation {
        Operation::Compare(..) | Operation::Not(_) | Operation::And(..) | Operation::Or(..) => Kind::Whole,
        _ => Kind::Real,
    }
}

/// Has constants that loops read one a lane be arrays.
pub(super) fn gather(law: &mut Law, arrays: &[Vec<usize>]) {
    let mut is_gathered = vec![false; law.constants.len()];
    for numbers in arrays {
        let kind = law.constants[numbers[0]].kind;
        let is_free = |&number: &usize| !is_gathered[number] && law.constants[number].kind == kind;
        let is_twice = numbers.iter().enumerate().any(|(k, number)| numbers[..k].contains(number));
        if is_twice || !numbers.iter().all(is_free) {
            continue;
        }
        let name = law.constants[numbers[0]].name.clone();
        for (k, &number) in numbers.iter().enumerate() {
            is_gathered[number] = true;
            law.constants[number].name = format!("{name}[{k}]");
        }
    }
}

/// The struct in C; nothing where there are no constants.
pub(super) fn declaration(constants: &[Constant]) -> String {
    if constants.is_empty() {
        return String::new();
    }
    let len = |array: &str| constants.iter().filter_map(|one| element(&one.name)).filter(|one| one.0 == array).count();
    let member = |one: &Constant| {
        let kind = if one.kind == Kind::Real { "real" } else { "bool" };
        match element(&one.name) {
            Some((array, 0)) => format!("    {kind} {array}[{}];\n", len(array)),
            Some(_) => String::new(),
            None => format!("    {kind} {};\n", one.name),
        }
    };
    let members: String = constants.iter().map(member).collect();
    format!("/* Results that are the same throughout a step. */\ntypedef struct {{\n{members}}} §_constants;\n\n")
}

#[cfg(test)]
mod tests {
    use super::constants;
    use crate::recording::{Binary, Comparison, Leaf, Node, Operation};

    /// A state and an input, then these; the constants of the last one, and whether they are always computed.
    fn found(rest: &[Operation]) -> Vec<(usize, bool)> {
        let leaves = [0, 1].map(|place| Operation::Leaf(Leaf::Real(place)));
        let operations: Vec<Operation> = leaves.iter().chain(rest).cloned().collect();
        let found = constants(&operations, &[Node::at(operations.len() - 1)], &|leaf| leaf == Leaf::Real(1));
        found.into_iter().map(|(node, guard)| (node.index(), guard.is_always())).collect()
    }

    fn binary(operation: Binary, a: usize, b: usize) -> Operation {
        Operation::Binary(operation, Node::at(a), Node::at(b))
    }

    fn select(condition: usize, yes: usize, no: usize) -> Operation {
        Operation::Select(Node::at(condition), Node::at(yes), Node::at(no))
    }

    #[test]
    fn the_largest_parts_without_states_are_constant_unless_they_are_a_few_sums() {
        // u + u, its square, the square's square, which is added to the state; then u + u once more.
        let squares = [binary(Binary::Add, 1, 1), binary(Binary::Mul, 2, 2), binary(Binary::Mul, 3, 3)];
        assert_eq!(found(&[&squares[..], &[binary(Binary::Add, 0, 4)]].concat()), [(4, true)]);
        let more = [binary(Binary::Add, 0, 4), binary(Binary::Add, 5, 2)];
        assert_eq!(found(&[&squares[..], &more].concat()), [(4, true)]);
        assert_eq!(found(&[binary(Binary::Add, 1, 1), binary(Binary::Add, 0, 2)]), []);
        assert_eq!(found(&[binary(Binary::Div, 1, 1), binary(Binary::Add, 0, 2)]), [(2, true)]);
    }

    #[test]
    fn what_may_trap_is_computed_only_where_it_is_asked_for() {
        // x < u or u < u + u ? u / (u + u) + x : u, which is added to the state.
        let of_condition = |a, b| {
            let condition = Operation::Compare(Comparison::Below, Node::at(a), Node::at(b));
            let quotient = [binary(Binary::Div, 1, 2), binary(Binary::Add, 4, 0)];
            [&[binary(Binary::Add, 1, 1), condition], &quotient[..], &[select(3, 5, 1), binary(Binary::Add, 0, 6)]]
                .concat()
        };
        assert_eq!(found(&of_condition(0, 1)), []);
        assert_eq!(found(&of_condition(1, 2)), [(3, true), (4, false)]);
    }
}
