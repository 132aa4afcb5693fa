//! A loaded loop: the data of its page, and its runs.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread;
use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};

use super::blocks;
use super::cases::Base;
use super::parameters::{Parameter, written};
use super::steps::{Step, Steps};
use crate::clock::Instant;
use crate::error::Error;
use crate::fmu;
use crate::results::{Ending, Report, measure};
use crate::simulation::{LoadedLoop, Recording};
use crate::structure::{Settings, Structure};

/// Groups of points of a curve, which has about twice as many points.
const GROUPS: usize = 250;
/// Interval at which a run reports its progress.
const REPORT_INTERVAL: Duration = Duration::from_millis(150);
/// Interval at which a waiting run checks if it may begin.
const LOOK: Duration = Duration::from_millis(5);
/// Longest time for runs to end with the program.
const PATIENCE: Duration = Duration::from_secs(2);
/// The most pages whose latest requests are stored.
const MOST_PAGES: usize = 100;

/// A loop that is explored.
#[derive(Debug)]
pub struct Session {
    pub(super) bases: Vec<Base>,
    /// Start values of its variables in the loop's files, by names; a set leaves them out.
    pub(super) plain: BTreeMap<String, fmu::Value>,
    pub(super) parameters: Vec<Parameter>,
    settings: Settings,
    /// The same with the communication step of metrics.
    fine: Settings,
    whole: bool,
    /// Notes on how it is run.
    notes: Vec<String>,
    /// Folder for files.
    pub(super) out: PathBuf,
    /// Lock for one run at a time, if FMUs of other tools allow no more.
    turn: Option<Mutex<()>>,
    /// Number of the newest request of each page; older ones end.
    newest: Mutex<HashMap<String, u64>>,
    is_ending: AtomicBool,
    /// Each run holds it.
    running: Arc<()>,
    /// True if exported FMUs have terminals.
    pub(super) terminals: bool,
}

/// Request of a page: values in place of those of a case.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wanted {
    /// The page, and the number of its request.
    #[serde(default)]
    pub page: String,
    #[serde(default)]
    pub number: u64,
    /// True to measure metrics exactly as `run` does.
    #[serde(default)]
    pub fine: bool,
    /// The case; none for the loop as it is.
    pub case: Option<String>,
    /// Numbers, truth values, and names of an enumeration's items.
    pub values: BTreeMap<String, Value>,
    /// Values that variables get from a time on.
    #[serde(default)]
    pub events: Vec<Step>,
    /// Name of files to be written.
    #[serde(default)]
    pub name: String,
    /// True to replace existing files.
    #[cfg(not(target_family = "wasm"))]
    #[serde(default)]
    pub replace: bool,
}

/// Values with their parameters.
type Chosen<'a> = Vec<(&'a Parameter, fmu::Value)>;

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Session {
    /// A session of a loop, the first of `bases`, and of its cases; `plain` is the loop of its files. Each change runs
    /// with the first settings, and with the others when the user pauses; these differ in their communication step.
    pub fn new(
        bases: Vec<Base>,
        plain: &LoadedLoop,
        (settings, fine): (Settings, Settings),
        whole: bool,
        notes: Vec<String>,
        out: PathBuf,
    ) -> Self {
        let parameters = bases.first().map_or_else(Vec::new, |base| Parameter::of(&base.structure, &base.loaded));
        let start = |(name, place, _)| Some((name, plain.value_of(place)?));
        let plain = plain.variables().filter_map(start).collect();
        let turn = (!whole).then(Mutex::default);
        let (newest, is_ending, running) = (Mutex::default(), AtomicBool::new(false), Arc::default());
        Session {
            bases,
            plain,
            parameters,
            settings,
            fine,
            whole,
            notes,
            out,
            turn,
            newest,
            is_ending,
            running,
            terminals: false,
        }
    }

    /// The same, with or without terminals in the FMUs that it exports.
    #[must_use]
    pub fn with_terminals(self, terminals: bool) -> Self {
        Session { terminals, ..self }
    }

    /// Ends all runs, and waits for a limited time until their components are freed.
    pub fn end(&self) {
        self.is_ending.store(true, Ordering::SeqCst);
        let begun = Instant::now();
        while Arc::strong_count(&self.running) > 1 && begun.elapsed() < PATIENCE {
            thread::sleep(LOOK);
        }
    }

    /// The loop's name.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn name(&self) -> &str {
        &self.bases[0].structure.name
    }

    /// Data that a page shows before the first run.
    pub(crate) fn to_json(&self) -> Value {
        let Base { structure, loaded, .. } = &self.bases[0];
        let notes = [&self.notes[..], loaded.notes()].concat();
        let values = |base: &Base| {
            let start = |it: &Parameter| Some((it.name.clone(), it.to_json(&base.loaded.value_of(it.place)?)));
            let starts: BTreeMap<_, _> = self.parameters.iter().filter_map(start).collect();
            json!({ "name": base.name, "values": starts })
        };
        let Settings { start_time, stop_time, step, .. } = self.settings;
        let changeable = loaded.changeables().filter(|(name, ..)| structure.unit_of(name).is_some());
        let changeable = changeable.map(|(name, place, variable)| {
            let value = loaded.value_of(place).map(|value| written(&value, &variable.items).1);
            json!({ "name": name, "measure": variable.unit, "description": variable.description, "value": value })
        });
        json!({ "name": structure.name, "description": structure.description, "whole": self.whole,
                "notes": notes, "blocks": blocks::svg(structure),
                "settings": { "start": start_time, "stop": stop_time, "step": step,
                              "fine_step": self.fine.step },
                "parameters": self.parameters, "changeable": changeable.collect::<Vec<_>>(),
                "cases": self.bases.iter().map(values).collect::<Vec<_>>(),
                "out": self.out.to_string_lossy() })
    }

    /// The case and the values that are asked for, with their parameters.
    ///
    /// # Errors
    /// A name that doesn't exist, or a value of another type.
    pub(super) fn find(&self, wanted: &Wanted) -> Result<(&Base, Chosen<'_>), String> {
        let base = self.bases.iter().find(|base| base.name == wanted.case);
        let case = wanted.case.as_deref().unwrap_or_default();
        let base = base.ok_or_else(|| {
            let known: Vec<_> = self.bases.iter().filter_map(|base| base.name.as_deref()).collect();
            format!("there is no case `{case}`; there are: {}", known.join(", "))
        })?;
        let value = |(name, given): (&String, &Value)| {
            let parameter = self.parameters.iter().find(|parameter| parameter.name == *name);
            let parameter = parameter.ok_or_else(|| format!("there is no adjustable parameter `{name}`"))?;
            parameter.value(given).map(|value| (parameter, value))
        };
        Ok((base, wanted.values.iter().map(value).collect::<Result<_, String>>()?))
    }

    /// True if the page has made no newer request.
    fn is_newest(&self, wanted: &Wanted) -> bool {
        let is_newest = locked(&self.newest).get(&wanted.page).is_none_or(|&number| number <= wanted.number);
        is_newest && !self.is_ending.load(Ordering::SeqCst)
    }

    fn begin(&self, wanted: &Wanted) {
        let mut newest = locked(&self.newest);
        if newest.len() >= MOST_PAGES && !newest.contains_key(&wanted.page) {
            newest.clear();
        }
        let number = newest.entry(wanted.page.clone()).or_default();
        *number = wanted.number.max(*number);
    }

    /// Runs the loop and reports its progress. It ends early if nobody listens any more, or for a newer request of the
    /// same page.
    pub(crate) fn run(&self, wanted: &Wanted, progress: &mut dyn FnMut(Value) -> bool) -> Result<Value, String> {
        let _running = Arc::clone(&self.running);
        let (base, values) = self.find(wanted)?;
        self.begin(wanted);
        let ended = json!({ "superseded": true });
        let begun = Instant::now();
        let Some(_turn) = self.turn(wanted, progress) else { return Ok(ended) };
        let mut reported = begun;
        let places: Vec<_> = values.into_iter().map(|(parameter, value)| (parameter.place, value)).collect();
        let settings = if wanted.fine { self.fine } else { self.settings };
        let Steps { events, changes } = match Steps::new(&base.loaded, &wanted.events, settings) {
            Ok(steps) => steps,
            Err((place, reason)) => return Ok(json!({ "refused": reason, "at": [], "events": [place] })),
        };
        let closed = match base.loaded.instantiate_changing(&places, &changes) {
            Ok(closed) => closed,
            Err(error) => return Ok(refused(&error, wanted)),
        };
        let Settings { start_time, stop_time, .. } = settings;
        let mut goes_on = true;
        let result = closed.run(settings, |time| {
            goes_on = self.is_newest(wanted);
            if reported.elapsed() > REPORT_INTERVAL {
                reported = Instant::now();
                goes_on &= progress(json!({ "done": (time - start_time) / (stop_time - start_time) }));
            }
            goes_on || time >= stop_time
        });
        if !goes_on {
            return Ok(ended);
        }
        let (recording, failure) = match result {
            Ok(recording) => (recording, None),
            Err((error, recording)) if recording.times.len() < 2 => {
                drop(recording);
                return Ok(refused(&error, wanted));
            }
            Err((error, recording)) => (*recording, Some(error)),
        };
        let mut structure = Cow::Borrowed(&base.structure);
        if !events.is_empty() {
            structure.to_mut().events.extend(events);
        }
        let at = failure.as_ref().map_or_else(Vec::new, |error| wanted.events_of(error));
        let mut answer = self.answer(&structure, settings, recording, failure, begun)?;
        answer["events"] = json!(at);
        Ok(answer)
    }

    /// Waits until a run may begin; none if the page no longer waits for it.
    fn turn(&self, wanted: &Wanted, progress: &mut dyn FnMut(Value) -> bool) -> Option<Option<MutexGuard<'_, ()>>> {
        let Some(turn) = &self.turn else { return Some(None) };
        let mut reported = Instant::now();
        loop {
            match turn.try_lock() {
                Ok(turn) => return Some(Some(turn)),
                Err(TryLockError::Poisoned(turn)) => return Some(Some(turn.into_inner())),
                Err(TryLockError::WouldBlock) => thread::sleep(LOOK),
            }
            let is_due = reported.elapsed() > REPORT_INTERVAL;
            if is_due {
                reported = Instant::now();
            }
            if !self.is_newest(wanted) || is_due && !progress(json!({ "done": 0.0, "waits": true })) {
                return None;
            }
        }
    }

    /// Result of a run.
    fn answer(
        &self,
        structure: &Structure,
        settings: Settings,
        mut recording: Recording,
        failure: Option<Error>,
        begun: Instant,
    ) -> Result<Value, String> {
        let measured = measure(structure, &mut recording)?;
        let ending = failure.map_or(Ending::Complete, |error| Ending::Failed(error.to_string()));
        let (fine, whole) = (settings == self.fine, self.whole);
        let report = Report {
            structure,
            settings,
            whole,
            recording: &recording,
            measured: &measured,
            ending: &ending,
            thinned: None,
        };
        let diagrams: Vec<Value> = report.diagrams()?.iter().map(|diagram| diagram.with_points(GROUPS)).collect();
        let metrics: Vec<Value> = measured
            .iter()
            .map(|it| json!({ "label": it.label, "value": it.value, "limit": it.limit, "holds": it.holds() }))
            .collect();
        Ok(json!({ "fine": fine, "diagrams": diagrams, "metrics": metrics, "warnings": recording.warnings,
                   "shortfall": report.shortfall(), "end": report.end(), "points": recording.times.len(),
                   "seconds": begun.elapsed().as_secs_f64() }))
    }
}

/// The component that an error comes from, and its message.
fn unit_and_message(error: &Error) -> (&str, String) {
    match error {
        Error::Unit { unit, function, message, .. } => {
            (unit, message.strip_prefix(&format!("{function}: ")).unwrap_or(message).to_owned())
        }
        other => ("", other.to_string()),
    }
}

/// True if an error is about a variable of the loop.
fn is_about(error: &Error, name: &str) -> bool {
    let (unit, message) = unit_and_message(error);
    let variable = name.strip_prefix(unit).and_then(|rest| rest.strip_prefix('.'));
    // A message may be about all elements of a matrix.
    let whole = name.split('[').next();
    [Some(name), variable, whole].into_iter().flatten().any(|name| names(&message, name))
}

/// Refusal of these values by a component, and the controls at which it is shown.
fn refused(error: &Error, wanted: &Wanted) -> Value {
    let at: Vec<&String> = wanted.values.keys().filter(|name| is_about(error, name)).collect();
    json!({ "refused": unit_and_message(error).1, "at": at, "events": wanted.events_of(error) })
}

impl Wanted {
    /// The places of the changes during the run that an error is about.
    fn events_of(&self, error: &Error) -> Vec<usize> {
        (0..self.events.len()).filter(|&place| is_about(error, &self.events[place].name)).collect()
    }
}

/// True if a message names a variable, and not one with a longer name.
fn names(message: &str, name: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || "_[".contains(c);
    message.match_indices(name).any(|(place, _)| {
        let (before, after) = (&message[..place], &message[place + name.len()..]);
        !before.ends_with(is_part) && !after.starts_with(is_part)
    })
}

#[cfg(test)]
mod tests {
    use super::names;

    #[test]
    fn a_message_is_about_the_variables_that_it_names() {
        let message = "controller.adaptation_gain = -1: must be at least 0, as Q[1,1] is";
        assert!(names(message, "controller.adaptation_gain") && names(message, "Q[1,1]"));
        assert!(!names(message, "gain") && !names(message, "Q") && !names(message, "controller.adaptation"));
    }
}
