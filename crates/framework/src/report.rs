//! A design report: what a designer should know of a system's parameters before using it.
//!
//! A [`System`](crate::system::System) reports its findings; only this module decides whether all of them together are
//! sound.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::eigenvalues::{Eigenvalue, eigenvalues};
use crate::nominal::{NominalPlant, WorstPlant};
use crate::picture::Picture;

/// Verdict on a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing against it.
    Ok,
    /// It works, with a disadvantage that its note names.
    Warning,
    /// An assumption of the design doesn't hold, or can't be shown.
    NotSound,
}

impl Verdict {
    /// Text for people.
    pub fn text(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::Warning => "warning",
            Verdict::NotSound => "not sound",
        }
    }
}

/// Value of a finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A finite number.
    Number(f64),
    /// A matrix, row by row.
    Matrix(Vec<Vec<f64>>),
    /// Eigenvalues, the slowest first.
    Eigenvalues(Vec<Eigenvalue>),
    /// Two numbers between which it lies.
    Between {
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// Words; also numbers that aren't finite.
    Text(String),
}

impl From<f64> for Value {
    fn from(number: f64) -> Self {
        if number.is_finite() { Value::Number(number) } else { Value::Text(infinite(number).to_owned()) }
    }
}

impl From<&DMatrix<f64>> for Value {
    fn from(matrix: &DMatrix<f64>) -> Self {
        Value::Matrix(matrix.row_iter().map(|row| row.iter().copied().collect()).collect())
    }
}

impl From<&DVector<f64>> for Value {
    fn from(vector: &DVector<f64>) -> Self {
        Value::Matrix(vec![vector.iter().copied().collect()])
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Value::Text(text)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Value::Text(text.to_owned())
    }
}

const INFINITE: &str = "infinite";
const NOT_A_NUMBER: &str = "not a number";

fn infinite(number: f64) -> &'static str {
    if number.is_nan() { NOT_A_NUMBER } else { INFINITE }
}

impl Value {
    /// True if every number in it is finite.
    fn is_finite(&self) -> bool {
        match self {
            Value::Number(number) => number.is_finite(),
            Value::Matrix(rows) => rows.iter().flatten().all(|number| number.is_finite()),
            Value::Eigenvalues(all) => all.iter().all(|value| value.real.is_finite() && value.imaginary.is_finite()),
            Value::Between { lower, upper } => lower.is_finite() && upper.is_finite(),
            Value::Text(text) => text != INFINITE && text != NOT_A_NUMBER,
        }
    }

    /// Text for people: one line, or a line per row or eigenvalue.
    pub fn lines(&self) -> Vec<String> {
        match self {
            Value::Number(value) => vec![number(*value)],
            Value::Matrix(rows) => rows.iter().map(|row| list(row)).collect(),
            Value::Eigenvalues(all) => all.iter().filter(|value| value.imaginary >= 0.0).map(eigenvalue).collect(),
            Value::Between { lower, upper } if number(*lower) == number(*upper) => vec![number(*upper)],
            Value::Between { lower, upper } => vec![format!("{} … {}", number(*lower), number(*upper))],
            Value::Text(text) => vec![text.clone()],
        }
    }
}

fn list(numbers: &[f64]) -> String {
    numbers.iter().map(|value| number(*value)).collect::<Vec<_>>().join(", ")
}

/// Text of an eigenvalue; one of a conjugate pair represents both.
fn eigenvalue(value: &Eigenvalue) -> String {
    let imaginary = if value.imaginary > 0.0 { format!(" ± {}j", number(value.imaginary)) } else { String::new() };
    let rest = value
        .damping
        .map_or(String::new(), |damping| format!(", damping {}, {} rad/s", number(damping), number(value.frequency)));
    format!("{}{imaginary} 1/s{rest}", number(value.real))
}

/// The number with this number of digits that is farthest from 0 but not beyond this one: the largest magnitude that a
/// text may advise.
pub fn no_more(value: f64, digits: usize) -> f64 {
    cut(value, digits, false)
}

/// The number with this number of digits that is nearest to 0 but not short of this one: the smallest magnitude that a
/// text may advise.
pub fn no_less(value: f64, digits: usize) -> f64 {
    cut(value, digits, true)
}

/// [`no_more`] in a text.
pub fn at_most(value: f64) -> String {
    number(no_more(value, DIGITS))
}

/// [`no_less`] in a text.
pub fn at_least(value: f64) -> String {
    number(no_less(value, DIGITS))
}

/// Returns the first of the shortest digits of a number, rounded up in magnitude or cut.
fn cut(value: f64, digits: usize, up: bool) -> f64 {
    let all = format!("{value:e}");
    let Some((mantissa, power)) = all.split_once('e') else { return value };
    let written: Vec<char> = mantissa.chars().filter(char::is_ascii_digit).collect();
    let (Ok(power), Some(behind)) = (power.parse::<i64>(), written.len().checked_sub(digits)) else { return value };
    let first: String = written[..digits].iter().collect();
    let sign = if value < 0.0 { "-" } else { "" };
    let units = first.parse::<u64>().map(|units| units + u64::from(up && behind > 0));
    let shift = power + 1 - i64::try_from(digits).unwrap_or_default();
    units.ok().and_then(|units| format!("{sign}{units}e{shift}").parse().ok()).unwrap_or(value)
}

/// Digits that are shown to people.
pub const DIGITS: usize = 7;

/// Seven digits, as short as can be.
pub fn number(value: f64) -> String {
    let short = format!("{value:.6e}").parse().unwrap_or(value);
    if short == 0.0 || (1e-3..1e6).contains(&f64::abs(short)) {
        format!("{}", short + 0.0)
    } else {
        format!("{short:e}")
    }
}

/// One thing that was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Section of the report.
    pub section: String,
    /// Name of the quantity.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Unit of the value; empty where it has none, and for eigenvalues, which have theirs.
    pub unit: String,
    /// Verdict.
    pub verdict: Verdict,
    /// Meaning or origin; if the verdict isn't ok, the remedy with numbers.
    pub note: String,
}

/// The findings of a system, in their order.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DesignReport {
    /// Communication step of the default experiment, s; 0 within a larger system, whose parts take none.
    pub step: f64,
    /// Findings; none if a system has nothing to report.
    pub findings: Vec<Finding>,
    /// Summary of the loop with the nominal plant, in a line; none where no plant is known.
    #[serde(default)]
    pub summary: Option<String>,
    /// Plants within the uncertainty of the nominal one with which the loop is worst; none where nothing is uncertain.
    #[serde(default)]
    pub worst: Vec<WorstPlant>,
    /// Pictures of the loop with the nominal plant; none where no plant is known.
    #[serde(default)]
    pub pictures: Vec<Picture>,
    /// Title of the section of the next findings.
    #[serde(skip)]
    section: String,
    /// Name of the part of a larger system whose findings follow.
    #[serde(skip)]
    part: Option<String>,
    /// The plant that the system was designed for.
    #[serde(skip)]
    nominal: Option<NominalPlant>,
}

impl DesignReport {
    /// Returns a report without findings, for this communication step, s.
    pub fn new(step: f64) -> Self {
        DesignReport { step, ..DesignReport::default() }
    }

    /// Adds the plant that the system was designed for, which its findings may be about.
    #[must_use]
    pub fn with_nominal(self, nominal: Option<NominalPlant>) -> Self {
        DesignReport { nominal, ..self }
    }

    /// The plant that the system was designed for, where its description has one; none for a part of a larger system.
    pub fn nominal(&self) -> Option<&NominalPlant> {
        self.nominal.as_ref()
    }

    /// The worst verdict: the design is sound where it isn't [`Verdict::NotSound`].
    pub fn verdict(&self) -> Verdict {
        self.findings.iter().map(|finding| finding.verdict).max().unwrap_or(Verdict::Ok)
    }

    /// True if everything that the design rests on holds.
    pub fn is_sound(&self) -> bool {
        self.verdict() != Verdict::NotSound
    }

    /// Reason why the design isn't sound and remedies, from its findings; none if it is sound.
    pub fn reason(&self) -> Option<String> {
        let bad = self.findings.iter().filter(|finding| finding.verdict == Verdict::NotSound);
        let lines = bad.map(|Finding { name, value, unit, note, .. }| {
            let value = format!("{} {unit}", value.lines().first().map_or("", String::as_str));
            format!("{name} = {}: {}", value.trim_end(), note.trim_end_matches('.'))
        });
        let lines = lines.collect::<Vec<_>>().join("; ");
        (!lines.is_empty()).then_some(lines)
    }

    /// Sets the title of the section of the next findings.
    pub fn section(&mut self, title: &str) {
        self.section = self.part.as_ref().map_or(title.to_owned(), |part| format!("{part}: {title}"));
    }

    /// Calls for the findings of a part.
    pub(crate) fn of_part(&mut self, name: &str, fill: impl FnOnce(&mut DesignReport)) {
        let nominal = self.nominal.take();
        self.part = Some(name.to_owned());
        fill(self);
        (self.part, self.nominal) = (None, nominal);
    }

    /// Rewords all texts, e.g. with users' names of variables.
    pub(crate) fn reworded(&mut self, word: impl Fn(&str) -> String) {
        for finding in &mut self.findings {
            finding.name = word(&finding.name);
            finding.note = word(&finding.note);
        }
        self.worst.iter_mut().flat_map(|plant| &mut plant.respects).for_each(|respect| *respect = word(respect));
        for picture in &mut self.pictures {
            for text in [&mut picture.title, &mut picture.y] {
                *text = word(text);
            }
            picture.curves.iter_mut().for_each(|curve| curve.name = word(&curve.name));
        }
        self.summary = self.summary.take().map(|summary| word(&summary));
    }

    /// Sets the summary of the loop with the nominal plant.
    pub fn summarise(&mut self, summary: String) {
        self.summary = Some(summary);
    }

    /// A finding that nothing speaks against.
    pub fn add(&mut self, name: &str, value: impl Into<Value>, unit: &str, note: &str) {
        self.judge(name, value, unit, Verdict::Ok, note);
    }

    /// A limit that nothing is beyond, which is as good as can be.
    pub fn add_unlimited(&mut self, name: &str, unit: &str, note: &str) {
        self.add(name, "unlimited", unit, note);
    }

    /// Adds a finding with its verdict and, as its note, a remedy. A number that isn't finite is never ok: it shows
    /// nothing.
    pub fn judge(
        &mut self,
        name: &str,
        value: impl Into<Value>,
        unit: &str,
        verdict: Verdict,
        note: impl Into<String>,
    ) {
        let (name, unit) = (name.to_owned(), unit.to_owned());
        let (section, value, mut note) = (self.section.clone(), value.into(), note.into());
        let mut verdict = verdict;
        if verdict == Verdict::Ok && !value.is_finite() {
            verdict = Verdict::NotSound;
            note = format!("not a finite number, so it shows nothing: {note}");
        }
        // JSON has no such numbers.
        let value = match value {
            Value::Text(_) | Value::Number(_) => value,
            several if several.is_finite() => several,
            _ => Value::Text(NOT_A_NUMBER.to_owned()),
        };
        self.findings.push(Finding { section, name, value, unit, verdict, note });
    }

    /// Adds the eigenvalues of a matrix; its modes must decay if `must_decay`.
    pub fn eigenvalues(&mut self, name: &str, matrix: &DMatrix<f64>, must_decay: bool) {
        match eigenvalues(matrix) {
            Err(reason) => self.judge(name, "not found", "", Verdict::NotSound, format!("{name}: {reason}")),
            Ok(found) if must_decay && found.iter().any(|value| value.real >= 0.0) => {
                let note = "every eigenvalue needs a negative real part";
                self.judge(name, Value::Eigenvalues(found), "", Verdict::NotSound, note);
            }
            Ok(found) => self.add(name, Value::Eigenvalues(found), "", ""),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_advised_is_on_the_safe_side() {
        assert_eq!([no_more(9.996e-4, 2), no_less(9.91e-4, 2)], [9.9e-4, 1e-3]);
        assert_eq!([no_more(0.3, 2), no_less(0.3, 2), no_more(-1.26, 2), no_less(-1.21, 2)], [0.3, 0.3, -1.2, -1.3]);
        assert_eq!([no_more(f64::INFINITY, 2), no_less(0.0, 2)], [f64::INFINITY, 0.0]);
        assert_eq!([at_most(0.012345678), at_least(0.0123456712)], ["0.01234567", "0.01234568"]);
        let mut value = 1.234e-310;
        while value < 1e300 {
            for digits in 1..8 {
                assert!(no_more(value, digits) <= value && no_less(value, digits) >= value, "{value:e}");
            }
            value *= 7.3;
        }
    }

    #[test]
    fn the_worst_finding_decides() {
        let mut report = DesignReport::new(1e-3);
        assert!(report.is_sound() && report.verdict() == Verdict::Ok);
        report.add("a", 1.0, "s", "");
        report.judge("b", 2.0, "", Verdict::Warning, "a disadvantage");
        assert!(report.is_sound() && report.verdict() == Verdict::Warning && report.reason().is_none());
        report.judge("c", f64::INFINITY, "", Verdict::NotSound, "what helps");
        assert!(!report.is_sound());
        assert_eq!(report.reason().unwrap(), "c = infinite: what helps");
    }

    #[test]
    fn a_report_survives_its_way_to_a_script_and_back() {
        let mut report = DesignReport::new(1e-3);
        report.section("numbers");
        report.judge("infinite", f64::INFINITY, "", Verdict::NotSound, "");
        report.add_unlimited("delay margin", "s", "");
        report.add("matrix", &DMatrix::from_row_slice(1, 2, &[0.1, 1e300]), "1/s", "");
        report.add("between", Value::Between { lower: 1.0, upper: 2.0 }, "", "");
        report.add("matrix", &DMatrix::from_row_slice(1, 2, &[0.1, f64::NAN]), "1/s", "");
        report.eigenvalues("A", &DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, -2.0]), false);
        report.eigenvalues("A", &DMatrix::from_element(1, 1, f64::NAN), true);
        let back: DesignReport = serde_json::from_str(&serde_json::to_string(&report).unwrap()).unwrap();
        assert_eq!(back.findings, report.findings);
        assert!(!report.is_sound());
    }

    #[test]
    fn nothing_that_is_no_finite_number_is_ok() {
        let matrix = DMatrix::from_row_slice(1, 2, &[1.0, f64::NEG_INFINITY]);
        let broken = Eigenvalue { real: f64::NAN, imaginary: 0.0, damping: None, frequency: f64::NAN };
        let all: [Value; 5] = [
            f64::INFINITY.into(),
            f64::NAN.into(),
            (&matrix).into(),
            Value::Between { lower: f64::NAN, upper: 1.0 },
            Value::Eigenvalues(vec![broken]),
        ];
        for value in all {
            let mut report = DesignReport::new(1e-3);
            report.add("norm", value.clone(), "", "from here to there");
            let [Finding { verdict, note, .. }] = &report.findings[..] else { panic!("one finding") };
            assert!(*verdict == Verdict::NotSound && note.ends_with("from here to there"), "{value:?}: {note}");
        }
        let mut report = DesignReport::new(1e-3);
        report.add_unlimited("delay margin", "s", "");
        report.add("words", "symmetric", "", "");
        assert_eq!(report.verdict(), Verdict::Ok);
    }

    #[test]
    fn people_see_one_of_a_pair_and_short_numbers() {
        let mut report = DesignReport::new(1e-3);
        report.eigenvalues("A", &DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -25.0, -6.0]), true);
        assert_eq!(report.findings[0].value.lines(), ["-3 ± 4j 1/s, damping 0.6, 5 rad/s"]);
        assert_eq!(Value::Between { lower: 0.1, upper: 0.100_000_001 }.lines(), ["0.1"]);
        assert_eq!(Value::Between { lower: 0.1, upper: 0.2 }.lines(), ["0.1 … 0.2"]);
    }
}
