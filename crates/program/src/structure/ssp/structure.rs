//! Reading a SystemStructure.ssd.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

use roxmltree::Node;

use super::annotation::ANNOTATION;
use super::files::LoopFiles;
use super::parameters::latest;
use super::reader::{Reader, parse};
use super::source::UnitFile;
use super::system::System;
use super::{Component, Connection, Connector, Structure};
use crate::error::Error;
use crate::exporter::Source;
use crate::model;
use crate::model_description::{Affine, UnitDefinition};
use crate::model_description::{attribute, child, elements};
use crate::structure::Order;
use crate::text_file;

const FMU: &str = "application/x-fmu-sharedlibrary";
const KINDS: [&str; 8] =
    ["input", "output", "parameter", "calculatedParameter", "inout", "structuralParameter", "constant", "local"];

impl Structure {
    /// Reads a loop and the parameter files that it names.
    ///
    /// # Errors
    /// If something is wrong, with its file and line.
    pub fn read(files: &LoopFiles) -> Result<Self, Error> {
        Structure::parse(&files.structure_text()?, files)
    }

    /// Reads a loop of existing files from another text than their own.
    ///
    /// # Errors
    /// If something is wrong, with its file and line.
    pub fn parse(text: &str, files: &LoopFiles) -> Result<Self, Error> {
        let file = files.structure_file();
        let document = parse(text, &file)?;
        Reader::new(&document, &file).structure(files)
    }
}

impl Reader<'_> {
    fn structure(&self, files: &LoopFiles) -> Result<Structure, Error> {
        let root = self.document.root_element();
        if root.tag_name().name() != "SystemStructureDescription" {
            return Err(self.refuse(root, "this is not a SystemStructureDescription"));
        }
        let version = self.required(root, "version")?;
        if !version.starts_with("1.") {
            return Err(self.refuse(root, &format!("version = {version}: only 1.x can be read")));
        }
        let (system, experiment) = (self.inside(root, "System")?, child(root, "DefaultExperiment"));
        let ours = closed_loop(root, experiment).map(|node| self.inside(node, "ClosedLoop")).transpose()?;
        let master = ours.map(|ours| self.master(self.inside(ours, "Master")?)).transpose()?;
        let (step, order, accepts_algebraic_loops) = master.unwrap_or((0.0, Order::GaussSeidel, false));
        let units = self.units(root)?;
        let System { components, connections, values, .. } = self.system(system, &units, files)?;
        let number = |name| experiment.filter(|it| it.has_attribute(name)).map(|it| self.number(it, name)).transpose();
        let read = |name| ours.into_iter().flat_map(move |ours| elements(ours, name));
        let mut structure = Structure {
            file: self.file.to_owned(),
            name: self.name(root, ours)?,
            description: attribute(system, "description").unwrap_or_default(),
            descriptions: descriptions(&components, files)?,
            components,
            connections,
            whole: Vec::new(),
            parameter_files: parameter_files(root),
            start_time: number("startTime")?.unwrap_or(0.0),
            stop_time: 0.0,
            step,
            order,
            asked_order: None,
            accepts_algebraic_loops,
            models: read("IdealModel").map(|node| self.model(node)).collect::<Result<_, _>>()?,
            metrics: read("Metric").map(|node| self.metric(node)).collect::<Result<_, _>>()?,
            plots: read("Plot").map(|node| self.plot(node)).collect::<Result<_, _>>()?,
            expected_failure: read("ExpectedFailure").next().map(|node| self.expected_failure(node)).transpose()?,
            tuning: read("Tuning").next().map(|node| self.tuning(node)).transpose()?,
            events: read("Event").map(|node| self.event(node)).collect::<Result<_, _>>()?,
            notes: files.chosen().map(|name| format!("the structure of the archive is {name}")).into_iter().collect(),
        };
        structure.stop_time = number("stopTime")?.unwrap_or_else(|| structure.proposed_stop_time());
        // The system's values come last, since they override those of its components.
        structure.apply(values)?;
        if ours.is_none() {
            structure.choose_defaults(root);
        }
        Ok(structure)
    }

    /// The loop's name. In another tool's name, characters that no folder should have are replaced.
    fn name(&self, root: Node, ours: Option<Node>) -> Result<String, Error> {
        match ours {
            Some(ours) => self.plain_name(if ours.has_attribute("name") { ours } else { root }),
            None => {
                let plain = |c: char| if c.is_alphanumeric() || "_-. ".contains(c) { c } else { '_' };
                let name: String = self.required(root, "name")?.chars().map(plain).collect();
                Ok(if name.is_empty() || name.starts_with('.') { format!("_{name}") } else { name })
            }
        }
    }

    /// The loop's name, which names a folder of results and an archive.
    fn plain_name(&self, node: Node) -> Result<String, Error> {
        let name = self.required(node, "name")?;
        let plain = name.chars().all(|c| c.is_alphanumeric() || "_-. ".contains(c)) && !name.starts_with('.');
        if name.is_empty() || !plain {
            return Err(self.refuse(node, &format!("name = {name}: must be letters, digits, _, -, spaces and dots")));
        }
        Ok(name)
    }

    pub fn component(&self, node: Node, units: &[UnitDefinition], files: &LoopFiles) -> Result<Component, Error> {
        let kind = attribute(node, "type").unwrap_or_else(|| FMU.to_owned());
        if kind != FMU {
            return Err(self.refuse(node, &format!("type = {kind}: must be {FMU}")));
        }
        if node.attribute("implementation") == Some("ModelExchange") {
            return Err(self.refuse(node, "implementation = ModelExchange: components must be co-simulation FMUs"));
        }
        let source = self.required(node, "source")?;
        let (mut fmu, file) = files.unit(&source).map_err(|reason| self.refuse(node, &reason))?;
        if let UnitFile::Description(path) = &file {
            fmu = name_of(path).unwrap_or(fmu);
        }
        let values = latest(self.bindings(node, units, files)?);
        let connectors = self.connectors(node, units)?;
        Ok(Component { name: self.required(node, "name")?, source, fmu, file, connectors, values })
    }

    pub fn connectors(&self, component: Node, units: &[UnitDefinition]) -> Result<Vec<Connector>, Error> {
        let (mut connectors, mut names) = (Vec::new(), HashSet::new());
        for node in child(component, "Connectors").into_iter().flat_map(|node| elements(node, "Connector")) {
            let (name, kind) = (self.required(node, "name")?, self.required(node, "kind")?);
            if !KINDS.contains(&kind.as_str()) {
                return Err(self.refuse(node, &format!("kind = {kind}: must be one of {}", KINDS.join(", "))));
            }
            if !names.insert(name.clone()) {
                return Err(self.refuse(node, &format!("two connectors are named `{name}`")));
            }
            let types = ["Real", "Integer", "Boolean", "String", "Enumeration", "Binary"];
            let data_type = types.into_iter().find_map(|kind| child(node, kind));
            let unit = data_type.and_then(|node| self.unit(node, units));
            let data_type = data_type.map(|node| node.tag_name().name().to_owned());
            connectors.push(Connector { name, kind, data_type, unit, line: self.line(node) });
        }
        Ok(connectors)
    }

    /// A linear transformation.
    pub fn linear(&self, node: Node) -> Result<Affine, Error> {
        if node.tag_name().name() != "LinearTransformation" {
            return Err(
                self.refuse(node, &format!("a {} can't be read. Use LinearTransformation", node.tag_name().name()))
            );
        }
        Ok(Affine { factor: self.number_or(node, "factor", 1.0)?, offset: self.number_or(node, "offset", 0.0)? })
    }

    /// A connection; the element of an end that is a connector of the system itself is empty.
    pub fn connection(&self, node: Node) -> Result<Connection, Error> {
        let transformation = node.children().find(|child| child.tag_name().name().ends_with("Transformation"));
        let transformation = transformation.map_or(Ok(Affine::IDENTITY), |node| self.linear(node))?;
        let element = |name| attribute(node, name).unwrap_or_default();
        Ok(Connection {
            from: (element("startElement"), self.required(node, "startConnector")?),
            to: (element("endElement"), self.required(node, "endConnector")?),
            transformation,
            convert_units: !matches!(node.attribute("suppressUnitConversion"), Some("true" | "1")),
            line: self.line(node),
        })
    }
}

/// Our annotation: that of the experiment, or of the root.
fn closed_loop<'a, 'b>(root: Node<'a, 'b>, experiment: Option<Node<'a, 'b>>) -> Option<Node<'a, 'b>> {
    let annotations = [experiment, Some(root)].into_iter().flatten().filter_map(|node| child(node, "Annotations"));
    let mut annotations = annotations.flat_map(|node| elements(node, "Annotation"));
    annotations.find(|node| node.attribute("type") == Some(ANNOTATION))
}

/// The name in a description; one that can't be read is reported when it is used.
fn name_of(description: &Path) -> Option<String> {
    let text = text_file::read(description).ok()?;
    model::Description::read(&text).ok().map(|description| description.name)
}

/// The descriptions of a loop's components that aren't this package's.
fn descriptions(components: &[Component], files: &LoopFiles) -> Result<BTreeMap<String, Source>, Error> {
    let mut found: BTreeMap<String, Source> = BTreeMap::new();
    for Component { fmu, file, .. } in components {
        let source = match file {
            UnitFile::Description(path) => {
                let text = text_file::read(path).map_err(Error::file(path))?;
                Some(Source::read(files.shown(path), text))
            }
            _ => files.description(fmu)?,
        };
        let Some(source) = source else { continue };
        let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
        let name = model::Description::read(&source.text).map_err(|invalid| refuse(invalid.to_string()))?.name;
        if name != *fmu {
            return Err(refuse(format!("name = `{name}`: must be `{fmu}`, the name in the file and the loop")));
        }
        if let Some(other) = found.get(fmu).filter(|other| other.text != source.text) {
            return Err(refuse(format!("`{fmu}` is a different FMU in {}", other.file.display())));
        }
        found.insert(fmu.clone(), source);
    }
    Ok(found)
}

/// The parameter files and their mappings that a document names, each once.
fn parameter_files(root: Node) -> Vec<String> {
    let kinds = ["ParameterBinding", "ParameterMapping"];
    let bindings = root.descendants().filter(|node| kinds.contains(&node.tag_name().name()));
    let files: BTreeSet<String> = bindings.filter_map(|node| attribute(node, "source")).collect();
    files.into_iter().collect()
}
