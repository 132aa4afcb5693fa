//! Iterations: a step recorded once, whatever how often it is carried out.
//!
//! While its condition and its step are recorded, an iteration is open on the tape, so that both are ordinary
//! equations. When it ends, operations that depend on its state are taken off the tape and become its [`Body`]. The
//! others stay before it, and are computed once.

use std::collections::HashMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::tape::{Leaf, Node, Operation, Tape};

/// A step of an iteration. Its operations read its state, and other numbers, as [`Operation::Carried`].
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Body {
    /// The operations, in an order in which each comes after its operands.
    pub operations: Vec<Operation>,
    /// True if the step is carried out; else the iteration ends.
    pub goes_on: Node,
    /// The state after the step.
    pub next: Vec<Node>,
}

impl Body {
    /// The state that is reached from a start.
    pub fn reached(&self, most: usize, start: &[f64], captured: &[f64]) -> Vec<f64> {
        let mut state = start.to_vec();
        for _ in 0..most {
            let carried = |k: usize| if k < state.len() { state[k] } else { captured[k - state.len()] };
            let values = values(&self.operations, &|_| f64::NAN, &carried);
            if values[self.goes_on.index()] == 0.0 {
                break;
            }
            state = self.next.iter().map(|node| values[node.index()]).collect();
        }
        state
    }
}

/// The value of each operation, where those of leaves, and of what an iteration carries, are found by functions. The value of
/// an iteration itself is none.
pub(super) fn values(operations: &[Operation], leaf: &dyn Fn(Leaf) -> f64, carried: &dyn Fn(usize) -> f64) -> Vec<f64> {
    let mut values: Vec<f64> = Vec::with_capacity(operations.len());
    let mut reached: HashMap<usize, Vec<f64>> = HashMap::new();
    for (place, operation) in operations.iter().enumerate() {
        let value = match operation {
            Operation::Leaf(which) => leaf(*which),
            Operation::Carried(number) => carried(*number as usize),
            Operation::Iterate { body, most, start, captured } => {
                let all = |nodes: &[Node]| nodes.iter().map(|node| values[node.index()]).collect::<Vec<f64>>();
                reached.insert(place, body.reached(*most, &all(start), &all(captured)));
                f64::NAN
            }
            Operation::Part(iteration, number) => reached[&iteration.index()][*number as usize],
            _ => operation.value(|node| values[node.index()]).unwrap_or(f64::NAN),
        };
        values.push(value);
    }
    values
}

/// An iteration that is being recorded.
#[derive(Debug)]
pub(super) struct Open {
    /// Begin on the tape, and number of its state's numbers.
    begin: usize,
    len: usize,
    /// Number of carried numbers of the iterations around it.
    carried: u32,
}

impl Open {
    /// Its state as the step finds it.
    pub fn state(&self) -> impl Iterator<Item = Node> + use<> {
        (self.begin as u32..).take(self.len).map(Node)
    }
}

/// Destination of an operation when its iteration ends.
#[derive(Clone, Copy)]
enum Place {
    /// The body.
    Inside(Node),
    /// The operations before the iteration.
    Before(Node),
}

impl Tape {
    /// Begins an iteration over a state of `len` numbers.
    pub(super) fn begin_iteration(&mut self, len: usize) -> Open {
        let open = Open { begin: self.operations.len(), len, carried: self.carried };
        self.carried += len as u32;
        self.operations.extend((open.carried..self.carried).map(Operation::Carried));
        open
    }

    /// Ends it: the state that it reaches.
    pub(super) fn end_iteration(
        &mut self,
        open: Open,
        (goes_on, next): (Node, Vec<Node>),
        start: Vec<Node>,
        most: usize,
    ) -> Vec<Node> {
        self.carried = open.carried;
        let recorded = self.operations.split_off(open.begin);
        recorded.iter().for_each(|operation| _ = self.known.remove(operation));
        let mut parting = Parting { tape: self, open, body: Tape::default(), captured: vec![], places: vec![] };
        recorded.iter().for_each(|operation| parting.put(operation));
        let goes_on = parting.inside(goes_on);
        let next = next.into_iter().map(|node| parting.inside(node)).collect();
        let Parting { body, captured, .. } = parting;
        let body = Body { operations: body.operations, goes_on, next };
        self.reached(body, most, start, captured)
    }

    fn reached(&mut self, body: Body, most: usize, start: Vec<Node>, captured: Vec<Node>) -> Vec<Node> {
        let known = |nodes: &[Node]| nodes.iter().map(|&node| self.constant(node)).collect::<Option<Vec<f64>>>();
        if let (Some(start), Some(captured)) = (known(&start), known(&captured)) {
            let reached = body.reached(most, &start, &captured);
            return reached.into_iter().map(|value| self.add(Operation::Constant(value.to_bits()))).collect();
        }
        let len = start.len() as u32;
        let iteration = self.add(Operation::Iterate { body: Arc::new(body), most, start, captured });
        (0..len).map(|number| self.add(Operation::Part(iteration, number))).collect()
    }
}

/// Operations of an iteration while they are parted into those that depend on its state and the others.
struct Parting<'a> {
    tape: &'a mut Tape,
    open: Open,
    body: Tape,
    captured: Vec<Node>,
    /// Destination of each operation, in the order in which they were recorded.
    places: Vec<Place>,
}

impl Parting<'_> {
    fn place(&self, node: Node) -> Place {
        node.index().checked_sub(self.open.begin).map_or(Place::Before(node), |k| self.places[k])
    }

    fn put(&mut self, operation: &Operation) {
        let own = self.open.carried..self.open.carried + self.open.len as u32;
        let operands: Vec<Node> = operation.operands().collect();
        let place = if let Operation::Carried(number) = operation
            && own.contains(number)
        {
            Place::Inside(self.body.add(Operation::Carried(number - own.start)))
        } else if operands.iter().any(|&node| matches!(self.place(node), Place::Inside(_))) {
            let moved: HashMap<Node, Node> = operands.into_iter().map(|node| (node, self.inside(node))).collect();
            Place::Inside(self.body.add(operation.over(|node| moved[&node])))
        } else {
            let moved = operation.over(|node| match self.place(node) {
                Place::Before(node) | Place::Inside(node) => node,
            });
            Place::Before(self.tape.add(moved))
        };
        self.places.push(place);
    }

    /// A number as the body reads it.
    fn inside(&mut self, node: Node) -> Node {
        let before = match self.place(node) {
            Place::Inside(node) => return node,
            Place::Before(node) => node,
        };
        if let Some(value) = self.tape.constant(before) {
            return self.body.add(Operation::Constant(value.to_bits()));
        }
        let known = self.captured.iter().position(|&node| node == before);
        let number = known.unwrap_or_else(|| {
            self.captured.push(before);
            self.captured.len() - 1
        });
        self.body.add(Operation::Carried((self.open.len + number) as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::{Recorded, on_tape};
    use super::*;
    use crate::scalar::Scalar;

    /// The values of what a function records of some numbers, and the tape with its results.
    fn recorded<const N: usize>(
        numbers: [f64; N],
        record: impl FnOnce([Recorded; N]) -> Vec<Recorded>,
    ) -> (Vec<f64>, Vec<Recorded>, Tape) {
        let leaf = |place: usize| Recorded::of(Operation::Leaf(Leaf::Real(place as u32)));
        let (results, tape) = on_tape(0, || record(std::array::from_fn(leaf)));
        let of = |leaf: Leaf| if let Leaf::Real(place) = leaf { numbers[place as usize] } else { f64::NAN };
        let values = values(tape.operations(), &of, &|_| f64::NAN);
        let found = results.iter().map(|result| values[result.node().index()]).collect();
        (found, results, tape)
    }

    fn iterations(tape: &Tape) -> Vec<&Body> {
        let bodies = tape.operations().iter().map(|operation| match operation {
            Operation::Iterate { body, .. } => Some(body.as_ref()),
            _ => None,
        });
        bodies.flatten().collect()
    }

    /// √a b by Newton's method.
    fn root<S: Scalar>(a: S, b: S) -> S {
        let mut state = [S::from(1.0), S::from(f64::INFINITY)];
        let moves = |state: &[S]| state[1].above(state[0] * 1e-12);
        S::iterate(&mut state, 50, moves, |state| {
            let next = (state[0] + a * b / state[0]) * 0.5;
            (state[1], state[0]) = ((next - state[0]).abs(), next);
        });
        state[0]
    }

    /// Σ j!, by an iteration within an iteration that reads the state of the outer one.
    fn factorials<S: Scalar>(last: S) -> S {
        let mut outer = [S::from(1.0), S::from(0.0)];
        S::iterate(
            &mut outer,
            100,
            |state| state[0].at_most(last),
            |state| {
                let mut inner = [S::from(1.0), S::from(1.0)];
                let up_to = state[0];
                S::iterate(
                    &mut inner,
                    100,
                    |inner| inner[1].below(up_to),
                    |inner| {
                        inner[1] += 1.0;
                        inner[0] *= inner[1] + last * 0.0;
                    },
                );
                state[0] += 1.0;
                state[1] += inner[0];
            },
        );
        outer[1]
    }

    #[test]
    fn an_iteration_reaches_what_numbers_reach() {
        for (a, b) in [(1.0, 1.0), (2.0, 3.0), (1e6, 1e-9), (0.0, 1.0), (f64::NAN, 1.0)] {
            let (found, ..) = recorded([a, b], |[a, b]| vec![root(a, b)]);
            assert_eq!(found[0].to_bits(), root(a, b).to_bits(), "{a}, {b}");
        }
    }

    #[test]
    fn its_body_is_recorded_once_and_what_does_not_change_in_it_is_computed_before() {
        let (_, results, tape) = recorded([2.0, 3.0], |[a, b]| vec![root(a, b), root(a, b)]);
        assert_eq!(results[0].node(), results[1].node(), "the same iteration is shared");
        let bodies = iterations(&tape);
        assert_eq!(bodies.len(), 1);
        let products = |operations: &[Operation]| {
            let is_product = |one: &&Operation| matches!(one, Operation::Binary(super::super::Binary::Mul, ..));
            operations.iter().filter(is_product).count()
        };
        assert_eq!((products(tape.operations()), products(&bodies[0].operations)), (1, 2), "{tape:?}");
        assert!(!tape.operations().iter().any(|one| matches!(one, Operation::Carried(_))), "{tape:?}");
        let of = tape.dependence(&[results[0].node()], |_| true);
        assert_eq!(of, [[Leaf::Real(0), Leaf::Real(1)]]);
    }

    #[test]
    fn iterations_may_be_nested() {
        for last in [0.0, 1.0, 4.0, 6.0] {
            let (found, _, tape) = recorded([last], |[last]| vec![factorials(last)]);
            assert_eq!(found[0], factorials(last));
            let [outer] = iterations(&tape)[..] else { panic!("{tape:?}") };
            assert_eq!(outer.operations.iter().filter(|one| matches!(one, Operation::Iterate { .. })).count(), 1);
        }
        assert_eq!(factorials(4.0), 33.0);
    }

    #[test]
    fn an_iteration_of_known_numbers_is_carried_out_at_once() {
        let (found, _, tape) = recorded([], |[]| vec![root(2.0.into(), 8.0.into()), factorials(4.0.into())]);
        assert_eq!((found, iterations(&tape).len()), (vec![4.0, 33.0], 0));
    }
}
