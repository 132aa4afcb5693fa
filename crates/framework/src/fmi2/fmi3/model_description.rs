//! modelDescription.xml of FMI 3.0 (FMI 3.0.2, section 2.4), with arrays.

use std::io;

use quick_xml::events::{BytesDecl, Event};

use super::arrays::{Entry, entries, references, time};
use crate::fmi2::access::References;
use crate::fmi2::logger;
use crate::fmi2::model_description::{
    Attributes, Role, Xml, choices, element, empty, guid, guid_text, number, of_real, start, text, tolerance,
    write_units,
};
use crate::model::{Extent, Model};
use crate::recording::{Leaf, Method, Operation, Recording};
use crate::structure::Place;
use crate::system::{Causality, Data, Section, Variables};

/// The whole modelDescription.xml.
pub fn xml(model: &Model) -> String {
    text(|xml| write(xml, model))
}

fn write(xml: &mut Xml, model: &Model) -> io::Result<()> {
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let description = model.description();
    let mut root = vec![
        ("fmiVersion", "3.0".to_owned()),
        ("modelName", description.name.clone()),
        ("instantiationToken", guid_text(guid(model))),
        ("description", description.description.clone()),
        ("variableNamingConvention", "structured".to_owned()),
    ];
    root.extend(description.about().filter_map(|(attribute, text)| Some((attribute, text?.to_owned()))));
    root.push(("generationTool", concat!("adaptive-fmu ", env!("CARGO_PKG_VERSION")).to_owned()));
    element(xml, "fmiModelDescription", root, |xml| {
        write_interfaces(xml, &description.name)?;
        // Time has a unit, too.
        write_units(xml, model.variables(), &["s"])?;
        write_types(xml, model.variables())?;
        element(xml, "LogCategories", vec![], |xml| {
            logger::categories(model).try_for_each(|(name, text)| {
                empty(xml, "Category", vec![("name", name.to_owned()), ("description", text.to_owned())])
            })
        })?;
        let experiment = vec![
            ("startTime", "0".to_owned()),
            ("stopTime", number(description.experiment.stop_time)),
            ("tolerance", number(tolerance(model.variables()))),
            ("stepSize", number(description.experiment.step)),
        ];
        empty(xml, "DefaultExperiment", experiment)?;
        let references = references(model);
        element(xml, "ModelVariables", vec![], |xml| write_variables(xml, model, &references))?;
        write_structure(xml, model, &references)
    })
}

fn write_interfaces(xml: &mut Xml, name: &str) -> io::Result<()> {
    let flag = |name, value: bool| (name, value.to_string());
    let common = [
        ("modelIdentifier", name.to_owned()),
        flag("canGetAndSetFMUState", true),
        flag("canSerializeFMUState", true),
        flag("providesDirectionalDerivatives", true),
        flag("providesAdjointDerivatives", true),
        flag("providesPerElementDependencies", true),
    ];
    let model_exchange = [flag("needsCompletedIntegratorStep", true)];
    let co_simulation = [
        flag("canHandleVariableCommunicationStepSize", true),
        ("maxOutputDerivativeOrder", "1".to_owned()),
        flag("mightReturnEarlyFromDoStep", true),
        flag("hasEventMode", true),
    ];
    empty(xml, "ModelExchange", [&common[..], &model_exchange].concat())?;
    empty(xml, "CoSimulation", [&common[..], &co_simulation].concat())
}

fn write_types(xml: &mut Xml, variables: &Variables) -> io::Result<()> {
    let types = choices(variables);
    if types.is_empty() {
        return Ok(());
    }
    element(xml, "TypeDefinitions", vec![], |xml| {
        types.iter().try_for_each(|(name, items)| {
            element(xml, "EnumerationType", vec![("name", (*name).to_owned())], |xml| {
                (1..).zip(*items).try_for_each(|(value, (name, text)): (i32, _)| {
                    let value = ("value", value.to_string());
                    // Answers have other names in this standard.
                    let text = text.replace("fmi2", "fmi3");
                    empty(xml, "Item", vec![("name", name.clone()), value, ("description", text)])
                })
            })
        })
    })
}

fn write_variables(xml: &mut Xml, model: &Model, references: &References) -> io::Result<()> {
    let variables = model.variables();
    write_sizes(xml, model)?;
    let independent = vec![
        ("name", "time".to_owned()),
        ("valueReference", references.outer(time(model)).to_string()),
        ("description", "time".to_owned()),
        ("causality", "independent".to_owned()),
        ("variability", "continuous".to_owned()),
        ("unit", "s".to_owned()),
    ];
    empty(xml, "Float64", independent)?;
    let jumps = jumping_states(model);
    entries(model).try_for_each(|entry| write_variable(xml, model, references, &entry, &jumps))?;
    let indicators = variables.indicators();
    if indicators.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = indicators.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
    let about = if names.is_empty() { String::new() } else { format!(": {}", names.join("; ")) };
    let attributes = vec![
        ("name", "event_indicators".to_owned()),
        ("valueReference", references.outer(References::of_indicators(variables)).to_string()),
        ("description", format!("event indicators{about}")),
        ("causality", "local".to_owned()),
        ("variability", "continuous".to_owned()),
        ("initial", "calculated".to_owned()),
    ];
    element(xml, "Float64", attributes, |xml| {
        if model.sizes().is_empty() {
            return write_dimension(xml, Extent::Fixed(indicators.len()));
        }
        let [rows, columns] = model.sizes().of_indicators();
        write_dimension(xml, rows)?;
        if columns == Extent::Fixed(1) { Ok(()) } else { write_dimension(xml, columns) }
    })
}

/// Structural parameters, whose value references are their numbers.
fn write_sizes(xml: &mut Xml, model: &Model) -> io::Result<()> {
    model.sizes().list().iter().enumerate().try_for_each(|(number, size)| {
        let attributes = vec![
            ("name", size.name.to_owned()),
            ("valueReference", number.to_string()),
            ("description", size.description.to_owned()),
            ("causality", "structuralParameter".to_owned()),
            ("variability", "fixed".to_owned()),
            ("min", "1".to_owned()),
            ("max", size.most.to_string()),
            ("start", size.value.to_string()),
        ];
        empty(xml, "UInt64", attributes)
    })
}

fn write_dimension(xml: &mut Xml, extent: Extent) -> io::Result<()> {
    let attribute = match extent {
        Extent::Fixed(size) => ("start", size.to_string()),
        Extent::Size(number) => ("valueReference", number.to_string()),
    };
    empty(xml, "Dimension", vec![attribute])
}

/// States that events or new parameters may change.
fn jumping_states(model: &Model) -> Vec<bool> {
    let variables = model.variables();
    let recorded = |method| Recording::of(model.system(), method, &variables.layout());
    let methods = [Method::Event, Method::ParametersChanged].map(recorded);
    let changes = |place: usize| {
        let leaf = Operation::Leaf(Leaf::Real(place as u32));
        methods.iter().any(|recording| *recording.tape.operation(recording.reals[place]) != leaf)
    };
    variables.reals(Section::State).map(changes).collect()
}

fn write_variable(
    xml: &mut Xml,
    model: &Model,
    references: &References,
    entry: &Entry,
    jumps: &[bool],
) -> io::Result<()> {
    let (variables, variable) = (model.variables(), entry.element.variable);
    let Role { causality, variability, initial, note, has_start } = Role::of(variable);
    let mut attributes = vec![
        ("name", entry.name()),
        ("valueReference", references.outer(References::of(variables, entry.element)).to_string()),
        ("description", entry.description() + note),
        ("causality", causality.to_owned()),
        ("variability", variability.to_owned()),
    ];
    attributes.extend(initial.map(|initial| ("initial", initial.to_owned())));
    let kind = write_type(&mut attributes, variables, references, entry);
    if variable.section == Section::State && entry.elements().iter().any(|one| jumps[one.place()]) {
        attributes.push(("reinit", "true".to_owned()));
    }
    if has_start {
        let each: Vec<String> = entry.elements().into_iter().map(start).collect();
        attributes.push(("start", each.join(" ")));
    }
    element(xml, kind, attributes, |xml| match entry.shape {
        None => Ok(()),
        Some((shape, dimensions)) => {
            let fixed = shape.map(|size| Extent::Fixed(size as usize));
            let extents = model.sizes().of_variable(entry.number).unwrap_or(fixed);
            extents[..dimensions].iter().try_for_each(|&extent| write_dimension(xml, extent))
        }
    })
}

/// The element of a variable's type; its attributes are added.
fn write_type(
    attributes: &mut Attributes,
    variables: &Variables,
    references: &References,
    entry: &Entry,
) -> &'static str {
    let element = entry.element;
    match &element.variable.data {
        Data::Real { .. } => {
            attributes.extend(of_real(element));
            // There is one for all elements; where these differ, fmi3GetNominalsOfContinuousStates gives each.
            let nominal = element.nominal();
            let is_one = entry.elements().iter().all(|other| other.nominal() == nominal);
            if is_one && (nominal != 1.0 || element.variable.section == Section::State) {
                attributes.push(("nominal", number(nominal)));
            }
            if element.variable.section == Section::Derivative {
                let state = variables.real_at(Section::State, element.place());
                let state = state.map(|state| references.outer(References::of(variables, state)).to_string());
                attributes.extend(state.map(|state| ("derivative", state)));
            }
            "Float64"
        }
        Data::Integer { limits, .. } => {
            attributes
                .extend(limits.iter().flat_map(|(min, max)| [("min", min.to_string()), ("max", max.to_string())]));
            "Int32"
        }
        Data::Boolean { .. } => "Boolean",
        Data::Choice { type_name, items, .. } => {
            attributes.push(("declaredType", type_name.clone()));
            attributes.push(("min", "1".to_owned()));
            attributes.push(("max", items.len().to_string()));
            "Enumeration"
        }
    }
}

fn write_structure(xml: &mut Xml, model: &Model, references: &References) -> io::Result<()> {
    let (variables, structure) = (model.variables(), model.structure());
    let all: Vec<Entry> = entries(model).collect();
    let reference = |entry: &Entry| references.outer(References::of(variables, entry.element));
    // By tables, since large units have tens of thousands of dependencies.
    let mut reals = vec![None; variables.reals(Section::Memory).end];
    let mut integers = vec![None; variables.integers(Section::Memory).end];
    for entry in &all {
        let of = if entry.element.variable.is_real() { &mut reals } else { &mut integers };
        entry.elements().iter().for_each(|one| of[variables.index(*one)] = Some(reference(entry)));
    }
    reals[model.time_place()] = Some(references.outer(time(model)));
    let named = |place: &Place| match *place {
        Place::Real(index) => reals[index],
        Place::Integer(index) => integers[index],
    };
    let running = |entry: &Entry, place: Place| match entry.element.variable.section {
        Section::State => vec![place],
        Section::Discrete => Vec::new(),
        _ => structure.running(place).to_vec(),
    };
    let write = |xml: &mut Xml, name: &str, entry: &Entry, on: &dyn Fn(&Entry, Place) -> Vec<Place>| {
        let places = entry.elements().into_iter().map(|one| Place::of(variables, one));
        let mut found: Vec<u32> = places.flat_map(|place| on(entry, place)).filter_map(|place| named(&place)).collect();
        found.sort_unstable();
        found.dedup();
        let listed = found.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
        empty(xml, name, vec![("valueReference", reference(entry).to_string()), ("dependencies", listed)])
    };
    let is_output = |entry: &&Entry| entry.element.variable.causality == Causality::Output;
    let is_derivative = |entry: &&Entry| entry.element.variable.section == Section::Derivative;
    let is_state = |entry: &&Entry| entry.element.variable.section == Section::State;
    element(xml, "ModelStructure", vec![], |xml| {
        all.iter().filter(is_output).try_for_each(|entry| write(xml, "Output", entry, &running))?;
        // Their order is that of the states in fmi3GetContinuousStates: as they are stored.
        let mut derivatives: Vec<&Entry> = all.iter().filter(is_derivative).collect();
        derivatives.sort_by_key(|entry| entry.element.place());
        derivatives.iter().try_for_each(|entry| write(xml, "ContinuousStateDerivative", entry, &running))?;
        let initial = all.iter().filter(|entry| is_output(entry) || is_derivative(entry) || is_state(entry));
        let starts = |_: &Entry, place: Place| structure.start(place).to_vec();
        initial.into_iter().try_for_each(|entry| write(xml, "InitialUnknown", entry, &starts))?;
        if variables.indicators().is_empty() {
            return Ok(());
        }
        let indicators = references.outer(References::of_indicators(variables)).to_string();
        empty(xml, "EventIndicator", vec![("valueReference", indicators)])
    })
}
