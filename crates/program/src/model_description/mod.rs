//! Reads modelDescription.xml of FMI 2.0 and FMI 3.0, of FMUs from any tool.

mod arrays;
mod model_structure;
mod units;
pub(crate) mod xml;

use std::collections::HashMap;
use std::path::{Component, Path};
use std::sync::Arc;

use roxmltree::{Document, Node};

pub use arrays::{Array, Type};
pub(crate) use model_structure::ModelStructure;
pub use units::{Affine, UnitDefinition};

use self::arrays::Arrays;
use crate::fmi2::calls::Standard;
use crate::system::{NO_LIMIT, Number, TELLS_NO_LIMIT};

/// Content of a modelDescription.xml that a master needs.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelDescription {
    /// Version of the standard.
    pub standard: Standard,
    /// Name of the model.
    pub name: String,
    /// Description.
    pub description: String,
    /// True if it is for co-simulation.
    pub co_simulation: bool,
    /// True if it is for model exchange.
    pub model_exchange: bool,
    /// Identifier of the binaries, those for co-simulation if it supports that.
    pub model_identifier: String,
    /// Identifier of the binaries for model exchange, if it supports that.
    pub exchange_identifier: Option<String>,
    /// GUID; instantiation token in FMI 3.0.
    pub guid: String,
    /// Tool that made it.
    pub generation_tool: String,
    /// Author, version, license and copyright, as far as the file has them.
    pub about: Vec<(&'static str, String)>,
    /// Default start time, s.
    pub start_time: Option<f64>,
    /// Default communication step, s.
    pub step: Option<f64>,
    /// Default stop time, s.
    pub stop_time: Option<f64>,
    /// Capability flags that are true, and numbers, those of co-simulation if it supports that.
    pub capabilities: Vec<(String, String)>,
    /// Log categories.
    pub categories: Vec<String>,
    /// Variables.
    pub variables: Vec<Variable>,
    /// Arrays and scalars of FMI 3.0 with these elements; empty in FMI 2.0.
    pub arrays: Vec<Array>,
    /// Units.
    pub units: Vec<UnitDefinition>,
    /// Outputs with the variables that they depend on, by their places; none if all are possible.
    pub dependencies: Vec<(usize, Option<Vec<usize>>)>,
}

/// A scalar variable, or an element of an array.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// Description.
    pub description: String,
    /// Value reference; in FMI 3.0 its number among the elements of all [`ModelDescription::arrays`].
    pub reference: u32,
    /// parameter, input, output, local, …
    pub causality: String,
    /// fixed, tunable, discrete, continuous, …
    pub variability: String,
    /// Real, Integer, Boolean, String or Enumeration.
    pub kind: String,
    /// Unit.
    pub unit: Option<String>,
    /// Definition of its unit, from the file or from the unit's name; without its offset, where values are differences.
    pub measure: Option<Arc<UnitDefinition>>,
    /// Start value.
    pub start: Option<String>,
    /// Smallest value.
    pub min: Option<String>,
    /// Largest value.
    pub max: Option<String>,
    /// exact, approx or calculated, if the file has it.
    pub initial: Option<String>,
    /// Usual magnitude, if the file has one above 0.
    pub nominal: Option<f64>,
    /// Items of an enumeration with their numbers.
    pub items: Vec<(String, i32)>,
}

/// Attributes that name the origin of an FMU.
pub const ABOUT: [&str; 4] = ["author", "version", "license", "copyright"];

impl Variable {
    /// Smallest and largest value; infinite where the file has none.
    pub fn bounds(&self) -> (f64, f64) {
        let bound = |text: &Option<String>| text.as_ref().and_then(|text| text.trim().parse::<f64>().ok());
        (bound(&self.min).unwrap_or(f64::NEG_INFINITY), bound(&self.max).unwrap_or(f64::INFINITY))
    }

    /// True if this value means no limit according to its description.
    pub fn is_no_limit(&self, value: &str) -> bool {
        let number = value.trim().parse().map(f64::abs);
        self.kind == "Real" && number == Ok(NO_LIMIT) && self.description.ends_with(TELLS_NO_LIMIT)
    }

    /// A value of it for people: "no limit" if its description gives [`NO_LIMIT`] this meaning.
    pub fn shown(&self, value: &str) -> String {
        let number = if self.kind == "Real" { value.trim().parse().ok() } else { None };
        match number {
            Some(_) if self.is_no_limit(value) => "no limit".to_owned(),
            // Its own text, if that is short.
            Some(number) => {
                let short = Number(number).to_string();
                if short.len() + 2 < value.len() { short } else { value.to_owned() }
            }
            None => value.to_owned(),
        }
    }
}

impl ModelDescription {
    /// Reads a modelDescription.xml of FMI 2.0 or 3.0.
    ///
    /// # Errors
    /// Missing or wrong content, with its line.
    pub fn read(xml: &str) -> Result<Self, String> {
        let document = xml::parse(xml).map_err(|error| in_file(&error))?;
        let root = document.root_element();
        let required = |node: Node, name: &str| attribute(node, name).ok_or_else(|| missing(&document, node, name));
        let standard = standard(root)?;
        let (co_simulation, model_exchange) = (child(root, "CoSimulation"), child(root, "ModelExchange"));
        let interface = co_simulation.or(model_exchange).ok_or_else(|| in_file(no_interface(root)))?;
        let model_identifier = identifier(&document, interface)?;
        let exchange_identifier = model_exchange.map(|node| identifier(&document, node)).transpose()?;
        let units = child(root, "UnitDefinitions").into_iter().flat_map(|node| elements(node, "Unit"));
        let units: Vec<UnitDefinition> =
            units.map(UnitDefinition::read).collect::<Result<_, _>>().map_err(|reason| in_file(&reason))?;
        let experiment = child(root, "DefaultExperiment");
        let number = |name| experiment.and_then(|node| node.attribute(name)).and_then(|text| text.parse().ok());
        let categories = child(root, "LogCategories").into_iter().flat_map(|node| elements(node, "Category"));
        let (variables, arrays, dependencies) = match standard {
            Standard::Fmi2 => of_fmi_2(&document, &units)?,
            Standard::Fmi3 => of_fmi_3(&document, &units)?,
        };
        Ok(ModelDescription {
            standard,
            name: required(root, "modelName")?,
            description: attribute(root, "description").unwrap_or_default(),
            co_simulation: co_simulation.is_some(),
            model_exchange: model_exchange.is_some(),
            model_identifier,
            exchange_identifier,
            guid: required(root, if standard == Standard::Fmi2 { "guid" } else { "instantiationToken" })?,
            generation_tool: attribute(root, "generationTool").unwrap_or_default(),
            about: ABOUT.into_iter().filter_map(|name| Some((name, attribute(root, name)?))).collect(),
            start_time: number("startTime"),
            step: number("stepSize"),
            stop_time: number("stopTime"),
            capabilities: interface
                .attributes()
                .filter(|attribute| attribute.name() != "modelIdentifier" && attribute.value() != "false")
                .map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned()))
                .collect(),
            categories: categories.filter_map(|node| attribute(node, "name")).collect(),
            variables,
            arrays,
            units,
            dependencies,
        })
    }

    /// True if a library of this program is in the FMU.
    pub fn is_own(&self) -> bool {
        self.generation_tool.starts_with("adaptive-fmu")
    }

    /// True if it has Event Mode in co-simulation (FMI 3.0).
    pub fn has_event_mode(&self) -> bool {
        let has = |(name, value): &(String, String)| name == "hasEventMode" && (value == "true" || value == "1");
        self.co_simulation && self.capabilities.iter().any(has)
    }

    /// Returns it, if it is for co-simulation.
    ///
    /// # Errors
    /// When it isn't.
    pub fn for_co_simulation(self) -> Result<Self, String> {
        if self.co_simulation { Ok(self) } else { Err(in_file("the FMU does not support co-simulation")) }
    }

    /// The place of a variable.
    pub fn place(&self, name: &str) -> Option<usize> {
        self.variables.iter().position(|variable| variable.name == name)
    }

    /// True if an output depends on an input without delay, by their places; none if the FMU lacks dependencies.
    pub fn is_fed_through(&self, input: usize, output: usize) -> Option<bool> {
        let known = self.dependencies.iter().find(|(place, _)| *place == output);
        known.and_then(|(_, on)| on.as_ref()).map(|on| on.contains(&input))
    }

    /// The variable of a name.
    pub fn variable(&self, name: &str) -> Option<&Variable> {
        self.variables.iter().find(|variable| variable.name == name)
    }
}

/// Variables, their arrays, and dependences of outputs.
type Read = (Vec<Variable>, Vec<Array>, Dependencies);
/// Places of outputs, and of their dependencies; none if all are possible.
type Dependencies = Vec<(usize, Option<Vec<usize>>)>;

fn of_fmi_2(document: &Document, units: &[UnitDefinition]) -> Result<Read, String> {
    let root = document.root_element();
    let (types, mut measures) = (types(root), Measures::new(units));
    let variables = child(root, "ModelVariables").into_iter().flat_map(|node| elements(node, "ScalarVariable"));
    let variables = variables.map(|node| variable(document, node, &types, &mut measures));
    let outputs = child(root, "ModelStructure").and_then(|node| child(node, "Outputs"));
    let outputs = outputs.into_iter().flat_map(|node| elements(node, "Unknown"));
    let variables = variables.collect::<Result<_, _>>()?;
    Ok((variables, Vec::new(), outputs.map(dependencies).collect::<Result<_, _>>().map_err(|reason| in_file(&reason))?))
}

fn of_fmi_3(document: &Document, units: &[UnitDefinition]) -> Result<Read, String> {
    let root = document.root_element();
    let types = child(root, "TypeDefinitions").into_iter().flat_map(|node| node.children());
    let types = types.filter_map(|node| Some((node.attribute("name")?, node))).collect();
    let all = Arrays::read(document, root, &types, &mut Measures::new(units))?;
    let dependencies = child(root, "ModelStructure").map_or(Ok(Vec::new()), |node| all.dependencies(node))?;
    Ok((all.variables, all.arrays, dependencies))
}

/// The version of the standard.
pub(super) fn standard(root: Node) -> Result<Standard, String> {
    match root.attribute("fmiVersion") {
        Some("2.0") => Ok(Standard::Fmi2),
        Some("3.0") => Ok(Standard::Fmi3),
        version => {
            let version = version.unwrap_or("unknown");
            Err(in_file(&format!("FMI version {version}; only 2.0 and 3.0 can be read")))
        }
    }
}

fn no_interface(root: Node) -> &'static str {
    match child(root, "ScheduledExecution") {
        Some(_) => "the FMU is for Scheduled Execution only, whose clocks `adaptive-fmu` can't activate",
        None => "it has neither CoSimulation nor ModelExchange",
    }
}

/// The name of an interface's binaries. It becomes part of a path, and must not be a path itself.
fn identifier(document: &Document, interface: Node) -> Result<String, String> {
    let text =
        attribute(interface, "modelIdentifier").ok_or_else(|| missing(document, interface, "modelIdentifier"))?;
    if Path::new(&text).components().ne([Component::Normal(text.as_ref())]) {
        return Err(in_file(&format!("modelIdentifier = {text}: must be a C identifier")));
    }
    Ok(text)
}

fn in_file(reason: &str) -> String {
    format!("modelDescription.xml: {reason}")
}

/// An output of the model structure and what it depends on. The file counts from 1.
fn dependencies(node: Node) -> Result<(usize, Option<Vec<usize>>), String> {
    let place = |text: &str| {
        let index = text.parse().ok().and_then(|index: usize| index.checked_sub(1));
        index.ok_or_else(|| format!("`{text}` in Outputs must be the index of a variable"))
    };
    let output = place(node.attribute("index").unwrap_or_default())?;
    let on = node.attribute("dependencies").map(|text| text.split_whitespace().map(place).collect());
    Ok((output, on.transpose()?))
}

/// The content of each simple type, by its name.
fn types<'a, 'input>(root: Node<'a, 'input>) -> HashMap<&'a str, Node<'a, 'input>> {
    let types = child(root, "TypeDefinitions").into_iter().flat_map(|node| elements(node, "SimpleType"));
    types.filter_map(|node| Some((node.attribute("name")?, node.children().find(Node::is_element)?))).collect()
}

/// The units of variables, each stored once; by its name, and whether values are differences.
struct Measures(HashMap<(String, bool), Arc<UnitDefinition>>);

impl Measures {
    fn new(units: &[UnitDefinition]) -> Self {
        let both = |unit: &UnitDefinition| {
            let (name, relative) = (unit.name.clone(), unit.clone().relative());
            [((name.clone(), false), Arc::new(unit.clone())), ((name, true), Arc::new(relative))]
        };
        // The first of several with one name counts.
        Measures(units.iter().rev().flat_map(both).collect())
    }

    fn of(&mut self, name: &str, relative: bool) -> Arc<UnitDefinition> {
        let named = || {
            let unit = UnitDefinition::named(name);
            Arc::new(if relative { unit.relative() } else { unit })
        };
        Arc::clone(self.0.entry((name.to_owned(), relative)).or_insert_with(named))
    }
}

fn variable(
    document: &Document,
    node: Node,
    types: &HashMap<&str, Node>,
    measures: &mut Measures,
) -> Result<Variable, String> {
    let required = |name: &str| attribute(node, name).ok_or_else(|| missing(document, node, name));
    let value = node.children().find(Node::is_element).ok_or_else(|| missing(document, node, "type"))?;
    let reference = required("valueReference")?;
    let declared = value.attribute("declaredType").and_then(|name| types.get(name)).copied();
    let of_type = |name| attribute(value, name).or_else(|| declared.and_then(|node| attribute(node, name)));
    let unit = of_type("unit").filter(|unit| !unit.is_empty());
    let relative = matches!(of_type("relativeQuantity").as_deref(), Some("true" | "1"));
    let items = declared.into_iter().flat_map(|node| node.descendants()).filter(|node| node.has_tag_name("Item"));
    Ok(Variable {
        name: required("name")?,
        description: attribute(node, "description").unwrap_or_default(),
        reference: reference.parse().map_err(|_| format!("modelDescription.xml: valueReference = {reference}"))?,
        causality: attribute(node, "causality").unwrap_or_else(|| "local".to_owned()),
        variability: attribute(node, "variability").unwrap_or_else(|| "continuous".to_owned()),
        kind: value.tag_name().name().to_owned(),
        measure: unit.as_deref().map(|unit| measures.of(unit, relative)),
        unit,
        start: attribute(value, "start"),
        min: of_type("min"),
        max: of_type("max"),
        initial: attribute(node, "initial"),
        nominal: of_type("nominal").and_then(|text| text.trim().parse().ok()).filter(|nominal| *nominal > 0.0),
        items: items.filter_map(item).collect(),
    })
}

/// An item of an enumeration; none if it is incomplete.
fn item(node: Node) -> Option<(String, i32)> {
    Some((attribute(node, "name")?, node.attribute("value")?.trim().parse().ok()?))
}

/// The first child element of a name, in any namespace.
pub(crate) fn child<'a, 'input>(node: Node<'a, 'input>, name: &'static str) -> Option<Node<'a, 'input>> {
    elements(node, name).next()
}

/// The child elements of a name, in any namespace.
pub(crate) fn elements<'a, 'input>(
    node: Node<'a, 'input>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'input>> + use<'a, 'input> {
    node.children().filter(move |node| node.is_element() && node.tag_name().name() == name)
}

pub(super) fn attribute(node: Node, name: &str) -> Option<String> {
    node.attribute(name).map(str::to_owned)
}

fn missing(document: &Document, node: Node, name: &str) -> String {
    let line = document.text_pos_at(node.range().start).row;
    format!("modelDescription.xml, line {line}: {} has no {name}", node.tag_name().name())
}
