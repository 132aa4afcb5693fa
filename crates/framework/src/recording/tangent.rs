//! Exact derivatives of a recording, as operations on the same tape: what dual numbers compute, operation by operation, where
//! something changes at all.

use std::collections::HashMap;
use std::sync::Arc;

use super::iteration::Body;
use super::tape::{Binary, Comparison, Leaf, Node, Operation, Tape, Unary};

/// The change of what is given: a leaf, or a number that an iteration carries.
type Seed<'a> = dyn Fn(Node, &Operation) -> Option<Node> + 'a;

impl Tape {
    /// The changes of operations, from a function for those of leaves: of each of `wanted`, none if it doesn't change.
    /// The nodes of leaves' changes must be on the tape.
    pub fn tangents(&mut self, wanted: &[Node], seed: impl Fn(Leaf) -> Option<Node>) -> Vec<Option<Node>> {
        self.tangents_of(wanted, &|_, operation| if let Operation::Leaf(leaf) = operation { seed(*leaf) } else { None })
    }

    /// The same with a function that also gives changes of numbers carried by an iteration: by their place on the tape
    /// and the operation there.
    fn tangents_of(&mut self, wanted: &[Node], seed: &Seed) -> Vec<Option<Node>> {
        // Operations after the last wanted one, and those added here, have no change themselves.
        let len = wanted.iter().map(|node| node.index() + 1).max().unwrap_or_default();
        let needed = needed(&self.operations[..len], wanted);
        let mut tangents: Vec<Option<Node>> = vec![None; len];
        for place in (0..len).filter(|&place| needed[place]) {
            let operation = &self.operations[place];
            let is_given = matches!(operation, Operation::Leaf(_) | Operation::Carried(_));
            if is_given || operation.operands().any(|operand| tangents[operand.index()].is_some()) {
                tangents[place] = self.tangent(Node(place as u32), &tangents, seed);
            }
        }
        wanted.iter().map(|node| tangents[node.index()]).collect()
    }

    /// True for operations that some nodes depend on, themselves included.
    pub fn needed(&self, wanted: &[Node]) -> Vec<bool> {
        needed(self.operations(), wanted)
    }

    /// A leaf, or the change of one.
    pub fn leaf(&mut self, leaf: Leaf) -> Node {
        self.add(Operation::Leaf(leaf))
    }

    /// A number that is known.
    pub fn number(&mut self, value: f64) -> Node {
        self.add(Operation::Constant(value.to_bits()))
    }

    /// The change of an operation where one of its operands, by its number, changes so, and no other does.
    pub(super) fn change(&mut self, node: Node, operation: &Operation, operand: usize, change: Node) -> Option<Node> {
        match *operation {
            // The same operand twice is two operands here.
            Operation::Binary(operation, a, b) => {
                let changes = if operand == 0 { [Some(change), None] } else { [None, Some(change)] };
                self.of_two(operation, [a, b], changes, node)
            }
            Operation::Unary(..) | Operation::Powi(..) | Operation::Powf(..) => {
                let of = |_: Node| Some(change);
                self.tangent_of(node, &of, &|_, _| None)
            }
            _ => None,
        }
    }

    fn tangent(&mut self, node: Node, tangents: &[Option<Node>], seed: &Seed) -> Option<Node> {
        self.tangent_of(node, &|node| tangents[node.index()], seed)
    }

    fn tangent_of(&mut self, node: Node, of: &dyn Fn(Node) -> Option<Node>, seed: &Seed) -> Option<Node> {
        match self.operation(node).clone() {
            given @ (Operation::Leaf(_) | Operation::Carried(_)) => seed(node, &given),
            Operation::Unary(function, a) => {
                let change = of(a)?;
                self.slope(function, a, node).map(|slope| self.times(change, slope))
            }
            Operation::Binary(operation, a, b) => self.of_two(operation, [a, b], [of(a), of(b)], node),
            Operation::Powi(a, exponent) => {
                let change = of(a).filter(|_| exponent != 0)?;
                let power = if exponent == 1 { self.number(1.0) } else { self.add(Operation::Powi(a, exponent - 1)) };
                let factor = self.number(f64::from(exponent));
                let slope = self.times(power, factor);
                Some(self.times(change, slope))
            }
            Operation::Powf(a, bits) => {
                let exponent = f64::from_bits(bits);
                let change = of(a).filter(|_| exponent != 0.0)?;
                let power = self.add(Operation::Powf(a, (exponent - 1.0).to_bits()));
                let factor = self.number(exponent);
                let slope = self.times(power, factor);
                Some(self.times(change, slope))
            }
            Operation::Select(condition, a, b) => {
                let changes = [of(a), of(b)];
                if changes == [None, None] {
                    return None;
                }
                let [yes, no] = changes.map(|change| change.unwrap_or_else(|| self.number(0.0)));
                Some(self.add(Operation::Select(condition, yes, no)))
            }
            Operation::Part(iteration, number) => {
                let with_changes = of(iteration)?;
                let Operation::Iterate { start, .. } = self.operation(iteration) else { return None };
                let behind = start.len() as u32;
                Some(self.add(Operation::Part(with_changes, behind + number)))
            }
            Operation::Iterate { body, most, start, captured } => {
                let changes = |nodes: &[Node]| nodes.iter().map(|&node| of(node)).collect::<Vec<_>>();
                let (of_start, of_captured) = (changes(&start), changes(&captured));
                let any = of_start.iter().chain(&of_captured).any(Option::is_some);
                any.then(|| self.iteration_with_changes(&body, most, (start, of_start), (captured, of_captured)))
            }
            _ => None,
        }
    }

    /// f'(x), where f isn't a step.
    fn slope(&mut self, function: Unary, x: Node, y: Node) -> Option<Node> {
        let unary = |tape: &mut Self, function, x| tape.add(Operation::Unary(function, x));
        let one = self.number(1.0);
        Some(match function {
            Unary::Neg => self.number(-1.0),
            Unary::Sin => unary(self, Unary::Cos, x),
            Unary::Cos => {
                let sine = unary(self, Unary::Sin, x);
                unary(self, Unary::Neg, sine)
            }
            Unary::Tan => {
                let square = self.times(y, y);
                self.add(Operation::Binary(Binary::Add, square, one))
            }
            Unary::Cosh => unary(self, Unary::Sinh, x),
            Unary::Sinh => unary(self, Unary::Cosh, x),
            Unary::Tanh => {
                let cosh = unary(self, Unary::Cosh, x);
                let inverse = unary(self, Unary::Recip, cosh);
                self.add(Operation::Powi(inverse, 2))
            }
            Unary::Exp => y,
            Unary::Ln => unary(self, Unary::Recip, x),
            Unary::Ln1p => {
                let above = self.add(Operation::Binary(Binary::Add, x, one));
                unary(self, Unary::Recip, above)
            }
            Unary::Sqrt => {
                let half = self.number(0.5);
                self.add(Operation::Binary(Binary::Div, half, y))
            }
            Unary::Atan => {
                let square = self.times(x, x);
                let above = self.add(Operation::Binary(Binary::Add, square, one));
                unary(self, Unary::Recip, above)
            }
            Unary::Recip => {
                let minus = unary(self, Unary::Neg, y);
                self.times(minus, y)
            }
            Unary::Abs => unary(self, Unary::Signum, x),
            Unary::Wrap => one,
            Unary::Signum | Unary::Floor | Unary::Round => return None,
        })
    }

    fn of_two(
        &mut self,
        operation: Binary,
        [a, b]: [Node; 2],
        changes: [Option<Node>; 2],
        value: Node,
    ) -> Option<Node> {
        let [of_a, of_b] = changes;
        match operation {
            Binary::Add => self.sum(of_a, of_b),
            Binary::Sub => match of_b {
                None => of_a,
                Some(of_b) => Some(self.difference(of_a, of_b)),
            },
            Binary::Mul => {
                let left = of_a.map(|change| self.times(change, b));
                let right = of_b.map(|change| self.times(a, change));
                self.sum(left, right)
            }
            Binary::Div => {
                let moved = of_b.map(|change| self.times(value, change));
                let change = match moved {
                    None => of_a?,
                    Some(moved) => self.difference(of_a, moved),
                };
                Some(self.add(Operation::Binary(Binary::Div, change, b)))
            }
            Binary::Pow => {
                let by_base = of_a.map(|change| {
                    let one = self.number(1.0);
                    let less = self.add(Operation::Binary(Binary::Sub, b, one));
                    let power = self.add(Operation::Binary(Binary::Pow, a, less));
                    let slope = self.times(b, power);
                    self.times(slope, change)
                });
                let by_exponent = of_b.map(|change| {
                    let zero = self.number(0.0);
                    let is_positive = self.add(Operation::Compare(Comparison::Below, zero, a));
                    let logarithm = self.add(Operation::Unary(Unary::Ln, a));
                    let slope = self.times(value, logarithm);
                    let slope = self.add(Operation::Select(is_positive, slope, zero));
                    self.times(slope, change)
                });
                self.sum(by_base, by_exponent)
            }
        }
    }

    fn sum(&mut self, a: Option<Node>, b: Option<Node>) -> Option<Node> {
        match (a, b) {
            (Some(a), Some(b)) => Some(self.add(Operation::Binary(Binary::Add, a, b))),
            (one, other) => one.or(other),
        }
    }

    fn difference(&mut self, a: Option<Node>, b: Node) -> Node {
        match a {
            Some(a) => self.add(Operation::Binary(Binary::Sub, a, b)),
            None => self.add(Operation::Unary(Unary::Neg, b)),
        }
    }

    /// A product; a factor 1 is left out.
    fn times(&mut self, a: Node, b: Node) -> Node {
        match (self.constant(a), self.constant(b)) {
            (Some(1.0), _) => b,
            (_, Some(1.0)) => a,
            (Some(-1.0), _) => self.add(Operation::Unary(Unary::Neg, b)),
            (_, Some(-1.0)) => self.add(Operation::Unary(Unary::Neg, a)),
            _ => self.add(Operation::Binary(Binary::Mul, a, b)),
        }
    }

    /// An iteration whose state has its changes behind it.
    fn iteration_with_changes(
        &mut self,
        body: &Body,
        most: usize,
        (start, of_start): (Vec<Node>, Vec<Option<Node>>),
        (captured, of_captured): (Vec<Node>, Vec<Option<Node>>),
    ) -> Node {
        let len = start.len();
        let changing: Vec<usize> = (0..captured.len()).filter(|&k| of_captured[k].is_some()).collect();
        let body = with_changes(body, len, &changing, captured.len());
        let zero = self.number(0.0);
        let of_start = of_start.into_iter().map(|change| change.unwrap_or(zero));
        let start: Vec<Node> = start.into_iter().chain(of_start).collect();
        let of_captured = of_captured.into_iter().flatten();
        let captured = captured.into_iter().chain(of_captured).collect();
        self.add(Operation::Iterate { body: Arc::new(body), most, start, captured })
    }
}

/// True for operations that some nodes depend on, themselves included.
pub fn needed(operations: &[Operation], wanted: &[Node]) -> Vec<bool> {
    let mut needed = vec![false; operations.len()];
    wanted.iter().for_each(|node| needed[node.index()] = true);
    // Operands come before what they are operands of.
    for (place, operation) in operations.iter().enumerate().rev() {
        if needed[place] {
            operation.operands().for_each(|operand| needed[operand.index()] = true);
        }
    }
    needed
}

/// The body of an iteration whose state of `len` numbers is followed by their changes. The changes of captured numbers,
/// if any, follow all captured ones.
fn with_changes(body: &Body, len: usize, changing: &[usize], captured: usize) -> Body {
    let mut tape = Tape::default();
    let mut moved: Vec<Node> = Vec::with_capacity(body.operations.len());
    let mut changes = HashMap::new();
    for operation in &body.operations {
        let Operation::Carried(number) = operation else {
            moved.push(tape.add(operation.over(|node| moved[node.index()])));
            continue;
        };
        let number = *number as usize;
        let (place, change) = if number < len {
            (number, Some(len + number))
        } else {
            let behind = changing.iter().position(|&k| k == number - len);
            (len + number, behind.map(|behind| 2 * len + captured + behind))
        };
        let node = tape.add(Operation::Carried(place as u32));
        let change = change.map(|change| tape.add(Operation::Carried(change as u32)));
        changes.insert(node, change);
        moved.push(node);
    }
    let goes_on = moved[body.goes_on.index()];
    let next: Vec<Node> = body.next.iter().map(|node| moved[node.index()]).collect();
    let of_next = tape.tangents_of(&next, &|node, _| changes.get(&node).copied().flatten());
    let zero = tape.number(0.0);
    let of_next = of_next.into_iter().map(|change| change.unwrap_or(zero));
    let next = next.into_iter().chain(of_next).collect();
    Body { operations: tape.operations, goes_on, next }
}

#[cfg(test)]
mod tests {
    use super::super::instructions::slopes;
    use super::super::node::Recorded;
    use crate::scalar::Scalar;
    use num_dual::{Dual64, DualNum};

    /// Every function and operation against those of a library, at random places.
    #[test]
    fn derivatives_are_those_of_an_independent_implementation() {
        type Own = fn(Recorded) -> Recorded;
        type Other = fn(Dual64) -> Dual64;
        let pairs: [(Own, Other); 19] = [
            (|x| Scalar::sin(x), |x| x.sin()),
            (|x| Scalar::cos(x), |x| x.cos()),
            (|x| Scalar::tan(x), |x| x.tan()),
            (|x| Scalar::cosh(x), |x| x.cosh()),
            (|x| Scalar::tanh(x), |x| x.tanh()),
            (|x| Scalar::exp(x), |x| x.exp()),
            (|x| Scalar::ln(x), |x| x.ln()),
            (|x| Scalar::ln_1p(x), |x| x.ln_1p()),
            (|x| Scalar::sqrt(x), |x| x.sqrt()),
            (|x| Scalar::atan(x), |x| x.atan()),
            (|x| Scalar::recip(x), |x| x.recip()),
            (|x| Scalar::powi(x, -3), |x| x.powi(-3)),
            (|x| Scalar::powf(x, 1.7), |x| x.powf(1.7)),
            (|x| Scalar::powd(x, x * 0.5), |x| x.powd(x * 0.5)),
            (|x| x * x - x / (x + 2.0), |x| x * x - x / (x + 2.0)),
            (|x| -x * 3.0 / 7.0 - 1.0, |x| -x * 3.0 / 7.0 - 1.0),
            (|x| Scalar::abs(-x), |x| num_traits::Signed::abs(&-x)),
            (|x| Scalar::powi(x, 0), |x| x.powi(0)),
            (|x| Recorded::from(3.0) / x, |x| Dual64::from(3.0) / x),
        ];
        for k in 1..40 {
            let x = 0.07 * f64::from(k);
            for (number, (own, other)) in pairs.into_iter().enumerate() {
                let ([(value, slope)], other) = (slopes(|x| [own(x)], x), other(Dual64::new(x, 1.0)));
                assert!((value - other.re).abs() <= 1e-14 * other.re.abs(), "{number} at {x}: {value} {other}");
                assert!(
                    (slope - other.eps).abs() <= 1e-12 * (1.0 + other.eps.abs()),
                    "{number} at {x}: {slope} {other}"
                );
            }
        }
    }

    #[test]
    fn an_angle_changes_as_fast_wrapped_as_unwrapped() {
        for x in [-40.0, -3.0, 0.0, 3.2, 1e6] {
            assert_eq!(slopes(|x| [Scalar::wrap(x * 2.0)], x), [(Scalar::wrap(x * 2.0), 2.0)]);
        }
    }

    #[test]
    fn a_saturated_function_has_a_derivative_far_out() {
        assert_eq!(slopes(|x| [Scalar::tanh(x)], 800.0), [(1.0, 0.0)]);
    }
}
