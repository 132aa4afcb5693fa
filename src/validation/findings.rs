//! What was found, and where.

use std::fmt;

use roxmltree::Node;
use serde::Serialize;

use crate::error::one_line;

/// More findings than this are only counted: a person mends the first ones first.
const MOST: usize = 1000;

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
    /// What is wrong.
    pub what: String,
    /// The section of FMI 2.0 that tells how it must be.
    pub section: &'static str,
    /// What to do.
    pub advice: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Finding { severity, line, variable, what, section, advice } = self;
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
        text.push_str(&format!("{what} (FMI 2.0, section {section}): {advice}"));
        f.write_str(&one_line(&text))
    }
}

/// All that was found.
#[derive(Debug, Default)]
pub struct Findings {
    kept: Vec<Finding>,
    errors: usize,
    warnings: usize,
}

impl Findings {
    /// The findings, those beyond a thousand left out.
    pub fn kept(&self) -> &[Finding] {
        &self.kept
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
        if self.kept.len() < MOST {
            self.kept.push(Finding { severity, line: at.line, variable: at.variable, what, section, advice });
        }
    }
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
