//! Operations as instructions over registers: a recording that is carried out again and again, without taking memory.

use std::collections::HashMap;

use super::guard::{Guard, guards};
use super::iteration::Body;
use super::node::{Recorded, on_tape};
use super::tangent::needed;
use super::tape::{Binary, Comparison, Leaf, Node, Operation, Tape, Unary};
use crate::scalar::Opaque;

/// A number's place among the registers.
type Register = u32;

/// What an instruction writes goes to the register behind that of the one before.
#[derive(Debug, Clone, Copy)]
enum Instruction {
    // What most instructions are has no second table to go through.
    Add(Register, Register),
    Sub(Register, Register),
    Mul(Register, Register),
    /// A product, and a third number behind it: rounded twice, as two instructions would.
    MulAdd(Register, Register, Register),
    MulSub(Register, Register, Register),
    SubMul(Register, Register, Register),
    Div(Register, Register),
    Neg(Register),
    Power(Register, Register),
    Unary(Unary, Register),
    Powi(Register, i32),
    Compare(Comparison, Register, Register),
    Not(Register),
    And(Register, Register),
    Or(Register, Register),
    Select(Register, Register, Register),
    Opaque(Opaque, [Register; 3]),
    /// Writes the state that a loop reaches.
    Iterate(u32),
    /// Where this is 0, the next instruction isn't needed: it would have no number, perhaps, and writes 0.
    Where(Register),
}

/// An iteration. Its registers lie together: the state, what it reads beside that, and what its instructions write.
#[derive(Debug, Clone, Default)]
struct Loop {
    most: usize,
    start: Vec<Register>,
    captured: Vec<Register>,
    state: usize,
    instructions: Vec<Instruction>,
    goes_on: Register,
    next: Vec<Register>,
    /// Where the next state is put together.
    scratch: usize,
}

/// The instructions that some operations of a tape need, and where their values are then.
#[derive(Debug, Clone, Default)]
pub struct Instructions {
    constants: Vec<f64>,
    leaves: Vec<Leaf>,
    instructions: Vec<Instruction>,
    loops: Vec<Loop>,
    results: Vec<Register>,
    /// How many registers there are: constants, leaves, and what is written.
    registers: usize,
}

/// Registers of instructions, which these put in order when they are first carried out.
pub type Registers = Vec<f64>;

impl Instructions {
    /// Those that compute the wanted operations.
    pub fn of(tape: &Tape, wanted: &[Node]) -> Self {
        let mut writer = Writer::default();
        let needed = tape.needed(wanted);
        // What is there before comes first, wherever it stands.
        writer.constants(tape.operations(), &needed);
        let is_leaf = |(place, operation): (usize, &Operation)| match operation {
            Operation::Leaf(leaf) if needed[place] => Some((place, *leaf)),
            _ => None,
        };
        let leaves: Vec<(usize, Leaf)> = tape.operations().iter().enumerate().filter_map(is_leaf).collect();
        let first_leaf = writer.take(leaves.len());
        let given: HashMap<usize, Register> =
            leaves.iter().zip(first_leaf as Register..).map(|(&(place, _), register)| (place, register)).collect();
        let unconditional: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
        let (instructions, places) = writer.write(tape.operations(), &unconditional, &|place, _| given[&place]);
        Instructions {
            leaves: leaves.into_iter().map(|(_, leaf)| leaf).collect(),
            instructions,
            results: wanted.iter().map(|node| places[node.index()]).collect(),
            constants: writer.constants,
            loops: writer.loops,
            registers: writer.registers,
        }
    }

    /// How many registers they need.
    pub fn registers(&self) -> usize {
        self.registers
    }

    /// The values of the wanted operations, where those of leaves are found by a function.
    pub fn carry_out<'a>(
        &'a self,
        leaf: impl Fn(Leaf) -> f64,
        registers: &'a mut Registers,
    ) -> impl ExactSizeIterator<Item = f64> + 'a {
        if registers.len() != self.registers {
            registers.clear();
            registers.resize(self.registers, 0.0);
            registers[..self.constants.len()].copy_from_slice(&self.constants);
        }
        let given = &mut registers[self.constants.len()..];
        given.iter_mut().zip(&self.leaves).for_each(|(register, &which)| *register = leaf(which));
        self.run(&self.instructions, self.constants.len() + self.leaves.len(), registers);
        let registers = &*registers;
        self.results.iter().map(move |&register| registers[register as usize])
    }

    /// Carries instructions out, whose results go to registers from the first on.
    fn run(&self, instructions: &[Instruction], first: usize, r: &mut [f64]) {
        let mut to = first;
        let flag = |holds: bool| f64::from(u8::from(holds));
        let mut instructions = instructions.iter();
        while let Some(instruction) = instructions.next() {
            let of = |register: Register| r[register as usize];
            r[to] = match *instruction {
                Instruction::Add(a, b) => of(a) + of(b),
                Instruction::Sub(a, b) => of(a) - of(b),
                Instruction::Mul(a, b) => of(a) * of(b),
                Instruction::MulAdd(a, b, c) => of(a) * of(b) + of(c),
                Instruction::MulSub(a, b, c) => of(a) * of(b) - of(c),
                Instruction::SubMul(a, b, c) => of(c) - of(a) * of(b),
                Instruction::Div(a, b) => of(a) / of(b),
                Instruction::Neg(a) => -of(a),
                Instruction::Power(a, b) => Binary::Pow.of(of(a), of(b)),
                Instruction::Unary(function, a) => function.of(of(a)),
                Instruction::Powi(a, exponent) => of(a).powi(exponent),
                Instruction::Compare(comparison, a, b) => flag(comparison.holds(of(a), of(b))),
                Instruction::Not(a) => flag(of(a) == 0.0),
                Instruction::And(a, b) => flag(of(a) != 0.0 && of(b) != 0.0),
                Instruction::Or(a, b) => flag(of(a) != 0.0 || of(b) != 0.0),
                Instruction::Select(condition, yes, no) => of(if of(condition) != 0.0 { yes } else { no }),
                Instruction::Opaque(function, arguments) => function.of(arguments.into_iter().map(of)),
                Instruction::Iterate(number) => {
                    to += self.iterate(&self.loops[number as usize], to, r);
                    continue;
                }
                Instruction::Where(condition) if of(condition) != 0.0 => continue,
                Instruction::Where(_) => {
                    let count = match instructions.next() {
                        Some(Instruction::Iterate(number)) => self.loops[*number as usize].start.len(),
                        _ => 1,
                    };
                    r[to..to + count].fill(0.0);
                    to += count;
                    continue;
                }
            };
            to += 1;
        }
    }

    /// Carries a loop out, and writes the state that it reaches; how many numbers that are.
    fn iterate(&self, body: &Loop, to: usize, r: &mut [f64]) -> usize {
        let (len, state) = (body.start.len(), body.state);
        for (k, &register) in body.start.iter().chain(&body.captured).enumerate() {
            r[state + k] = r[register as usize];
        }
        for _ in 0..body.most {
            self.run(&body.instructions, state + len + body.captured.len(), r);
            if r[body.goes_on as usize] == 0.0 {
                break;
            }
            for (k, &register) in body.next.iter().enumerate() {
                r[body.scratch + k] = r[register as usize];
            }
            r.copy_within(body.scratch..body.scratch + len, state);
        }
        r.copy_within(state..state + len, to);
        len
    }
}

/// What instructions are put together in.
#[derive(Debug, Default)]
struct Writer {
    constants: Vec<f64>,
    /// Their registers, by their bits.
    known: HashMap<u64, Register>,
    loops: Vec<Loop>,
    registers: usize,
}

impl Writer {
    /// Takes so many registers: the first of them.
    fn take(&mut self, count: usize) -> usize {
        let first = self.registers;
        self.registers += count;
        first
    }

    /// Takes registers for all constants of the operations that are needed, and of iterations among them.
    fn constants(&mut self, operations: &[Operation], needed: &[bool]) {
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
    fn write(
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
            _ => unreachable!("the body of an iteration reads what it carries alone"),
        };
        let next = body.next.iter().map(|&node| (node, Some(body.goes_on)));
        let wanted: Vec<_> = std::iter::once((body.goes_on, None)).chain(next).collect();
        let (instructions, places) = self.write(&body.operations, &wanted, &carried);
        let of = |node: &Node| places[node.index()];
        let (goes_on, next) = (of(&body.goes_on), body.next.iter().map(of).collect());
        Loop { most, start, captured, state, instructions, goes_on, next, scratch }
    }
}

/// How a guard is put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Joint {
    Not(Register),
    And(Register, Register),
    Or(Register, Register),
}

/// Instructions that are being written.
struct Scope<'a> {
    operations: &'a [Operation],
    guards: Vec<Guard>,
    given: &'a dyn Fn(usize, &Operation) -> Register,
    known: &'a HashMap<u64, Register>,
    /// Products that are computed within the sum that they are part of.
    within: Vec<bool>,
    places: Vec<Option<Register>>,
    /// Which operations are being computed.
    is_open: Vec<bool>,
    /// What guards are put together of: guards have much in common.
    joined: HashMap<Joint, Register>,
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

    /// Computes an operation behind its operands, unless that is done, or under way; whether it is done.
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
                    if operation.is_partial()
                        && let Some(guard) = self.guard(place)
                    {
                        self.instructions.push(Instruction::Where(guard));
                    }
                    let instruction = self.instruction(place);
                    let results = if let Operation::Iterate { start, .. } = operation { start.len() } else { 1 };
                    self.push(instruction, results)
                }
            };
            self.places[place] = Some(register);
        }
        self.is_open[place] = false;
        operands_are
    }

    /// Writes an instruction with so many results: where the first of them is.
    fn push(&mut self, instruction: Instruction, results: usize) -> Register {
        let own = self.to;
        self.to += results as Register;
        self.instructions.push(instruction);
        own
    }

    /// Where an operation is needed; nothing where that is always.
    fn guard(&mut self, place: usize) -> Option<Register> {
        let guard = self.guards[place].clone();
        let mut any = None;
        for term in guard.terms() {
            let mut all = None;
            for &(node, holds) in term {
                // What follows from the operation itself doesn't say where that is needed.
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

    /// Where a part of a guard is computed, once.
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

/// Products that one sum or difference alone uses, at most one each.
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

/// Values and derivatives of functions of a number, at one.
pub fn slopes<const N: usize>(functions: impl FnOnce(Recorded) -> [Recorded; N], x: f64) -> [(f64, f64); N] {
    let (found, mut tape) = on_tape(0, || functions(Recorded::of(Operation::Leaf(Leaf::Time))));
    let nodes = found.map(Recorded::node);
    let (zero, one) = (tape.number(0.0), tape.number(1.0));
    let slopes = tape.tangents(&nodes, |_| Some(one));
    let wanted: Vec<Node> = nodes.into_iter().chain(slopes.into_iter().map(|slope| slope.unwrap_or(zero))).collect();
    let numbers: Vec<f64> = Instructions::of(&tape, &wanted).carry_out(|_| x, &mut Registers::new()).collect();
    std::array::from_fn(|k| (numbers[k], numbers[N + k]))
}
