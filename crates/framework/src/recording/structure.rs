//! Dependences between values, by the operations of a recording: whatever the numbers are.
//!
//! A parameter that is zero today counts. A product with a constant zero of the system's structure doesn't, nor does an
//! exponent of zero.

use super::tape::{Binary, Leaf, Node, Operation, Tape};

/// Number of leaves in one pass: a bit each.
const AT_ONCE: usize = u64::BITS as usize;

impl Tape {
    /// Those of the wanted leaves that each of some nodes depends on, in increasing order.
    pub fn dependence(&self, nodes: &[Node], wanted: impl Fn(Leaf) -> bool) -> Vec<Vec<Leaf>> {
        let leaf = |(place, operation): (usize, &Operation)| match operation {
            Operation::Leaf(leaf) if wanted(*leaf) => Some((*leaf, place)),
            _ => None,
        };
        let mut leaves: Vec<(Leaf, usize)> = self.operations().iter().enumerate().filter_map(leaf).collect();
        leaves.sort_unstable();
        let mut found = vec![Vec::new(); nodes.len()];
        let mut reached = vec![0_u64; self.operations().len()];
        for followed in leaves.chunks(AT_ONCE) {
            reached.fill(0);
            followed.iter().enumerate().for_each(|(bit, &(_, place))| reached[place] = 1 << bit);
            self.follow(&mut reached);
            for (node, found) in nodes.iter().zip(&mut found) {
                let mut bits = reached[node.index()];
                while bits != 0 {
                    found.push(followed[bits.trailing_zeros() as usize].0);
                    bits &= bits - 1;
                }
            }
        }
        found
    }

    /// Carries on what leaves have reached.
    fn follow(&self, reached: &mut [u64]) {
        // Operands come before what they are operands of.
        for (place, operation) in self.operations().iter().enumerate() {
            if !matches!(operation, Operation::Leaf(_)) {
                let bits = operation.operands().fold(0, |bits, operand| bits | reached[operand.index()]);
                reached[place] = if bits != 0 && self.is_fixed(operation) { 0 } else { bits };
            }
        }
    }

    /// True if an operation is zero or one whatever the numbers are that it is given.
    fn is_fixed(&self, operation: &Operation) -> bool {
        let zero = |node: &Node| self.constant(*node) == Some(0.0);
        match operation {
            Operation::Binary(Binary::Mul, a, b) => zero(a) || zero(b),
            Operation::Binary(Binary::Div, a, _) => zero(a),
            Operation::Powi(_, 0) => true,
            _ => false,
        }
    }
}
