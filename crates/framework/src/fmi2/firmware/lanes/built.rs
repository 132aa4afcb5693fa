//! Operations with loops, from those that were found to be alike.

use std::cell::Cell;
use std::collections::HashMap;
use std::sync::Arc;

use super::tuples::{Operand, Search};
use super::{Known, Rolled};
use crate::fmi2::source::expression::Kind;
use crate::fmi2::source::loops::{Input, Lanes, Loops, elements};
use crate::recording::{Body, Node, Operation};

/// A loop: its tuples, and which of them are results.
struct Loop {
    tuples: Vec<usize>,
    results: Vec<usize>,
    /// Its place among the new operations.
    place: Option<Node>,
}

struct Builder<'a> {
    search: &'a Search<'a>,
    known: &'a Known<'a>,
    operations: Vec<Operation>,
    moved: Vec<Option<Node>>,
    all: Vec<Loop>,
    /// The loop of each tuple.
    of: HashMap<usize, usize>,
    loops: Loops,
}

/// The operations that are wanted, with loops.
pub(super) fn built(search: &Search, wanted: &[Node], known: &Known) -> Rolled {
    let outside = search.read_outside();
    let (mut all, mut of): (Vec<Loop>, HashMap<usize, usize>) = (Vec::new(), HashMap::new());
    for number in (0..search.tuples.len()).filter(|&number| search.tuples[number].is_some()) {
        if of.contains_key(&number) {
            continue;
        }
        let mut tuples = search.with(number);
        tuples.iter().for_each(|&tuple| _ = of.insert(tuple, all.len()));
        tuples.sort_by_key(|&tuple| search.tuples[tuple].as_ref().map(|one| one.nodes[0]));
        let results = tuples.iter().copied().filter(|&tuple| outside[tuple]).collect();
        all.push(Loop { tuples, results, place: None });
    }
    let moved = vec![None; search.operations.len()];
    let mut builder = Builder { search, known, operations: Vec::new(), moved, all, of, loops: Loops::new() };
    // In their order, as far as loops allow.
    for place in (0..search.operations.len()).filter(|&place| search.needed[place]) {
        let is_inner = search.owners.get(&Node::at(place)).is_some_and(|(number, _)| !outside[*number]);
        if !is_inner {
            builder.node(Node::at(place));
        }
    }
    wanted.iter().for_each(|&node| _ = builder.node(node));
    Rolled { operations: builder.operations, moved: builder.moved, loops: builder.loops }
}

impl Builder<'_> {
    fn add(&mut self, operation: Operation) -> Node {
        self.operations.push(operation);
        Node::at(self.operations.len() - 1)
    }

    /// An operation before, among the new ones.
    fn node(&mut self, old: Node) -> Node {
        if let Some(known) = self.moved[old.index()] {
            return known;
        }
        let operation = &self.search.operations[old.index()];
        let new = match self.search.owners.get(&old) {
            Some(&(number, lane)) => {
                let of = self.of[&number];
                let from = self.whole(of);
                let result = self.all[of].results.iter().position(|&tuple| tuple == number).unwrap_or_default();
                let count = self.loops[&from.index()].count;
                self.add(Operation::Part(from, (result * count + lane) as u32))
            }
            None => {
                let operands: Vec<Node> = operation.operands().map(|operand| self.node(operand)).collect();
                self.add(in_turn(operation, &operands))
            }
        };
        self.moved[old.index()] = Some(new);
        new
    }

    /// A loop, among the new operations.
    fn whole(&mut self, number: usize) -> Node {
        if let Some(known) = self.all[number].place {
            return known;
        }
        let search = self.search;
        let (mut inputs, mut read): (Vec<Input>, Vec<&[Node]>) = (Vec::new(), Vec::new());
        let (mut captured, mut body, mut within) = (Vec::new(), Vec::new(), HashMap::new());
        let tuples = self.all[number].tuples.clone();
        let all = || tuples.iter().filter_map(|&tuple| Some((tuple, search.tuples[tuple].as_ref()?)));
        for operand in all().flat_map(|(_, tuple)| &tuple.operands) {
            if let Operand::Read(nodes) = operand
                && !read.contains(&&nodes[..])
            {
                let (input, nodes_of_it) = self.input(nodes);
                body.push(Operation::Carried(inputs.len() as u32));
                inputs.push(input);
                read.push(nodes);
                captured.extend(nodes_of_it.into_iter().map(|node| self.node(node)));
            }
        }
        for (at, tuple) in all() {
            let operands: Vec<Node> = tuple
                .operands
                .iter()
                .map(|operand| match operand {
                    Operand::Computed(other) => within[other],
                    Operand::Read(nodes) => {
                        Node::at(read.iter().position(|other| *other == &nodes[..]).unwrap_or_default())
                    }
                })
                .collect();
            within.insert(at, Node::at(body.len()));
            body.push(in_turn(&search.operations[tuple.nodes[0].index()], &operands));
        }
        let next: Vec<Node> = self.all[number].results.iter().map(|tuple| within[tuple]).collect();
        let count = all().next().map_or(0, |(_, tuple)| tuple.nodes.len());
        let body = Arc::new(Body { operations: body, goes_on: next[0], next });
        let place = self.add(Operation::Iterate { body, most: count, start: Vec::new(), captured });
        let targets = vec![None; self.all[number].results.len()];
        self.loops.insert(place.index(), Lanes { count, inputs, targets, call: None });
        self.all[number].place = Some(place);
        place
    }

    /// Input of a loop for some numbers, one a lane, and those of them that are computed before.
    fn input(&self, nodes: &[Node]) -> (Input, Vec<Node>) {
        let operations = || nodes.iter().map(|node| &self.search.operations[node.index()]);
        let numbers: Option<Vec<f64>> = operations().map(|one| (self.known.number)(one)).collect();
        if let Some(numbers) = numbers {
            return (Input::Numbers(numbers), Vec::new());
        }
        if nodes.windows(2).all(|pair| pair[0] == pair[1]) {
            return (Input::Same, vec![nodes[0]]);
        }
        let texts: Option<Vec<(String, Kind)>> = operations().map(|one| (self.known.element)(one)).collect();
        let texts = texts.unwrap_or_default();
        match elements(texts.iter().map(|one| one.0.as_str())) {
            Some(all) => (Input::Elements(all, texts[0].1), Vec::new()),
            None => (Input::Each, nodes.to_vec()),
        }
    }
}

/// An operation on other operands, in their order.
fn in_turn(operation: &Operation, operands: &[Node]) -> Operation {
    let number = Cell::new(0);
    operation.over(|_| {
        number.set(number.get() + 1);
        operands[number.get() - 1]
    })
}
