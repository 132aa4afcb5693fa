//! Recommends a controller for a plant. Candidates of several kinds are designed, simulated as FMUs with the nominal
//! plant and with the worst plants within its uncertainty, and ranked.

mod candidate;
mod design_loop;
mod page;
mod rank;
mod reported;
mod series;
mod trial;
mod worst_case;
mod written;

pub use candidate::{Candidate, Design, Judged, Kind, PLANT, REFERENCE, Ran, Task, settling_time};
pub use design_loop::DesignLoop;
pub use page::{figures, page, report_page};
pub use rank::{ranked, shortfall};
pub use reported::{add_runs, lines};
pub use series::{Course, Followed};
pub use trial::{Noise, NotRun};
pub use worst_case::{Cases, WorstCase};
pub use written::Written;

use crate::error::Error;
use crate::exporter::Library;
use crate::structure::{STRUCTURE, Wishes};
use crate::template::round_up;

/// The loop's folder, below that of the candidates.
const LOOP: &str = "loop";
/// Settling times before the reference steps in the loop that is written, and after it.
const LOOP_TIMES: [f64; 2] = [0.5, 3.0];

/// Writes a description of each candidate, and the loop of one of them. Returns their paths in the folder, and the name
/// of the loop.
///
/// # Errors
/// When the loop can't be closed.
pub fn files(
    task: &Task,
    candidates: &[Candidate],
    best: &Design,
    (name, library): (&str, &Library),
) -> Result<Vec<(String, String)>, Error> {
    let designs = candidates.iter().filter_map(|candidate| candidate.outcome.as_ref().ok());
    let texts: Vec<_> = designs.flat_map(|design| design.texts.iter().cloned()).collect();
    let settles = best.worst().or_else(|| best.followed().cloned()).and_then(|followed| followed.settling);
    let time = settles.unwrap_or(4.0 / best.bandwidth);
    let surroundings =
        candidate::surroundings(&task.plant, &task.references, best.bandwidth, round_up(LOOP_TIMES[0] * time))?;
    let written = Written::new(surroundings.clone()).with_shared(best.texts.iter().cloned());
    let stop_time = Some(round_up(LOOP_TIMES.iter().sum::<f64>() * time));
    let (_, structure) = written
        .structure(library, Wishes { name: name.to_owned(), step: Some(best.step), stop_time, ..Wishes::default() })?;
    let own = texts.into_iter().map(|(name, text)| (format!("{name}.toml"), text));
    let of_loop = surroundings.into_iter().map(|(name, text)| (format!("{LOOP}/{name}.toml"), text));
    Ok(own.chain(of_loop).chain([(format!("{LOOP}/{STRUCTURE}"), structure)]).collect())
}
