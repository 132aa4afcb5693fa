//! `check`: what a designer should know of a description before exporting it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adaptive_fmu::designs::{Cases, Followed, Steps, WorstCase, report_page, steps};
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::{self, Library, Source};
use adaptive_fmu::model::Description;
use adaptive_fmu::nominal::WorstPlant;
use adaptive_fmu::output;
use adaptive_fmu::report::{DesignReport, Finding, Verdict, number};
use adaptive_fmu::system::NO_LIMIT;
use adaptive_fmu::template::three_digits;
use adaptive_fmu::tuning::parameter_set;
use serde_json::json;

use super::number::positive;
use super::workers;

/// Widths of the columns of names, and of values that have a note in the same line.
const NAME: usize = 34;
const VALUE: usize = 30;
/// An output that ends farther from its reference, in parts of it, is worth a word.
const FAR: f64 = 0.01;
/// And one that ends even farther is worth a warning.
const MOST_OFF: f64 = 0.05;

#[derive(clap::Args)]
pub struct Arguments {
    /// Description file (NAME.toml), FMU that this program exported (NAME.fmu), or FMU of this package
    name: String,
    /// Shared library that contains the model [default: the one built with this program]
    #[arg(long)]
    library: Option<PathBuf>,
    /// Number of plants within the uncertainty of the nominal one to try [default: 200, half of them at corners]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    plants: Option<u32>,
    /// Seed of the random ones among them, and of --worst-case [default: 1]
    #[arg(long)]
    seed: Option<u32>,
    /// Search so long for the worst plant within the uncertainty, with runs of the FMUs, s
    ///
    /// A particle swarm looks for the largest integral of the squared error of a step of the reference.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    worst_case: Option<f64>,
    /// Write the plant with the longest settling time, or that of --worst-case, as a parameter set (.ssv)
    ///
    /// Its parameters are the elements of plant.A and plant.B, as for `run LOOP --case FILE.ssv`.
    #[arg(long, value_name = "FILE.ssv")]
    worst: Option<PathBuf>,
    /// Write the report as a page with pictures
    #[arg(long, value_name = "FILE.html")]
    page: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Carry out the runs of one plant of --worst-case, as JSON
    #[arg(long, hide = true)]
    job: Option<String>,
}

/// Prints the report; the exit code shows whether the design is sound.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { name, library, json, .. } = arguments;
    let library = library.as_deref().map_or_else(Library::beside_program, Library::open)?;
    let source = exporter::find_description(name)?;
    let drawn = [("plants", arguments.plants), ("seed", arguments.seed)];
    let source = source.with_nominal(drawn.into_iter().filter_map(|(key, value)| Some((key, i64::from(value?)))))?;
    if let Some(text) = &arguments.job {
        workers::reply(&Cases::new(&source, &*super::ready::units()?)?.squared_error(&workers::job::<Vec<f64>>(text)?));
        return Ok(ExitCode::SUCCESS);
    }
    let (mut unit, _) = exporter::describe(&source, &library)?;
    // Units of another library aren't known here.
    if arguments.library.is_none() {
        run_loop(&source, &mut unit.report);
    }
    let found = search(arguments, &source)?;
    if let Some(file) = &arguments.worst {
        write_worst(file, &unit.report, found.as_ref(), &source)?;
    }
    if let Some(file) = &arguments.page {
        output::write(file, report_page(&unit.name, &unit.report))?;
    }
    if *json {
        let DesignReport { step, findings, worst, pictures, .. } = &unit.report;
        let (verdict, sound) = (unit.report.verdict(), unit.report.is_sound());
        let report = json!({ "name": unit.name, "verdict": verdict, "sound": sound, "step": step, "findings": findings,
                    "summary": unit.report.summary, "worst": worst, "pictures": pictures,
                    "worst_case": found.as_ref().map(case_as_json), "text": told(&unit.name, &unit.report) });
        say!("{report}");
    } else {
        say!("{}", told(&unit.name, &unit.report));
        if let Some(found) = &found {
            say!("\n{}", case_lines(found).join("\n"));
        }
    }
    Ok(exit_code(&unit.report))
}

/// Adds results of the FMUs' loop that the report lacks: for kinds whose loop isn't linear, and where limits act.
fn run_loop(source: &Source, report: &mut DesignReport) {
    let is_beyond = |finding: &Finding| finding.name.starts_with("range of ") && finding.verdict == Verdict::Warning;
    let acts = report.findings.iter().any(is_beyond);
    let has_plant = Description::read(&source.text).is_ok_and(|description| description.nominal.is_some());
    if !has_plant || report.summary.is_some() && !acts {
        return;
    }
    // The nominal verdict of a kind whose loop isn't linear is this one.
    let if_wrong = if report.summary.is_some() { Verdict::Warning } else { Verdict::NotSound };
    let ran = super::ready::units().and_then(|units| steps(source, &units));
    report.section("Loop of the FMUs");
    match ran {
        Ok(Some(steps)) => tell_steps(&steps, if_wrong, report),
        // Names of its own, by which nothing is connected.
        Err(Error::Loop { .. }) => {}
        Ok(None) if report.summary.is_some() => {}
        Ok(None) => {
            let note = "it takes too long for `check`. Use `new loop` and `run`";
            report.tell("nominal loop", "not run", "", note);
        }
        Err(reason) => {
            let note = format!("simulated with its limits and its communication step: {reason}");
            report.judge("nominal loop", "fails", "", if_wrong, note);
        }
    }
}

fn tell_steps(steps: &Steps, if_wrong: Verdict, report: &mut DesignReport) {
    let Steps { followed: Followed { settling, overshoot, off, peaks }, controls, duration, .. } = steps;
    let at_limit: Vec<_> = controls.iter().zip(peaks).filter(|((_, limit), peak)| **peak >= 0.999 * limit).collect();
    let limited = at_limit.iter().map(|((name, _), _)| name.as_str()).collect::<Vec<_>>().join(", ");
    match settling {
        Some(time) => {
            let note = "to 2 % of a step of the reference, with the nominal plant, the limits of the control and the communication step";
            report.tell("settling time", three_digits(*time), "s", note);
        }
        // A control at its limit makes a loop slow; without that, it isn't stable or has no rest.
        None if !limited.is_empty() => {
            let note = format!(
                "within {} s, with {limited} at a limit: use a smaller --reference or a lower --bandwidth",
                digits(*duration)
            );
            report.judge("settling time", "does not settle", "", Verdict::Warning, note);
        }
        None => {
            let note = format!(
                "within {} s with the nominal plant: use another --bandwidth or another kind",
                digits(*duration)
            );
            report.judge("settling time", "does not settle", "", if_wrong, note);
        }
    }
    report.tell("overshoot", three_digits(100.0 * overshoot), "%", "beyond the reference");
    let rest = three_digits(100.0 * off);
    match limited.as_str() {
        _ if *off <= MOST_OFF => report.tell("at rest", rest, "%", "distance from the reference"),
        "" => report.judge("at rest", rest, "%", Verdict::Warning, "distance from the reference: steady-state error"),
        limited => {
            let note = format!("distance from the reference, with {limited} at a limit: use a smaller --reference");
            report.judge("at rest", rest, "%", Verdict::Warning, note);
        }
    }
    let peak = |((name, limit), peak): (&(String, f64), &f64)| {
        let of = if *limit < NO_LIMIT { format!(" of {}", digits(*limit)) } else { String::new() };
        format!("peak of {name} {}{of}", digits(*peak))
    };
    let words = controls.iter().zip(peaks).map(peak).collect::<Vec<_>>().join(", ");
    controls.iter().zip(peaks).for_each(|((name, _), peak)| {
        report.tell(&format!("peak of {name}"), three_digits(*peak), "", "largest size");
    });
    summarise(steps, &words, report);
}

/// The first line: what the loop does, and that other plants weren't tried where there are any.
fn summarise(steps: &Steps, peaks: &str, report: &mut DesignReport) {
    let Followed { settling, overshoot, off, .. } = &steps.followed;
    let settles = settling.map_or("does not settle".to_owned(), |time| format!("settles in {} s", digits(time)));
    let rests = if *off > FAR { format!(", ends {} % from the reference", digits(100.0 * off)) } else { String::new() };
    let words = format!("{settles}, overshoot {} %{rests}", digits(100.0 * overshoot));
    let summary = match report.summary.take() {
        Some(summary) => format!("{summary}; with the limits of the control: {words}"),
        None if steps.has_others => {
            let note = "only the nominal plant was simulated; --worst-case SECONDS simulates others";
            report.tell("uncertain plants", "not tried", "", note);
            format!("{words}, {peaks}; other plants not tried")
        }
        None => format!("{words}, {peaks}"),
    };
    report.summarise(summary);
}

/// The worst plant, where it is searched for.
fn search(arguments: &Arguments, source: &Source) -> Result<Option<WorstCase>, Error> {
    let seed = arguments.seed.map_or(1, u64::from);
    let found = |seconds| Cases::new(source, &*super::ready::units()?)?.worst(seconds, seed);
    arguments.worst_case.map(found).transpose()
}

/// Writes the worst plant as a parameter set.
fn write_worst(file: &Path, report: &DesignReport, found: Option<&WorstCase>, source: &Source) -> Result<(), Error> {
    let plant = found.map(|found| &found.plant).or(report.worst.first());
    let refuse = || Error::Description {
        file: source.file.clone(),
        reason: "--worst needs a plant in [nominal] with its uncertainty, and a loop that is stable with all plants"
            .to_owned(),
    };
    let plant = plant.ok_or_else(refuse)?;
    let values: Vec<_> = entries(plant).collect();
    let values: Vec<_> = values.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let remark = format!("Worst plant of {}: {}", source.file.display(), plant.respects.join(", "));
    let text = parameter_set("worst", &remark, &values).map_err(Error::file(file))?;
    output::write(file, text)
}

/// The entries of a plant, by their names in a loop.
fn entries(plant: &WorstPlant) -> impl Iterator<Item = (String, f64)> {
    [("A", &plant.A), ("B", &plant.B)].into_iter().flat_map(|(name, rows)| {
        rows.iter().enumerate().flat_map(move |(i, row)| {
            row.iter().enumerate().map(move |(j, value)| (format!("plant.{name}[{},{}]", i + 1, j + 1), *value))
        })
    })
}

fn case_lines(WorstCase { plant, followed, tried }: &WorstCase) -> Vec<String> {
    let had = match followed {
        Ok(Followed { settling, overshoot, peaks, .. }) => {
            let settles =
                settling.map_or("does not settle".to_owned(), |time| format!("settles in {} s", digits(time)));
            let peaks = peaks.iter().copied().map(digits).collect::<Vec<_>>().join(", ");
            format!("{settles}, overshoot {} %, peak of the control {peaks}", digits(100.0 * overshoot))
        }
        Err(reason) => format!("its loop fails: {reason}"),
    };
    let rows = |name: &str, rows: &[Vec<f64>]| {
        let row = |row: &Vec<f64>| row.iter().copied().map(number).collect::<Vec<_>>().join(", ");
        format!("  {name:3} {}", rows.iter().map(row).collect::<Vec<_>>().join("\n      "))
    };
    vec![format!("Worst case of {tried} plants: {had}"), rows("A", &plant.A), rows("B", &plant.B)]
}

fn case_as_json(WorstCase { plant, followed, tried }: &WorstCase) -> serde_json::Value {
    let had = followed.as_ref().ok();
    json!({
        "tried": tried, "A": plant.A, "B": plant.B, "failure": followed.as_ref().err(),
        "settling_time": had.and_then(|had| had.settling), "overshoot": had.map(|had| had.overshoot),
        "peaks": had.map(|had| &had.peaks),
    })
}

fn digits(value: f64) -> String {
    number(three_digits(value))
}

/// 0 of a sound design, with warnings too; 3 of one that isn't.
pub fn exit_code(report: &DesignReport) -> ExitCode {
    if report.is_sound() { ExitCode::SUCCESS } else { ExitCode::from(3) }
}

/// The report in lines.
fn told(name: &str, report: &DesignReport) -> String {
    if report.findings.is_empty() {
        return format!("{name}: all values are within their limits; there is nothing else to check");
    }
    let reason = report.reason().map_or(String::new(), |reason| format!(": {reason}"));
    // What was tried with a plant is sound, where else nothing speaks against it.
    let verdict = match report.verdict() {
        Verdict::Ok if report.summary.is_some() => "sound",
        verdict => verdict.text(),
    };
    let summary = report.summary.as_ref().map_or(String::new(), |summary| format!(": {summary}"));
    let mut lines = vec![format!("{name}: {verdict}{summary}{reason}")];
    let mut section = None;
    for finding in &report.findings {
        if section != Some(&finding.section) {
            lines.push(format!("\n{}", finding.section));
            section = Some(&finding.section);
        }
        lines.extend(finding_lines(finding));
    }
    lines.join("\n")
}

fn finding_lines(Finding { name, value, unit, verdict, note, .. }: &Finding) -> Vec<String> {
    let lines = value.lines();
    let line = |(k, line): (usize, &String)| {
        let name = if k == 0 { name.as_str() } else { "" };
        let value = format!("{line} {unit}");
        let beside = if k == 0 && *verdict == Verdict::Ok { note.as_str() } else { "" };
        format!("  {name:NAME$} {value:VALUE$} {beside}").trim_end().to_owned()
    };
    let mut told: Vec<_> = lines.iter().enumerate().map(line).collect();
    if *verdict != Verdict::Ok {
        told.push(format!("    {}: {note}", verdict.text()));
    }
    told
}
