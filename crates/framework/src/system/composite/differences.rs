//! Differences as coordinates: where a part compares another part's state x with a state x_m of its own, e = x − x_m is
//! integrated in place of x.

use super::connection::Link;
use super::schedule::ranges;
use super::{Composite, Part};
use crate::system::values::{Offsets, Span};
use crate::system::variable::{Causality, Data, Section, Variable, Variables};
use crate::system::{Declaration, Scalar};

/// One vector of states that is integrated as a difference.
#[derive(Debug, Clone)]
pub(super) struct DifferenceCoordinates {
    /// Places of the states.
    pub states: Span,
    /// Places of the states that they differ from.
    pub model_states: Span,
    /// Places among the connected values: the states themselves, and the difference as the part that compares is given it.
    pub own: usize,
    pub passed: usize,
}

impl DifferenceCoordinates {
    /// Places of each state and of the one that it differs from.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        self.states.range().zip(self.model_states.range())
    }
}

/// Finds which parts are integrated as differences, and moves their states among the connected values.
pub(super) fn apply(links: &[Link], parts: &mut [Part], d: &mut Declaration) -> Vec<DifferenceCoordinates> {
    let mut found = Vec::new();
    for difference in d.differences.clone() {
        let sources: Option<Vec<(Section, usize)>> = difference
            .x
            .range()
            .map(|place| links.iter().find(|link| link.to == place).map(|link| link.from))
            .collect();
        let Some(states) = sources.and_then(|sources| whole_variable(&sources, &d.variables)) else { continue };
        let range = ranges(parts, Section::State, &d.variables);
        let Some(part) = range.iter().position(|range| range.contains(&states.start)) else { continue };
        let place = *parts[part].own_states.get_or_insert_with(|| {
            let size = &mut d.variables.real_sizes[Section::Connected as usize];
            std::mem::replace(size, *size + range[part].len())
        });
        let own = place + states.start - range[part].start;
        rename(states, own, difference.nominal, &mut d.variables);
        let is_flag =
            |v: &&mut Variable| v.section == Section::Connected && !v.is_real() && v.start == difference.is_passed;
        if let Some(Data::Boolean { start }) = d.variables.list.iter_mut().find(is_flag).map(|v| &mut v.data) {
            *start = true;
        }
        found.push(DifferenceCoordinates {
            states,
            model_states: difference.x_m,
            own,
            passed: difference.passed.start,
        });
    }
    found
}

/// The variable of states that these places are, all of it and in its order.
fn whole_variable(places: &[(Section, usize)], variables: &Variables) -> Option<Span> {
    let first = *places.first()?;
    let ordered = places.iter().enumerate().all(|(k, &place)| place == (Section::State, first.1 + k));
    let span = Span { section: Section::State, start: first.1, len: places.len() };
    let is_it =
        |v: &&Variable| v.section == Section::State && v.is_real() && (v.start, v.len()) == (span.start, span.len);
    variables.list.iter().find(is_it).filter(|_| ordered).map(|_| span)
}

/// The states become connected values of the same name; what is integrated are differences.
fn rename(states: Span, own: usize, magnitude: f64, variables: &mut Variables) {
    let Some(index) = variables.list.iter().position(|v| v.section == Section::State && v.start == states.start) else {
        return;
    };
    let mut error = variables.list[index].clone();
    let plant = &mut variables.list[index];
    (plant.section, plant.start) = (Section::Connected, own);
    let name = format!("{}_error", plant.name);
    error.description = (0..plant.len())
        .map(|offset| format!("{} as it differs from its reference model", plant.element(offset).own_text()))
        .collect();
    error.name.clone_from(&name);
    error.given.iter_mut().flatten().for_each(|given| given.push_str("_error"));
    let given = error.given.clone();
    error.causality = Causality::Local;
    if let Data::Real { nominal, .. } = &mut error.data {
        *nominal = vec![magnitude];
    }
    variables.list.insert(index + 1, error);
    let rate = variables.list.iter_mut().find(|v| v.section == Section::Derivative && v.start == states.start);
    if let Some(rate) = rate {
        (rate.name, rate.given) = (name, given);
    }
}

/// Links that start at states which were moved start where they are now.
pub(super) fn redirect(links: Vec<Link>, parts: &[Part], d: &Declaration) -> Vec<Link> {
    let range = ranges(parts, Section::State, &d.variables);
    let moved = |(section, place): (Section, usize)| {
        let part = range.iter().position(|range| section == Section::State && range.contains(&place));
        let own = part.and_then(|part| parts[part].own_states.map(|own| own + place - range[part].start));
        own.map_or((section, place), |own| (Section::Connected, own))
    };
    links.into_iter().map(|link| Link { from: moved(link.from), ..link }).collect()
}

impl Composite {
    /// Places of states, and of the parts' own copies of them.
    fn moved(&self, whole: &Offsets) -> impl Iterator<Item = (std::ops::Range<usize>, usize)> {
        let (state, connected) = (whole.real[Section::State as usize], whole.real[Section::Connected as usize]);
        let len = move |k: usize| {
            let end = self.parts.get(k + 1).map_or(whole.real[Section::State as usize + 1] - state, |next| {
                next.base.real[Section::State as usize]
            });
            end - self.parts[k].base.real[Section::State as usize]
        };
        let parts = self.parts.iter().enumerate();
        parts.filter_map(move |(k, part)| {
            let start = state + part.base.real[Section::State as usize];
            part.own_states.map(|own| (start..start + len(k), connected + own))
        })
    }

    /// The states themselves: x = e + x_m; and e, for the part that compares.
    pub(super) fn give_own_states<S: Scalar>(&self, reals: &mut [S], whole: &Offsets) {
        self.moved(whole).for_each(|(states, own)| reals.copy_within(states, own));
        let (state, connected) = (whole.real[Section::State as usize], whole.real[Section::Connected as usize]);
        for difference in &self.differences {
            for (k, (place, model_place)) in difference.pairs().enumerate() {
                let (e, x_m) = (reals[state + place], reals[state + model_place]);
                reals[connected + difference.own + k] = e + x_m;
                reals[connected + difference.passed + k] = e;
            }
        }
    }

    /// Takes over states that a part changed: e = x − x_m, but not where nothing was changed, since e is the sharper number.
    pub(super) fn take_own_states<S: Scalar>(&self, reals: &mut [S], whole: &Offsets) {
        let (state, connected) = (whole.real[Section::State as usize], whole.real[Section::Connected as usize]);
        let is_difference = |place: usize| {
            self.differences.iter().any(|difference| difference.states.range().contains(&(place - state)))
        };
        for (states, own) in self.moved(whole) {
            let first = states.start;
            for place in states.filter(|&place| !is_difference(place)) {
                reals[place] = reals[own + place - first];
            }
        }
        for difference in &self.differences {
            for (k, (place, model_place)) in difference.pairs().enumerate() {
                let (x, x_m) = (reals[connected + difference.own + k], reals[state + model_place]);
                let e = reals[state + place];
                reals[state + place] = S::select(x.equals(e + x_m), e, x - x_m);
            }
        }
    }

    /// Gives parts their declared start values as own states before the start.
    pub(super) fn declared_own_states<S: Scalar>(&self, reals: &mut [S], whole: &Offsets) {
        self.moved(whole).for_each(|(states, own)| reals.copy_within(states, own));
    }
}
