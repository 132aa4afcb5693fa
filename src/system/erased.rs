//! The same system behind an object-safe interface: equations compiled for `f64` and for dual numbers.

use std::marker::PhantomData;

use num_dual::Dual64;
use serde::de::DeserializeOwned;

use super::names::{self, Names};
use super::renamed::Renamed;
use super::values::{Offsets, Values, Written};
use super::{Declaration, ErrorEstimate, Point, Scalar, Section, Stride, System};
use crate::error::Invalid;
use crate::report::DesignReport;

/// A [`System`] whose type was erased. Every `System` is one.
pub trait DynSystem: Send + Sync {
    /// Number of event indicators.
    fn indicators(&self) -> usize;
    /// See [`System::indicator_name`].
    fn indicator_name(&self, indicator: usize) -> String;
    /// See [`System::prepare`].
    ///
    /// # Errors
    /// As there.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid>;
    /// See [`System::initialise`].
    ///
    /// # Errors
    /// As there.
    fn initialise(&self, t: f64, v: &mut Point) -> Result<(), Invalid>;
    /// See [`System::parameters_changed`].
    fn parameters_changed(&self, t: f64, v: &mut Point);
    /// Writes the signals of a block of numbers.
    fn outputs(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets);
    /// Writes the derivatives of a block of numbers, whose signals stand.
    fn derivatives(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets);
    /// Writes both: one call through a table instead of two, which small systems feel.
    fn evaluate(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets) {
        self.outputs(t, reals, integers, offsets);
        self.derivatives(t, reals, integers, offsets);
    }
    /// `outputs` of a block of dual numbers.
    fn outputs_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets);
    /// `derivatives` of a block of dual numbers.
    fn derivatives_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets);
    /// See [`System::check`].
    ///
    /// # Errors
    /// As there.
    fn check(&self, t: f64, v: &Values<f64>) -> Result<(), Invalid>;
    /// See [`System::next_time_event`].
    fn next_time_event(&self, v: &Values<f64>) -> Option<f64>;
    /// See [`System::event_indicators`].
    fn event_indicators(&self, t: f64, v: &Values<f64>, z: &mut [f64]);
    /// See [`System::event`].
    fn event(&self, t: f64, crossed: &[bool], v: &mut Point);
    /// See [`System::step_completed`].
    fn step_completed(&self, t: f64, step: f64, v: &mut Point);
    /// See [`System::report`].
    fn report(&self, v: &Values<f64>, report: &mut DesignReport);
    /// See [`System::steps_itself`].
    fn steps_itself(&self) -> bool;
    /// See [`System::workspace`].
    fn workspace(&self) -> usize;
    /// See [`System::advance`].
    fn advance(&self, stride: Stride, v: &mut Point) -> bool;
    /// See [`System::own_step_pays`].
    fn own_step_pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool;
    /// See [`System::conclude`].
    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate;
}

fn outputs<M: System, S: Scalar>(system: &M, t: S, reals: &mut [S], integers: &[i32], offsets: &Offsets) {
    let (known, section) = reals.split_at_mut(offsets.real[Section::Signal as usize]);
    let v = Values { reals: known, integers, offsets };
    system.outputs(t, &v, &mut Written { section, class: PhantomData });
}

fn derivatives<M: System, S: Scalar>(system: &M, t: S, reals: &mut [S], integers: &[i32], offsets: &Offsets) {
    let (known, section) = reals.split_at_mut(offsets.real[Section::Derivative as usize]);
    let v = Values { reals: known, integers, offsets };
    system.derivatives(t, &v, &mut Written { section, class: PhantomData });
}

impl<M: System> DynSystem for M {
    fn indicators(&self) -> usize {
        System::indicators(self)
    }
    fn indicator_name(&self, indicator: usize) -> String {
        System::indicator_name(self, indicator)
    }
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        System::prepare(self, v)
    }
    fn initialise(&self, t: f64, v: &mut Point) -> Result<(), Invalid> {
        System::initialise(self, t, v)
    }
    fn parameters_changed(&self, t: f64, v: &mut Point) {
        System::parameters_changed(self, t, v);
    }
    fn outputs(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets) {
        outputs(self, t, reals, integers, offsets);
    }
    fn derivatives(&self, t: f64, reals: &mut [f64], integers: &[i32], offsets: &Offsets) {
        derivatives(self, t, reals, integers, offsets);
    }
    fn outputs_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets) {
        outputs(self, t, reals, integers, offsets);
    }
    fn derivatives_dual(&self, t: Dual64, reals: &mut [Dual64], integers: &[i32], offsets: &Offsets) {
        derivatives(self, t, reals, integers, offsets);
    }
    fn check(&self, t: f64, v: &Values<f64>) -> Result<(), Invalid> {
        System::check(self, t, v)
    }
    fn next_time_event(&self, v: &Values<f64>) -> Option<f64> {
        System::next_time_event(self, v)
    }
    fn event_indicators(&self, t: f64, v: &Values<f64>, z: &mut [f64]) {
        System::event_indicators(self, t, v, z);
    }
    fn event(&self, t: f64, crossed: &[bool], v: &mut Point) {
        System::event(self, t, crossed, v);
    }
    fn step_completed(&self, t: f64, step: f64, v: &mut Point) {
        System::step_completed(self, t, step, v);
    }
    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        System::report(self, v, report);
    }
    fn steps_itself(&self) -> bool {
        System::steps_itself(self)
    }
    fn workspace(&self) -> usize {
        System::workspace(self)
    }
    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        System::advance(self, stride, v)
    }
    fn own_step_pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        System::own_step_pays(self, h, relative_tolerance, v)
    }
    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        System::conclude(self, whole, tolerance, v)
    }
}

type DeclareFunction = fn(toml::Table, Registry, &mut Declaration) -> Result<Box<dyn DynSystem>, Invalid>;

/// A kind of system that a library knows how to make from a description.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Its [`System::NAME`].
    pub name: &'static str,
    /// Its [`System::DOCUMENTATION`].
    pub documentation: &'static str,
    declare: DeclareFunction,
}

/// The kinds of a library.
pub type Registry = &'static [Kind];

impl Kind {
    /// The kind of a system.
    pub const fn of<M: System>() -> Kind {
        Kind { name: M::NAME, documentation: M::DOCUMENTATION, declare: declare::<M> }
    }

    /// The kind that connects systems of other kinds: a whole loop as one system.
    pub const COMPOSITE: Kind = Kind {
        name: "composite",
        documentation: include_str!("../../docs/composite.md"),
        declare: super::composite::declare,
    };

    /// Whether no two kinds have the same name.
    #[doc(hidden)]
    pub const fn have_different_names(kinds: &[Kind]) -> bool {
        let mut k = 0;
        while k < kinds.len() {
            let mut other = 0;
            while other < k {
                if same(kinds[k].name.as_bytes(), kinds[other].name.as_bytes()) {
                    return false;
                }
                other += 1;
            }
            k += 1;
        }
        true
    }

    /// The kind of this name.
    ///
    /// # Errors
    /// [`Invalid`] with the names that there are.
    pub fn find<'a>(registry: &'a [Kind], name: &str) -> Result<&'a Kind, Invalid> {
        registry.iter().find(|kind| kind.name == name).ok_or_else(|| {
            let known: Vec<_> = registry.iter().map(|kind| kind.name).collect();
            Invalid::new("model", format!("`{name}`"), format!("must be one of {}", known.join(", ")))
        })
    }

    /// Declares its variables for a structure, under the user's names; the registry is where a composite finds its parts.
    ///
    /// # Errors
    /// [`Invalid`] for keys that don't exist, are missing, of a wrong type, or contradict each other.
    pub fn declare(
        &self,
        structure: toml::Table,
        names: &Names,
        registry: Registry,
        d: &mut Declaration,
    ) -> Result<Box<dyn DynSystem>, Invalid> {
        d.document(self.documentation);
        let (first, part) = d.declared();
        let system = (self.declare)(structure, registry, d)?;
        if names.is_empty() {
            return Ok(system);
        }
        let translation = names::apply(names, first, part.as_deref(), d)?;
        Ok(Box::new(Renamed { system, translation }))
    }
}

/// Whether two texts are equal, when compiling.
const fn same(one: &[u8], other: &[u8]) -> bool {
    let mut equal = 0;
    while equal < one.len() && equal < other.len() && one[equal] == other[equal] {
        equal += 1;
    }
    equal == one.len() && equal == other.len()
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Kind({})", self.name)
    }
}

fn declare<M: System>(structure: toml::Table, _: Registry, d: &mut Declaration) -> Result<Box<dyn DynSystem>, Invalid> {
    let structure = read::<M::Structure>(structure)?;
    Ok(Box::new(M::declare(structure, d)?))
}

pub(super) fn read<T: DeserializeOwned>(structure: toml::Table) -> Result<T, Invalid> {
    toml::Value::Table(structure)
        .try_into()
        .map_err(|error: toml::de::Error| Invalid::because(format!("[structure]: {error}")))
}
