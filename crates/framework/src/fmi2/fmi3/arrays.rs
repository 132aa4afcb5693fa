//! Variables as FMI 3.0 has them: a vector or a matrix is one array where its elements have one unit and names of the system.

use crate::fmi2::access::References;
use crate::model::Model;
use crate::system::{Causality, Data, Element, Naming, Section, Variable, Variables};

/// A variable of the model description: a scalar, or an array with all its elements.
#[derive(Debug, Clone, Copy)]
pub struct Entry<'a> {
    /// Its first element.
    pub element: Element<'a>,
    /// Rows and columns of an array, and how many of these are dimensions; none of a scalar.
    pub shape: Option<([u32; 2], usize)>,
}

impl<'a> Entry<'a> {
    /// The name: that of an array is without indices.
    pub fn name(&self) -> String {
        let variable = self.element.variable;
        match self.shape {
            None => self.element.name(),
            Some(_) if variable.section == Section::Derivative => format!("der({})", variable.name),
            Some(_) => variable.name.clone(),
        }
    }

    /// The description: texts of elements that differ follow each other.
    pub fn description(&self) -> String {
        if self.shape.is_none() {
            return self.element.description().into_owned();
        }
        let mut texts: Vec<&str> = self.element.variable.description.iter().map(String::as_str).collect();
        texts.dedup();
        texts.join("; ")
    }

    /// Its elements, rows first.
    pub fn elements(&self) -> Vec<Element<'a>> {
        if self.shape.is_some() { self.element.variable.elements().collect() } else { vec![self.element] }
    }
}

/// Everything that is shown outside, in the order of declaration.
pub fn entries(variables: &Variables) -> impl Iterator<Item = Entry<'_>> {
    variables.iter().filter(|variable| variable.causality != Causality::Hidden).flat_map(|variable| {
        let shape = shape(variables, variable);
        let elements = variable.elements().take(if shape.is_some() { 1 } else { usize::MAX });
        elements.map(move |element| Entry { element, shape })
    })
}

/// Rows and columns of a variable that is an array, and the number of its dimensions.
fn shape(variables: &Variables, variable: &Variable) -> Option<([u32; 2], usize)> {
    let shape = match variable.naming {
        Naming::Vector(n) => ([n as u32, 1], 1),
        Naming::Matrix(rows, columns) => ([rows as u32, columns as u32], 2),
        Naming::Scalar | Naming::Diagonal(_) => return None,
    };
    // The order of states is that in which they are stored, columns first; that of arrays is rows first.
    let is_of_states = matches!(variable.section, Section::State | Section::Derivative);
    if is_of_states && shape.1 == 2 {
        return None;
    }
    let twin = match variable.section {
        Section::State => Section::Derivative,
        Section::Derivative => Section::State,
        other => other,
    };
    // A state and its derivative are arrays both, or none of them.
    let mut both = variables.iter().filter(|v| v.is_real() == variable.is_real() && v.start == variable.start);
    let is_one = both.all(|v| ![variable.section, twin].contains(&v.section) || is_uniform(v));
    (is_one && is_uniform(variable)).then_some(shape)
}

/// True if all elements have one unit, and names of the system.
fn is_uniform(variable: &Variable) -> bool {
    let is_one_unit = match &variable.data {
        Data::Real { unit, .. } => unit.windows(2).all(|pair| pair[0] == pair[1]),
        _ => true,
    };
    is_one_unit && variable.given.iter().all(Option::is_none)
}

/// The value references of a model in FMI 3.0.
pub fn references(model: &Model) -> References {
    let variables = model.variables();
    let arrays = entries(variables).filter_map(|entry| {
        let first = References::of(variables, entry.element.variable.element(0));
        entry.shape.map(|(shape, _)| (first, shape))
    });
    References::with_arrays(variables, time(model), arrays)
}

/// The value reference of time.
pub fn time(model: &Model) -> u32 {
    model.time_place() as u32
}
