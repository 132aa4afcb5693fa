//! Reader for all SSP files: attributes, numbers, and refusals with a line.

use std::path::Path;

use roxmltree::{Document, Node};

use super::Origin;
use crate::error::Error;
use crate::model_description::UnitDefinition;
use crate::model_description::xml;
use crate::model_description::{attribute, child, elements};

/// A document, with its file for messages.
pub(super) struct Reader<'a> {
    pub document: &'a Document<'a>,
    pub file: &'a Path,
    /// Ends of its lines.
    line_ends: Vec<usize>,
}

/// The document of a text.
pub fn parse<'a>(text: &'a str, file: &Path) -> Result<Document<'a>, Error> {
    xml::parse(text).map_err(|reason| Error::Loop { file: file.to_owned(), reason })
}

impl<'a> Reader<'a> {
    pub fn new(document: &'a Document<'a>, file: &'a Path) -> Self {
        let line_ends = document.input_text().match_indices('\n').map(|(place, _)| place).collect();
        Reader { document, file, line_ends }
    }
}

impl Reader<'_> {
    pub fn line(&self, node: Node) -> u32 {
        let before = self.line_ends.partition_point(|&end| end < node.range().start);
        u32::try_from(before + 1).unwrap_or(u32::MAX)
    }

    pub fn origin(&self, node: Node) -> Origin {
        Origin { file: self.file.to_owned(), line: Some(self.line(node)) }
    }

    pub fn refuse(&self, node: Node, reason: &str) -> Error {
        self.origin(node).refuse(reason)
    }

    pub fn required(&self, node: Node, name: &str) -> Result<String, Error> {
        let element = node.tag_name().name();
        let text = attribute(node, name).ok_or_else(|| self.refuse(node, &format!("{element} has no {name}")))?;
        if text.contains(char::is_control) {
            return Err(self.refuse(node, &format!("{name} = {text}: must not contain control characters")));
        }
        Ok(text)
    }

    pub fn number(&self, node: Node, name: &str) -> Result<f64, Error> {
        let text = self.required(node, name)?;
        let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.refuse(node, &format!("{name} = {text}: must be a finite number")))
    }

    pub fn number_or(&self, node: Node, name: &str, default: f64) -> Result<f64, Error> {
        node.attribute(name).map_or(Ok(default), |_| self.number(node, name))
    }

    pub fn numbers(&self, node: Node, name: &str) -> Result<Vec<f64>, Error> {
        let text = self.required(node, name)?;
        let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        let numbers = numbers.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        numbers.ok_or_else(|| self.refuse(node, &format!("{name} = {text}: must be finite numbers")))
    }

    pub fn inside<'a, 'b>(&self, node: Node<'a, 'b>, name: &'static str) -> Result<Node<'a, 'b>, Error> {
        child(node, name).ok_or_else(|| self.refuse(node, &format!("{} has no {name}", node.tag_name().name())))
    }

    /// The units that a file defines.
    pub fn units(&self, root: Node) -> Result<Vec<UnitDefinition>, Error> {
        let units = child(root, "Units").into_iter().flat_map(|node| elements(node, "Unit"));
        units.map(|node| UnitDefinition::read(node).map_err(|reason| self.refuse(node, &reason))).collect()
    }

    /// The unit of measurement that an element names: one of the file's, else one parsed from the name.
    pub fn unit(&self, node: Node, units: &[UnitDefinition]) -> Option<UnitDefinition> {
        let name = attribute(node, "unit").filter(|name| !name.is_empty())?;
        let found = units.iter().find(|unit| unit.name == name).cloned();
        Some(found.unwrap_or_else(|| UnitDefinition::named(&name)))
    }
}
