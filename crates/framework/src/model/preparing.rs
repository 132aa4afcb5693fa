//! Values that follow from a model's parameters.

use super::{Block, Model};
use crate::error::{Invalid, Number};
use crate::system::{Data, MessageLog, Section};

impl Model {
    /// Checks every parameter against its limits, then prepares what depends on them: what is designed, and what follows.
    ///
    /// # Errors
    /// [`Invalid`] with every reason.
    pub fn prepare(&self, block: &mut Block, log: &mut MessageLog) -> Result<(), Invalid> {
        self.check_limits(block)?;
        let designed = self.system.prepare(&mut block.point(self, log));
        self.equations().relate(&mut block.point(self, log));
        let mut invalid = log.accepted().err().unwrap_or_default();
        designed.unwrap_or_else(|reasons| invalid.and(reasons));
        invalid.into_result().map_err(|invalid| self.variables.named_refusal(invalid))?;
        let prepared = self.variables.reals(Section::Prepared);
        let start = prepared.start;
        let broken = prepared.into_iter().find(|&index| !block.reals[index].is_finite());
        let element = broken.and_then(|index| self.variables.real_at(Section::Prepared, index - start));
        element.map_or(Ok(()), |element| {
            let allowed = "follows from the parameters and must be finite: they are too large or too small";
            Err(Invalid::new(element.name(), Number(block.reals[self.variables.index(element)]), allowed))
        })
    }

    /// Takes over what was prepared from the start values, where these are the parameters: a design takes longer than all
    /// else that a start takes. Whether they are.
    pub(crate) fn prepare_as_at_start(&self, block: &mut Block) -> bool {
        let Some(prepared) = &self.prepared else { return false };
        let (reals, integers) = (self.variables.reals(Section::Parameter), self.variables.integers(Section::Parameter));
        let same = |(one, other): (&f64, &f64)| one.to_bits() == other.to_bits();
        if !block.reals[reals.clone()].iter().zip(&self.start.reals[reals]).all(same)
            || block.integers[integers.clone()] != self.start.integers[integers]
        {
            return false;
        }
        let (reals, integers) = (self.variables.reals(Section::Prepared), self.variables.integers(Section::Prepared));
        block.reals[reals].copy_from_slice(&prepared.reals);
        block.integers[integers].copy_from_slice(&prepared.integers);
        true
    }

    fn check_limits(&self, block: &Block) -> Result<(), Invalid> {
        let mut invalid = Invalid::none();
        let parameters = self.variables.iter().filter(|variable| variable.section == Section::Parameter);
        for element in parameters.flat_map(|variable| variable.elements()) {
            let index = self.variables.index(element);
            match &element.variable.data {
                Data::Real { min, above_min, max, .. } => {
                    let value = block.reals[index];
                    if !element.variable.data.allows(value) {
                        invalid.and(Invalid::new(element.name(), Number(value), allowed(*min, *above_min, *max)));
                    }
                }
                Data::Integer { limits: Some((min, max)), .. } => {
                    let value = block.integers[index];
                    if !element.variable.data.allows(f64::from(value)) {
                        invalid.and(Invalid::new(element.name(), value, format!("must be within {min} … {max}")));
                    }
                }
                _ => {}
            }
        }
        invalid.into_result()
    }

    /// The prepared values of a block; none if it differs from the start in anything else.
    pub(super) fn prepared_alone(&self, block: &Block) -> Option<Block> {
        let (reals, integers) = (self.variables.reals(Section::Prepared), self.variables.integers(Section::Prepared));
        let prepared =
            Block { reals: block.reals[reals.clone()].to_vec(), integers: block.integers[integers.clone()].to_vec() };
        let mut with = self.start.clone();
        with.reals[reals].copy_from_slice(&prepared.reals);
        with.integers[integers].copy_from_slice(&prepared.integers);
        (with == *block).then_some(prepared)
    }
}

fn allowed(min: Option<f64>, above_min: bool, max: Option<f64>) -> String {
    match (min.map(Number), max.map(Number)) {
        (Some(min), Some(max)) if above_min => format!("must be above {min} and at most {max}"),
        (Some(min), Some(max)) => format!("must be within {min} … {max}"),
        (Some(min), None) if above_min => format!("must be above {min}"),
        (Some(min), None) => format!("must be at least {min}"),
        (None, Some(max)) => format!("must be at most {max}"),
        (None, None) => "must be finite".to_owned(),
    }
}
