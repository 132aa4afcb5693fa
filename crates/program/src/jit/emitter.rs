//! Recorded operations for the compiler: the same arithmetic, in the same order, one operation each.
//!
//! Arguments and constants are fetched where they are used, so that they occupy no register in between.

use std::collections::HashMap;

use cranelift_codegen::cursor::{Cursor, FuncCursor};
use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::types::{F64, I32, I64};
use cranelift_codegen::ir::{AbiParam, BlockArg, Function, InstBuilder, MemFlags, SigRef, Signature, Type, Value};
use cranelift_codegen::isa::CallConv;

use crate::fmi2::kernel::{Callees, Write};
use crate::recording::{Binary, Body, Comparison, Leaf, Node, Operation, Unary, needed};

/// Arguments of a function: a number, and addresses of others.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Given {
    pub time: Option<Value>,
    pub reals: Option<Value>,
    pub integers: Option<Value>,
    /// Address of [`Leaf::Change`].
    pub changes: Option<Value>,
    /// Address of [`Leaf::Slope`].
    pub slopes: Option<Value>,
}

/// Results of a function: numbers of the tape, and their places.
pub(super) struct Written<'a> {
    /// Address from which places are counted.
    pub to: Value,
    /// Leaf that reads a place, if any.
    pub read: Option<fn(u32) -> Leaf>,
    pub writes: &'a [Write],
}

/// Value of an operation.
#[derive(Debug, Clone)]
enum Found {
    Nothing,
    Real(Value),
    Flag(Value),
    Given(Leaf),
    Constant(u64),
    /// The state that an iteration reaches.
    Reached(Vec<Value>),
}

/// Writes the operations of one function.
pub(super) struct Emitter<'a> {
    cursor: FuncCursor<'a>,
    callees: &'a Callees,
    pointer: Type,
    given: Given,
    /// Signatures of functions of one to three numbers.
    signatures: [SigRef; 3],
}

/// Result, or the reason why operations can't be written: they don't belong together.
type Answer<T = ()> = Result<T, String>;

impl<'a> Emitter<'a> {
    /// An emitter that writes at the cursor.
    pub fn new(
        cursor: FuncCursor<'a>,
        callees: &'a Callees,
        (pointer, convention): (Type, CallConv),
        given: Given,
    ) -> Self {
        let of = |function: &mut Function, arguments: usize| {
            let mut signature = Signature::new(convention);
            signature.params = vec![AbiParam::new(F64); arguments];
            signature.returns = vec![AbiParam::new(F64)];
            function.import_signature(signature)
        };
        let signatures = [1, 2, 3].map(|arguments| of(cursor.func, arguments));
        Emitter { cursor, callees, pointer, given, signatures }
    }

    /// Computes and writes; returns the value of a condition, if one is given.
    pub fn write(mut self, operations: &[Operation], written: &[Written], condition: Option<Node>) -> Answer {
        let wanted =
            written.iter().flat_map(|to| to.writes).map(|(_, node)| *node).chain(condition).collect::<Vec<_>>();
        if wanted.iter().any(|node| node.index() >= operations.len()) {
            return Err("a number that isn't there is wanted".to_owned());
        }
        let needed = needed(operations, &wanted);
        let mut pending = Pending::new(operations, &needed, written);
        let mut found = vec![Found::Nothing; operations.len()];
        for place in (0..operations.len()).filter(|&place| needed[place]) {
            found[place] = self.operation(&operations[place], &found, &[])?;
            if let (Operation::Leaf(leaf), true) = (&operations[place], pending.is_overwritten(&operations[place])) {
                found[place] = Found::Real(self.leaf(*leaf)?);
            }
            for (to, offset) in pending.at_once(place) {
                self.store(&found[place], to, offset)?;
            }
        }
        for (place, to, offset) in pending.at_last() {
            self.store(&found[place], to, offset)?;
        }
        let holds = condition.map(|node| self.flag(&found[node.index()])).transpose()?;
        let holds = holds.map(|holds| self.cursor.ins().uextend(I32, holds));
        self.cursor.ins().return_(holds.as_slice());
        Ok(())
    }

    fn store(&mut self, found: &Found, to: Value, offset: i32) -> Answer {
        let value = self.real(found)?;
        self.cursor.ins().store(MemFlags::trusted(), value, to, offset);
        Ok(())
    }

    fn leaf(&mut self, leaf: Leaf) -> Answer<Value> {
        let from = |base: Option<Value>| base.ok_or_else(|| format!("{leaf:?} isn't given"));
        let given = self.given;
        let real = |base: Value, place: u32, it: &mut Self| {
            it.cursor.ins().load(F64, MemFlags::trusted(), base, place as i32 * 8)
        };
        match leaf {
            Leaf::Time => from(given.time),
            Leaf::Real(place) => Ok(real(from(given.reals)?, place, self)),
            Leaf::Change(place) => Ok(real(from(given.changes)?, place, self)),
            Leaf::Slope(place) => Ok(real(from(given.slopes)?, place, self)),
            Leaf::Integer(place) => {
                let base = from(given.integers)?;
                let whole = self.cursor.ins().load(I32, MemFlags::trusted(), base, place as i32 * 4);
                Ok(self.cursor.ins().fcvt_from_sint(F64, whole))
            }
            Leaf::Step | Leaf::Crossed(_) | Leaf::TimeChange => from(None),
        }
    }

    fn real(&mut self, found: &Found) -> Answer<Value> {
        match found {
            Found::Real(value) => Ok(*value),
            Found::Given(leaf) => self.leaf(*leaf),
            Found::Constant(bits) => Ok(self.number(f64::from_bits(*bits))),
            Found::Flag(holds) => {
                let (yes, no) = (self.number(1.0), self.number(0.0));
                Ok(self.cursor.ins().select(*holds, yes, no))
            }
            Found::Nothing | Found::Reached(_) => Err("what isn't a number is used as one".to_owned()),
        }
    }

    fn flag(&mut self, found: &Found) -> Answer<Value> {
        if let Found::Flag(holds) = found {
            return Ok(*holds);
        }
        let (value, zero) = (self.real(found)?, self.number(0.0));
        Ok(self.cursor.ins().fcmp(FloatCC::NotEqual, value, zero))
    }

    fn number(&mut self, value: f64) -> Value {
        self.cursor.ins().f64const(value)
    }

    /// Writes an operation whose arguments, and values that an iteration carries, are known.
    fn operation(&mut self, operation: &Operation, found: &[Found], carried: &[Value]) -> Answer<Found> {
        let of = |node: &Node| found.get(node.index()).unwrap_or(&Found::Nothing);
        Ok(Found::Real(match operation {
            Operation::Constant(bits) => return Ok(Found::Constant(*bits)),
            Operation::Leaf(leaf) => return Ok(Found::Given(*leaf)),
            Operation::Carried(number) => *carried.get(*number as usize).ok_or("nothing is carried there")?,
            Operation::Unary(function, x) => {
                let x = self.real(of(x))?;
                self.unary(*function, x)?
            }
            Operation::Binary(operation, a, b) => {
                let (a, b) = (self.real(of(a))?, self.real(of(b))?);
                match operation {
                    Binary::Add => self.cursor.ins().fadd(a, b),
                    Binary::Sub => self.cursor.ins().fsub(a, b),
                    Binary::Mul => self.cursor.ins().fmul(a, b),
                    Binary::Div => self.cursor.ins().fdiv(a, b),
                    Binary::Pow => self.call(self.callees.power, &[a, b]),
                }
            }
            Operation::Powi(x, exponent) => {
                let x = self.real(of(x))?;
                self.power(x, *exponent)
            }
            Operation::Powf(x, bits) => {
                let (x, exponent) = (self.real(of(x))?, self.number(f64::from_bits(*bits)));
                self.call(self.callees.power, &[x, exponent])
            }
            Operation::Compare(comparison, a, b) => {
                let (a, b) = (self.real(of(a))?, self.real(of(b))?);
                let code = match comparison {
                    Comparison::Below => FloatCC::LessThan,
                    Comparison::AtMost => FloatCC::LessThanOrEqual,
                    Comparison::Equals => FloatCC::Equal,
                };
                return Ok(Found::Flag(self.cursor.ins().fcmp(code, a, b)));
            }
            Operation::Not(a) => {
                let a = self.flag(of(a))?;
                return Ok(Found::Flag(self.cursor.ins().bxor_imm(a, 1)));
            }
            Operation::And(a, b) | Operation::Or(a, b) => {
                let (a, b) = (self.flag(of(a))?, self.flag(of(b))?);
                let both = matches!(operation, Operation::And(..));
                return Ok(Found::Flag(if both { self.cursor.ins().band(a, b) } else { self.cursor.ins().bor(a, b) }));
            }
            Operation::Select(condition, yes, no) => {
                let condition = self.flag(of(condition))?;
                let (yes, no) = (self.real(of(yes))?, self.real(of(no))?);
                self.cursor.ins().select(condition, yes, no)
            }
            Operation::Opaque(function, arguments) => {
                let arguments = arguments.iter().map(|node| self.real(of(node))).collect::<Answer<Vec<Value>>>()?;
                let arguments: [Value; 3] = arguments.try_into().map_err(|_| "it follows from three numbers")?;
                self.call(self.callees.of_opaque(*function), &arguments)
            }
            Operation::Iterate { body, most, start, captured } => {
                let mut all = |nodes: &[Node]| nodes.iter().map(|node| self.real(of(node))).collect::<Answer<Vec<_>>>();
                let (start, captured) = (all(start)?, all(captured)?);
                return Ok(Found::Reached(self.iteration(body, *most, &start, captured)?));
            }
            Operation::Part(iteration, number) => match of(iteration) {
                Found::Reached(state) => *state.get(*number as usize).ok_or("a part that isn't there")?,
                _ => return Err("a part of what isn't an iteration".to_owned()),
            },
        }))
    }

    fn unary(&mut self, function: Unary, x: Value) -> Answer<Value> {
        Ok(match function {
            Unary::Neg => self.cursor.ins().fneg(x),
            Unary::Abs => self.cursor.ins().fabs(x),
            Unary::Sqrt => self.cursor.ins().sqrt(x),
            Unary::Recip => {
                let one = self.number(1.0);
                self.cursor.ins().fdiv(one, x)
            }
            _ => {
                let callee = self.callees.of(function).ok_or_else(|| format!("{function:?} can't be called"))?;
                self.call(callee, &[x])
            }
        })
    }

    /// Writes a product of squares, like every compiler of the equations.
    fn power(&mut self, x: Value, exponent: i32) -> Value {
        let (mut rest, mut square, mut power) = (exponent.unsigned_abs(), x, None);
        loop {
            if rest % 2 == 1 {
                power = Some(power.map_or(square, |power| self.cursor.ins().fmul(power, square)));
            }
            rest /= 2;
            if rest == 0 {
                break;
            }
            square = self.cursor.ins().fmul(square, square);
        }
        let power = power.unwrap_or_else(|| self.number(1.0));
        if exponent >= 0 {
            return power;
        }
        let one = self.number(1.0);
        self.cursor.ins().fdiv(one, power)
    }

    fn call(&mut self, callee: u64, arguments: &[Value]) -> Value {
        let callee = self.cursor.ins().iconst(self.pointer, callee as i64);
        let call = self.cursor.ins().call_indirect(self.signatures[arguments.len() - 1], callee, arguments);
        self.cursor.func.dfg.first_result(call)
    }

    /// Writes a loop, and returns its final state.
    fn iteration(&mut self, body: &Body, most: usize, start: &[Value], captured: Vec<Value>) -> Answer<Vec<Value>> {
        let [head, step, end] = [(); 3].map(|()| self.cursor.func.dfg.make_block());
        let count = self.cursor.func.dfg.append_block_param(head, I64);
        let mut parameters = |block| -> Vec<Value> {
            start.iter().map(|_| self.cursor.func.dfg.append_block_param(block, F64)).collect()
        };
        let (state, reached) = (parameters(head), parameters(end));
        let zero = self.cursor.ins().iconst(I64, 0);
        self.cursor.ins().jump(head, &arguments([zero].iter().chain(start)));

        self.cursor.insert_block(head);
        let carried = [&state[..], &captured].concat();
        let mut found = vec![Found::Nothing; body.operations.len()];
        let for_condition = needed(&body.operations, &[body.goes_on]);
        let for_state = needed(&body.operations, &body.next);
        let places = |wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
            (0..body.operations.len()).filter(|&place| wanted(place)).collect()
        };
        for place in places(&|place| for_condition[place]) {
            found[place] = self.operation(&body.operations[place], &found, &carried)?;
        }
        let goes_on = self.flag(&found[body.goes_on.index()])?;
        let more = self.cursor.ins().icmp_imm(IntCC::UnsignedLessThan, count, most as i64);
        let goes_on = self.cursor.ins().band(goes_on, more);
        self.cursor.ins().brif(goes_on, step, &[], end, &arguments(&state));

        self.cursor.insert_block(step);
        for place in places(&|place| for_state[place] && !for_condition[place]) {
            found[place] = self.operation(&body.operations[place], &found, &carried)?;
        }
        let next = body.next.iter().map(|node| self.real(&found[node.index()])).collect::<Answer<Vec<Value>>>()?;
        let count = self.cursor.ins().iadd_imm(count, 1);
        self.cursor.ins().jump(head, &arguments([count].iter().chain(&next)));

        self.cursor.insert_block(end);
        Ok(reached)
    }
}

fn arguments<'v>(values: impl IntoIterator<Item = &'v Value>) -> Vec<BlockArg> {
    values.into_iter().map(|&value| BlockArg::Value(value)).collect()
}

/// Numbers still to be written. A number is written as soon as it is known, unless its place is read later.
struct Pending {
    /// Address and offset by operation.
    now: HashMap<usize, Vec<(Value, i32)>>,
    last: Vec<(usize, Value, i32)>,
    overwritten: Vec<Leaf>,
}

impl Pending {
    fn new(operations: &[Operation], needed: &[bool], written: &[Written]) -> Self {
        let leaf = |(place, operation): (usize, &Operation)| match operation {
            Operation::Leaf(leaf) if needed[place] => Some((*leaf, place)),
            _ => None,
        };
        let read: HashMap<Leaf, usize> = operations.iter().enumerate().filter_map(leaf).collect();
        let mut pending = Pending { now: HashMap::new(), last: Vec::new(), overwritten: Vec::new() };
        for Written { to, read: as_leaf, writes } in written {
            for (place, node) in *writes {
                let overwrites = as_leaf.map(|leaf| leaf(*place)).and_then(|leaf| Some((leaf, *read.get(&leaf)?)));
                pending.overwritten.extend(overwrites.map(|(leaf, _)| leaf));
                let (node, offset) = (node.index(), *place as i32 * 8);
                if overwrites.is_some_and(|(_, last)| last > node) {
                    pending.last.push((node, *to, offset));
                } else {
                    pending.now.entry(node).or_default().push((*to, offset));
                }
            }
        }
        pending.overwritten.sort_unstable();
        pending
    }

    /// True if an argument is overwritten later.
    fn is_overwritten(&self, operation: &Operation) -> bool {
        matches!(operation, Operation::Leaf(leaf) if self.overwritten.binary_search(leaf).is_ok())
    }

    fn at_once(&mut self, place: usize) -> Vec<(Value, i32)> {
        self.now.remove(&place).unwrap_or_default()
    }

    fn at_last(self) -> Vec<(usize, Value, i32)> {
        self.last
    }
}
