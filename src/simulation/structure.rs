//! SystemStructure.ssd (SSP 1.0): the units of a loop, their connections, and how it is run and judged.

use std::path::Path;

use roxmltree::{Document, Node};

use super::closed_loop::Order;
use super::description::{attribute, child, elements};
use crate::error::Error;

/// Type of our annotation.
const ANNOTATION: &str = "adaptive-fmu.closed-loop";

/// A closed loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Its name.
    pub name: String,
    /// What it shows.
    pub description: String,
    /// Units, in the order in which they are stepped.
    pub components: Vec<Component>,
    /// Connections.
    pub connections: Vec<Connection>,
    /// Start time, s.
    pub start_time: f64,
    /// Stop time, s.
    pub stop_time: f64,
    /// Communication step, s.
    pub step: f64,
    /// When units see each other's new outputs.
    pub order: Order,
    /// Ideal models, simulated beside the loop for comparison.
    pub models: Vec<IdealModel>,
    /// What is measured.
    pub metrics: Vec<Metric>,
    /// What is plotted.
    pub plots: Vec<Plot>,
}

/// A unit of the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Its name in the loop.
    pub name: String,
    /// Name of the FMU.
    pub fmu: String,
    /// Start values: name and value.
    pub values: Vec<(String, String)>,
}

/// A connection from an output to an input, by component and connector.
#[derive(Debug, Clone, PartialEq)]
pub struct Connection {
    /// Where the value comes from.
    pub from: (String, String),
    /// Where it goes.
    pub to: (String, String),
}

/// A linear model numerator/denominator of an input signal, from rest.
#[derive(Debug, Clone, PartialEq)]
pub struct IdealModel {
    /// Name of its output.
    pub name: String,
    /// Its input, `unit.variable`.
    pub input: String,
    /// Coefficients, highest power first.
    pub numerator: Vec<f64>,
    /// Coefficients, highest power first.
    pub denominator: Vec<f64>,
}

/// What is taken of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// Largest magnitude.
    Max,
    /// Root of the mean square.
    Rms,
}

/// A number that judges a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Metric {
    /// What it is.
    pub label: String,
    /// The statistic.
    pub statistic: Statistic,
    /// The signal.
    pub of: String,
    /// What is subtracted from it.
    pub minus: Option<String>,
    /// From when on, s.
    pub from: f64,
    /// The largest value that is as it should be, if one is given.
    pub limit: Option<f64>,
}

/// A diagram.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// Signals.
    pub signals: Vec<String>,
}

/// Reads one document, with its file for messages.
struct Reader<'a> {
    document: &'a Document<'a>,
    file: &'a Path,
}

impl Structure {
    /// Reads a SystemStructure.ssd.
    ///
    /// # Errors
    /// What is wrong, with its line.
    pub fn read(xml: &str, file: &Path) -> Result<Self, Error> {
        let parsed = Document::parse(xml);
        let document = parsed.map_err(|error| Error::Loop { file: file.to_owned(), reason: error.to_string() })?;
        Reader { document: &document, file }.structure()
    }
}

impl Reader<'_> {
    fn refuse(&self, node: Node, reason: &str) -> Error {
        let line = self.document.text_pos_at(node.range().start).row;
        Error::Loop { file: self.file.to_owned(), reason: format!("line {line}: {reason}") }
    }

    fn required(&self, node: Node, name: &str) -> Result<String, Error> {
        attribute(node, name).ok_or_else(|| self.refuse(node, &format!("{} has no {name}", node.tag_name().name())))
    }

    fn number(&self, node: Node, name: &str) -> Result<f64, Error> {
        let text = self.required(node, name)?;
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.refuse(node, &format!("{name} = {text}: must be a finite number")))
    }

    fn numbers(&self, node: Node, name: &str) -> Result<Vec<f64>, Error> {
        let text = self.required(node, name)?;
        let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        numbers.map_err(|_| self.refuse(node, &format!("{name} = {text}: must be numbers")))
    }

    fn inside<'a, 'b>(&self, node: Node<'a, 'b>, name: &'static str) -> Result<Node<'a, 'b>, Error> {
        child(node, name).ok_or_else(|| self.refuse(node, &format!("{} has no {name}", node.tag_name().name())))
    }

    fn structure(&self) -> Result<Structure, Error> {
        let root = self.document.root_element();
        if root.tag_name().name() != "SystemStructureDescription" {
            return Err(self.refuse(root, "this is not a SystemStructureDescription"));
        }
        let system = self.inside(root, "System")?;
        let experiment = self.inside(root, "DefaultExperiment")?;
        let annotations = child(root, "Annotations").into_iter().flat_map(|node| elements(node, "Annotation"));
        let mut ours = annotations.filter(|node| node.attribute("type") == Some(ANNOTATION));
        let ours = ours.next().ok_or_else(|| self.refuse(root, &format!("there is no annotation {ANNOTATION}")))?;
        let master = self.inside(ours, "Master")?;
        let components = elements(self.inside(system, "Elements")?, "Component").map(|node| self.component(node));
        let connections = child(system, "Connections").into_iter().flat_map(|node| elements(node, "Connection"));
        let structure = Structure {
            name: self.required(root, "name")?,
            description: attribute(system, "description").unwrap_or_default(),
            components: components.collect::<Result<_, _>>()?,
            connections: connections.map(|node| self.connection(node)).collect::<Result<_, _>>()?,
            start_time: self.number(experiment, "startTime")?,
            stop_time: self.number(experiment, "stopTime")?,
            step: self.number(master, "step")?,
            order: self.order(master)?,
            models: elements(ours, "IdealModel").map(|node| self.model(node)).collect::<Result<_, _>>()?,
            metrics: elements(ours, "Metric").map(|node| self.metric(node)).collect::<Result<_, _>>()?,
            plots: elements(ours, "Plot").map(|node| self.plot(node)).collect::<Result<_, _>>()?,
        };
        if structure.step <= 0.0 {
            return Err(self.refuse(master, &format!("step = {}: must be above 0", structure.step)));
        }
        let repeated = |name: &String| structure.components.iter().filter(|other| other.name == *name).count() > 1;
        if let Some(component) = structure.components.iter().find(|component| repeated(&component.name)) {
            return Err(self.refuse(system, &format!("two components are named `{}`", component.name)));
        }
        Ok(structure)
    }

    fn order(&self, master: Node) -> Result<Order, Error> {
        let text = self.required(master, "order")?;
        text.parse().map_err(|reason: String| self.refuse(master, &reason))
    }

    fn component(&self, node: Node) -> Result<Component, Error> {
        let source = self.required(node, "source")?;
        let fmu = source.strip_prefix("resources/").and_then(|name| name.strip_suffix(".fmu"));
        let plain = |name: &&str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let fmu = fmu
            .filter(plain)
            .ok_or_else(|| self.refuse(node, &format!("source = {source}: must be resources/NAME.fmu")))?;
        let parameters = node.descendants().filter(|node| node.has_tag_name("Parameter") || is_parameter(*node));
        let values = parameters.map(|parameter| {
            let value = parameter.children().find(Node::is_element);
            let value = value.ok_or_else(|| self.refuse(parameter, "a Parameter has no value"))?;
            Ok((self.required(parameter, "name")?, self.required(value, "value")?))
        });
        Ok(Component {
            name: self.required(node, "name")?,
            fmu: fmu.to_owned(),
            values: values.collect::<Result<_, Error>>()?,
        })
    }

    fn connection(&self, node: Node) -> Result<Connection, Error> {
        Ok(Connection {
            from: (self.required(node, "startElement")?, self.required(node, "startConnector")?),
            to: (self.required(node, "endElement")?, self.required(node, "endConnector")?),
        })
    }

    fn model(&self, node: Node) -> Result<IdealModel, Error> {
        let (numerator, denominator) = (self.numbers(node, "numerator")?, self.numbers(node, "denominator")?);
        let proper = numerator.len() < denominator.len() && denominator.first().is_some_and(|&first| first != 0.0);
        if !proper || denominator.len() > 30 {
            return Err(
                self.refuse(node, "an IdealModel must be strictly proper, with a first denominator coefficient not 0")
            );
        }
        let (name, input) = (self.required(node, "name")?, self.required(node, "input")?);
        Ok(IdealModel { name, input, numerator, denominator })
    }

    fn metric(&self, node: Node) -> Result<Metric, Error> {
        let statistic = match self.required(node, "statistic")?.as_str() {
            "max" => Statistic::Max,
            "rms" => Statistic::Rms,
            other => return Err(self.refuse(node, &format!("statistic = {other}: must be max or rms"))),
        };
        let optional = |name: &str| node.attribute(name).map(|_| self.number(node, name)).transpose();
        Ok(Metric {
            label: self.required(node, "label")?,
            statistic,
            of: self.required(node, "of")?,
            minus: attribute(node, "minus"),
            from: optional("from")?.unwrap_or(f64::NEG_INFINITY),
            limit: optional("limit")?,
        })
    }

    fn plot(&self, node: Node) -> Result<Plot, Error> {
        let signals = self.required(node, "signals")?.split_whitespace().map(str::to_owned).collect();
        Ok(Plot { title: self.required(node, "title")?, signals })
    }
}

fn is_parameter(node: Node) -> bool {
    node.is_element() && node.tag_name().name() == "Parameter"
}
