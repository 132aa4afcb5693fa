//! The page: advice, strengths and weaknesses of each controller, and a table and a picture of every plant. It loads
//! nothing and needs no script.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::advice::{Measured, advice};
use super::condition::Condition;
use super::laws::{Law, laws, of_plant};
use super::margins::{Bound, Margin};
use super::panels::panels;
use super::quantity::under;
use super::record::Record;
use super::standing::{Rank, standings};
use super::study::{Budget, Plant, Study};
use crate::drawing::escaped;
use crate::figures::{still, still_ending};
use crate::results::four_digits;

const OWN_STYLE: &str = "
  h2 { font-size: 1.3em; margin-top: 2.5em; border-top: 2px solid #1b1b1b; padding-top: 0.6em; }
  h3 { font-size: 1em; margin: 1.2em 0 0.3em; }
  td small { color: #555; display: block; }
  td, th { padding-right: 0.9em; }
  .good { color: #006b3c; }
  .panels { display: block; width: 100%; max-width: 70em; height: auto; margin: 1em 0; }
  .panels text { font-size: 12px; fill: #333; }
  .panels .title { font-weight: bold; }
  .panels .frame { fill: none; stroke: #aaa; }
  .panels .interval { stroke: #0072b2; stroke-width: 2.5; stroke-opacity: 0.45; }
  .panels .mark { fill: #0072b2; }
  .panels .open { fill: #fff; stroke: #0072b2; stroke-width: 2; }
  .panels .none { fill: #b00020; }
  .tree { max-width: 70em; padding-left: 1.2em; border-left: 2px solid #ccc; list-style: none; }
  .tree li { margin: 0.7em 0; }
  .tree small { color: #555; display: block; }
  dt { font-weight: bold; margin-top: 0.6em; }
  @media print { h2 { break-before: page; } }
";

/// A league, as far as it is computed.
#[derive(Debug)]
pub struct Page<'a> {
    /// The study.
    pub study: &'a Study,
    /// The results.
    pub records: &'a [Record],
}

impl Page<'_> {
    /// The page.
    ///
    /// # Errors
    /// If the study's advice names what the league doesn't have.
    pub fn html(&self) -> Result<String, String> {
        let Study { title, about, .. } = self.study;
        let mut page = still(title, about, OWN_STYLE);
        let pairs = self.study.plant.iter().map(|plant| plant.controller.len()).sum::<usize>();
        let known = self.records.iter().filter(|record| record.next().is_none()).count();
        if known < pairs {
            let _ = writeln!(page, "<p class=\"bad\">{known} of {pairs} pairs were computed.</p>");
        }
        push_advice(&mut page, &advice(self.study, self.records)?);
        push_laws(&mut page, &laws(self.study, self.records));
        for plant in &self.study.plant {
            let records = of_plant(self.study, self.records, &plant.name);
            if !records.is_empty() {
                push_plant(&mut page, plant, &records);
            }
        }
        push_method(&mut page, &self.study.budget, self.records);
        page.push_str(&still_ending());
        Ok(page)
    }
}

fn push_advice(page: &mut String, lines: &[Measured]) {
    if lines.is_empty() {
        return;
    }
    page.push_str(
        "<h2 id=\"advice\">Which controller to choose</h2>\n<p>Follow the first branch that applies, then its \
         sub-branches.</p>\n",
    );
    push_branches(page, lines);
}

fn push_branches(page: &mut String, lines: &[Measured]) {
    page.push_str("<ul class=\"tree\">\n");
    for Measured { when, take, because, holds, within } in lines {
        let word = match holds {
            Some(true) => " <span class=\"good\">Confirmed.</span>",
            Some(false) => " <span class=\"bad\">Not confirmed.</span>",
            None => " Not known.",
        };
        let [when, take, because] = [when, take, because].map(|text| escaped(text));
        let _ = match take.as_ref() {
            "" => writeln!(page, "<li>{when}:"),
            _ => writeln!(page, "<li>{when}: <b>{take}</b><small>{because}.{word}</small>"),
        };
        if !within.is_empty() {
            push_branches(page, within);
        }
    }
    page.push_str("</ul>\n");
}

fn push_laws(page: &mut String, laws: &[Law]) {
    page.push_str("<h2 id=\"laws\">Strengths and weaknesses of each controller</h2>\n<dl>\n");
    for Law { name, sentences } in laws {
        let _ = writeln!(page, "<dt>{}<dd>{}", escaped(name), escaped(&sentences.join(" ")));
    }
    page.push_str("</dl>\n");
}

fn push_plant(page: &mut String, plant: &Plant, records: &[&Record]) {
    let (name, title) = (escaped(&plant.name), escaped(&plant.title));
    let _ = writeln!(page, "<h2 id=\"{name}\">{title}</h2>");
    if let Some(about) = &plant.about {
        let _ = writeln!(page, "<p>{}</p>", escaped(about));
    }
    page.push_str(&panels(plant, records));
    page.push_str("<h3>Random plants, bench and margins</h3>\n");
    push_results(page, plant, records);
    page.push_str("<h3>Errors under each condition</h3>\n");
    push_conditions(page, plant, records);
    page.push_str("<h3>Tuned gains</h3>\n<dl>\n");
    for record in records {
        let Some(gains) = &record.gains else { continue };
        let text = if gains.values.is_empty() { "none to tune".to_owned() } else { gains.to_text() };
        let (before, after) = (four_digits(gains.before), four_digits(gains.after));
        let text = escaped(&format!("{text} (cost {before} before, {after} after {} runs)", gains.runs));
        let computed = record.computed.as_ref().map_or(String::new(), |day| format!(" on {}", escaped(day)));
        let computed = format!("<small>computed by version {}{computed}</small>", escaped(&record.version));
        let _ = writeln!(page, "<dt>{}<dd>{text} {computed}", escaped(&record.controller));
    }
    page.push_str("</dl>\n");
}

/// Random plants, effort and margins.
fn push_results(page: &mut String, plant: &Plant, records: &[&Record]) {
    page.push_str(
        "<div class=\"scroll\"><table class=\"results\">\n<tr><th>controller<th>random plants that fail<th>median error\
         <th class=\"number\">effort<th class=\"number\">variation<th class=\"number\">dead time<th class=\"number\">lag\
         <th class=\"number\">gain<th class=\"number\">gain divided<th class=\"number\">step, Jacobi\
         <th class=\"number\">instructions\n",
    );
    for (record, standing) in records.iter().zip(standings(records)) {
        let form = if record.as_one { "" } else { "<small>as separate FMUs</small>" };
        let _ = write!(page, "<tr><td>{}{form}", escaped(&record.controller));
        match &record.spread {
            Some(spread) => {
                let (rate, [low, high]) = spread.rate();
                let text = format!("{:.0} % <small>{:.0} … {:.0} %</small>", 100.0 * rate, 100.0 * low, 100.0 * high);
                let _ = write!(page, "<td>{text}{}", place(standing.failures));
                let (median, [low, high]) = spread.median();
                let end = |end: Option<f64>| end.map_or("fails".to_owned(), four_digits);
                let text = format!("{} <small>{} … {}</small>", end(median), end(low), end(high));
                let _ = write!(page, "<td>{text}{}", place(standing.error));
            }
            None => page.push_str("<td>–<td>–"),
        }
        match under(record, Condition::Bench) {
            Some(outcome) => {
                let (effort, moved) = (outcome.commanded(plant), outcome.moved(plant));
                let _ = write!(
                    page,
                    "<td class=\"number\">{}<td class=\"number\">{}",
                    four_digits(effort),
                    four_digits(moved)
                );
            }
            None => page.push_str("<td>–<td>–"),
        }
        match &record.margins {
            Some(margins) => {
                let times = [margins.dead_time, margins.lag].map(|margin| time(&margin));
                let gains = [margins.gain, margins.divided].map(|margin| margin_text(&margin, 1.0, ""));
                for text in times.into_iter().chain(gains).chain([time(&margins.step)]) {
                    let _ = write!(page, "<td class=\"number\">{text}");
                }
            }
            None => page.push_str(&"<td>–".repeat(5)),
        }
        let counted = record.instructions.map_or("–".to_owned(), |count| format!("{count:.0}"));
        let _ = writeln!(page, "<td class=\"number\">{counted}");
    }
    page.push_str(
        "</table></div>\n<p>Effort is the root mean square of the commands on the bench, relative to the largest \
         control. Variation is the total movement of the commands there, in largest controls per second. Instructions \
         are counted per step of the controller as compiled C, over the first thousand steps. A dash means: not \
         computed, or failed on the bench.</p>\n",
    );
}

fn place(rank: Option<Rank>) -> String {
    rank.map_or(String::new(), |Rank { place, shared }| {
        format!("<small>place {place}{}</small>", if shared { ", shared" } else { "" })
    })
}

fn time(margin: &Margin) -> String {
    margin_text(margin, 1e3, " ms")
}

fn margin_text(margin: &Margin, scale: f64, unit: &str) -> String {
    let value = scale * margin.value;
    let value = if value >= 10.0 { format!("{value:.0}") } else { format!("{value:.2}") };
    match margin.bound {
        Bound::Within => format!("{value}{unit}"),
        Bound::AtLeast => format!("≥ {value}{unit}"),
        Bound::Below => format!("&lt; {value}{unit}"),
    }
}

/// The errors under each condition.
fn push_conditions(page: &mut String, plant: &Plant, records: &[&Record]) {
    page.push_str("<div class=\"scroll\"><table class=\"conditions\">\n<tr><th>error");
    let of_plant = Condition::of(plant);
    of_plant.iter().for_each(|condition| _ = write!(page, "<th class=\"number\">{}", condition.title()));
    page.push('\n');
    for record in records {
        let Some(conditions) = &record.conditions else { continue };
        let _ = write!(page, "<tr><td>{}", escaped(&record.controller));
        for condition in &of_plant {
            let Some(judged) = conditions.get(condition) else {
                page.push_str("<td>–");
                continue;
            };
            match &judged.outcome.failure {
                None => _ = write!(page, "<td class=\"number\">{}", four_digits(judged.outcome.error(plant))),
                Some(failure) => {
                    let (at, reason) = (four_digits(failure.at), escaped(&failure.reason));
                    let _ = write!(page, "<td class=\"number bad\" title=\"{reason}\">fails at {at} s");
                }
            }
        }
        page.push('\n');
    }
    page.push_str("</table></div>\n");
    let limits: Vec<_> = plant
        .errors
        .iter()
        .zip(&plant.error_limits)
        .map(|([of, minus], limit)| format!("|{of} − {minus}| ≤ {limit}"))
        .collect();
    let _ = writeln!(
        page,
        "<p>Errors are root mean squares from {} s on, relative to the largest error that is not a failure: {}.</p>",
        plant.settled,
        escaped(&limits.join(", "))
    );
}

/// Number of runs that failed at first, but not when they were repeated.
fn mended(records: &[Record]) -> usize {
    let conditions = records.iter().flat_map(|record| record.conditions.iter().flatten());
    let of_conditions = conditions.filter(|(_, judged)| judged.mended).count();
    of_conditions
        + records.iter().filter_map(|record| record.spread.as_ref()).map(|spread| spread.mended).sum::<usize>()
}

/// Versions that computed the results.
fn versions(records: &[Record]) -> String {
    let all: BTreeSet<&str> = records.iter().map(|record| record.version.as_str()).collect();
    all.into_iter().collect::<Vec<_>>().join(", ")
}

fn push_method(page: &mut String, budget: &Budget, records: &[Record]) {
    let mended = match mended(records) {
        0 => String::new(),
        count => format!("; {count} did not"),
    };
    let Budget { particles, generations, noises, tuning_time, gain_range: [low, high], plants, spread, margin, .. } =
        budget;
    let plural = if *noises == 1 { "" } else { "s" };
    let _ = writeln!(
        page,
        "<h2 id=\"method\">Method</h2>\n<p>The same particle swarm tuned the gains of every controller: {particles} \
         particles, {generations} generations, {noises} noise{plural} per position, and {tuning_time} s of the \
         nominal plant with its sensors and actuators. Each gain was limited to {low} to {high} times its initial \
         value. The objective is the integral of the squared errors, relative to their limits, plus a hundredth of \
         the squared commands and of their total variation, relative to the largest control. A failure costs up to a \
         million. After the search no gain was changed.</p>\n<p>A run fails if an output of the plant leaves its \
         envelope, if an error exceeds its limit while errors are judged, or if an FMU returns an error. Near a \
         margin it also fails if a command varies three times as much as nominally. Failed runs were repeated with a \
         hundredth of the tolerance and half the step, and count only if they failed again{mended}. Margins apply to \
         the nominal plant without noise and were found by bisection of the ratio to {:.0} %; all values up to a \
         margin are assumed to pass.</p>\n<p>{plants} random plants, the same for all controllers: each uncertain \
         parameter is anywhere within ±{:.0} % of its nominal value, with sensors and actuators. Intervals contain \
         the true value with a probability of 95 % for plants drawn in this way. A place is one more than the number \
         of controllers that are certainly better; where intervals overlap, it is shared.</p>\n<p>Computed by version \
         {}.</p>",
        100.0 * margin,
        100.0 * spread,
        escaped(&versions(records))
    );
}
