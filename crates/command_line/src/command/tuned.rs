//! Result of a search: printed, and written.

use std::path::PathBuf;
use std::time::Duration;

use adaptive_fmu::error::Error;
use adaptive_fmu::figures::{Part, of_plot, svg};
use adaptive_fmu::output::Files;
use adaptive_fmu::simulation::Recording;
use adaptive_fmu::structure::{Plot, Scale};
use adaptive_fmu::tuning::{Best, Generation, Outcome, Range, Swarm, parameter_set};
use serde_json::{Map, Value, json};

use super::tune::{Before, Ended, RECORD, Task};
use crate::console;

pub const TUNED: &str = "tuned.ssv";
pub const CONVERGENCE: &str = "convergence.svg";

/// The result of a search.
pub struct Tuned {
    pub task: Task,
    pub best: Best,
    pub before: Option<Before>,
    /// Another form of the loop than that of the search, and the outcome of the best values in it.
    pub again: Option<(&'static str, Outcome)>,
    /// The swarm after the last whole generation.
    pub swarm: Swarm,
    pub ended: Ended,
    pub took: Duration,
    pub folder: PathBuf,
}

impl Tuned {
    fn failed(&self) -> usize {
        self.swarm.history().iter().map(|generation| generation.failed).sum()
    }

    fn name(&self) -> &str {
        &self.task.structure.name
    }

    fn ranges(&self) -> &[Range] {
        self.task.search.ranges()
    }

    fn values(&self) -> impl Iterator<Item = (&str, f64)> {
        self.ranges().iter().map(|range| range.name.as_str()).zip(self.best.position.iter().copied())
    }
}

/// Writes the best values as parameter sets, of the loop and of each unit, and how the search went.
pub fn write_results(tuned: &Tuned) -> Result<(), Error> {
    let mut files = Files::at(&tuned.folder);
    let remark = format!("Found for {} by a particle swarm; its objective is {}.", tuned.name(), tuned.best.value);
    let set = |values: &[(&str, f64)]| parameter_set("tuned", &remark, values).map_err(Error::file(&tuned.folder));
    files.add(TUNED, set(&tuned.values().collect::<Vec<_>>())?)?;
    for unit in tuned.task.structure.components.iter().map(|component| &component.name) {
        let of_unit = |(name, value)| Some((str::strip_prefix(name, unit.as_str())?.strip_prefix('.')?, value));
        let values: Vec<_> = tuned.values().filter_map(of_unit).collect();
        if !values.is_empty() {
            files.add(format!("{unit}.ssv"), set(&values)?)?;
        }
    }
    let history = tuned.swarm.history();
    let column = |of: fn(&Generation) -> Option<f64>| {
        history.iter().map(|generation| of(generation).unwrap_or(f64::NAN)).collect::<Vec<_>>()
    };
    let names = ["best so far", "median particle so far"].map(str::to_owned).to_vec();
    let recording = Recording {
        names: names.clone(),
        times: (1..=history.len()).map(|generation| generation as f64).collect(),
        columns: vec![column(|generation| generation.best), column(|generation| generation.median)],
        ..Recording::default()
    };
    let parts = vec![Part::Own; names.len()];
    let plot = Plot { title: "objective".to_owned(), signals: names, scale: Scale::ByValues, references: Vec::new() };
    let wrong = |reason| Error::Loop { file: tuned.folder.clone(), reason };
    let diagram = of_plot("generation", &plot, &parts, &recording).map_err(wrong)?;
    files.add(CONVERGENCE, svg(tuned.name(), &[diagram]))?;
    files.place()
}

/// Prints a table of the values, or what a script wants.
pub fn print(tuned: &Tuned, json: bool) {
    let Tuned { best, before, again, ended, took, folder, .. } = tuned;
    let (name, start) = (tuned.name(), before.as_ref().and_then(|before| before.objective));
    if json {
        let parameters: Map<String, Value> =
            tuned.values().map(|(name, value)| (name.to_owned(), json!(value))).collect();
        let again = again.as_ref().map(|(_, outcome)| outcome.value());
        print_line!(
            "{}",
            json!({ "loop": name, "ended": if ended.interrupted { "interrupted" } else { "complete" },
                    "objective": { "start": start, "best": best.value, "verified": again },
                    "parameters": parameters, "generations": tuned.swarm.history().len(), "runs": ended.runs,
                    "failed": tuned.failed(), "seconds": took.as_secs_f64(), "results": console::path(folder) })
        );
        return;
    }
    let shown = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.6}"));
    print_line!("{name:34} {:>14} {:>14}   bounds", "as it is", "tuned");
    print_line!("{:34} {:>14} {:>14}", "objective", shown(start), shown(Some(best.value)));
    for (k, range) in tuned.ranges().iter().enumerate() {
        let (was, is) = (before.as_ref().map(|before| before.values[k]), best.position[k]);
        print_line!("{:34} {:>14} {is:>14.6}   {} … {}", range.name, shown(was), range.low, range.high);
    }
    match again {
        Some((how, Outcome::Value(value))) => print_line!("objective of the loop {how}: {value:.6}"),
        Some((how, Outcome::Failed(reason))) => error_line!("warning: the loop {how} fails: {reason}"),
        _ => {}
    }
    if let Some(reason) = &ended.reason {
        print_line!("{} runs failed and count as worst. The last one: {reason}", tuned.failed());
    }
    if ended.interrupted {
        error_line!("interrupted in generation {}. Repeat the command to continue", tuned.swarm.history().len() + 1);
    }
    print_line!("{} runs took {:.1} s", ended.runs, took.as_secs_f64());
    let folder = folder.display();
    print_line!(
        "{TUNED} (for --case), a parameter set for each component (for export --values), {CONVERGENCE} and {RECORD} \
         are in {folder}"
    );
}
