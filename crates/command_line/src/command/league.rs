//! `league`: controllers on equal terms.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::Error;
use adaptive_fmu::league::{Page, Pair, Record, Stage, Study, Units, advice};
use adaptive_fmu::scratch::Scratch;
use adaptive_fmu::workers::{Workers, employed};
use adaptive_fmu::{begun, output, text_file};
use serde::Deserialize;
use serde_json::json;

use super::earlier::EarlierOptions;
use super::hosting::HostingOptions;
use super::open::OpenOption;
use super::progress::{self, Bars, Counter};
use super::workers;
use crate::console;

const PAGE: &str = "index.html";
/// Instructions of a step by `PLANT/CONTROLLER`, which a bench counts.
const INSTRUCTIONS: &str = "instructions.json";

#[derive(clap::Args)]
pub struct Arguments {
    /// Pairs to run: PLANT, PLANT/CONTROLLER or /CONTROLLER (repeatable) [default: all]
    #[arg(long, value_name = "PAIR")]
    only: Vec<String>,
    /// Study to run, a file like examples/league/league.toml [default: this package's own]
    ///
    /// Its FMUs are descriptions or archives next to the file, or FMUs of this package.
    #[arg(long, value_name = "FILE.toml")]
    study: Option<PathBuf>,
    /// Do only a small part of the runs, to test that everything works (the numbers are not results)
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    earlier: EarlierOptions,
    /// Rebuild the page from existing results, without running anything
    #[arg(long, conflicts_with_all = ["only", "resume", "force"])]
    page: bool,
    /// List the pairs, each wired and checked, with the gains that the search may scale, without running anything
    #[arg(long, conflicts_with_all = ["page", "resume", "force"])]
    list: bool,
    /// Folder for the page and for the results of each pair
    #[arg(long, default_value = "results/league")]
    out: PathBuf,
    #[command(flatten)]
    hosting: HostingOptions,
    #[command(flatten)]
    open: OpenOption,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Carry out the next stage of one pair, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

/// A league with its folders.
struct League {
    study: Study,
    /// The study's file, for messages.
    file: PathBuf,
    folder: PathBuf,
    out: PathBuf,
    /// Folder with the files of this package's own league, apart from its study, while it runs.
    _unpacked: Option<Scratch>,
}

/// Computes the requested results that are missing, and writes the page of all results.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let league = League::new(arguments)?;
    if let Some(text) = &arguments.job {
        workers::reply(&league.carry_out(arguments, workers::job(text)?)?);
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.list {
        league.list(arguments)?;
        return Ok(ExitCode::SUCCESS);
    }
    output::check(&league.out, "", &[PAGE])?;
    let complete = arguments.page || league.compute(arguments)?;
    let records = league.records()?;
    let wrong = |reason| Error::Loop { file: league.file.clone(), reason };
    if records.is_empty() {
        let reason = format!("{} contains no results of this study", league.out.display());
        return if complete { Err(wrong(reason)) } else { Ok(ExitCode::from(progress::INTERRUPTED)) };
    }
    let judged = advice(&league.study, &records).map_err(wrong)?;
    let page = Page { study: &league.study, records: &records }.html().map_err(wrong)?;
    let page_file = league.out.join(PAGE);
    output::write(&page_file, page)?;
    if arguments.json {
        print_line!("{}", json!({ "page": console::path(&page_file), "pairs": records, "advice": judged }));
    } else {
        records.iter().for_each(|record| print_line!("{}", pair_line(record)));
        aside!("{}", page_file.display());
    }
    if !complete {
        error_line!("interrupted. Repeat the command to continue");
        return Ok(ExitCode::from(progress::INTERRUPTED));
    }
    arguments.open.show(&page_file);
    Ok(ExitCode::SUCCESS)
}

/// A pair in a line.
fn pair_line(record: &Record) -> String {
    let passed = record.conditions.as_ref().map_or("–".to_owned(), |conditions| {
        let passed = conditions.values().filter(|judged| judged.outcome.holds()).count();
        format!("passes {passed} of {} conditions", conditions.len())
    });
    let failed = record.spread.as_ref().map_or("–".to_owned(), |spread| {
        format!("{} of {} random plants fail", spread.failed(), spread.errors.len())
    });
    let dead_time = record
        .margins
        .map_or("–".to_owned(), |margins| format!("dead-time margin {:.2} ms", 1e3 * margins.dead_time.value));
    format!("{}/{}: {passed}, {failed}, {dead_time}", record.plant, record.controller)
}

impl League {
    fn new(arguments: &Arguments) -> Result<Self, Error> {
        let (mut study, file, folder, unpacked) = match &arguments.study {
            Some(file) => {
                let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
                (Study::read(file)?, file.clone(), folder.unwrap_or(Path::new(".")).to_owned(), None)
            }
            None => {
                let unpacked = Scratch::new()?;
                let file = PathBuf::from("examples/league/league.toml");
                (Study::own(unpacked.path())?, file, unpacked.path().to_owned(), Some(unpacked))
            }
        };
        if arguments.quick {
            study.budget = study.budget.quick();
        }
        // What advice rests on is there, whether it holds or not.
        advice(&study, &[]).map_err(|reason| Error::Loop { file: file.clone(), reason })?;
        let suffix = arguments.earlier.suffix();
        if !suffix.is_empty() && arguments.out.file_name().is_none() {
            let reason = format!(
                "--tag is appended to the name of the folder, but `{}` has no name: give a folder with a name",
                arguments.out.display()
            );
            return Err(Error::Loop { file: "--out".into(), reason });
        }
        // Without a separator at its end.
        let mut out = arguments.out.components().as_path().as_os_str().to_owned();
        out.push(suffix);
        let out = PathBuf::from(out);
        Ok(League { study, file, folder, out, _unpacked: unpacked })
    }

    /// The pairs that are asked for, all of whose names are there.
    fn pairs(&self, arguments: &Arguments) -> Result<Vec<Pair<'_>>, Error> {
        let wrong = |reason| Error::Loop { file: "--only".into(), reason };
        let chosen = self.study.chosen(&arguments.only).map_err(wrong)?;
        let units = Units::new(arguments.hosting.hosting()?)?;
        let pair = |(plant, entry)| Pair::new(plant, entry, self.study.budget, &self.folder, &units);
        chosen.into_iter().map(pair).collect()
    }

    /// Names the pairs that are asked for, without running any.
    fn list(&self, arguments: &Arguments) -> Result<(), Error> {
        let pairs = self.pairs(arguments)?;
        let listed = |pair: &Pair| {
            let (plant, controller) = (&pair.plant.name, &pair.entry.name);
            json!({ "plant": plant, "controller": controller, "as_one": pair.is_one_unit(), "gains": pair.gains() })
        };
        if arguments.json {
            print_line!("{}", json!({ "pairs": pairs.iter().map(listed).collect::<Vec<_>>() }));
            return Ok(());
        }
        for pair in &pairs {
            let form = if pair.is_one_unit() { "single FMU" } else { "separate FMUs" };
            let gains = pair.entry.tune.join(", ");
            let gains = if gains.is_empty() { "no gains to tune".to_owned() } else { format!("gains {gains}") };
            print_line!("{}/{}: {}, {form}; {gains}", pair.plant.name, pair.entry.name, pair.entry.unit);
        }
        Ok(())
    }

    /// True if all of it was done, not interrupted.
    fn compute(&self, arguments: &Arguments) -> Result<bool, Error> {
        // All names, and all earlier results, are checked before anything runs.
        let pairs = self.pairs(arguments)?;
        let begun = |pair| self.begun(pair, &arguments.earlier);
        let begun = pairs.into_iter().map(begun).collect::<Result<Vec<_>, Error>>()?;
        let bars = Bars::new(arguments.json);
        let counter = Counter::new(&bars, "league", Stage::ALL.len() * begun.len(), 0);
        if let Some(workers) = employed() {
            return self.hand_out(&*workers, begun.into_iter().map(|(_, record)| record), &counter);
        }
        for (mut pair, record) in begun {
            if !self.compute_pair(&mut pair, record, &counter)? {
                counter.clear();
                return Ok(false);
            }
        }
        counter.clear();
        Ok(true)
    }

    /// A pair with what is known of it.
    fn begun<'a>(&self, pair: Pair<'a>, earlier: &EarlierOptions) -> Result<(Pair<'a>, Record), Error> {
        let file = self.result(&pair.plant.name, &pair.entry.name);
        let fresh = Record::new(&pair);
        let known = earlier.left(&file, |file| {
            let known = Record::read(file)?;
            let refuse = |differing| Error::Loop {
                file: file.to_owned(),
                reason: format!("belongs to another study: {differing}"),
            };
            fresh.differing(&known).map_or(Ok(known), |differing| Err(refuse(differing)))
        })?;
        Ok((pair, known.unwrap_or(fresh)))
    }

    fn compute_pair(&self, pair: &mut Pair, mut record: Record, counter: &Counter) -> Result<bool, Error> {
        let below = &pair.plant.name;
        output::make_folder(&self.out, below)?;
        let file = self.result(below, &pair.entry.name);
        let name = format!("{}/{}", pair.plant.name, pair.entry.name);
        (0..record.done()).for_each(|_| counter.count(&name));
        while let Some(stage) = record.next() {
            let wrong = |reason| Error::Loop { file: PathBuf::from(&name), reason };
            if !pair.go_on(&mut record, &progress::is_interrupted).map_err(wrong)? {
                return Ok(false);
            }
            record.write(&file)?;
            counter.count(&format!("{name}: {}", stage.word()));
        }
        Ok(true)
    }

    /// Has workers compute the stages of all pairs, the next one of a pair when one is done.
    fn hand_out(
        &self,
        workers: &dyn Workers,
        records: impl Iterator<Item = Record>,
        counter: &Counter,
    ) -> Result<bool, Error> {
        let mut waiting = 0;
        let next = |record: &Record| {
            let is_left = record.next().is_some();
            if is_left {
                workers.submit(json!(record));
            }
            usize::from(is_left)
        };
        for record in records {
            output::make_folder(&self.out, &record.plant)?;
            (0..record.done()).for_each(|_| counter.count(&format!("{}/{}", record.plant, record.controller)));
            waiting += next(&record);
        }
        while waiting > 0 {
            let Some(record) = workers.result().and_then(|(_, result)| Record::deserialize(result).ok()) else {
                counter.clear();
                return Ok(false);
            };
            record.write(&self.result(&record.plant, &record.controller))?;
            counter.count(&format!("{}/{}", record.plant, record.controller));
            waiting += next(&record);
            waiting -= 1;
        }
        counter.clear();
        Ok(true)
    }

    /// Computes the next stage of a pair, for another process.
    fn carry_out(&self, arguments: &Arguments, mut record: Record) -> Result<Record, Error> {
        let name = format!("{}/{}", record.plant, record.controller);
        let wrong = |reason| Error::Loop { file: PathBuf::from(&name), reason };
        let chosen = self.study.chosen(std::slice::from_ref(&name)).map_err(wrong)?;
        let units = Units::new(arguments.hosting.hosting()?)?;
        for (plant, entry) in chosen {
            let mut pair = Pair::new(plant, entry, self.study.budget, &self.folder, &units)?;
            pair.go_on(&mut record, &progress::is_interrupted).map_err(wrong)?;
        }
        Ok(record)
    }

    /// The file of a pair.
    fn result(&self, plant: &str, controller: &str) -> PathBuf {
        self.out.join(plant).join(format!("{controller}.json"))
    }

    /// Numbers counted by a benchmark; empty if there are none.
    fn instructions(&self) -> Result<BTreeMap<String, f64>, Error> {
        let file = self.out.join(INSTRUCTIONS);
        if !begun::path(&file).is_file() {
            return Ok(BTreeMap::new());
        }
        let text = text_file::read(&begun::path(&file)).map_err(Error::file(&file))?;
        serde_json::from_str(&text).map_err(|error| Error::Loop { file, reason: error.to_string() })
    }

    /// The results of this study that are there.
    fn records(&self) -> Result<Vec<Record>, Error> {
        let mut records = Vec::new();
        let counted = self.instructions()?;
        for plant in &self.study.plant {
            for entry in &plant.controller {
                let file = self.result(&plant.name, &entry.name);
                if !begun::path(&file).is_file() {
                    continue;
                }
                let mut record = Record::read(&file)?;
                record.instructions = counted.get(&format!("{}/{}", plant.name, entry.name)).copied();
                if record.question == Record::question(plant, entry, &self.study.budget) {
                    records.push(record);
                } else {
                    remark!("{} is ignored because it belongs to another study", file.display());
                }
            }
        }
        Ok(records)
    }
}
