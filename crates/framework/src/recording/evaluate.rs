//! Evaluation of a recording on numbers: the reference for every other form of it.

use super::iteration;
use super::method::Recording;
use super::tape::{Leaf, Node, Tape};

/// Inputs of a recording.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// Time, s.
    pub time: f64,
    /// Length of the communication step that was completed, s.
    pub step: f64,
    /// The block's real values.
    pub reals: &'a [f64],
    /// The block's integers.
    pub integers: &'a [i32],
    /// True for event indicators that changed sides.
    pub crossed: &'a [bool],
}

impl Given<'_> {
    /// The value of a leaf.
    pub fn leaf(&self, leaf: Leaf) -> f64 {
        match leaf {
            Leaf::Time => self.time,
            Leaf::Step => self.step,
            Leaf::Real(place) => self.reals[place as usize],
            Leaf::Integer(place) => f64::from(self.integers[place as usize]),
            Leaf::Crossed(indicator) => f64::from(u8::from(self.crossed[indicator as usize])),
            // Nothing changes in a point.
            Leaf::TimeChange | Leaf::Change(_) | Leaf::Slope(_) => 0.0,
        }
    }
}

impl Tape {
    /// The value of every operation.
    pub fn values(&self, given: &Given) -> Vec<f64> {
        iteration::values(self.operations(), &|leaf| given.leaf(leaf), &|_| f64::NAN)
    }
}

impl Recording {
    /// Returns the block's new real values and integers, and the method's results.
    pub fn carry_out(&self, given: &Given) -> (Vec<f64>, Vec<i32>, Vec<f64>) {
        let values = self.tape.values(given);
        let of = |nodes: &[Node]| nodes.iter().map(|node| values[node.index()]).collect::<Vec<f64>>();
        (of(&self.reals), of(&self.integers).into_iter().map(|value| value as i32).collect(), of(&self.results))
    }
}
