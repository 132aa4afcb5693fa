//! A study: a loop, its varied quantities, its requirements, and its runs.

use std::sync::{PoisonError, RwLock};

use serde::{Deserialize, Serialize};

use super::accelerated::Accelerated;
use super::distribution::Vary;
use super::outcome::{Limits, Outcome, Tally};
use super::plan::{Plan, Verdict};
use super::plant::{DrawnPlant, VaryFrom};
use super::random::Random;
use super::requirement::{Requirement, add_metrics, limits};
use super::subset::{Drawn, Found};
use super::varied::{Sample, Varied, listed, timed};
use crate::error::{Error, Invalid};
use crate::figures::labelled;
use crate::parallel;
use crate::results::{Measured, Meter};
use crate::simulation::{LoadedLoop, Recording};
use crate::structure::{Event, Settings, Structure};
use crate::workers::{Workers, results};

/// Number of values that are recorded before metrics process them.
const BLOCK: usize = 1 << 14;
/// Consecutive samples of a thread, and of a worker.
pub(super) const ROW: u64 = 32;
/// The most batches of all workers.
const BATCHES: u64 = 32;
/// The most samples that are tried for compiled equations.
const MOST_REFUSED: u64 = 4;
/// Number of samples at which refused ones are first counted; each further count is at ten times as many.
const FIRST_COUNT: u64 = 1000;

/// Wishes of a user.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked {
    /// Quantities with their distributions.
    pub vary: Vec<Vary>,
    /// Plants with known uncertainty.
    pub vary_from: Vec<VaryFrom>,
    /// Requirements [default: the limits of the loop's metrics].
    pub require: Vec<Requirement>,
    /// True if all runs have the same noise.
    pub same_noise: bool,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Samples for a worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Batch {
    /// Samples whose values follow from their numbers.
    Plain {
        /// The first.
        first: u64,
        /// Their number.
        count: u64,
    },
    /// Samples of a subset simulation.
    Drawn(Vec<Drawn>),
}

impl Batch {
    /// Number of samples.
    fn size(&self) -> usize {
        match self {
            Batch::Plain { count, .. } => *count as usize,
            Batch::Drawn(drawn) => drawn.len(),
        }
    }
}

/// The end of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Ended {
    /// Its counts.
    pub tally: Tally,
    /// The verdict; none without an allowed rate, or after an interruption.
    pub verdict: Option<Verdict>,
    /// True if the user stopped it.
    pub interrupted: bool,
    /// Result of a subset simulation.
    pub rare: Option<Found>,
}

/// A study of a loop.
#[derive(Debug)]
pub struct Study {
    structure: Structure,
    settings: Settings,
    events: Vec<Event>,
    varied: Varied,
    pub(super) seed: u64,
    /// Samples of a subset simulation.
    pub(super) drawn: RwLock<Vec<Drawn>>,
    labels: Vec<String>,
    limits: Limits,
    /// One a thread: other tools' libraries may not allow two instances at work at a time.
    loops: Vec<LoadedLoop>,
    /// Runs on a device; or why the processor makes all of them, where a device was looked for.
    pub(super) accelerated: Option<Accelerated>,
    pub(super) by_processor: Option<String>,
}

impl Study {
    /// A study of a loop, from a function that loads it, once for each parallel run.
    ///
    /// # Errors
    /// When a quantity or a requirement doesn't fit the loop.
    pub fn new(
        mut structure: Structure,
        settings: Settings,
        asked: &Asked,
        threads: usize,
        load: impl Fn(&Structure) -> Result<LoadedLoop, Error>,
    ) -> Result<Self, Error> {
        let wrong = |reason: String| Error::Argument(Invalid::because(reason));
        if asked.vary.is_empty() && asked.vary_from.is_empty() {
            return Err(wrong("nothing is varied: give --vary NAME=±30% or --vary-from COMPONENT=FILE".to_owned()));
        }
        let events = std::mem::take(&mut structure.events);
        let first = load(&structure)?;
        add_metrics(&asked.require, &mut structure, &first).map_err(wrong)?;
        let first = first.recording(structure.signals());
        let plants = asked.vary_from.iter().map(|of| DrawnPlant::new(of, &first)).collect::<Result<_, Error>>()?;
        let varied = Varied::new(&first, &asked.vary, plants, &events, settings).map_err(wrong)?;
        let varied = if asked.same_noise { varied } else { varied.with_noise(&first) };
        let labels = Meter::new(&structure, &mut first.signals()).map_err(wrong)?.labels();
        if let Some(label) = labels.iter().enumerate().find_map(|(k, it)| labels[..k].contains(it).then_some(it)) {
            return Err(wrong(format!("two metrics of the loop are called `{label}`: give one another label")));
        }
        let of = limits(&asked.require, &structure, &first, &labels).map_err(wrong)?;
        let place = |label: &String| labels.iter().position(|known| known == label).unwrap_or_default();
        let limits = Limits { places: of.iter().map(|limit| place(&limit.label)).collect(), of };
        let further = if first.can_be_multiplied() { threads.saturating_sub(1) } else { 0 };
        let mut loops = vec![first];
        for _ in 0..further {
            loops.push(load(&structure)?);
        }
        let (seed, drawn) = (asked.seed, RwLock::default());
        let (accelerated, by_processor) = (None, None);
        let study = Study {
            structure,
            settings,
            events,
            varied,
            seed,
            drawn,
            labels,
            limits,
            loops,
            accelerated,
            by_processor,
        };
        study.fold();
        Ok(study)
    }

    /// Compiles the equations for all parameters but the varied ones: those of the first sample that isn't refused show
    /// which these are.
    fn fold(&self) {
        let _ = (0..MOST_REFUSED).find(|sample| {
            let of = self.sample(*sample);
            LoadedLoop::fold(&self.loops, &of.start, &of.changes, self.settings)
        });
    }

    /// The device of its runs; none if the processor makes them.
    pub fn device(&self) -> Option<&str> {
        self.accelerated.as_ref().map(Accelerated::name)
    }

    /// Fixed steps of its device in a communication step; 0 where that isn't accurate enough.
    pub fn substeps(&self) -> Option<usize> {
        self.accelerated.as_ref().map(Accelerated::substeps)
    }

    /// Goes on with the fixed steps of an earlier call.
    pub fn go_on(&self, substeps: usize) {
        self.accelerated.iter().for_each(|device| device.go_on(substeps, self));
    }

    /// Start values and changes of a sample.
    pub(super) fn sample(&self, sample: u64) -> Sample {
        self.varied.sample(&self.values(sample), self.noise(sample))
    }

    /// Settings of a run.
    pub(super) fn settings(&self) -> Settings {
        self.settings
    }

    /// The loop.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The loop as it was loaded.
    pub fn loaded(&self) -> &LoadedLoop {
        &self.loops[0]
    }

    /// Labels of all metrics.
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// The limits.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Names of what is varied.
    pub fn names(&self) -> Vec<&str> {
        self.varied.names().collect()
    }

    /// Distribution of each of it.
    pub fn distributions(&self) -> Vec<String> {
        self.varied.texts().collect()
    }

    /// True for each whose axis is logarithmic.
    pub fn are_logarithmic(&self) -> Vec<bool> {
        self.varied.are_logarithmic().collect()
    }

    /// The name of a variable with its unit of measurement.
    pub(super) fn with_unit(&self, name: &str) -> String {
        let unit = self.loaded().variable(name).and_then(|(_, variable)| variable.unit.clone());
        labelled(name, unit.as_deref().filter(|unit| *unit != "1").unwrap_or_default())
    }

    /// The values of a sample, in the order of the names.
    pub fn values(&self, sample: u64) -> Vec<f64> {
        let drawn = self.drawn.read().unwrap_or_else(PoisonError::into_inner);
        match drawn.get(sample as usize) {
            Some(drawn) => self.varied.values(&drawn.parts),
            None => self.plain(sample),
        }
    }

    /// The values of a sample that follow from its number.
    fn plain(&self, sample: u64) -> Vec<f64> {
        let random = self.random(sample);
        self.varied.values(&self.varied.names().map(|name| random.uniform(name)).collect::<Vec<_>>())
    }

    /// Random numbers for the noise of a sample.
    fn noise(&self, sample: u64) -> Random {
        let drawn = self.drawn.read().unwrap_or_else(PoisonError::into_inner);
        self.random(drawn.get(sample as usize).map_or(sample, |drawn| drawn.noise))
    }

    /// The values of a sample in words.
    pub fn described(&self, sample: u64) -> String {
        let values = self.values(sample);
        listed(&self.varied.names().zip(values).collect::<Vec<_>>())
    }

    /// Start values of a sample for a parameter set: name, type and text of each, seeds of noise included.
    pub fn start_values(&self, sample: u64) -> Vec<(String, &'static str, String)> {
        let (random, values) = (self.noise(sample), self.values(sample));
        let reals = self.varied.start_values(&values).chain(self.varied.constants());
        let reals = reals.map(|(name, value)| (name.to_owned(), "Real", value.to_string()));
        let seeds = self.varied.seeds(random).map(|(name, seed)| (name.to_owned(), "Integer", seed.to_string()));
        reals.chain(seeds).collect::<Vec<_>>()
    }

    /// Seeds of noise of a sample.
    pub fn seeds(&self, sample: u64) -> Vec<i32> {
        self.varied.seeds(self.noise(sample)).map(|(_, seed)| seed).collect()
    }

    /// The user's events, with the times of a sample, in the form of the option.
    pub fn events(&self, sample: u64) -> Vec<String> {
        let values = self.values(sample);
        let asked = self.events.iter().enumerate().filter(|(_, event)| event.origin.is_argument());
        asked.map(|(k, event)| timed(event, self.varied.event_time(k, &values).unwrap_or(event.time))).collect()
    }

    fn random(&self, sample: u64) -> Random {
        Random { seed: self.seed, sample }
    }

    /// Metrics of the nominal loop, if it reaches its end. Refuses requirements on metrics that it lacks, since its
    /// references don't step.
    ///
    /// # Errors
    /// The refused requirement.
    pub fn as_it_is(&self, is_interrupted: &dyn Fn() -> bool) -> Result<Option<Vec<Option<f64>>>, Error> {
        let Some((outcome, measured)) = self.run_one(&self.loops[0], &self.varied.nominal(), is_interrupted) else {
            return Ok(None);
        };
        let Outcome::Ended(metrics) = outcome else { return Ok(None) };
        let has = |label: &String| measured.iter().any(|metric| metric.label == *label);
        match self.limits.of.iter().find(|limit| !has(&limit.label)) {
            Some(limit) => Err(Error::Argument(Invalid::because(format!(
                "--require {limit}: the loop has this metric only if its reference steps, and it doesn't"
            )))),
            None => Ok(Some(metrics)),
        }
    }

    /// Makes further samples until the plan has a verdict, in an order that doesn't depend on the number of threads.
    /// `done` gets the results from time to time; `is_interrupted` is called at every communication point.
    ///
    /// # Errors
    /// When too many samples are refused, with the message of the first.
    pub fn run(
        &self,
        plan: &Plan,
        outcomes: &mut Vec<Outcome>,
        workers: Option<&dyn Workers>,
        mut done: impl FnMut(&[Outcome], &Tally) -> Result<(), Error>,
        is_interrupted: impl Fn() -> bool + Sync,
    ) -> Result<Ended, Error> {
        if let Some(sizes) = plan.sizes() {
            return self.run_rare((plan, sizes), outcomes, workers, done, is_interrupted);
        }
        let mut tally = Tally::default();
        let mut counted = 0;
        loop {
            while counted < outcomes.len() {
                tally.add(&outcomes[counted], &self.limits);
                counted += 1;
                let verdict = plan.verdict(tally.failures, tally.runs);
                let is_end = verdict.is_some() || plan.next_look(tally.runs).is_none();
                self.check_refused(if is_end { counted as u64 } else { plan.runs() }, &tally, &outcomes[..counted])?;
                if is_end {
                    outcomes.truncate(counted);
                    return Ok(Ended { tally, verdict, interrupted: false, rare: None });
                }
            }
            done(outcomes, &tally)?;
            let wanted = plan.next_look(tally.runs).map_or(0, |look| look - tally.runs);
            let (first, count) = (outcomes.len() as u64, wanted.min(self.at_a_time(workers)));
            let made = match workers {
                Some(workers) => {
                    let starts = (first..first + count).step_by(ROW as usize);
                    let row = |from| Batch::Plain { first: from, count: ROW.min(first + count - from) };
                    hand_out(workers, starts.map(row))
                }
                None => self.batch(&Batch::Plain { first, count }, &is_interrupted),
            };
            let interrupted = (made.len() as u64) < count;
            outcomes.extend(made);
            if self.accelerated.as_ref().is_some_and(Accelerated::begins_anew) {
                (tally, counted) = (Tally::default(), 0);
                outcomes.clear();
                continue;
            }
            if interrupted {
                outcomes[counted..].iter().for_each(|outcome| tally.add(outcome, &self.limits));
                return Ok(Ended { tally, verdict: None, interrupted, rare: None });
            }
        }
    }

    /// Number of samples between two reports.
    pub(super) fn at_a_time(&self, workers: Option<&dyn Workers>) -> u64 {
        let by_processor = ROW * if workers.is_some() { BATCHES } else { self.loops.len() as u64 };
        self.accelerated.as_ref().map_or(by_processor, |device| device.at_a_time().max(by_processor))
    }

    /// Ends a study with refused samples if they are more than 1 % of its size, or at a count of those so far.
    pub(super) fn check_refused(&self, planned: u64, tally: &Tally, outcomes: &[Outcome]) -> Result<(), Error> {
        let samples = outcomes.len() as u64;
        let mut counts = std::iter::successors(Some(FIRST_COUNT), |count| count.checked_mul(10));
        let of = if counts.any(|count| count == samples) { samples } else { planned.max(samples) };
        if !tally.is_refused_too_often(of) {
            return Ok(());
        }
        let refused = outcomes.iter().enumerate().find_map(|(k, outcome)| match outcome {
            Outcome::Refused(reason) => Some((k as u64, reason)),
            _ => None,
        });
        let (k, message) = refused.map_or((0, ""), |(k, reason)| (k, reason.as_str()));
        let reason = format!(
            "components refused {} of {samples} samples; at most 1 % may be. Narrow the distributions. The first one, \
             {}: {message}",
            tally.refused,
            self.described(k)
        );
        Err(Error::Loop { file: self.structure.file.clone(), reason })
    }

    /// The outcomes of a batch, on the device if there is one; fewer if the user stops it.
    pub fn batch(&self, batch: &Batch, is_interrupted: &(impl Fn() -> bool + Sync)) -> Vec<Outcome> {
        let on_device = match (&self.accelerated, batch) {
            (Some(device), Batch::Plain { first, count }) => device.batch(self, *first, *count, is_interrupted),
            _ => None,
        };
        on_device.unwrap_or_else(|| self.one_by_one(batch, is_interrupted))
    }

    /// The outcomes of these samples on all threads; fewer if the user stops it.
    pub(super) fn each_of(&self, samples: &[u64], is_interrupted: &(impl Fn() -> bool + Sync)) -> Vec<Outcome> {
        let made = parallel::each(&self.loops, samples.len(), |loaded, k| {
            self.run_one(loaded, &self.sample(samples[k]), is_interrupted).map(|(outcome, _)| outcome)
        });
        made.into_iter().map_while(|outcome| outcome).collect()
    }

    /// The outcomes of a batch on all threads; fewer if the user stops it.
    pub(super) fn one_by_one(&self, batch: &Batch, is_interrupted: &(impl Fn() -> bool + Sync)) -> Vec<Outcome> {
        let made = parallel::each(&self.loops, batch.size(), |loaded, k| {
            let (values, noise) = match batch {
                Batch::Plain { first, .. } => (self.plain(first + k as u64), first + k as u64),
                Batch::Drawn(drawn) => (self.varied.values(&drawn[k].parts), drawn[k].noise),
            };
            let sample = self.varied.sample(&values, self.random(noise));
            self.run_one(loaded, &sample, is_interrupted).map(|(outcome, _)| outcome)
        });
        made.into_iter().map_while(|outcome| outcome).collect()
    }

    /// A run of a sample; none if the user stops it.
    fn run_one(
        &self,
        loaded: &LoadedLoop,
        sample: &Sample,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Option<(Outcome, Vec<Measured>)> {
        if is_interrupted() {
            return None;
        }
        let closed = match loaded.instantiate_changing(&sample.start, &sample.changes) {
            Ok(closed) => closed,
            Err(error) => return Some((Outcome::Refused(error.to_string()), Vec::new())),
        };
        let (mut interrupted, mut begun, mut meter) = (false, false, None);
        let mut take = |points: &mut Recording| {
            begun |= !points.times.is_empty();
            let meter = meter.get_or_insert_with(|| Meter::new(&self.structure, points));
            let taken = meter.as_mut().is_ok_and(|meter| {
                meter.add(points);
                true
            });
            points.times.clear();
            points.columns.iter_mut().for_each(Vec::clear);
            taken
        };
        let stop_time = self.settings.stop_time;
        let ran = closed.run_in_blocks(self.settings, BLOCK, &mut take, |time| {
            interrupted = is_interrupted() && time < stop_time;
            !interrupted
        });
        let failure = match ran {
            Ok(mut recording) => {
                take(&mut recording);
                None
            }
            Err((error, mut recording)) => {
                take(&mut recording);
                Some(error.to_string())
            }
        };
        if interrupted {
            return None;
        }
        Some(match (failure, meter) {
            (Some(reason), _) if !begun => (Outcome::Refused(reason), Vec::new()),
            (Some(reason), _) | (None, Some(Err(reason))) => (Outcome::NotEnded(reason), Vec::new()),
            (None, None) => (Outcome::NotEnded("the run has no points".to_owned()), Vec::new()),
            (None, Some(Ok(meter))) => self.ended(meter.measured()),
        })
    }

    /// The metrics of a complete run, in the order of their labels.
    pub(super) fn ended(&self, measured: Vec<Measured>) -> (Outcome, Vec<Measured>) {
        let value = |label: &String| measured.iter().find(|metric| metric.label == *label).and_then(|it| it.value);
        let metrics = self.labels.iter().map(|label| value(label).filter(|value| value.is_finite())).collect();
        (Outcome::Ended(metrics), measured)
    }

    /// The recorded signals of a sample, or of the nominal loop.
    ///
    /// # Errors
    /// When the sample is refused.
    pub fn recorded(&self, sample: Option<u64>) -> Result<Recording, Error> {
        let of = match sample {
            Some(sample) => self.sample(sample),
            None => self.varied.nominal(),
        };
        let closed = self.loops[0].instantiate_changing(&of.start, &of.changes)?;
        Ok(closed.run(self.settings, |_| true).unwrap_or_else(|(_, recording)| *recording))
    }
}

/// Outcomes of batches by workers; fewer if the user stops it, or a worker was stopped: then those before its batch.
pub(super) fn hand_out(workers: &dyn Workers, batches: impl IntoIterator<Item = Batch>) -> Vec<Outcome> {
    let batches: Vec<Batch> = batches.into_iter().collect();
    let sizes: Vec<usize> = batches.iter().map(Batch::size).collect();
    let made = results::<Vec<Outcome>>(workers, batches, |_| ());
    let whole = made.into_iter().zip(sizes).map_while(|(outcomes, size)| outcomes.filter(|it| it.len() == size));
    whole.flatten().collect()
}
