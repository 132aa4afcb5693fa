//! Recorded functions of a kernel, which a library passes to a host that has a compiler.

mod elimination;

use serde::{Deserialize, Serialize};

use crate::differentiation;
use crate::error::Invalid;
use crate::execution::Settled;
use crate::kernel::{Sizes, VERSION};
use crate::model::Model;
use crate::recording::{Leaf, Method, Node, Opaque, Operation, Recording, Tape, Unary};
use crate::system::Section;

/// Equations of more operations are evaluated as they are: making a kernel of them takes too long.
const LARGEST: usize = 20_000;
/// Operations that are followed at most while a Jacobian is recorded: beyond that, few runs are long enough for it.
const MOST_FOLLOWED: usize = 250_000;

/// Functions that a kernel is compiled from.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Functions {
    version: u32,
    /// Sizes of the block that they are for.
    pub sizes: Sizes,
    /// Parameters that they are for; empty if they are for any.
    pub settled: Settled,
    /// Functions that they call.
    pub callees: Callees,
    /// Signals, rates, and the Jacobian.
    pub equations: Vec<Operation>,
    /// Places of the signals in the block.
    pub signals: Vec<Write>,
    /// Places of the rates in the block.
    pub rates: Vec<Write>,
    /// The entries of the Jacobian, and the rates' change by time; nothing where it has too many operations.
    pub jacobian: Option<[Vec<Write>; 2]>,
    /// The linear equations of the stiff method; nothing where the elimination has too many operations, or isn't worth it.
    pub solver: Option<Solver>,
}

/// A number that is written, and where among others it goes.
pub type Write = (u32, Node);

/// Straight-line elimination over the pattern of a Jacobian.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Solver {
    /// Decomposition. [`Leaf::Time`] is the diagonal, and each [`Leaf::Real`] is an entry of the Jacobian, by its
    /// number.
    pub decompose: Vec<Operation>,
    /// True if the decomposition is accurate.
    pub accurate: Node,
    /// Places of the factors.
    pub factors: Vec<Write>,
    /// Solution. Each [`Leaf::Real`] is a factor, and each [`Leaf::Change`] a number of the right-hand side.
    pub solve: Vec<Operation>,
    /// Places of the solution in the right-hand side.
    pub solution: Vec<Write>,
}

/// Addresses of the very functions that the equations call, in the process that the library is loaded into.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Callees {
    unary: Vec<(Unary, u64)>,
    /// The address of the function that takes a number to the power of another.
    pub power: u64,
    noise: u64,
    uniform: u64,
}

macro_rules! callees {
    ($($function:ident)*) => {
        vec![$((Unary::$function, {
            extern "C" fn call(x: f64) -> f64 {
                Unary::$function.of(x)
            }
            address(call as *const ())
        })),*]
    };
}

fn address(function: *const ()) -> u64 {
    function as u64
}

impl Callees {
    fn own() -> Self {
        extern "C" fn power(x: f64, exponent: f64) -> f64 {
            x.powf(exponent)
        }
        extern "C" fn noise(seed: f64, channel: f64, sample: f64) -> f64 {
            Opaque::Noise.of([seed, channel, sample].into_iter())
        }
        extern "C" fn uniform(seed: f64, channel: f64, sample: f64) -> f64 {
            Opaque::Uniform.of([seed, channel, sample].into_iter())
        }
        let unary = callees!(Sin Cos Tan Cosh Sinh Tanh Exp Ln Ln1p Atan Signum Floor Round Wrap);
        let [power, noise, uniform] = [power as *const (), noise as *const (), uniform as *const ()].map(address);
        Callees { unary, power, noise, uniform }
    }

    /// The address of a function of three numbers that no arithmetic expresses.
    pub fn of_opaque(&self, function: Opaque) -> u64 {
        match function {
            Opaque::Noise => self.noise,
            Opaque::Uniform => self.uniform,
        }
    }

    /// The address of a function of one number that isn't an instruction of every processor.
    pub fn of(&self, function: Unary) -> Option<u64> {
        self.unary.iter().find(|(known, _)| *known == function).map(|(_, address)| *address)
    }
}

impl Functions {
    /// Those of a model, where some values of the block are known.
    ///
    /// # Errors
    /// When its equations can't be recorded, or are too large.
    pub fn of(model: &Model, settled: Settled) -> Result<Self, Invalid> {
        let (variables, known) = (model.variables(), |leaf| settled.known(leaf));
        let recording = Recording::of_known(model.system(), Method::Evaluate, &variables.layout(), &known);
        if recording.tape.has_looked() {
            model.check_recorded()?;
        }
        let of = |sections: &[Section]| writes(&recording, sections.iter().flat_map(|&it| variables.reals(it)));
        let (signals, rates) = (of(&[Section::Connected, Section::Signal]), of(&[Section::Derivative]));
        let wanted: Vec<Node> = signals.iter().chain(&rates).map(|(_, node)| *node).collect();
        let size = size(&recording.tape, &wanted);
        if size > LARGEST {
            return Err(Invalid::because(format!("{size} operations are more than the {LARGEST} that are compiled")));
        }
        let (sparsity, evaluation) = (model.sparsity(), recording.tape.operations().len());
        let mut functions = Functions {
            version: VERSION,
            sizes: Sizes::of(variables, sparsity.entries()),
            settled,
            callees: Callees::own(),
            equations: Vec::new(),
            signals,
            rates,
            jacobian: None,
            solver: None,
        };
        let equations = recording.tape.operations().to_vec();
        let follows = (1..=MOST_FOLLOWED).contains(&(variables.states() * evaluation));
        match follows.then(|| differentiation::jacobian(variables, sparsity.columns(), recording, LARGEST)).flatten() {
            Some(jacobian) => {
                let numbered = |nodes: Vec<Node>| (0..).zip(nodes).collect();
                functions.equations = jacobian.tape.operations().to_vec();
                functions.jacobian = Some([jacobian.entries, jacobian.by_time].map(numbered));
                functions.solver = elimination::record(sparsity);
                functions.sizes.factors = functions.solver.as_ref().map_or(0, |solver| solver.factors.len() as u32);
            }
            None => functions.equations = equations,
        }
        Ok(functions)
    }

    /// True if they are of the version that this host knows.
    pub fn is_known(&self) -> bool {
        self.version == VERSION
    }
}

/// New values of the block, only those that change.
fn writes(recording: &Recording, places: impl Iterator<Item = usize>) -> Vec<Write> {
    let written = |place: usize| {
        let (node, own) = (recording.reals[place], Leaf::Real(place as u32));
        (*recording.tape.operation(node) != Operation::Leaf(own)).then_some((place as u32, node))
    };
    places.filter_map(written).collect()
}

/// Number of operations that nodes need; those of an iteration's body count once.
fn size(tape: &Tape, wanted: &[Node]) -> usize {
    let needed = tape.needed(wanted);
    tape.operations().iter().zip(needed).filter(|(_, needed)| *needed).map(|(operation, _)| size_of(operation)).sum()
}

fn size_of(operation: &Operation) -> usize {
    match operation {
        Operation::Iterate { body, .. } => 1 + body.operations.iter().map(size_of).sum::<usize>(),
        _ => 1,
    }
}
