//! Dependences in a model, as its recorded equations have them (FMI 2.0.4, section 2.2.8).

use std::collections::{BTreeMap, BTreeSet};

use crate::recording::{Leaf, Method, Node, Note, Operation, Recording, Tape};
use crate::system::{Causality, DynSystem, Element, Section, Variables};

/// A value's place in the block: of reals, or of integers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// Among the reals.
    Real(usize),
    /// Among the integers.
    Integer(usize),
}

impl Place {
    /// The place of an element.
    pub fn of(variables: &Variables, element: Element<'_>) -> Self {
        let index = variables.index(element);
        if element.variable.is_real() { Place::Real(index) } else { Place::Integer(index) }
    }
}

/// Dependences of outputs and derivatives: while a simulation runs, and at its start.
#[derive(Debug, Clone)]
pub struct Structure {
    running: BTreeMap<Place, Vec<Place>>,
    start: BTreeMap<Place, Vec<Place>>,
}

impl Structure {
    /// Finds the dependences in a system's equations and its start, with the place of time.
    pub fn of(system: &dyn DynSystem, variables: &Variables, time: Place) -> Self {
        let found = |method| Recording::of(system, method, &variables.layout());
        let wanted = |element: &Element<'_>| {
            let is_output = element.variable.causality == Causality::Output;
            is_output || matches!(element.variable.section, Section::State | Section::Derivative | Section::Connected)
        };
        let unknowns: Vec<Place> =
            variables.visible().filter(wanted).map(|element| Place::of(variables, element)).collect();
        Structure {
            running: dependence(&found(Method::Evaluate), &unknowns, |leaf| running(leaf, variables, time)),
            start: dependence(&found(Method::Start), &unknowns, |leaf| start(leaf, variables)),
        }
    }

    /// The inputs and states, and time, that an output, a derivative or a connected value depends on while a simulation runs.
    pub fn running(&self, place: Place) -> &[Place] {
        self.running.get(&place).map_or(&[], Vec::as_slice)
    }

    /// The inputs and parameters that the start value of an output, a state or a derivative depends on.
    pub fn start(&self, place: Place) -> &[Place] {
        self.start.get(&place).map_or(&[], Vec::as_slice)
    }
}

fn dependence(
    recording: &Recording,
    unknowns: &[Place],
    knowns: impl Fn(Leaf) -> Vec<Place>,
) -> BTreeMap<Place, Vec<Place>> {
    let node = |place: &Place| match *place {
        Place::Real(index) => recording.reals[index],
        Place::Integer(index) => recording.integers[index],
    };
    let nodes: Vec<Node> = unknowns.iter().map(node).collect();
    let on = recording.tape.dependence(&nodes, |leaf| !knowns(leaf).is_empty());
    let places = |leaves: Vec<Leaf>| {
        let places: BTreeSet<_> = leaves.into_iter().flat_map(&knowns).collect();
        places.into_iter().collect()
    };
    unknowns.iter().copied().zip(on.into_iter().map(places)).collect()
}

/// Variables of a master behind a leaf of the equations: an input, a state or time.
fn running(leaf: Leaf, variables: &Variables, time: Place) -> Vec<Place> {
    let is_known = |place: usize, ranges: &[std::ops::Range<usize>]| ranges.iter().any(|range| range.contains(&place));
    match leaf {
        Leaf::Real(place) => {
            let known = [variables.reals(Section::State), variables.reals(Section::Input)];
            is_known(place as usize, &known).then_some(Place::Real(place as usize)).into_iter().collect()
        }
        Leaf::Integer(place) => {
            let known = [variables.integers(Section::Input)];
            is_known(place as usize, &known).then_some(Place::Integer(place as usize)).into_iter().collect()
        }
        Leaf::Time => vec![time],
        _ => Vec::new(),
    }
}

/// Variables of a master behind a leaf of the start: an input, a parameter, or the parameters of a prepared value.
fn start(leaf: Leaf, variables: &Variables) -> Vec<Place> {
    match leaf {
        Leaf::Real(place) => {
            let place = place as usize;
            let known = [variables.reals(Section::Parameter), variables.reals(Section::Input)];
            if known.iter().any(|range| range.contains(&place)) {
                vec![Place::Real(place)]
            } else if variables.reals(Section::Prepared).contains(&place) {
                prepared_from(place, variables)
            } else {
                Vec::new()
            }
        }
        Leaf::Integer(place) => {
            let place = place as usize;
            let known = [variables.integers(Section::Parameter), variables.integers(Section::Input)];
            let is_known = known.iter().any(|range| range.contains(&place));
            is_known.then_some(Place::Integer(place)).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

/// Parameters that a design's result depends on. A design isn't recorded, so these are all parameters of its system.
fn prepared_from(place: usize, variables: &Variables) -> Vec<Place> {
    let first = variables.reals(Section::Prepared).start;
    // Variables of a composite's part begin with its name.
    let part = |name: &str| name.split_once('.').map(|(part, _)| part.to_owned());
    let of = variables.real_at(Section::Prepared, place - first).and_then(|element| part(&element.variable.name));
    let of_part = variables.iter().filter(|v| v.section == Section::Parameter && part(&v.name) == of);
    let shown = of_part.filter(|v| v.causality == Causality::Parameter && !variables.is_control(v));
    shown.flat_map(|v| v.elements().map(|element| Place::of(variables, element)).collect::<Vec<_>>()).collect()
}

/// True if the end of a communication step stands aside: what it changes is read only by such ends and by events, not by
/// signals, rates, indicators and the times of events, and neither it nor a check reads rates.
pub(crate) fn ends_aside(variables: &Variables, recorded: impl Fn(Method) -> Recording) -> bool {
    // A part of a composite is never stepped by itself.
    let memory = variables.integers(Section::Memory).start;
    let is_never_set = |tape: &Tape, node| match tape.operation(node) {
        Operation::Leaf(Leaf::Integer(place)) => {
            variables.never_stepped.iter().any(|flag| memory + flag == *place as usize).then_some(false)
        }
        _ => None,
    };
    let recorded = |method| recorded(method).simplified(&is_never_set);
    let end = recorded(Method::StepCompleted);
    let node = |recording: &Recording, leaf| match leaf {
        Leaf::Real(place) => recording.reals.get(place as usize).copied(),
        Leaf::Integer(place) => recording.integers.get(place as usize).copied(),
        _ => None,
    };
    let changes = |recording: &Recording, leaf: Leaf| {
        node(recording, leaf).is_some_and(|node| *recording.tape.operation(node) != Operation::Leaf(leaf))
    };
    let computed = [Section::State, Section::Connected, Section::Signal, Section::Derivative];
    let is_in = |sections: &[Section], leaf: Leaf| {
        let is_there =
            |place: u32| sections.iter().any(|&section| variables.reals(section).contains(&(place as usize)));
        matches!(leaf, Leaf::Real(place) if is_there(place))
    };
    let reals = (0..variables.reals(Section::Memory).end).map(|place| Leaf::Real(place as u32));
    let leaves = reals.chain((0..variables.integers(Section::Memory).end).map(|place| Leaf::Integer(place as u32)));
    // What a method computes: of the values, those that change.
    let reads = |method, is_read: &dyn Fn(Leaf) -> bool| {
        let recording = if method == Method::StepCompleted { &end } else { &recorded(method) };
        let changed = leaves.clone().filter(|&leaf| changes(recording, leaf)).filter_map(|leaf| node(recording, leaf));
        let notes = recording.tape.notes().iter().map(Note::condition);
        let wanted: Vec<Node> = changed.chain(recording.results.iter().copied()).chain(notes).collect();
        recording.tape.dependence(&wanted, is_read).iter().any(|leaves| !leaves.is_empty())
    };
    let is_rate = |leaf| is_in(&[Section::Derivative], leaf);
    !leaves.clone().any(|leaf| changes(&end, leaf) && is_in(&computed, leaf))
        && ![Method::Evaluate, Method::Indicators, Method::NextTimeEvent]
            .into_iter()
            .any(|it| reads(it, &|leaf| changes(&end, leaf)))
        && ![Method::StepCompleted, Method::Check].into_iter().any(|it| reads(it, &is_rate))
}
