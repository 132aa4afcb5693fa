//! Functions of a kernel, compiled one by one and put into memory together.

use std::fmt::Display;
use std::mem::transmute;
use std::sync::OnceLock;

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::cursor::{Cursor, FuncCursor};
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::types::{F64, I32, I64};
use cranelift_codegen::ir::{AbiParam, Function, InstBuilder, MemFlags, Signature, Type, UserFuncName, Value};
use cranelift_codegen::isa::OwnedTargetIsa;
use cranelift_codegen::settings::{self, Configurable};
use cranelift_codegen::{Context, isa};
use memmap2::{Mmap, MmapMut};

use super::emitter::{Emitter, Given, Written};
use crate::execution::Settled;
use crate::fmi2::kernel::{Functions, Solver};
use crate::kernel::{Code, Decompose, Differentiate, Evaluate, Holds, Kernel, Solve};
use crate::recording::{Leaf, Node, Operation};

/// Alignment of the first instruction of a function, bytes.
const ALIGNMENT: usize = 64;

/// A kernel, and the memory of its code.
#[derive(Debug)]
pub struct Compiled {
    kernel: Kernel,
    _code: Mmap,
    /// Slopes of inputs that don't move.
    _slopes: Box<[f64]>,
}

impl Compiled {
    /// Compiles recorded functions.
    ///
    /// # Errors
    /// There is no compiler for this processor, or no memory for code.
    pub fn of(functions: &Functions) -> Result<Self, String> {
        Self::made(functions, true)
    }

    /// Compiles only the evaluation of the equations, which is needed soon.
    ///
    /// # Errors
    /// See [`Compiled::of`].
    pub fn evaluation(functions: &Functions) -> Result<Self, String> {
        Self::made(functions, false)
    }

    fn made(functions: &Functions, whole: bool) -> Result<Self, String> {
        let slopes = vec![0.0; functions.sizes.inputs as usize].into_boxed_slice();
        let mut assembly =
            Assembly { isa: own_isa(if whole { "speed" } else { "none" })?, functions, code: Vec::new() };
        let outputs = assembly.evaluation(false)?;
        let evaluate = assembly.evaluation(true)?;
        let holds = assembly.comparison()?;
        let jacobian = if whole { assembly.jacobian(&slopes)? } else { None };
        let solver = functions.solver.as_ref().filter(|_| whole).map(|solver| assembly.solver(solver)).transpose()?;
        let code = in_memory(&assembly.code)?;
        let at = |place: usize| code[place..].as_ptr();
        // SAFETY: each function was compiled for the signature of its type.
        let code_of = unsafe {
            Code {
                outputs: transmute::<*const u8, Evaluate>(at(outputs)),
                evaluate: transmute::<*const u8, Evaluate>(at(evaluate)),
                jacobian: jacobian.map(|place| transmute::<*const u8, Differentiate>(at(place))),
                decompose: solver.map(|[place, _]| transmute::<*const u8, Decompose>(at(place))),
                solve: solver.map(|[_, place]| transmute::<*const u8, Solve>(at(place))),
                holds: holds.map(|place| transmute::<*const u8, Holds>(at(place))),
            }
        };
        // SAFETY: the library that gave the functions counts places within the sizes that it gave with them. The code
        // stays in memory as long as this value.
        let kernel = unsafe { Kernel::new(functions.sizes, code_of) };
        Ok(Compiled { kernel, _code: code, _slopes: slopes })
    }

    /// The kernel, which must not outlive this.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }
}

/// Reason why nothing can be compiled in this process; none if it can.
pub fn refused() -> Option<String> {
    static REFUSED: OnceLock<Option<String>> = OnceLock::new();
    REFUSED.get_or_init(|| own_isa("none").and_then(|_| in_memory(&[0; ALIGNMENT])).err()).clone()
}

fn because(reason: impl Display) -> String {
    reason.to_string()
}

/// The processor of this process, as a target with this level of optimisation.
fn own_isa(level: &str) -> Result<OwnedTargetIsa, String> {
    let mut flags = settings::builder();
    // Some systems require that large frames are touched page by page.
    let probes = [("enable_probestack", "true"), ("probestack_strategy", "inline")];
    let plain = [("opt_level", level), ("enable_verifier", "false"), ("unwind_info", "false")];
    for (name, value) in probes.into_iter().chain(plain) {
        flags.set(name, value).map_err(because)?;
    }
    let builder: isa::Builder = cranelift_native::builder().map_err(because)?;
    builder.finish(settings::Flags::new(flags)).map_err(because)
}

/// Code in memory that is executable, and no longer writable.
fn in_memory(code: &[u8]) -> Result<Mmap, String> {
    let refused = |error: std::io::Error| format!("the system refuses memory for code: {error}");
    let mut memory = MmapMut::map_anon(code.len()).map_err(refused)?;
    memory.copy_from_slice(code);
    let memory = memory.make_exec().map_err(refused)?;
    #[cfg(target_arch = "aarch64")]
    // SAFETY: the memory is there.
    unsafe {
        use wasmtime_internal_jit_icache_coherence::{clear_cache, pipeline_flush_mt};
        clear_cache(memory.as_ptr().cast(), memory.len()).map_err(because)?;
        pipeline_flush_mt().map_err(because)?;
    }
    Ok(memory)
}

/// Functions one behind the other.
struct Assembly<'a> {
    isa: OwnedTargetIsa,
    functions: &'a Functions,
    code: Vec<u8>,
}

/// Contents of a function: the operations, and the condition that it returns.
type Operations<'a> = (&'a [Operation], Option<Node>);

impl<'a> Assembly<'a> {
    /// Compiles signals, or signals and rates; returns the start of the function.
    fn evaluation(&mut self, with_rates: bool) -> Result<usize, String> {
        let pointer = self.isa.pointer_type();
        let Functions { equations, signals, rates, .. } = self.functions;
        self.function([F64, pointer, pointer], (equations, None), |_, [time, reals, integers]| {
            let given = Given { time: Some(time), reals: Some(reals), integers: Some(integers), ..Given::default() };
            let written = |writes| Written { to: reals, read: Some(Leaf::Real), writes };
            let rates: &[_] = if with_rates { rates } else { &[] };
            (given, vec![written(signals), written(rates)])
        })
    }

    /// Compiles the Jacobian, and the rates' change by time. Inputs without slopes have those of `still`.
    fn jacobian(&mut self, still: &[f64]) -> Result<Option<usize>, String> {
        let pointer = self.isa.pointer_type();
        let Functions { equations, jacobian: Some([entries, by_time]), .. } = self.functions else { return Ok(None) };
        let parameters = [F64, pointer, pointer, pointer, pointer, pointer];
        let function =
            self.function(parameters, (equations, None), |cursor, [time, reals, integers, slopes, to, rates]| {
                let still = cursor.ins().iconst(pointer, still.as_ptr() as i64);
                let slopes = cursor.ins().select(slopes, slopes, still);
                let (reals, integers, slopes) = (Some(reals), Some(integers), Some(slopes));
                let given = Given { time: Some(time), reals, integers, slopes, changes: None };
                let written = |to, writes| Written { to, read: None, writes };
                (given, vec![written(to, entries), written(rates, by_time)])
            });
        function.map(Some)
    }

    /// The decomposition, and the solution.
    fn solver(&mut self, solver: &'a Solver) -> Result<[usize; 2], String> {
        let pointer = self.isa.pointer_type();
        let operations = (&solver.decompose[..], Some(solver.accurate));
        let decompose = self.function([F64, pointer, pointer], operations, |_, [diagonal, entries, factors]| {
            let given = Given { time: Some(diagonal), reals: Some(entries), ..Given::default() };
            (given, vec![Written { to: factors, read: None, writes: &solver.factors }])
        })?;
        let solve = self.function([pointer, pointer], (&solver.solve, None), |_, [factors, b]| {
            let given = Given { reals: Some(factors), changes: Some(b), ..Given::default() };
            (given, vec![Written { to: b, read: Some(Leaf::Change), writes: &solver.solution }])
        })?;
        Ok([decompose, solve])
    }

    /// Compiles the comparison of a block with the parameters that the functions are for; none if they are for any.
    fn comparison(&mut self) -> Result<Option<usize>, String> {
        let (pointer, Settled { reals, integers }) = (self.isa.pointer_type(), &self.functions.settled);
        if reals.is_empty() && integers.is_empty() {
            return Ok(None);
        }
        let place = self.assembled([pointer, pointer], true, |mut cursor, [of_reals, of_integers]| {
            let mut differ = cursor.ins().iconst(I64, 0);
            let mut compare = |cursor: &mut FuncCursor, value, known: i64| {
                let known = cursor.ins().iconst(I64, known);
                let different = cursor.ins().bxor(value, known);
                differ = cursor.ins().bor(differ, different);
            };
            for (place, bits) in reals {
                let value = cursor.ins().load(I64, MemFlags::trusted(), of_reals, *place as i32 * 8);
                compare(&mut cursor, value, *bits as i64);
            }
            for (place, known) in integers {
                let value = cursor.ins().load(I32, MemFlags::trusted(), of_integers, *place as i32 * 4);
                let value = cursor.ins().sextend(I64, value);
                compare(&mut cursor, value, i64::from(*known));
            }
            let holds = cursor.ins().icmp_imm(IntCC::Equal, differ, 0);
            let holds = cursor.ins().uextend(I32, holds);
            cursor.ins().return_(&[holds]);
            Ok(())
        });
        place.map(Some)
    }

    /// Compiles one function of operations and returns its start. `body` assigns a meaning to its parameters.
    fn function<const N: usize>(
        &mut self,
        parameters: [Type; N],
        (operations, condition): Operations,
        body: impl FnOnce(&mut FuncCursor, [Value; N]) -> (Given, Vec<Written<'a>>),
    ) -> Result<usize, String> {
        let (target, callees) = ((self.isa.pointer_type(), self.isa.default_call_conv()), &self.functions.callees);
        self.assembled(parameters, condition.is_some(), |mut cursor, parameters| {
            let (given, written) = body(&mut cursor, parameters);
            Emitter::new(cursor, callees, target, given).write(operations, &written, condition)
        })
    }

    /// Compiles one function and returns its start. `answers` if it returns an integer; `write` writes it at a cursor.
    fn assembled<const N: usize>(
        &mut self,
        parameters: [Type; N],
        answers: bool,
        write: impl FnOnce(FuncCursor, [Value; N]) -> Result<(), String>,
    ) -> Result<usize, String> {
        let convention = self.isa.default_call_conv();
        let mut signature = Signature::new(convention);
        signature.params = parameters.map(AbiParam::new).to_vec();
        signature.returns = answers.then(|| AbiParam::new(I32)).into_iter().collect();
        let mut context = Context::for_function(Function::with_name_signature(UserFuncName::default(), signature));
        let entry = context.func.dfg.make_block();
        let parameters = parameters.map(|of| context.func.dfg.append_block_param(entry, of));
        let mut cursor = FuncCursor::new(&mut context.func);
        cursor.insert_block(entry);
        write(cursor, parameters)?;
        let compiled =
            context.compile(&*self.isa, &mut ControlPlane::default()).map_err(|error| because(error.inner))?;
        if !compiled.buffer.relocs().is_empty() {
            return Err("the compiler asks for functions of its own".to_owned());
        }
        let begin = self.code.len().next_multiple_of(ALIGNMENT.max(compiled.buffer.alignment as usize));
        self.code.resize(begin, 0);
        self.code.extend_from_slice(compiled.code_buffer());
        Ok(begin)
    }
}
