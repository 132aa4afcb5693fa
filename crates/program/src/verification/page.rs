//! The page of a study: the verdict, histograms of metrics, failures over parameters, main influences, the worst
//! curves.

use std::fmt::Write;

use super::binomial::{lower, upper};
use super::outcome::Outcome;
use super::sensitivity::{Bin, groups, histogram, rates};
use super::summary::{Index, Runs, Summary, thousands};
use crate::drawing::{CHARTS, Chart, Line, colours, escaped};
use crate::figures::{still, still_ending, thinned, time_label};
use crate::report::number;
use crate::results::four_digits;

const STYLE: &str = "
  .map { margin-bottom: 1em; }
  .map td { text-align: right; padding: 0.3em 0.7em; border: 1px solid #fff; font-variant-numeric: tabular-nums; }
  .verdict { font-size: 1.2em; font-weight: bold; }
";
/// Bins of a histogram, and of failures over a quantity.
const BINS: usize = 40;
const STEPS: usize = 12;
/// Bins of each of two quantities.
const SIDE: usize = 8;
/// The most influential quantities, whose pairs are shown.
const MOST_PAIRED: usize = 4;
/// Least average number of runs in a bin of a chart or a map.
const LEAST_RUNS: usize = 20;
/// Curves of the worst samples.
pub(super) const CURVES: usize = 10;
/// Groups of points in a curve, and signals that are drawn.
const GROUPS: usize = 300;
const MOST_SIGNALS: usize = 12;
/// Rows of the table of the worst.
const ROWS: usize = 20;
/// Error of the bounds of a rate in a chart: 95 % confidence.
const ERROR: f64 = 0.025;

impl Summary<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let structure = self.study.structure();
        let title = format!("{}, verified", structure.name);
        let mut page = still(&title, &structure.description, &format!("{CHARTS}{STYLE}"));
        let _ = writeln!(page, "<p class=\"verdict\">{}</p>", escaped(&self.verdict()));
        if self.ended.interrupted {
            page.push_str("<p class=\"bad\">The study was interrupted. Repeat the command to continue.</p>\n");
        }
        page.push_str("<ul>\n");
        self.counts().iter().for_each(|count| _ = writeln!(page, "<li>{}</li>", escaped(count)));
        let _ = writeln!(page, "</ul>\n<p>{}</p>", self.form());
        match &self.ended.rare {
            Some(found) => self.push_rare(&mut page, found),
            None if self.plan.sizes().is_none() => self.push_influences(&mut page),
            None => {}
        }
        self.push_curves(&mut page);
        self.push_worst(&mut page);
        page.push_str(&still_ending());
        page
    }

    /// Influences on failures, and histograms of metrics.
    fn push_influences(&self, page: &mut String) {
        let runs = self.table();
        let indices = self.indices_of(&runs);
        push_indices(page, &indices);
        self.push_rates(page, &runs, &indices);
        self.push_pairs(page, &runs, &indices);
        self.push_metrics(page, &runs);
    }

    /// The failing part of the runs over each quantity.
    fn push_rates(&self, page: &mut String, runs: &Runs, indices: &[Index]) {
        let count = STEPS.min(runs.failed.len() / LEAST_RUNS);
        if count < 2 || !runs.failed.contains(&true) {
            return;
        }
        page.push_str("<h2>Failures over each parameter</h2>\n<p>Dashed: bounds with 95 % confidence.</p>\n");
        for Index { name, .. } in indices {
            let Some(place) = self.study.names().iter().position(|known| known == name) else { continue };
            let bins = rates(&runs.columns[place], &runs.failed, count);
            let line = |text: &str, colour: &str, dashed: bool, of: &dyn Fn(&Bin) -> f64| Line {
                name: text.to_owned(),
                colour: colour.to_owned(),
                points: bins.iter().map(|bin| (0.5 * (bin.low + bin.high), Some(100.0 * of(bin)))).collect(),
                marked: !dashed,
                dashed,
            };
            let lines = vec![
                line("lower bound", colours::COMPARED, true, &|bin| lower(bin.failures, bin.runs, ERROR)),
                line("upper bound", colours::COMPARED, true, &|bin| upper(bin.failures, bin.runs, ERROR)),
                line("failing runs", colours::LINE, false, &|bin| bin.failures as f64 / bin.runs as f64),
            ];
            let (x, logarithmic) = (self.study.with_unit(name), self.study.are_logarithmic()[place]);
            page.push_str(&Chart { title: name, x: &x, y: "failing runs in %", logarithmic, lines }.drawing());
        }
    }

    /// The failing part of the runs over pairs of the most influential quantities.
    fn push_pairs(&self, page: &mut String, runs: &Runs, indices: &[Index]) {
        let side = SIDE.min(((runs.failed.len() / LEAST_RUNS) as f64).sqrt() as usize);
        if side < 2 || !runs.failed.contains(&true) || indices.len() < 2 {
            return;
        }
        page.push_str("<h2>Failures over pairs of parameters, %</h2>\n");
        let names = self.study.names();
        let chosen = indices.iter().take(MOST_PAIRED);
        let chosen: Vec<usize> = chosen.filter_map(|it| names.iter().position(|name| *name == it.name)).collect();
        for (k, &down) in chosen.iter().enumerate() {
            for &across in &chosen[..k] {
                push_map(page, (names[down], names[across]), (&runs.columns[down], &runs.columns[across]), runs, side);
            }
        }
    }

    /// Histograms of the metrics of requirements, then of the others.
    fn push_metrics(&self, page: &mut String, runs: &Runs) {
        page.push_str("<h2>Metrics</h2>\n<p>Dashed: limits.</p>\n");
        let limits = self.study.limits();
        let others = (0..self.study.labels().len()).filter(|place| !limits.places.contains(place));
        let mut places = limits.places.clone();
        places.dedup();
        for place in places.into_iter().chain(others) {
            let value = |(_, outcome): (u64, &Outcome)| match outcome {
                Outcome::Ended(metrics) => metrics[place].unwrap_or(f64::NAN),
                _ => f64::NAN,
            };
            let bins = histogram(&self.runs().map(value).collect::<Vec<_>>(), &runs.failed, BINS);
            let Some(most) = bins.iter().map(|bin| bin.runs).max() else { continue };
            let mut lines = vec![
                outline("all runs", colours::LINE, &bins, |bin| bin.runs),
                outline("failing runs", colours::LIMIT, &bins, |bin| bin.failures),
            ];
            for (limit, _) in limits.of.iter().zip(&limits.places).filter(|(_, of)| **of == place) {
                let points = vec![(limit.value, Some(0.0)), (limit.value, Some(most as f64))];
                let (name, colour) = (limit.to_string(), colours::COMPARED.to_owned());
                lines.push(Line { name, colour, points, marked: false, dashed: true });
            }
            let label = &self.study.labels()[place];
            page.push_str(&Chart { title: label, x: label, y: "number of runs", logarithmic: false, lines }.drawing());
        }
        page.push_str("<p>Blue: all runs. Orange: failing runs.</p>\n");
    }

    /// Signals of the worst samples, and of the nominal loop.
    fn push_curves(&self, page: &mut String) {
        let worst: Vec<u64> = self.worst().into_iter().take(CURVES).collect();
        let curves: Vec<_> = worst.iter().filter_map(|&k| Some((k, self.study.recorded(Some(k)).ok()?))).collect();
        let as_it_is = self.study.recorded(None).ok();
        if curves.is_empty() {
            return;
        }
        let _ =
            writeln!(page, "<h2>Curves of the {} worst samples</h2>\n<p>Dashed: the loop as it is.</p>", curves.len());
        let mut names: Vec<&String> = Vec::new();
        for name in self.study.structure().plots.iter().flat_map(|plot| &plot.signals) {
            let is_there = curves[0].1.names.contains(name);
            if is_there && !names.contains(&name) && names.len() < MOST_SIGNALS {
                names.push(name);
            }
        }
        for name in names {
            let points = |recording: &crate::simulation::Recording| {
                let column = recording.column(name).unwrap_or_default();
                let points = thinned(&recording.times, column, GROUPS);
                points.into_iter().map(|(time, value)| (time, Some(value).filter(|value| value.is_finite()))).collect()
            };
            let mut lines: Vec<_> = curves
                .iter()
                .enumerate()
                .map(|(rank, (k, recording))| Line {
                    name: format!("sample {k}: {}", self.study.described(*k)),
                    colour: colours::at(rank as f64 / CURVES as f64),
                    points: points(recording),
                    marked: false,
                    dashed: false,
                })
                .collect();
            lines.extend(as_it_is.as_ref().map(|recording| Line {
                name: "as it is".to_owned(),
                colour: colours::COMPARED.to_owned(),
                points: points(recording),
                marked: false,
                dashed: true,
            }));
            let (x, y) = (time_label(), self.study.with_unit(name));
            page.push_str(&Chart { title: name, x: &x, y: &y, logarithmic: false, lines }.drawing());
        }
    }

    fn push_worst(&self, page: &mut String) {
        page.push_str("<h2>The worst samples</h2>\n<div class=\"scroll\"><table>\n<tr><th>sample");
        self.study.names().iter().for_each(|name| _ = write!(page, "<th class=\"number\">{}", escaped(name)));
        page.push_str("<th>result");
        for k in self.worst().into_iter().take(ROWS) {
            let _ = write!(page, "\n<tr><td class=\"number\">{k}");
            self.study.values(k).iter().for_each(|value| _ = write!(page, "<td class=\"number\">{}", number(*value)));
            let class = if self.judged(k).is_failure() { " class=\"bad\"" } else { "" };
            let _ = write!(page, "<td{class}>{}: {}", self.judged(k).word(), escaped(&self.described(k)));
        }
        page.push_str("\n</table></div>\n");
    }
}

/// Influences of parameters on failures, as a table.
fn push_indices(page: &mut String, indices: &[Index]) {
    page.push_str(
        "<h2>Parameters that drive failures</h2>\n<p>First-order index: the part of the variance that a parameter \
         explains by itself.</p>\n<table>\n<tr><th>parameter<th>distribution<th class=\"number\">index of failing\
         <th class=\"number\">index of the distance to the nearest limit (ranks)",
    );
    for Index { name, distribution, of_failing, of_distance } in indices {
        let shown = |index: &Option<f64>| index.map_or("–".to_owned(), |index| format!("{index:.2}"));
        let (failing, distance) = (shown(of_failing), shown(of_distance));
        let _ = write!(
            page,
            "\n<tr><td>{}<td>{}<td class=\"number\">{failing}<td class=\"number\">{distance}",
            escaped(name),
            escaped(distribution)
        );
    }
    page.push_str("\n</table>\n");
}

/// The failing part of the runs over two quantities, as numbers on colours.
fn push_map(page: &mut String, names: (&str, &str), columns: (&[f64], &[f64]), runs: &Runs, side: usize) {
    let (down, across) = (groups(columns.0, side), groups(columns.1, side));
    let mut cells = vec![(0_u64, 0_u64); side * side];
    for ((down, across), failed) in down.iter().zip(&across).zip(&runs.failed) {
        let (runs, failures) = &mut cells[down * side + across];
        *runs += 1;
        *failures += u64::from(*failed);
    }
    let part = |&(runs, failures): &(u64, u64)| failures as f64 / runs.max(1) as f64;
    let most = cells.iter().map(part).fold(f64::MIN_POSITIVE, f64::max);
    let ends = |column: &[f64]| rates(column, &runs.failed, side);
    let shown = |bin: &Bin| format!("{} … {}", four_digits(bin.low), four_digits(bin.high));
    let _ = write!(
        page,
        "<div class=\"scroll\"><table class=\"map\">\n<tr><th>{} \\ {}",
        escaped(names.0),
        escaped(names.1)
    );
    ends(columns.1).iter().for_each(|bin| _ = write!(page, "<th class=\"number\">{}", shown(bin)));
    for (row, bin) in ends(columns.0).iter().enumerate() {
        let _ = write!(page, "\n<tr><th class=\"number\">{}", shown(bin));
        for cell in &cells[row * side..(row + 1) * side] {
            let (place, percent, (count, failures)) = (part(cell) / most, 100.0 * part(cell), cell);
            let title = format!("{} of {} runs", thousands(*failures), thousands(*count));
            let (colour, text) = (colours::at(place), colours::text_on(place));
            let percent = if *count == 0 { "–".to_owned() } else { number((10.0 * percent).round() / 10.0) };
            let _ = write!(page, "<td title=\"{title}\" style=\"background: {colour}; color: {text}\">{percent}");
        }
    }
    page.push_str("\n</table></div>\n");
}

/// The outline of a histogram.
fn outline(name: &str, colour: &str, bins: &[Bin], of: impl Fn(&Bin) -> u64) -> Line {
    let ends = bins.iter().flat_map(|bin| [(bin.low, Some(of(bin) as f64)), (bin.high, Some(of(bin) as f64))]);
    let (low, high) = (bins.first().map(|bin| (bin.low, Some(0.0))), bins.last().map(|bin| (bin.high, Some(0.0))));
    let points = low.into_iter().chain(ends).chain(high).collect();
    Line { name: name.to_owned(), colour: colour.to_owned(), points, marked: false, dashed: false }
}
