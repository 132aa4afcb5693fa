//! Value references: index of the value in the instance's block, integers behind the reals. So each is unique over
//! all types, and a wrong type is noticed.

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

/// What may be done with one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Not shown outside.
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
}

/// What a value reference of the wrong sort is.
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

    /// The value reference of an element.
    pub fn of(variables: &Variables, element: Element<'_>) -> u32 {
        let index = variables.index(element);
        let before = if element.variable.is_real() { 0 } else { variables.reals(Section::Memory).end };
        (before + index) as u32
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
