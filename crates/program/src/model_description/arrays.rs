//! Reads variables of FMI 3.0: each element of an array is a variable of its own, named as in FMI 2.0.

use std::collections::HashMap;
use std::ops::Range;

use roxmltree::{Document, Node};
use serde::{Deserialize, Serialize};

use super::{Dependencies, Measures, Variable, attribute, elements, in_file, item, missing};

/// The most elements of all arrays together.
const MOST_ELEMENTS: usize = 1_000_000;

/// The type of a variable's values, as FMI 3.0 names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)] // named as in the standard
pub enum Type {
    Float32,
    Float64,
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Int64,
    UInt64,
    Boolean,
    String,
    Enumeration,
}

impl Type {
    const ALL: [(&'static str, Type); 13] = [
        ("Float32", Type::Float32),
        ("Float64", Type::Float64),
        ("Int8", Type::Int8),
        ("UInt8", Type::UInt8),
        ("Int16", Type::Int16),
        ("UInt16", Type::UInt16),
        ("Int32", Type::Int32),
        ("UInt32", Type::UInt32),
        ("Int64", Type::Int64),
        ("UInt64", Type::UInt64),
        ("Boolean", Type::Boolean),
        ("String", Type::String),
        ("Enumeration", Type::Enumeration),
    ];

    /// Type of an element of `ModelVariables`; none for a Binary or a Clock.
    fn of(node: Node) -> Option<Self> {
        Self::ALL.iter().find(|(name, _)| node.has_tag_name(*name)).map(|(_, one)| *one)
    }

    /// Its least and largest number.
    pub fn range(self) -> (f64, f64) {
        match self {
            Type::Float32 => (f32::MIN.into(), f32::MAX.into()),
            Type::Int8 => (i8::MIN.into(), i8::MAX.into()),
            Type::UInt8 => (u8::MIN.into(), u8::MAX.into()),
            Type::Int16 => (i16::MIN.into(), i16::MAX.into()),
            Type::UInt16 => (u16::MIN.into(), u16::MAX.into()),
            Type::UInt32 => (u32::MIN.into(), u32::MAX.into()),
            Type::UInt64 => (0.0, u64::MAX as f64),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Name of the type in FMI 2.0 that it is read as.
    fn in_fmi_2(self) -> &'static str {
        match self {
            Type::Float32 | Type::Float64 => "Real",
            Type::Boolean => "Boolean",
            Type::String => "String",
            Type::Enumeration => "Enumeration",
            _ => "Integer",
        }
    }
}

/// A variable of FMI 3.0: an array, or a scalar, which has one element. Elements of all arrays are numbered
/// consecutively; these numbers are the references of the variables that they are read as.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Array {
    /// Its name.
    pub name: String,
    /// Its value reference.
    pub reference: u32,
    /// Number of its elements.
    pub count: usize,
    /// Type of its values.
    pub of: Type,
    /// Start values, if the file has them and they are numbers.
    pub start: Option<Vec<f64>>,
}

/// All variables.
pub(super) struct Arrays {
    /// A variable for each element, and for each of its other names.
    pub variables: Vec<Variable>,
    pub arrays: Vec<Array>,
    /// Places of the variables of a value reference.
    places: HashMap<u32, Range<usize>>,
}

impl Arrays {
    /// Reads them from `ModelVariables`.
    pub fn read(
        document: &Document,
        root: Node,
        types: &HashMap<&str, Node>,
        measures: &mut Measures,
    ) -> Result<Self, String> {
        let mut all = Arrays { variables: Vec::new(), arrays: Vec::new(), places: HashMap::new() };
        let declared = || variables(root).filter(Node::is_element);
        let sizes: HashMap<&str, &str> = declared()
            .filter(|node| node.attribute("causality") == Some("structuralParameter"))
            .filter_map(|node| Some((node.attribute("valueReference")?, node.attribute("start")?)))
            .collect();
        let mut count = 0;
        for node in declared() {
            let Some(of) = Type::of(node) else {
                refuse_clock(node)?;
                // A Binary has no value here, and no place.
                let reference = node.attribute("valueReference").and_then(|text| text.trim().parse().ok());
                all.places.extend(reference.map(|reference| (reference, 0..0)));
                continue;
            };
            let base = variable(document, node, of, types, measures)?;
            let shape = shape(node, &base.name, &sizes)?;
            let (reference, size) = (base.reference, shape.iter().try_fold(1usize, |all, n| all.checked_mul(*n)));
            let size = size.filter(|size| count + size <= MOST_ELEMENTS);
            let size =
                size.ok_or_else(|| in_file(&format!("its variables have more than {MOST_ELEMENTS} elements")))?;
            let starts = starts(node, of, size).map_err(|reason| in_file(&format!("`{}`: {reason}", base.name)))?;
            let first = all.variables.len();
            all.add(&base, None, &shape, &starts, count..count + size);
            let places = first..all.variables.len();
            if all.places.insert(reference, places).is_some() {
                return Err(in_file(&format!(
                    "`{}`: another variable has valueReference = {reference}, too",
                    base.name
                )));
            }
            for alias in elements(node, "Alias") {
                all.add(&base, Some(alias), &shape, &starts, count..count + size);
            }
            let numbers = starts.iter().map(|text| number(text)).collect::<Option<Vec<f64>>>();
            let start = numbers.filter(|numbers| numbers.len() == size && size > 0);
            all.arrays.push(Array { name: base.name, reference, count: size, of, start });
            count += size;
        }
        Ok(all)
    }

    /// Adds the elements of an array under its name or another one.
    fn add(&mut self, base: &Variable, alias: Option<Node>, shape: &[usize], starts: &[String], numbers: Range<usize>) {
        let of_alias = |name: &str| alias.and_then(|node| attribute(node, name));
        let name = of_alias("name").unwrap_or_else(|| base.name.clone());
        let description = of_alias("description").unwrap_or_else(|| base.description.clone());
        // One text for each element, as this package writes it, or one for all.
        let each: Vec<&str> = description.split("; ").collect();
        for (k, number) in numbers.clone().enumerate() {
            let own = if each.len() == numbers.len() { each[k] } else { &description };
            self.variables.push(Variable {
                name: element_name(&name, shape, k),
                description: own.to_owned(),
                reference: number as u32,
                start: starts.get(k).cloned(),
                ..base.clone()
            });
        }
    }

    /// Places of the elements of a value reference.
    pub fn places(&self, reference: &str) -> Result<Range<usize>, String> {
        let found = reference.trim().parse().ok().and_then(|reference: u32| self.places.get(&reference));
        found.cloned().ok_or_else(|| in_file(&format!("there is no variable with valueReference = \"{reference}\"")))
    }

    /// Outputs with the variables that they depend on: the file has arrays, so each element depends on all elements.
    pub fn dependencies(&self, structure: Node) -> Result<Dependencies, String> {
        let mut all = Vec::new();
        for node in elements(structure, "Output") {
            let outputs = self.places(node.attribute("valueReference").unwrap_or_default())?;
            let on = node
                .attribute("dependencies")
                .map(|text| text.split_whitespace().map(|one| self.places(one)).collect::<Result<Vec<_>, _>>());
            let on = on.transpose()?.map(|places| places.into_iter().flatten().collect::<Vec<_>>());
            all.extend(outputs.map(|output| (output, on.clone())));
        }
        Ok(all)
    }
}

/// The children of `ModelVariables`.
pub(super) fn variables<'a, 'input>(root: Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    elements(root, "ModelVariables").flat_map(|node| node.children())
}

/// Refuses a clock: without its activation, an FMU lacks what it computes then.
fn refuse_clock(node: Node) -> Result<(), String> {
    let is_clock = node.has_tag_name("Clock");
    let name = node.attribute("name").unwrap_or_default();
    let refused = is_clock.then(|| in_file(&format!("`{name}` is a Clock, which `adaptive-fmu` can't activate")));
    refused.map_or(Ok(()), Err)
}

/// A variable as a whole: its name without indices, no start value.
fn variable(
    document: &Document,
    node: Node,
    of: Type,
    types: &HashMap<&str, Node>,
    measures: &mut Measures,
) -> Result<Variable, String> {
    let required = |name: &str| attribute(node, name).ok_or_else(|| missing(document, node, name));
    let reference = required("valueReference")?;
    let declared = node.attribute("declaredType").and_then(|name| types.get(name)).copied();
    let of_type = |name| attribute(node, name).or_else(|| declared.and_then(|node| attribute(node, name)));
    let unit = of_type("unit").filter(|unit| !unit.is_empty());
    let relative = matches!(of_type("relativeQuantity").as_deref(), Some("true" | "1"));
    let is_float = matches!(of, Type::Float32 | Type::Float64);
    let by_default = if is_float { "continuous" } else { "discrete" };
    let items = declared.into_iter().flat_map(|node| elements(node, "Item"));
    Ok(Variable {
        name: required("name")?,
        description: attribute(node, "description").unwrap_or_default(),
        reference: reference.trim().parse().map_err(|_| in_file(&format!("valueReference = {reference}")))?,
        causality: attribute(node, "causality").unwrap_or_else(|| "local".to_owned()),
        variability: attribute(node, "variability").unwrap_or_else(|| by_default.to_owned()),
        kind: of.in_fmi_2().to_owned(),
        measure: unit.as_deref().map(|unit| measures.of(unit, relative)),
        unit,
        start: None,
        min: of_type("min"),
        max: of_type("max"),
        initial: attribute(node, "initial"),
        nominal: of_type("nominal").and_then(|text| text.trim().parse().ok()).filter(|nominal| *nominal > 0.0),
        items: items.filter_map(item).collect(),
    })
}

/// Sizes of the dimensions of an array; empty for a scalar.
fn shape(node: Node, name: &str, sizes: &HashMap<&str, &str>) -> Result<Vec<usize>, String> {
    let size = |dimension: Node| {
        let by_parameter = || dimension.attribute("valueReference").and_then(|of| sizes.get(of)).copied();
        let text = dimension.attribute("start").or_else(by_parameter);
        let size = text.and_then(|text| text.trim().parse().ok());
        size.ok_or_else(|| {
            in_file(&format!("`{name}`: a Dimension needs start, or the valueReference of a structuralParameter"))
        })
    };
    elements(node, "Dimension").map(size).collect()
}

/// Start values: one for each element, or one for all; those of texts are elements of their own.
fn starts(node: Node, of: Type, count: usize) -> Result<Vec<String>, String> {
    let texts: Vec<String> = match of {
        Type::String => elements(node, "Start").filter_map(|start| attribute(start, "value")).collect(),
        _ => node.attribute("start").unwrap_or_default().split_whitespace().map(str::to_owned).collect(),
    };
    match texts.len() {
        0 => Ok(texts),
        1 => Ok(vec![texts[0].clone(); count]),
        given if given == count => Ok(texts),
        given => Err(format!("{given} start values, but {count} elements")),
    }
}

/// A start value as a number, a Boolean as 0 or 1.
fn number(text: &str) -> Option<f64> {
    match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        _ => text.parse().ok(),
    }
}

/// The name of an element, counted row by row: `x[2]`, `A[1,2]`, `der(x[2])`.
fn element_name(name: &str, shape: &[usize], k: usize) -> String {
    if shape.is_empty() {
        return name.to_owned();
    }
    let (mut rest, mut indices) = (k, Vec::new());
    for size in shape.iter().rev() {
        indices.push((rest % size + 1).to_string());
        rest /= size;
    }
    indices.reverse();
    let indices = indices.join(",");
    let of_rate = name.strip_prefix("der(").and_then(|name| name.strip_suffix(')'));
    of_rate.map_or_else(|| format!("{name}[{indices}]"), |state| format!("der({state}[{indices}])"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_description::{ModelDescription, ModelStructure};

    fn description(variables: &str, structure: &str) -> String {
        format!(
            "<fmiModelDescription fmiVersion='3.0' modelName='M' instantiationToken='t'>\
             <CoSimulation modelIdentifier='M'/><ModelVariables>{variables}</ModelVariables>\
             <ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
        )
    }

    fn names(description: &ModelDescription) -> Vec<&str> {
        description.variables.iter().map(|variable| variable.name.as_str()).collect()
    }

    #[test]
    fn elements_are_named_row_by_row_with_their_start_values() {
        let xml = description(
            "<UInt64 name='n' valueReference='7' causality='structuralParameter' start='2'/>\
             <Float64 name='A' valueReference='3' causality='parameter' variability='fixed' start='1 2 3 4 5 6'>\
             <Dimension valueReference='7'/><Dimension start='3'/></Float64>\
             <Int32 name='k' valueReference='1' causality='input' start='4'><Dimension start='2'/></Int32>\
             <Float64 name='der(x)' valueReference='9'><Dimension start='1'/></Float64>",
            "",
        );
        let read = ModelDescription::read(&xml).unwrap();
        let expected = ["n", "A[1,1]", "A[1,2]", "A[1,3]", "A[2,1]", "A[2,2]", "A[2,3]", "k[1]", "k[2]", "der(x[1])"];
        assert_eq!(names(&read), expected);
        let starts: Vec<_> = read.variables.iter().map(|variable| variable.start.as_deref().unwrap_or("-")).collect();
        assert_eq!(starts, ["2", "1", "2", "3", "4", "5", "6", "4", "4", "-"]);
        assert!(read.variables.iter().enumerate().all(|(k, variable)| variable.reference == k as u32));
        assert_eq!(read.arrays[1].start.as_deref(), Some(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0][..]));
        assert_eq!((read.arrays[3].reference, read.arrays[3].count, read.arrays[3].of), (9, 1, Type::Float64));
    }

    #[test]
    fn another_name_is_a_variable_with_the_same_reference() {
        let xml = description("<Float64 name='a' valueReference='1'><Alias name='b'/></Float64>", "");
        let read = ModelDescription::read(&xml).unwrap();
        assert_eq!((names(&read), read.variables[1].reference), (vec!["a", "b"], 0));
    }

    #[test]
    fn states_outputs_and_indicators_are_those_of_the_elements() {
        let xml = description(
            "<Float64 name='u' valueReference='4' causality='input' start='0'/>\
             <Float64 name='x' valueReference='1'><Dimension start='2'/></Float64>\
             <Float64 name='der(x)' valueReference='2' derivative='1'><Dimension start='2'/></Float64>\
             <Float64 name='y' valueReference='5' causality='output'><Dimension start='2'/></Float64>\
             <Float64 name='z' valueReference='6'><Dimension start='3'/></Float64>",
            "<Output valueReference='5' dependencies='4'/><ContinuousStateDerivative valueReference='2'/>\
             <EventIndicator valueReference='6'/>",
        );
        let structure = ModelStructure::read(&xml).unwrap();
        assert_eq!((structure.states, structure.indicators, structure.outputs), (vec![(1, 3), (2, 4)], 3, vec![5, 6]));
        let read = ModelDescription::read(&xml).unwrap();
        assert_eq!(read.dependencies, [(5, Some(vec![0])), (6, Some(vec![0]))]);
    }

    #[test]
    fn what_is_wrong_is_refused_with_its_name() {
        let of = |variables: &str, structure: &str| ModelDescription::read(&description(variables, structure));
        for (variables, structure, reason) in [
            ("<Float64 name='x' valueReference='1'><Dimension/></Float64>", "", "`x`: a Dimension needs start"),
            ("<Float64 name='x' valueReference='1' start='1 2'><Dimension start='3'/></Float64>", "", "2 start values"),
            ("<Clock name='c' valueReference='1'/>", "", "`c` is a Clock"),
            ("<Float64 name='x'/>", "", "has no valueReference"),
            ("<Float64 name='x' valueReference='1'/><Int8 name='y' valueReference='1'/>", "", "`y`: another variable"),
            ("", "<Output valueReference='5'/>", "no variable with valueReference = \"5\""),
            (
                "<Float64 name='x' valueReference='1'><Dimension start='4000000000'/><Dimension start='9000000000'/></Float64>",
                "",
                "more than 1000000 elements",
            ),
        ] {
            let refused = of(variables, structure).unwrap_err();
            assert!(refused.contains(reason), "{refused}");
        }
    }
}
