//! A recording without what numbers that are known decide: products with zeros of the structure, sums with zero, conditions.
//!
//! Where numbers are finite, no value is changed by it, but for the sign of a zero.

use std::sync::Arc;

use super::iteration::Body;
use super::method::Recording;
use super::tape::{Binary, Node, Operation, Tape, Unary};

impl Recording {
    /// The recording without what known numbers decide. Conditions that are decided otherwise are found by a function of the
    /// tape and their place there.
    pub fn simplified(&self, decided: &dyn Fn(&Tape, Node) -> Option<bool>) -> Recording {
        let mut tape = Tape::default();
        tape.reserve(self.tape.operations().len());
        let mut moved = Vec::with_capacity(self.tape.operations().len());
        for (place, operation) in self.tape.operations().iter().enumerate() {
            let node = match decided(&self.tape, Node::at(place)) {
                Some(holds) => tape.number(f64::from(u8::from(holds))),
                None => tape.simplified(operation.over(|node| moved[node.index()])),
            };
            moved.push(node);
        }
        let all = |nodes: &[Node]| nodes.iter().map(|node| moved[node.index()]).collect();
        let (reals, integers, results) = (all(&self.reals), all(&self.integers), all(&self.results));
        tape.notes = self.tape.notes.iter().map(|note| note.moved(&|node| moved[node.index()])).collect();
        Recording { tape, reals, integers, results }
    }
}

impl Tape {
    /// Adds an operation in its simplest form.
    fn simplified(&mut self, operation: Operation) -> Node {
        let is = |node: Node, value: f64| self.constant(node) == Some(value);
        let negated = |node: Node| match self.operation(node) {
            Operation::Unary(Unary::Neg, of) => Some(*of),
            _ => None,
        };
        let opposite = |node: Node| match self.operation(node) {
            Operation::Not(of) => Some(*of),
            _ => None,
        };
        let twice = |node: Node| match self.operation(node) {
            Operation::Binary(Binary::Add, a, b) if a == b => Some(*a),
            _ => None,
        };
        match operation {
            Operation::Binary(Binary::Mul, a, b) if is(a, 0.0) || is(b, 0.0) => self.number(0.0),
            Operation::Binary(Binary::Div, a, _) if is(a, 0.0) => self.number(0.0),
            Operation::Binary(Binary::Sub, a, b) if a == b => self.number(0.0),
            Operation::Binary(Binary::Mul, a, b) if is(b, 0.5) && twice(a).is_some() => twice(a).unwrap_or(a),
            Operation::Binary(Binary::Add, a, b) if is(a, 0.0) => b,
            Operation::Binary(Binary::Add | Binary::Sub, a, b) if is(b, 0.0) => a,
            Operation::Binary(Binary::Sub, a, b) if is(a, 0.0) => self.simplified(Operation::Unary(Unary::Neg, b)),
            Operation::Binary(Binary::Mul, a, b) if is(a, -1.0) => self.simplified(Operation::Unary(Unary::Neg, b)),
            Operation::Binary(Binary::Mul | Binary::Div, a, b) if is(b, -1.0) => {
                self.simplified(Operation::Unary(Unary::Neg, a))
            }
            Operation::Not(a) if opposite(a).is_some() => opposite(a).unwrap_or(a),
            Operation::Unary(Unary::Neg, a) if negated(a).is_some() => negated(a).unwrap_or(a),
            Operation::Binary(Binary::Add, a, b) => match (negated(a), negated(b)) {
                (_, Some(b)) => self.simplified(Operation::Binary(Binary::Sub, a, b)),
                (Some(a), None) => self.simplified(Operation::Binary(Binary::Sub, b, a)),
                _ => self.add(operation),
            },
            Operation::Binary(Binary::Sub, a, b) if negated(b).is_some() => {
                self.simplified(Operation::Binary(Binary::Add, a, negated(b).unwrap_or(b)))
            }
            Operation::Select(condition, yes, no) => self.selected(condition, yes, no),
            Operation::Iterate { body, most, start, captured } => {
                self.add(Operation::Iterate { body: Arc::new(body.simplified()), most, start, captured })
            }
            operation => self.add(operation),
        }
    }

    /// A selection without those in its branches that its own condition decides.
    fn selected(&mut self, condition: Node, yes: Node, no: Node) -> Node {
        let (condition, yes, no) = match self.operation(condition) {
            Operation::Not(of) => (*of, no, yes),
            _ => (condition, yes, no),
        };
        let branch = |mut node: Node, holds: bool| {
            while let Operation::Select(of, a, b) = self.operation(node) {
                let is_opposite = *self.operation(*of) == Operation::Not(condition);
                if *of != condition && !is_opposite {
                    break;
                }
                node = if holds == is_opposite { *b } else { *a };
            }
            node
        };
        let (yes, no) = (branch(yes, true), branch(no, false));
        self.add(Operation::Select(condition, yes, no))
    }
}

impl Body {
    /// The same step, in its simplest form.
    fn simplified(&self) -> Body {
        let mut tape = Tape::default();
        let mut moved: Vec<Node> = Vec::with_capacity(self.operations.len());
        for operation in &self.operations {
            let node = tape.simplified(operation.over(|node| moved[node.index()]));
            moved.push(node);
        }
        let next = self.next.iter().map(|node| moved[node.index()]).collect();
        Body { operations: tape.operations, goes_on: moved[self.goes_on.index()], next }
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::{Recorded, on_tape};
    use super::super::tape::Leaf;
    use super::*;
    use crate::scalar::Scalar;

    /// Operations that a function records of two numbers, before and after, without those that nothing reads.
    fn left(record: impl FnOnce(Recorded, Recorded) -> Recorded) -> (Vec<Operation>, Vec<Operation>) {
        let leaf = |place: u32| Recorded::of(Operation::Leaf(Leaf::Real(place)));
        let (result, tape) = on_tape(0, || record(leaf(0), leaf(1)).node());
        let recording = Recording { tape, reals: vec![result], integers: vec![], results: vec![] };
        let simplified = recording.simplified(&|_, _| None);
        let needed = |of: &Recording| {
            let needed = of.tape.needed(&of.reals);
            let all = of.tape.operations().iter().zip(needed);
            all.filter(|(_, needed)| *needed).map(|(operation, _)| operation.clone()).collect::<Vec<_>>()
        };
        (needed(&recording), needed(&simplified))
    }

    #[test]
    fn products_with_zero_and_sums_with_them_go() {
        let zero = || Recorded::from(0.0);
        let (before, after) = left(|a, b| zero() + a * zero() + b * 1.0);
        assert!(before.len() > 3 && after == [Operation::Leaf(Leaf::Real(1))], "{after:?}");
        let (_, after) = left(|a, b| a - (zero() - b));
        assert!(matches!(after[..], [.., Operation::Binary(Binary::Add, ..)]) && after.len() == 3, "{after:?}");
        let (_, after) = left(|a, b| a * -1.0 + b);
        assert!(matches!(after[..], [.., Operation::Binary(Binary::Sub, ..)]) && after.len() == 3, "{after:?}");
    }

    #[test]
    fn a_selection_has_none_within_that_its_condition_decides() {
        let (_, after) = left(|a, b| {
            let is = || a.below(b);
            let inner = Recorded::select(!is(), a * b, a + b);
            Recorded::select(!is(), Recorded::select(is(), a - b, inner), Recorded::select(is(), b - a, inner))
        });
        let selections = after.iter().filter(|one| matches!(one, Operation::Select(..))).count();
        assert!(selections == 1 && !after.iter().any(|one| matches!(one, Operation::Not(_))), "{after:?}");
        let is_product = |one: &Operation| matches!(one, Operation::Binary(Binary::Mul, ..));
        let is_difference = |one: &Operation| matches!(one, Operation::Binary(Binary::Sub, ..));
        assert!(
            after.iter().any(is_product) && after.iter().filter(|one| is_difference(one)).count() == 1,
            "{after:?}"
        );
    }

    #[test]
    fn what_a_condition_decides_is_all_that_is_left() {
        let leaf = |place: u32| Recorded::of(Operation::Leaf(Leaf::Real(place)));
        let (result, tape) = on_tape(0, || {
            let [a, b] = [0, 1].map(leaf);
            Recorded::select(a.below(b), a + b, a * b).node()
        });
        let recording = Recording { tape, reals: vec![result], integers: vec![], results: vec![] };
        let is_comparison = |tape: &Tape, node| matches!(tape.operation(node), Operation::Compare(..)).then_some(false);
        let simplified = recording.simplified(&is_comparison);
        assert!(matches!(simplified.tape.operation(simplified.reals[0]), Operation::Binary(Binary::Mul, ..)));
    }
}
