//! Operations as instructions over registers: a recording that is carried out again and again, without taking memory.

use std::collections::HashMap;

use super::node::{Recorded, on_tape};
use super::tape::{Binary, Comparison, Leaf, Node, Operation, Tape, Unary};
use super::writer::Writer;
use crate::scalar::Opaque;

/// A number's place among the registers.
pub(super) type Register = u32;

/// An instruction. Its result goes to the register after that of the instruction before.
#[derive(Debug, Clone, Copy)]
pub(super) enum Instruction {
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
    /// Skips the given number of instructions if the register is 0: they aren't needed, and some might have no number.
    /// Registers that they would write stay as they are.
    Where(Register, u32, Register),
}

/// An iteration. Its registers are contiguous: the state, the other operands, and the results of its instructions.
#[derive(Debug, Clone, Default)]
pub(super) struct Loop {
    pub(super) most: usize,
    pub(super) start: Vec<Register>,
    pub(super) captured: Vec<Register>,
    pub(super) state: usize,
    pub(super) instructions: Vec<Instruction>,
    pub(super) goes_on: Register,
    pub(super) next: Vec<Register>,
    /// First register of the next state.
    pub(super) scratch: usize,
}

/// The instructions that some operations of a tape need, and where their values are then.
#[derive(Debug, Clone, Default)]
pub struct Instructions {
    constants: Vec<f64>,
    leaves: Vec<Leaf>,
    instructions: Vec<Instruction>,
    loops: Vec<Loop>,
    results: Vec<Register>,
    /// Number of registers: constants, leaves, and results.
    registers: usize,
}

/// Registers of instructions, of any.
pub type Registers = Vec<f64>;

impl Instructions {
    /// Those that compute the wanted operations.
    pub fn of(tape: &Tape, wanted: &[Node]) -> Self {
        let mut writer = Writer::default();
        let needed = tape.needed(wanted);
        // Constants and leaves come first, wherever they are on the tape.
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

    /// Number of registers that they need.
    pub fn registers(&self) -> usize {
        self.registers
    }

    /// The values of the wanted operations, where those of leaves are found by a function.
    pub fn carry_out<'a>(
        &'a self,
        leaf: impl Fn(Leaf) -> f64,
        registers: &'a mut Registers,
    ) -> impl ExactSizeIterator<Item = f64> + 'a {
        registers.resize(self.registers, 0.0);
        // Others may have used them.
        registers[..self.constants.len()].copy_from_slice(&self.constants);
        let given = &mut registers[self.constants.len()..];
        given.iter_mut().zip(&self.leaves).for_each(|(register, &which)| *register = leaf(which));
        self.run(&self.instructions, self.constants.len() + self.leaves.len(), registers);
        let registers = &*registers;
        self.results.iter().map(move |&register| registers[register as usize])
    }

    /// The value of one of them, as it was found last.
    pub fn result(&self, number: usize, registers: &Registers) -> f64 {
        registers[self.results[number] as usize]
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
                Instruction::Where(condition, count, registers) => {
                    if of(condition) == 0.0 {
                        instructions = instructions.as_slice()[count as usize..].iter();
                        to += registers as usize;
                    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar::Scalar;

    #[test]
    fn instructions_that_share_registers_have_constants_of_their_own() {
        let instructions = |factor: f64| {
            let (found, tape) = on_tape(0, || Recorded::of(Operation::Leaf(Leaf::Time)) * factor);
            Instructions::of(&tape, &[found.node()])
        };
        let (double, triple) = (instructions(2.0), instructions(3.0));
        assert_eq!(double.registers(), triple.registers());
        let mut registers = Registers::new();
        for (of, factor) in [(&double, 2.0), (&triple, 3.0), (&double, 2.0)] {
            assert_eq!(of.carry_out(|_| 5.0, &mut registers).collect::<Vec<_>>(), [5.0 * factor]);
        }
    }

    /// Checks that operations behind a condition are skipped and computed again, whatever the registers contained
    /// before.
    #[test]
    fn what_a_condition_leaves_out_is_computed_when_it_holds_again() {
        let function = |x: Recorded| {
            let zero = Recorded::from(0.0);
            let below = x.below(zero);
            Recorded::branch(below, || (-x).sqrt() * 2.0 + x, || (x + 1.0).ln() / x + x.sqrt() * x - x / (x + 3.0))
        };
        let (found, tape) = on_tape(0, || function(Recorded::of(Operation::Leaf(Leaf::Time))));
        let of = Instructions::of(&tape, &[found.node()]);
        assert!(of.instructions.iter().any(|one| matches!(one, Instruction::Where(..))));
        let mut registers = Registers::new();
        for x in [4.0, -9.0, 0.25, -1.0, f64::NAN, 7.0_f64] {
            let expected =
                if x < 0.0 { (-x).sqrt() * 2.0 + x } else { (x + 1.0).ln() / x + x.sqrt() * x - x / (x + 3.0) };
            let found = of.carry_out(|_| x, &mut registers).next().unwrap();
            assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(), "{x}: {found}");
        }
    }
}
