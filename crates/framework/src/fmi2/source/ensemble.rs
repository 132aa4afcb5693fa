//! A system as OpenCL C, for many runs at a time on a graphics card: the functions of its C source, where parameters that all runs
//! have in common are numbers, with a kernel that takes fixed steps.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::equations::{Head, METHODS, function, of_events};
use super::{RUNTIME, Unit};
use crate::error::Invalid;
use crate::execution::Settled;
use crate::model::{Block, Model};
use crate::recording::{Leaf, Method, Node, Note, Operation, Recording};
use crate::system::Section;

/// The kernel's name in [`Ensemble::text`].
pub const KERNEL: &str = "advance";

/// OpenCL C in place of the headers of C, and other names for its own words.
const BEGIN: &str = "\
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF
#define real double
#define R(x) x
#define F(name) name
#define LARGE(x) x
#define SMALL(x) x
#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)
#define uint64_t ulong
#define int64_t long
#define UINT64_C(x) x##UL
#define INT64_MIN LONG_MIN
#define INT64_MAX LONG_MAX
#define half half_turn
#define sign unit_sign
#define kernel unit_kernel
#define global unit_global
#define local unit_local
#define constant unit_constant
#define generic unit_generic
#define pipe unit_pipe
#define event_t unit_event_t
#define log_text(...) ((void)0)
#define refuse(messages, ...) ((messages)->refused = 1)
typedef struct {
    int refused;
} Log;

";

/// Sections whose values a run continues with.
const CONTINUED: [Section; 3] = [Section::State, Section::Discrete, Section::Memory];
/// Sections that an evaluation writes.
const EVALUATED: [Section; 3] = [Section::Connected, Section::Signal, Section::Derivative];
/// Sections that a method may write.
const ANY: [Section; 6] =
    [Section::State, Section::Discrete, Section::Memory, Section::Connected, Section::Signal, Section::Derivative];

/// A value of the block by its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// A real value.
    Real(usize),
    /// An integer.
    Integer(usize),
}

/// A system for many runs at a time.
#[derive(Debug, Clone)]
pub struct Ensemble {
    /// The program in OpenCL C, with the kernel [`KERNEL`].
    pub text: String,
    /// Places in the block of the columns of reals that a run continues with.
    pub reals: Vec<usize>,
    /// The same of integers. Behind them there are as many columns as there are event indicators, zeros at the start.
    pub integers: Vec<usize>,
    /// Number of event indicators.
    pub indicators: usize,
    /// Places of the reals and the integers that changes during a run may set.
    pub changed: (Vec<usize>, Vec<usize>),
}

/// Request for an ensemble.
#[derive(Debug)]
pub struct Request<'a> {
    /// Values that all runs start with, but for what differs.
    pub block: &'a Block,
    /// The parameters that are the same in all runs, and at all times.
    pub settled: &'a Settled,
    /// Recorded values, in their order.
    pub recorded: &'a [Slot],
    /// Number of changes of parameters or inputs during a run.
    pub changes: usize,
}

impl Ensemble {
    /// A model for many runs at a time.
    ///
    /// # Errors
    /// When its equations can't be recorded.
    pub fn of(model: &Model, request: &Request) -> Result<Self, Invalid> {
        model.check_recorded()?;
        let unit = Unit::settled(model, request.block, request.settled);
        let methods = Methods::of(&unit);
        let (reals, integers) = continued(&unit, &methods, request.recorded);
        let changed = if request.changes == 0 { Default::default() } else { given(&unit, &reals, &integers) };
        let indicators = model.variables().indicators().len();
        let made = Ensemble { text: String::new(), reals, integers, indicators, changed };
        Ok(Ensemble { text: made.written(&unit, &methods, request), ..made })
    }

    fn written(&self, unit: &Unit, methods: &Methods, request: &Request) -> String {
        let numbers = RUNTIME.iter().find(|(name, _)| *name == "numbers.h").map_or("", |(_, text)| text);
        let mut text = BEGIN.to_owned();
        let (variables, mut define) = (unit.model.variables(), String::new());
        for (name, value) in [
            ("UNIT_REALS", variables.reals(Section::Memory).end),
            ("UNIT_INTEGERS", variables.integers(Section::Memory).end),
            ("UNIT_INDICATORS", self.indicators),
            ("UNIT_STATES", variables.states()),
            ("FIRST_STATE", variables.reals(Section::State).start),
            ("FIRST_RATE", variables.reals(Section::Derivative).start),
            ("CHANGES", request.changes),
        ] {
            let _ = writeln!(define, "#define {name} {value}");
        }
        text += &define;
        text += numbers;
        text += &methods.written(unit);
        text += &self.columns(unit, request);
        text + include_str!("ensemble.cl")
    }

    /// Functions that move values between a run's own memory and the columns of all runs.
    fn columns(&self, unit: &Unit, request: &Request) -> String {
        let (mut load, mut store, mut record, mut change) = <(String, String, String, String)>::default();
        for (column, place) in self.reals.iter().enumerate() {
            let _ = writeln!(load, "    v[{place}] = reals[(size_t){column} * runs + run];");
            if is_in(unit, &CONTINUED, Slot::Real(*place)) {
                let _ = writeln!(store, "    reals[(size_t){column} * runs + run] = v[{place}];");
            }
        }
        for (column, place) in self.integers.iter().enumerate() {
            let _ = writeln!(load, "    n[{place}] = integers[(size_t){column} * runs + run];");
            if is_in(unit, &CONTINUED, Slot::Integer(*place)) {
                let _ = writeln!(store, "    integers[(size_t){column} * runs + run] = n[{place}];");
            }
        }
        let of_sides = self.integers.len();
        if self.indicators > 0 {
            let column = format!("integers[(size_t)({of_sides} + i) * runs + run]");
            let each = "    for (int i = 0; i < UNIT_INDICATORS; i++) {\n        ";
            let _ = writeln!(load, "{each}sides[i] = {column};\n    }}");
            let _ = writeln!(store, "{each}{column} = sides[i];\n    }}");
        }
        for (number, slot) in request.recorded.iter().enumerate() {
            let value = match *slot {
                Slot::Real(place) => match unit.known(Leaf::Real(place as u32)) {
                    Some(known) => format!("{known:?}"),
                    None => format!("v[{place}]"),
                },
                Slot::Integer(place) => match unit.known(Leaf::Integer(place as u32)) {
                    Some(known) => format!("{known:?}"),
                    None => format!("(real)n[{place}]"),
                },
            };
            let all = request.recorded.len();
            let _ = writeln!(record, "    recorded[((size_t)row * {all} + {number}) * runs + run] = {value};");
        }
        let (reals, integers) = &self.changed;
        for (of, name, array) in [(reals, "changed_reals", "v"), (integers, "changed_integers", "n")] {
            for (column, place) in of.iter().enumerate() {
                let all = of.len();
                let _ = writeln!(
                    change,
                    "    {array}[{place}] = {name}[((size_t)number * {all} + {column}) * runs + run];"
                );
            }
        }
        format!(
            "static void load(real *v, int *n, int *sides, __global const double *reals, __global const int *integers, uint run, uint \
             runs)\n{{\n{load}}}\n\nstatic void store(const real *v, const int *n, const int *sides, __global double *reals, __global int \
             *integers, uint run, uint runs)\n{{\n{store}}}\n\nstatic void record(const real *v, const int *n, __global double *recorded, \
             uint row, uint run, uint runs)\n{{\n{record}}}\n\nstatic void change(real *v, int *n, __global const double *changed_reals, \
             __global const int *changed_integers, uint number, uint run, uint runs)\n{{\n{change}}}\n\n"
        )
    }
}

/// The methods of a run.
struct Methods {
    evaluate: Recording,
    indicators: Recording,
    next_time_event: Recording,
    /// Those that change values, in the order of [`changing`].
    changing: Vec<Recording>,
}

/// Methods of [`METHODS`] that the kernel calls: parameters are prepared, and states started, on the processor.
fn changing() -> impl Iterator<Item = &'static (Method, Head)> {
    METHODS.iter().filter(|(method, _)| !matches!(method, Method::Relate | Method::Start))
}

impl Methods {
    fn of(unit: &Unit) -> Self {
        Methods {
            evaluate: unit.record(Method::Evaluate),
            indicators: unit.record(Method::Indicators),
            next_time_event: unit.record(Method::NextTimeEvent),
            changing: changing().map(|(method, _)| unit.record(*method)).collect(),
        }
    }

    /// Leaves that any of them reads.
    fn read(&self, unit: &Unit) -> BTreeSet<Leaf> {
        let mut found = BTreeSet::new();
        let mut add = |recording: &Recording, nodes: Vec<Node>| {
            let needed = recording.tape.needed(&nodes);
            let operations = recording.tape.operations().iter().zip(needed);
            found.extend(operations.filter_map(|(operation, needed)| match operation {
                Operation::Leaf(leaf) if needed => Some(*leaf),
                _ => None,
            }));
        };
        let targets = |recording, sections: &[Section]| -> Vec<Node> {
            unit.changed(recording, sections).iter().map(|target| target.node).collect()
        };
        add(&self.evaluate, targets(&self.evaluate, &EVALUATED));
        for recording in [&self.indicators, &self.next_time_event] {
            add(recording, recording.results.clone());
        }
        for recording in &self.changing {
            let conditions = recording.tape.notes().iter().map(Note::condition);
            add(recording, targets(recording, &ANY).into_iter().chain(conditions).collect());
        }
        found
    }

    /// Their functions.
    fn written(&self, unit: &Unit) -> String {
        let head = |what, declaration| Head { what, declaration };
        let evaluate = head("Signals and rates.", "static void unit_evaluate(real t, real *v, const int *n)");
        let rates = head("The rates of the states.", "static void unit_rates(real t, real *v, const int *n)");
        let tape = &self.evaluate.tape;
        let mut text = function(unit, &evaluate, tape, &unit.changed(&self.evaluate, &EVALUATED), &[]);
        text += &function(unit, &rates, tape, &unit.changed(&self.evaluate, &[Section::Derivative]), &[]);
        for ((_, head), recording) in changing().zip(&self.changing) {
            text += &function(unit, head, &recording.tape, &unit.changed(recording, &ANY), recording.tape.notes());
        }
        text + &of_events(unit, &self.next_time_event, &self.indicators)
    }
}

fn is_in(unit: &Unit, sections: &[Section], slot: Slot) -> bool {
    let variables = unit.model.variables();
    sections.iter().any(|&section| match slot {
        Slot::Real(place) => variables.reals(section).contains(&place),
        Slot::Integer(place) => variables.integers(section).contains(&place),
    })
}

/// Values that a run needs at the start of a step, as far as they may differ: places of reals and of integers.
fn continued(unit: &Unit, methods: &Methods, recorded: &[Slot]) -> (Vec<usize>, Vec<usize>) {
    let read = methods.read(unit).into_iter().filter_map(|leaf| match leaf {
        Leaf::Real(place) => Some(Slot::Real(place as usize)),
        Leaf::Integer(place) => Some(Slot::Integer(place as usize)),
        _ => None,
    });
    let is_known = |slot: &Slot| match *slot {
        Slot::Real(place) => unit.known_reals[place],
        Slot::Integer(place) => unit.known_integers[place],
    };
    // All states, since a step takes them all.
    let states = unit.model.variables().reals(Section::State).map(Slot::Real);
    let all: BTreeSet<Slot> = read.chain(recorded.iter().copied()).chain(states).collect();
    let needed = all.into_iter().filter(|slot| !is_known(slot) && !is_in(unit, &EVALUATED, *slot));
    let (mut reals, mut integers) = (Vec::new(), Vec::new());
    needed.for_each(|slot| match slot {
        Slot::Real(place) => reals.push(place),
        Slot::Integer(place) => integers.push(place),
    });
    (reals, integers)
}

/// Those of these places that changes during a run may set, or that follow from it.
fn given(unit: &Unit, reals: &[usize], integers: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let sections = [Section::Parameter, Section::Prepared, Section::Input];
    let reals = reals.iter().copied().filter(|&place| is_in(unit, &sections, Slot::Real(place)));
    let integers = integers.iter().copied().filter(|&place| is_in(unit, &sections, Slot::Integer(place)));
    (reals.collect(), integers.collect())
}
