//! A function of its own for results that the start and an event of a law both compute, as the hand-over from a manual
//! control.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;
use std::sync::Arc;

use super::law::{Law, is_in};
use crate::fmi2::source::loops::{Call, Lanes, Loops};
use crate::recording::{Body, Guard, Leaf, Node, Operation, Recording, guards, needed};
use crate::system::Section;

/// Operations from which a function takes less memory than two times what it computes.
const WORTH: usize = 30;
/// Sections that neither a start nor an event changes.
const GIVEN: [Section; 3] = [Section::Parameter, Section::Prepared, Section::Input];

/// The function, in C.
pub(super) const NAME: &str = "§_find_common";
/// The array that it writes.
pub(super) const VALUES: &str = "values";

/// Results that two methods compute alike from parameters and inputs.
#[derive(Debug)]
pub(super) struct Common {
    /// A recording of one of the methods, with their nodes.
    pub recording: Recording,
    pub results: Vec<Node>,
    /// The operation that takes their place in both recordings.
    body: Arc<Body>,
}

impl Common {
    /// Adds the calls among some operations to their loops.
    pub fn calls(&self, operations: &[Operation], arguments: &str, loops: &mut Loops) {
        let is_call = |operation: &Operation| match operation {
            Operation::Iterate { body, .. } => Arc::ptr_eq(body, &self.body),
            _ => false,
        };
        for place in (0..operations.len()).filter(|&place| is_call(&operations[place])) {
            let call = Call { function: NAME.to_owned(), arguments: arguments.to_owned() };
            let targets = vec![None; self.results.len()];
            loops.insert(place, Lanes { count: 1, inputs: Vec::new(), targets, call: Some(call) });
        }
    }
}

/// Has the start and the event of a law share what both compute, where that is much.
pub(super) fn share(law: &mut Law) {
    if law.indicators.is_empty() {
        return;
    }
    let [start, event] = [&law.recorded.start, &law.recorded.event].map(|recording| wanted(law, recording));
    let tapes = [&law.recorded.start, &law.recorded.event].map(|recording| recording.tape.operations());
    let is_given = |leaf: Leaf| {
        let variables = law.variables();
        match leaf {
            Leaf::Real(place) => is_in(&GIVEN, |section| variables.reals(section), place as usize),
            Leaf::Integer(place) => is_in(&GIVEN, |section| variables.integers(section), place as usize),
            _ => false,
        }
    };
    let Some(found) = common(tapes, [&start, &event], &is_given) else { return };
    let places = [0, 1].map(|k| place_of_call(tapes[k], [&start, &event][k], &found[k]));
    let [Some(first), Some(second)] = places else { return };
    let recording = law.recorded.start.clone();
    let body = Arc::new(body(recording.tape.operations(), &found[0]));
    let recorded = &mut law.recorded;
    for (recording, place, results) in
        [(&mut recorded.start, first, &found[0]), (&mut recorded.event, second, &found[1])]
    {
        let call = Operation::Iterate { body: Arc::clone(&body), most: 1, start: Vec::new(), captured: Vec::new() };
        let parts = (0..).zip(results).map(|(number, &node)| (node, Operation::Part(place, number)));
        recording.tape = recording.tape.with(parts.chain([(place, call)]));
    }
    let [results, _] = found;
    law.common = Some(Common { recording, results, body });
}

fn wanted(law: &Law, recording: &Recording) -> Vec<Node> {
    let (reals, integers) = law.changed(recording);
    let written = reals.into_iter().chain(integers).map(|(_, node)| node);
    written.chain(law.refusals(recording).into_iter().map(|(condition, _)| condition)).collect()
}

/// Results that two methods have in common, as nodes of each, which all are needed under one condition in each.
fn common(tapes: [&[Operation]; 2], wanted: [&[Node]; 2], is_given: &dyn Fn(Leaf) -> bool) -> Option<[Vec<Node>; 2]> {
    let mut numbers = HashMap::new();
    let [one, other] = [0, 1].map(|k| Method::of(tapes[k], wanted[k], is_given, &mut numbers));
    let in_both: BTreeSet<usize> = one.follows.intersection(&other.follows).copied().collect();
    let ends: BTreeSet<usize> = [&one, &other].iter().flat_map(|method| method.ends(&in_both)).collect();
    let mut groups: Vec<([Rc<Guard>; 2], Vec<usize>)> = Vec::new();
    for number in ends {
        let of = [one.guard(number), other.guard(number)];
        match groups.iter_mut().find(|(guards, _)| *guards == of) {
            Some((_, group)) => group.push(number),
            None => groups.push((of, vec![number])),
        }
    }
    let found = groups.into_iter().map(|(_, group)| [&one, &other].map(|method| method.nodes(&group)));
    let size = |nodes: &[Vec<Node>; 2]| operations_of(tapes[0], &nodes[0]).len();
    found.filter(|nodes| size(nodes) >= WORTH).max_by_key(size)
}

/// Operations of a method.
struct Method<'a> {
    operations: &'a [Operation],
    /// A number for each operation, the same in all methods where the same is computed.
    numbers: Vec<usize>,
    is_needed: Vec<bool>,
    wanted: &'a [Node],
    guards: Vec<Rc<Guard>>,
    /// Numbers of those that follow from what is given.
    follows: BTreeSet<usize>,
}

impl<'a> Method<'a> {
    fn of(
        operations: &'a [Operation],
        wanted: &'a [Node],
        is_given: &dyn Fn(Leaf) -> bool,
        all: &mut HashMap<Operation, usize>,
    ) -> Self {
        let is_needed = needed(operations, wanted);
        let (mut numbers, mut follows) = (Vec::new(), Vec::new());
        for operation in operations {
            let (next, key) = (all.len(), operation.over(|node| Node::at(numbers[node.index()])));
            numbers.push(*all.entry(key).or_insert(next));
            follows.push(match operation {
                Operation::Leaf(leaf) => is_given(*leaf),
                Operation::Opaque(..) | Operation::Carried(_) | Operation::Iterate { .. } | Operation::Part(..) => {
                    false
                }
                _ => operation.operands().all(|node| follows[node.index()]),
            });
        }
        let conditions: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
        let guards = guards(operations, &is_needed, &conditions);
        let follow = (0..operations.len()).filter(|&place| is_needed[place] && follows[place]);
        let follows = follow.map(|place| numbers[place]).collect();
        Method { operations, numbers, is_needed, wanted, guards, follows }
    }

    /// Numbers among some that others or the method's results need, and that are no conditions.
    fn ends(&self, among: &BTreeSet<usize>) -> Vec<usize> {
        let is_one =
            |node: &Node| among.contains(&self.numbers[node.index()]) && is_number(&self.operations[node.index()]);
        let others = (0..self.operations.len())
            .filter(|&place| self.is_needed[place] && !among.contains(&self.numbers[place]))
            .flat_map(|place| self.operations[place].operands());
        others.chain(self.wanted.iter().copied()).filter(is_one).map(|node| self.numbers[node.index()]).collect()
    }

    fn node(&self, number: usize) -> Node {
        Node::at(self.numbers.iter().position(|&other| other == number).expect("it is computed"))
    }

    fn nodes(&self, numbers: &[usize]) -> Vec<Node> {
        numbers.iter().map(|&number| self.node(number)).collect()
    }

    fn guard(&self, number: usize) -> Rc<Guard> {
        Rc::clone(&self.guards[self.node(number).index()])
    }
}

/// True for an operation that computes a real number.
fn is_number(operation: &Operation) -> bool {
    !matches!(
        operation,
        Operation::Leaf(_)
            | Operation::Constant(_)
            | Operation::Compare(..)
            | Operation::Not(_)
            | Operation::And(..)
            | Operation::Or(..)
    )
}

/// Places of the operations that results need, but for leaves and numbers.
fn operations_of(operations: &[Operation], results: &[Node]) -> Vec<usize> {
    let is_needed = needed(operations, results);
    let is_one =
        |&place: &usize| is_needed[place] && !matches!(operations[place], Operation::Leaf(_) | Operation::Constant(_));
    (0..operations.len()).filter(is_one).collect()
}

/// Place of a call that gives the results: before all of them, that of an operation that nothing else needs.
fn place_of_call(operations: &[Operation], wanted: &[Node], results: &[Node]) -> Option<Node> {
    let first = results.iter().min()?.index();
    let mut without = operations.to_vec();
    results.iter().for_each(|node| without[node.index()] = Operation::Constant(0));
    let is_needed = needed(&without, wanted);
    let is_free = |place: &usize| *place < first && !is_needed[*place];
    operations_of(operations, results).into_iter().find(is_free).map(Node::at)
}

/// The results, from leaves.
fn body(operations: &[Operation], results: &[Node]) -> Body {
    let is_needed = needed(operations, results);
    let (mut places, mut own) = (vec![Node::at(0); operations.len()], Vec::new());
    for place in (0..operations.len()).filter(|&place| is_needed[place]) {
        let operation = operations[place].over(|node| places[node.index()]);
        places[place] = Node::at(own.len());
        own.push(operation);
    }
    let next: Vec<Node> = results.iter().map(|node| places[node.index()]).collect();
    Body { operations: own, goes_on: next[0], next }
}

#[cfg(test)]
mod tests {
    use super::{Operation, body, common, place_of_call};
    use crate::recording::{Binary, Comparison, Leaf, Node, needed};

    fn binary(operation: Binary, a: usize, b: usize) -> Operation {
        Operation::Binary(operation, Node::at(a), Node::at(b))
    }

    /// A condition and its operands, then squares of given numbers in turn, the last of which is added to a state where the condition
    /// holds; `more` other operations come first.
    fn method(more: usize, squares: usize) -> (Vec<Operation>, [Node; 1], Node) {
        let leaf = |place| Operation::Leaf(Leaf::Real(place));
        let mut operations: Vec<_> = (0..more).map(|k| Operation::Constant(k as u64)).collect();
        let (given, state) = (more, more + 1);
        operations.extend([leaf(1), leaf(0), Operation::Compare(Comparison::Below, Node::at(state), Node::at(given))]);
        for k in 0..squares {
            let last = if k == 0 { given } else { operations.len() - 1 };
            operations.push(binary(Binary::Mul, last, last));
        }
        let end = Node::at(operations.len() - 1);
        operations.push(binary(Binary::Add, state, end.index()));
        operations.push(Operation::Select(Node::at(more + 2), Node::at(end.index() + 1), Node::at(state)));
        let result = [Node::at(operations.len() - 1)];
        (operations, result, end)
    }

    #[test]
    fn what_two_methods_compute_alike_is_found_where_it_is_much() {
        let is_given = |leaf| leaf == Leaf::Real(1);
        let found = |squares: usize| {
            let [one, other] = [0, 3].map(|more| method(more, squares));
            let ends = [one.2, other.2];
            let found = common([&one.0, &other.0], [&one.1, &other.1], &is_given);
            (found, ends.map(|end| vec![end]))
        };
        let (found_all, ends) = found(40);
        assert_eq!(found_all, Some(ends));
        assert_eq!(found(3).0, None);
        let (operations, ..) = method(0, 40);
        let none = |_| false;
        assert_eq!(common([&operations, &operations], [&[Node::at(44)], &[Node::at(44)]], &none), None);
    }

    #[test]
    fn a_call_takes_the_place_of_what_nothing_else_needs() {
        let (operations, wanted, end) = method(0, 4);
        let place = place_of_call(&operations, &wanted, &[end]).unwrap();
        assert_eq!(place, Node::at(3), "the first square");
        // With another use of the first square, the second one.
        let mut more = operations.clone();
        more.push(binary(Binary::Add, 3, wanted[0].index()));
        assert_eq!(place_of_call(&more, &[Node::at(more.len() - 1)], &[end]), Some(Node::at(4)));
        let body = body(&operations, &[end]);
        assert_eq!(body.operations.len(), 5, "a leaf and four squares");
        assert!(needed(&body.operations, &body.next).iter().all(|needed| *needed));
    }
}
