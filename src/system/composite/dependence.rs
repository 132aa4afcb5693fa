//! What signals and derivatives of the whole depend on: the states and inputs at the far end of every connection.

use std::collections::{BTreeSet, HashMap};

use super::Part;
use super::connection::Link;
use super::errors::ErrorCoordinates;
use super::schedule::ranges;
use crate::system::values::Span;
use crate::system::variable::{Dependence, Section, Variables};

type Place = (Section, usize);

/// Follows connections back to states and inputs.
struct Sources<'a> {
    from: HashMap<usize, Place>,
    errors: &'a [ErrorCoordinates],
    parts: &'a [Part],
    variables: &'a Variables,
    found: HashMap<Place, BTreeSet<(usize, usize)>>,
}

impl Sources<'_> {
    fn of(&mut self, place: Place) -> BTreeSet<(usize, usize)> {
        if let Some(known) = self.found.get(&place) {
            return known.clone();
        }
        let direct: Vec<Place> = match place.0 {
            Section::State => self.coordinates(place.1),
            Section::Input => vec![place],
            Section::Connected => self.behind(place.1),
            _ => self.declared(place),
        };
        let mut sources = BTreeSet::new();
        for source in direct {
            if matches!(source.0, Section::State | Section::Input) && (source == place || place.0 == Section::State) {
                sources.insert((source.0 as usize, source.1));
            } else {
                sources.extend(self.of(source));
            }
        }
        self.found.insert(place, sources.clone());
        sources
    }

    /// The states that a plant's own state is computed from.
    fn coordinates(&self, state: usize) -> Vec<Place> {
        let pairs = self.errors.iter().flat_map(ErrorCoordinates::pairs);
        let model = pairs.filter(|(place, _)| *place == state).map(|(_, model)| (Section::State, model));
        model.chain([(Section::State, state)]).collect()
    }

    /// What a connected value is a copy of.
    fn behind(&self, place: usize) -> Vec<Place> {
        let own = |part: usize| {
            let range = &ranges(self.parts, Section::State, self.variables)[part];
            let first = self.parts[part].own_states?;
            (first..first + range.len()).contains(&place).then(|| (Section::State, range.start + place - first))
        };
        match self.from.get(&place) {
            Some(&from) => vec![from],
            None => (0..self.parts.len()).find_map(own).into_iter().collect(),
        }
    }

    /// What a part declared, or all that it has.
    fn declared(&self, (section, place): Place) -> Vec<Place> {
        if let Some(on) = self.variables.dependence(section, place) {
            return on;
        }
        let of = |section: Section| ranges(self.parts, section, self.variables);
        let part = of(section).iter().position(|range| range.contains(&place)).unwrap_or(0);
        let all = [Section::State, Section::Connected].into_iter();
        all.flat_map(|section| of(section)[part].clone().map(move |place| (section, place))).collect()
    }
}

/// The dependence of every signal, connected value and derivative on states and inputs of the whole.
pub(super) fn closure(
    links: &[Link],
    errors: &[ErrorCoordinates],
    parts: &[Part],
    variables: &Variables,
) -> Vec<Dependence> {
    let from = links.iter().map(|link| (link.to, link.from)).collect();
    let mut sources = Sources { from, errors, parts, variables, found: HashMap::new() };
    let mut all = Vec::new();
    for section in [Section::Connected, Section::Signal, Section::Derivative] {
        for place in 0..variables.real_sizes[section as usize] {
            let mut on = sources.of((section, place));
            let pairs = errors.iter().flat_map(ErrorCoordinates::pairs);
            for (_, model) in pairs.filter(|(state, _)| section == Section::Derivative && *state == place) {
                on.extend(sources.of((Section::Derivative, model)));
            }
            let span = |&(section, start): &(usize, usize)| {
                let section = if section == Section::State as usize { Section::State } else { Section::Input };
                Span { section, start, len: 1 }
            };
            all.push(Dependence { of: Span { section, start: place, len: 1 }, on: on.iter().map(span).collect() });
        }
    }
    all
}
