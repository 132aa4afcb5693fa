//! Present parameters, for equations that are compiled for these values only.

use serde::{Deserialize, Serialize};

use crate::model::{Block, Model};
use crate::recording::{Leaf, Method, Operation, Recording};
use crate::system::Section;

/// Sections that depend on parameters only.
const SECTIONS: [Section; 2] = [Section::Parameter, Section::Prepared];

/// Parameters and what was prepared from them, as far as they are known: their places in the block, ascending, and their
/// values.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Settled {
    /// Reals, as bits.
    pub reals: Vec<(u32, u64)>,
    /// Integers.
    pub integers: Vec<(u32, i32)>,
}

impl Settled {
    /// Those of a block.
    pub fn of(model: &Model, block: &Block) -> Self {
        Settled::common(model, block, block)
    }

    /// Those that two blocks have in common.
    pub fn common(model: &Model, block: &Block, other: &Block) -> Self {
        let variables = model.variables();
        let event = Recording::of(model.system(), Method::Event, &variables.layout());
        // Values that events may write aren't known.
        let stays = |node, leaf| *event.tape.operation(node) == Operation::Leaf(leaf);
        let real = |place: usize| {
            let [bits, others] = [block, other].map(|block| block.reals[place].to_bits());
            let is_known = bits == others && stays(event.reals[place], Leaf::Real(place as u32));
            is_known.then_some((place as u32, bits))
        };
        let integer = |place: usize| {
            let [value, others] = [block, other].map(|block| block.integers[place]);
            let is_known = value == others && stays(event.integers[place], Leaf::Integer(place as u32));
            is_known.then_some((place as u32, value))
        };
        Settled {
            reals: SECTIONS.into_iter().flat_map(|it| variables.reals(it)).filter_map(real).collect(),
            integers: SECTIONS.into_iter().flat_map(|it| variables.integers(it)).filter_map(integer).collect(),
        }
    }

    /// The value of what is given to equations, where it is known.
    pub fn known(&self, leaf: Leaf) -> Option<f64> {
        fn value<T: Copy>(stored: &[(u32, T)], place: u32) -> Option<T> {
            stored.binary_search_by_key(&place, |(place, _)| *place).ok().map(|found| stored[found].1)
        }
        match leaf {
            Leaf::Real(place) => value(&self.reals, place).map(f64::from_bits),
            Leaf::Integer(place) => value(&self.integers, place).map(f64::from),
            _ => None,
        }
    }
}
