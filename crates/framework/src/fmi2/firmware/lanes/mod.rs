//! Loops in straight lines: what is computed alike for some elements of a variable, as for the axes of a vehicle, is written once, in a
//! loop over them. All operations are those of the recording, on the same numbers.
//!
//! It begins with elements of one array that are computed by the same operation, and with terms of a sum. As long as all their operands
//! are, they belong to the loop, too. Others are read by it, in arrays. What follows from all elements of one loop is in a later one.

mod built;
mod tuples;

use std::rc::Rc;

use super::functions::Written;
use crate::fmi2::source::loops::{Loops, element};
use crate::recording::{Binary, Node, Operation, followed};
use tuples::{Search, shape};

/// Operations with loops, which are iterations without a state; where the operations before are now; and what the loops read.
pub(super) struct Rolled {
    pub operations: Vec<Operation>,
    pub moved: Vec<Option<Node>>,
    pub loops: Loops,
}

/// What is known of leaves and constants.
pub(super) struct Known<'a> {
    /// The number that an operation is.
    pub number: &'a dyn Fn(&Operation) -> Option<f64>,
    /// The element of an array in C that a leaf is.
    pub element: &'a dyn Fn(&Operation) -> Option<String>,
}

/// The fewest lanes of a loop.
const FEWEST: usize = 2;

/// Operations with loops where it is worth it.
pub(super) fn rolled(operations: &[Operation], wanted: &[Node], written: &[&Written], known: &Known) -> Rolled {
    let all: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
    let operations = followed(operations, &all);
    let mut search = Search::of(&operations, wanted);
    for nodes in arrays(&operations, written).into_iter().chain(search.chains()) {
        search.begin(&nodes);
    }
    search.settle(known);
    built::built(&search, wanted, known)
}

/// Elements of arrays, one behind the other, that are computed alike.
fn arrays(operations: &[Operation], written: &[&Written]) -> Vec<Vec<Node>> {
    let mut all: Vec<Vec<Node>> = Vec::new();
    let mut last: Option<(&str, usize, u64)> = None;
    for one in written {
        let Some((array, number)) = element(&one.to) else {
            last = None;
            continue;
        };
        let alike = shape(operations, one.node);
        if last.is_some_and(|(before, k, other)| before == array && k + 1 == number && other == alike) {
            all.last_mut().expect("one is there").push(one.node);
        } else {
            all.push(vec![one.node]);
        }
        last = Some((array, number, alike));
    }
    all.retain(|nodes| nodes.len() >= FEWEST);
    all
}

impl Search<'_> {
    /// Terms of sums and of conditions that are computed alike, as they follow each other.
    fn chains(&self) -> Vec<Vec<Node>> {
        let mut is_inner = vec![false; self.operations.len()];
        let mut all = Vec::new();
        for place in (0..self.operations.len()).rev() {
            if is_inner[place] || !self.needed[place] {
                continue;
            }
            let mut terms = Vec::new();
            let mut at = Node::at(place);
            while let Some((before, term)) = self.link(at, Node::at(place)) {
                is_inner[at.index()] = true;
                terms.push(term);
                at = before;
            }
            terms.push(at);
            terms.reverse();
            let alike = terms.chunk_by(|a, b| shape(self.operations, *a) == shape(self.operations, *b));
            all.extend(alike.filter(|nodes| nodes.len() >= FEWEST).map(<[Node]>::to_vec));
        }
        all
    }

    /// What comes before the last term of a sum or a condition, and that term, where it is one as that at the end of its chain.
    fn link(&self, at: Node, end: Node) -> Option<(Node, Node)> {
        match (&self.operations[at.index()], &self.operations[end.index()]) {
            (Operation::Binary(Binary::Add, a, b), Operation::Binary(Binary::Add, ..))
            | (Operation::And(a, b), Operation::And(..))
            | (Operation::Or(a, b), Operation::Or(..)) => Some((*a, *b)),
            _ => None,
        }
    }

    /// Looks for what some nodes have in common: those that are selections by one condition, for each of its arms.
    fn begin(&mut self, nodes: &[Node]) {
        let conditions: Vec<(Node, Node, Node)> = nodes
            .iter()
            .filter_map(|node| match self.operations[node.index()] {
                Operation::Select(condition, yes, no) => Some((condition, yes, no)),
                _ => None,
            })
            .collect();
        let is_one = conditions.len() == nodes.len() && conditions.windows(2).all(|pair| pair[0].0 == pair[1].0);
        if is_one {
            self.begin(&conditions.iter().map(|selection| selection.1).collect::<Vec<_>>());
            self.begin(&conditions.iter().map(|selection| selection.2).collect::<Vec<_>>());
        } else if let Some(first) = nodes.first() {
            let home = Rc::clone(&self.guards[first.index()]);
            self.expand(nodes, &home);
        }
    }
}
