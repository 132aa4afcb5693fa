//! Loops in straight lines: what is computed alike for some elements of a variable, as for the axes of a vehicle, is written once, in a
//! loop over them. All operations are those of the recording, on the same numbers.
//!
//! It begins with elements of one array that are computed by the same operation, and with terms of a sum. As long as all their operands
//! are, they belong to the loop, too. Others are read by it, in arrays. What follows from all elements of one loop is in a later one.

mod built;
#[cfg(test)]
mod tests;
mod tuples;

use std::rc::Rc;

use super::functions::Written;
use crate::fmi2::source::expression::Kind;
use crate::fmi2::source::loops::{Input, Loops, element};
use crate::recording::{Binary, Node, Operation, followed};
use tuples::{Search, shape};

/// Operations with loops, which are iterations without a state; where the operations before are now; and what the loops read.
pub(super) struct Rolled {
    pub operations: Vec<Operation>,
    pub moved: Vec<Option<Node>>,
    pub loops: Loops,
}

/// Knowledge of leaves and constants.
pub(super) struct Known<'a> {
    /// The number that an operation is.
    pub number: &'a dyn Fn(&Operation) -> Option<f64>,
    /// The element of an array in C that a leaf is.
    pub element: &'a dyn Fn(&Operation) -> Option<(String, Kind)>,
    /// True for a function that is called again and again in a step.
    pub is_repeated: bool,
    /// The least number that a leaf or a constant is, if known.
    pub least: &'a dyn Fn(&Operation) -> Option<f64>,
}

impl Rolled {
    /// Constants of a step that a loop reads one a lane.
    pub fn constants(&self) -> Vec<Vec<usize>> {
        let mut all = Vec::new();
        for (place, lanes) in &self.loops {
            let Operation::Iterate { captured, .. } = &self.operations[*place] else { continue };
            let mut captured = captured.iter();
            for input in &lanes.inputs {
                let count = if *input == Input::Each { lanes.count } else { usize::from(*input == Input::Same) };
                let read: Vec<&Node> = captured.by_ref().take(count).collect();
                let numbers = read.into_iter().map(|node| match self.operations[node.index()] {
                    Operation::Carried(number) => Some(number as usize),
                    _ => None,
                });
                all.extend(numbers.collect::<Option<Vec<_>>>().filter(|numbers| numbers.len() >= FEWEST));
            }
        }
        all
    }
}

/// The fewest lanes of a loop.
const FEWEST: usize = 2;

/// Operations with loops where it is worth it.
pub(super) fn rolled(operations: &[Operation], wanted: &[Node], written: &[&Written], known: &Known) -> Rolled {
    let all: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
    let operations = followed(operations, &all);
    let mut search = Search::of(&operations, wanted);
    for nodes in arrays(&operations, wanted, written).into_iter().chain(search.chains()) {
        search.begin(&nodes);
    }
    search.settle(known);
    built::built(&search, wanted, known)
}

/// Elements of arrays, one behind the other, that are computed alike, and conditions that are.
fn arrays(operations: &[Operation], wanted: &[Node], written: &[&Written]) -> Vec<Vec<Node>> {
    let mut arrays: Vec<(&str, Vec<(usize, Node)>)> = Vec::new();
    for one in written {
        let Some((array, number)) = element(&one.to) else { continue };
        match arrays.iter_mut().find(|(other, _)| *other == array) {
            Some((_, all)) => all.push((number, one.node)),
            None => arrays.push((array, vec![(number, one.node)])),
        }
    }
    let conditions = wanted[written.len()..].iter().copied().enumerate().collect();
    let mut found: Vec<Vec<Node>> = Vec::new();
    for (_, all) in arrays.into_iter().chain([("", conditions)]) {
        let is_next =
            |a: &(usize, Node), b: &(usize, Node)| a.0 + 1 == b.0 && shape(operations, a.1) == shape(operations, b.1);
        let alike = all.chunk_by(is_next).filter(|all| all.len() >= FEWEST);
        found.extend(alike.map(|all| all.iter().map(|one| one.1).collect::<Vec<_>>()));
    }
    found
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

    /// The part before the last term of a sum or a condition, and that term, where it is one as that at the end of its chain.
    fn link(&self, at: Node, end: Node) -> Option<(Node, Node)> {
        match (&self.operations[at.index()], &self.operations[end.index()]) {
            (Operation::Binary(Binary::Add, a, b), Operation::Binary(Binary::Add, ..))
            | (Operation::And(a, b), Operation::And(..))
            | (Operation::Or(a, b), Operation::Or(..)) => Some((*a, *b)),
            _ => None,
        }
    }

    /// Looks for what some nodes have in common. Selections by one condition that are always made stay outside: each of their arms may
    /// have loops.
    fn begin(&mut self, nodes: &[Node]) {
        let conditions: Vec<(Node, Node, Node)> = nodes
            .iter()
            .filter_map(|node| match self.operations[node.index()] {
                Operation::Select(condition, yes, no) => Some((condition, yes, no)),
                _ => None,
            })
            .collect();
        let is_one = conditions.len() == nodes.len() && conditions.windows(2).all(|pair| pair[0].0 == pair[1].0);
        let is_outermost = nodes.iter().all(|node| self.guards[node.index()].is_always());
        if is_one && is_outermost {
            self.begin(&conditions.iter().map(|selection| selection.1).collect::<Vec<_>>());
            self.begin(&conditions.iter().map(|selection| selection.2).collect::<Vec<_>>());
        } else if let Some(first) = nodes.first() {
            let home = Rc::clone(&self.guards[first.index()]);
            self.expand(nodes, &home);
        }
    }
}
