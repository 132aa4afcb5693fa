//! Runs on a graphics card. It takes fixed steps, so each run is made with two lengths of them, and a part of the runs again with
//! error control on the processor, whose results count: every run that isn't complete or whose metrics depend on the length, every
//! run near a limit, and a share of all, which show how accurate the others are.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use serde_json::{Value, json};

use super::backend::Backend;
use super::outcome::{Limits, Outcome};
use super::study::{Batch, Study};
use super::summary::thousands;
use crate::ensemble::{Device, Runner, Start};
use crate::parallel;
use crate::report::number;
use crate::results::Meter;
use crate::simulation::Recording;
use crate::structure::Structure;

/// Runs by which fixed steps are chosen.
const PILOT: u64 = 100;
/// Further on, one of so many runs is made again, and so many of them at most.
const AGAIN: u64 = 100;
const MOST_AGAIN: u64 = 1000;
/// The largest difference of a metric in parts of its limit: in the pilot and from one length of steps to its half, and of all runs
/// with error control.
const PILOT_DIFFERENCE: f64 = 2e-4;
const DIFFERENCE: f64 = 1e-3;
/// Runs within this part of a limit are near it: three times the largest difference that a study may have.
const NEAR: f64 = 3.0 * DIFFERENCE;
/// Memory for the runs that are made at a time, bytes; and of a step metric at each of so many points at most.
const MEMORY: usize = 2 << 30;
const BYTES_OF_POINT: usize = 96;
const MOST_POINTS: usize = 1 << 16;
/// Fewer seconds on the processor aren't worth a kernel.
const WORTH_IT: f64 = 10.0;
const INTERRUPTED: &str = "the study was interrupted";
const ENDS_EARLY: &str = "with fixed steps, runs reach their end that don't with error control";
/// The most fixed steps of a run.
const MOST_STEPS: usize = 10_000_000;

/// A study's runs on a device.
#[derive(Debug)]
pub(super) struct Accelerated {
    runner: Runner,
    /// Results of the first samples with error control.
    pilot: Vec<Outcome>,
    /// The signals that metrics need, without points.
    signals: Recording,
    /// Number of runs at a time.
    runs: usize,
    state: Mutex<State>,
}

#[derive(Debug, Clone, Default)]
struct State {
    /// Fixed steps in a communication step.
    substeps: usize,
    /// Largest difference so far, in parts of a limit.
    largest: f64,
    /// Number of runs on the device, and of those that were made again.
    made: u64,
    again: u64,
    /// Runs that were made again to show how accurate the others are.
    checked: u64,
    /// True once longer fixed steps have proved too inaccurate: earlier results don't count.
    begins_anew: bool,
    /// Why the processor makes all further runs.
    failure: Option<String>,
}

/// Samples that are prepared for the device.
struct Begun {
    count: usize,
    /// Those that the device can take, and their starts.
    places: Vec<usize>,
    starts: Vec<Start>,
}

/// The names of the signals without which the metrics are others.
fn needed(structure: &Structure, signals: &Recording) -> Vec<String> {
    let labels = |names: &[String]| Meter::new(structure, &mut only(signals, names)).ok().map(|meter| meter.labels());
    let mut names = signals.names.clone();
    let all = labels(&names);
    for name in &signals.names {
        let fewer: Vec<String> = names.iter().filter(|other| *other != name).cloned().collect();
        if labels(&fewer) == all {
            names = fewer;
        }
    }
    names
}

/// Signals of these names, without points.
fn only(signals: &Recording, names: &[String]) -> Recording {
    let measures = names.iter().map(|name| signals.measure(name).unwrap_or_default().to_owned()).collect();
    Recording { names: names.to_vec(), measures, columns: vec![Vec::new(); names.len()], ..Recording::default() }
}

/// The largest difference of metrics with limits, in parts of these; infinite where only one has a value. Times may differ
/// by a communication step.
fn difference(limits: &Limits, step: f64, one: &Outcome, other: &Outcome) -> f64 {
    let (Outcome::Ended(one), Outcome::Ended(other)) = (one, other) else { return f64::INFINITY };
    let of = |(limit, &place): (&super::requirement::Limit, &usize)| match (one[place], other[place]) {
        (None, None) => 0.0,
        (Some(one), Some(other)) => ((one - other).abs() - points(&limit.label, step)).max(0.0) / scale(limit.value),
        _ => f64::INFINITY,
    };
    limits.of.iter().zip(&limits.places).map(of).fold(0.0, f64::max)
}

/// True if a run's metric is so near its limit that the error of fixed steps matters, or has no value.
fn is_near(limits: &Limits, step: f64, outcome: &Outcome) -> bool {
    let Outcome::Ended(metrics) = outcome else { return true };
    limits.of.iter().zip(&limits.places).any(|(limit, &place)| {
        let within = NEAR * scale(limit.value) + points(&limit.label, step);
        metrics[place].is_none_or(|value| (value - limit.value).abs() <= within)
    })
}

fn is_complete(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Ended(_))
}

/// True for a run that is complete in fixed steps, but not with error control.
fn ends_early((one, exact): (&Outcome, &Outcome)) -> bool {
    is_complete(one) && !is_complete(exact)
}

/// Text on a study whose runs the processor makes.
pub(super) fn not_used(reason: &str) -> String {
    format!("No graphics card was used: {reason}.")
}

fn too_many() -> String {
    format!("with {MOST_STEPS} fixed steps in a run, metrics are less accurate than {DIFFERENCE} of their limits")
}

fn scale(limit: f64) -> f64 {
    if limit == 0.0 { 1.0 } else { limit.abs() }
}

/// Difference of a metric that is the time of a point.
fn points(label: &str, step: f64) -> f64 {
    if label.ends_with(", s") { 1.001 * step } else { 0.0 }
}

impl Study {
    /// Notes why the processor makes the runs, where a graphics card was asked for.
    pub fn stay_on_processor(&mut self, backend: Backend, reason: &str) {
        self.by_processor = (backend == Backend::Gpu).then(|| reason.to_owned());
    }

    /// Looks for a device for the runs, and chooses its fixed steps by the first samples.
    ///
    /// # Errors
    /// When a graphics card is asked for and there is none.
    pub fn accelerate(
        &mut self,
        backend: Backend,
        runs: u64,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Result<(), String> {
        if backend == Backend::Cpu {
            return Ok(());
        }
        let device = match Device::find() {
            Ok(device) => device,
            Err(_) if backend == Backend::Auto => return Ok(()),
            Err(reason) => return Err(format!("--backend gpu: {reason}")),
        };
        match self.begin(device, backend, runs, is_interrupted) {
            Ok(accelerated) => self.accelerated = Some(accelerated),
            Err(reason) => self.by_processor = Some(reason),
        }
        Ok(())
    }

    fn begin(
        &self,
        device: Device,
        backend: Backend,
        runs: u64,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Result<Accelerated, String> {
        let (count, begun) = (PILOT.min(runs), Instant::now());
        let pilot = self.by_processor(0..count, is_interrupted);
        let pace = begun.elapsed().as_secs_f64() / count as f64;
        if is_interrupted() {
            return Err(INTERRUPTED.to_owned());
        }
        if !pilot.iter().any(is_complete) {
            return Err("none of the first runs is complete".to_owned());
        }
        if backend == Backend::Auto && (runs - count) as f64 * pace < WORTH_IT {
            return Err(format!("the study takes less than {WORTH_IT} s without one"));
        }
        let of = |sample| {
            let sample = self.sample(sample);
            (sample.start, sample.changes)
        };
        let samples: Vec<_> = (0..8).map(of).collect();
        let signals = self.loaded().signals();
        let signals = only(&signals, &needed(self.structure(), &signals));
        let runner = Runner::new(device, self.loaded(), &signals.names, &samples, self.settings())?;
        let runs = runner.device().runs.min(MEMORY / self.memory_of_run(&pilot, &runner)).max(1);
        let accelerated = Accelerated { runner, pilot, signals, runs, state: Mutex::default() };
        let begun = Instant::now();
        let (substeps, largest) = accelerated.chosen(self, is_interrupted)?;
        let device = accelerated.runner.device();
        // A card takes as long for all that it has room for. The last choice took half of the time.
        let at_a_time = if device.is_gpu { runs as f64 } else { count as f64 };
        if backend == Backend::Auto && 0.5 * begun.elapsed().as_secs_f64() / at_a_time >= pace {
            return Err(format!("{} is slower than the processor", device.name));
        }
        *accelerated.state() = State { substeps, largest, ..State::default() };
        Ok(accelerated)
    }

    /// Memory that a run takes on the processor at most, bytes: its values, and the points of outputs that follow steps.
    fn memory_of_run(&self, pilot: &[Outcome], runner: &Runner) -> usize {
        let of_loop = self.structure().metrics.len();
        let has_steps = |outcome: &Outcome| match outcome {
            Outcome::Ended(metrics) => metrics.iter().skip(of_loop).any(Option::is_some),
            _ => false,
        };
        let points = if pilot.iter().any(has_steps) { self.settings().steps().min(MOST_POINTS) } else { 0 };
        BYTES_OF_POINT * points * (self.labels().len() - of_loop.min(self.labels().len())) + runner.bytes_of_start() + 1
    }

    /// Outcomes of samples with error control.
    fn by_processor(&self, samples: Range<u64>, is_interrupted: &(impl Fn() -> bool + Sync)) -> Vec<Outcome> {
        self.one_by_one(&Batch::Plain { first: samples.start, count: samples.end - samples.start }, is_interrupted)
    }
}

impl Accelerated {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fixed steps in a communication step by which the first samples are accurate, and their largest difference.
    fn chosen(&self, study: &Study, is_interrupted: &(impl Fn() -> bool + Sync)) -> Result<(usize, f64), String> {
        let (step, limits, count) = (study.settings().step, study.limits(), self.pilot.len() as u64);
        let (steps, mut substeps) = (study.settings().steps().max(1), 1);
        let begun = self.begun(study, 0..count);
        while steps.saturating_mul(substeps) <= MOST_STEPS {
            let found = self.outcomes(study, &begun, substeps, is_interrupted)?;
            if is_interrupted() {
                return Err(INTERRUPTED.to_owned());
            }
            if found.iter().zip(&self.pilot).any(ends_early) {
                return Err(ENDS_EARLY.to_owned());
            }
            let pairs = found.iter().zip(&self.pilot).filter(|(_, exact)| is_complete(exact));
            let largest = pairs.map(|(one, exact)| difference(limits, step, one, exact)).fold(0.0, f64::max);
            if largest <= PILOT_DIFFERENCE {
                let near = found.iter().filter(|outcome| is_near(limits, step, outcome)).count();
                if 2 * near > found.len() {
                    return Err(format!("{near} of {count} runs are so near a limit that they need error control"));
                }
                return Ok((substeps, largest));
            }
            substeps *= 2;
        }
        Err(too_many())
    }

    /// Number of samples at a time; 0 once the processor makes them.
    pub fn at_a_time(&self) -> u64 {
        if self.state().failure.is_some() { 0 } else { self.runs as u64 }
    }

    /// Name of the device.
    pub fn name(&self) -> &str {
        &self.runner.device().name
    }

    /// Fixed steps in a communication step; 0 where runs need error control.
    pub fn substeps(&self) -> usize {
        self.state().substeps
    }

    /// Goes on with those of an earlier call, which may have found that shorter ones are needed.
    pub fn go_on(&self, substeps: usize, study: &Study) {
        let mut state = self.state();
        if substeps != state.substeps {
            let is_too_many = study.settings().steps().saturating_mul(substeps) > MOST_STEPS;
            let failure = if substeps == 0 { Some(ENDS_EARLY.to_owned()) } else { is_too_many.then(too_many) };
            *state = State { substeps, failure, ..State::default() };
        }
    }

    /// True once after the fixed steps were halved: the study begins anew.
    pub fn begins_anew(&self) -> bool {
        std::mem::take(&mut self.state().begins_anew)
    }

    /// Samples, prepared for the device.
    fn begun(&self, study: &Study, samples: Range<u64>) -> Begun {
        let count = (samples.end - samples.start) as usize;
        let starts = parallel::each(&vec![(); parallel::cores()], count, |(), k| {
            let sample = study.sample(samples.start + k as u64);
            self.runner.start(&sample.start, &sample.changes)
        });
        let (places, starts) = starts.into_iter().enumerate().filter_map(|(k, start)| Some((k, start?))).unzip();
        Begun { count, places, starts }
    }

    /// Outcomes of samples by fixed steps; those that can't be made are not complete.
    fn outcomes(
        &self,
        study: &Study,
        Begun { count, places, starts }: &Begun,
        substeps: usize,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<Outcome>, String> {
        let workers: Vec<()> = vec![(); parallel::cores()];
        let mut made = vec![Outcome::NotEnded("is not for fixed steps".to_owned()); *count];
        if starts.is_empty() {
            return Ok(made);
        }
        // A signal that isn't finite ends a run on the processor.
        let meter = |_| -> Result<_, String> {
            let (mut points, is_finite) = (self.signals.clone(), true);
            Ok(Mutex::new((Meter::new(study.structure(), &mut points)?, points, is_finite)))
        };
        let meters = starts.iter().map(meter).collect::<Result<Vec<_>, _>>()?;
        let complete = self.runner.run(starts, substeps, |rows| {
            parallel::each(&workers, meters.len(), |(), run| {
                let (meter, points, is_finite) = &mut *meters[run].lock().unwrap_or_else(PoisonError::into_inner);
                rows.add_to(points, run);
                *is_finite &= points.columns.iter().flatten().all(|value| value.is_finite());
                meter.add(points);
                points.times.clear();
                points.columns.iter_mut().for_each(Vec::clear);
            });
            !is_interrupted()
        })?;
        let Some(complete) = complete else { return Ok(Vec::new()) };
        for ((place, meter), complete) in places.iter().zip(meters).zip(complete) {
            let (meter, _, is_finite) = meter.into_inner().unwrap_or_else(PoisonError::into_inner);
            if complete && is_finite {
                made[*place] = study.ended(meter.measured()).0;
            }
        }
        Ok(made)
    }

    /// Outcomes of samples, in their order; fewer if the user stops it, none at all where the device has failed.
    pub fn batch(
        &self,
        study: &Study,
        first: u64,
        count: u64,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Option<Vec<Outcome>> {
        let State { substeps, failure, checked, .. } = self.state().clone();
        if failure.is_some() {
            return None;
        }
        let known = self.pilot.iter().skip(first as usize).take(count as usize).cloned();
        let mut made: Vec<Outcome> = known.collect();
        let from = first + made.len() as u64;
        let begun = self.begun(study, from..first + count);
        let twice = [substeps, 2 * substeps].map(|substeps| self.outcomes(study, &begun, substeps, is_interrupted));
        let [coarse, further] = match twice {
            [Ok(coarse), Ok(further)] => [coarse, further],
            [Err(reason), _] | [_, Err(reason)] => {
                self.state().failure = Some(reason);
                return None;
            }
        };
        let (step, limits) = (study.settings().step, study.limits());
        let pairs = coarse.iter().zip(&further);
        let is_sure: Vec<bool> =
            pairs.map(|(one, finer)| difference(limits, step, one, finer) <= PILOT_DIFFERENCE).collect();
        let is_sampled = |sample: u64| sample.is_multiple_of(AGAIN) && checked < MOST_AGAIN;
        let is_again = |(k, outcome): &(usize, &Outcome)| {
            !is_sure[*k] || is_sampled(from + *k as u64) || is_near(limits, step, outcome)
        };
        let again: Vec<usize> = further.iter().enumerate().filter(is_again).map(|(k, _)| k).collect();
        let exact = study.each_of(&again.iter().map(|k| from + *k as u64).collect::<Vec<_>>(), is_interrupted);
        let interrupted = exact.len() < again.len();
        self.learn(study, (&further, &is_sure), (&again, &exact), substeps);
        let valid = if interrupted { again.get(exact.len()).copied().unwrap_or_default() } else { further.len() };
        made.extend(further.into_iter().take(valid));
        let before = made.len() - valid;
        again.iter().zip(exact).filter(|(k, _)| **k < valid).for_each(|(k, outcome)| made[before + k] = outcome);
        Some(made)
    }

    /// Takes what runs that were made again show of the others: those of which fixed steps are sure.
    fn learn(
        &self,
        study: &Study,
        (made, is_sure): (&[Outcome], &[bool]),
        (again, exact): (&[usize], &[Outcome]),
        substeps: usize,
    ) {
        let pairs = || again.iter().zip(exact).filter(|(k, _)| is_sure[**k]).map(|(k, exact)| (&made[*k], exact));
        if pairs().any(ends_early) {
            let failure = Some(ENDS_EARLY.to_owned());
            *self.state() = State { begins_anew: true, failure, ..State::default() };
            return;
        }
        let complete = pairs().filter(|(one, exact)| is_complete(one) && is_complete(exact));
        let differences = complete.map(|(one, exact)| difference(study.limits(), study.settings().step, one, exact));
        let mut state = self.state();
        state.made += made.len() as u64;
        state.again += again.len() as u64;
        state.checked += made.len() as u64 / AGAIN;
        state.largest = differences.fold(state.largest, f64::max);
        if state.largest > DIFFERENCE {
            let steps = study.settings().steps().saturating_mul(2 * substeps);
            let failure = (steps > MOST_STEPS).then(too_many);
            *state = State { substeps: 2 * substeps, begins_anew: true, failure, ..State::default() };
        }
    }

    /// Origin and accuracy of the runs, in words.
    pub fn described(&self, step: f64) -> String {
        let State { substeps, largest, made, again, failure, .. } = self.state().clone();
        let name = &self.runner.device().name;
        if let Some(reason) = failure {
            if made == 0 {
                return not_used(&reason);
            }
            return format!("Runs on {name} ended, and the processor made the others: {reason}.");
        }
        format!(
            "{} runs were made on {name} in fixed steps of {} s; {} of all runs with error control. Where both were \
             made, metrics differ by at most {:.1e} of their limits.",
            thousands(made),
            number(step / (2 * substeps) as f64),
            thousands(again + self.pilot.len() as u64),
            largest
        )
    }

    /// The same for scripts.
    pub fn json(&self, step: f64) -> Value {
        let State { substeps, largest, made, again, failure, .. } = self.state().clone();
        json!({
            "device": self.runner.device().name, "fixed_step": step / (2 * substeps) as f64, "runs": made,
            "with_error_control": again + self.pilot.len() as u64, "largest_difference": largest, "failure": failure,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::requirement::{Limit, Side};
    use super::*;

    const STEP: f64 = 1e-3;

    fn limits() -> Limits {
        let limit = |label: &str, value| Limit { label: label.to_owned(), side: Side::AtMost, value };
        Limits { of: vec![limit("max |u|", 2.0), limit("settling time of y, s", 0.5)], places: vec![0, 1] }
    }

    fn ended(metrics: [f64; 2]) -> Outcome {
        Outcome::Ended(metrics.map(|value| Some(value).filter(|value| value.is_finite())).to_vec())
    }

    #[test]
    fn differences_are_parts_of_limits_and_times_may_be_those_of_neighbouring_points() {
        let of = |one, other| difference(&limits(), STEP, &ended(one), &ended(other));
        assert!((of([1.0, 0.3], [1.1, 0.301]) - 0.05).abs() < 1e-12);
        assert!((of([1.0, 0.3], [1.0, 0.304]) - 0.006).abs() < 1e-5);
        assert_eq!(of([1.0, f64::NAN], [1.0, f64::NAN]), 0.0);
        assert_eq!(of([1.0, f64::NAN], [1.0, 0.3]), f64::INFINITY);
        assert_eq!(difference(&limits(), STEP, &ended([1.0, 0.3]), &Outcome::NotEnded(String::new())), f64::INFINITY);
    }

    #[test]
    fn runs_near_a_limit_or_without_a_value_need_error_control() {
        let near = |metrics| is_near(&limits(), STEP, &ended(metrics));
        // 3e-3 of 2, on both sides.
        assert!(near([1.995, 0.3]) && near([2.005, 0.3]) && !near([1.993, 0.3]) && !near([2.007, 0.3]));
        assert!(near([1.0, 0.498]) && !near([1.0, 0.49]) && near([1.0, f64::NAN]));
        assert!(is_near(&limits(), STEP, &Outcome::NotEnded(String::new())));
    }
}
