//! A unit as C99: its recorded equations as straight-line functions, and its tables. A runtime, the same for all units, is
//! compiled with them and has the functions of the standard.
//!
//! What only the design of a unit reads (`System::prepare`) is a constant of its source; what the equations read stays a
//! variable. The same description gives the same bytes.

pub(crate) mod blocks;
mod derivatives;
pub mod ensemble;
mod equations;
pub(crate) mod expression;
mod fmi3;
pub(crate) mod function;
mod header;
pub(crate) mod loops;
mod message;
pub(crate) mod names;
mod operation;
mod tables;
pub(crate) mod written;

use crate::error::Invalid;
use crate::execution::Settled;
use crate::fmi2::fmi3::build_description;
use crate::fmi2::logger;
use crate::model::{Block, Model, Standard};
use crate::recording::{Leaf, Method, Node, Note, Operation, Recording};
use crate::system::{MessageLog, Section, Variability, Variable, Variables};
use equations::Target;
use expression::Kind;
use message::MessageFormat;

macro_rules! runtime {
    ($($name:literal)*) => {
        &[$(($name, include_str!(concat!("runtime/", $name)))),*]
    };
}

/// The files that all units share: names and texts.
pub const RUNTIME: &[(&str, &str)] = runtime!(
    "access.c" "all.c" "both.c" "calls.c" "choice.c" "chosen.c" "derivatives.c" "digits.c" "driver.c" "elimination.c" "events.c"
    "exchange.c" "exchange_calls.c" "execution.c" "explicit.c" "failures.c" "fixed.c" "indicators.c" "instance.h"
    "memory.c" "modes.c" "numbers.h" "order_8.c" "problem.c" "problem.h" "real.h" "runtime.h" "spectrum.c" "stability.c"
    "standard.h" "states.c" "stepping.c" "stiff.c" "text.c" "text.h"
);

/// The files that units of a standard have in addition.
pub const fn boundary(standard: Standard) -> &'static [(&'static str, &'static str)] {
    match standard {
        Standard::Fmi2 => runtime!("fmi2.c" "fmi2.h"),
        Standard::Fmi3 => runtime!("adjoint.c" "dependencies.c" "event_mode.c" "fmi3.c" "fmi3.h"),
    }
}

/// A source file: its name and its text.
pub type SourceFile = (String, String);

/// A unit that is written.
struct Unit<'a> {
    model: &'a Model,
    /// The block that instances begin with, prepared.
    start: Block,
    /// Names of what lies in the block.
    real_names: Vec<String>,
    integer_names: Vec<String>,
    /// Sources of the equations of reals, if given.
    sources: Vec<&'static str>,
    categories: Vec<&'static str>,
    /// True for known reals and integers: parameters of the design, and values prepared from them.
    known_reals: Vec<bool>,
    known_integers: Vec<bool>,
}

/// The files of a unit that are its own.
///
/// # Errors
/// When its equations can't be recorded, or its start values don't fit together.
pub fn files(model: &Model) -> Result<Vec<SourceFile>, Invalid> {
    model.check_recorded()?;
    let unit = Unit::designed(model)?;
    let body = [tables::write(&unit), equations::write(&unit), derivatives::write(&unit)].concat();
    let mut files = vec![("unit.h".to_owned(), header::write(&unit)), ("unit.c".to_owned(), body)];
    if model.description().standard() == Standard::Fmi3 {
        files.push(("buildDescription.xml".to_owned(), build_description::xml(&model.description().name)));
    }
    Ok(files)
}

/// True for values of the block that are parameters of the design.
fn known(variables: &Variables, size: usize, real: bool) -> Vec<bool> {
    let mut known = vec![false; size];
    let designed = variables.iter().filter(|v| v.is_real() == real && v.variability == Variability::Constant);
    designed.flat_map(Variable::elements).for_each(|element| known[variables.index(element)] = true);
    known
}

/// The sources of the equations of reals, by their places.
pub(crate) fn sources(variables: &Variables, size: usize) -> Vec<&'static str> {
    let mut sources = vec![""; size];
    let equations =
        variables.iter().filter(|v| matches!(v.section, Section::Signal | Section::Derivative) && v.is_real());
    for variable in equations {
        variable.elements().for_each(|element| sources[variables.index(element)] = variable.source);
    }
    sources
}

/// Names of all that lies in the block: of reals, or of integers.
pub(crate) fn names(variables: &Variables, real: bool) -> Vec<String> {
    let size = if real { variables.reals(Section::Memory).end } else { variables.integers(Section::Memory).end };
    let mut names = vec![String::new(); size];
    for element in variables.iter().filter(|variable| variable.is_real() == real).flat_map(|v| v.elements()) {
        names[variables.index(element)] = element.name().trim_start_matches('#').to_owned();
    }
    let unnamed = names.iter_mut().enumerate().filter(|(_, name)| name.is_empty());
    unnamed.for_each(|(place, name)| *name = format!("kept[{place}]"));
    names
}

impl<'a> Unit<'a> {
    /// Returns it with all its parameters as variables.
    fn tunable(model: &'a Model) -> Self {
        let (start, variables) = (model.start().clone(), model.variables());
        Unit {
            model,
            real_names: names(variables, true),
            integer_names: names(variables, false),
            sources: sources(variables, start.reals.len()),
            categories: logger::categories(model).map(|(name, _)| name).collect(),
            known_reals: vec![false; start.reals.len()],
            known_integers: vec![false; start.integers.len()],
            start,
        }
    }

    /// Returns it with the parameters of its design as constants.
    fn designed(model: &'a Model) -> Result<Self, Invalid> {
        let mut unit = Unit::tunable(model);
        model.prepare(&mut unit.start, &mut MessageLog::new())?;
        let variables = model.variables();
        unit.known_integers = known(variables, unit.start.integers.len(), false);
        unit.known_reals = known(variables, unit.start.reals.len(), true);
        let related = Recording::of(model.system(), Method::Relate, &variables.layout());
        let is_leaf = |node: Node, leaf| *related.tape.operation(node) == Operation::Leaf(leaf);
        for place in variables.reals(Section::Prepared) {
            unit.known_reals[place] = is_leaf(related.reals[place], Leaf::Real(place as u32));
        }
        Ok(unit)
    }

    /// Returns it with some values of a block as constants.
    fn settled(model: &'a Model, block: &Block, settled: &Settled) -> Self {
        let mut unit = Unit { start: block.clone(), ..Unit::tunable(model) };
        settled.reals.iter().for_each(|(place, _)| unit.known_reals[*place as usize] = true);
        settled.integers.iter().for_each(|(place, _)| unit.known_integers[*place as usize] = true);
        unit
    }

    fn real_name(&self, place: usize) -> &str {
        &self.real_names[place]
    }

    fn integer_name(&self, place: usize) -> &str {
        &self.integer_names[place]
    }

    /// The number of a log category.
    fn category(&self, name: &str) -> usize {
        self.categories.iter().position(|known| *known == name).unwrap_or_default()
    }

    /// A value that was computed or given at design time.
    fn known(&self, leaf: Leaf) -> Option<f64> {
        match leaf {
            Leaf::Real(place) => self.known_reals[place as usize].then(|| self.start.reals[place as usize]),
            Leaf::Integer(place) => {
                self.known_integers[place as usize].then(|| f64::from(self.start.integers[place as usize]))
            }
            _ => None,
        }
    }

    fn record(&self, method: Method) -> Recording {
        let layout = self.model.variables().layout();
        Recording::of_known(self.model.system(), method, &layout, &|leaf| self.known(leaf))
    }

    /// Values of some sections that a method changes.
    fn changed(&self, recording: &Recording, sections: &[Section]) -> Vec<Target> {
        let variables = self.model.variables();
        let is_same = |node: Node, leaf: Leaf| match recording.tape.operation(node) {
            Operation::Leaf(found) => *found == leaf,
            Operation::Constant(bits) => self.known(leaf).is_some_and(|known| known.to_bits() == *bits),
            _ => false,
        };
        let mut targets = Vec::new();
        for &section in sections {
            for place in variables.reals(section) {
                let node = recording.reals[place];
                if !is_same(node, Leaf::Real(place as u32)) {
                    let variable = Some(self.real_names[place].clone());
                    targets.push(Target {
                        source: self.sources[place],
                        ..Target::of(format!("v[{place}] ="), node, Kind::Real, variable)
                    });
                }
            }
            for place in variables.integers(section) {
                let node = recording.integers[place];
                if !is_same(node, Leaf::Integer(place as u32)) {
                    let variable = Some(self.integer_names[place].clone());
                    targets.push(Target::of(format!("n[{place}] ="), node, Kind::Whole, variable));
                }
            }
        }
        targets
    }

    /// A message or a refusal, in the names that users know.
    fn format_of(&self, note: &Note) -> MessageFormat {
        let variables = self.model.variables();
        match note {
            Note::Message { text, .. } => MessageFormat::of(&variables.named(text)),
            Note::Refusal { reason, .. } => MessageFormat::of(&variables.named(&reason.to_string())),
        }
    }
}
