//! What all SSP files have in common: attributes, numbers, and refusals with a line.

use std::path::Path;

use roxmltree::{Document, Node};

use super::Origin;
use crate::error::Error;
use crate::simulation::description::{attribute, child, elements};
use crate::simulation::units::UnitDefinition;

/// A document, with its file for messages.
pub(super) struct Reader<'a> {
    pub document: &'a Document<'a>,
    pub file: &'a Path,
}

/// The document of a text.
pub(super) fn parse<'a>(text: &'a str, file: &Path) -> Result<Document<'a>, Error> {
    Document::parse(text).map_err(|error| Error::Loop { file: file.to_owned(), reason: error.to_string() })
}

impl Reader<'_> {
    pub fn line(&self, node: Node) -> u32 {
        self.document.text_pos_at(node.range().start).row
    }

    pub fn origin(&self, node: Node) -> Origin {
        Origin { file: self.file.to_owned(), line: Some(self.line(node)) }
    }

    pub fn refuse(&self, node: Node, reason: &str) -> Error {
        self.origin(node).refuse(reason)
    }

    pub fn required(&self, node: Node, name: &str) -> Result<String, Error> {
        attribute(node, name).ok_or_else(|| self.refuse(node, &format!("{} has no {name}", node.tag_name().name())))
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
        numbers.map_err(|_| self.refuse(node, &format!("{name} = {text}: must be numbers")))
    }

    pub fn inside<'a, 'b>(&self, node: Node<'a, 'b>, name: &'static str) -> Result<Node<'a, 'b>, Error> {
        child(node, name).ok_or_else(|| self.refuse(node, &format!("{} has no {name}", node.tag_name().name())))
    }

    /// The units that a file defines.
    pub fn units(&self, root: Node) -> Result<Vec<UnitDefinition>, Error> {
        let units = child(root, "Units").into_iter().flat_map(|node| elements(node, "Unit"));
        units.map(|node| UnitDefinition::read(node).map_err(|reason| self.refuse(node, &reason))).collect()
    }

    /// The unit that an element names, which must be one of the file's.
    pub fn unit(&self, node: Node, units: &[UnitDefinition]) -> Result<Option<UnitDefinition>, Error> {
        let Some(name) = node.attribute("unit") else { return Ok(None) };
        let found = units.iter().find(|unit| unit.name == name);
        let found =
            found.ok_or_else(|| self.refuse(node, &format!("unit = {name}: is not among the Units of this file")));
        found.map(|unit| Some(unit.clone()))
    }
}
