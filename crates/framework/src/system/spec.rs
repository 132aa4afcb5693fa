//! Declared properties of a variable: name, shape, start value, unit, limits, description.

use std::marker::PhantomData;

use super::declaration::MOST_VALUES;
use super::values::{Choice, Class, MatrixOf, ScalarOf, VectorOf, number_of};
use super::variable::{Causality, Data, NO_LIMIT, Naming, Shown};

/// A real variable to be declared; see [`scalar`], [`vector`], [`matrix`], [`diagonal`].
#[derive(Debug, Clone)]
pub struct Spec<D> {
    pub(super) shape: D,
    pub(super) name: String,
    pub(super) description: Vec<String>,
    pub(super) source: &'static str,
    pub(super) causality: Option<Causality>,
    pub(super) fixed: bool,
    pub(super) start: Vec<f64>,
    pub(super) unit: Vec<&'static str>,
    pub(super) min: Option<f64>,
    pub(super) above_min: bool,
    pub(super) max: Option<f64>,
    pub(super) nominal: Vec<f64>,
    pub(super) shown: Shown,
}

/// A scalar.
pub fn scalar(name: &str, description: &str) -> Spec<Naming> {
    Spec::new(Naming::Scalar, name, description)
}

/// A vector of n elements, `name[i]`.
pub fn vector(name: &str, n: usize, description: &str) -> Spec<Many> {
    Spec::new(Many(Naming::Vector(n)), name, description)
}

/// The diagonal of an n × n matrix that is diagonal by law, `name[i,i]`.
pub fn diagonal(name: &str, n: usize, description: &str) -> Spec<Many> {
    Spec::new(Many(Naming::Diagonal(n)), name, description)
}

/// A matrix, `name[i,j]`.
pub fn matrix(name: &str, rows: usize, columns: usize, description: &str) -> Spec<Grid> {
    Spec::new(Grid { rows, columns }, name, description)
}

/// The shape of a vector.
#[derive(Debug, Clone, Copy)]
pub struct Many(Naming);

/// The shape of a matrix.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    rows: usize,
    columns: usize,
}

/// The shape of a variable, and the handle that goes with it.
pub trait Shape: Copy {
    /// The handle's type.
    type Handle<C: Class>;
    /// Naming of the elements.
    fn naming(self) -> Naming;
    /// The handle of values that begin at `start`.
    fn handle<C: Class>(self, start: usize) -> Self::Handle<C>;
}

impl Shape for Naming {
    type Handle<C: Class> = ScalarOf<C>;
    fn naming(self) -> Naming {
        self
    }
    fn handle<C: Class>(self, start: usize) -> ScalarOf<C> {
        ScalarOf { start, class: PhantomData }
    }
}

impl Shape for Many {
    type Handle<C: Class> = VectorOf<C>;
    fn naming(self) -> Naming {
        self.0
    }
    fn handle<C: Class>(self, start: usize) -> VectorOf<C> {
        let (Naming::Vector(len) | Naming::Diagonal(len)) = self.0 else {
            unreachable!("made by `vector`, `diagonal`")
        };
        VectorOf { start, len, class: PhantomData }
    }
}

impl Shape for Grid {
    type Handle<C: Class> = MatrixOf<C>;
    fn naming(self) -> Naming {
        Naming::Matrix(self.rows, self.columns)
    }
    fn handle<C: Class>(self, start: usize) -> MatrixOf<C> {
        MatrixOf { start, rows: self.rows, columns: self.columns, class: PhantomData }
    }
}

impl<D: Shape> Spec<D> {
    fn new(shape: D, name: &str, description: &str) -> Self {
        Spec {
            shape,
            name: name.to_owned(),
            description: vec![description.to_owned()],
            source: "",
            causality: None,
            fixed: false,
            start: vec![0.0],
            unit: vec!["1"],
            min: None,
            above_min: false,
            max: None,
            nominal: vec![1.0],
            shown: Shown::default(),
        }
    }

    /// Start value, of every element.
    pub fn start(mut self, value: f64) -> Self {
        self.start = vec![value];
        self
    }

    /// Start values, one an element in the order of storage (matrices by columns).
    pub fn starts(mut self, values: &[f64]) -> Self {
        self.start = values.to_vec();
        self
    }

    /// The start values of an identity matrix.
    pub fn identity(mut self) -> Self {
        if let Naming::Matrix(rows, columns) = self.shape.naming() {
            // What is too large is refused by the declaration.
            if rows.saturating_mul(columns) > MOST_VALUES {
                return self;
            }
            self.start = (0..rows * columns).map(|k| f64::from(u8::from(k % rows == k / rows))).collect();
        } else {
            self.start = vec![1.0];
        }
        self
    }

    /// Unit of every element: any text; an empty one is none. Of those that [`Base::of`](super::Base::of) knows, other
    /// tools know how to convert them.
    pub fn unit(mut self, unit: &'static str) -> Self {
        self.unit = vec![unit];
        self
    }

    /// Units, one an element.
    pub fn units(mut self, units: &[&'static str]) -> Self {
        self.unit = units.to_vec();
        self
    }

    /// Descriptions, one an element, in place of the common one.
    pub fn each(mut self, descriptions: &[&str]) -> Self {
        self.description = descriptions.iter().map(|text| (*text).to_owned()).collect();
        self
    }

    /// Sets descriptions that name the quantity of the plant that each element is about: `text` with its name in place
    /// of `{}`. If no names are known, the common description stays.
    pub fn about(mut self, quantities: &[String], text: &str) -> Self {
        if !quantities.is_empty() {
            self.description = quantities.iter().map(|quantity| text.replace("{}", quantity)).collect();
        }
        self
    }

    /// A smallest value that doesn't limit anything, unless it is set.
    pub fn no_lower_limit(self) -> Self {
        self.no_limit(-NO_LIMIT)
    }

    /// A largest value that doesn't limit anything, unless it is set.
    pub fn no_upper_limit(self) -> Self {
        self.no_limit(NO_LIMIT)
    }

    /// Starts at what is no limit. Beyond that nothing is meant, so tools see what range such a number ends.
    fn no_limit(mut self, start: f64) -> Self {
        self.shown.no_limit = true;
        self.min(-NO_LIMIT).max(NO_LIMIT).start(start)
    }

    /// Shows it in its own unit: phases and angular frequencies, which are not wanted in degrees.
    pub fn in_own_unit(mut self) -> Self {
        self.shown.in_own_unit = true;
        self
    }

    /// Sets the source of the equation of it, or of its rate, e.g. "Hashim (3.2)". C sources cite it there.
    pub fn source(mut self, source: &'static str) -> Self {
        self.source = source;
        self
    }

    /// Smallest value allowed.
    pub fn min(mut self, min: f64) -> Self {
        self.min = Some(min);
        self
    }

    /// Largest value allowed.
    pub fn max(mut self, max: f64) -> Self {
        self.max = Some(max);
        self
    }

    /// Allows values above zero only.
    pub fn positive(mut self) -> Self {
        self.min = Some(0.0);
        self.above_min = true;
        self
    }

    /// Magnitude of the values: the absolute tolerance is the relative one times this.
    pub fn nominal(mut self, nominal: f64) -> Self {
        self.nominal = vec![nominal];
        self
    }

    /// Magnitudes, one an element.
    pub fn nominals(mut self, nominals: &[f64]) -> Self {
        self.nominal = nominals.to_vec();
        self
    }

    /// A parameter that can't be changed while running (an initial value).
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// A state or discrete variable that is an output.
    pub fn output(mut self) -> Self {
        self.causality = Some(Causality::Output);
        self
    }

    /// A variable that isn't shown outside.
    pub fn hidden(mut self) -> Self {
        self.causality = Some(Causality::Hidden);
        self
    }
}

/// A discrete-valued variable to be declared; see [`integer`], [`boolean`], [`choice`].
#[derive(Debug, Clone)]
pub struct DiscreteSpec<T> {
    pub(super) name: String,
    pub(super) description: String,
    pub(super) data: Data,
    pub(super) causality: Option<Causality>,
    pub(super) fixed: bool,
    value: PhantomData<T>,
}

/// An integer.
pub fn integer(name: &str, description: &str) -> DiscreteSpec<i32> {
    DiscreteSpec::new(name, description, Data::Integer { start: 0, limits: None })
}

/// True or false.
pub fn boolean(name: &str, description: &str) -> DiscreteSpec<bool> {
    DiscreteSpec::new(name, description, Data::Boolean { start: false })
}

/// A choice, which starts at its first item.
pub fn choice<E: Choice>(name: &str, description: &str) -> DiscreteSpec<E> {
    let items = E::ITEMS.iter().map(|(_, name, text)| ((*name).to_owned(), (*text).to_owned())).collect();
    DiscreteSpec::new(name, description, Data::Choice { type_name: E::TYPE.to_owned(), items, start: 1 })
}

/// A choice between items (name and description) that a structure gives: its value is their number 1, 2, …
pub fn selection(name: &str, description: &str, type_name: &str, items: Vec<(String, String)>) -> DiscreteSpec<i32> {
    DiscreteSpec::new(name, description, Data::Choice { type_name: type_name.to_owned(), items, start: 1 })
}

impl<T> DiscreteSpec<T> {
    fn new(name: &str, description: &str, data: Data) -> Self {
        let (name, description) = (name.to_owned(), description.to_owned());
        DiscreteSpec { name, description, data, causality: None, fixed: false, value: PhantomData }
    }

    /// A parameter that can't be changed while running.
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// A discrete variable that is an output.
    pub fn output(mut self) -> Self {
        self.causality = Some(Causality::Output);
        self
    }

    /// A variable that isn't shown outside.
    pub fn hidden(mut self) -> Self {
        self.causality = Some(Causality::Hidden);
        self
    }
}

impl DiscreteSpec<i32> {
    /// Start value.
    pub fn start(mut self, value: i32) -> Self {
        if let Data::Integer { start, .. } = &mut self.data {
            *start = value;
        }
        self
    }

    /// Smallest and largest value allowed.
    pub fn within(mut self, min: i32, max: i32) -> Self {
        if let Data::Integer { limits, .. } = &mut self.data {
            *limits = Some((min, max));
        }
        self
    }
}

impl<E: Choice> DiscreteSpec<E> {
    /// The item that it starts at, where that isn't the first.
    pub fn start(mut self, item: E) -> Self {
        if let Data::Choice { start, .. } = &mut self.data {
            *start = number_of(item);
        }
        self
    }

    /// The name of its type, where several choices have the same items.
    pub fn type_name(mut self, name: &str) -> Self {
        if let Data::Choice { type_name, .. } = &mut self.data {
            name.clone_into(type_name);
        }
        self
    }
}

impl DiscreteSpec<bool> {
    /// Start value.
    pub fn start(mut self, value: bool) -> Self {
        if let Data::Boolean { start } = &mut self.data {
            *start = value;
        }
        self
    }
}
