//! The page: examples with their claims, what adaptation adds, what was corrected, and figures. It loads nothing and
//! needs no script.

use std::fmt::Write;

use super::claim::Judged;
use super::figure::Drawing;
use super::outcome::Outcome;
use super::{Example, Study, Table};
use crate::drawing::escaped;
use crate::figures::{still, still_ending};
use crate::results::{Ending, Measured, Verdict, four_digits};

const OWN_STYLE: &str = "
  h2 { font-size: 1.3em; margin-top: 2.5em; border-top: 2px solid #1b1b1b; padding-top: 0.6em; }
  h3 { font-size: 1em; margin: 1.2em 0 0.3em; }
  .figures { margin-top: 1.5em; display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 30em), 1fr)); gap: 1em; }
  figure { margin: 0; break-inside: avoid; }
  figcaption { font-size: 0.9em; }
  svg { display: block; height: auto; }
  .good { color: #006b3c; font-weight: bold; }
  nav li { margin: 0.1em 0; }
  @media print { h2 { break-before: page; } .figures { grid-template-columns: 1fr 1fr; } }
";

/// Cell without a number.
const NONE: &str = "<td class=\"number\">–";
/// Explanation of the columns about linear limits.
const ABOUT_LIMIT: &str = "<p>The linear limit is the loop with the linear controller that its L1 controller tends to as its \
adaptation gets fast, of the same description. What adaptation adds is the metric as it is, less that of the limit.</p>\n";

/// An example as it came out.
#[derive(Debug)]
pub struct Done {
    /// Its runs.
    pub outcomes: Vec<Outcome>,
    /// The same with adaptation frozen.
    pub frozen: Vec<Outcome>,
    /// The same with the linear limits of adaptive controllers, if they exist.
    pub linear: Vec<Option<Outcome>>,
    /// Its claims.
    pub claims: Vec<Judged>,
    /// Its figures.
    pub drawings: Vec<Drawing>,
}

/// All of it.
#[derive(Debug)]
pub struct Page<'a> {
    /// Runs and claims that were asked for.
    pub study: &'a Study,
    /// Results, in the order of the examples.
    pub done: &'a [Done],
}

impl Page<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let Study { title, about, .. } = self.study;
        let mut page = still(title, about, OWN_STYLE);
        self.push_contents(&mut page);
        self.push_glance(&mut page);
        for (example, done) in self.study.example.iter().zip(self.done) {
            push_example(&mut page, example, done);
        }
        page.push_str(&still_ending());
        page
    }

    fn push_contents(&self, page: &mut String) {
        page.push_str("<nav><ul>\n");
        for (Example { name, title, .. }, Done { claims, .. }) in self.study.example.iter().zip(self.done) {
            let hold = claims.iter().filter(|claim| claim.holds).count();
            let (name, title, of) = (escaped(name), escaped(title), claims.len());
            let _ = writeln!(page, "<li><a href=\"#{name}\">{name} {title}</a>: {hold} of {of} claims hold");
        }
        page.push_str("</ul></nav>\n");
    }

    /// Adds a table of the first metric of every run: with adaptation, without, and with its linear limit.
    fn push_glance(&self, page: &mut String) {
        page.push_str(
            "<h3>What adaptation adds, at a glance</h3>\n<div class=\"scroll\"><table id=\"glance\">\n\
             <tr><th>run<th>metric<th class=\"number\">as it is<th class=\"number\">adaptation frozen\
             <th class=\"number\">linear limit<th class=\"number\">adaptation adds\n",
        );
        for done in self.done {
            for ((own, frozen), linear) in done.outcomes.iter().zip(&done.frozen).zip(&done.linear) {
                let Some(label) = own.measured.first().map(|metric| metric.label.as_str()) else { continue };
                let label = || std::iter::once(label);
                let limit = linear.as_ref().map_or(NONE.repeat(2), |linear| {
                    format!("{}{}", cells(linear, label()), added(own, linear, label()))
                });
                let [run, shown] = [&own.run, own.measured[0].label.as_str()].map(escaped);
                let _ =
                    writeln!(page, "<tr><td>{run}<td>{shown}{}{}{limit}", cells(own, label()), cells(frozen, label()));
            }
        }
        page.push_str("</table></div>\n");
        page.push_str(ABOUT_LIMIT);
    }
}

fn push_example(page: &mut String, example: &Example, done: &Done) {
    let (name, title, about) = (escaped(&example.name), escaped(&example.title), escaped(&example.about));
    let _ = writeln!(page, "<section>\n<h2 id=\"{name}\">{name} {title}</h2>\n<p>{about}</p>");
    if !example.thesis.is_empty() {
        let _ = writeln!(page, "<p class=\"thesis\">In the thesis: {}.</p>", escaped(&example.thesis));
    }
    for outcome in &done.outcomes {
        push_shortfall(page, outcome);
    }
    push_claims(page, &done.claims);
    if !example.corrections.is_empty() {
        let items: String = example.corrections.iter().map(|text| format!("<li>{}\n", escaped(text))).collect();
        let _ = writeln!(page, "<h3>Corrected</h3>\n<ul>\n{items}</ul>");
    }
    push_adaptation(page, example, done);
    example.table.iter().for_each(|table| push_table(page, table));
    page.push_str("<div class=\"figures\">\n");
    for Drawing { name, title, thesis, svg, .. } in &done.drawings {
        let thesis = if thesis.is_empty() { String::new() } else { format!(" (thesis: figure {thesis})") };
        let title = escaped(&format!("{title}{thesis}"));
        let _ = writeln!(page, "<figure id=\"{name}\"><figcaption>{title}</figcaption>{svg}</figure>");
    }
    page.push_str("</div>\n</section>\n");
}

fn push_table(page: &mut String, Table { title, head, rows }: &Table) {
    let row =
        |cells: &[String], tag: &str| cells.iter().map(|cell| format!("<{tag}>{}", escaped(cell))).collect::<String>();
    let rows: String = rows.iter().map(|cells| format!("\n<tr>{}", row(cells, "td"))).collect();
    let (title, head) = (escaped(title), row(head, "th"));
    let _ = writeln!(
        page,
        "<h3>{title}</h3>\n<div class=\"scroll\"><table class=\"own\">\n<tr>{head}{rows}\n</table></div>"
    );
}

/// Adds failures that the loop isn't meant to show.
fn push_shortfall(page: &mut String, outcome: &Outcome) {
    if let (Ending::Failed(reason), Verdict::Failed | Verdict::Beyond) = (&outcome.ending, outcome.verdict) {
        let text = format!("{} {}: {reason}", outcome.run, outcome.to_text());
        let _ = writeln!(page, "<p class=\"bad\">{}</p>", escaped(&text));
    }
}

fn push_claims(page: &mut String, claims: &[Judged]) {
    page.push_str("<div class=\"scroll\"><table class=\"claims\">\n<tr><th>claim<th>measured<th>holds?\n");
    for Judged { claim, measured, holds, remark } in claims {
        let word = if *holds { "<td class=\"good\">yes" } else { "<td class=\"bad\">no" };
        let remark = if remark.is_empty() { String::new() } else { format!("<br><i>{}</i>", escaped(remark)) };
        let (claim, measured) = (escaped(claim), escaped(measured));
        let _ = writeln!(page, "<tr><td>{claim}{remark}<td>{measured}{word}");
    }
    page.push_str("</table></div>\n");
}

/// Adds tables that compare each run with the same run with adaptation frozen, and with its linear limit.
fn push_adaptation(page: &mut String, example: &Example, done: &Done) {
    page.push_str("<h3>What adaptation adds</h3>\n");
    let all = example.run.iter().zip(&done.outcomes).zip(&done.frozen).zip(&done.linear);
    for (((run, outcome), frozen), linear) in all {
        let labels = || outcome.measured.iter().map(|metric| metric.label.as_str());
        let heads: String = labels().map(|label| format!("<th class=\"number\">{}", escaped(label))).collect();
        let set: Vec<_> = run.frozen.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let (key, set) = (escaped(&run.key()), escaped(&set.join(", ")));
        let limit = linear.as_ref().map_or(String::new(), |linear| {
            let (cells, added) = (cells(linear, labels()), added(outcome, linear, labels()));
            format!("\n<tr><td>linear limit{cells}\n<tr><td>adaptation adds{added}")
        });
        let _ = writeln!(
            page,
            "<div class=\"scroll\"><table class=\"adaptation\">\n<tr><th>{key}{heads}\n\
             <tr><td>as it is{}\n<tr><td>adaptation frozen ({set}){}{limit}\n</table></div>",
            cells(outcome, labels()),
            cells(frozen, labels())
        );
    }
}

/// Returns the differences of a run's metrics from those of its linear limit.
fn added<'a>(own: &Outcome, linear: &Outcome, labels: impl Iterator<Item = &'a str>) -> String {
    let value = |outcome: &Outcome, label| {
        let measured = outcome.measured.iter().find(|metric| metric.label == label);
        measured.and_then(|metric| metric.value).filter(|_| outcome.ending == Ending::Complete)
    };
    let difference = |label| Some(value(own, label)? - value(linear, label)?);
    let cell = |difference: f64| format!("<td class=\"number\">{}", signed(difference));
    labels.map(|label| difference(label).map_or(NONE.to_owned(), cell)).collect()
}

fn signed(difference: f64) -> String {
    let sign = if difference < 0.0 { "−" } else { "+" };
    format!("{sign}{}", four_digits(difference.abs()))
}

fn cells<'a>(outcome: &Outcome, labels: impl Iterator<Item = &'a str>) -> String {
    if outcome.ending != Ending::Complete {
        let (width, ending) = (labels.count().max(1), escaped(&outcome.to_text()));
        return format!("<td class=\"number\" colspan=\"{width}\">{ending}");
    }
    let value = |label: &str| -> Option<&Measured> { outcome.measured.iter().find(|metric| metric.label == label) };
    let number = |label| value(label).and_then(|metric| metric.value).map_or("–".to_owned(), four_digits);
    labels.map(|label| format!("<td class=\"number\">{}", number(label))).collect()
}
