//! Reading a SystemStructure.ssd.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use roxmltree::Node;

use super::annotation::ANNOTATION;
use super::files::{LoopFiles, is_inside};
use super::parameters::latest;
use super::reader::{Reader, parse};
use super::{Component, Connection, Connector, Structure};
use crate::error::Error;
use crate::exporter::Source;
use crate::model;
use crate::simulation::description::{attribute, child, elements};
use crate::simulation::units::{Affine, UnitDefinition};

const FMU: &str = "application/x-fmu-sharedlibrary";
/// The most components of a loop: each is an FMU that is loaded.
const MOST_COMPONENTS: usize = 1000;
const KINDS: [&str; 5] = ["input", "output", "parameter", "calculatedParameter", "inout"];

impl Structure {
    /// Reads a loop and the parameter files that it names.
    ///
    /// # Errors
    /// What is wrong, with its file and line.
    pub fn read(files: &LoopFiles) -> Result<Self, Error> {
        let (text, file) = (files.structure_text()?, files.structure_file());
        let document = parse(&text, &file)?;
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
        let (system, experiment) = (self.inside(root, "System")?, self.inside(root, "DefaultExperiment")?);
        let ours = self.closed_loop(root, experiment)?;
        let (step, order, accepts_algebraic_loops) = self.master(self.inside(ours, "Master")?)?;
        let units = self.units(root)?;
        let components = self.components(system, &units, files)?;
        let mut structure = Structure {
            file: self.file.to_owned(),
            name: self.plain_name(if ours.has_attribute("name") { ours } else { root })?,
            description: attribute(system, "description").unwrap_or_default(),
            descriptions: descriptions(&components, files)?,
            components,
            connections: self.connections(system)?,
            whole: Vec::new(),
            parameter_files: parameter_files(root),
            start_time: self.number_or(experiment, "startTime", 0.0)?,
            stop_time: self.number(experiment, "stopTime")?,
            step,
            order,
            accepts_algebraic_loops,
            models: elements(ours, "IdealModel").map(|node| self.model(node)).collect::<Result<_, _>>()?,
            metrics: elements(ours, "Metric").map(|node| self.metric(node)).collect::<Result<_, _>>()?,
            plots: elements(ours, "Plot").map(|node| self.plot(node)).collect::<Result<_, _>>()?,
            expected_failure: child(ours, "ExpectedFailure").map(|node| self.expected_failure(node)).transpose()?,
            tuning: child(ours, "Tuning").map(|node| self.tuning(node)).transpose()?,
        };
        // The system's values come last: they prevail over those of its components.
        structure.apply(self.bindings(system, &units, files)?)?;
        Ok(structure)
    }

    /// The content of our annotation: that of the experiment, or of the whole.
    fn closed_loop<'a, 'b>(&self, root: Node<'a, 'b>, experiment: Node<'a, 'b>) -> Result<Node<'a, 'b>, Error> {
        let annotations = [experiment, root].into_iter().filter_map(|node| child(node, "Annotations"));
        let mut annotations = annotations.flat_map(|node| elements(node, "Annotation"));
        let ours = annotations.find(|node| node.attribute("type") == Some(ANNOTATION));
        let ours = ours.ok_or_else(|| self.refuse(root, &format!("there is no annotation {ANNOTATION}")))?;
        self.inside(ours, "ClosedLoop")
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

    fn components(&self, system: Node, units: &[UnitDefinition], files: &LoopFiles) -> Result<Vec<Component>, Error> {
        let mut components: Vec<Component> = Vec::new();
        for node in self.inside(system, "Elements")?.children().filter(Node::is_element) {
            let kind = node.tag_name().name();
            if kind != "Component" {
                return Err(self.refuse(node, &format!("a {kind} among the elements can't be read: only components")));
            }
            let component = self.component(node, units, files)?;
            if components.iter().any(|other| other.name == component.name) {
                return Err(self.refuse(node, &format!("two components are named `{}`", component.name)));
            }
            components.push(component);
            if components.len() > MOST_COMPONENTS {
                return Err(self.refuse(node, &format!("there are more than {MOST_COMPONENTS} components")));
            }
        }
        Ok(components)
    }

    fn component(&self, node: Node, units: &[UnitDefinition], files: &LoopFiles) -> Result<Component, Error> {
        let kind = attribute(node, "type").unwrap_or_else(|| FMU.to_owned());
        if kind != FMU {
            return Err(self.refuse(node, &format!("type = {kind}: must be {FMU}")));
        }
        if node.attribute("implementation") == Some("ModelExchange") {
            return Err(self.refuse(node, "implementation = ModelExchange: units are run by co-simulation"));
        }
        let source = self.required(node, "source")?;
        let fmu = source.strip_prefix("resources/").and_then(|name| name.strip_suffix(".fmu"));
        let fmu = fmu
            .filter(|name| is_inside(name))
            .ok_or_else(|| self.refuse(node, &format!("source = {source}: must be resources/NAME.fmu")))?;
        let values = latest(self.bindings(node, units, files)?);
        let connectors = self.connectors(node, units)?;
        Ok(Component { name: self.required(node, "name")?, fmu: fmu.to_owned(), connectors, values })
    }

    fn connectors(&self, component: Node, units: &[UnitDefinition]) -> Result<Vec<Connector>, Error> {
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

    fn connections(&self, system: Node) -> Result<Vec<Connection>, Error> {
        let connections = child(system, "Connections").into_iter().flat_map(|node| elements(node, "Connection"));
        connections.map(|node| self.connection(node)).collect()
    }

    fn connection(&self, node: Node) -> Result<Connection, Error> {
        let transformation = node.children().find(|child| child.tag_name().name().ends_with("Transformation"));
        let transformation = match transformation {
            None => Affine::IDENTITY,
            Some(linear) if linear.tag_name().name() == "LinearTransformation" => Affine {
                factor: self.number_or(linear, "factor", 1.0)?,
                offset: self.number_or(linear, "offset", 0.0)?,
            },
            Some(other) => {
                let reason = format!("a {} can't be read: only linear ones", other.tag_name().name());
                return Err(self.refuse(other, &reason));
            }
        };
        Ok(Connection {
            from: (self.required(node, "startElement")?, self.required(node, "startConnector")?),
            to: (self.required(node, "endElement")?, self.required(node, "endConnector")?),
            transformation,
            convert_units: !matches!(node.attribute("suppressUnitConversion"), Some("true" | "1")),
            line: self.line(node),
        })
    }
}

/// The descriptions that lie beside a loop, of units that are made of them.
fn descriptions(components: &[Component], files: &LoopFiles) -> Result<BTreeMap<String, Source>, Error> {
    let mut found = BTreeMap::new();
    for fmu in components.iter().map(|component| &component.fmu) {
        if let Some(source) = files.description(fmu)? {
            let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
            let name = model::Description::read(&source.text).map_err(|invalid| refuse(invalid.to_string()))?.name;
            if name != *fmu {
                return Err(refuse(format!("name = `{name}`: must be `{fmu}`, as the file and the loop have it")));
            }
            found.insert(fmu.clone(), source);
        }
    }
    Ok(found)
}

/// The parameter files that a document names, each once.
fn parameter_files(root: Node) -> Vec<String> {
    let bindings = root.descendants().filter(|node| node.tag_name().name() == "ParameterBinding");
    let files: BTreeSet<String> = bindings.filter_map(|node| attribute(node, "source")).collect();
    files.into_iter().collect()
}
