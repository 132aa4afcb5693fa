//! Checks of the integers of a saved state.

use super::{Block, Model};
use crate::system::{Data, DiscreteHandle, Element, Section, Variable};

impl Model {
    /// The least and the greatest value of each integer of a block, by its place.
    pub fn integer_ranges(&self) -> Vec<(i32, i32)> {
        let variables = &self.variables;
        // What is no variable is a flag of the simulation's own, or a copy.
        let mut ranges = vec![(0, 1); variables.integers(Section::Memory).end];
        for element in variables.iter().filter(|v| !v.is_real()).flat_map(Variable::elements) {
            ranges[variables.index(element)] = element.variable.data.integers();
        }
        for (section, copy) in self.controls.copied_integers(variables) {
            ranges.copy_within(variables.integers(section), copy);
        }
        ranges
    }

    /// Checks the integers of a block that comes from elsewhere.
    ///
    /// # Errors
    /// The first value that no instance has. A parameter that waits to be taken over may be beyond its limits: it is
    /// refused then.
    pub fn check_integers(&self, block: &Block) -> Result<(), String> {
        let variables = &self.variables;
        let flag = variables.integers(Section::Memory).start + self.controls.parameters_set.place().1;
        let parameters = variables.integers(Section::Parameter);
        let waits = |place: &usize| block.integers[flag] == 1 && parameters.contains(place);
        let ranges = self.integer_ranges();
        let beyond = |place: &usize| {
            let (least, most) = ranges[*place];
            !(least..=most).contains(&block.integers[*place])
        };
        let Some(place) = (0..ranges.len()).find(|place| beyond(place) && !(waits(place) && self.has_limits(*place)))
        else {
            return Ok(());
        };
        let (value, (least, most)) = (block.integers[place], ranges[place]);
        let name = self.visible_integer(place).map_or_else(|| format!("internal value {place}"), |it| it.name());
        Err(format!("{name} = {value}: must be within {least} … {most}"))
    }

    /// True if the limits of an integer are checked when it is taken over, not when it is set.
    fn has_limits(&self, place: usize) -> bool {
        self.visible_integer(place).is_some_and(|it| matches!(it.variable.data, Data::Integer { .. }))
    }

    fn visible_integer(&self, place: usize) -> Option<Element<'_>> {
        let variables = &self.variables;
        variables.visible().find(|it| !it.variable.is_real() && variables.index(*it) == place)
    }
}
