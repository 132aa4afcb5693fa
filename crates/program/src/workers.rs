//! Workers outside of this process that do jobs of a command, such as the runs of a search.

use std::sync::{Arc, PoisonError, RwLock};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// Workers: they do jobs in any order, in other processes or on other machines.
pub trait Workers: Send + Sync {
    /// Hands out a job, and returns its number.
    fn submit(&self, job: Value) -> u64;

    /// Waits for a result, with the number of its job; `None` if the command should stop.
    fn result(&self) -> Option<(u64, Value)>;
}

static EMPLOYED: RwLock<Option<Arc<dyn Workers>>> = RwLock::new(None);

/// Hands out jobs of commands to these workers from now on; with `None`, commands do their jobs themselves.
pub fn employ(workers: Option<Arc<dyn Workers>>) {
    *EMPLOYED.write().unwrap_or_else(PoisonError::into_inner) = workers;
}

/// The workers of this command; `None` if it does its jobs itself.
pub fn employed() -> Option<Arc<dyn Workers>> {
    EMPLOYED.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Results of jobs, in their order; `None` for jobs not done. `done` gets each result as it comes.
pub fn results<R: DeserializeOwned>(
    workers: &dyn Workers,
    jobs: impl IntoIterator<Item = impl Serialize>,
    mut done: impl FnMut(&R),
) -> Vec<Option<R>> {
    let numbers: Vec<u64> = jobs.into_iter().map(|job| workers.submit(value(&job))).collect();
    let mut results: Vec<Option<R>> = numbers.iter().map(|_| None).collect();
    for _ in 0..numbers.len() {
        let Some((number, result)) = workers.result() else { break };
        let place = numbers.iter().position(|known| *known == number);
        if let Some((place, result)) = place.zip(R::deserialize(result).ok()) {
            done(&result);
            results[place] = Some(result);
        }
    }
    results
}

fn value(job: &impl Serialize) -> Value {
    serde_json::to_value(job).unwrap_or_default()
}
