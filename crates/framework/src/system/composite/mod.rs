//! A connection of systems is a system: parts, each with a slice of every section of one flat block.
//!
//! A part is called with its own offsets into the block, so it doesn't know that it is one. Its real inputs lie in the
//! section of connected values, and are copied there from the outputs of other parts, in an order in which every value
//! is computed before it is used.

mod connection;
mod differences;
mod schedule;

use std::any::Any;
use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;

use super::declaration::Declaration;
use super::erased::{Compiled, DynSystem, Equations, Kind, Registry, read};
use super::names::Names;
use super::values::{Offsets, Values};
use super::{MessageLog, OwnStep, Point, Scalar, Section};
use crate::error::Invalid;
use crate::report::DesignReport;
use crate::scalar::of_part;
use differences::DifferenceCoordinates;
use schedule::Step;

/// The most parts of a composite.
const MOST_PARTS: usize = 1000;

/// Structure of a composite.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Structure {
    /// The systems that it consists of.
    parts: Vec<PartDescription>,
    /// Connections from an output to an input, as `part.variable[i]`.
    #[serde(default)]
    connections: Vec<(String, String)>,
}

/// A part, in the words of a description.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct PartDescription {
    /// Its name, which stands before those of its variables.
    name: String,
    /// Name of its kind of system.
    model: String,
    /// Structure of the part, on which its variables depend.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, serde_json::Value>"))]
    structure: toml::Table,
    /// Names of one's own for its variables.
    #[serde(default)]
    names: Names,
    /// Start values that differ from its own.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, serde_json::Value>"))]
    start: toml::Table,
    /// Usual magnitudes of its variables that differ from its own.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "std::collections::BTreeMap<String, serde_json::Value>"))]
    magnitudes: toml::Table,
}

/// A part, and where its values lie.
struct Part {
    name: Arc<str>,
    kind: Kind,
    system: Box<dyn DynSystem>,
    /// Begin of its values in the composite's sections.
    base: Offsets,
    /// Its event indicators among all.
    indicators: Range<usize>,
    /// Place of its own states among the connected values, if the composite integrates others in their place.
    own_states: Option<usize>,
}

impl Part {
    fn offsets(&self, whole: &Offsets) -> Offsets {
        let mut own = *whole;
        own.real.iter_mut().zip(&self.base.real).for_each(|(own, base)| *own += base);
        own.integer.iter_mut().zip(&self.base.integer).for_each(|(own, base)| *own += base);
        own.real[Section::Input as usize] = own.real[Section::Connected as usize];
        if let Some(place) = self.own_states {
            own.real[Section::State as usize] = whole.real[Section::Connected as usize] + place;
        }
        own
    }

    /// Calls the part with its own view of a point; messages and refusals get the part's name.
    fn with<S: Scalar, T>(&self, v: &mut Point<S>, call: impl FnOnce(&dyn DynSystem, &mut Point<S>) -> T) -> T {
        let offsets = self.offsets(v.offsets);
        let mut log = MessageLog::of_part(&self.name, v.log);
        let answer = call(self.system.as_ref(), &mut Point::new(v.reals, v.integers, &offsets, &mut log));
        v.log.take_over(log);
        answer
    }
}

/// A connection of systems.
struct Composite {
    parts: Vec<Part>,
    steps: Vec<Step>,
    differences: Vec<DifferenceCoordinates>,
}

/// Declares the parts of a composite, and connects them.
pub(super) fn declare(
    structure: toml::Table,
    registry: Registry,
    d: &mut Declaration,
) -> Result<Box<dyn DynSystem>, Invalid> {
    let structure: Structure = read(structure)?;
    if !(1..=MOST_PARTS).contains(&structure.parts.len()) {
        let allowed = format!("must be within 1 … {MOST_PARTS}");
        return Err(Invalid::new("[structure] number of parts", structure.parts.len(), allowed));
    }
    let mut parts = Vec::new();
    for part in &structure.parts {
        parts.push(declare_part(part, registry, d, &parts)?);
        d.check_so_far()?;
    }
    let links = connection::resolve(&structure.connections, &d.variables)?;
    d.variables.has_feedback = connection::has_feedback(&structure.connections);
    let open = connection::open_inputs(&links, d);
    let differences = differences::apply(&links, &mut parts, d);
    let links = differences::redirect(links, &parts, d).into_iter().chain(open).collect::<Vec<_>>();
    let steps = schedule::schedule(&links, &parts, d)?;
    let mut invalid = Invalid::none();
    for part in &structure.parts {
        for (name, value) in &part.start {
            let full = format!("{}.{name}", part.name);
            if let Err(reason) = d.variables.set_start(&full, value) {
                invalid.and(Invalid::new(format!("[start] {full}"), value, reason));
            }
        }
        for (name, value) in &part.magnitudes {
            let full = format!("{}.{name}", part.name);
            if let Err(reason) = d.variables.set_magnitude(&full, value) {
                invalid.and(Invalid::new(format!("[magnitudes] {full}"), value, reason));
            }
        }
    }
    invalid.into_result()?;
    Ok(Box::new(Composite { parts, steps, differences }))
}

/// Reports on the designs of a composite's parts, which take no communication steps.
pub(super) fn report(system: &dyn DynSystem, v: &Values<f64>, report: &mut DesignReport) {
    let Some(composite) = (system as &dyn Any).downcast_ref::<Composite>() else { return };
    report.step = 0.0;
    for part in &composite.parts {
        let own = Values { offsets: &part.offsets(v.offsets), ..*v };
        report.of_part(&part.name, |report| part.kind.report(part.system.as_ref(), &own, report));
    }
}

fn declare_part(
    part: &PartDescription,
    registry: Registry,
    d: &mut Declaration,
    before: &[Part],
) -> Result<Part, Invalid> {
    let name = &part.name;
    let identifier = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if !identifier {
        let allowed = "must be letters, digits and _, and not begin with a digit";
        return Err(Invalid::new("name of a part", format!("`{}`", name.escape_debug()), allowed));
    }
    if before.iter().any(|other| *other.name == **name) {
        return Err(Invalid::because(format!("two parts are named `{name}`")));
    }
    if part.model == Kind::COMPOSITE.name {
        return Err(Invalid::new(format!("model of `{name}`"), "`composite`", "a part can't be a composite itself"));
    }
    let kind = Kind::find(registry, &part.model).map_err(|invalid| invalid.within(name))?;
    d.note_shapes(&format!("{name}."), &part.start);
    let (system, base) = d.part(name, |d| kind.declare(part.structure.clone(), &part.names, registry, d));
    let system = system.map_err(|invalid| invalid.within(name))?;
    let indicators = before.last().map_or(0, |other| other.indicators.end)..d.variables.indicators.len();
    Ok(Part { name: name.as_str().into(), kind: *kind, system, base, indicators, own_states: None })
}

impl Composite {
    /// Calls every part, then takes over what it did to states of its own coordinates.
    fn each<S: Scalar>(&self, v: &mut Point<S>, mut call: impl FnMut(&Part, &mut Point<S>)) {
        self.give_own_states(v.reals, v.offsets);
        self.parts.iter().for_each(|part| call(part, v));
        self.take_own_states(v.reals, v.offsets);
    }
}

impl<S: Compiled> Equations<S> for Composite {
    /// Passes values on and evaluates parts in the order of the schedule.
    fn outputs(&self, t: S, reals: &mut [S], integers: &[S::Integer], whole: &Offsets) {
        self.give_own_states(reals, whole);
        for step in &self.steps {
            match *step {
                Step::Copy { from: (section, from), to } => {
                    reals[whole.real[Section::Connected as usize] + to] = reals[whole.real[section as usize] + from];
                }
                Step::Evaluate(part) => {
                    let part = &self.parts[part];
                    S::equations(part.system.as_ref()).outputs(t, reals, integers, &part.offsets(whole));
                }
            }
        }
    }

    fn derivatives(&self, t: S, reals: &mut [S], integers: &[S::Integer], whole: &Offsets) {
        for part in &self.parts {
            S::equations(part.system.as_ref()).derivatives(t, reals, integers, &part.offsets(whole));
        }
        let first = whole.real[Section::Derivative as usize];
        for (state, model_state) in self.differences.iter().flat_map(DifferenceCoordinates::pairs) {
            let rate = reals[first + model_state];
            reals[first + state] -= rate;
        }
    }

    /// A part may start from inputs that follow from the start of others: after as many rounds as there are parts, every
    /// value has gone round.
    fn initialise(&self, t: S, v: &mut Point<S>) {
        self.declared_own_states(v.reals, v.offsets);
        for round in 1..=self.parts.len() {
            let is_last = round == self.parts.len();
            for part in &self.parts {
                // Only what the last round refuses is refused: before, inputs may not have gone round.
                let mut unheard = MessageLog::unheard();
                let (offsets, log) = (v.offsets, if is_last { &mut *v.log } else { &mut unheard });
                let mut v = Point::new(v.reals, v.integers, offsets, log);
                part.with(&mut v, |system, v| S::equations(system).initialise(t, v));
            }
            self.take_own_states(v.reals, v.offsets);
            self.outputs(t, v.reals, v.integers, v.offsets);
        }
    }

    fn relate(&self, v: &mut Point<S>) {
        self.parts.iter().for_each(|part| part.with(v, |system, v| S::equations(system).relate(v)));
    }

    fn parameters_changed(&self, t: S, v: &mut Point<S>) {
        self.each(v, |part, v| part.with(v, |system, v| S::equations(system).parameters_changed(t, v)));
    }

    fn check(&self, t: S, v: &mut Point<S>) {
        self.parts.iter().for_each(|part| part.with(v, |system, v| S::equations(system).check(t, v)));
    }

    fn next_time_event(&self, v: &Values<S>) -> S {
        let next = |part: &Part| {
            let own = Values { offsets: &part.offsets(v.offsets), ..*v };
            S::equations(part.system.as_ref()).next_time_event(&own)
        };
        // One that isn't a number shows, whatever the others are.
        let earlier = |a: S, b: S| S::select(!a.equals(a) | a.at_most(b), a, b);
        self.parts.iter().map(next).reduce(earlier).unwrap_or(S::from(f64::INFINITY))
    }

    fn event_indicators(&self, t: S, v: &Values<S>, z: &mut [S]) {
        for part in &self.parts {
            let own = Values { offsets: &part.offsets(v.offsets), ..*v };
            S::equations(part.system.as_ref()).event_indicators(t, &own, &mut z[part.indicators.clone()]);
        }
    }

    /// Calls only the parts whose event it is.
    fn event(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        self.each(v, |part, v| {
            let crossed = &crossed[part.indicators.clone()];
            part.with(v, |system, v| {
                let system = S::equations(system);
                let due = system.next_time_event(&v.values()).at_most(t);
                let its_own = crossed.iter().fold(due, |any, &one| any | one);
                v.when(its_own, |v| system.event(t, crossed, v));
            });
        });
    }

    /// No part holds the inputs that it has from others.
    fn step_completed(&self, t: S, _step: S, v: &mut Point<S>) {
        let none = S::from(0.0);
        self.each(v, |part, v| part.with(v, |system, v| S::equations(system).step_completed(t, none, v)));
    }
}

impl DynSystem for Composite {
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        let mut invalid = Invalid::none();
        for part in &self.parts {
            if let Err(reasons) = part.with(v, |system, v| system.prepare(v)) {
                invalid.and(reasons.reworded(|reason| of_part(reason, &part.name)));
            }
        }
        invalid.into_result()
    }

    /// A part's own way through a step holds its inputs; the whole is integrated together.
    fn own_step(&self) -> Option<&dyn OwnStep> {
        None
    }
}
