//! `report`: the examples of the thesis on one page.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::output::{self, Files};
use adaptive_fmu::parallel;
use adaptive_fmu::reproduction::{
    Curve, Done, Example, Figure, Outcome, Page, Run, SINGLE_BEFORE, Study, linear_limit,
};
use adaptive_fmu::results::Ending;
use adaptive_fmu::structure::LoopFiles;
use adaptive_fmu::text_file;
use serde_json::{Value, json};

use super::loop_options::LoopOptions;
use super::open::OpenOption;
use super::parameters::Parameters;
use super::progress::{self, Bars, Counter};
use super::ready;
use super::run::{Results, simulated};
use crate::console;

const PAGE: &str = "index.html";

#[derive(clap::Args)]
pub struct Arguments {
    /// Examples to run, whose numbers begin with this, such as 3.3 or 6.5.1 (repeatable) [default: all]
    #[arg(long, value_name = "EXAMPLE")]
    only: Vec<String>,
    /// Study to run, a file like examples/thesis.toml [default: the thesis]
    #[arg(long, value_name = "FILE.toml")]
    study: Option<PathBuf>,
    /// Folder for the page, its figures (SVG) and their curves (CSV)
    #[arg(long, default_value = "results/report")]
    out: PathBuf,
    #[command(flatten)]
    open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// An example with its figures, how long its runs take about, and which of them have a linear limit.
struct Planned<'a> {
    example: &'a Example,
    figures: Vec<Figure>,
    efforts: Vec<f64>,
    has_limit: Vec<bool>,
}

/// Form of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    AsItIs,
    /// Adaptation is frozen.
    Frozen,
    /// The linear controller that the adaptive one tends to takes its place.
    Linear,
}

/// Runs every example, each run as it is, with adaptation frozen, and with its linear limit, where it has one.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let file = arguments.study.clone().unwrap_or_else(|| PathBuf::from("examples/thesis.toml"));
    let wrong = |reason| Error::Loop { file: file.clone(), reason };
    let study = match &arguments.study {
        Some(file) => {
            let text = text_file::read(file).map_err(Error::file(file))?;
            if text.contains(SINGLE_BEFORE) {
                let advice = "write `, as a single FMU`; the former name is read until 0.3";
                error_line!("warning: {}: the name of a run ends with `{SINGLE_BEFORE}`: {advice}", file.display());
            }
            Study::read(&text).map_err(wrong)?
        }
        None => Study::thesis().map_err(wrong)?,
    };
    let study = study.only(&arguments.only).map_err(wrong)?;
    let planned = study.example.iter().map(|example| planned(example, &file)).collect::<Result<Vec<_>, Error>>()?;
    output::check(&arguments.out, "", &[PAGE])?;
    let outcomes = run_all(&planned, arguments)?;
    if outcomes.iter().any(|outcome| outcome.ending == Ending::Interrupted) {
        error_line!("interrupted: no page was written");
        return Ok(ExitCode::from(progress::INTERRUPTED));
    }
    let done = judged(&planned, outcomes).map_err(wrong)?;
    write(&Page { study: &study, done: &done }, &arguments.out)?;
    print_summary(&study, &done, arguments);
    arguments.open.show(&arguments.out.join(PAGE));
    Ok(ExitCode::SUCCESS)
}

fn options(run: &Run, form: Form) -> LoopOptions {
    let set = run.frozen.iter().filter(|_| form == Form::Frozen).map(|(name, value)| format!("{name}={value}"));
    let parameters = Parameters::new(run.case.as_deref(), set.collect());
    let linear = form == Form::Linear;
    LoopOptions { composite: run.composite, step: run.step, parameters, linear, ..LoopOptions::default() }
}

/// Plans an example; claims about what no run measures are refused before anything is run.
fn planned<'a>(example: &'a Example, file: &Path) -> Result<Planned<'a>, Error> {
    let structure = |run: &Run| options(run, Form::AsItIs).structure(&LoopFiles::find(&run.name)?);
    let structures = example.run.iter().map(structure).collect::<Result<Vec<_>, Error>>()?;
    let before = example.run.iter().zip(&structures).map(|(run, structure)| Outcome::before(&run.key(), structure));
    let before: Vec<_> = before.collect();
    let wrong = |reason| Error::Loop { file: file.to_owned(), reason };
    example.claim.iter().try_for_each(|claim| claim.judge(&before).map(drop)).map_err(wrong)?;
    let has_limit = structures.iter().map(|structure| Ok(linear_limit(structure)?.is_some()));
    let has_limit = has_limit.collect::<Result<_, Error>>()?;
    let runs = example.run.iter().zip(&structures);
    let efforts = runs.map(|(run, structure)| options(run, Form::AsItIs).effort(structure)).collect();
    Ok(Planned { example, figures: Figure::all(example, &structures), efforts, has_limit })
}

impl Planned<'_> {
    /// The forms of its runs, one run after the other, and how long each takes about.
    fn forms(&self) -> impl Iterator<Item = (&Run, Form, f64)> {
        let runs = self.example.run.iter().zip(&self.efforts).zip(&self.has_limit);
        runs.flat_map(|((run, effort), has_limit)| {
            let linear = has_limit.then_some((run, Form::Linear, *effort));
            [(run, Form::AsItIs, *effort), (run, Form::Frozen, *effort)].into_iter().chain(linear)
        })
    }
}

/// The outcomes of all runs in their order, each in its forms.
fn run_all(planned: &[Planned], arguments: &Arguments) -> Result<Vec<Outcome>, Error> {
    let all: Vec<(&Planned, (&Run, Form, f64))> =
        planned.iter().flat_map(|planned| planned.forms().map(move |form| (planned, form))).collect();
    // Created once for all runs. If that fails, each run that needs them reports the reason.
    let _units = ready::units();
    let efforts: Vec<f64> = all.iter().map(|(_, (_, _, effort))| *effort).collect();
    let (bars, silent) = (Bars::new(arguments.json), Bars::new(true));
    let counter = Counter::new(&bars, "report", all.len(), 0);
    let outcomes = parallel::longest_first(&vec![(); parallel::cores()], &efforts, |(), place| {
        let (planned, (run, form, _)) = all[place];
        let outcome = attempt(planned, run, form, &silent);
        counter.count(&run.key());
        outcome
    });
    counter.clear();
    outcomes.into_iter().collect()
}

fn attempt(planned: &Planned, run: &Run, form: Form, bars: &Bars) -> Result<Outcome, Error> {
    let key = run.key();
    let is_shown = |curve: &&Curve| form == Form::AsItIs && curve.run == key;
    let shown: Vec<&Curve> = planned.figures.iter().flat_map(Figure::needs).filter(is_shown).collect();
    let signals: Vec<&str> =
        shown.iter().flat_map(|curve| [Some(&curve.of), curve.minus.as_ref()]).flatten().map(String::as_str).collect();
    let done = simulated(&options(run, form), &run.name, Results::default(), &signals, bars)?;
    let wrong = |reason| Error::Loop { file: PathBuf::from(&run.name), reason };
    Outcome::new(&key, &done.report(), done.took, &shown).map_err(wrong)
}

/// Results of each example.
fn judged(planned: &[Planned], outcomes: Vec<Outcome>) -> Result<Vec<Done>, String> {
    let mut rest = outcomes.into_iter();
    let mut done = Vec::new();
    for planned in planned {
        let (mut outcomes, mut frozen, mut linear) = (Vec::new(), Vec::new(), Vec::new());
        for has_limit in &planned.has_limit {
            outcomes.extend(rest.next());
            frozen.extend(rest.next());
            linear.push(if *has_limit { rest.next() } else { None });
        }
        let Planned { example, figures, .. } = planned;
        let claims = example.claim.iter().map(|claim| claim.judge(&outcomes)).collect::<Result<_, _>>()?;
        let named = |(k, figure): (usize, &Figure)| figure.draw(format!("{}-{}", example.name, k + 1), &outcomes);
        let drawings = figures.iter().enumerate().map(named).collect::<Result<_, _>>()?;
        done.push(Done { outcomes, frozen, linear, claims, drawings });
    }
    Ok(done)
}

fn write(page: &Page, folder: &Path) -> Result<(), Error> {
    let mut files = Files::within(folder, "")?;
    for drawing in page.done.iter().flat_map(|done| &done.drawings) {
        files.add(format!("figures/{}.svg", drawing.name), &drawing.svg)?;
        files.add(format!("data/{}.csv", drawing.name), &drawing.csv)?;
    }
    files.add(PAGE, page.html())?;
    files.place()
}

fn print_summary(study: &Study, done: &[Done], arguments: &Arguments) {
    let page = arguments.out.join(PAGE);
    if arguments.json {
        let examples = study.example.iter().zip(done).map(|(example, done)| {
            let runs = |outcomes: &[Outcome]| -> Vec<Value> { outcomes.iter().map(outcome_json).collect() };
            json!({ "example": example.name, "claims": done.claims, "runs": runs(&done.outcomes),
                    "frozen": runs(&done.frozen), "linear": done.linear.iter().map(|it| it.as_ref().map(outcome_json)).collect::<Vec<_>>(),
                    "figures": done.drawings.len() })
        });
        print_line!("{}", json!({ "examples": examples.collect::<Vec<_>>(), "page": console::path(&page) }));
        return;
    }
    for (example, done) in study.example.iter().zip(done) {
        print_line!("{} {}", example.name, example.title);
        for claim in &done.claims {
            print_line!("  {:3}  {}: {}", if claim.holds { "yes" } else { "NO" }, claim.claim, claim.measured);
        }
    }
    aside!("page: {}; its figures and their data are in the same folder", page.display());
}

fn outcome_json(outcome: &Outcome) -> Value {
    json!({ "run": outcome.run, "ended": outcome.ending.word(), "at": outcome.end, "metrics": outcome.measured,
            "seconds": outcome.took.as_secs_f64() })
}
