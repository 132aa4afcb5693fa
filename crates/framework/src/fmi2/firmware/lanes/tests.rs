//! Loops give what straight lines do, and compute nothing that these don't ask for.

use std::collections::HashMap;

use super::{Known, Rolled, rolled};
use crate::fmi2::firmware::functions::Written;
use crate::fmi2::source::expression::Kind;
use crate::fmi2::source::loops::Input;
use crate::recording::{Binary, Comparison, Leaf, Node, Operation};

/// The number of a leaf: an element of one array.
fn number(place: usize) -> f64 {
    [0.3, -1.7, 2.9, 0.11, 5.3, -0.77, 1.9, 0.6][place]
}

/// Operations behind eight leaves, with loops; results are elements of an array.
fn with_loops(rest: &[Operation], results: &[usize]) -> (Vec<Operation>, Rolled) {
    let leaves = (0..8).map(|place| Operation::Leaf(Leaf::Real(place)));
    let operations: Vec<Operation> = leaves.chain(rest.iter().cloned()).collect();
    let wanted: Vec<Node> = results.iter().map(|&place| Node::at(place)).collect();
    let one = |(k, &node): (usize, &Node)| {
        let to = format!("dx->y[{k}]");
        Written { to, node, kind: Kind::Real, name: None, source: "" }
    };
    let written: Vec<Written> = wanted.iter().enumerate().map(one).collect();
    let element = |operation: &Operation| match operation {
        Operation::Leaf(Leaf::Real(place)) => Some((format!("x[{place}]"), Kind::Real)),
        _ => None,
    };
    let known = Known { number: &|_| None, element: &element, is_repeated: false, least: &|_| None };
    let rolled = rolled(&operations, &wanted, &written.iter().collect::<Vec<_>>(), &known);
    (operations, rolled)
}

fn values(operations: &[Operation], carried: &[f64], loops: &crate::fmi2::source::loops::Loops) -> Vec<f64> {
    let (mut values, mut reached): (Vec<f64>, HashMap<usize, Vec<f64>>) = (Vec::new(), HashMap::new());
    for (place, operation) in operations.iter().enumerate() {
        let value = match operation {
            Operation::Leaf(Leaf::Real(leaf)) => number(*leaf as usize),
            Operation::Carried(k) => carried[*k as usize],
            Operation::Part(from, k) => reached[&from.index()][*k as usize],
            Operation::Iterate { body, captured, .. } => {
                let lanes = &loops[&place];
                let mut results = vec![0.0; body.next.len() * lanes.count];
                for lane in 0..lanes.count {
                    let mut captured = captured.iter().map(|node| values[node.index()]);
                    let mut of = |input: &Input| match input {
                        Input::Same => captured.next().unwrap(),
                        Input::Each => captured.by_ref().take(lanes.count).collect::<Vec<_>>()[lane],
                        Input::Elements((_, first, step), _) => number(first + lane * step),
                        Input::Numbers(numbers) => numbers[lane],
                    };
                    let read: Vec<f64> = lanes.inputs.iter().map(&mut of).collect();
                    let found = self::values(&body.operations, &read, loops);
                    body.next
                        .iter()
                        .enumerate()
                        .for_each(|(k, node)| results[k * lanes.count + lane] = found[node.index()]);
                }
                reached.insert(place, results);
                f64::NAN
            }
            _ => operation.value(|node| values[node.index()]).unwrap_or(f64::NAN),
        };
        values.push(value);
    }
    values
}

fn binary(operation: Binary, a: usize, b: usize) -> Operation {
    Operation::Binary(operation, Node::at(a), Node::at(b))
}

/// For three elements: (a b + c) a, with one c.
fn products() -> Vec<Operation> {
    let one = |k: usize| {
        let at = 8 + 3 * k;
        [binary(Binary::Mul, k, k + 3), binary(Binary::Add, at, 6), binary(Binary::Mul, at + 1, k)]
    };
    (0..3).flat_map(one).collect()
}

#[test]
fn what_is_computed_alike_is_one_loop_with_the_same_results() {
    let (operations, rolled) = with_loops(&products(), &[10, 13, 16]);
    let [lanes] = rolled.loops.values().collect::<Vec<_>>()[..] else { panic!("it is one loop") };
    let elements = |first| Input::Elements(("x".to_owned(), first, 1), Kind::Real);
    assert_eq!((lanes.count, &lanes.inputs[..]), (3, &[elements(0), elements(3), Input::Same][..]));
    let (before, after) = (values(&operations, &[], &rolled.loops), values(&rolled.operations, &[], &rolled.loops));
    for place in [10, 13, 16] {
        let new = rolled.moved[place].unwrap();
        assert_eq!(before[place].to_bits(), after[new.index()].to_bits());
    }
}

#[test]
fn what_follows_from_all_results_of_a_loop_is_in_a_later_one() {
    let mut rest = products();
    rest.push(binary(Binary::Add, 10, 13));
    rest.push(binary(Binary::Add, 17, 16));
    for k in 0..3 {
        let at = 19 + 3 * k;
        rest.extend([
            binary(Binary::Mul, 18, k),
            binary(Binary::Sub, at, k + 3),
            binary(Binary::Mul, at + 1, 10 + 3 * k),
        ]);
    }
    let (operations, rolled) = with_loops(&rest, &[21, 24, 27]);
    assert_eq!(rolled.loops.len(), 2);
    let (before, after) = (values(&operations, &[], &rolled.loops), values(&rolled.operations, &[], &rolled.loops));
    for place in [21, 24, 27] {
        assert_eq!(before[place].to_bits(), after[rolled.moved[place].unwrap().index()].to_bits());
    }
}

#[test]
fn a_chain_in_which_each_follows_from_the_last_is_no_loop() {
    let chain = |k: usize| binary(Binary::Mul, if k == 0 { 6 } else { 7 + k }, k % 6);
    let rest: Vec<Operation> = (0..6).map(chain).collect();
    assert!(with_loops(&rest, &[8, 9, 10, 11, 12, 13]).1.loops.is_empty());
}

#[test]
fn a_quotient_stays_where_it_is_asked_for() {
    // Where c holds, for three elements a / b + a, which the sum of all reads, too, where c holds; c doesn't depend on the element.
    let mut rest = vec![Operation::Compare(Comparison::Below, Node::at(6), Node::at(7))];
    let select = |yes: usize, no: usize| Operation::Select(Node::at(8), Node::at(yes), Node::at(no));
    for k in 0..3 {
        let at = 9 + 4 * k;
        rest.extend([
            binary(Binary::Div, k, k + 3),
            binary(Binary::Add, at, k),
            binary(Binary::Mul, at + 1, k + 3),
            select(at + 2, k),
        ]);
    }
    let (_, rolled) = with_loops(&rest, &[12, 16, 20]);
    // The quotients are in a loop that only the selections ask for, or in none.
    let is_loop = |place: usize| matches!(rolled.operations[place], Operation::Iterate { .. });
    for (place, operation) in rolled.operations.iter().enumerate() {
        let asks = operation.operands().any(|node| is_loop(node.index()));
        assert!(!asks || matches!(operation, Operation::Part(..)), "{place}");
        let reads = operation.operands().any(|node| matches!(rolled.operations[node.index()], Operation::Part(..)));
        assert!(!reads || matches!(operation, Operation::Select(..)), "{place}");
    }
    assert_eq!(rolled.loops.len(), 1);
}
