//! Adjoints of a recording, as operations on the same tape: the transposed of what tangents compute, from results back to leaves.

use super::tangent::needed;
use super::tape::{Binary, Comparison, Node, Operation, Tape};

impl Tape {
    /// The sum over `wanted` of seed times derivative, by each of `by`; nothing where none depends on it. `None` where one of `wanted`
    /// follows from an iteration, which isn't followed back.
    pub fn adjoints(&mut self, wanted: &[(Node, Node)], by: &[Node]) -> Option<Vec<Option<Node>>> {
        let nodes: Vec<Node> = wanted.iter().map(|(node, _)| *node).collect();
        let len = nodes.iter().chain(by).map(|node| node.index() + 1).max().unwrap_or_default();
        let needed = needed(&self.operations[..len], &nodes);
        let depends = self.dependents(len, by);
        let mut adjoints: Vec<Option<Node>> = vec![None; len];
        for &(node, seed) in wanted {
            self.collect(&mut adjoints, node, Some(seed));
        }
        for place in (0..len).rev().filter(|&place| needed[place] && depends[place]) {
            let Some(adjoint) = adjoints[place] else { continue };
            match self.operations[place] {
                Operation::Iterate { .. } | Operation::Part(..) => return None,
                _ => self.hand_on(Node(place as u32), adjoint, &depends, &mut adjoints),
            }
        }
        Some(by.iter().map(|node| adjoints[node.index()]).collect())
    }

    /// Operations that some nodes change.
    fn dependents(&self, len: usize, by: &[Node]) -> Vec<bool> {
        let mut depends = vec![false; len];
        by.iter().for_each(|node| depends[node.index()] = true);
        for (place, operation) in self.operations[..len].iter().enumerate() {
            depends[place] |= operation.operands().any(|operand| depends[operand.index()]);
        }
        depends
    }

    fn collect(&mut self, adjoints: &mut [Option<Node>], node: Node, more: Option<Node>) {
        let known = &mut adjoints[node.index()];
        *known = match (*known, more) {
            (Some(one), Some(other)) => Some(self.add(Operation::Binary(Binary::Add, one, other))),
            (one, other) => one.or(other),
        };
    }

    /// Adds what an operation's adjoint gives to those of its operands.
    fn hand_on(&mut self, node: Node, adjoint: Node, depends: &[bool], adjoints: &mut [Option<Node>]) {
        let operation = self.operation(node).clone();
        if let Operation::Select(condition, yes, no) = operation {
            let zero = self.number(0.0);
            for (taken, [one, other]) in [(yes, [adjoint, zero]), (no, [zero, adjoint])] {
                if depends[taken.index()] {
                    let part = self.add(Operation::Select(condition, one, other));
                    self.collect(adjoints, taken, Some(part));
                }
            }
            return;
        }
        let operands: Vec<Node> = operation.operands().collect();
        for (k, &operand) in operands.iter().enumerate().filter(|(_, operand)| depends[operand.index()]) {
            let part = self.part_of(node, &operation, k, adjoint);
            self.collect(adjoints, operand, part);
        }
    }

    /// An adjoint times the derivative of an operation by one of its operands: the change of the operation where only that operand
    /// changes, by the adjoint. One that is zero, by its seed or in an arm that isn't taken, stays zero, though the derivative may be no number.
    fn part_of(&mut self, node: Node, operation: &Operation, operand: usize, adjoint: Node) -> Option<Node> {
        let change = self.change(node, operation, operand, adjoint)?;
        if change == adjoint {
            return Some(change);
        }
        let zero = self.number(0.0);
        let is_zero = self.add(Operation::Compare(Comparison::Equals, adjoint, zero));
        Some(self.add(Operation::Select(is_zero, zero, change)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::instructions::{Instructions, Registers};
    use super::super::node::{Recorded, on_tape};
    use super::super::tape::{Leaf, Node, Operation};
    use crate::scalar::Scalar;

    /// The gradient of a function of two numbers: by adjoints, and by tangents.
    fn gradients(function: impl FnOnce([Recorded; 2]) -> Recorded, at: [f64; 2]) -> [[f64; 2]; 2] {
        let leaves = [Leaf::Real(0), Leaf::Real(1)];
        let (found, mut tape) = on_tape(0, || function(leaves.map(|leaf| Recorded::of(Operation::Leaf(leaf)))));
        let (zero, one, by) = (tape.number(0.0), tape.number(1.0), leaves.map(|leaf| tape.leaf(leaf)));
        let back = tape.adjoints(&[(found.node(), one)], &by).expect("there is no iteration");
        let ahead = leaves.map(|known| tape.tangents(&[found.node()], |leaf| (leaf == known).then_some(one))[0]);
        let nodes: Vec<Node> = back.into_iter().chain(ahead).map(|node| node.unwrap_or(zero)).collect();
        let leaf = |leaf| if leaf == Leaf::Real(0) { at[0] } else { at[1] };
        let numbers: Vec<f64> = Instructions::of(&tape, &nodes).carry_out(leaf, &mut Registers::new()).collect();
        [[numbers[0], numbers[1]], [numbers[2], numbers[3]]]
    }

    #[test]
    fn a_gradient_is_the_same_in_both_directions() {
        type Function = fn([Recorded; 2]) -> Recorded;
        let functions: [Function; 5] = [
            |[x, y]| x * y + x / (y + 2.0) - y * y,
            |[x, y]| (x * y).sin() * y.exp() / (x * x + 1.0).sqrt(),
            |[x, y]| (x + 3.0).powd(y * 0.5) + x.powi(3) * y.tanh() + x.powf(1.5),
            |[x, y]| (x - y).abs() * x.cos() - x.recip() * x.recip(),
            |[x, y]| Recorded::select(x.below(y), x * x * y, (x - y).sqrt() * y),
        ];
        for function in functions {
            for k in 1..20 {
                let (x, y) = (0.31 * f64::from(k), 0.7 + (2.3 * f64::from(k)).sin().abs());
                let [back, ahead] = gradients(function, [x, y]);
                for (one, other) in back.into_iter().zip(ahead) {
                    assert!((one - other).abs() <= 1e-12 * (1.0 + other.abs()), "{back:?} {ahead:?} at {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn an_iteration_is_not_followed_back() {
        let leaf = Leaf::Real(0);
        let (found, mut tape) = on_tape(0, || {
            let mut state = [Recorded::of(Operation::Leaf(leaf))];
            Recorded::iterate(&mut state, 9, |state| state[0].above(Recorded::from(1.0)), |state| state[0] *= 0.5);
            state[0] * 2.0
        });
        let (one, by) = (tape.number(1.0), tape.leaf(leaf));
        assert_eq!(tape.adjoints(&[(found.node(), one)], &[by]), None);
        // What isn't wanted isn't followed.
        assert_eq!(tape.adjoints(&[(by, one)], &[by]), Some(vec![Some(one)]));
    }

    #[test]
    fn an_arm_that_is_not_taken_has_no_part_in_it_though_its_derivative_is_none() {
        // At x = 0 the root has no derivative, and the quotient no value.
        let function = |[x, y]: [Recorded; 2]| Recorded::select(x.below(y), x * y, x.sqrt() * (y / x));
        assert_eq!(gradients(function, [0.0, 2.0]), [[2.0, 0.0]; 2]);
    }
}
