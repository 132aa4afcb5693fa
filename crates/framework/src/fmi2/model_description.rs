//! modelDescription.xml, written from the declared variables (FMI 2.0.4, section 2.2).

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};
use uuid::Uuid;

use crate::model::{Description, Model};
use crate::structure::Place;
use crate::system::{BASE_UNITS, Base, Causality, Data, Element, Section, Unit, Variability, Variable, Variables};

use super::access::References;
use super::logger;

/// End of the description of a constant that an FMU was designed with.
pub const DESIGNED: &str = " (designed at export)";

/// The file of a source unit that is compiled; it includes all others.
pub const SOURCE: &str = "all.c";

pub(super) type Xml = Writer<Vec<u8>>;
pub(super) type Attributes<'a> = Vec<(&'a str, String)>;

/// The GUID of a model: a name-based UUID of its description and of all that its system declares, which is the content
/// of the XML. So the same FMU always has the same GUID, and different ones have different ones.
pub fn guid(model: &Model) -> [u8; 16] {
    let Description { name, model: system, description, experiment, structure, designed, fmi, .. } =
        model.description();
    let about: Vec<_> = model.description().about().collect();
    let own = (name, system, description, experiment, structure, about);
    // Not the XML itself: an instance checks its GUID when it is made, and the XML of a large unit takes milliseconds.
    let identity = match designed {
        None => serde_json::to_vec(&(own, model.variables().declared())),
        // A unit with sources is another one than that without, even if its variables are the same.
        Some(_) => serde_json::to_vec(&(own, SOURCE, model.variables().declared())),
    };
    // In FMI 3.0 its variables have other names and value references.
    let identity = identity.map(|bytes| if *fmi == Some(3) { [b"3.0", &bytes[..]].concat() } else { bytes });
    // Numbers and texts in lists and tables can be written to memory.
    debug_assert!(identity.is_ok());
    Uuid::new_v5(&Uuid::NAMESPACE_OID, &identity.unwrap_or_default()).into_bytes()
}

/// A GUID as the XML shows it.
pub fn guid_text(guid: [u8; 16]) -> String {
    format!("{{{}}}", Uuid::from_bytes(guid))
}

/// The whole modelDescription.xml.
pub fn xml(model: &Model) -> String {
    text(|xml| write(xml, model))
}

/// The text that a function writes.
pub(super) fn text(write: impl FnOnce(&mut Xml) -> io::Result<()>) -> String {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    let written = write(&mut xml);
    // Writing to memory can't fail.
    debug_assert!(written.is_ok());
    let mut text = String::from_utf8(xml.into_inner()).unwrap_or_default();
    text.push('\n');
    text
}

pub(super) fn element(
    xml: &mut Xml,
    name: &str,
    attributes: Attributes,
    inside: impl Fn(&mut Xml) -> io::Result<()>,
) -> io::Result<()> {
    let start = xml.create_element(name).with_attributes(attributes.iter().map(|(key, value)| (*key, value.as_str())));
    start.write_inner_content(inside)?;
    Ok(())
}

pub(super) fn empty(xml: &mut Xml, name: &str, attributes: Attributes) -> io::Result<()> {
    let start = xml.create_element(name).with_attributes(attributes.iter().map(|(key, value)| (*key, value.as_str())));
    start.write_empty()?;
    Ok(())
}

pub(super) fn number(value: f64) -> String {
    // As people write large numbers: 1e15.
    if value.is_finite() && value.abs() >= 1e9 { format!("{value:e}") } else { format!("{value:?}") }
}

fn write(xml: &mut Xml, model: &Model) -> io::Result<()> {
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let description = model.description();
    let mut root = vec![
        ("fmiVersion", "2.0".to_owned()),
        ("modelName", description.name.clone()),
        ("guid", guid_text(guid(model))),
        ("description", description.description.clone()),
        ("variableNamingConvention", "structured".to_owned()),
        ("numberOfEventIndicators", model.variables().indicators().len().to_string()),
    ];
    root.extend(description.about().filter_map(|(attribute, text)| Some((attribute, text?.to_owned()))));
    root.push(("generationTool", concat!("adaptive-fmu ", env!("CARGO_PKG_VERSION")).to_owned()));
    element(xml, "fmiModelDescription", root, |xml| {
        write_interfaces(xml, model)?;
        write_units(xml, model.variables(), &[])?;
        write_types(xml, model.variables())?;
        element(xml, "LogCategories", vec![], |xml| {
            for (name, text) in logger::categories(model) {
                empty(xml, "Category", vec![("name", name.to_owned()), ("description", text.to_owned())])?;
            }
            Ok(())
        })?;
        let experiment = vec![
            ("startTime", "0".to_owned()),
            ("stopTime", number(description.experiment.stop_time)),
            ("tolerance", number(tolerance(model.variables()))),
            ("stepSize", number(description.experiment.step)),
        ];
        empty(xml, "DefaultExperiment", experiment)?;
        let variables = model.variables();
        element(xml, "ModelVariables", vec![], |xml| {
            let index = index_of_states(variables);
            variables.visible().try_for_each(|element| write_variable(xml, variables, element, &index))
        })?;
        write_structure(xml, model)
    })
}

/// The error that an FMU tolerates by default. An FMU without states tolerates none, but masters ask for a number.
pub(super) fn tolerance(variables: &Variables) -> f64 {
    variables.find("relative_tolerance").map_or(1e-6, |element| element.start())
}

fn write_interfaces(xml: &mut Xml, model: &Model) -> io::Result<()> {
    let flag = |name, value: bool| (name, value.to_string());
    let identifier = ("modelIdentifier", model.description().name.clone());
    let common = [
        flag("canNotUseMemoryManagementFunctions", true),
        flag("canGetAndSetFMUstate", true),
        flag("canSerializeFMUstate", true),
        flag("providesDirectionalDerivative", true),
    ];
    let model_exchange = [identifier.clone(), flag("completedIntegratorStepNotNeeded", false)];
    let co_simulation = [
        identifier,
        flag("canHandleVariableCommunicationStepSize", true),
        flag("canInterpolateInputs", !model.variables().reals(Section::Input).is_empty()),
        ("maxOutputDerivativeOrder", "1".to_owned()),
    ];
    let is_source = model.description().designed.is_some();
    for (name, own) in [("ModelExchange", &model_exchange[..]), ("CoSimulation", &co_simulation)] {
        let attributes = [own, &common].concat();
        if is_source {
            element(xml, name, attributes, |xml| {
                element(xml, "SourceFiles", vec![], |xml| empty(xml, "File", vec![("name", SOURCE.to_owned())]))
            })?;
        } else {
            empty(xml, name, attributes)?;
        }
    }
    Ok(())
}

/// Definitions of the units of variables, and of these.
pub(super) fn write_units(xml: &mut Xml, variables: &Variables, further: &[&'static str]) -> io::Result<()> {
    let of_variables = variables.visible().map(|element| element.unit()).filter(|unit| !unit.is_empty());
    let mut symbols: Vec<_> = of_variables.chain(further.iter().copied()).collect();
    symbols.sort_unstable();
    symbols.dedup();
    if symbols.is_empty() {
        return Ok(());
    }
    element(xml, "UnitDefinitions", vec![], |xml| {
        for unit in symbols.iter().map(|symbol| Unit::of(symbol)) {
            element(xml, "Unit", vec![("name", unit.symbol.to_owned())], |xml| {
                unit.base.iter().try_for_each(|base| empty(xml, "BaseUnit", base_unit(base)))?;
                unit.display.iter().try_for_each(|display| {
                    let factor = number(display.factor);
                    empty(xml, "DisplayUnit", vec![("name", display.symbol.to_owned()), ("factor", factor)])
                })
            })?;
        }
        Ok(())
    })
}

/// The attributes of a BaseUnit that aren't what they are by default.
fn base_unit(base: &Base) -> Attributes<'static> {
    let exponents = BASE_UNITS.into_iter().zip(base.exponents).filter(|(_, n)| *n != 0);
    let mut attributes: Attributes = exponents.map(|(base, n)| (base, n.to_string())).collect();
    attributes.extend((base.factor != 1.0).then(|| ("factor", number(base.factor))));
    attributes.extend((base.offset != 0.0).then(|| ("offset", number(base.offset))));
    attributes
}

/// Types of choices, with the name and the description of each item.
pub(super) fn choices(variables: &Variables) -> Vec<(&str, &[(String, String)])> {
    let mut types: Vec<(&str, &[(String, String)])> = Vec::new();
    for element in variables.visible() {
        if let Data::Choice { type_name, items, .. } = &element.variable.data
            && !types.iter().any(|(name, _)| name == type_name)
        {
            types.push((type_name, items));
        }
    }
    types
}

fn write_types(xml: &mut Xml, variables: &Variables) -> io::Result<()> {
    let types = choices(variables);
    if types.is_empty() {
        return Ok(());
    }
    element(xml, "TypeDefinitions", vec![], |xml| {
        for (name, items) in &types {
            element(xml, "SimpleType", vec![("name", (*name).to_owned())], |xml| {
                element(xml, "Enumeration", vec![], |xml| {
                    items.iter().enumerate().try_for_each(|(k, (name, text))| {
                        let value = (k + 1).to_string();
                        empty(
                            xml,
                            "Item",
                            vec![("name", name.clone()), ("value", value), ("description", text.clone())],
                        )
                    })
                })
            })?;
        }
        Ok(())
    })
}

/// Position (from 1) among the visible variables of each state.
fn index_of_states(variables: &Variables) -> Vec<usize> {
    let mut index = vec![0; variables.states()];
    for (position, element) in variables.visible().enumerate() {
        if element.variable.section == Section::State {
            index[element.place()] = position + 1;
        }
    }
    index
}

/// Role of a variable, in words of both standards.
pub(super) struct Role {
    pub causality: &'static str,
    pub variability: &'static str,
    pub initial: Option<&'static str>,
    /// The end of its description.
    pub note: &'static str,
    pub has_start: bool,
}

impl Role {
    pub fn of(variable: &Variable) -> Self {
        let is_designed = variable.variability == Variability::Constant;
        let (causality, initial) = match variable.causality {
            _ if is_designed => ("local", Some("exact")),
            Causality::Parameter => ("parameter", Some("exact")),
            Causality::Input => ("input", None),
            Causality::Output => ("output", Some("calculated")),
            Causality::Local | Causality::Hidden => ("local", Some("calculated")),
        };
        let variability = match variable.variability {
            Variability::Constant => "constant",
            Variability::Fixed => "fixed",
            Variability::Tunable => "tunable",
            Variability::Discrete => "discrete",
            Variability::Continuous => "continuous",
        };
        let note = if is_designed { DESIGNED } else { "" };
        let has_start = matches!(variable.causality, Causality::Parameter | Causality::Input);
        Role { causality, variability, initial, note, has_start }
    }
}

/// The start value of an element.
pub(super) fn start(element: Element<'_>) -> String {
    match &element.variable.data {
        Data::Real { .. } => number(element.start()),
        Data::Integer { start, .. } | Data::Choice { start, .. } => start.to_string(),
        Data::Boolean { start } => start.to_string(),
    }
}

/// Unit and limits of a real number.
pub(super) fn of_real(element: Element<'_>) -> Attributes<'static> {
    let Data::Real { min, max, .. } = &element.variable.data else { return Vec::new() };
    let mut attributes = Vec::new();
    let unit = Some(element.unit()).filter(|unit| !unit.is_empty()).map(Unit::of);
    attributes.extend(unit.map(|unit| ("unit", unit.symbol.to_owned())));
    let display = unit.and_then(|unit| unit.display).filter(|_| !element.variable.shown.in_own_unit);
    attributes.extend(display.map(|display| ("displayUnit", display.symbol.to_owned())));
    attributes.extend(min.map(|min| ("min", number(min))));
    attributes.extend(max.map(|max| ("max", number(max))));
    attributes
}

fn write_variable(xml: &mut Xml, variables: &Variables, element: Element<'_>, states: &[usize]) -> io::Result<()> {
    let variable = element.variable;
    let Role { causality, variability, initial, note, has_start } = Role::of(variable);
    let mut attributes = vec![
        ("name", element.name()),
        ("valueReference", References::of(variables, element).to_string()),
        ("description", [element.description().as_ref(), note].concat()),
        ("causality", causality.to_owned()),
        ("variability", variability.to_owned()),
    ];
    attributes.extend(initial.map(|initial| ("initial", initial.to_owned())));
    self::element(xml, "ScalarVariable", attributes, |xml| {
        let (kind, mut value) = type_of(element, states);
        if has_start {
            value.push(("start", start(element)));
        }
        empty(xml, kind, value)
    })
}

/// The element for a variable's type, with its attributes but for the start value.
fn type_of(element: Element<'_>, states: &[usize]) -> (&'static str, Attributes<'static>) {
    let mut attributes = Vec::new();
    let kind = match &element.variable.data {
        Data::Real { .. } => {
            attributes.extend(of_real(element));
            // Solvers take their tolerances from those of states; some tools warn where a state has none.
            if element.nominal() != 1.0 || element.variable.section == Section::State {
                attributes.push(("nominal", number(element.nominal())));
            }
            if element.variable.section == Section::Derivative {
                attributes.push(("derivative", states[element.place()].to_string()));
            }
            "Real"
        }
        Data::Integer { limits, .. } => {
            attributes
                .extend(limits.iter().flat_map(|(min, max)| [("min", min.to_string()), ("max", max.to_string())]));
            "Integer"
        }
        Data::Boolean { .. } => "Boolean",
        Data::Choice { type_name, items, .. } => {
            attributes.push(("declaredType", type_name.clone()));
            attributes.push(("min", "1".to_owned()));
            attributes.push(("max", items.len().to_string()));
            "Enumeration"
        }
    };
    (kind, attributes)
}

/// Numbers with spaces between.
fn listed(numbers: &[usize]) -> String {
    let mut text = String::new();
    for number in numbers {
        if !text.is_empty() {
            text.push(' ');
        }
        text.push_str(&number.to_string());
    }
    text
}

fn write_structure(xml: &mut Xml, model: &Model) -> io::Result<()> {
    let (variables, structure) = (model.variables(), model.structure());
    let visible: Vec<_> = variables.visible().collect();
    // By tables, since large units have tens of thousands of dependencies.
    let mut reals = vec![None; variables.reals(Section::Memory).end];
    let mut integers = vec![None; variables.integers(Section::Memory).end];
    for (k, element) in visible.iter().enumerate() {
        let positions = if element.variable.is_real() { &mut reals } else { &mut integers };
        positions[variables.index(*element)] = Some(k + 1);
    }
    let position = |place: &Place| match *place {
        Place::Real(index) => reals[index],
        Place::Integer(index) => integers[index],
    };
    let unknown = |xml: &mut Xml, k: usize, on: &[Place]| {
        let mut indices: Vec<_> = on.iter().filter_map(position).collect();
        indices.sort_unstable();
        empty(xml, "Unknown", vec![("index", (k + 1).to_string()), ("dependencies", listed(&indices))])
    };
    let list = |xml: &mut Xml,
                name: &str,
                wanted: &dyn Fn(&Element<'_>) -> bool,
                on: &dyn Fn(Element<'_>, Place) -> Vec<Place>| {
        let mut found: Vec<_> = visible.iter().enumerate().filter(|(_, e)| wanted(e)).collect();
        if found.is_empty() {
            return Ok(());
        }
        if name == "Derivatives" {
            // Their order is that of the states in fmi2GetContinuousStates: as they are stored.
            found.sort_by_key(|(_, e)| e.place());
        }
        element(xml, name, vec![], |xml| {
            found.iter().try_for_each(|&(k, e)| unknown(xml, k, &on(*e, Place::of(variables, *e))))
        })
    };
    let output = |e: &Element<'_>| e.variable.causality == Causality::Output;
    let derivative = |e: &Element<'_>| e.variable.section == Section::Derivative;
    let running = |e: Element<'_>, place: Place| match e.variable.section {
        // A state depends on itself.
        Section::State => vec![place],
        // What changes at events and with completed steps only.
        Section::Discrete => Vec::new(),
        _ => structure.running(place).to_vec(),
    };
    element(xml, "ModelStructure", vec![], |xml| {
        list(xml, "Outputs", &output, &running)?;
        list(xml, "Derivatives", &derivative, &running)?;
        let initial = |e: &Element<'_>| output(e) || derivative(e) || e.variable.section == Section::State;
        list(xml, "InitialUnknowns", &initial, &|_, place| structure.start(place).to_vec())
    })
}
