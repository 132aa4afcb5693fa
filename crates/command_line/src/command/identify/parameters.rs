//! `identify --fmu`: parameters of an FMU from records, and the linear model that follows from them.
#![allow(non_snake_case)] // matrices have the names of the field

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use adaptive_fmu::analysis::{Linearisation, Method, OperatingPoint, Quantity, linearise};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::estimation::{Estimated, Found, Recorded, Sought, Task};
use adaptive_fmu::fmu::Fmu;
use adaptive_fmu::identified::text_of;
use adaptive_fmu::model_description::Variable;
use adaptive_fmu::report::number;
use adaptive_fmu::simulation::{Inputs, conversion, values_of};
use adaptive_fmu::template::counted;
use adaptive_fmu::tuning::parameter_set;
use adaptive_fmu_identification::{Fits, Free, Model, RecordOf, Units};
use nalgebra::DMatrix;
use serde_json::json;

use super::{Arguments, HoldOf, Offset, Read, UNSOUND, page};
use crate::command::hosting::HostingOptions;
use crate::command::linearise::{assignment, open_unit};
use crate::command::names::Names;
use crate::command::new::{name_of, place};
use crate::command::number::part;
use crate::command::workers;

/// Heading of these options in the help.
const HEADING: &str = "Parameters of an FMU";
/// A parameter is seen if its standard error is at most this part of it, or this part of its start value.
const MOST_ERROR: f64 = 0.3;
const LEAST_ERROR: f64 = 0.03;
/// Parameters whose information has a larger condition number can't be distinguished.
const MOST_CONDITION: f64 = 1e8;
/// A sound fit is at least this part of what noise leaves.
const LEAST_FIT: f64 = 0.5;
/// Step of a parameter for differences of the linear model: in standard errors, and at least in parts of its value. The latter is larger
/// where the linear model is found from responses, which are blurred by the steps of the FMU.
const STEP: f64 = 0.5;
const LEAST_STEP: f64 = 1e-3;
const LEAST_OF_RESPONSES: f64 = 0.1;
/// Entries of the linear model that the parameters leave less uncertain than this, in parts of the entry, are known: what differences
/// leave of an entry that doesn't depend on them.
const LEAST_SPREAD: f64 = 1e-6;

#[derive(clap::Args, Debug, Clone)]
pub struct ParameterOptions {
    /// FMU, description or loop whose parameters are estimated, instead of the matrices of a linear model
    ///
    /// The model that is written is linear about its start, with the uncertainty that the parameters leave; the parameters are
    /// written as a parameter set (.ssv) of the same name.
    #[arg(
        long,
        value_name = "FMU",
        requires_all = ["free", "outputs"],
        conflicts_with_all = ["states", "structure", "order", "delay", "fixed", "windows"],
        help_heading = HEADING
    )]
    pub fmu: Option<String>,
    /// Parameters to estimate, with their smallest and largest values if these are known
    #[arg(long, value_name = "NAME[=LOW:HIGH],…", requires = "fmu", help_heading = HEADING)]
    free: Option<Names>,
    /// Start values to estimate for each record, as initial states
    #[arg(long, value_name = "NAME[=LOW:HIGH],…", requires = "fmu", help_heading = HEADING)]
    initial: Option<Names>,
    /// Start value of a parameter, where the search begins, or constant value of an input (repeatable)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment, requires = "fmu", help_heading = HEADING)]
    set: Vec<(String, String)>,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Carry out one run of a search, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

/// Estimates, writes both files, and prints what was found.
pub fn execute(arguments: &Arguments, name: &str, records: &[Read]) -> Result<ExitCode, Error> {
    let options = &arguments.parameters;
    let fmu = open_unit(name, &options.hosting.hosting()?)?;
    let Names(outputs) = arguments.outputs.clone().unwrap_or(Names(Vec::new()));
    let sought = sought(options)?;
    let recorded =
        records.iter().map(|read| recorded(arguments, &fmu, read, &outputs)).collect::<Result<Vec<_>, _>>()?;
    let task = Task {
        fmu: &fmu,
        start: &options.set,
        outputs: &outputs,
        sought: &sought,
        records: &recorded,
        hold_out: held_out(&arguments.hold_out)?,
        has_offsets: arguments.offset == Offset::Record,
    };
    if let Some(text) = &options.job {
        workers::reply(&task.carry_out(&workers::job(text)?)?);
        return Ok(ExitCode::SUCCESS);
    }
    let found = task.run()?;
    let findings = findings(&found, &outputs);
    let linear = linear_model(&fmu, arguments, &found);
    let model = linear.as_ref().ok().map(|linear| model(linear, arguments, records, &found, &fmu));
    write(arguments, &found, model.as_ref(), &fmu)?;
    let page = page::write(arguments, || {
        let measured: Vec<_> = recorded.iter().map(|record| &record.outputs[..]).collect();
        let unit = |name: &String| fmu.description.variable(name).and_then(|own| own.unit.clone()).unwrap_or_default();
        let units: Vec<_> = outputs.iter().map(unit).collect();
        let shown = page::OfParameters::new(&found, records, &measured, model.as_ref());
        shown.report(&found, (model.as_ref(), &findings), &units, arguments).html()
    })?;
    let set = arguments.out.with_extension("ssv");
    if arguments.json {
        let parameters: Vec<_> = found.parameters.iter().map(as_json).collect();
        print_line!(
            "{}",
            json!({ "parameters": parameters, "covariance": rows(&found.covariance), "outputs": outputs, "noise": found.noise,
                    "fit": found.held_out, "ceiling": found.ceiling, "condition": found.condition, "findings": findings, "sound": findings.is_empty(),
                    "model": model, "set": set })
        );
    } else {
        print_table(&found, &outputs, &findings);
        match &linear {
            Ok(_) => {
                aside!("the parameters are in {}, the linear model is in {}", set.display(), arguments.out.display())
            }
            Err(reason) => aside!("the parameters are in {}; there is no linear model: {reason}", set.display()),
        }
        page.iter().for_each(|page| aside!("the page is {}", page.display()));
    }
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(UNSOUND) })
}

/// Parameters, and start values of records.
fn sought(options: &ParameterOptions) -> Result<Vec<Sought>, Error> {
    let of = |option: &'static str, names: &Option<Names>, is_of_record: bool| {
        let names = names.iter().flat_map(|Names(names)| names.clone());
        let one = |given: String| {
            let refuse = || {
                let allowed = "must be NAME, or NAME=LOW:HIGH with two numbers, the smaller one first";
                Error::Argument(Invalid::new(option, &given, allowed))
            };
            let Some((name, range)) = given.split_once('=') else {
                return Ok(Sought { name: given, range: None, is_of_record });
            };
            let (low, high) = range.split_once(':').ok_or_else(refuse)?;
            let ends = low.trim().parse().ok().zip(high.trim().parse().ok());
            let is_range = |(low, high): &(f64, f64)| low.is_finite() && high.is_finite() && low < high;
            let (low, high) = ends.filter(is_range).ok_or_else(refuse)?;
            Ok(Sought { name: name.trim().to_owned(), range: Some([low, high]), is_of_record })
        };
        names.map(one).collect::<Result<Vec<_>, _>>()
    };
    let mut all = of("--free", &options.free, false)?;
    all.extend(of("--initial", &options.initial, true)?);
    if let Some(k) = (1..all.len()).find(|&k| all[..k].iter().any(|other| other.name == all[k].name)) {
        return Err(Error::Argument(Invalid::new("--free", &all[k].name, "is given twice")));
    }
    Ok(all)
}

fn held_out(given: &str) -> Result<f64, Error> {
    let allowed =
        "must be at least 0 and below 90 %, as 30% or 0.3: with --fmu the last part of each record is held out";
    let refuse = || Error::Argument(Invalid::new("--hold-out", given, allowed));
    part(given).ok().filter(|part| *part < super::MOST_HELD_OUT).ok_or_else(refuse)
}

/// A record as the FMU takes it.
fn recorded(arguments: &Arguments, fmu: &Fmu, read: &Read, outputs: &[String]) -> Result<Recorded, Error> {
    let record = &read.record;
    let column = |name: &String| {
        let missing = || {
            let known = record.columns.iter().map(|column| column.name.clone()).collect();
            Error::Unknown { what: "column", name: name.clone(), known, all: "" }
        };
        record.column(name).ok_or_else(missing)
    };
    let refuse = |reason: String| Error::Argument(Invalid::because(format!("{}: {reason}", record.name)));
    let measured = |name: &String| {
        let (column, variable) = (column(name)?, fmu.description.variable(name));
        variable.and_then(|own| conversion(column, own)).iter().for_each(|line| detail!("{}: {line}", record.name));
        variable.map_or_else(|| Ok(column.values.clone()), |own| values_of(column, own)).map_err(refuse)
    };
    let outputs = outputs.iter().map(measured).collect::<Result<_, _>>()?;
    let inputs = arguments.inputs().iter().map(column).collect::<Result<Vec<_>, Error>>()?;
    let is_sampled = matches!(arguments.hold, HoldOf::ZeroOrder);
    let inputs = Inputs::of_columns(&fmu.description, &record.time, &inputs, is_sampled).map_err(refuse)?;
    Ok(Recorded { name: record.name.clone(), inputs, outputs })
}

/// Findings that make the model unsound.
fn findings(found: &Found, outputs: &[String]) -> Vec<String> {
    let mut findings = Vec::new();
    for Estimated { name, value, error, is_at_end, scale, record, .. } in &found.parameters {
        if error.is_nan() && !is_at_end {
            findings.push(format!("{name} has no effect on these outputs: remove it from --free"));
        } else if *is_at_end {
            findings.push(format!("{name} = {} is at the end of its range: give a wider range", number(*value)));
        } else if record.is_none() && *error > (MOST_ERROR * value.abs()).max(LEAST_ERROR * scale) {
            // Where a record begins may be near 0, and the model does not depend on it.
            let part = 100.0 * error / value.abs();
            findings.push(format!(
                "{name}: {} % (1 σ): these records don't determine it. Remove it from --free, or record more motion",
                number(part.round())
            ));
        }
    }
    if found.condition > MOST_CONDITION {
        findings.push(format!(
            "parameters can't be distinguished (condition number {}): remove one of them from --free",
            number(found.condition)
        ));
    }
    for ((name, fit), ceiling) in outputs.iter().zip(&found.held_out).zip(&found.ceiling) {
        if *fit < LEAST_FIT * ceiling {
            findings.push(format!(
                "{name}: the model follows {} % of the held-out motion, noise leaves {} %: is a state missing, or another parameter?",
                number(fit.round()),
                number(ceiling.round())
            ));
        }
    }
    findings
}

/// The linear model with the estimated parameters, and how its entries depend on these.
struct Linear {
    linear: Linearisation,
    /// Entries of A, by rows, then of B.
    slopes: DMatrix<f64>,
    /// Uncertainty that the parameters seem to leave of an entry that doesn't depend on them.
    blur: f64,
    shared: Vec<usize>,
}

/// A linear model with the signals of the records only.
fn of_signals(linear: Linearisation, arguments: &Arguments) -> Linearisation {
    let places = |of: &[Quantity], names: &[String]| -> Vec<usize> {
        names.iter().filter_map(|name| of.iter().position(|quantity| quantity.name == *name)).collect()
    };
    let Names(outputs) = arguments.outputs.clone().unwrap_or(Names(Vec::new()));
    let (inputs, outputs) = (places(&linear.inputs, arguments.inputs()), places(&linear.outputs, &outputs));
    let some = |of: &[Quantity], places: &[usize]| places.iter().map(|&place| of[place].clone()).collect();
    Linearisation {
        b: linear.b.select_columns(&inputs),
        c: linear.c.select_rows(&outputs),
        d: linear.d.select_rows(&outputs).select_columns(&inputs),
        inputs: some(&linear.inputs, &inputs),
        outputs: some(&linear.outputs, &outputs),
        ..linear
    }
}

fn linear_model(fmu: &Arc<Fmu>, arguments: &Arguments, found: &Found) -> Result<Linear, Error> {
    let options = &arguments.parameters;
    let is_shared = |&k: &usize| found.parameters[k].record.is_none();
    let (shared, known): (Vec<_>, Vec<_>) =
        (0..found.parameters.len()).filter(is_shared).partition(|&k| found.parameters[k].error > 0.0);
    let of_record = |linear: Linearisation| of_signals(linear, arguments);
    let at = |moved: Option<(usize, f64)>| {
        let mut start = options.set.clone();
        for &k in shared.iter().chain(&known) {
            let Estimated { name, value, .. } = &found.parameters[k];
            let value = moved.filter(|(of, _)| *of == k).map_or(*value, |(_, to)| to);
            start.retain(|(known, _)| known != name);
            start.push((name.clone(), value.to_string()));
        }
        linearise(fmu, &OperatingPoint { start, ..OperatingPoint::default() }).map(of_record)
    };
    let linear = at(None)?;
    let entries =
        |of: &Linearisation| -> Vec<f64> { of.a.transpose().iter().chain(of.b.transpose().iter()).copied().collect() };
    let (least_step, blurred) = match linear.method {
        Method::Responses { difference, .. } => (LEAST_OF_RESPONSES, difference * linear.a.amax().max(linear.b.amax())),
        Method::Derivatives | Method::Differences { .. } => (LEAST_STEP, 0.0),
    };
    let mut slopes = DMatrix::zeros(entries(&linear).len(), shared.len());
    let mut blur: f64 = 0.0;
    for (column, &k) in shared.iter().enumerate() {
        let Estimated { name, value, error, .. } = &found.parameters[k];
        let step = (STEP * error).max(least_step * value.abs());
        // At a bound that the FMU declares, the difference is to one side.
        let (low, high) = fmu.description.variable(name).map_or((f64::NEG_INFINITY, f64::INFINITY), Variable::bounds);
        let ends = [(value - step).max(low), (value + step).min(high)];
        let width = ends[1] - ends[0];
        if width <= 0.0 {
            continue;
        }
        let [below, above] = ends.map(|end| at(Some((k, end))));
        let (below, above) = (entries(&below?), entries(&above?));
        let of_entry = |i: usize| (above[i] - below[i]) / width;
        slopes.column_mut(column).iter_mut().enumerate().for_each(|(i, slope)| *slope = of_entry(i));
        blur = blur.hypot(2.0 * blurred * error / width);
    }
    Ok(Linear { linear, slopes, blur, shared })
}

/// The linear model for a file, with the uncertainty of A and B from that of the parameters.
fn model(of: &Linear, arguments: &Arguments, records: &[Read], found: &Found, fmu: &Fmu) -> Model {
    let Linear { linear, slopes, blur, shared } = of;
    let parameters = found.covariance.select_rows(shared).select_columns(shared);
    let all = slopes * parameters * slopes.transpose();
    let (n, m) = linear.b.shape();
    let place = |entry: usize| match entry.checked_sub(n * n) {
        None => Free("A".to_owned(), entry / n + 1, entry % n + 1),
        Some(of_B) => Free("B".to_owned(), of_B / m + 1, of_B % m + 1),
    };
    let value = |entry: usize| match entry.checked_sub(n * n) {
        None => linear.a[(entry / n, entry % n)],
        Some(of_B) => linear.b[(of_B / m, of_B % m)],
    };
    let is_free = |&entry: &usize| all[(entry, entry)].sqrt() > blur.max(LEAST_SPREAD * value(entry).abs());
    let free: Vec<_> = (0..all.nrows()).filter(is_free).collect();
    let names = |of: &[Quantity]| of.iter().map(|quantity| quantity.name.clone()).collect();
    let units = |of: &[Quantity]| of.iter().map(|quantity| quantity.unit.clone().unwrap_or_default()).collect();
    let (x, u, y) = (units(&linear.states), units(&linear.inputs), units(&linear.outputs));
    let shows_states = linear.c.rank(1e-9) == n;
    let step = |read: &Read| read.record.time.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let has_D = linear.d.iter().any(|entry| *entry != 0.0);
    Model {
        A: rows(&linear.a),
        B: rows(&linear.b),
        C: rows(&linear.c),
        D: has_D.then(|| rows(&linear.d)),
        states: names(&linear.states),
        inputs: names(&linear.inputs),
        outputs: names(&linear.outputs),
        units: Some(Units { x, u, y }),
        sample_time: records.iter().map(step).fold(f64::INFINITY, f64::min),
        offset: vec![vec![0.0; n]; records.len()],
        covariance: rows(&all.select_rows(&free).select_columns(&free)),
        kappa: vec![1.0; free.len()],
        free: free.into_iter().map(place).collect(),
        noise: found.noise.clone(),
        level: arguments.level,
        fit: Fits { held_out: found.held_out.clone(), windows: Vec::new() },
        records: records.iter().map(record_of).collect(),
        method: format!("parameters of {}{}", fmu.description.name, if shows_states { "" } else { ", outputs only" }),
        ..Model::default()
    }
}

fn record_of(read: &Read) -> RecordOf {
    let Read { record, checksum } = read;
    let (from, to) = (record.time[0], record.time[record.time.len() - 1]);
    RecordOf { file: record.name.clone(), sha256: Some(checksum.clone()), rows: record.time.len(), from, to }
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

fn write(arguments: &Arguments, found: &Found, model: Option<&Model>, fmu: &Fmu) -> Result<(), Error> {
    let file = &arguments.out;
    let shared = found.parameters.iter().filter(|parameter| parameter.record.is_none());
    let values: Vec<_> = shared.map(|parameter| (parameter.name.as_str(), parameter.value)).collect();
    let records = counted(arguments.records.len(), "file");
    let remark = format!("Parameters of {} from {records} of records", fmu.description.name);
    let set = parameter_set("identified", &remark, &values).map_err(Error::file(file))?;
    let model = model.map(text_of).transpose()?;
    let own = PathBuf::from(name_of(file)?);
    let mut texts = vec![(own.with_extension("ssv"), set.as_str(), arguments.force)];
    texts.extend(model.iter().map(|model| (own.clone(), model.as_str(), arguments.force)));
    place(file, &texts)
}

fn as_json(Estimated { name, unit, record, value, error, .. }: &Estimated) -> serde_json::Value {
    json!({ "name": name, "unit": unit, "record": record.map(|record| record + 1), "value": value, "error": error })
}

fn print_table(found: &Found, outputs: &[String], findings: &[String]) {
    print_line!("{:28} {:>14} {:>14} unit", "parameter", "value", "std. error");
    for Estimated { name, unit, record, value, error, .. } in &found.parameters {
        let name = record.map_or(name.clone(), |record| format!("{name} in record {}", record + 1));
        print_line!("{}", format!("{name:28} {:>14} {:>14} {unit}", number(*value), number(*error)).trim_end());
    }
    print_line!("\n{:28} {:>14} {:>14}", "fit of the held-out part", "%", "noise");
    for (k, (name, noise)) in outputs.iter().zip(&found.noise).enumerate() {
        let fit = found.held_out.get(k).filter(|fit| !fit.is_nan());
        let fit = fit.map_or("–".to_owned(), |fit| number((fit * 10.0).round() / 10.0));
        print_line!("{name:28} {fit:>14} {:>14}", number(*noise));
    }
    if !findings.is_empty() {
        print_line!();
    }
    findings.iter().for_each(|finding| print_line!("not sound: {finding}"));
}
