//! Declaration of a system's variables: each once, with everything that anybody needs to know about it.

use std::collections::HashSet;
use std::marker::PhantomData;

use super::clock::SamplingClock;
use super::spec::{DiscreteSpec, Many, Shape, Spec, boolean, vector};
use super::values::{
    BooleanOf, Choice, ChoiceOf, Class, DifferenceOf, Handle, IntegerOf, Offsets, ScalarOf, Span, VectorOf, class,
};
use super::variable::{Causality, Data, Naming, Section, Shown, Variability, Variable, Variables};
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

/// A variable that can be declared: real, integer, Boolean or choice.
pub trait Declarable {
    /// The handle's type.
    type Handle<C: Class>;
    /// Adds it to the declaration.
    fn declare<C: Class>(self, d: &mut Declaration) -> Self::Handle<C>;
    /// Gives it this role, unless it was given another.
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
        let about = (self.description, self.source, self.shown);
        let start = d.add::<C>(self.name, about, naming, self.causality, self.fixed, data);
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
        let about = (vec![self.description], "", Shown::default());
        T::handle(d.add::<C>(self.name, about, Naming::Scalar, self.causality, self.fixed, self.data))
    }
}

/// Handle of a warning: a message that is given once a simulation, in a log category of its own.
#[derive(Debug, Clone, Copy)]
pub struct Warning {
    pub(super) flag: usize,
    pub(super) category: &'static str,
}

/// A difference that a part declared, at places counted from the beginning of each section.
#[derive(Debug, Clone, Copy)]
pub(super) struct Difference {
    pub(super) x: Span,
    pub(super) x_m: Span,
    pub(super) passed: Span,
    /// Place of the flag by which the part knows that the difference is passed.
    pub(super) is_passed: usize,
    pub(super) nominal: f64,
}

/// The most numbers that one instance may hold, and of them the most that are shown outside.
pub(super) const MOST_VALUES: usize = 4_000_000;
const MOST_SHOWN: usize = 200_000;

/// Collects the variables of a system.
#[derive(Debug, Default)]
pub struct Declaration {
    pub(super) variables: Variables,
    pub(super) problems: Invalid,
    pub(super) differences: Vec<Difference>,
    /// Names of variables, and whether they are derivatives: these have the names of their states.
    names: HashSet<(String, bool)>,
    /// Numbers that are shown outside.
    shown: usize,
    /// True if there were more than one instance may hold.
    full: bool,
    /// Documentation of the systems, each once.
    documentation: Vec<&'static str>,
    /// The part that is being declared, in a composite.
    part: Option<Part>,
    /// Variables whose start values a description gives as matrices, with their parts' names in front.
    pub(super) matrices: HashSet<String>,
}

/// A part's name, and where its values begin.
#[derive(Debug)]
struct Part {
    name: String,
    base: Offsets,
    /// Number of event indicators before it.
    indicators: usize,
}

impl Declaration {
    /// A parameter: tunable, unless [`Spec::fixed`].
    pub fn parameter<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Parameter> {
        spec.role(Causality::Parameter).declare(self)
    }

    /// A quantity computed from parameters by `prepare` or `relate`, shown as a local variable.
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

    /// A hidden signal behind the vector of outputs that was declared last: a control before its limits cut it. The error of
    /// what is cut is 0, and states behind it would drift, so that this one's counts in its place.
    pub fn behind_output(&mut self, spec: Spec<Many>) -> VectorOf<class::Signal> {
        let is_output = |v: &&Variable| v.section == Section::Signal && v.causality == Causality::Output;
        let output = self.variables.list.iter().rev().find(is_output).map(|output| (output.start, output.len()));
        let handle = self.local(spec.hidden());
        if let Some(signal) = self.variables.list.last_mut() {
            let fitting = output.filter(|&(_, len)| len == signal.len());
            signal.behind = Some(fitting.map_or(signal.start, |(start, _)| start));
        }
        handle
    }

    /// Memory of the simulation itself, not of the system.
    pub(crate) fn memory<V: Declarable>(&mut self, spec: V) -> V::Handle<class::Memory> {
        spec.role(Causality::Hidden).declare(self)
    }

    /// The difference e = x − x_m of an input and a state that follows it, or that it follows, read by
    /// [`super::Values::difference`]: e.g. an error against a reference model or that of an observer. If it is many
    /// orders of magnitude smaller than both (`nominal` is its magnitude, in their unit), a subtraction would leave
    /// rounding errors: a composite in which x is a state integrates e in its place.
    ///
    /// # Panics
    /// When they have different sizes.
    pub fn difference(&mut self, x: VectorOf<class::Input>, x_m: VectorOf<class::State>, nominal: f64) -> DifferenceOf {
        assert_eq!(x.len(), x_m.len(), "an input and a state whose difference is meant have the same size");
        let number = self.differences.len();
        let passed = vector(&format!("#difference {number}"), x.len(), "").hidden().declare::<class::Connected>(self);
        let is_passed =
            boolean(&format!("#difference {number} is passed"), "").hidden().declare::<class::Connected>(self);
        let (x_span, x_m_span) = (self.absolute(x.span()), self.absolute(x_m.span()));
        let is_passed_place = is_passed.start + self.base(Section::Connected, false);
        self.differences.push(Difference {
            x: x_span,
            x_m: x_m_span,
            passed: self.absolute(passed.span()),
            is_passed: is_passed_place,
            nominal,
        });
        DifferenceOf { x, x_m, passed, is_passed }
    }

    /// A log category for what is out of the system's own assumptions, as in `logProjection`.
    pub fn warning(&mut self, category: &'static str, description: &'static str) -> Warning {
        self.variables.warnings.push((category, description));
        Warning { flag: self.integer_memory(1), category }
    }

    /// True if the unit is stepped by a master of co-simulation, which holds its inputs meanwhile: false in model exchange,
    /// and for a part of a composite.
    pub fn is_stepped(&mut self) -> BooleanOf<class::Memory> {
        let start = self.integer_memory(1);
        if self.part.is_none() {
            self.variables.stepped = Some(start);
        } else {
            self.variables.never_stepped.push(start + self.base(Section::Memory, false));
        }
        BooleanOf { start, class: PhantomData }
    }

    /// The clock of a law that is sampled at `start` + k `period` + `shift`, where k − 1 samples were taken: C for targets counts
    /// calls in its place, so that no sample is lost in the rounding of time.
    pub fn sampling_clock(&mut self, clock: SamplingClock<ScalarOf<class::Discrete>>) {
        let place = |handle: ScalarOf<class::Discrete>| self.absolute(handle.span()).start;
        let clock = clock.map(place);
        self.variables.clocks.push(clock);
    }

    /// Event indicators, and what each watches ("height above the floor"), for messages; an empty text where it has no
    /// name. How many this system had before: where its [`super::System::event_indicators`] finds these.
    pub fn indicators<T: Into<String>>(&mut self, names: impl IntoIterator<Item = T>) -> usize {
        let before = self.variables.indicators.len() - self.part.as_ref().map_or(0, |part| part.indicators);
        let part = self.part.as_ref().map(|part| part.name.clone());
        for (k, name) in names.into_iter().enumerate() {
            let name = name.into();
            self.variables.indicators.push(match &part {
                Some(part) if name.is_empty() => format!("number {} of {part}", before + k + 1),
                Some(part) => format!("{part}: {name}"),
                None => name,
            });
        }
        before
    }

    /// Names to which a description may give start values without effect: parameters of another system, whose descriptions
    /// serve this one as well.
    pub fn without_effect<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) {
        let part = self.part.as_ref().map_or(String::new(), |part| format!("{}.", part.name));
        self.variables.without_effect.extend(names.into_iter().map(|name| format!("{part}{name}")));
    }

    /// Number of event indicators that were declared so far.
    pub(crate) fn indicator_count(&self) -> usize {
        self.variables.indicators.len()
    }

    /// Ends the system's own variables; those that every model has follow.
    pub(crate) fn begin_controls(&mut self) {
        self.variables.own = self.variables.list.len();
    }

    /// Declares a part of a composite: its names begin with the part's, its handles count from where the part begins,
    /// and its real inputs are connected ones. What the part's declaration gives, and where the part begins.
    pub(super) fn part<T>(&mut self, name: &str, declare: impl FnOnce(&mut Self) -> T) -> (T, Offsets) {
        let base = Offsets { real: self.variables.real_sizes, integer: self.variables.integer_sizes };
        let indicators = self.variables.indicators.len();
        self.part = Some(Part { name: name.to_owned(), base, indicators });
        let declared = declare(self);
        self.part = None;
        (declared, base)
    }

    /// Number of variables declared so far, and the name of the part that is being declared.
    pub(super) fn declared(&self) -> (usize, Option<String>) {
        (self.variables.list.len(), self.part.as_ref().map(|part| part.name.clone()))
    }

    /// Place of a handle's span in the whole section.
    fn absolute(&self, span: Span) -> Span {
        let section = self.section_of(span.section, true);
        Span { section, start: span.start + self.base(section, true), ..span }
    }

    /// A part's real inputs are connected; its discrete ones stay inputs.
    fn section_of(&self, section: Section, real: bool) -> Section {
        if section == Section::Input && real && self.part.is_some() { Section::Connected } else { section }
    }

    /// Begin of the part that is being declared in a section.
    fn base(&self, section: Section, real: bool) -> usize {
        let base = |part: &Part| if real { part.base.real } else { part.base.integer }[section as usize];
        self.part.as_ref().map_or(0, base)
    }

    /// Adds what a system is to the documentation.
    pub(super) fn document(&mut self, text: &'static str) {
        if !self.documentation.contains(&text) {
            self.documentation.push(text);
        }
    }

    /// Documentation of the system, and of every system in it.
    pub(crate) fn documentation(&self) -> String {
        self.documentation.join("\n\n")
    }

    /// Integers of the simulation itself; the first one's place.
    pub(crate) fn integer_memory(&mut self, len: usize) -> usize {
        let base = self.base(Section::Memory, false);
        let size = &mut self.variables.integer_sizes[Section::Memory as usize];
        std::mem::replace(size, *size + len) - base
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
        (description, source, shown): (Vec<String>, &'static str, Shown),
        naming: Naming,
        causality: Option<Causality>,
        fixed: bool,
        data: Data,
    ) -> usize {
        let real = matches!(data, Data::Real { .. });
        let section = self.section_of(C::SECTION, real);
        let variability = match section {
            Section::Parameter if fixed => Variability::Fixed,
            Section::Parameter | Section::Prepared => Variability::Tunable,
            Section::Input if real => Variability::Continuous,
            Section::Input | Section::Discrete | Section::Memory => Variability::Discrete,
            Section::Connected if !real => Variability::Discrete,
            Section::State | Section::Connected | Section::Signal | Section::Derivative => Variability::Continuous,
        };
        let causality = match causality {
            Some(Causality::Input) if section == Section::Connected => Causality::Local,
            other => other.unwrap_or(Causality::Local),
        };
        let name = self.part.as_ref().map_or(name.clone(), |part| format!("{}.{name}", part.name));
        let sizes = if real { &self.variables.real_sizes } else { &self.variables.integer_sizes };
        let start = sizes[section as usize];
        let given = Vec::new();
        let variable = Variable {
            name,
            given,
            description,
            shown,
            source,
            section,
            start,
            naming,
            causality,
            variability,
            behind: None,
            data,
        };
        if self.has_room(&variable) {
            let sizes = if real { &mut self.variables.real_sizes } else { &mut self.variables.integer_sizes };
            sizes[section as usize] += variable.len();
            self.check(&variable);
            self.variables.list.push(variable);
        }
        start - self.base(section, real)
    }

    /// True if a variable may be added. Sizes come from descriptions, so a size that is too large is refused before
    /// anything is allocated for it.
    fn has_room(&mut self, variable: &Variable) -> bool {
        let all = self.variables.real_sizes.iter().chain(&self.variables.integer_sizes).sum::<usize>();
        let shown = if variable.causality == Causality::Hidden { 0 } else { variable.len() };
        let most = if self.shown.saturating_add(shown) > MOST_SHOWN { MOST_SHOWN } else { MOST_VALUES };
        if !self.full && most == MOST_VALUES && all.saturating_add(variable.len()) <= MOST_VALUES {
            self.shown += shown;
            return true;
        }
        // Reported once: nothing else is added, so no later one is the reason.
        if !std::mem::replace(&mut self.full, true) {
            let (name, len) = (&variable.name, variable.len());
            let reason =
                format!("with `{name}`, of {len} numbers, there would be more than {most}: sizes must be smaller");
            self.problems.and(Invalid::because(reason));
        }
        false
    }

    /// # Errors
    /// What is wrong with the variables that were declared so far.
    pub(super) fn check_so_far(&self) -> Result<(), Invalid> {
        self.problems.clone().into_result()
    }

    /// Mistakes of a model's author, or sizes of zero from a description.
    fn check(&mut self, variable: &Variable) {
        let name = &variable.name;
        if variable.is_empty() {
            self.problems.and(Invalid::because(format!("`{name}` would have no element: a size is 0")));
        }
        // A derivative has the name of its state, and shows it as `der(…)`.
        let rate = variable.section == Section::Derivative;
        let given = |v: &Variable| {
            (v.section == Section::Derivative) == rate && v.given.iter().flatten().any(|own| own == name)
        };
        if !self.names.insert((name.clone(), rate)) || self.variables.list.iter().any(given) {
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
            for unit in unit.iter().filter(|unit| !super::Unit::is_text(unit)) {
                self.problems.and(Invalid::new(format!("unit of `{name}`"), unit, "can't be the text of a unit"));
            }
        }
    }
}

impl Variables {
    /// The clocks of sampled laws, by places among all reals.
    pub fn clocks(&self) -> impl Iterator<Item = SamplingClock<usize>> + '_ {
        let first = self.reals(Section::Discrete).start;
        self.clocks.iter().map(move |clock| clock.map(|place| first + place))
    }
}
