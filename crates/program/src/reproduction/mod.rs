//! The thesis' examples on one page: the runs of each, its claims, and what was corrected (`report`).
//!
//! A [`Study`] is data: examples, each with its runs, figures and claims. [`Outcome`] stores the results of a run;
//! [`Page`] shows them all.

mod claim;
mod figure;
mod linear;
mod outcome;
mod page;

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::{near, texts};

pub use claim::{Claim, Judged};
pub use figure::{Coordinate, Drawing, Figure, Line};
pub use linear::linear_limit;
pub use outcome::Outcome;
pub use page::{Done, Page};

/// Addition to the name of a run as a single FMU.
const SINGLE: &str = ", as a single FMU";
/// The same in studies before 0.2.0, read until 0.3.
pub const SINGLE_BEFORE: &str = ", as one unit";

/// Examples in the order of the page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Title of the page.
    pub title: String,
    /// Introduction.
    pub about: String,
    /// The examples.
    pub example: Vec<Example>,
}

/// An example of the thesis.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Example {
    /// Number of the example or chapter.
    pub name: String,
    /// Title.
    pub title: String,
    /// Introduction.
    pub about: String,
    /// Its section in the thesis.
    #[serde(default)]
    pub thesis: String,
    /// The same figures in the thesis, as `3.2`, by the titles of figures.
    #[serde(default)]
    pub thesis_figures: BTreeMap<String, String>,
    /// Corrections to it.
    #[serde(default)]
    pub corrections: Vec<String>,
    /// Its runs.
    pub run: Vec<Run>,
    /// Figures in addition to those of the loops themselves.
    #[serde(default)]
    pub figure: Vec<Figure>,
    /// Tables in addition to those of metrics.
    #[serde(default)]
    pub table: Vec<Table>,
    /// Its claims.
    pub claim: Vec<Claim>,
}

/// A table as it is shown.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Title.
    pub title: String,
    /// The first row.
    pub head: Vec<String>,
    /// The others.
    pub rows: Vec<Vec<String>>,
}

/// A run of a loop.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// The loop.
    #[serde(rename = "loop")]
    pub name: String,
    /// True if it is run as a single FMU.
    #[serde(default)]
    pub composite: bool,
    /// A parameter set in the folder of the loop.
    pub case: Option<String>,
    /// Communication step, s, in place of the loop's own.
    pub step: Option<f64>,
    /// Start values that freeze adaptation.
    pub frozen: BTreeMap<String, String>,
}

impl Run {
    /// Its name in figures and claims.
    pub fn key(&self) -> String {
        let case = self.case.iter().map(|case| format!(", {case}"));
        let whole = self.composite.then(|| SINGLE.to_owned());
        std::iter::once(self.name.clone()).chain(case).chain(whole).collect()
    }
}

/// A signal of a run, or the difference of two: `RUN: of - minus`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Deserialize)]
#[serde(try_from = "String")]
pub struct Curve {
    /// The run.
    pub run: String,
    /// The signal.
    pub of: String,
    /// Signal that is subtracted from it.
    pub minus: Option<String>,
}

impl TryFrom<String> for Curve {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let (run, signal) = text.split_once(": ").ok_or_else(|| format!("`{text}`: must be RUN: SIGNAL"))?;
        let (of, minus) = match signal.split_once(" - ") {
            Some((of, minus)) => (of, Some(minus.to_owned())),
            None => (signal, None),
        };
        Ok(Curve { run: run.to_owned(), of: of.to_owned(), minus })
    }
}

impl Curve {
    /// The signal without the run.
    pub fn signal(&self) -> String {
        let minus = self.minus.iter().map(|minus| format!(" − {minus}"));
        std::iter::once(self.of.clone()).chain(minus).collect()
    }
}

impl Study {
    /// The examples of the thesis.
    ///
    /// # Errors
    /// When the study is not valid.
    pub fn thesis() -> Result<Self, String> {
        Study::read(texts::THESIS)
    }

    /// Reads a study.
    ///
    /// # Errors
    /// When it is not valid, or an example's name can't name files.
    pub fn read(text: &str) -> Result<Self, String> {
        let study: Study = toml::from_str(&text.replace(SINGLE_BEFORE, SINGLE)).map_err(|error| error.to_string())?;
        let plain = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c));
        match study.example.iter().find(|example| !plain(&example.name)) {
            Some(Example { name, .. }) => Err(format!("name = `{name}`: must be letters, digits, _, - and dots")),
            None => Ok(study),
        }
    }

    /// The examples whose names begin with one of these.
    ///
    /// # Errors
    /// When none begins with one of them.
    pub fn only(mut self, names: &[String]) -> Result<Self, String> {
        let known: Vec<String> = self.example.iter().map(|example| example.name.clone()).collect();
        if let Some(unknown) = names.iter().find(|name| known.iter().all(|known| !known.starts_with(*name))) {
            return Err(format!("there is no example `{unknown}`; {}", near::choice(unknown, &known, "")));
        }
        self.example.retain(|example| names.is_empty() || names.iter().any(|name| example.name.starts_with(name)));
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mathematics::fuzzy::{RULES, SETS, memberships};

    const NAMES: [&str; SETS] = ["zero", "very small", "small", "large", "very large"];

    fn chapter_4() -> Example {
        Study::thesis().unwrap().example.into_iter().find(|example| example.name == "4").unwrap()
    }

    #[test]
    fn the_rules_that_the_report_shows_are_those_of_the_inference() {
        let example = chapter_4();
        let Table { head, rows, .. } = &example.table[0];
        let place = |name: &str| NAMES.iter().position(|other| *other == name).unwrap();
        assert_eq!(rows.len(), SETS);
        for row in rows {
            for (of_error, output) in head[1..].iter().zip(&row[1..]) {
                assert_eq!(RULES[place(&row[0])][place(of_error)], place(output), "{} {of_error}", row[0]);
            }
        }
    }

    #[test]
    fn the_input_sets_that_the_report_shows_are_those_of_the_inference() {
        let example = chapter_4();
        let figure = example.figure.iter().find(|figure| figure.title.starts_with("input sets")).unwrap();
        let centres = [0.08, 0.31, 0.54, 0.77, 1.0];
        let centre = |curve: &Curve| {
            let place = curve.of.strip_prefix("controller.input_centre[").and_then(|rest| rest.strip_suffix(']'));
            centres[place.unwrap().parse::<usize>().unwrap() - 1]
        };
        for (line, name) in figure.lines.iter().zip(NAMES) {
            assert_eq!(line.name, name);
            let places = line.x.iter().map(|coordinate| match coordinate {
                Coordinate::Number(number) => *number,
                Coordinate::Of(curve) => centre(curve),
            });
            for (place, height) in places.zip(&line.y) {
                let expected = memberships(place, &centres)[NAMES.iter().position(|other| *other == name).unwrap()];
                assert!((expected - height).abs() < 1e-12, "{name} at {place}: {height}, not {expected}");
            }
        }
    }
}
