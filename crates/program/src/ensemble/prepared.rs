//! The model of a loop as a single FMU, and the values that its runs start with.

use std::sync::Arc;

use crate::execution::{Execution, Settled};
use crate::fmi2::calls::Standard;
use crate::fmi2::model_description::{guid, guid_text};
use crate::fmi2::source::ensemble::Slot;
use crate::fmu::Value;
use crate::library::REGISTRY;
use crate::model::{Block, Description, Model};
use crate::simulation::{Change, LoadedLoop, LoadedUnit, Place, ROUNDING};
use crate::structure::Settings;

/// A model whose runs are prepared.
#[derive(Debug)]
pub struct Prepared {
    model: Arc<Model>,
    settings: Settings,
    /// Start values of the loop, by value references.
    values: Vec<(u32, Value)>,
    /// Value references of its variables.
    references: Vec<u32>,
    /// Changes of the loop itself.
    changes: Vec<Change>,
    settled: Settled,
}

/// The start of a run.
#[derive(Debug, Clone)]
pub struct Start {
    /// All values at the start.
    pub(super) block: Block,
    /// Numbers of the communication steps at which changes are due, if they are, and all values then but for what
    /// depends on the run.
    pub(super) changes: Vec<(Option<u32>, Block)>,
}

impl Prepared {
    /// The model of a loop.
    ///
    /// # Errors
    /// Why it has none.
    pub fn new(loaded: &LoadedLoop, settings: Settings) -> Result<Self, String> {
        let [LoadedUnit { fmu, values, .. }] = loaded.units() else {
            return Err("the loop is not one continuous system".to_owned());
        };
        let foreign = || "its FMU isn't of this program's models".to_owned();
        let text = fmu.own_description().ok_or_else(foreign)?;
        let described = Description::read(&text).map_err(|error| error.to_string())?;
        let model = Model::from_description(described, REGISTRY).map_err(|_| foreign())?;
        if fmu.description.standard != Standard::Fmi2 || guid_text(guid(&model)) != fmu.description.guid {
            return Err(foreign());
        }
        let variables = &fmu.description.variables;
        let values = values.iter().map(|(place, value)| (variables[*place].reference, value.clone())).collect();
        let changes = loaded.changes().to_vec();
        let references = variables.iter().map(|variable| variable.reference).collect();
        Ok(Prepared { model: Arc::new(model), settings, values, references, changes, settled: Settled::default() })
    }

    /// Refuses changes that a kernel takes otherwise than an FMU: of inputs, which an FMU may interpolate, and at the start, on which
    /// initial states depend.
    pub fn check(&self, loaded: &LoadedLoop, changes: &[Change]) -> Result<(), String> {
        let variables = &loaded.units()[0].fmu.description.variables;
        for change in self.changes.iter().chain(changes) {
            let variable = &variables[change.place.variable];
            if variable.causality == "input" {
                return Err(format!("the input `{}` changes during a run", variable.name));
            }
            if self.step_of(change.at) == Some(0) {
                return Err(format!("`{}` changes at the start", variable.name));
            }
        }
        Ok(())
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The parameters that runs have in common.
    pub fn settled(&self) -> &Settled {
        &self.settled
    }

    /// Takes the parameters that these runs have in common, at all times, as those of all runs.
    pub fn settle(&mut self, starts: &[Start]) {
        let mut blocks =
            starts.iter().flat_map(|start| std::iter::once(&start.block).chain(start.changes.iter().map(|it| &it.1)));
        let Some(first) = blocks.next() else { return };
        let mut settled = Settled::of(&self.model, first);
        for other in blocks {
            settled.reals.retain(|(place, bits)| other.reals[*place as usize].to_bits() == *bits);
            settled.integers.retain(|(place, value)| other.integers[*place as usize] == *value);
        }
        self.settled = settled;
    }

    /// True if a run has the parameters of all runs.
    pub fn holds(&self, start: &Start) -> bool {
        let holds = |block: &Block| {
            let reals = |(place, bits): &(u32, u64)| block.reals[*place as usize].to_bits() == *bits;
            let integers = |(place, value): &(u32, i32)| block.integers[*place as usize] == *value;
            self.settled.reals.iter().all(reals) && self.settled.integers.iter().all(integers)
        };
        holds(&start.block) && start.changes.iter().all(|(_, block)| holds(block))
    }

    /// The place of a signal in the block.
    pub fn slot(&self, loaded: &LoadedLoop, name: &str) -> Result<Slot, String> {
        let (place, _) = loaded.variable(name).ok_or_else(|| format!("there is no signal `{name}`"))?;
        let (reference, reals) = (self.references[place.variable] as usize, self.model.start().reals.len());
        Ok(if reference < reals { Slot::Real(reference) } else { Slot::Integer(reference - reals) })
    }

    /// The start of a run with these values and changes; none if the model refuses them.
    pub fn start(&self, values: &[(Place, Value)], changes: &[Change]) -> Option<Start> {
        let own = self.values.iter().map(|(reference, value)| (*reference, value.clone()));
        let further = values.iter().map(|(place, value)| (self.references[place.variable], value.clone()));
        let mut given: Vec<_> = own.chain(further).collect();
        let block = self.block(&given)?;
        let mut changes = [&self.changes[..], changes].concat();
        changes.sort_by(|a, b| a.at.total_cmp(&b.at));
        let mut later: Vec<(Option<u32>, Block)> = Vec::new();
        for change in changes {
            given.push((self.references[change.place.variable], change.value.clone()));
            let step = self.step_of(change.at);
            if let Some(last) = later.last_mut().filter(|last| last.0 == step) {
                // Both are taken over together.
                last.0 = None;
            }
            later.push((step, self.block(&given)?));
        }
        Some(Start { block, changes: later })
    }

    /// The number of the communication step that begins with a change, if one does.
    fn step_of(&self, at: f64) -> Option<u32> {
        let is_due = |(time, next): (f64, f64)| at <= time + ROUNDING * (next - time);
        self.settings.points().position(is_due).map(|number| number as u32)
    }

    /// All values at the start of a run with these values, by their references.
    fn block(&self, given: &[(u32, Value)]) -> Option<Block> {
        let mut execution = Execution::new(Arc::clone(&self.model));
        let reals = self.model.start().reals.len();
        for (reference, value) in given {
            let place = *reference as usize;
            match value {
                Value::Real(value) => execution.set_real(place, *value),
                Value::Integer(value) => execution.set_integer(place - reals, *value),
                Value::Boolean(value) => execution.set_integer(place - reals, i32::from(*value)),
                Value::String(_) => return None,
            }
        }
        execution.set_time(self.settings.start_time);
        execution.initialise().ok()?;
        Some(execution.block().clone())
    }
}
