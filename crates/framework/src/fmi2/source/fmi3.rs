//! Tables of a unit of FMI 3.0: arrays, discrete variables that are computed, dependences of elements.

use std::collections::{BTreeSet, HashMap};

use super::Unit;
use super::message::quoted;
use super::tables::list;
use crate::fmi2::access::References;
use crate::fmi2::fmi3::arrays;
use crate::model::Standard;
use crate::structure::Place;
use crate::system::{Causality, Element, Section};

/// Tables of a unit of FMI 3.0, all empty in one of FMI 2.0. Places are value references: integers lie behind the reals.
#[derive(Debug, Default)]
pub(super) struct Tables {
    /// First place, rows and columns of each array, by their places.
    arrays: Vec<(u32, [u32; 2])>,
    /// Places of discrete variables that are computed.
    discretes: Vec<u32>,
    /// Each output, state and derivative, with what it depends on while a simulation runs and at its start: number of places, and
    /// where they begin among the dependences.
    dependents: Vec<(u32, [(usize, usize); 2])>,
    /// Places that others depend on.
    dependences: Vec<u32>,
    /// References of variables that event indicators may depend on.
    independents: Vec<u32>,
}

impl Tables {
    /// Those of a unit.
    pub fn of(unit: &Unit) -> Self {
        if unit.model.description().standard() == Standard::Fmi2 {
            return Tables::default();
        }
        let (model, variables) = (unit.model, unit.model.variables());
        let of_entry = |entry: arrays::Entry| Some((References::of(variables, entry.element), entry.shape?.0));
        let indicators = variables.indicators().len() as u32;
        let of_indicators = (indicators > 0).then_some((References::of_indicators(variables), [indicators, 1]));
        let mut found = Tables {
            arrays: arrays::entries(model).filter_map(of_entry).chain(of_indicators).collect(),
            discretes: arrays::references(model).discrete().iter().map(|place| place_number(unit, *place)).collect(),
            ..Tables::default()
        };
        found.arrays.sort_unstable();
        let is_known = |section| matches!(section, Section::Input | Section::State);
        let knowns = arrays::entries(model).filter(|entry| is_known(entry.element.variable.section));
        let knowns = knowns.map(|entry| References::of(variables, entry.element));
        found.independents = knowns.chain([arrays::time(model)]).collect();
        found.find_dependences(unit);
        found
    }

    fn find_dependences(&mut self, unit: &Unit) {
        let (variables, structure) = (unit.model.variables(), unit.model.structure());
        let time = Place::Real(unit.model.time_place());
        let shown: BTreeSet<Place> =
            variables.visible().map(|element| Place::of(variables, element)).chain([time]).collect();
        // Many depend on the same.
        let mut known: HashMap<Vec<u32>, usize> = HashMap::new();
        let mut listed = |places: &[Place], dependences: &mut Vec<u32>| {
            let places = places.iter().filter(|place| shown.contains(place));
            let places: Vec<u32> = places.map(|place| place_number(unit, *place)).collect();
            let count = places.len();
            let first = *known.entry(places).or_insert_with_key(|places| {
                dependences.extend(places);
                dependences.len() - places.len()
            });
            (count, first)
        };
        let is_dependent = |element: &Element| {
            let is_of_states = matches!(element.variable.section, Section::State | Section::Derivative);
            element.variable.causality == Causality::Output || is_of_states
        };
        for element in variables.visible().filter(is_dependent) {
            let own = [Place::of(variables, element)];
            let running = match element.variable.section {
                Section::State => &own,
                Section::Discrete => &[][..],
                _ => structure.running(own[0]),
            };
            let both = [running, structure.start(own[0])].map(|places| listed(places, &mut self.dependences));
            self.dependents.push((References::of(variables, element), both));
        }
    }

    /// The sizes, for unit.h.
    pub fn sizes(&self) -> [(&'static str, usize); 4] {
        [
            ("UNIT_ARRAYS", self.arrays.len()),
            ("UNIT_COMPUTED_DISCRETES", self.discretes.len()),
            ("UNIT_DEPENDENTS", self.dependents.len()),
            ("UNIT_INDEPENDENTS", self.independents.len()),
        ]
    }

    /// The tables in C.
    pub fn write(&self, unit: &Unit) -> String {
        let indicators = unit.model.variables().indicators().len();
        let names = (1..=indicators).map(|number| quoted(&format!("event_indicators[{number}]")));
        let names = if indicators > 0 {
            list("char *const unit_indicator_variables[UNIT_INDICATORS]", names)
        } else {
            String::new()
        };
        let numbers = |places: &[u32]| places.iter().map(ToString::to_string).collect::<Vec<_>>().into_iter();
        let arrays = self.arrays.iter().map(|(first, [rows, columns])| format!("{{ {first}, {rows}, {columns} }}"));
        let dependents = self.dependents.iter().map(|(place, [(running, first), (starts, first_start)])| {
            format!("{{ {place}, {running}, {first}, {starts}, {first_start} }}")
        });
        [
            list("Array unit_arrays[AT_LEAST_ONE(UNIT_ARRAYS)]", arrays),
            names,
            list("int unit_computed_discretes[AT_LEAST_ONE(UNIT_COMPUTED_DISCRETES)]", numbers(&self.discretes)),
            list("Dependent unit_dependents[AT_LEAST_ONE(UNIT_DEPENDENTS)]", dependents),
            list("int unit_dependences[]", numbers(&self.dependences)),
            list("int unit_independents[AT_LEAST_ONE(UNIT_INDEPENDENTS)]", numbers(&self.independents)),
        ]
        .concat()
    }
}

/// A place as a value reference.
fn place_number(unit: &Unit, place: Place) -> u32 {
    match place {
        Place::Real(index) => index as u32,
        Place::Integer(index) => (unit.start.reals.len() + index) as u32,
    }
}
