//! What depends on what, as the operations of a recording have it: whatever the numbers are.
//!
//! A parameter that is zero today counts. What doesn't: a product with a constant zero of the system's structure, and the
//! exponent zero.

use std::collections::BTreeSet;

use super::tape::{Binary, Leaf, Node, Operation, Tape};

/// Finds what nodes of a tape depend on.
#[derive(Debug)]
pub struct Dependence<'a> {
    tape: &'a Tape,
    /// In which search an operation was last met.
    met: Vec<u32>,
    search: u32,
    waiting: Vec<Node>,
}

impl<'a> Dependence<'a> {
    /// For a tape.
    pub fn new(tape: &'a Tape) -> Self {
        Dependence { tape, met: vec![0; tape.operations().len()], search: 0, waiting: Vec::new() }
    }

    /// The leaves that a node depends on.
    pub fn of(&mut self, node: Node) -> BTreeSet<Leaf> {
        let mut leaves = BTreeSet::new();
        self.search += 1;
        self.waiting.push(node);
        while let Some(node) = self.waiting.pop() {
            if std::mem::replace(&mut self.met[node.index()], self.search) == self.search {
                continue;
            }
            match self.tape.operation(node) {
                Operation::Leaf(leaf) => {
                    leaves.insert(*leaf);
                }
                operation if self.is_zero(operation) => {}
                operation => self.waiting.extend(operation.operands()),
            }
        }
        leaves
    }

    /// Whether an operation is zero or one whatever the numbers are that it is given.
    fn is_zero(&self, operation: &Operation) -> bool {
        let zero = |node: &Node| self.tape.constant(*node) == Some(0.0);
        match operation {
            Operation::Binary(Binary::Mul, a, b) => zero(a) || zero(b),
            Operation::Binary(Binary::Div, a, _) => zero(a),
            Operation::Powi(_, 0) => true,
            _ => false,
        }
    }
}
