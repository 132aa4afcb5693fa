//! Instructions of operations. Those that only a condition needs follow that condition.

use std::collections::HashMap;
use std::rc::Rc;

use super::guard::{Guard, guards};
use super::instructions::{Instruction, Loop, Register};
use super::iteration::Body;
use super::tangent::needed;
use super::tape::{Binary, Node, Operation, Unary};

/// Constants, loops and registers of the instructions.
#[derive(Debug, Default)]
pub(super) struct Writer {
    pub(super) constants: Vec<f64>,
    /// Their registers, by their bits.
    known: HashMap<u64, Register>,
    pub(super) loops: Vec<Loop>,
    pub(super) registers: usize,
}

impl Writer {
    /// Takes `count` registers and returns the first of them.
    pub(super) fn take(&mut self, count: usize) -> usize {
        let first = self.registers;
        self.registers += count;
        first
    }

    /// Takes registers for all constants of the operations that are needed, and of iterations among them.
    pub(super) fn constants(&mut self, operations: &[Operation], needed: &[bool]) {
        for (operation, _) in operations.iter().zip(needed).filter(|(_, needed)| **needed) {
            match operation {
                Operation::Constant(bits) | Operation::Powf(_, bits) => self.constant(*bits),
                Operation::Iterate { body, .. } => self.constants(&body.operations, &vec![true; body.operations.len()]),
                _ => {}
            }
        }
    }

    fn constant(&mut self, bits: u64) {
        if !self.known.contains_key(&bits) {
            let register = self.take(1) as Register;
            self.known.insert(bits, register);
            self.constants.push(f64::from_bits(bits));
        }
    }

    /// The instructions that compute what is wanted, perhaps under a condition, and the registers of all operations; those of
    /// what is given are found by a function.
    pub(super) fn write(
        &mut self,
        operations: &[Operation],
        wanted: &[(Node, Option<Node>)],
        given: &dyn Fn(usize, &Operation) -> Register,
    ) -> (Vec<Instruction>, Vec<Register>) {
        let nodes: Vec<Node> = wanted.iter().flat_map(|&(node, condition)| [Some(node), condition]).flatten().collect();
        let needed = needed(operations, &nodes);
        let mut scope = Scope {
            operations,
            within: products(operations, &needed, &nodes),
            guards: guards(operations, &needed, wanted),
            given,
            known: &self.known,
            places: vec![None; operations.len()],
            is_open: vec![false; operations.len()],
            joined: HashMap::new(),
            part: None,
            instructions: Vec::new(),
            to: self.registers as Register,
            loops: Vec::new(),
            first_loop: self.loops.len(),
        };
        (0..operations.len()).filter(|&place| needed[place]).for_each(|place| _ = scope.computed(place));
        let Scope { places, instructions, to, loops, .. } = scope;
        self.registers = to as usize;
        // Loops have their registers behind those of what is around them.
        self.loops.extend(loops.iter().map(|_| Loop::default()));
        let first = self.loops.len() - loops.len();
        for (k, place) in loops.into_iter().enumerate() {
            let Operation::Iterate { body, most, start, captured } = &operations[place] else { continue };
            let of = |nodes: &[Node]| nodes.iter().map(|node| places[node.index()].unwrap_or_default()).collect();
            self.loops[first + k] = self.iteration(body, *most, of(start), of(captured));
        }
        (instructions, places.into_iter().map(Option::unwrap_or_default).collect())
    }

    fn iteration(&mut self, body: &Body, most: usize, start: Vec<Register>, captured: Vec<Register>) -> Loop {
        let scratch = self.take(start.len());
        let state = self.take(start.len() + captured.len());
        let carried = |_, operation: &Operation| match operation {
            Operation::Carried(number) => state as Register + number,
            _ => unreachable!("the body of an iteration reads carried numbers only"),
        };
        let next = body.next.iter().map(|&node| (node, Some(body.goes_on)));
        let wanted: Vec<_> = std::iter::once((body.goes_on, None)).chain(next).collect();
        let (instructions, places) = self.write(&body.operations, &wanted, &carried);
        let of = |node: &Node| places[node.index()];
        let (goes_on, next) = (of(&body.goes_on), body.next.iter().map(of).collect());
        Loop { most, start, captured, state, instructions, goes_on, next, scratch }
    }
}

/// Number of operations under one guard from which checking the guard pays.
const WORTH_A_GUARD: usize = 6;

/// Instructions that are needed under one guard, behind a [`Instruction::Where`].
struct Part {
    /// An operation of it.
    place: usize,
    begin: usize,
    end: usize,
}

/// A link of a guard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Joint {
    Not(Register),
    And(Register, Register),
    Or(Register, Register),
}

/// Instructions that are being written.
struct Scope<'a> {
    operations: &'a [Operation],
    guards: Vec<Rc<Guard>>,
    given: &'a dyn Fn(usize, &Operation) -> Register,
    known: &'a HashMap<u64, Register>,
    /// Products that are computed within the sum that they are part of.
    within: Vec<bool>,
    places: Vec<Option<Register>>,
    /// True for operations that are being computed.
    is_open: Vec<bool>,
    /// Registers of links: guards have much in common.
    joined: HashMap<Joint, Register>,
    /// The part that is being written of what is needed under one guard.
    part: Option<Part>,
    instructions: Vec<Instruction>,
    /// The register of the next result.
    to: Register,
    /// Operations that are loops.
    loops: Vec<usize>,
    first_loop: usize,
}

impl Scope<'_> {
    fn of(&self, node: &Node) -> Register {
        self.places[node.index()].unwrap_or_default()
    }

    /// Computes an operation after its operands, unless that is done or under way. Returns true if it is done.
    fn computed(&mut self, place: usize) -> bool {
        if self.places[place].is_some() || self.is_open[place] {
            return self.places[place].is_some();
        }
        self.is_open[place] = true;
        let operation = &self.operations[place];
        let operands_are = operation.operands().all(|operand| self.computed(operand.index()));
        if operands_are {
            let register = match operation {
                Operation::Constant(bits) => self.known[bits],
                Operation::Leaf(_) | Operation::Carried(_) => (self.given)(place, operation),
                Operation::Part(iteration, number) => self.of(iteration) + number,
                _ if self.within[place] => Register::MAX,
                _ => {
                    self.begin_part(place);
                    let instruction = self.instruction(place);
                    let results = if let Operation::Iterate { start, .. } = operation { start.len() } else { 1 };
                    let own = self.push(instruction, results);
                    self.extend_part(results);
                    own
                }
            };
            self.places[place] = Some(register);
        }
        self.is_open[place] = false;
        operands_are
    }

    /// Writes an instruction with this number of results and returns the first one's register.
    fn push(&mut self, instruction: Instruction, results: usize) -> Register {
        let own = self.to;
        self.to += results as Register;
        self.instructions.push(instruction);
        own
    }

    /// Begins a part behind its guard, where an operation isn't in the one before, nor always needed.
    fn begin_part(&mut self, place: usize) {
        let goes_on =
            |part: &Part| part.end == self.instructions.len() && self.guards[part.place] == self.guards[place];
        if self.part.as_ref().is_some_and(goes_on) {
            return;
        }
        let is_worth_it = self.operations[place].is_partial() || self.alike(place) >= WORTH_A_GUARD;
        let guard = if is_worth_it { self.guard(place) } else { None };
        self.part = guard.map(|guard| {
            let begin = self.instructions.len();
            self.instructions.push(Instruction::Where(guard, 0, 0));
            Part { place, begin, end: begin + 1 }
        });
    }

    /// Number of operations under the same guard, from one on.
    fn alike(&self, place: usize) -> usize {
        let behind = self.guards[place..].iter().take(WORTH_A_GUARD);
        behind.take_while(|guard| **guard == self.guards[place]).count()
    }

    /// Takes the last instruction into the part.
    fn extend_part(&mut self, results: usize) {
        let Some(part) = &mut self.part else { return };
        part.end += 1;
        if let Instruction::Where(_, count, registers) = &mut self.instructions[part.begin] {
            *count += 1;
            *registers += results as Register;
        }
    }

    /// Register of an operation's guard; none if it is always needed.
    fn guard(&mut self, place: usize) -> Option<Register> {
        let guard = Rc::clone(&self.guards[place]);
        let mut any = None;
        for term in guard.terms() {
            let mut all = None;
            for &(node, holds) in term {
                // Conditions that depend on the operation itself can't guard it.
                if self.computed(node.index()) {
                    let condition = self.of(&node);
                    let literal = if holds { condition } else { self.joined(Joint::Not(condition)) };
                    all = Some(all.map_or(literal, |all| self.joined(Joint::And(all, literal))));
                }
            }
            let all = all?;
            any = Some(any.map_or(all, |any| self.joined(Joint::Or(any, all))));
        }
        any
    }

    /// Register of a link, computed once.
    fn joined(&mut self, joint: Joint) -> Register {
        if let Some(register) = self.joined.get(&joint) {
            return *register;
        }
        let register = self.push(
            match joint {
                Joint::Not(a) => Instruction::Not(a),
                Joint::And(a, b) => Instruction::And(a, b),
                Joint::Or(a, b) => Instruction::Or(a, b),
            },
            1,
        );
        self.joined.insert(joint, register);
        register
    }

    fn instruction(&mut self, place: usize) -> Instruction {
        let of = |node: &Node| self.of(node);
        match &self.operations[place] {
            Operation::Unary(Unary::Neg, a) => Instruction::Neg(of(a)),
            Operation::Unary(function, a) => Instruction::Unary(*function, of(a)),
            Operation::Binary(operation @ (Binary::Add | Binary::Sub), a, b)
                if self.within[a.index()] || self.within[b.index()] =>
            {
                let (product, other) = if self.within[a.index()] { (a, of(b)) } else { (b, of(a)) };
                let Operation::Binary(_, x, y) = &self.operations[product.index()] else { unreachable!("a product") };
                let make = match operation {
                    Binary::Add => Instruction::MulAdd,
                    _ if product == a => Instruction::MulSub,
                    _ => Instruction::SubMul,
                };
                make(of(x), of(y), other)
            }
            Operation::Binary(operation, a, b) => {
                let make = match operation {
                    Binary::Add => Instruction::Add,
                    Binary::Sub => Instruction::Sub,
                    Binary::Mul => Instruction::Mul,
                    Binary::Div => Instruction::Div,
                    Binary::Pow => Instruction::Power,
                };
                make(of(a), of(b))
            }
            Operation::Powi(a, exponent) => Instruction::Powi(of(a), *exponent),
            Operation::Powf(a, exponent) => Instruction::Power(of(a), self.known[exponent]),
            Operation::Compare(comparison, a, b) => Instruction::Compare(*comparison, of(a), of(b)),
            Operation::Not(a) => Instruction::Not(of(a)),
            Operation::And(a, b) => Instruction::And(of(a), of(b)),
            Operation::Or(a, b) => Instruction::Or(of(a), of(b)),
            Operation::Select(condition, yes, no) => Instruction::Select(of(condition), of(yes), of(no)),
            Operation::Opaque(function, arguments) => {
                let [a, b, c] = &arguments[..] else { unreachable!("its functions have three arguments") };
                Instruction::Opaque(*function, [of(a), of(b), of(c)])
            }
            Operation::Iterate { .. } => {
                self.loops.push(place);
                Instruction::Iterate((self.first_loop + self.loops.len() - 1) as u32)
            }
            Operation::Constant(_) | Operation::Leaf(_) | Operation::Carried(_) | Operation::Part(..) => {
                unreachable!("it has a register")
            }
        }
    }
}

/// Products that only one sum or difference uses, at most one each.
fn products(operations: &[Operation], needed: &[bool], wanted: &[Node]) -> Vec<bool> {
    let mut uses = vec![0; operations.len()];
    wanted.iter().for_each(|node| uses[node.index()] += 1);
    let operands = operations.iter().zip(needed).filter(|(_, needed)| **needed).flat_map(|(one, _)| one.operands());
    operands.for_each(|operand| uses[operand.index()] += 1);
    let mut within = vec![false; operations.len()];
    for (operation, _) in operations.iter().zip(needed).filter(|(_, needed)| **needed) {
        if let Operation::Binary(Binary::Add | Binary::Sub, a, b) = operation {
            let alone = |node: &&Node| {
                uses[node.index()] == 1 && matches!(operations[node.index()], Operation::Binary(Binary::Mul, ..))
            };
            [a, b].into_iter().find(alone).into_iter().for_each(|node| within[node.index()] = true);
        }
    }
    within
}
