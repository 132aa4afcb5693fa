//! Variables as FMI 3.0 has them: a vector or a matrix is one array where its elements have one unit and names of the system.

use crate::fmi2::access::References;
use crate::model::Model;
use crate::system::{Causality, Element, Naming, Section, Variable, Variables};

/// A variable of the model description: a scalar, or an array with all its elements.
#[derive(Debug, Clone, Copy)]
pub struct Entry<'a> {
    /// Its first element.
    pub element: Element<'a>,
    /// Rows and columns of an array, and how many of these are dimensions; none of a scalar.
    pub shape: Option<([u32; 2], usize)>,
    /// Number of its variable, in the order of declaration.
    pub number: usize,
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
pub fn entries(model: &Model) -> impl Iterator<Item = Entry<'_>> {
    let variables = model.variables();
    let is_shown = |(_, variable): &(usize, &Variable)| variable.causality != Causality::Hidden;
    variables.iter().enumerate().filter(is_shown).flat_map(move |(number, variable)| {
        let shape = shape(variables, variable, !model.sizes().is_empty());
        let elements = variable.elements().take(if shape.is_some() { 1 } else { usize::MAX });
        elements.map(move |element| Entry { element, shape, number })
    })
}

/// Rows and columns of a variable that is an array, and the number of its dimensions. Where sizes can change, diagonals and matrices
/// of states are arrays, too.
fn shape(variables: &Variables, variable: &Variable, is_resizable: bool) -> Option<([u32; 2], usize)> {
    let shape = match variable.naming {
        Naming::Vector(n) => ([n as u32, 1], 1),
        Naming::Diagonal(n) if is_resizable => ([n as u32, 1], 1),
        Naming::Matrix(rows, columns) => ([rows as u32, columns as u32], 2),
        Naming::Scalar | Naming::Diagonal(_) => return None,
    };
    // The order of states is that in which they are stored, columns first; that of arrays is rows first.
    let is_of_states = matches!(variable.section, Section::State | Section::Derivative);
    if is_of_states && shape.1 == 2 && !is_resizable {
        return None;
    }
    let twin = match variable.section {
        Section::State => Section::Derivative,
        Section::Derivative => Section::State,
        other => other,
    };
    // A state and its derivative are arrays both, or none of them.
    let mut both = variables.iter().filter(|v| v.is_real() == variable.is_real() && v.start == variable.start);
    let is_one = both.all(|v| ![variable.section, twin].contains(&v.section) || v.is_uniform());
    (is_one && variable.is_uniform()).then_some(shape)
}

/// The value references of a model in FMI 3.0. Where its sizes can change, they are numbers of variables, so that they stay: first
/// the sizes, then time, then all others.
pub fn references(model: &Model) -> References {
    let variables = model.variables();
    let first = |entry: &Entry| References::of(variables, entry.element.variable.element(0));
    let arrays = entries(model).filter_map(|entry| entry.shape.map(|(shape, _)| (first(&entry), shape)));
    let references = References::with_arrays(variables, time(model), arrays);
    if model.sizes().is_empty() {
        return references;
    }
    let own = entries(model).map(|entry| References::of(variables, entry.element));
    let numbered = [time(model)].into_iter().chain(own).chain([References::of_indicators(variables)]);
    references.numbered(model.sizes().list().len(), numbered)
}

/// The place of time, as a reference.
pub fn time(model: &Model) -> u32 {
    model.time_place() as u32
}

/// Places of states in the order in which a master has them: arrays by rows, not by columns as they are stored. Empty where these
/// orders are the same.
pub fn order_of_states(model: &Model) -> Vec<usize> {
    let mut states: Vec<Entry> =
        entries(model).filter(|entry| entry.element.variable.section == Section::State).collect();
    states.sort_by_key(|entry| entry.element.place());
    let order: Vec<usize> = states.iter().flat_map(Entry::elements).map(|element| element.place()).collect();
    if order.is_sorted() { Vec::new() } else { order }
}
