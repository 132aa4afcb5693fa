//! The list of recorded operations.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::iteration::Body;
use crate::error::Invalid;
use crate::scalar::{Opaque, wrapped};

/// An operation's place on its tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Node(pub(super) u32);

impl Node {
    /// The operation at a place of its tape.
    pub(crate) fn at(place: usize) -> Self {
        Node(place as u32)
    }

    /// Its place among all operations.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A given number, with which a recording begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Leaf {
    /// Time.
    Time,
    /// Length of the communication step that was completed.
    Step,
    /// A real value, by its place in the block.
    Real(u32),
    /// An integer, by its place in the block.
    Integer(u32),
    /// True if an event indicator has changed sides.
    Crossed(u32),
    /// The change of time, in a direction in which derivatives are taken.
    TimeChange,
    /// The change of a real value, by its place in the block.
    Change(u32),
    /// The rate of a real input, by its number.
    Slope(u32),
}

/// A function of one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)] // each has the name of its function
pub enum Unary {
    Neg,
    Sin,
    Cos,
    Tan,
    Cosh,
    Sinh,
    Tanh,
    Exp,
    Ln,
    Ln1p,
    Sqrt,
    Atan,
    Recip,
    Abs,
    Signum,
    Floor,
    Round,
    Wrap,
}

/// An operation on two numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)] // each has the name of its operation
pub enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
}

/// A comparison of two numbers; where one is no number, none holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)] // each has the name of its comparison
pub enum Comparison {
    Below,
    AtMost,
    Equals,
}

/// An operation. Conditions and integers are numbers too: 1 and 0, and whole numbers.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Operation {
    /// A number, by its bits.
    Constant(u64),
    /// A given number.
    Leaf(Leaf),
    /// A function of one number.
    Unary(Unary, Node),
    /// A function of two numbers.
    Binary(Binary, Node, Node),
    /// A power with a whole exponent.
    Powi(Node, i32),
    /// A power, its exponent by its bits.
    Powf(Node, u64),
    /// A comparison.
    Compare(Comparison, Node, Node),
    /// True if a condition doesn't hold.
    Not(Node),
    /// True if both conditions hold.
    And(Node, Node),
    /// True if one condition holds.
    Or(Node, Node),
    /// The second where the first holds, else the third.
    Select(Node, Node, Node),
    /// A function that is called as it is.
    Opaque(Opaque, Vec<Node>),
    /// A step that is carried out on a state again and again; the state that it reaches is read by [`Operation::Part`].
    Iterate {
        /// The step, and whether it goes on.
        body: Arc<Body>,
        /// The most steps.
        most: usize,
        /// The state at the start.
        start: Vec<Node>,
        /// Other numbers that the body reads, in addition to the state.
        captured: Vec<Node>,
    },
    /// A number of the state that an iteration reaches.
    Part(Node, u32),
    /// A number of the state, or one of the other numbers behind these, in the body of an iteration.
    Carried(u32),
}

impl Operation {
    /// Its operands.
    pub fn operands(&self) -> impl Iterator<Item = Node> + use<'_> {
        let few = |nodes: [Option<Node>; 3]| (nodes, [&[][..]; 2]);
        let (few, many) = match self {
            Operation::Constant(_) | Operation::Leaf(_) | Operation::Carried(_) => few([None; 3]),
            Operation::Unary(_, a)
            | Operation::Powi(a, _)
            | Operation::Powf(a, _)
            | Operation::Not(a)
            | Operation::Part(a, _) => few([Some(*a), None, None]),
            Operation::Binary(_, a, b) | Operation::Compare(_, a, b) | Operation::And(a, b) | Operation::Or(a, b) => {
                few([Some(*a), Some(*b), None])
            }
            Operation::Select(a, b, c) => few([Some(*a), Some(*b), Some(*c)]),
            Operation::Opaque(_, arguments) => ([None; 3], [&arguments[..], &[]]),
            Operation::Iterate { start, captured, .. } => ([None; 3], [&start[..], captured]),
        };
        few.into_iter().flatten().chain(many.into_iter().flatten().copied())
    }

    /// True if it isn't defined for every number, or its result may be none.
    pub(super) fn is_partial(&self) -> bool {
        match self {
            Operation::Unary(function, _) => matches!(
                function,
                Unary::Tan
                    | Unary::Cosh
                    | Unary::Sinh
                    | Unary::Exp
                    | Unary::Ln
                    | Unary::Ln1p
                    | Unary::Sqrt
                    | Unary::Recip
            ),
            Operation::Binary(operation, ..) => matches!(operation, Binary::Div | Binary::Pow),
            Operation::Powi(_, exponent) => ![1, 2].contains(exponent),
            Operation::Powf(..) | Operation::Opaque(..) | Operation::Iterate { .. } => true,
            _ => false,
        }
    }

    /// The same of other operands.
    pub(crate) fn over(&self, of: impl Fn(Node) -> Node) -> Operation {
        let all = |nodes: &[Node]| nodes.iter().map(|&node| of(node)).collect();
        match self {
            Operation::Constant(_) | Operation::Leaf(_) | Operation::Carried(_) => self.clone(),
            Operation::Unary(function, a) => Operation::Unary(*function, of(*a)),
            Operation::Binary(operation, a, b) => Operation::Binary(*operation, of(*a), of(*b)),
            Operation::Powi(a, exponent) => Operation::Powi(of(*a), *exponent),
            Operation::Powf(a, exponent) => Operation::Powf(of(*a), *exponent),
            Operation::Compare(comparison, a, b) => Operation::Compare(*comparison, of(*a), of(*b)),
            Operation::Not(a) => Operation::Not(of(*a)),
            Operation::And(a, b) => Operation::And(of(*a), of(*b)),
            Operation::Or(a, b) => Operation::Or(of(*a), of(*b)),
            Operation::Select(a, b, c) => Operation::Select(of(*a), of(*b), of(*c)),
            Operation::Opaque(function, arguments) => Operation::Opaque(*function, all(arguments)),
            Operation::Iterate { body, most, start, captured } => {
                Operation::Iterate { body: body.clone(), most: *most, start: all(start), captured: all(captured) }
            }
            Operation::Part(a, number) => Operation::Part(of(*a), *number),
        }
    }

    /// Its value, where those of its operands are found by a function; nothing for what is given, and for iterations.
    #[inline]
    pub fn value(&self, of: impl Fn(Node) -> f64) -> Option<f64> {
        let flag = |holds: bool| f64::from(u8::from(holds));
        Some(match self {
            Operation::Constant(bits) => f64::from_bits(*bits),
            Operation::Leaf(_) | Operation::Iterate { .. } | Operation::Part(..) | Operation::Carried(_) => {
                return None;
            }
            Operation::Unary(function, a) => function.of(of(*a)),
            Operation::Binary(operation, a, b) => operation.of(of(*a), of(*b)),
            Operation::Powi(a, exponent) => of(*a).powi(*exponent),
            Operation::Powf(a, bits) => of(*a).powf(f64::from_bits(*bits)),
            Operation::Compare(comparison, a, b) => flag(comparison.holds(of(*a), of(*b))),
            Operation::Not(a) => flag(of(*a) == 0.0),
            Operation::And(a, b) => flag(of(*a) != 0.0 && of(*b) != 0.0),
            Operation::Or(a, b) => flag(of(*a) != 0.0 || of(*b) != 0.0),
            Operation::Select(condition, yes, no) => of(if of(*condition) != 0.0 { *yes } else { *no }),
            Operation::Opaque(function, arguments) => function.of(arguments.iter().map(|&argument| of(argument))),
        })
    }
}

impl Unary {
    /// Its value, by the function that equations over numbers call.
    pub fn of(self, x: f64) -> f64 {
        match self {
            Unary::Neg => -x,
            Unary::Sin => x.sin(),
            Unary::Cos => x.cos(),
            Unary::Tan => x.tan(),
            Unary::Cosh => x.cosh(),
            Unary::Sinh => x.sinh(),
            Unary::Tanh => x.tanh(),
            Unary::Exp => x.exp(),
            Unary::Ln => x.ln(),
            Unary::Ln1p => x.ln_1p(),
            Unary::Sqrt => x.sqrt(),
            Unary::Atan => x.atan(),
            Unary::Recip => x.recip(),
            Unary::Abs => x.abs(),
            Unary::Signum => x.signum(),
            Unary::Floor => x.floor(),
            Unary::Round => x.round(),
            Unary::Wrap => wrapped(x),
        }
    }
}

impl Binary {
    /// Its value.
    pub fn of(self, a: f64, b: f64) -> f64 {
        match self {
            Binary::Add => a + b,
            Binary::Sub => a - b,
            Binary::Mul => a * b,
            Binary::Div => a / b,
            Binary::Pow => a.powf(b),
        }
    }
}

impl Comparison {
    /// True if it holds.
    pub fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Comparison::Below => a < b,
            Comparison::AtMost => a <= b,
            Comparison::Equals => a == b,
        }
    }
}

/// A message or refusal under a condition.
#[derive(Debug, Clone)]
pub enum Note {
    /// A message of a category.
    Message {
        /// Condition of the message.
        condition: Node,
        /// Its log category.
        category: &'static str,
        /// The text, with references to nodes and variables in it.
        text: String,
    },
    /// Reason why a start or a point is refused.
    Refusal {
        /// Condition of the refusal.
        condition: Node,
        /// The reasons, with references to nodes and variables in them.
        reason: Invalid,
    },
}

impl Note {
    /// Condition of the message or refusal.
    pub fn condition(&self) -> Node {
        match self {
            Note::Message { condition, .. } | Note::Refusal { condition, .. } => *condition,
        }
    }

    /// The same where its condition has moved; numbers in its text have not.
    pub(super) fn moved(&self, to: &dyn Fn(Node) -> Node) -> Note {
        let mut note = self.clone();
        match &mut note {
            Note::Message { condition, .. } | Note::Refusal { condition, .. } => *condition = to(*condition),
        }
        note
    }
}

/// Hashes operations with one multiplication per number. The standard library's hash protects against maliciously
/// chosen keys, which don't occur here, and would take most of the time of a recording.
#[derive(Debug, Default, Clone)]
pub(super) struct Mixed(u64);

impl Mixed {
    fn mix(&mut self, word: u64) {
        // Odd, and with about as many ones as zeros: 2⁶⁴ by the golden ratio.
        self.0 = (self.0.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

impl Hasher for Mixed {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.mix(byte.into()));
    }
    fn write_u32(&mut self, word: u32) {
        self.mix(word.into());
    }
    fn write_u64(&mut self, word: u64) {
        self.mix(word);
    }
    fn write_i32(&mut self, word: i32) {
        self.mix(word as u64);
    }
    fn write_usize(&mut self, word: usize) {
        self.mix(word as u64);
    }
    fn write_isize(&mut self, word: isize) {
        self.mix(word as u64);
    }
    fn finish(&self) -> u64 {
        // A product's low bits know nothing of the high ones of its factors; tables look at both ends.
        self.0 ^ self.0 >> 32
    }
}

/// A list of operations.
#[derive(Debug, Default, Clone)]
pub struct Tape {
    pub(super) operations: Vec<Operation>,
    pub(super) known: HashMap<Operation, Node, BuildHasherDefault<Mixed>>,
    pub(super) notes: Vec<Note>,
    /// Number of carried numbers of the iterations that are being recorded.
    pub(super) carried: u32,
    /// True if equations looked at a number that isn't known before it is given.
    pub(super) looked: bool,
    /// Conditions of the changes that are being recorded.
    pub(super) conditions: Vec<Node>,
}

impl Tape {
    /// All operations, in an order in which each comes after its operands.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// One of them.
    pub fn operation(&self, node: Node) -> &Operation {
        &self.operations[node.index()]
    }

    /// True if equations looked at a number, by `==`: what they do at other numbers wasn't recorded.
    pub fn has_looked(&self) -> bool {
        self.looked
    }

    /// Messages and refusals.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// The tape for evaluation with other operations in some places. Nothing can be added.
    pub(crate) fn with(&self, others: impl IntoIterator<Item = (Node, Operation)>) -> Tape {
        let mut operations = self.operations.clone();
        others.into_iter().for_each(|(node, operation)| operations[node.index()] = operation);
        Tape { operations, notes: self.notes.clone(), ..Tape::default() }
    }

    /// The tape for evaluation where the results of some operations are given, as carried numbers in this order.
    pub(crate) fn with_given(&self, nodes: &[Node]) -> Tape {
        self.with((0..).zip(nodes).map(|(number, node)| (*node, Operation::Carried(number))))
    }

    /// Reserves memory for this number of operations.
    pub(super) fn reserve(&mut self, operations: usize) {
        self.operations.reserve(operations);
        self.known.reserve(operations);
    }

    /// The number that a node is, where it is known.
    pub fn constant(&self, node: Node) -> Option<f64> {
        match self.operation(node) {
            Operation::Constant(bits) => Some(f64::from_bits(*bits)),
            _ => None,
        }
    }

    /// Adds an operation, unless it is there already or its value is known.
    pub(super) fn add(&mut self, operation: Operation) -> Node {
        let operation = self.folded(operation);
        let operation = match operation {
            Folded::Same(node) => return node,
            Folded::Operation(operation) => operation,
        };
        match self.known.entry(operation) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(unknown) => {
                let node = Node(u32::try_from(self.operations.len()).expect("a recording is smaller than 4 GB"));
                self.operations.push(unknown.key().clone());
                *unknown.insert(node)
            }
        }
    }

    /// Simplifies an operation on constants. No number is changed by it, a zero's sign included.
    fn folded(&self, operation: Operation) -> Folded {
        if let Operation::Select(condition, yes, no) = operation {
            if let Some(known) = self.constant(condition) {
                return Folded::Same(if known != 0.0 { yes } else { no });
            }
            if yes == no {
                return Folded::Same(yes);
            }
        }
        // A condition with a known part.
        if let Operation::And(a, b) | Operation::Or(a, b) = operation {
            let neutral = if matches!(operation, Operation::And(..)) { 1.0 } else { 0.0 };
            for (one, other) in [(a, b), (b, a)] {
                match self.constant(one) {
                    Some(known) if known == neutral => return Folded::Same(other),
                    Some(_) => return Folded::Same(one),
                    None => {}
                }
            }
        }
        if let Some(same) = self.unchanged(&operation) {
            return Folded::Same(same);
        }
        let is_known = operation.operands().all(|operand| self.constant(operand).is_some());
        let value = if is_known { operation.value(|node| self.constant(node).unwrap_or(f64::NAN)) } else { None };
        Folded::Operation(value.map_or(operation, |value| Operation::Constant(value.to_bits())))
    }

    /// The operand that an operation leaves as it is, whatever that is: a product with 1, a quotient by 1, less 0.
    fn unchanged(&self, operation: &Operation) -> Option<Node> {
        let is = |node: Node, value: f64| self.constant(node).is_some_and(|known| known.to_bits() == value.to_bits());
        match *operation {
            Operation::Binary(Binary::Mul, a, b) if is(a, 1.0) => Some(b),
            Operation::Binary(Binary::Mul | Binary::Div, a, b) if is(b, 1.0) => Some(a),
            Operation::Binary(Binary::Sub, a, b) if is(b, 0.0) => Some(a),
            _ => None,
        }
    }
}

enum Folded {
    Same(Node),
    Operation(Operation),
}
