//! Present parameters, for equations that are compiled for these values only.

use crate::model::{Block, Model};
use crate::recording::{Leaf, Method, Operation, Recording};
use crate::system::Section;

/// Sections that depend on parameters only.
const SECTIONS: [Section; 2] = [Section::Parameter, Section::Prepared];

/// The parameters of an instance at a time, and what was prepared from them.
#[derive(Debug)]
pub struct Settled {
    /// Values at that time, with the begin of each section.
    reals: [(usize, Vec<f64>); 2],
    integers: [(usize, Vec<i32>); 2],
    /// Places that events write, whatever they are: these aren't known.
    real_events: Vec<usize>,
    integer_events: Vec<usize>,
}

impl Settled {
    /// Those of a block.
    pub fn of(model: &Model, block: &Block) -> Self {
        let variables = model.variables();
        let (reals, integers) = (SECTIONS.map(|it| variables.reals(it)), SECTIONS.map(|it| variables.integers(it)));
        let event = Recording::of(model.system(), Method::Event, &variables.layout());
        let is_same = |node, leaf| *event.tape.operation(node) == Operation::Leaf(leaf);
        let written = |place: &usize| !is_same(event.reals[*place], Leaf::Real(*place as u32));
        let written_integer = |place: &usize| !is_same(event.integers[*place], Leaf::Integer(*place as u32));
        Settled {
            real_events: reals.iter().cloned().flatten().filter(written).collect(),
            integer_events: integers.iter().cloned().flatten().filter(written_integer).collect(),
            reals: reals.map(|range| (range.start, block.reals[range].to_vec())),
            integers: integers.map(|range| (range.start, block.integers[range].to_vec())),
        }
    }

    /// The value of what is given to equations, where it is known.
    pub fn known(&self, leaf: Leaf) -> Option<f64> {
        fn value<T: Copy>(kept: &[(usize, Vec<T>)], place: usize) -> Option<T> {
            kept.iter().find_map(|(start, values)| values.get(place.checked_sub(*start)?).copied())
        }
        match leaf {
            Leaf::Real(place) if !self.real_events.contains(&(place as usize)) => value(&self.reals, place as usize),
            Leaf::Integer(place) if !self.integer_events.contains(&(place as usize)) => {
                value(&self.integers, place as usize).map(f64::from)
            }
            _ => None,
        }
    }

    /// True if a block holds the same, to the bit.
    pub fn holds(&self, block: &Block) -> bool {
        // Without a branch a value, for this is asked at every step.
        let real = |(now, then): (&f64, &f64)| now.to_bits() ^ then.to_bits();
        let differ = self.reals.iter().fold(0, |differ, (start, values)| {
            block.reals[*start..].iter().zip(values).map(real).fold(differ, |differ, bits| differ | bits)
        });
        differ == 0 && self.integers.iter().all(|(start, values)| block.integers[*start..].starts_with(values))
    }
}
