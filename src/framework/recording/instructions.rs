//! Operations as instructions over registers: a recording that is carried out again and again, without taking memory.

use std::collections::HashMap;

use super::iteration::Body;
use super::node::{Recorded, on_tape};
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
}

/// An iteration. Its registers lie together: the state, what it reads beside that, and what its instructions write.
#[derive(Debug, Clone)]
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
        let (instructions, places) = writer.write(tape.operations(), &needed, |place, _| given[&place]);
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
        for instruction in instructions {
            let of = |register: Register| r[register as usize];
            r[to] = match *instruction {
                Instruction::Add(a, b) => of(a) + of(b),
                Instruction::Sub(a, b) => of(a) - of(b),
                Instruction::Mul(a, b) => of(a) * of(b),
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

    /// The instructions of the operations that are needed, and the register of each operation; those of what is given are
    /// found by a function.
    fn write(
        &mut self,
        operations: &[Operation],
        needed: &[bool],
        given: impl Fn(usize, &Operation) -> Register,
    ) -> (Vec<Instruction>, Vec<Register>) {
        let results: usize = (0..operations.len()).filter(|&k| needed[k]).map(|k| written(&operations[k])).sum();
        let mut to = self.take(results) as Register;
        let (mut instructions, mut places) = (Vec::with_capacity(results), vec![0; operations.len()]);
        for (place, operation) in operations.iter().enumerate().filter(|(place, _)| needed[*place]) {
            let of = |node: &Node| places[node.index()];
            places[place] = match operation {
                Operation::Constant(bits) => self.known[bits],
                Operation::Leaf(_) | Operation::Carried(_) => given(place, operation),
                Operation::Part(iteration, number) => of(iteration) + number,
                _ => {
                    let own = to;
                    to += written(operation) as Register;
                    instructions.push(self.instruction(operation, of));
                    own
                }
            };
        }
        (instructions, places)
    }

    fn instruction(&mut self, operation: &Operation, of: impl Fn(&Node) -> Register) -> Instruction {
        match operation {
            Operation::Unary(Unary::Neg, a) => Instruction::Neg(of(a)),
            Operation::Unary(function, a) => Instruction::Unary(*function, of(a)),
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
            Operation::Iterate { body, most, start, captured } => {
                let all = |nodes: &[Node]| nodes.iter().map(&of).collect();
                let number = self.iteration(body, *most, all(start), all(captured));
                Instruction::Iterate(number)
            }
            Operation::Constant(_) | Operation::Leaf(_) | Operation::Carried(_) | Operation::Part(..) => {
                unreachable!("it has a register")
            }
        }
    }

    /// Writes a loop: its number.
    fn iteration(&mut self, body: &Body, most: usize, start: Vec<Register>, captured: Vec<Register>) -> u32 {
        let scratch = self.take(start.len());
        let state = self.take(start.len() + captured.len());
        let needed = vec![true; body.operations.len()];
        let carried = |_, operation: &Operation| match operation {
            Operation::Carried(number) => state as Register + number,
            _ => unreachable!("the body of an iteration reads what it carries alone"),
        };
        let (instructions, places) = self.write(&body.operations, &needed, carried);
        let of = |node: &Node| places[node.index()];
        let (goes_on, next) = (of(&body.goes_on), body.next.iter().map(of).collect());
        self.loops.push(Loop { most, start, captured, state, instructions, goes_on, next, scratch });
        self.loops.len() as u32 - 1
    }
}

/// How many registers an operation writes.
fn written(operation: &Operation) -> usize {
    match operation {
        Operation::Constant(_) | Operation::Leaf(_) | Operation::Carried(_) | Operation::Part(..) => 0,
        Operation::Iterate { start, .. } => start.len(),
        _ => 1,
    }
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
