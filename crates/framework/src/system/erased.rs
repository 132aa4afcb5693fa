//! The same system behind an object-safe interface: its equations compiled for every scalar that they are evaluated over.

use std::any::Any;
use std::marker::PhantomData;

use serde::de::DeserializeOwned;

use super::names::{self, Names};
use super::values::{Offsets, Values, Written};
use super::{Declaration, OwnStep, Point, Scalar, Section, Size, System};
use crate::error::Invalid;
use crate::near;
use crate::recording::Recorded;
use crate::report::DesignReport;

/// The equations of a system over one scalar.
pub trait Equations<S: Scalar> {
    /// Writes the signals of a block.
    fn outputs(&self, t: S, reals: &mut [S], integers: &[S::Integer], offsets: &Offsets);
    /// Writes the derivatives of a block whose signals stand.
    fn derivatives(&self, t: S, reals: &mut [S], integers: &[S::Integer], offsets: &Offsets);
    /// Writes both: one call through a table instead of two, which small systems feel.
    fn evaluate(&self, t: S, reals: &mut [S], integers: &[S::Integer], offsets: &Offsets) {
        self.outputs(t, reals, integers, offsets);
        self.derivatives(t, reals, integers, offsets);
    }
    /// See [`System::initialise`].
    fn initialise(&self, t: S, v: &mut Point<S>);
    /// See [`System::relate`].
    fn relate(&self, v: &mut Point<S>);
    /// See [`System::parameters_changed`].
    fn parameters_changed(&self, t: S, v: &mut Point<S>);
    /// See [`System::check`].
    fn check(&self, t: S, v: &mut Point<S>);
    /// See [`System::next_time_event`].
    fn next_time_event(&self, v: &Values<S>) -> S;
    /// See [`System::event_indicators`].
    fn event_indicators(&self, t: S, v: &Values<S>, z: &mut [S]);
    /// See [`System::event`].
    fn event(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>);
    /// See [`System::step_completed`].
    fn step_completed(&self, t: S, step: S, v: &mut Point<S>);
}

/// A [`System`] whose type was erased, over numbers and recordings. Every `System` is one.
pub trait DynSystem: Equations<f64> + Equations<Recorded> + Any + Send + Sync {
    /// See [`System::prepare`].
    ///
    /// # Errors
    /// As there.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid>;
    /// See [`System::own_step`].
    fn own_step(&self) -> Option<&dyn OwnStep>;
}

/// A scalar that equations are compiled for.
pub trait Compiled: Scalar {
    /// The equations of a system over it.
    fn equations(system: &dyn DynSystem) -> &dyn Equations<Self>;
}

impl Compiled for f64 {
    fn equations(system: &dyn DynSystem) -> &dyn Equations<f64> {
        system
    }
}

impl Compiled for Recorded {
    fn equations(system: &dyn DynSystem) -> &dyn Equations<Recorded> {
        system
    }
}

impl<M: System, S: Scalar> Equations<S> for M {
    fn outputs(&self, t: S, reals: &mut [S], integers: &[S::Integer], offsets: &Offsets) {
        let (known, section) = reals.split_at_mut(offsets.real[Section::Signal as usize]);
        let v = Values { reals: known, integers, offsets };
        System::outputs(self, t, &v, &mut Written { section, class: PhantomData });
    }
    fn derivatives(&self, t: S, reals: &mut [S], integers: &[S::Integer], offsets: &Offsets) {
        let (known, section) = reals.split_at_mut(offsets.real[Section::Derivative as usize]);
        let v = Values { reals: known, integers, offsets };
        System::derivatives(self, t, &v, &mut Written { section, class: PhantomData });
    }
    fn initialise(&self, t: S, v: &mut Point<S>) {
        System::initialise(self, t, v);
    }
    fn relate(&self, v: &mut Point<S>) {
        System::relate(self, v);
    }
    fn parameters_changed(&self, t: S, v: &mut Point<S>) {
        System::parameters_changed(self, t, v);
    }
    fn check(&self, t: S, v: &mut Point<S>) {
        System::check(self, t, v);
    }
    fn next_time_event(&self, v: &Values<S>) -> S {
        System::next_time_event(self, v)
    }
    fn event_indicators(&self, t: S, v: &Values<S>, z: &mut [S]) {
        System::event_indicators(self, t, v, z);
    }
    fn event(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        System::event(self, t, crossed, v);
    }
    fn step_completed(&self, t: S, step: S, v: &mut Point<S>) {
        System::step_completed(self, t, step, v);
    }
}

impl<M: System> DynSystem for M {
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        System::prepare(self, v)
    }
    fn own_step(&self) -> Option<&dyn OwnStep> {
        System::own_step(self)
    }
}

/// Reports on the design of a system of a kind.
pub(super) type ReportFunction = fn(&dyn DynSystem, &Values<f64>, &mut DesignReport);
type DeclareFunction = fn(toml::Table, Registry, &mut Declaration) -> Result<Box<dyn DynSystem>, Invalid>;
type SizesFunction = fn(toml::Table) -> Vec<Size>;
type ResizedFunction = fn(toml::Table, &[usize], &mut Declaration) -> Result<Resized, Invalid>;

/// A system of other sizes than those of its structure, and the start values that these bring with them.
type Resized = (Box<dyn DynSystem>, toml::Table);

/// A kind of system that a library knows how to make from a description.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Its [`System::NAME`].
    pub name: &'static str,
    /// Its [`System::DOCUMENTATION`].
    pub documentation: &'static str,
    declare: DeclareFunction,
    sizes: SizesFunction,
    resized: ResizedFunction,
    report: Option<ReportFunction>,
}

/// The kinds of a library.
pub type Registry = &'static [Kind];

impl Kind {
    /// The kind of a system.
    pub const fn of<M: System>() -> Kind {
        Kind {
            name: M::NAME,
            documentation: M::DOCUMENTATION,
            declare: declare::<M>,
            sizes: sizes::<M>,
            resized: resized::<M>,
            report: Some(report::<M>),
        }
    }

    /// The kind that connects systems of other kinds: a composite.
    pub const COMPOSITE: Kind = Kind {
        name: "composite",
        documentation: include_str!("composite.md"),
        declare: super::composite::declare,
        sizes: |_| Vec::new(),
        resized: |_, _, _| Err(Invalid::because("the sizes of a composite are fixed")),
        report: Some(super::composite::report),
    };

    /// The kind as a library in an FMU needs it: without its page and its design report, which the program has. The linker
    /// leaves out what nothing refers to.
    pub const fn in_fmu(self) -> Kind {
        Kind { documentation: "", report: None, ..self }
    }

    /// True if no two kinds have the same name.
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
            let choice = near::choice(name, &known, "`adaptive-fmu list`");
            Invalid::new("model", format!("`{name}`"), format!("there is no such kind; {choice}"))
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
        names::apply(names, first, part.as_deref(), d)?;
        Ok(system)
    }

    /// Reports on the design of one of its systems; nothing in an FMU.
    pub(crate) fn report(&self, system: &dyn DynSystem, v: &Values<f64>, report: &mut DesignReport) {
        if let Some(function) = self.report {
            function(system, v, report);
        }
    }

    /// Sizes of a structure that can change.
    pub(crate) fn sizes(&self, structure: toml::Table) -> Vec<Size> {
        (self.sizes)(structure)
    }

    /// Declares its variables with these values of its sizes.
    ///
    /// # Errors
    /// As [`Kind::declare`], and for sizes that don't fit each other.
    pub(crate) fn declare_resized(
        &self,
        structure: toml::Table,
        sizes: &[usize],
        names: &Names,
        d: &mut Declaration,
    ) -> Result<Resized, Invalid> {
        let resized = (self.resized)(structure, sizes, d)?;
        names::apply(names, 0, None, d)?;
        Ok(resized)
    }
}

/// True if two texts are equal, when compiling.
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

fn sizes<M: System>(structure: toml::Table) -> Vec<Size> {
    read::<M::Structure>(structure).map_or(Vec::new(), |structure| M::sizes(&structure))
}

fn resized<M: System>(structure: toml::Table, sizes: &[usize], d: &mut Declaration) -> Result<Resized, Invalid> {
    let mut structure = read::<M::Structure>(structure)?;
    let start = M::resize(&mut structure, sizes);
    Ok((Box::new(M::declare(structure, d)?), start))
}

fn report<M: System>(system: &dyn DynSystem, v: &Values<f64>, report: &mut DesignReport) {
    if let Some(system) = (system as &dyn Any).downcast_ref::<M>() {
        system.report(v, report);
    }
}

pub(super) fn read<T: DeserializeOwned>(structure: toml::Table) -> Result<T, Invalid> {
    toml::Value::Table(structure).try_into().map_err(|error: toml::de::Error| {
        // The key has a line of its own.
        let shown = error.to_string();
        let key = shown.lines().find(|line| line.starts_with("in `")).map_or(String::new(), |key| format!(", {key}"));
        Invalid::because(format!("[structure]: {}{key}", near::reworded(error.message())))
    })
}
