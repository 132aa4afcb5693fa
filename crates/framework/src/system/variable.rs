//! The declared variables of a system: the one list that getters, setters, the model description and messages read.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::OnceLock;

use serde::Serialize;

use super::Layout;
use super::clock::SamplingClock;
use super::values::Offsets;
use crate::error::Invalid;

/// The sections of the flat block, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
pub enum Section {
    /// Parameters.
    Parameter,
    /// Prepared from parameters.
    Prepared,
    /// Inputs.
    Input,
    /// Continuous states.
    State,
    /// Discrete variables.
    Discrete,
    /// Inputs of a composite's parts, each taken from an output of another part or from an input of the composite.
    Connected,
    /// Outputs and local signals.
    Signal,
    /// Derivatives of the states, in their order.
    Derivative,
    /// The simulation's own memory.
    Memory,
}

impl Section {
    /// Number of sections.
    pub const COUNT: usize = 9;
}

/// The role of a variable towards the outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Causality {
    /// Set by the user.
    Parameter,
    /// Comes from outside.
    Input,
    /// Gets connected.
    Output,
    /// Visible for inspection.
    Local,
    /// Never shown.
    Hidden,
}

/// Times at which a variable may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Variability {
    /// Never: a parameter that a unit was designed with.
    Constant,
    /// Changes before the simulation only.
    Fixed,
    /// Changes between communication steps, by the user.
    Tunable,
    /// Changes at events.
    Discrete,
    /// Always.
    Continuous,
}

/// Type and limits of a variable's values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Data {
    /// Real numbers with unit and limits, a value an element where there are several.
    Real {
        /// Start values.
        start: Vec<f64>,
        /// Units; one for all, or one an element.
        unit: Vec<&'static str>,
        /// Smallest value allowed.
        min: Option<f64>,
        /// True if `min` itself is excluded.
        above_min: bool,
        /// Largest value allowed.
        max: Option<f64>,
        /// Magnitudes: what an absolute tolerance is measured with; one for all, or one an element.
        nominal: Vec<f64>,
    },
    /// Integers.
    Integer {
        /// Start value.
        start: i32,
        /// Smallest and largest value allowed.
        limits: Option<(i32, i32)>,
    },
    /// True or false.
    Boolean {
        /// Start value.
        start: bool,
    },
    /// One of several named items, counted from 1.
    Choice {
        /// Name of the type.
        type_name: String,
        /// Names and descriptions.
        items: Vec<(String, String)>,
        /// Start value.
        start: i32,
    },
}

impl Data {
    /// True if a number, an integer, or an item by its number is within the limits.
    pub fn allows(&self, value: f64) -> bool {
        match self {
            Data::Real { min, above_min, max, .. } => {
                let too_small = min.is_some_and(|min| value < min || (*above_min && value <= min));
                !too_small && max.is_none_or(|max| value <= max) && value.is_finite()
            }
            Data::Boolean { .. } => value == 0.0 || value == 1.0,
            Data::Integer { .. } | Data::Choice { .. } => {
                let (least, most) = self.integers();
                (f64::from(least)..=f64::from(most)).contains(&value)
            }
        }
    }

    /// The least and the greatest of the integers that are stored for a value that is no real number.
    pub fn integers(&self) -> (i32, i32) {
        match self {
            Data::Boolean { .. } => (0, 1),
            Data::Choice { items, .. } => (1, items.len() as i32),
            Data::Integer { limits, .. } => limits.unwrap_or((i32::MIN, i32::MAX)),
            Data::Real { .. } => (i32::MIN, i32::MAX),
        }
    }
}

/// Naming of a variable's elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Naming {
    /// `name`
    Scalar,
    /// `name[i]`
    Vector(usize),
    /// `name[i,j]`
    Matrix(usize, usize),
    /// `name[i,i]`: a matrix that is diagonal by law.
    Diagonal(usize),
}

/// Display of a variable's values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Shown {
    /// True if [`NO_LIMIT`] means none.
    pub no_limit: bool,
    /// True if they are shown in their own unit, whatever unit for display that has: phases and angular frequencies.
    pub in_own_unit: bool,
}

/// The magnitude of a limit that is none: FMI needs a finite number.
pub const NO_LIMIT: f64 = 1e15;

/// End of the description of a variable for which [`NO_LIMIT`] means none.
pub const TELLS_NO_LIMIT: &str = " (1e15: no limit)";

/// A declared variable: a scalar, a vector or a matrix.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Variable {
    /// Name without indices.
    pub name: String,
    /// A user's own names of its elements, as they are stored; empty where none has one.
    pub given: Vec<Option<String>>,
    /// Description; one text for all, or one an element.
    pub description: Vec<String>,
    /// Display of its values.
    pub shown: Shown,
    /// Source of the equation of it, or of its rate; empty if none is given.
    #[serde(skip)]
    pub source: &'static str,
    /// Its class.
    pub section: Section,
    /// First place in its section.
    pub start: usize,
    /// Shape.
    pub naming: Naming,
    /// Role.
    pub causality: Causality,
    /// Times at which it changes.
    pub variability: Variability,
    /// Begin in its section of the output whose error a hidden signal's error counts as.
    #[serde(skip)]
    pub behind: Option<usize>,
    /// Type, start value, unit, limits.
    pub data: Data,
}

impl Variable {
    /// Number of elements.
    pub fn len(&self) -> usize {
        match self.naming {
            Naming::Scalar => 1,
            Naming::Vector(n) | Naming::Diagonal(n) => n,
            Naming::Matrix(rows, columns) => rows.saturating_mul(columns),
        }
    }

    /// Never: a declared variable has at least one element.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if integration controls its error in addition to those of states: a continuous output, or what counts as
    /// one.
    fn is_controlled(&self) -> bool {
        let is_continuous = self.section == Section::Signal && self.variability == Variability::Continuous;
        is_continuous && self.is_real() && (self.behind.is_some() || self.causality == Causality::Output)
    }

    /// True if its values are real numbers.
    pub fn is_real(&self) -> bool {
        matches!(self.data, Data::Real { .. })
    }

    /// Its elements, rows first.
    pub fn elements(&self) -> impl Iterator<Item = Element<'_>> {
        let rows = |k: usize, columns: usize, rows: usize| (k / columns) + (k % columns) * rows;
        (0..self.len()).map(move |k| match self.naming {
            Naming::Matrix(r, c) => Element { variable: self, offset: rows(k, c, r) },
            _ => Element { variable: self, offset: k },
        })
    }

    /// The element at a place of its storage.
    pub fn element(&self, offset: usize) -> Element<'_> {
        Element { variable: self, offset }
    }
}

/// One element of a declared variable.
#[derive(Debug, Clone, Copy)]
pub struct Element<'a> {
    /// The variable.
    pub variable: &'a Variable,
    /// Place among its elements, as they are stored.
    pub offset: usize,
}

impl<'a> Element<'a> {
    /// Full name, with indices; that of a derivative is `der(…)`.
    pub fn name(&self) -> String {
        let name = self.indexed_name();
        if self.variable.section == Section::Derivative { format!("der({name})") } else { name }
    }

    fn indexed_name(&self) -> String {
        let (name, k) = (&self.variable.name, self.offset);
        if let Some(Some(given)) = self.variable.given.get(k) {
            return given.clone();
        }
        match self.variable.naming {
            Naming::Scalar => name.clone(),
            Naming::Vector(_) => format!("{name}[{}]", k + 1),
            Naming::Diagonal(_) => format!("{name}[{0},{0}]", k + 1),
            Naming::Matrix(rows, _) => format!("{name}[{},{}]", k % rows + 1, k / rows + 1),
        }
    }

    /// Its description; elements that share a text are distinguished by their places.
    pub fn description(&self) -> Cow<'a, str> {
        let (text, place) = self.text_and_place();
        let limit = if self.variable.shown.no_limit { TELLS_NO_LIMIT } else { "" };
        if place.is_empty() && limit.is_empty() {
            Cow::Borrowed(text)
        } else {
            Cow::Owned([text, &place, limit].concat())
        }
    }

    /// Its own text, as it is stored for one element of several.
    pub(super) fn own_text(&self) -> String {
        let (text, place) = self.text_and_place();
        [text, &place].concat()
    }

    fn text_and_place(&self) -> (&'a str, String) {
        let text = pick(&self.variable.description, self.offset).map_or("", String::as_str);
        let shared = self.variable.description.len() == 1 && self.variable.len() > 1;
        (text, if shared { self.place_in_words() } else { String::new() })
    }

    fn place_in_words(&self) -> String {
        let k = self.offset;
        match self.variable.naming {
            Naming::Scalar => String::new(),
            Naming::Vector(n) | Naming::Diagonal(n) => format!(", {} of {n}", k + 1),
            Naming::Matrix(1, columns) => format!(", {} of {columns}", k + 1),
            Naming::Matrix(rows, 1) => format!(", {} of {rows}", k + 1),
            Naming::Matrix(rows, _) => format!(", row {}, column {}", k % rows + 1, k / rows + 1),
        }
    }

    /// Place in its section.
    pub fn place(&self) -> usize {
        self.variable.start + self.offset
    }

    /// Unit of a real number; empty when it has none.
    pub fn unit(&self) -> &'static str {
        match &self.variable.data {
            Data::Real { unit, .. } => pick(unit, self.offset).copied().unwrap_or(""),
            _ => "",
        }
    }

    /// Magnitude of a real number.
    pub fn nominal(&self) -> f64 {
        match &self.variable.data {
            Data::Real { nominal, .. } => pick(nominal, self.offset).copied().unwrap_or(1.0),
            _ => 1.0,
        }
    }

    /// Start value of a real number.
    pub fn start(&self) -> f64 {
        match &self.variable.data {
            Data::Real { start, .. } => pick(start, self.offset).copied().unwrap_or(0.0),
            _ => 0.0,
        }
    }
}

/// The element's own entry, or the one for all.
fn pick<T>(entries: &[T], index: usize) -> Option<&T> {
    if entries.len() == 1 { entries.first() } else { entries.get(index) }
}

/// All variables of a system.
#[derive(Debug, Clone, Default)]
pub struct Variables {
    pub(super) list: Vec<Variable>,
    /// Name of the quantity that each event indicator watches; empty if it has none.
    pub(super) indicators: Vec<String>,
    /// Warnings: category and description. Each has a flag in the integers' memory.
    pub(super) warnings: Vec<(&'static str, &'static str)>,
    /// Place of the flag in the integers' memory by which a system knows that it is stepped, if it asked for it.
    pub(super) stepped: Option<usize>,
    /// Places of the same flags of a composite's parts, which are never set.
    pub(crate) never_stepped: Vec<usize>,
    /// Number of the system's own variables; those that every model has come after them.
    pub(super) own: usize,
    /// The clocks of sampled laws, by places among the discrete reals.
    pub(super) clocks: Vec<SamplingClock<usize>>,
    /// Names that a description may give start values without effect.
    pub(super) without_effect: Vec<String>,
    /// True for a composite with feedback between its parts.
    pub(super) has_feedback: bool,
    pub(super) real_sizes: [usize; Section::COUNT],
    pub(super) integer_sizes: [usize; Section::COUNT],
    pub(super) offsets: Offsets,
    by_name: OnceLock<HashMap<String, (usize, usize)>>,
}

impl Variables {
    /// Fixes offsets once everything is declared.
    pub(super) fn finish(&mut self) {
        self.place_sections();
    }

    /// Places of elements by their names, found at the first call: an instance that is only run needs none.
    fn by_name(&self) -> &HashMap<String, (usize, usize)> {
        self.by_name.get_or_init(|| {
            let elements = |(index, variable): (usize, &Variable)| {
                variable.elements().map(|element| (element.name(), (index, element.offset))).collect::<Vec<_>>()
            };
            self.list.iter().enumerate().flat_map(elements).collect()
        })
    }

    /// Places sections one after the other, as large as they are now.
    pub(super) fn place_sections(&mut self) {
        let running = |sizes: &[usize; Section::COUNT]| {
            let mut sum = 0;
            sizes.map(|size| {
                sum += size;
                sum - size
            })
        };
        self.offsets = Offsets { real: running(&self.real_sizes), integer: running(&self.integer_sizes) };
    }

    /// Place, among all integers, of the flag by which the system knows that a master of co-simulation steps it.
    pub fn stepped(&self) -> Option<usize> {
        self.stepped.map(|place| self.integers(Section::Memory).start + place)
    }

    /// Makes constants of parameters: of all elements that they have.
    ///
    /// # Errors
    /// For what is no parameter of the system.
    pub(crate) fn make_constant(&mut self, names: &[String]) -> Result<(), Invalid> {
        for name in names {
            let is_it = |v: &&mut Variable| v.name == *name && v.causality == Causality::Parameter;
            let Some(variable) = self.list[..self.own].iter_mut().find(is_it) else {
                return Err(Invalid::new("designed", format!("`{name}`"), "must be the name of a parameter"));
            };
            variable.variability = Variability::Constant;
        }
        Ok(())
    }

    /// True if a variable is one that every model has: how it is simulated, not what it is.
    pub fn is_control(&self, variable: &Variable) -> bool {
        self.list[self.own..].iter().any(|own| std::ptr::eq(own, variable))
    }

    /// The variables, in the order of their declaration.
    pub fn iter(&self) -> impl Iterator<Item = &Variable> {
        self.list.iter()
    }

    /// Every element that is shown outside.
    pub fn visible(&self) -> impl Iterator<Item = Element<'_>> {
        self.list.iter().filter(|v| v.causality != Causality::Hidden).flat_map(Variable::elements)
    }

    /// The element of this full name.
    pub fn find(&self, name: &str) -> Option<Element<'_>> {
        self.by_name().get(name).map(|&(index, offset)| self.list[index].element(offset))
    }

    /// Signals whose errors integration controls in addition to those of states: the place of each, that of the output
    /// whose magnitude they count in, and its nominal value.
    pub fn controlled(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let signals = self.reals(Section::Signal).start;
        let starting_at =
            |start: usize| self.iter().find(move |v| v.section == Section::Signal && v.is_real() && v.start == start);
        self.iter().filter(|v| v.is_controlled()).flat_map(Variable::elements).map(move |y| {
            let output = y.variable.behind.and_then(starting_at).unwrap_or(y.variable);
            (self.index(y), signals + output.start + y.offset, output.element(y.offset).nominal())
        })
    }

    /// Index of an element in the block: of reals for real variables, else of integers.
    pub fn index(&self, element: Element<'_>) -> usize {
        let offsets = if element.variable.is_real() { &self.offsets.real } else { &self.offsets.integer };
        offsets[element.variable.section as usize] + element.place()
    }

    /// Number of values, and begin of each section.
    pub fn layout(&self) -> Layout {
        let (reals, integers) = (self.reals(Section::Memory).end, self.integers(Section::Memory).end);
        Layout { reals, integers, offsets: self.offsets, indicators: self.indicators.len() }
    }

    /// Begin of each section.
    pub fn offsets(&self) -> &Offsets {
        &self.offsets
    }

    /// Range of a section in the block of reals.
    pub fn reals(&self, section: Section) -> std::ops::Range<usize> {
        let start = self.offsets.real[section as usize];
        start..start + self.real_sizes[section as usize]
    }

    /// Range of a section in the block of integers.
    pub fn integers(&self, section: Section) -> std::ops::Range<usize> {
        let start = self.offsets.integer[section as usize];
        start..start + self.integer_sizes[section as usize]
    }

    /// Number of continuous states.
    pub fn states(&self) -> usize {
        self.real_sizes[Section::State as usize]
    }

    /// The element at a place of a section of reals.
    pub fn real_at(&self, section: Section, place: usize) -> Option<Element<'_>> {
        let mut reals = self.list.iter().filter(|v| v.section == section && v.is_real());
        let found = reals.find(|v| (v.start..v.start + v.len()).contains(&place));
        found.map(|v| v.element(place - v.start))
    }

    /// Everything that was declared: variables, event indicators, warnings.
    pub fn declared(&self) -> impl Serialize {
        (&self.list, &self.indicators, &self.warnings)
    }

    /// Name of the quantity that each event indicator watches; empty if it has none.
    pub fn indicators(&self) -> &[String] {
        &self.indicators
    }

    /// Warnings: category and description.
    pub fn warnings(&self) -> &[(&'static str, &'static str)] {
        &self.warnings
    }
}
