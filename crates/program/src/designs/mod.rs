//! Recommends a controller for a plant. Candidates of several kinds are designed, simulated as FMUs with the nominal
//! plant and with the worst plants within its uncertainty, and ranked.

mod candidate;
mod page;
mod rank;
mod series;
mod trial;
mod worst_case;
mod written;

pub use candidate::{Candidate, Design, Kind, PLANT, REFERENCE, Ran, Task};
pub use page::{figures, page, report_page};
pub use rank::{ranked, shortfall};
pub use series::{Course, Followed};
pub use trial::Noise;
pub use worst_case::{Cases, Steps, WorstCase, steps};

use crate::error::Error;
use crate::scratch::Scratch;
use crate::structure::{STRUCTURE, Wishes};
use crate::template::round_up;
use written::Written;

/// The loop's folder, below that of the candidates.
const LOOP: &str = "loop";
/// Settling times before the reference steps in the loop that is written, and after it.
const BEFORE: f64 = 0.5;
const AFTER: f64 = 3.0;

/// Writes a description of each candidate, and the loop of one of them. Returns their paths in the folder, and the name
/// of the loop.
///
/// # Errors
/// When the loop can't be closed.
pub fn files(task: &Task, candidates: &[Candidate], best: &Design, name: &str) -> Result<Vec<(String, String)>, Error> {
    let scratch = Scratch::new()?;
    let designs = candidates.iter().filter_map(|candidate| candidate.outcome.as_ref().ok());
    let texts: Vec<_> = designs.flat_map(|design| design.texts.iter().cloned()).collect();
    Written::new(scratch.path(), texts.iter().cloned())?;
    let settles = best.worst().or_else(|| best.followed().cloned()).and_then(|followed| followed.settling);
    let time = settles.unwrap_or(4.0 / best.bandwidth);
    let surroundings = candidate::surroundings(&task.plant, &task.references, best.bandwidth, round_up(BEFORE * time))?;
    let written = Written::new(&scratch.path().join(LOOP), surroundings.clone())?;
    let written = written.beside(best.texts.iter().map(|(name, _)| name.as_str()));
    let stop_time = Some(round_up((BEFORE + AFTER) * time));
    let (_, structure) =
        written.structure(Wishes { name: name.to_owned(), step: Some(best.step), stop_time, ..Wishes::default() })?;
    let own = texts.into_iter().map(|(name, text)| (format!("{name}.toml"), text));
    let of_loop = surroundings.into_iter().map(|(name, text)| (format!("{LOOP}/{name}.toml"), text));
    Ok(own.chain(of_loop).chain([(format!("{LOOP}/{STRUCTURE}"), structure)]).collect())
}
