//! How a system declares its variables: each once, with everything that anybody needs to know about it.

use std::marker::PhantomData;

use super::spec::{DiscreteSpec, Shape, Spec};
use super::values::{BooleanOf, Choice, ChoiceOf, Class, Handle, IntegerOf, class};
use super::variable::{Causality, Data, Dependence, Naming, Section, Variability, Variable, Variables};
use crate::error::Invalid;

/// The handle that belongs to a discrete value's type.
pub trait DiscreteValue {
    /// The handle's type.
    type Handle<C: Class>;
    /// The handle of a value at a place.
    fn handle<C: Class>(start: usize) -> Self::Handle<C>;
}

impl DiscreteValue for i32 {
    type Handle<C: Class> = IntegerOf<C>;
    fn handle<C: Class>(start: usize) -> IntegerOf<C> {
        IntegerOf { start, class: PhantomData }
    }
}

impl DiscreteValue for bool {
    type Handle<C: Class> = BooleanOf<C>;
    fn handle<C: Class>(start: usize) -> BooleanOf<C> {
        BooleanOf { start, class: PhantomData }
    }
}

impl<E: Choice> DiscreteValue for E {
    type Handle<C: Class> = ChoiceOf<C, E>;
    fn handle<C: Class>(start: usize) -> ChoiceOf<C, E> {
        ChoiceOf { start, class: PhantomData }
    }
}

/// What can be declared: a real variable, an integer, a Boolean or a choice.
pub trait Declarable {
    /// The handle's type.
    type Handle<C: Class>;
    /// Adds it to the declaration.
    fn declare<C: Class>(self, d: &mut Declaration) -> Self::Handle<C>;
    /// With this role, unless it was given another.
    fn role(self, causality: Causality) -> Self;
}

impl<D: Shape> Declarable for Spec<D> {
    type Handle<C: Class> = D::Handle<C>;

    fn role(mut self, causality: Causality) -> Self {
        self.causality.get_or_insert(causality);
        self
    }

    fn declare<C: Class>(self, d: &mut Declaration) -> D::Handle<C> {
        let naming = self.shape.naming();
        let data = Data::Real {
            start: self.start,
            unit: self.unit,
            min: self.min,
            above_min: self.above_min,
            max: self.max,
            nominal: self.nominal,
        };
        let start = d.add::<C>(self.name, self.description, naming, self.causality, self.fixed, data);
        self.shape.handle(start)
    }
}

impl<T: DiscreteValue> Declarable for DiscreteSpec<T> {
    type Handle<C: Class> = T::Handle<C>;

    fn role(mut self, causality: Causality) -> Self {
        self.causality.get_or_insert(causality);
        self
    }

    fn declare<C: Class>(self, d: &mut Declaration) -> T::Handle<C> {
        let description = vec![self.description];
        T::handle(d.add::<C>(self.name, description, Naming::Scalar, self.causality, self.fixed, self.data))
    }
}

/// Handle of a warning: a message that is given once a simulation, in a log category of its own.
#[derive(Debug, Clone, Copy)]
pub struct Warning {
    pub(super) flag: usize,
    pub(super) category: &'static str,
}

/// Collects the variables of a system.
#[derive(Debug, Default)]
pub struct Declaration {
    variables: Variables,
    problems: Invalid,
}

impl Declaration {
    /// A parameter: tunable, unless [`Spec::fixed`].
    pub fn parameter<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Parameter> {
        spec.role(Causality::Parameter).declare(self)
    }

    /// A quantity computed from parameters by `prepare`, shown as a local variable.
    pub fn prepared<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Prepared> {
        spec.role(Causality::Local).declare(self)
    }

    /// An input.
    pub fn input<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Input> {
        spec.role(Causality::Input).declare(self)
    }

    /// A continuous state: a local variable, unless [`Spec::output`]. Its derivative `der(name)` goes with it.
    pub fn state<D: Shape>(&mut self, spec: Spec<D>) -> D::Handle<class::State> {
        let rates = Spec {
            description: spec.description.iter().map(|text| format!("time derivative of: {text}")).collect(),
            causality: Some(Causality::Local),
            unit: spec.unit.iter().map(|unit| super::Unit::per_second(unit)).collect(),
            start: vec![0.0],
            min: None,
            max: None,
            nominal: vec![1.0],
            ..spec.clone()
        };
        let state = spec.role(Causality::Local).declare(self);
        rates.declare::<class::Derivative>(self);
        state
    }

    /// A variable that changes at events (and in `step_completed`) only; local, unless [`Spec::output`].
    pub fn discrete<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Discrete> {
        spec.role(Causality::Local).declare(self)
    }

    /// An output, written by `outputs`.
    pub fn output<D: Shape>(&mut self, spec: Spec<D>) -> D::Handle<class::Signal> {
        spec.role(Causality::Output).declare(self)
    }

    /// A local signal for inspection, written by `outputs`.
    pub fn local<D: Shape>(&mut self, spec: Spec<D>) -> D::Handle<class::Signal> {
        spec.role(Causality::Local).declare(self)
    }

    /// Memory of the simulation itself, not of the system.
    pub(crate) fn memory<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Memory> {
        spec.role(Causality::Hidden).declare(self)
    }

    /// A log category for what is out of the system's own assumptions, as in `logProjection`.
    pub fn warning(&mut self, category: &'static str, description: &'static str) -> Warning {
        self.variables.warnings.push((category, description));
        Warning { flag: self.integer_memory(1), category }
    }

    /// Declares all that signals or derivatives depend on, among inputs and states. Where nothing is declared,
    /// tools are told that everything may matter.
    ///
    /// # Panics
    /// When `of` isn't a signal or a derivative, or `on` not an input or a state.
    pub fn depends(&mut self, of: impl Handle, on: &[&dyn Handle]) {
        let on: Vec<_> = on.iter().map(|handle| handle.span()).collect();
        assert!(matches!(of.span().section, Section::Signal | Section::Derivative), "only these depend on anything");
        assert!(on.iter().all(|span| matches!(span.section, Section::Input | Section::State)), "inputs and states");
        self.variables.dependence.push(Dependence { of: of.span(), on });
    }

    /// Integers of the simulation itself; the first one's place.
    pub(crate) fn integer_memory(&mut self, len: usize) -> usize {
        let size = &mut self.variables.integer_sizes[Section::Memory as usize];
        std::mem::replace(size, *size + len)
    }

    /// Number of values declared so far in a section of reals.
    pub(crate) fn size(&self, section: Section) -> usize {
        self.variables.real_sizes[section as usize]
    }

    /// Number of integers declared so far in a section.
    pub(crate) fn integer_size(&self, section: Section) -> usize {
        self.variables.integer_sizes[section as usize]
    }

    /// The variables, all sizes fixed.
    ///
    /// # Errors
    /// [`Invalid`] with what is wrong in the declaration itself.
    pub(crate) fn finish(mut self) -> Result<Variables, Invalid> {
        self.problems.into_result()?;
        self.variables.finish();
        Ok(self.variables)
    }

    fn add<C: Class>(
        &mut self,
        name: String,
        description: Vec<String>,
        naming: Naming,
        causality: Option<Causality>,
        fixed: bool,
        data: Data,
    ) -> usize {
        let section = C::SECTION;
        let real = matches!(data, Data::Real { .. });
        let variability = match section {
            Section::Parameter if fixed => Variability::Fixed,
            Section::Parameter | Section::Prepared => Variability::Tunable,
            Section::Input if real => Variability::Continuous,
            Section::Input | Section::Discrete | Section::Memory => Variability::Discrete,
            Section::State | Section::Signal | Section::Derivative => Variability::Continuous,
        };
        let sizes = if real { &mut self.variables.real_sizes } else { &mut self.variables.integer_sizes };
        let start = sizes[section as usize];
        let causality = causality.unwrap_or(Causality::Local);
        let variable = Variable { name, description, section, start, naming, causality, variability, data };
        sizes[section as usize] += variable.len();
        self.check(&variable);
        self.variables.list.push(variable);
        start
    }

    /// Mistakes of a model's author, or sizes of zero from a description.
    fn check(&mut self, variable: &Variable) {
        let name = &variable.name;
        if variable.is_empty() {
            self.problems.and(Invalid::because(format!("`{name}` would have no element: a size is 0")));
        }
        // A derivative has the name of its state, and shows it as `der(…)`.
        let rate = |v: &Variable| v.section == Section::Derivative;
        if self.variables.list.iter().any(|other| other.name == *name && rate(other) == rate(variable)) {
            self.problems.and(Invalid::because(format!("two variables are named `{name}`")));
        }
        if variable.section == Section::State && variable.causality == Causality::Hidden {
            self.problems
                .and(Invalid::because(format!("`{name}` is a state: masters must see it, it can't be hidden")));
        }
        if let Data::Choice { items, type_name, .. } = &variable.data {
            let same_type =
                |v: &&Variable| matches!(&v.data, Data::Choice { type_name: other, .. } if other == type_name);
            let other = self.variables.list.iter().find(same_type).map(|v| &v.data);
            if other.is_some_and(|other| !matches!(other, Data::Choice { items: others, .. } if others == items)) {
                self.problems.and(Invalid::because(format!("two types are named `{type_name}`, but have other items")));
            }
            let repeated =
                items.iter().enumerate().find(|(k, (name, _))| items[..*k].iter().any(|(other, _)| other == name));
            if let Some((_, (item, _))) = repeated {
                self.problems.and(Invalid::because(format!("`{name}` has two items named `{item}`")));
            }
            if items.iter().any(|(name, _)| name.trim().is_empty()) {
                self.problems.and(Invalid::because(format!("`{name}` has an item without a name")));
            }
        }
        if let Data::Real { start, unit, nominal, .. } = &variable.data {
            let fits = |len: usize| len == 1 || len == variable.len();
            if !(fits(start.len()) && fits(unit.len()) && fits(nominal.len()) && fits(variable.description.len())) {
                let reason = format!("`{name}` has {} elements, but another number of entries", variable.len());
                self.problems.and(Invalid::because(reason));
            }
            for unit in unit.iter().filter(|unit| !unit.is_empty() && super::Unit::known(unit).is_none()) {
                self.problems.and(Invalid::new(format!("unit of `{name}`"), unit, "not a known unit"));
            }
        }
    }
}
