//! Value references: index of the value in the instance's block, integers behind the reals. So each is unique over
//! all types, and a wrong type is noticed. In FMI 3.0 that of an array is its first element's, and event indicators have
//! references behind all others.

use crate::structure::Place;
use crate::system::{Causality, Data, Element, Section, Variability, Variables};

/// The types of values at the boundary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// Real
    Real,
    /// Integer or Enumeration
    Integer,
    /// Boolean
    Boolean,
}

/// Use that a master may make of one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Hidden from masters.
    Hidden,
    /// A constant: a parameter that the unit was designed with.
    Designed,
    /// Set before the simulation.
    Fixed,
    /// Set between steps.
    Tunable,
    /// Set between steps.
    Input,
    /// Computed; `output` where it has that causality.
    Calculated {
        /// True if it is an output.
        output: bool,
    },
}

/// The value references of a model.
#[derive(Debug)]
pub struct References {
    reals: Vec<Access>,
    integers: Vec<(Access, Type)>,
    /// Number of items of each integer that is a choice.
    items: Vec<Option<i32>>,
    /// Rows and columns of what a reference is of; 0 where it is another's element. Empty in FMI 2.0, where all are scalars.
    shapes: Vec<[u32; 2]>,
    /// Number of event indicators that have references.
    indicators: u32,
    /// Places of discrete variables that are computed, in FMI 3.0.
    discrete: Vec<Place>,
    /// Number of sizes that can change, if there are some, and the first places of the other variables, whose references count on
    /// from there.
    numbers: Option<(usize, Vec<u32>)>,
}

/// Reason why a value reference doesn't fit a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoValue {
    /// It belongs to no variable.
    Unknown,
    /// Its variable has another type.
    Other(Type),
}

impl References {
    /// The value references of these variables.
    pub fn new(variables: &Variables) -> Self {
        let mut references = References {
            reals: vec![Access::Hidden; variables.reals(Section::Memory).end],
            integers: vec![(Access::Hidden, Type::Integer); variables.integers(Section::Memory).end],
            items: vec![None; variables.integers(Section::Memory).end],
            shapes: Vec::new(),
            indicators: 0,
            discrete: Vec::new(),
            numbers: None,
        };
        for element in variables.visible() {
            let access = match (element.variable.causality, element.variable.variability) {
                (_, Variability::Constant) => Access::Designed,
                (Causality::Parameter, Variability::Fixed) => Access::Fixed,
                (Causality::Parameter, _) => Access::Tunable,
                (Causality::Input, _) => Access::Input,
                (causality, _) => Access::Calculated { output: causality == Causality::Output },
            };
            let index = variables.index(element);
            match &element.variable.data {
                Data::Real { .. } => references.reals[index] = access,
                Data::Boolean { .. } => references.integers[index] = (access, Type::Boolean),
                Data::Integer { .. } => references.integers[index] = (access, Type::Integer),
                Data::Choice { items, .. } => {
                    references.integers[index] = (access, Type::Integer);
                    references.items[index] = Some(items.len() as i32);
                }
            }
        }
        references
    }

    /// The value references of these variables in FMI 3.0, of which some are arrays: each first reference with its rows and columns.
    /// Time can be read.
    pub fn with_arrays(variables: &Variables, time: u32, arrays: impl Iterator<Item = (u32, [u32; 2])>) -> Self {
        let mut references = References::new(variables);
        references.reals[time as usize] = Access::Calculated { output: false };
        references.indicators = variables.indicators().len() as u32;
        let is_discrete = |element: &Element| {
            let is_computed = matches!(element.variable.causality, Causality::Output | Causality::Local);
            is_computed && element.variable.variability == Variability::Discrete
        };
        let discrete = variables.visible().filter(is_discrete).map(|element| Place::of(variables, element));
        references.discrete = discrete.collect();
        let all = references.reals.len() + references.integers.len();
        references.shapes = vec![[1, 1]; all + usize::from(references.indicators > 0)];
        if let Some(shape) = references.shapes.get_mut(all) {
            *shape = [references.indicators, 1];
        }
        for (first, [rows, columns]) in arrays {
            let elements = first as usize..(first + rows * columns) as usize;
            references.shapes[elements].fill([0, 0]);
            references.shapes[first as usize] = [rows, columns];
        }
        references
    }

    /// The same with references that are numbers: of sizes first, and then of variables that begin at these places.
    pub fn numbered(self, sizes: usize, places: impl Iterator<Item = u32>) -> Self {
        References { numbers: Some((sizes, places.collect())), ..self }
    }

    /// The first place of the variable with a master's reference.
    pub fn inner(&self, reference: u32) -> Option<u32> {
        let Some((sizes, places)) = &self.numbers else { return Some(reference) };
        places.get((reference as usize).checked_sub(*sizes)?).copied()
    }

    /// A master's reference of the variable that has this place.
    pub fn outer(&self, place: u32) -> u32 {
        let Some((sizes, places)) = &self.numbers else { return place };
        let length = |first: u32| self.shapes.get(first as usize).map_or(1, |[rows, columns]| rows * columns);
        let holds = |first: &u32| (*first..*first + length(*first)).contains(&place);
        places.iter().position(holds).map_or(place, |number| (sizes + number) as u32)
    }

    /// Places of discrete variables that are computed.
    pub fn discrete(&self) -> &[Place] {
        &self.discrete
    }

    /// The reference of the event indicators, behind all others.
    pub fn of_indicators(variables: &Variables) -> u32 {
        (variables.reals(Section::Memory).end + variables.integers(Section::Memory).end) as u32
    }

    /// The number of an event indicator, where a reference is one's.
    pub fn indicator(&self, reference: u32) -> Option<usize> {
        let number = reference.checked_sub((self.reals.len() + self.integers.len()) as u32)?;
        (number < self.indicators).then_some(number as usize)
    }

    /// Number of values that a master's reference names.
    ///
    /// # Errors
    /// [`NoValue`] when it is no variable's.
    pub fn length(&self, reference: u32) -> Result<usize, NoValue> {
        match self.inner(reference).and_then(|place| self.shapes.get(place as usize)) {
            Some([0, _]) | None => Err(NoValue::Unknown),
            Some([rows, columns]) => Ok((rows * columns) as usize),
        }
    }

    /// The places of all values that a master's references name, arrays row by row.
    pub fn values_of<'a>(&'a self, references: &'a [u32]) -> impl Iterator<Item = u32> + Clone + 'a {
        references.iter().filter_map(|&reference| self.inner(reference)).flat_map(|place| {
            let [rows, columns] = self.shapes.get(place as usize).copied().unwrap_or([1, 1]);
            // As they are stored, columns come first.
            (0..rows * columns).map(move |k| place + k % columns * rows + k / columns)
        })
    }

    /// The value reference of an element.
    pub fn of(variables: &Variables, element: Element<'_>) -> u32 {
        let index = variables.index(element);
        let before = if element.variable.is_real() { 0 } else { variables.reals(Section::Memory).end };
        (before + index) as u32
    }

    /// True if an integer, by its place, is a choice of items.
    pub fn is_choice(&self, place: usize) -> bool {
        self.items[place].is_some()
    }

    /// True if an integer may have a value: only the numbers of its items, where it is a choice.
    pub fn holds(&self, place: usize, value: i32) -> bool {
        self.items[place].is_none_or(|items| (1..=items).contains(&value))
    }

    /// Place and access of a value of the type wanted.
    ///
    /// # Errors
    /// [`NoValue`] when there is none.
    #[inline]
    pub fn find(&self, reference: u32, wanted: Type) -> Result<(usize, Access), NoValue> {
        let index = reference as usize;
        let (place, access, is) = match self.reals.get(index) {
            Some(&access) => (index, access, Type::Real),
            None if self.indicator(reference).is_some() => (index, Access::Calculated { output: false }, Type::Real),
            None => {
                let place = index - self.reals.len();
                let &(access, is) = self.integers.get(place).ok_or(NoValue::Unknown)?;
                (place, access, is)
            }
        };
        match access {
            Access::Hidden => Err(NoValue::Unknown),
            _ if is != wanted => Err(NoValue::Other(is)),
            _ => Ok((place, access)),
        }
    }
}

/// The variable with this value reference.
pub fn element(variables: &Variables, reference: u32) -> Option<Element<'_>> {
    variables.visible().find(|element| References::of(variables, *element) == reference)
}
