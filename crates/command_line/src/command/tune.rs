//! `tune`: parameters of a closed loop by a particle swarm.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

use adaptive_fmu::error::Error;
use adaptive_fmu::structure::{LoopFiles, Settings, SquareTerm, Structure, TunedParameter, Tuning};
use adaptive_fmu::tuning::{Best, Job, Motion, Objective, Outcome, Question, Range, Record, Search, Swarm, is_better};
use adaptive_fmu::workers::employed;
use adaptive_fmu::{output, parallel};

use super::earlier::EarlierOptions;
use super::form::Form;
use super::loop_options::LoopOptions;
use super::number::positive;
use super::progress::{self, Bars, Counter};
use super::tuned::{CONVERGENCE, TUNED, Tuned, print, write_results};
use super::workers;

/// Written after every generation.
pub const RECORD: &str = "search.json";
const SAMPLE: f64 = 0.01;
/// Tolerance of a search's runs: comparing them takes fewer digits than looking at one.
const SEARCH_TOLERANCE: f64 = 1e-3;

#[derive(clap::Args)]
pub struct Arguments {
    /// Loop of this package, or SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP")]
    name: String,
    /// Parameter to tune (repeatable) [default: those that the loop names]
    ///
    /// UNIT is a component of the loop. Without LOW..HIGH, the bounds are those of the FMU.
    #[arg(long, value_name = "UNIT.variable[=LOW..HIGH]", value_parser = parameter)]
    parameter: Vec<TunedParameter>,
    /// Minimise the sum of WEIGHT (SIGNAL - SIGNAL)² over sampled points (repeatable) [default: the loop's own
    /// objective]
    #[arg(long, value_name = "WEIGHT SIGNAL [- SIGNAL]", allow_hyphen_values = true)]
    square: Vec<SquareTerm>,
    /// Minimise the metric of the loop that has this label
    #[arg(long, value_name = "LABEL", conflicts_with_all = ["square", "sample"])]
    metric: Option<String>,
    /// Time between the points that --square sums up, s [default: the loop's own, or 0.01]
    ///
    /// It must be a multiple of the communication step.
    #[arg(long, value_parser = positive)]
    sample: Option<f64>,
    /// Minimise the largest objective of the loop as it is and with each of these parameter sets, such as corners of the plant
    #[arg(long, value_name = "FILE.ssv,…", value_delimiter = ',')]
    worst_of: Vec<PathBuf>,
    #[command(flatten)]
    swarm: SwarmOptions,
    #[command(flatten)]
    earlier: EarlierOptions,
    /// Number of parallel runs [default: that of --jobs]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Simulate the components separately, at their communication step, as `run` does.
    ///
    /// By default the loop is one continuous system if possible, and the best values are run once more with separate
    /// components. --fmus, --order and --accept-algebraic-loops also select separate components.
    #[arg(long, conflicts_with = "composite")]
    separate: bool,
    /// Folder for results, which go to its subfolder LOOP-tuned
    #[arg(long, default_value = "results")]
    out: PathBuf,
    #[command(flatten)]
    options: LoopOptions,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Carry out one run of a search, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

#[derive(clap::Args)]
struct SwarmOptions {
    /// Number of particles in the swarm
    #[arg(long, default_value_t = 150, value_parser = clap::value_parser!(u32).range(1..))]
    particles: u32,
    /// Number of generations, each with one run per particle
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    generations: u32,
    /// Seed of the random numbers; the same seed gives the same search on any number of threads
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cognitive coefficient, the pull of a particle's own best position
    #[arg(long, default_value_t = 2.0, value_parser = not_negative)]
    cognitive: f64,
    /// Social coefficient, the pull of the best position of the swarm
    #[arg(long, default_value_t = 2.0, value_parser = not_negative)]
    social: f64,
    /// Inertia weight in the first generation
    #[arg(long, default_value_t = 1.0, value_parser = not_negative)]
    inertia: f64,
    /// Factor on the inertia weight from one generation to the next
    #[arg(long, default_value_t = 0.99, value_parser = not_negative)]
    decay: f64,
    /// Largest change of a parameter per generation, as a fraction of its range
    #[arg(long, default_value_t = 0.1, value_parser = positive)]
    velocity_limit: f64,
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "must be a finite number, at least 0".to_owned())
}

fn parameter(text: &str) -> Result<TunedParameter, String> {
    let Some((name, bounds)) = text.split_once('=') else {
        return Ok(TunedParameter { name: text.trim().to_owned(), low: None, high: None });
    };
    let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    let bounds = bounds.split_once("..").and_then(|(low, high)| number(low).zip(number(high)));
    let (low, high) = bounds.ok_or("must be UNIT.variable, or UNIT.variable=LOW..HIGH with two finite numbers")?;
    Ok(TunedParameter { name: name.trim().to_owned(), low: Some(low), high: Some(high) })
}

/// Searches, and writes what was found; also when the user interrupts.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let bars = Bars::new(arguments.json);
    let files = LoopFiles::find(&arguments.name)?;
    arguments.options.check(&arguments.name)?;
    let form = Form::of(&arguments.options, arguments.separate, &files, Some(SEARCH_TOLERANCE))?;
    let task = Task::new(arguments, &files, &form)?;
    if let Some(text) = &arguments.job {
        let Job { position, bound } = workers::job(text)?;
        let bound = bound.unwrap_or(f64::INFINITY);
        let outcomes = task.search.run(&[&position], &[bound], |_| (), progress::is_interrupted);
        workers::reply(&outcomes[0]);
        return Ok(ExitCode::SUCCESS);
    }
    let below = format!("{}-tuned{}", task.structure.name, arguments.earlier.suffix());
    let folder = arguments.out.join(&below);
    output::check(&arguments.out, &below, &[RECORD, TUNED, CONVERGENCE])?;
    let file = folder.join(RECORD);
    let earlier = arguments.earlier.left(&file, |file| Record::resume(file, &task.question))?;
    if let Some(swarm) = earlier.as_ref().filter(|_| !arguments.json) {
        remark!("continuing after generation {} of an earlier call; use --force to start again", swarm.history().len());
    }
    let mut swarm = earlier.unwrap_or_else(|| task.swarm());
    output::make_folder(&arguments.out, &below)?;
    let begun = Instant::now();
    let before = task.as_it_is();
    let ended = task.search(&mut swarm, &file, &bars)?;
    let took = begun.elapsed();
    let Some(best) = ended.best.clone() else {
        let reason = ended.reason.as_deref().unwrap_or("interrupted");
        let reason = format!("none of {} runs completed, so there is no best one. The last one: {reason}", ended.runs);
        return Err(Error::Loop { file: task.structure.file.clone(), reason });
    };
    let again = task.again(&form, (arguments, &files), &best)?;
    let interrupted = ended.interrupted;
    let by = if form.verified.is_some() { "as separate FMUs" } else { "with its own tolerance and method" };
    let again = again.map(|outcome| (by, outcome));
    let tuned = Tuned { task, best, before, again, swarm, ended, took, folder };
    write_results(&tuned)?;
    print(&tuned, arguments.json);
    Ok(if interrupted { ExitCode::from(progress::INTERRUPTED) } else { ExitCode::SUCCESS })
}

/// Searches in the loop with the parameter sets of --worst-of.
struct Others<'a> {
    options: &'a LoopOptions,
    /// The loop as it is searched.
    structure: Structure,
    settings: Settings,
    threads: usize,
}

impl Others<'_> {
    fn all(
        &self,
        (arguments, files): (&Arguments, &LoopFiles),
        objective: &Objective,
        parameters: &[TunedParameter],
    ) -> Result<Vec<Search>, Error> {
        let one = |case: &PathBuf| {
            let mut structure = self.structure.clone();
            structure.apply_case(case, files)?;
            let (units, hosting) = (self.options.units(&structure)?, self.options.hosting.hosting()?);
            let load = |_| units.load(&structure, &hosting);
            let loops = (0..self.threads).map(load).collect::<Result<_, _>>()?;
            let wrong = |reason| Error::Loop { file: case.clone(), reason };
            Search::new(structure.clone(), self.settings, objective.clone(), parameters, loops).map_err(wrong)
        };
        arguments.worst_of.iter().map(one).collect()
    }
}

/// Task of a search.
pub struct Task {
    pub structure: Structure,
    settings: Settings,
    question: Question,
    generations: usize,
    pub search: Search,
}

/// A loop before anything is tuned.
pub struct Before {
    /// Start values of the parameters.
    pub values: Vec<f64>,
    /// None where the run fails.
    pub objective: Option<f64>,
}

/// End of a search.
pub struct Ended {
    best: Option<Best>,
    pub interrupted: bool,
    pub runs: usize,
    /// Reason of the last failed run's failure.
    pub reason: Option<String>,
}

impl Task {
    fn new(arguments: &Arguments, files: &LoopFiles, Form { options, structure, .. }: &Form) -> Result<Self, Error> {
        let Tuning { parameters, terms, sample, until } = structure.tuning.clone().unwrap_or(Tuning {
            parameters: Vec::new(),
            terms: Vec::new(),
            sample: SAMPLE,
            until: None,
        });
        let parameters = if arguments.parameter.is_empty() { parameters } else { arguments.parameter.clone() };
        let terms = if arguments.square.is_empty() { terms } else { arguments.square.clone() };
        let sample = arguments.sample.unwrap_or(sample);
        let objective = arguments.metric.clone().map_or(Objective::Squares { terms, sample }, Objective::Metric);
        let mut settings = options.settings(structure)?;
        settings.stop_time = options.until.or(until).unwrap_or(settings.stop_time);
        if options.composite && options.step.is_none() && matches!(objective, Objective::Squares { .. }) {
            // Nothing depends on further communication points.
            settings.step = sample;
        }
        let units = options.units(structure)?;
        let hosting = options.hosting.hosting()?;
        let first = units.load(structure, &hosting)?;
        let order = first.order();
        let run = options.provenance(&arguments.name, files, structure, settings, &first)?;
        let threads = arguments.threads.map_or_else(parallel::cores, usize::from);
        // The loop of one run; where workers have the runs, that of none.
        let threads = if arguments.job.is_some() || employed().is_some() { 1 } else { threads };
        let further = if first.can_be_multiplied() { threads - 1 } else { 0 };
        let mut loops = vec![first];
        for _ in 0..further {
            loops.push(units.load(structure, &hosting)?);
        }
        let wrong = |reason| Error::Loop { file: structure.file.clone(), reason };
        let search = Search::new(structure.clone(), settings, objective.clone(), &parameters, loops).map_err(wrong)?;
        let of = |structure: Structure| Others { options, structure, settings, threads: 1 + further };
        let search = search.worst_of(of(structure.clone()).all((arguments, files), &objective, &parameters)?);
        let SwarmOptions { particles, generations, seed, cognitive, social, inertia, decay, velocity_limit } =
            arguments.swarm;
        let question = Question {
            name: structure.name.clone(),
            composite: options.composite,
            step: settings.step,
            times: (settings.start_time, settings.stop_time),
            order: order.to_string(),
            values: structure.all_values(),
            objective,
            parameters: search.ranges().to_vec(),
            particles: particles as usize,
            motion: Motion { cognitive, social, inertia, decay, velocity_limit },
            seed,
            worst_of: arguments.worst_of.iter().map(|file| file.display().to_string()).collect(),
            run: Some(run),
        };
        let structure = structure.clone();
        Ok(Task { structure, settings, question, generations: generations as usize, search })
    }

    fn swarm(&self) -> Swarm {
        let Question { particles, motion, seed, .. } = self.question;
        let bounds = self.search.ranges().iter().map(|range| (range.low, range.high)).collect();
        Swarm::new(particles, bounds, self.search.start(), motion, seed)
    }

    fn as_it_is(&self) -> Option<Before> {
        let values = self.search.present()?;
        let outcomes = self.search.run(&[&values], &[f64::INFINITY], |_| (), progress::is_interrupted);
        Some(Before { objective: outcomes.first().and_then(Outcome::value), values })
    }

    /// Goes on with a swarm up to the last generation.
    fn search(&self, swarm: &mut Swarm, file: &Path, bars: &Bars) -> Result<Ended, Error> {
        let (particles, done) = (self.question.particles, swarm.history().len());
        let counter = Counter::new(bars, &self.structure.name, self.generations * particles, done * particles);
        let mut ended = Ended { best: swarm.best().cloned(), interrupted: false, runs: 0, reason: None };
        let best = Mutex::new(ended.best.as_ref().map(|best| best.value));
        while swarm.history().len() < self.generations && !ended.interrupted {
            let report = |outcome: &Outcome| {
                let mut best = best.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                *best = outcome.value().into_iter().chain(*best).reduce(f64::min);
                let generation = swarm.history().len() + 1;
                let value = best.map_or_else(|| "none yet".to_owned(), |best| format!("{best:.6}"));
                counter.count(&format!("generation {generation} of {}, best {value}", self.generations));
            };
            let (positions, bounds) = (swarm.positions(), swarm.bounds_of_values());
            let outcomes = match employed() {
                Some(workers) => self.search.hand_out(&*workers, &positions, &bounds, report),
                None => self.search.run(&positions, &bounds, report, progress::is_interrupted),
            };
            ended.note(swarm, &outcomes);
            if !ended.interrupted {
                swarm.tell(&outcomes.iter().map(Outcome::value).collect::<Vec<_>>());
                // A search that has found nothing takes the place of none.
                if swarm.best().is_some() {
                    Record { question: self.question.clone(), swarm: swarm.clone() }.write(file)?;
                }
            }
        }
        counter.clear();
        Ok(ended)
    }

    /// The objective of the best values as `run` would have it: through separate units where the search chose otherwise by
    /// itself; with every run's tolerance and method where others were asked for.
    fn again(&self, form: &Form, asked: (&Arguments, &LoopFiles), best: &Best) -> Result<Option<Outcome>, Error> {
        let (options, structure, step) = match &form.verified {
            Some((options, structure)) => (options, structure.clone(), options.settings(structure)?.step),
            None if self.structure.whole.is_empty() => return Ok(None),
            None => {
                let structure = Structure { whole: Vec::new(), ..self.structure.clone() };
                (&form.options, structure, self.settings.step)
            }
        };
        let settings = Settings { step, ..self.settings };
        let loaded = options.units(&structure)?.load(&structure, &options.hosting.hosting()?)?;
        let named = |range: &Range| {
            let (low, high) = (Some(range.low), Some(range.high));
            TunedParameter { name: range.name.clone(), low, high }
        };
        let parameters: Vec<_> = self.search.ranges().iter().map(named).collect();
        let wrong = |reason| Error::Loop { file: structure.file.clone(), reason };
        let objective = self.question.objective.clone();
        let search =
            Search::new(structure.clone(), settings, objective.clone(), &parameters, vec![loaded]).map_err(wrong)?;
        let others = Others { options, structure: structure.clone(), settings, threads: 1 };
        let outcomes = search.worst_of(others.all(asked, &objective, &parameters)?).run(
            &[&best.position],
            &[f64::INFINITY],
            |_| (),
            || false,
        );
        Ok(outcomes.into_iter().next())
    }
}

impl Ended {
    /// Takes over the results of a generation, before the swarm moves on; also of a part of one.
    fn note(&mut self, swarm: &Swarm, outcomes: &[Outcome]) {
        for (position, outcome) in swarm.positions().into_iter().zip(outcomes) {
            match outcome {
                Outcome::Interrupted => {
                    self.interrupted = true;
                    continue;
                }
                Outcome::Failed(reason) => self.reason = Some(reason.clone()),
                Outcome::Value(value) if is_better(*value, self.best.as_ref()) => {
                    self.best = Some(Best { position: position.to_vec(), value: *value });
                }
                Outcome::Value(_) => {}
            }
            self.runs += 1;
        }
    }
}
