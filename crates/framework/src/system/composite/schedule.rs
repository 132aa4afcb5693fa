//! The order in which parts are evaluated: every value is computed before it is used.

use super::Part;
use super::connection::Link;
use crate::error::Invalid;
use crate::recording::{Leaf, Recording};
use crate::system::variable::{Section, Variables};
use crate::system::{Declaration, Offsets};

/// A step on the way to all signals.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step {
    /// A value becomes an input of a part.
    Copy {
        /// Section and place of the value.
        from: (Section, usize),
        /// Place among the connected values.
        to: usize,
    },
    /// A part computes its signals.
    Evaluate(usize),
}

/// Ranges of the parts' values in one section.
pub(super) fn ranges(parts: &[Part], section: Section, d: &Variables) -> Vec<std::ops::Range<usize>> {
    let begin = |base: &Offsets| base.real[section as usize];
    let end = |k: usize| parts.get(k + 1).map_or(d.real_sizes[section as usize], |next| begin(&next.base));
    parts.iter().enumerate().map(|(k, part)| begin(&part.base)..end(k)).collect()
}

/// Known values at some point of the schedule.
struct Progress<'a> {
    links: &'a [Link],
    /// The connected values that each signal directly follows from.
    follows_from: Vec<Vec<usize>>,
    inputs: Vec<std::ops::Range<usize>>,
    signals: Vec<std::ops::Range<usize>>,
    known_input: Vec<bool>,
    known_signal: Vec<bool>,
    steps: Vec<Step>,
}

impl Progress<'_> {
    /// Copies every value that has become known to where it goes.
    fn hand_on(&mut self) {
        for link in self.links {
            let known = link.from.0 != Section::Signal || self.known_signal[link.from.1];
            if known && !self.known_input[link.to] {
                self.known_input[link.to] = true;
                self.steps.push(Step::Copy { from: link.from, to: link.to });
            }
        }
    }

    /// True if an input of a part has its value; those that aren't linked aren't inputs.
    fn is_known(&self, place: usize) -> bool {
        self.known_input[place] || self.links.iter().all(|link| link.to != place)
    }

    fn complete(&self, part: usize) -> bool {
        self.inputs[part].clone().all(|place| self.is_known(place))
    }

    /// True if a signal can be computed from what is known.
    fn computable(&self, signal: usize) -> bool {
        self.follows_from[signal].iter().all(|&place| self.is_known(place))
    }

    /// Evaluates a part. Returns true if a further value became known.
    fn evaluate(&mut self, part: usize) -> bool {
        let new: Vec<usize> = self.signals[part]
            .clone()
            .filter(|&signal| !self.known_signal[signal] && self.computable(signal))
            .collect();
        let wanted = |signal: &usize| self.links.iter().any(|link| link.from == (Section::Signal, *signal));
        let complete = self.complete(part);
        if !complete && !new.iter().any(wanted) {
            return false;
        }
        new.iter().for_each(|&signal| self.known_signal[signal] = true);
        self.steps.push(Step::Evaluate(part));
        self.hand_on();
        true
    }
}

/// The connected values that each signal follows from, as the parts' equations have it.
fn follows_from(parts: &[Part], variables: &mut Variables) -> Vec<Vec<usize>> {
    variables.place_sections();
    let layout = variables.layout();
    let recording = Recording::with(&layout, &|_| None, |t, v| {
        for part in parts {
            v.outputs_of(part.system.as_ref(), t, &part.offsets(&layout.offsets));
        }
        Vec::new()
    });
    let connected = variables.reals(Section::Connected);
    let place = |leaf: Leaf| match leaf {
        Leaf::Real(index) if connected.contains(&(index as usize)) => Some(index as usize - connected.start),
        _ => None,
    };
    let signals = &recording.reals[variables.reals(Section::Signal)];
    let on = recording.tape.dependence(signals, |leaf| place(leaf).is_some());
    on.into_iter().map(|leaves| leaves.into_iter().filter_map(place).collect()).collect()
}

/// The steps to all signals.
///
/// # Errors
/// The connections of an algebraic loop.
pub(super) fn schedule(links: &[Link], parts: &[Part], d: &mut Declaration) -> Result<Vec<Step>, Invalid> {
    let follows_from = follows_from(parts, &mut d.variables);
    let variables = &d.variables;
    let mut progress = Progress {
        links,
        follows_from,
        inputs: ranges(parts, Section::Connected, variables),
        signals: ranges(parts, Section::Signal, variables),
        known_input: vec![false; variables.real_sizes[Section::Connected as usize]],
        known_signal: vec![false; variables.real_sizes[Section::Signal as usize]],
        steps: Vec::new(),
    };
    progress.hand_on();
    let mut waiting: Vec<usize> = (0..parts.len()).collect();
    while !waiting.is_empty() {
        // A part whose inputs are all known is evaluated once and for all; else one that brings the others forward.
        let ready = waiting.iter().position(|&part| progress.complete(part));
        if let Some(place) = ready {
            progress.evaluate(waiting.remove(place));
            continue;
        }
        if !waiting.iter().any(|&part| progress.evaluate(part)) {
            let unknown = links.iter().filter(|link| !progress.known_input[link.to]).map(|link| link.names.as_str());
            let unknown: Vec<_> = unknown.collect();
            let advice = "outputs that depend on each other without a state between them; put a state (a lag, a delay) \
                          between two of them";
            return Err(Invalid::because(format!("algebraic loop through {}: {advice}", unknown.join(", "))));
        }
    }
    Ok(progress.steps)
}
