//! Start values for a run: parameter sets, and single values.

use std::path::PathBuf;

use adaptive_fmu::error::Error;
use adaptive_fmu::structure::{Event, LoopFiles, Structure};

#[derive(clap::Args, Default, Clone)]
pub struct Parameters {
    /// Parameter set to apply, a file or one next to the loop (repeatable).
    ///
    /// Names in the set are UNIT.variable, where UNIT is a component of the loop. If several sets give a variable a
    /// value, the last one counts. Values of --set override it.
    #[arg(long, value_name = "FILE.ssv")]
    pub case: Vec<PathBuf>,
    /// Start value of a variable (repeatable).
    ///
    /// UNIT is a component of the loop, or an FMU that only one component uses. With --composite, a name without UNIT
    /// is a parameter of the single FMU, such as relative_tolerance.
    #[arg(long, value_name = "UNIT.variable=VALUE")]
    pub set: Vec<String>,
    /// Value that a tunable parameter or an open input gets while the loop runs (repeatable)
    ///
    /// For example --event '5: plant.mass=2', with the time in s. It is set at the first communication point that is not before it.
    #[arg(long, value_name = "TIME: UNIT.variable=VALUE")]
    pub event: Vec<String>,
}

impl Parameters {
    /// A parameter set, and single values.
    pub fn new(case: Option<&str>, set: Vec<String>) -> Self {
        Parameters { case: case.map(PathBuf::from).into_iter().collect(), set, event: Vec::new() }
    }

    /// Parameter sets, single values, and events.
    pub fn of(case: Vec<PathBuf>, set: Vec<String>, event: Vec<String>) -> Self {
        Parameters { case, set, event }
    }

    /// Hands them to a loop: cases first, then single values.
    pub fn apply(&self, structure: &mut Structure, files: &LoopFiles) -> Result<(), Error> {
        self.case.iter().try_for_each(|case| structure.apply_case(case, files))?;
        self.set.iter().try_for_each(|assignment| structure.set(assignment))?;
        let events = self.event.iter().map(|text| Event::read(text)).collect::<Result<Vec<_>, _>>()?;
        structure.events.extend(events);
        Ok(())
    }
}
