//! Variables of an FMU as a master knows them from its modelDescription.xml.

use adaptive_fmu::fmi2::access::References;
use adaptive_fmu::model::Model;
use adaptive_fmu::system::{Causality, Data, Section, Variability};

/// A variable.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    pub reference: u32,
    /// Its start value, or another that is reasonable.
    pub near: f64,
    /// The number of its items, where it is an enumeration.
    pub items: Option<i32>,
    pub causality: Causality,
    pub fixed: bool,
    pub state: bool,
    /// A state's time derivative.
    pub rate: bool,
}

impl Entry {
    /// True if the standard lets it be set in this phase; which functions are allowed there is another matter.
    pub fn settable(&self, phase: char) -> bool {
        match self.causality {
            Causality::Input => true,
            Causality::Parameter => "IM".contains(phase) || !self.fixed && phase != 'C',
            _ => false,
        }
    }

    pub fn calculated(&self) -> bool {
        !matches!(self.causality, Causality::Input | Causality::Parameter)
    }
}

/// The variables of a unit by their types, and value references of none.
pub struct Catalog {
    pub name: String,
    pub reals: Vec<Entry>,
    pub integers: Vec<Entry>,
    pub booleans: Vec<Entry>,
    pub unknown: Vec<u32>,
    pub states: usize,
    pub indicators: usize,
}

impl Catalog {
    pub fn new(model: &Model) -> Self {
        let variables = model.variables();
        let [mut reals, mut integers, mut booleans] = [const { Vec::new() }; 3];
        for element in variables.visible() {
            let (list, near, items) = match &element.variable.data {
                Data::Real { .. } => (&mut reals, element.start(), None),
                Data::Integer { start, .. } => (&mut integers, f64::from(*start), None),
                Data::Choice { start, items, .. } => (&mut integers, f64::from(*start), Some(items.len() as i32)),
                Data::Boolean { .. } => (&mut booleans, 0.0, None),
            };
            list.push(Entry {
                reference: References::of(variables, element),
                near,
                items,
                causality: element.variable.causality,
                fixed: element.variable.variability == Variability::Fixed,
                state: element.variable.section == Section::State,
                rate: element.variable.section == Section::Derivative,
            });
        }
        let known: Vec<u32> = [&reals, &integers, &booleans].into_iter().flatten().map(|e| e.reference).collect();
        let end = known.iter().max().map_or(0, |last| last + 1);
        let mut unknown: Vec<u32> = (0..end).filter(|reference| !known.contains(reference)).collect();
        unknown.extend([end + 10_000, u32::MAX, 1 << 31]);
        Catalog {
            name: model.description().name.clone(),
            reals,
            integers,
            booleans,
            unknown,
            states: variables.states(),
            indicators: model.variables().indicators().len(),
        }
    }

    /// The variables of the type that a function is for.
    pub fn of(&self, function: &str) -> &[Entry] {
        match function {
            name if name.ends_with("Integer") => &self.integers,
            name if name.ends_with("Boolean") => &self.booleans,
            _ => &self.reals,
        }
    }
}
