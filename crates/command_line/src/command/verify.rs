//! `verify`: a closed loop with random samples, and a verdict with a confidence.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::structure::{LoopFiles, Structure};
use adaptive_fmu::verification::{
    Asked, Backend, Batch, Ended, Outcome, Plan, Record, Requirement, Study, Summary, Tally, Vary, VaryFrom, Verdict,
};
use adaptive_fmu::workers::employed;
use adaptive_fmu::{output, parallel};
use serde_json::{Value, json};

use super::earlier::EarlierOptions;
use super::form::Form;
use super::loop_options::LoopOptions;
use super::progress::{self, Bars, Counter};
use super::results::PAGE;
use super::verified::{self, RESULT, SAMPLES};
use super::workers;

/// The outcomes so far, from which the same command goes on.
const RUNS: &str = "runs.bin";
/// They are written at most so often.
const REST: Duration = Duration::from_secs(5);
/// Exit code where the verdict isn't that the loop passes.
const NOT_PASSED: u8 = 3;

#[derive(clap::Args)]
pub struct Arguments {
    /// Loop of this package, or SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP")]
    pub name: String,
    /// Parameter or initial state and its distribution (repeatable).
    ///
    /// Distributions are ±30% (or +-30%; uniform about the present value), LOW..HIGH (uniform), LOW..HIGH/log (uniform
    /// logarithm) and normal(MEAN,DEVIATION), cut at the variable's min and max. NAME is UNIT.variable, where UNIT is a
    /// component; UNIT may be omitted if only one component has such a variable. `event[N].time` is the time of the Nth
    /// --event.
    #[arg(long, value_name = "NAME=DISTRIBUTION")]
    vary: Vec<Vary>,
    /// Draw A and B of a state-space component from what is known of the plant (repeatable).
    ///
    /// FILE is a model.json of `identify`, with the covariance that the records leave, or a controller's description
    /// (.toml) with the uncertainty in its `[nominal]`.
    #[arg(long, value_name = "COMPONENT=FILE")]
    vary_from: Vec<VaryFrom>,
    /// Requirement of each run (repeatable) [default: the limits of the loop's metrics]
    ///
    /// LABEL is that of a metric, or `overshoot SIGNAL` (in parts of the step, or with %), `settling SIGNAL` or `rise
    /// SIGNAL` (in s). `funnel` requires that no error leaves its funnel.
    #[arg(long, value_name = "LABEL <= VALUE")]
    require: Vec<Requirement>,
    /// Largest failure rate that is allowed; the study ends as soon as it is decided
    #[arg(long, value_name = "RATE")]
    at_most: Option<f64>,
    /// Estimate a small failure rate by subset simulation, with far fewer runs.
    ///
    /// Levels of samples that are ever nearer to a limit lead to the failing ones. For a rate of one in a million this
    /// takes about 20,000 runs.
    #[arg(long)]
    rare: bool,
    /// Confidence of the verdict and of the interval
    #[arg(long, default_value_t = 0.95)]
    confidence: f64,
    /// Largest number of runs [default: 100/RATE with --at-most RATE, 20000 with --rare, else 10000]
    #[arg(long)]
    runs: Option<u64>,
    /// Seed of the random numbers; the same seed gives the same samples on any number of threads
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Use a graphics card for the runs: auto, cpu or gpu.
    ///
    /// A graphics card with OpenCL and double precision takes many runs at a time in fixed steps. Runs near a limit, and
    /// a share of the others, are made again on the processor, whose results count. auto uses it where it is faster.
    #[arg(long, value_name = "BACKEND", default_value_t)]
    backend: Backend,
    /// Use the same sensor noise in all runs [default: a different seed in each]
    #[arg(long)]
    same_noise: bool,
    /// Simulate the components separately, at their communication step, as `run` does.
    ///
    /// By default the loop is one continuous system if possible. --fmus, --order and --accept-algebraic-loops also
    /// select separate components.
    #[arg(long, conflicts_with = "composite")]
    separate: bool,
    #[command(flatten)]
    pub earlier: EarlierOptions,
    /// Folder for results, which go to its subfolder LOOP-verified
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
    #[command(flatten)]
    options: LoopOptions,
    /// Print JSON instead of text
    #[arg(long)]
    pub json: bool,
    /// Make a batch of samples, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

/// A study with what its file holds in addition to the outcomes.
pub struct Task {
    pub study: Study,
    pub plan: Plan,
    /// Form of each run.
    pub options: LoopOptions,
    question: Value,
}

/// Makes the runs, and writes their results; also when the user interrupts.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let bars = Bars::new(arguments.json);
    let task = Task::new(arguments)?;
    if let Some(text) = &arguments.job {
        let batch: Batch = workers::job(text)?;
        workers::reply(&task.study.batch(&batch, &progress::is_interrupted));
        return Ok(ExitCode::SUCCESS);
    }
    let below = arguments.below(task.study.structure());
    let folder = arguments.out.join(&below);
    output::check(&arguments.out, &below, &[RUNS, SAMPLES, RESULT, PAGE])?;
    let file = folder.join(RUNS);
    let known = arguments.earlier.left(&file, |file| Record::read(file, &task.question))?;
    if let Some((known, _)) = known.as_ref().filter(|_| !arguments.json) {
        remark!("continuing with {} samples of an earlier call; use --force to start again", known.len());
    }
    let (mut outcomes, substeps) = known.unwrap_or_default();
    substeps.into_iter().for_each(|substeps| task.study.go_on(substeps));
    output::make_folder(&arguments.out, &below)?;
    let as_it_is = task.study.as_it_is(&progress::is_interrupted)?;
    let ended = task.run(&mut outcomes, &file, &bars)?;
    let Task { study, plan, options, .. } = &task;
    let composite = options.composite;
    let summary = Summary { study, plan, outcomes: &outcomes, ended: &ended, as_it_is: as_it_is.as_deref(), composite };
    verified::write(&task, &summary, arguments, &below)?;
    verified::print(&summary, &folder, arguments.json);
    Ok(match (ended.interrupted, ended.verdict) {
        (true, _) => ExitCode::from(progress::INTERRUPTED),
        (_, Some(Verdict::Failed | Verdict::Undecided)) => ExitCode::from(NOT_PASSED),
        _ => ExitCode::SUCCESS,
    })
}

impl Arguments {
    /// Folder for the results of a loop, within the folder for results.
    fn below(&self, structure: &Structure) -> String {
        format!("{}-verified{}", structure.name, self.earlier.suffix())
    }

    /// The back-end of the runs: that of an earlier call which this one continues, if none is asked for.
    fn backend(&self, structure: &Structure) -> Backend {
        let file = self.out.join(self.below(structure)).join(RUNS);
        let earlier = (!self.earlier.force && self.backend == Backend::Auto).then(|| Record::device(&file)).flatten();
        earlier.map_or(self.backend, |device| if device.is_some() { Backend::Gpu } else { Backend::Cpu })
    }
}

impl Task {
    /// All names and values are checked before anything runs.
    fn new(arguments: &Arguments) -> Result<Self, Error> {
        let wrong = |reason: String| Error::Argument(Invalid::because(reason));
        let plan = if arguments.rare { Plan::rare } else { Plan::new };
        let plan = plan(arguments.at_most, arguments.confidence, arguments.runs).map_err(wrong)?;
        let files = LoopFiles::find(&arguments.name)?;
        arguments.options.check(&arguments.name)?;
        let Form { options, structure, .. } = Form::of(&arguments.options, arguments.separate, &files, None)?;
        let settings = options.settings(&structure)?;
        let (units, hosting) = (options.units(&structure)?, options.hosting.hosting()?);
        let Arguments { vary, vary_from, require, same_noise, seed, .. } = arguments;
        let (vary, vary_from, require) = (vary.clone(), vary_from.clone(), require.clone());
        let asked = Asked { vary, vary_from, require, same_noise: *same_noise, seed: *seed };
        // Where workers have the runs, the loop of none.
        let threads = if employed().is_some() || arguments.job.is_some() { 1 } else { parallel::cores() };
        let load = |structure: &_| units.load(structure, &hosting);
        let mut study = Study::new(structure.clone(), settings, &asked, threads, load)?;
        // A subset simulation's batches are small, and depend on each other.
        if arguments.rare {
            study.stay_on_processor(arguments.backend, "batches of --rare are small, one after the other");
        } else if employed().is_some() || arguments.job.is_some() {
            study.stay_on_processor(arguments.backend, "the runs went to workers");
        } else {
            let found = study.accelerate(arguments.backend(&structure), plan.runs(), &progress::is_interrupted);
            // An earlier call's device that is no longer there is noticed as another question.
            found.or_else(|reason| if arguments.backend == Backend::Gpu { Err(wrong(reason)) } else { Ok(()) })?;
        }
        let run = options.provenance(&arguments.name, &files, &structure, settings, study.loaded())?;
        let varied: Vec<_> = study.names().into_iter().zip(study.distributions()).collect();
        let drawn = asked.vary_from.iter().map(|of| adaptive_fmu::sealed::checksum_of_file(&of.file));
        let question = json!({
            "varied": varied, "drawn": drawn.collect::<Result<Vec<_>, _>>()?, "requirements": study.limits().of,
            "seed": seed, "same_noise": same_noise, "run": run, "device": study.device(),
            // What a study only estimates may go on for longer.
            "plan": (plan.at_most().is_some() || arguments.rare).then_some(&plan),
        });
        Ok(Task { study, plan, options, question })
    }

    /// Makes the runs that are missing.
    fn run(&self, outcomes: &mut Vec<Outcome>, file: &Path, bars: &Bars) -> Result<Ended, Error> {
        let name = &self.study.structure().name;
        let known = outcomes.len();
        let counter = Counter::new(bars, name, self.plan.runs() as usize, known);
        let new = || Record::new(&self.question, self.study.substeps());
        let mut record = new();
        let (mut next, mut counted, mut anew) = (Instant::now(), known, false);
        let write = |record: &mut Record, outcomes: &[Outcome]| {
            let wrong = |reason| Error::Loop { file: file.to_owned(), reason };
            record.add(outcomes).map_err(wrong)?;
            record.write(file)
        };
        let done = |outcomes: &[Outcome], tally: &Tally| {
            if outcomes.is_empty() || outcomes.len() < counted {
                // The study begins, or begins anew since fixed steps were too long.
                (record, counted, anew) = (new(), 0, true);
                counter.restart();
            }
            counter.advance(outcomes.len() - counted, &format!("{} failed", tally.failures));
            counted = outcomes.len();
            let begun = Instant::now();
            if next <= begun {
                write(&mut record, outcomes)?;
                // A large study takes long to write: then it is written less often.
                next = Instant::now() + REST.max(20 * begun.elapsed());
            }
            Ok(())
        };
        let workers = employed();
        let ended = self.study.run(&self.plan, outcomes, workers.as_deref(), done, progress::is_interrupted);
        counter.clear();
        let ended = ended?;
        // A shorter study than an earlier one takes none of its runs away.
        if anew || outcomes.len() >= known {
            write(&mut new(), outcomes)?;
        }
        Ok(ended)
    }
}
