//! Findings and their places.

use std::borrow::Cow;
use std::fmt;

use roxmltree::Node;
use serde::Serialize;

use crate::error::one_line;
use crate::fmi2::calls::Standard;

/// More findings than this are only counted: a person fixes the first ones first.
const MOST: usize = 1000;
/// Characters of a name that are shown, and of a whole text: a file may hold names and values of any length.
const LONGEST_NAME: usize = 200;
const LONGEST_TEXT: usize = 1200;

/// The standard of related files, in place of a section of FMI 2.0.
pub(super) const RELATED: &str = "FMI-LS-REF";

/// How grave a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The standard forbids it.
    Error,
    /// The standard allows it, but tools stumble over it.
    Warning,
}

/// Something that was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How grave it is.
    pub severity: Severity,
    /// The line of modelDescription.xml.
    pub line: Option<u32>,
    /// The variable.
    pub variable: Option<String>,
    /// The fault.
    pub what: String,
    /// The version of the standard.
    pub standard: &'static str,
    /// The section of FMI 2.0 that specifies it; empty in FMI 3.0. Or the name of a layered standard.
    pub section: &'static str,
    /// Advice.
    pub advice: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Finding { severity, line, variable, what, standard, section, advice } = self;
        let mut text = match severity {
            Severity::Error => "error: ".to_owned(),
            Severity::Warning => "warning: ".to_owned(),
        };
        if let Some(line) = line {
            text.push_str(&format!("line {line}: "));
        }
        if let Some(variable) = variable {
            text.push_str(&format!("`{variable}`: "));
        }
        let rule = match *section {
            "" => format!("FMI {standard}"),
            RELATED => RELATED.to_owned(),
            section => format!("FMI {standard}, section {section}"),
        };
        text.push_str(&format!("{what} ({rule}): {advice}"));
        f.write_str(&one_line(&text))
    }
}

/// All that was found.
#[derive(Debug, Default)]
pub struct Findings {
    /// The version of the standard that the FMU is of.
    pub(super) standard: Standard,
    listed: Vec<Finding>,
    errors: usize,
    warnings: usize,
}

impl Findings {
    /// The findings, those beyond a thousand left out.
    pub fn listed(&self) -> &[Finding] {
        &self.listed
    }

    /// How many there are, those left out too.
    pub fn count(&self, severity: Severity) -> usize {
        match severity {
            Severity::Error => self.errors,
            Severity::Warning => self.warnings,
        }
    }

    pub(super) fn error(&mut self, at: At, what: impl Into<String>, section: &'static str, advice: impl Into<String>) {
        self.errors += 1;
        self.keep(Severity::Error, at, what.into(), section, advice.into());
    }

    pub(super) fn warning(
        &mut self,
        at: At,
        what: impl Into<String>,
        section: &'static str,
        advice: impl Into<String>,
    ) {
        self.warnings += 1;
        self.keep(Severity::Warning, at, what.into(), section, advice.into());
    }

    fn keep(&mut self, severity: Severity, at: At, what: String, section: &'static str, advice: String) {
        if self.listed.len() < MOST {
            let [what, advice] = [what, advice].map(|text| shortened(&text, LONGEST_TEXT).into_owned());
            // Sections are those of FMI 2.0.
            let section = if self.standard == Standard::Fmi2 { section } else { "" };
            let standard = self.standard.version();
            self.listed.push(Finding {
                severity,
                line: at.line,
                variable: at.variable,
                what,
                standard,
                section,
                advice,
            });
        }
    }
}

/// A text without its middle, if it is too long: the fault may be at its end.
fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    if text.char_indices().nth(most).is_none() {
        return text.into();
    }
    let place = |found: Option<(usize, char)>| found.map_or(text.len(), |(place, _)| place);
    let tail = most / 3;
    let head = &text[..place(text.char_indices().nth(most - tail))];
    format!("{head}…{}", &text[place(text.char_indices().nth_back(tail - 1))..]).into()
}

/// A name as texts show it: where a long one is named in each of many findings, they would fill the memory.
pub(super) fn short(name: &str) -> Cow<'_, str> {
    shortened(name, LONGEST_NAME)
}

/// Where a finding was made.
#[derive(Debug, Clone, Default)]
pub(super) struct At {
    pub line: Option<u32>,
    pub variable: Option<String>,
}

impl At {
    pub fn nowhere() -> Self {
        At::default()
    }

    pub fn line(line: u32) -> Self {
        At { line: Some(line), variable: None }
    }

    /// At a variable, or a type, of this name.
    pub fn named(line: impl Into<Option<u32>>, name: &str) -> Self {
        At { line: line.into(), variable: Some(short(name).into_owned()) }
    }
}

/// Where the lines of a text begin: the document itself counts them anew each time.
#[derive(Debug)]
pub(super) struct Lines(Vec<usize>);

impl Lines {
    pub fn of(text: &str) -> Self {
        Lines(text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(place, _)| place).collect())
    }

    /// The line of an element.
    pub fn of_node(&self, node: Node) -> u32 {
        let start = node.range().start;
        u32::try_from(self.0.partition_point(|&end| end < start) + 1).unwrap_or(u32::MAX)
    }

    pub fn at(&self, node: Node) -> At {
        At::line(self.of_node(node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_too_long_keeps_its_beginning_and_its_end() {
        for (text, most, shown) in
            [("abcdef", 6, "abcdef"), ("abcdefg", 6, "abcd…fg"), ("äöüßäöü", 6, "äöüß…öü"), ("", 3, "")]
        {
            assert_eq!(shortened(text, most), shown);
        }
    }
}
