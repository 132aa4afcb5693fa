//! The values of a law that its outputs need.

use std::collections::BTreeSet;

use super::law::{CONTROL, EVALUATED, Law, is_in, leaves};
use crate::error::Invalid;
use crate::recording::{Leaf, Node};
use crate::system::{Section, Variable};

/// Bits of an unsigned integer for the sides of indicators.
const MOST_INDICATORS: usize = 32;

/// Flags of values of the block.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Live {
    pub reals: Vec<bool>,
    pub integers: Vec<bool>,
}

impl Live {
    pub fn add(&mut self, leaf: Leaf) {
        match leaf {
            Leaf::Real(place) => self.reals[place as usize] = true,
            Leaf::Integer(place) => self.integers[place as usize] = true,
            _ => {}
        }
    }
}

impl Law<'_> {
    /// Follows what outputs need until nothing is added.
    pub(super) fn find_live(&mut self) {
        let variables = self.variables();
        let (reals, integers) = (self.start.reals.len(), self.start.integers.len());
        self.live = Live { reals: vec![false; reals], integers: vec![false; integers] };
        let outputs: Vec<usize> = self.outputs().into_iter().map(|y| variables.index(y)).collect();
        outputs.into_iter().for_each(|place| self.live.reals[place] = true);
        let flags: Vec<usize> = self.flags().into_iter().map(|y| variables.index(y)).collect();
        flags.into_iter().for_each(|place| self.live.integers[place] = true);
        self.limited().into_iter().for_each(|(before, _)| self.live.reals[before] = true);
        loop {
            let before = self.live.clone();
            let found: BTreeSet<Leaf> =
                self.all().into_iter().flat_map(|(recording, nodes)| leaves(recording, &nodes)).collect();
            let is_constant = |leaf: &Leaf| matches!(leaf, Leaf::Real(k) if self.constant(*k as usize).is_some());
            let found: Vec<Leaf> = found.into_iter().filter(|leaf| !is_constant(leaf)).collect();
            found.into_iter().for_each(|leaf| self.live.add(leaf));
            self.complete();
            self.indicators = self.effective_indicators();
            if self.live == before {
                return;
            }
        }
    }

    /// A state or a discrete variable is there with all its elements.
    fn complete(&mut self) {
        let variables = self.variables();
        let is_stored = |v: &&Variable| matches!(v.section, Section::State | Section::Discrete | Section::Memory);
        for variable in variables.iter().filter(is_stored) {
            let first = variables.index(variable.element(0));
            let live = if variable.is_real() { &mut self.live.reals } else { &mut self.live.integers };
            let all = &mut live[first..first + variable.len()];
            if all.contains(&true) {
                all.fill(true);
            }
        }
    }

    /// Event indicators that can change sides, where events have an effect on what is live.
    fn effective_indicators(&self) -> Vec<usize> {
        let (reals, integers) = self.changed(&self.recorded.event);
        if reals.is_empty() && integers.is_empty() {
            return Vec::new();
        }
        let indicators = &self.recorded.indicators;
        let is_constant = |k: &usize| indicators.tape.constant(indicators.results[*k]).is_some();
        (0..indicators.results.len()).filter(|k| !is_constant(k)).collect()
    }

    /// The element of the control that an output is.
    pub(super) fn control(&self, place: usize) -> Option<usize> {
        let control = self.variables().iter().find(|v| v.name == CONTROL && v.is_real())?;
        place.checked_sub(self.variables().index(control.element(0))).filter(|&k| k < control.len())
    }

    /// Outputs that limits cut: the place before, and that of the output. Rotors have others than `u_min` and `u_max`.
    pub(super) fn limited(&self) -> Vec<(usize, usize)> {
        let variables = self.variables();
        let pairs = variables.iter().filter(|v| v.section == Section::Signal).filter_map(|v| {
            let first = variables.reals(Section::Signal).start;
            let behind = v.behind.filter(|_| v.is_real())?;
            Some((0..v.len()).map(move |k| (first + v.start + k, first + behind + k)))
        });
        pairs.flatten().filter(|(before, output)| before != output).collect()
    }

    /// Finds whether indicators can change sides within a step.
    pub(super) fn find_indicators(&mut self) -> Result<(), Invalid> {
        if self.indicators.len() > MOST_INDICATORS {
            let reason =
                format!("has {} event indicators, at most {MOST_INDICATORS} are possible", self.indicators.len());
            return Err(Invalid::new("model", &self.model.description().model, reason));
        }
        let (recording, evaluate) = (&self.recorded.indicators, &self.recorded.evaluate);
        let nodes: Vec<Node> = self.indicators.iter().map(|&k| recording.results[k]).collect();
        let variables = self.variables();
        let mut read = leaves(recording, &nodes);
        let evaluated = |leaf: &Leaf| match *leaf {
            Leaf::Real(place) => is_in(&EVALUATED, |section| variables.reals(section), place as usize)
                .then(|| evaluate.reals[place as usize]),
            Leaf::Integer(place) => is_in(&EVALUATED, |section| variables.integers(section), place as usize)
                .then(|| evaluate.integers[place as usize]),
            _ => None,
        };
        let signals: Vec<Node> = read.iter().filter_map(evaluated).collect();
        read.extend(leaves(evaluate, &signals));
        let states = variables.reals(Section::State);
        self.events_within = read.iter().any(|leaf| match leaf {
            Leaf::Time => true,
            Leaf::Real(place) => states.contains(&(*place as usize)),
            _ => false,
        });
        Ok(())
    }
}
