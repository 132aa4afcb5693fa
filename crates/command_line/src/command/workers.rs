//! Workers of the program that is served: it gets jobs as messages, and replies with their results.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::workers::Workers;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::progress;
use crate::console;

/// Interval between checks whether the command is to stop, while no result comes.
const LOOK: Duration = Duration::from_millis(100);

/// The other end: where results come in.
static RESULTS: Mutex<Option<Sender<(u64, Value)>>> = Mutex::new(None);

/// Jobs of one request.
pub struct OfRequest {
    last: AtomicU64,
    results: Mutex<Receiver<(u64, Value)>>,
}

impl OfRequest {
    /// Takes the results that come from now on.
    pub fn new() -> Self {
        let (sender, results) = channel();
        *RESULTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(sender);
        OfRequest { last: AtomicU64::new(0), results: Mutex::new(results) }
    }
}

/// Takes a result.
pub fn take(number: u64, result: Value) {
    if let Some(sender) = &*RESULTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) {
        // Results of a request that has ended are dropped.
        let _ = sender.send((number, result));
    }
}

impl Workers for OfRequest {
    fn submit(&self, job: Value) -> u64 {
        let number = self.last.fetch_add(1, Ordering::Relaxed) + 1;
        // As a text: numbers keep all their digits on the way.
        console::send("job", &json!({ "number": number, "job": job.to_string() }), &[]);
        number
    }

    fn result(&self) -> Option<(u64, Value)> {
        let results = self.results.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        while !progress::is_interrupted() {
            match results.recv_timeout(LOOK) {
                Err(RecvTimeoutError::Timeout) => {}
                result => return result.ok(),
            }
        }
        None
    }
}

/// A job of a worker, from the hidden option --job.
///
/// # Errors
/// A text that is none.
pub fn job<J: DeserializeOwned>(text: &str) -> Result<J, Error> {
    serde_json::from_str(text).map_err(|error| Error::Argument(Invalid::new("--job", text, error.to_string())))
}

/// Prints the result of a job.
pub fn reply(result: &impl Serialize) {
    print_line!("{}", json!(result));
}
