//! `sweep`: a closed loop with all combinations of some values.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use adaptive_fmu::analysis::{Axis, Point, Sweep, SweepPage};
use adaptive_fmu::error::Error;
use adaptive_fmu::output::{self, Files};
use adaptive_fmu::parallel;
use adaptive_fmu::results::four_digits;
use adaptive_fmu::sealed::{self, Sealed, differing};
use adaptive_fmu::structure::LoopFiles;
use adaptive_fmu::text_file::csv_field;
use serde::Deserialize;
use serde_json::{Value, json};

use super::earlier::EarlierOptions;
use super::loop_options::LoopOptions;
use super::progress::{self, Bars, Counter};
use super::results::PAGE;
use crate::console;

/// Written while the sweep goes on, and when it ends.
const RECORD: &str = "sweep.json";
const POINTS: &str = "points.csv";
/// Shortest time between two writes of the results so far.
const REST: Duration = Duration::from_secs(5);
/// Rows that are printed, and columns of characters for metrics of steps.
const MOST_ROWS: usize = 40;
const WIDTH: usize = 100;

#[derive(clap::Args)]
pub struct Arguments {
    /// Loop of this package, or SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP")]
    name: String,
    /// Parameter and its values (repeatable; all combinations are run).
    ///
    /// Values are LOW..HIGH/logN (N values at equal ratios), LOW..HIGH/linN (N values at equal distances) or A,B,C.
    /// NAME is UNIT.variable, where UNIT is a component. UNIT may be omitted if only one component has such a variable.
    #[arg(long, value_name = "NAME=VALUES", required = true)]
    over: Vec<Axis>,
    #[command(flatten)]
    earlier: EarlierOptions,
    /// Folder for results, which go to its subfolder LOOP-sweep
    #[arg(long, default_value = "results")]
    out: PathBuf,
    #[command(flatten)]
    options: LoopOptions,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A sweep with the further content of its file.
struct Task {
    sweep: Sweep,
    question: Value,
    below: String,
}

/// Computes all runs, and writes their results; also when the user interrupts.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let bars = Bars::new(arguments.json);
    let task = Task::new(arguments)?;
    let folder = arguments.out.join(&task.below);
    output::check(&arguments.out, &task.below, &[RECORD, POINTS, PAGE])?;
    let file = folder.join(RECORD);
    let known = arguments.earlier.left(&file, |file| task.resume(file))?;
    if let Some(known) = known.as_ref().filter(|_| !arguments.json) {
        let runs = known.iter().flatten().count();
        remark!("continuing with {runs} runs of an earlier call; use --force to start again");
    }
    let known = known.unwrap_or_else(|| vec![None; task.sweep.runs()]);
    output::make_folder(&arguments.out, &task.below)?;
    let points = task.run(known, &file, &bars)?;
    let made: Vec<&Point> = points.iter().flatten().collect();
    let interrupted = made.len() < points.len();
    if let Some(reason) = made.last().and_then(|last| last.failure.as_ref())
        && made.iter().all(|point| point.failure.is_some())
        && !interrupted
    {
        let reason = format!("all {} runs failed. The last one: {reason}", made.len());
        task.write(&points, &arguments.out)?;
        return Err(Error::Loop { file: task.sweep.structure().file.clone(), reason });
    }
    task.write(&points, &arguments.out)?;
    task.print(&points, &folder, arguments.json);
    Ok(if interrupted { ExitCode::from(progress::INTERRUPTED) } else { ExitCode::SUCCESS })
}

impl Task {
    /// All names and values are checked before anything runs.
    fn new(arguments: &Arguments) -> Result<Self, Error> {
        let options = &arguments.options;
        let files = LoopFiles::find(&arguments.name)?;
        let structure = options.structure(&files)?;
        let settings = options.settings(&structure)?;
        let (units, hosting) = (options.units(&structure)?, options.hosting.hosting()?);
        let first = units.load(&structure, &hosting)?;
        let provenance = options.provenance(&arguments.name, &files, &structure, settings, &first)?;
        let wrong = |reason| Error::Loop { file: "--over".into(), reason };
        let further = if first.can_be_multiplied() { parallel::cores() - 1 } else { 0 };
        let mut loops = vec![first];
        for _ in 0..further {
            loops.push(units.load(&structure, &hosting)?);
        }
        let sweep = Sweep::new(structure.clone(), settings, arguments.over.clone(), loops).map_err(wrong)?;
        let form = if options.composite { "-composite" } else { "" };
        let below = format!("{}{form}-sweep{}", structure.name, arguments.earlier.suffix());
        let question = json!({ "over": sweep.axes(), "run": provenance });
        Ok(Task { sweep, question, below })
    }

    /// The runs of an earlier sweep.
    fn resume(&self, file: &Path) -> Result<Vec<Option<Point>>, Error> {
        let refuse = |reason: String| Error::Loop { file: file.to_owned(), reason };
        let Sealed { content, fits } = sealed::read(file, "sweep to continue")?;
        if fits != Some(true) {
            return Err(refuse("its content does not match its checksum, so it was changed".to_owned()));
        }
        if let Some(differing) = differing(&content["question"], &self.question) {
            return Err(refuse(format!("belongs to another sweep: {differing}")));
        }
        Vec::deserialize(&content["points"]).map_err(|error| refuse(format!("can't be continued: {error}")))
    }

    fn run(&self, known: Vec<Option<Point>>, file: &Path, bars: &Bars) -> Result<Vec<Option<Point>>, Error> {
        let (runs, done) = (self.sweep.runs(), known.iter().flatten().count());
        let counter = Counter::new(bars, &self.sweep.structure().name, runs, done);
        let saved = Mutex::new((known.clone(), Instant::now(), Ok(())));
        let note = |run: usize, point: &Point| {
            let mut saved = saved.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            saved.0[run] = Some(point.clone());
            let begun = Instant::now();
            if saved.1 <= begun {
                let written = self.keep(&saved.0, file);
                // A large sweep takes long to write: then it is written less often.
                saved.1 = Instant::now() + REST.max(20 * begun.elapsed());
                saved.2 = written;
            }
            counter.count(if point.failure.is_some() { "one run failed" } else { "last run complete" });
        };
        let points = self.sweep.run(&known, note, progress::is_interrupted);
        counter.clear();
        let (_, _, written) = saved.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        written?;
        self.keep(&points, file)?;
        Ok(points)
    }

    fn keep(&self, points: &[Option<Point>], file: &Path) -> Result<(), Error> {
        sealed::write(file, json!({ "question": self.question, "points": points }))
    }

    fn write(&self, points: &[Option<Point>], out: &Path) -> Result<(), Error> {
        let mut files = Files::within(out, &self.below)?;
        files.add(POINTS, self.csv(points))?;
        files.add(PAGE, SweepPage { sweep: &self.sweep, points, table: POINTS }.html())?;
        files.place()
    }

    /// All runs that were made, a line each.
    fn csv(&self, points: &[Option<Point>]) -> String {
        let shown: Vec<_> = self.sweep.metrics(points).collect();
        let names = self.sweep.axes().iter().map(|axis| axis.name.as_str());
        let names = names.chain(["ended"]).chain(shown.iter().map(|(_, label)| *label)).chain(["message"]);
        let mut csv = names.map(csv_field).collect::<Vec<_>>().join(",") + "\n";
        for (run, point) in made(points) {
            let metrics = shown.iter().map(|(k, _)| point.metric(*k).map_or(String::new(), |value| value.to_string()));
            let values = self.sweep.values(run).into_iter().map(str::to_owned);
            let ended = ended(point.failure.as_ref()).to_owned();
            let fields = values.chain([ended]).chain(metrics).chain([point.failure.clone().unwrap_or_default()]);
            let fields: Vec<_> = fields.map(|field| csv_field(&field).into_owned()).collect();
            csv.push_str(&(fields.join(",") + "\n"));
        }
        csv
    }

    fn print(&self, points: &[Option<Point>], folder: &Path, json: bool) {
        let (made_runs, runs) = (made(points).count(), self.sweep.runs());
        let shortfall = (made_runs < runs).then(|| format!("interrupted after {made_runs} of {runs} runs"));
        if let Some(shortfall) = &shortfall {
            error_line!("{shortfall}. Repeat the command to continue");
        }
        if json {
            print_line!("{}", self.to_json(points, folder));
            return;
        }
        let width = |name: &str| name.chars().count().max(12);
        let names: Vec<_> = self.sweep.axes().iter().map(|axis| axis.name.as_str()).collect();
        let own = self.sweep.structure().metrics.len();
        let all: Vec<_> = self.sweep.metrics(points).collect();
        // The loop's own metrics, and of those of steps as many as there is room for.
        let mut room = WIDTH.saturating_sub(names.iter().map(|name| width(name) + 2).sum());
        let fits = |(k, label): &&(usize, &str)| {
            let needed = width(label) + 2;
            let fits = *k < own || needed <= room;
            room = if fits { room.saturating_sub(needed) } else { 0 };
            fits
        };
        let shown: Vec<_> = all.iter().filter(fits).copied().collect();
        let head: Vec<&str> = names.into_iter().chain(shown.iter().map(|(_, label)| *label)).collect();
        let widths: Vec<usize> = head.iter().map(|name| width(name)).collect();
        let line = |cells: Vec<String>| {
            let padded = cells.into_iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}"));
            padded.collect::<Vec<_>>().join("  ")
        };
        print_line!("{}", line(head.into_iter().map(str::to_owned).collect()));
        for (run, point) in made(points).take(MOST_ROWS) {
            let values = self.sweep.values(run).into_iter().map(str::to_owned);
            let metrics = shown.iter().map(|(k, _)| point.metric(*k).map_or("–".to_owned(), four_digits));
            let failed = point.failure.as_ref().map_or("", |_| "  failed");
            print_line!("{}{failed}", line(values.chain(metrics).collect()));
        }
        if made_runs > MOST_ROWS {
            print_line!("… and {} more in {POINTS}", made_runs - MOST_ROWS);
        }
        let further: Vec<_> = all.iter().filter(|metric| !shown.contains(metric)).map(|(_, label)| *label).collect();
        if !further.is_empty() {
            print_line!("Further metrics are in {POINTS}: {}", further.join("; "));
        }
        print_line!("{PAGE} (diagrams) and {POINTS} (all runs) are in {}", folder.display());
    }

    fn to_json(&self, points: &[Option<Point>], folder: &Path) -> Value {
        let shown: Vec<_> = self.sweep.metrics(points).collect();
        let point = |(run, point): (usize, &Point)| {
            let metrics = shown.iter().map(|(k, label)| ((*label).to_owned(), json!(point.metric(*k))));
            let names = self.sweep.axes().iter().map(|axis| axis.name.clone());
            let values = names.zip(self.sweep.values(run).into_iter().map(|value| json!(value)));
            json!({ "values": values.collect::<serde_json::Map<_, _>>(), "ended": ended(point.failure.as_ref()),
                    "metrics": metrics.collect::<serde_json::Map<_, _>>(), "message": point.failure })
        };
        let is_whole = points.iter().all(Option::is_some);
        json!({ "loop": self.sweep.structure().name, "ended": if is_whole { "complete" } else { "interrupted" },
                "runs": self.sweep.runs(), "points": made(points).map(point).collect::<Vec<_>>(), "results": console::path(folder) })
    }
}

fn made(points: &[Option<Point>]) -> impl Iterator<Item = (usize, &Point)> {
    points.iter().enumerate().filter_map(|(run, point)| Some((run, point.as_ref()?)))
}

fn ended(failure: Option<&String>) -> &'static str {
    if failure.is_some() { "failed" } else { "complete" }
}
