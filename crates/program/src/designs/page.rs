//! The page of a comparison of candidates: a table, and steps of each with the nominal plant and with the worst ones.

use std::fmt::Write;

use super::candidate::{Candidate, Design, Judged, Ran, Task};
use super::rank::shortfall;
use super::series::{Course, Followed};
use crate::drawing::escaped;
use crate::drawing::{CHARTS, KEY, push_pictures};
use crate::exporter::push_report;
use crate::figures::{still, still_ending};
use crate::picture::{Curve, CurveOf, Picture};
use crate::report::{DesignReport, number};
use crate::system::NO_LIMIT;
use crate::template::{one_or_each, three_digits};

/// Additional style of this page.
const STYLE: &str = "
  figure { margin: 0.5em 0 1em; }
  .first { font-weight: bold; }
";
/// Points of a curve.
const POINTS: usize = 400;

/// The page of a design report.
pub fn report_page(name: &str, report: &DesignReport) -> String {
    let style = format!("{CHARTS}{STYLE}  .report td {{ white-space: pre-line; }}\n");
    let mut page = still(name, "", &style);
    push_report(&mut page, report);
    page.push_str(&still_ending());
    page
}

/// The page of candidates in an order, for a plant of a name.
pub fn page(task: &Task, candidates: &[Candidate], order: &[usize], plant: &str) -> String {
    let asked = match (task.bandwidth, task.settling_time) {
        (Some(bandwidth), _) => format!("a bandwidth of {} rad/s", number(bandwidth)),
        (None, Some(time)) => format!("a settling time of {} s", number(time)),
        (None, None) => "a bandwidth that follows from the plant".to_owned(),
    };
    let uncertainty = task.uncertainty.map_or_else(
        || "the uncertainty of the plant identified from records".to_owned(),
        |part| format!("{} % uncertainty of each number of A and B", number(three_digits(100.0 * part))),
    );
    let about =
        format!("Asked for: {asked}, a step of the reference to {}, {uncertainty}.", one_or_each(&task.references));
    let mut page = still(&format!("Controllers for {plant}"), &about, &format!("{CHARTS}{STYLE}"));
    push_table(&mut page, task, candidates, order);
    page.push_str(KEY);
    for &place in order {
        let Candidate { kind, outcome } = &candidates[place];
        let Ok(design) = outcome else { continue };
        let _ = writeln!(page, "<h2>{}</h2>", escaped(&kind.name));
        if let Some(what) = shortfall(task, design).filter(|_| design.verdict() == Judged::Sound) {
            let _ = writeln!(page, "<p>{}{}.</p>", what[..1].to_uppercase(), escaped(&what[1..]));
        }
        if let Some(reason) = design.reason() {
            let verdict = design.verdict().words().replacen('n', "N", 1);
            let _ = writeln!(page, "<p class=\"bad\">{verdict}: {}.</p>", escaped(reason.trim_end_matches('.')));
        }
        for note in &design.notes {
            let _ = writeln!(page, "<p>{}</p>", escaped(note));
        }
        push_pictures(&mut page, &steps(task, design));
    }
    page.push_str(&still_ending());
    page
}

fn push_table(page: &mut String, task: &Task, candidates: &[Candidate], order: &[usize]) {
    page.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>controller<th>verdict<th>settling time<th>of the worst plant\
         <th>overshoot<th>of the worst plant<th>peak of the control<th>noise of the control<th>margins<th>operations a step\n",
    );
    for (turn, &place) in order.iter().enumerate() {
        let Candidate { kind, outcome } = &candidates[place];
        let first = if turn == 0 { " class=\"first\"" } else { "" };
        let _ = match outcome {
            Ok(design) => {
                let verdict = design.verdict().words();
                let cells = figures(task, design).map(|text| format!("<td>{}", escaped(&text))).concat();
                writeln!(page, "<tr{first}><td>{}<td>{verdict}{cells}", escaped(&kind.name))
            }
            Err(reason) => writeln!(page, "<tr><td>{}<td colspan=\"9\">{}", escaped(&kind.name), escaped(reason)),
        };
    }
    page.push_str(
        "</table></div>\n<p>All figures are of runs of the FMUs with their communication step and limits.</p>\n",
    );
}

/// The figures of a candidate in words: settling time and overshoot with the nominal and with the worst plant, peaks
/// and noise of the controls, margins, operations.
/// controls, margins, operations.
pub fn figures(task: &Task, design: &Design) -> [String; 8] {
    let rounded = |value: f64| number(three_digits(value));
    let (nominal, worst) = (design.followed().cloned(), design.worst());
    let none = || "–".to_owned();
    let time = |followed: &Option<Followed>| {
        let settling = followed.as_ref().and_then(|followed| followed.settling);
        settling.map_or_else(none, |time| format!("{} s", rounded(time)))
    };
    let overshoot = |followed: &Option<Followed>| {
        let percent = |followed: &Followed| number((1000.0 * followed.overshoot).round() / 10.0);
        followed.as_ref().map_or_else(none, |followed| format!("{} %", percent(followed)))
    };
    let limits = task.plant.limits.as_ref();
    let limit = |j: usize| limits.map(|[min, max]| max[j].max(-min[j])).filter(|limit| *limit < NO_LIMIT);
    let peak = |(j, peak): (usize, &f64)| {
        limit(j).map_or_else(|| rounded(*peak), |limit| format!("{} of {}", rounded(*peak), rounded(limit)))
    };
    let list = |all: &Vec<f64>| all.iter().copied().map(rounded).collect::<Vec<_>>().join(", ");
    let peaks = |followed: &Followed| followed.peaks.iter().enumerate().map(peak).collect::<Vec<_>>().join(", ");
    [
        time(&nominal),
        time(&worst),
        overshoot(&nominal),
        overshoot(&worst),
        worst.as_ref().map_or_else(none, peaks),
        design.noise.as_ref().map_or_else(String::new, list),
        design.margins(),
        design.operations.to_string(),
    ]
}

/// Outputs and controls of the step of the first reference.
fn steps(task: &Task, design: &Design) -> [Picture; 2] {
    let worst = design.corners.iter().map(|(_, ran)| (ran, CurveOf::Worst));
    let runs: Vec<_> = worst.chain([(&design.nominal, CurveOf::Nominal)]).collect();
    let last = |ran: &Ran| ran.as_ref().ok().and_then(|(_, course)| course.times.last().copied());
    let end = runs.iter().filter_map(|(ran, _)| last(ran)).fold(0.0, f64::max);
    let (_, m, p) = task.plant.sizes();
    let name = |names: &[String], symbol: &str, i: usize| {
        names.get(i).cloned().unwrap_or_else(|| format!("{symbol}[{}]", i + 1))
    };
    let curves = |count: usize, names: &[String], symbol: &str, of_course: fn(&Course) -> &[Vec<f64>]| {
        let each = runs.iter().flat_map(|(ran, of)| {
            let course = ran.as_ref().ok().map(|(_, course)| course);
            course.into_iter().flat_map(move |course| {
                of_course(course).iter().enumerate().map(move |(i, values)| (i, *of, thinned(&course.times, values)))
            })
        });
        let named = each.filter(|(i, ..)| *i < count);
        named.map(|(i, of, points)| Curve { name: name(names, symbol, i), of, points }).collect::<Vec<_>>()
    };
    let level = |name: &str, value: f64| Curve {
        name: name.to_owned(),
        of: CurveOf::Bound,
        points: vec![[0.0, value], [end, value]],
    };
    let mut outputs = curves(p, &task.plant.y.names, "y", |course| &course.outputs);
    outputs.push(level("reference", task.references[0]));
    let mut controls = curves(m, &task.plant.u.names, "u", |course| &course.controls);
    let limits = task.plant.limits.iter().flatten().flatten();
    controls.extend(limits.filter(|limit| limit.abs() < NO_LIMIT).map(|&limit| level("limit", limit)));
    let reference = if p > 1 {
        format!("the reference of {}", name(&task.plant.y.names, "y", 0))
    } else {
        "the reference".to_owned()
    };
    let picture = |title: String, y: &str, curves| {
        let (x, y) = ("time in s".to_owned(), y.to_owned());
        Picture { title, x, y, logarithmic: false, curves }
    };
    [picture(format!("Step of {reference}"), "outputs", outputs), picture("Controls".to_owned(), "controls", controls)]
}

/// A signal at fewer times: the lowest and the highest value of each stretch.
fn thinned(times: &[f64], values: &[f64]) -> Vec<[f64; 2]> {
    let stretch = values.len().div_ceil(POINTS / 2).max(1);
    let short = |value: f64| format!("{:.*e}", 5, value).parse().unwrap_or(value);
    let of = |(k, part): (usize, &[f64])| {
        let first = k * stretch;
        let order = |one: &usize, other: &usize| part[*one].total_cmp(&part[*other]);
        let (low, high) = ((0..part.len()).min_by(order).unwrap_or(0), (0..part.len()).max_by(order).unwrap_or(0));
        let mut both = vec![low.min(high), low.max(high)];
        both.dedup();
        both.into_iter().map(move |at| [short(times[first + at]), short(part[at])]).collect::<Vec<_>>()
    };
    values.chunks(stretch).enumerate().flat_map(of).collect()
}
