//! `identify`: from records of a plant to a linear model with the uncertainty that the data leave.

mod page;
mod parameters;
mod plan;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::identified::{convert, lines, text_of};
use adaptive_fmu::tables::{self, Column, Table};
use adaptive_fmu::template::counted;
use adaptive_fmu::{begun, near, sealed, text_file};
use adaptive_fmu_identification::{
    Cause, Hold, Identified, LABEL, Options, Record, Signals, Structure, identify_outputs, identify_states, time_of,
};
use clap::Parser as _;
use serde_json::Value;

use super::linearise::assignment;
use super::names::Names;
use super::new::{name_of, place, there_already};
use super::number::{part, positive};
use super::tables::log_assumptions;

/// The model was written, and a finding is that it should not be used for a design.
const UNSOUND: u8 = 3;
/// Default of --hold-out, and the least that is too much.
const HELD_OUT: &str = "30%";
const MOST_HELD_OUT: f64 = 0.9;
/// The page, in the folder of --page.
const PAGE: &str = "identify.html";

/// The arguments by themselves, as another command gives them.
#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct Alone {
    #[command(flatten)]
    arguments: Arguments,
}

impl Arguments {
    /// The arguments that a user would give.
    ///
    /// # Errors
    /// An argument that is missing or wrong.
    pub fn of(given: Vec<OsString>) -> Result<Self, Error> {
        let refuse = |error: clap::Error| Error::Argument(Invalid::because(error.kind().to_string()));
        Alone::try_parse_from(given).map(|alone| alone.arguments).map_err(refuse)
    }
}

#[derive(clap::Args)]
pub struct Arguments {
    /// CSV, Parquet or MATLAB files (.csv, .parquet, .mat), one or more records of the same plant
    ///
    /// The first line of a CSV file contains names; the column `time` or else the first one is the time in s, or in ms, us, min or h if
    /// its name ends with that: `time [ms]`. Separators are commas, or semicolons or tabs, which allow a decimal comma. A column
    /// `record` divides a file into records. A MATLAB file (version 5 or 7) contains the time and vectors of that length.
    #[arg(required_unless_present = "plan", value_name = "RECORD")]
    records: Vec<PathBuf>,
    /// Columns that are inputs of the plant
    #[arg(long, value_name = "NAME,…", required_unless_present_any = ["plan", "fmu"])]
    inputs: Option<Names>,
    /// Columns that are its states: all of them are measured
    #[arg(long, value_name = "NAME,…", required_unless_present_any = ["outputs", "plan"], conflicts_with = "outputs")]
    states: Option<Names>,
    /// Columns that are its outputs, if not all states are measured
    #[arg(long, value_name = "NAME,…")]
    outputs: Option<Names>,
    /// File to write
    #[arg(long, default_value = "model.json")]
    out: PathBuf,
    /// Overwrite an existing file of that name
    #[arg(long)]
    force: bool,
    /// Known entries of A and B: a TOML file with A and B, in which "?" is free, "?<0" negative, "?>0" positive
    ///
    /// A row of A may be an equation: "twist' = motor_speed - load_speed".
    #[arg(long, value_name = "FILE.toml", conflicts_with = "outputs")]
    structure: Option<PathBuf>,
    /// Number of states with --outputs [default: the order that predicts the held-out part best]
    #[arg(long, value_name = "COUNT", requires = "outputs", value_parser = clap::value_parser!(u16).range(1..=10))]
    order: Option<u16>,
    /// Dead time of each input, s: one number, or one for each [default: 0]
    #[arg(long, value_name = "NUMBER,…", value_delimiter = ',', value_parser = not_negative)]
    delay: Vec<f64>,
    /// Last part of each record that checks the model, or a file of records that do
    #[arg(long, value_name = "PART or FILE", default_value = HELD_OUT)]
    hold_out: String,
    /// Course of the inputs between rows
    #[arg(long, value_enum, default_value_t = HoldOf::ZeroOrder)]
    hold: HoldOf,
    /// Inputs that never move, to be left out
    #[arg(long, value_name = "NAME,…")]
    fixed: Option<Names>,
    /// Constant of each record: operating point, friction, bias
    #[arg(long, value_enum, default_value_t = Offset::Record)]
    offset: Offset,
    /// Confidence level that the model keeps for bounds
    #[arg(long, default_value_t = 0.99, value_parser = level)]
    level: f64,
    /// Longest window that is simulated without correction, s [default: whole records]
    #[arg(long, value_name = "TIME", value_parser = positive)]
    windows: Option<f64>,
    /// Bandwidth of the controller to be designed, rad/s [default: from the model]
    #[arg(long, value_parser = positive)]
    bandwidth: Option<f64>,
    /// Column that is the time [default: `time`, or else the first one]
    #[arg(long, value_name = "NAME")]
    time: Option<String>,
    /// The unit of measurement of a column, in place of that of the file (repeatable)
    ///
    /// Columns in rpm, mm or degC, for example, are converted to rad/s, m or K.
    #[arg(long, value_name = "NAME=UNIT", value_parser = assignment)]
    unit: Vec<(String, String)>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Write a page: measured and simulated signals, residuals, poles and frequency responses with their uncertainty
    ///
    /// A folder, in which it is identify.html, or the file by its name with .html.
    #[arg(long, value_name = "DIR", conflicts_with = "plan")]
    page: Option<PathBuf>,
    #[command(flatten)]
    parameters: parameters::ParameterOptions,
    #[command(flatten)]
    plan: plan::PlanOptions,
}

impl Arguments {
    /// Names of the inputs.
    fn inputs(&self) -> &[String] {
        self.inputs.as_ref().map_or(&[], |Names(names)| names)
    }

    /// The file of the page.
    fn page_file(&self) -> Option<PathBuf> {
        let page = self.page.as_ref()?;
        let is_file = page.extension().is_some_and(|end| end == "html");
        Some(if is_file { page.clone() } else { page.join(PAGE) })
    }

    /// Refuses a file that is there already, before anything is computed.
    fn check_out(&self, file: &Path) -> Result<(), Error> {
        let file = begun::path(file);
        if self.force || !file.exists() {
            return Ok(());
        }
        Err(there_already(Error::File { file, source: ErrorKind::AlreadyExists.into() }))
    }
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum HoldOf {
    /// Each value holds until the next row, as a digital controller writes it
    ZeroOrder,
    /// Straight lines between the rows: an input that was measured
    FirstOrder,
}

#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum Offset {
    /// One for each record
    Record,
    /// None: the records are deviations from a point of rest
    None,
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "must be a finite number, at least 0".to_owned())
}

/// Reads a confidence level.
///
/// # Errors
/// The levels that are allowed.
pub fn level(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "must be above 0 and below 1".to_owned())
}

/// Writes the model and prints what was found; the exit code is 3 where the model should not be used for a design.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    if let Some(file) = &arguments.plan.plan {
        return plan::execute(file, &arguments.plan, arguments.json).map(|()| ExitCode::SUCCESS);
    }
    arguments.check_out(&arguments.out)?;
    arguments.page_file().map_or(Ok(()), |file| arguments.check_out(&file))?;
    let records = read(&arguments.records, arguments)?;
    if let Some(fmu) = &arguments.parameters.fmu {
        arguments.check_out(&arguments.out.with_extension("ssv"))?;
        return parameters::execute(arguments, fmu, &records);
    }
    let (part, held_out) = held_out(arguments)?;
    let options = options(arguments, part)?;
    let checked: Vec<_> = held_out.iter().flatten().map(|read| read.record.clone()).collect();
    let checked = held_out.is_some().then_some(&checked[..]);
    let of = |Names(measured): &Names| Signals { inputs: arguments.inputs().to_vec(), measured: measured.clone() };
    let tables: Vec<_> = records.iter().map(|read| read.record.clone()).collect();
    let found = match (&arguments.states, &arguments.outputs) {
        (_, Some(outputs)) => identify_outputs(&tables, checked, &known(of(outputs), &tables)?, &options),
        (Some(states), None) => identify_states(&tables, checked, &known(of(states), &tables)?, &options),
        // The parser refuses that.
        (None, None) => return Ok(ExitCode::SUCCESS),
    };
    let mut found = found.map_err(|refusal| {
        let advice =
            of_cause(refusal.cause, arguments.states.is_some()).map_or(String::new(), |advice| format!(". {advice}"));
        Error::Argument(Invalid::because(format!("{refusal}{advice}")))
    })?;
    for of in &mut found.model.records {
        of.sha256 = records.iter().find(|read| read.record.name == of.file).map(|read| read.checksum.clone());
    }
    let out = &arguments.out;
    place(out, &[(name_of(out)?.into(), &text_of(&found.model)?, arguments.force)])?;
    let page = page::write(arguments, || page::of_identified(&found, arguments).html())?;
    if arguments.json {
        print_line!("{}", as_json(&found)?);
    } else {
        lines(&found, true).iter().for_each(|line| print_line!("{line}"));
        aside!("the model is in {}", out.display());
        page.iter().for_each(|page| aside!("the page is {}", page.display()));
    }
    Ok(if found.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(UNSOUND) })
}

/// Refuses signals that a record lacks, with the names that are near.
fn known(signals: Signals, records: &[Record]) -> Result<Signals, Error> {
    for name in signals.inputs.iter().chain(&signals.measured) {
        if let Some(record) = records.iter().find(|record| record.column(name).is_none()) {
            let known = record.columns.iter().map(|column| column.name.clone()).collect();
            return Err(Error::Unknown { what: "column", name: name.clone(), known, all: "" });
        }
    }
    Ok(signals)
}

/// Options that help where there is no model.
fn of_cause(cause: Cause, of_states: bool) -> Option<&'static str> {
    match cause {
        Cause::StillInput => Some("--fixed NAME leaves an input out"),
        Cause::TooShort if of_states => Some("With --structure fewer entries are unknown"),
        Cause::NoModel if of_states => Some("Give all states that matter, or --outputs"),
        _ => None,
    }
}

/// A record, and the checksum of its file.
struct Read {
    record: Record,
    checksum: String,
}

fn read(files: &[PathBuf], arguments: &Arguments) -> Result<Vec<Read>, Error> {
    let mut records = Vec::new();
    for file in files {
        let table = tables::read(file, &[LABEL])?;
        let name = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let found = Record::of_table(&name, &table, arguments.time.as_deref());
        let checksum = sealed::checksum_of_file(file)?;
        let mut found = found.map_err(|refusal| Error::Argument(Invalid::because(refusal)))?;
        log_assumptions(file, &assumed(&table, arguments.time.as_deref(), found.len()), &table.left_out);
        for (k, record) in found.iter_mut().enumerate() {
            let converted = convert(record, &arguments.unit)?;
            // All records of a file have the same columns.
            converted.iter().filter(|_| k == 0).for_each(|line| remark!("{line}"));
        }
        records.extend(found.into_iter().map(|record| Read { record, checksum: checksum.clone() }));
    }
    Ok(records)
}

/// Assumptions about a file with this number of records.
fn assumed(table: &Table, time: Option<&str>, records: usize) -> Vec<String> {
    let mut lines = table.assumed.clone();
    let of_time =
        |time: &Column| format!("the time is the column `{}`, in {}", time.name, time.unit.as_deref().unwrap_or("s"));
    lines.extend(time_of(table, time).map(of_time));
    if table.column(LABEL).is_some_and(|label| !label.texts.is_empty()) {
        lines.push(format!("the column `{LABEL}` divides it: {}", counted(records, "record")));
    }
    lines
}

/// The part of each record that is held out, or the records that are.
fn held_out(arguments: &Arguments) -> Result<(f64, Option<Vec<Read>>), Error> {
    let given = &arguments.hold_out;
    match part(given) {
        Ok(part) if part < MOST_HELD_OUT => Ok((part, None)),
        Err(_) if tables::is_table(Path::new(given)) => Ok((0.0, Some(read(&[PathBuf::from(given)], arguments)?))),
        _ => {
            let allowed = "must be at least 0 and below 90 %, as 30% or 0.3, or a file: .csv, .parquet or .mat";
            Err(Error::Argument(Invalid::new("--hold-out", given, allowed)))
        }
    }
}

fn options(arguments: &Arguments, hold_out: f64) -> Result<Options, Error> {
    // The parser lets that pass, since --states and --outputs exclude each other.
    if let (Some(order), None) = (arguments.order, &arguments.outputs) {
        let allowed = "is for --outputs; with --states the order is the number of states";
        return Err(Error::Argument(Invalid::new("--order", order, allowed)));
    }
    let structure = arguments.structure.as_deref().map_or(Ok(Structure::default()), read_structure)?;
    let count = arguments.inputs().len();
    let delays = match &arguments.delay[..] {
        [one] => vec![*one; count],
        each => each.to_vec(),
    };
    if !delays.is_empty() && delays.len() != count {
        let allowed = format!("must be one number, or {count}, one for each input");
        return Err(Error::Argument(Invalid::new("--delay", format!("{} numbers", delays.len()), allowed)));
    }
    Ok(Options {
        structure,
        hold: match arguments.hold {
            HoldOf::ZeroOrder => Hold::ZeroOrder,
            HoldOf::FirstOrder => Hold::FirstOrder,
        },
        hold_out,
        offsets: arguments.offset == Offset::Record,
        level: arguments.level,
        delays,
        fixed: arguments.fixed.clone().map_or_else(Vec::new, |Names(names)| names),
        longest_window: arguments.windows,
        bandwidth: arguments.bandwidth,
        order: arguments.order.map(usize::from),
    })
}

fn read_structure(file: &Path) -> Result<Structure, Error> {
    let text = text_file::read(&begun::path(file)).map_err(Error::file(file))?;
    let refuse = |reason: String| Error::Description { file: file.to_owned(), reason };
    toml::from_str(&text).map_err(|error| refuse(near::in_line(&text, &error)))
}

fn as_json(found: &Identified) -> Result<Value, Error> {
    serde_json::to_value(found).map_err(|error| Error::Argument(Invalid::because(error)))
}
