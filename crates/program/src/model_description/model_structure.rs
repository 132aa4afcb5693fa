//! The states of an FMU, as its modelDescription.xml declares them.

use std::collections::HashMap;

use roxmltree::{Document, Node};

use super::arrays::{Arrays, variables};
use super::{Measures, attribute, child, elements, standard, xml};
use crate::fmi2::calls::Standard;

/// States, derivatives and outputs, by their places among the variables.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelStructure {
    /// States and their derivatives.
    pub states: Vec<(usize, usize)>,
    /// Number of event indicators.
    pub indicators: usize,
    /// Outputs.
    pub outputs: Vec<usize>,
    /// Default start time, s.
    pub start_time: f64,
    /// Model exchange, if the FMU supports it.
    pub exchange: Option<Exchange>,
}

/// Model exchange of an FMU.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exchange {
    /// Identifier of its binaries.
    pub model_identifier: String,
    /// True if it gives directional derivatives.
    pub directional: bool,
}

impl ModelStructure {
    /// Reads it from a modelDescription.xml.
    ///
    /// # Errors
    /// Missing or wrong content.
    pub fn read(xml: &str) -> Result<Self, String> {
        let document = xml::parse(xml).map_err(|error| format!("modelDescription.xml: {error}"))?;
        let root = document.root_element();
        match standard(root)? {
            Standard::Fmi2 => Self::of_fmi_2(root),
            Standard::Fmi3 => Self::of_fmi_3(&document),
        }
    }

    fn of_fmi_2(root: Node) -> Result<Self, String> {
        let variables: Vec<_> =
            child(root, "ModelVariables").into_iter().flat_map(|node| elements(node, "ScalarVariable")).collect();
        let unknowns = |name| {
            let list = child(root, "ModelStructure").and_then(|node| child(node, name));
            list.into_iter()
                .flat_map(|node| elements(node, "Unknown"))
                .map(|node| place(node, "index", variables.len()))
        };
        let state_of = |derivative: usize| {
            let value = variables[derivative].children().find(Node::is_element);
            let value = value.ok_or_else(|| "modelDescription.xml: a derivative has no type".to_owned())?;
            Ok((place(value, "derivative", variables.len())?, derivative))
        };
        Ok(ModelStructure {
            states: unknowns("Derivatives").map(|derivative| state_of(derivative?)).collect::<Result<_, String>>()?,
            indicators: root.attribute("numberOfEventIndicators").and_then(|text| text.parse().ok()).unwrap_or(0),
            outputs: unknowns("Outputs").collect::<Result<_, _>>()?,
            start_time: start_time(root),
            exchange: exchange(root, "providesDirectionalDerivative"),
        })
    }

    fn of_fmi_3(document: &Document) -> Result<Self, String> {
        let root = document.root_element();
        let all = Arrays::read(document, root, &HashMap::new(), &mut Measures::new(&[]))?;
        let structure = |name| child(root, "ModelStructure").into_iter().flat_map(move |node| elements(node, name));
        let places = |node: Node| all.places(node.attribute("valueReference").unwrap_or_default());
        let state_of: HashMap<&str, &str> = variables(root)
            .filter_map(|node| Some((node.attribute("valueReference")?, node.attribute("derivative")?)))
            .collect();
        let (mut states, mut indicators, mut outputs) = (Vec::new(), 0, Vec::new());
        for node in structure("ContinuousStateDerivative") {
            let derivatives = places(node)?;
            let state = node.attribute("valueReference").and_then(|derivative| state_of.get(derivative));
            let of = all.places(
                state.ok_or("modelDescription.xml: a ContinuousStateDerivative without the attribute derivative")?,
            )?;
            if of.len() != derivatives.len() {
                return Err("modelDescription.xml: a state and its derivative have different sizes".to_owned());
            }
            states.extend(of.zip(derivatives));
        }
        for node in structure("EventIndicator") {
            indicators += places(node)?.len();
        }
        for node in structure("Output") {
            outputs.extend(places(node)?);
        }
        let exchange = exchange(root, "providesDirectionalDerivatives");
        Ok(ModelStructure { states, indicators, outputs, start_time: start_time(root), exchange })
    }
}

fn start_time(root: Node) -> f64 {
    let start = child(root, "DefaultExperiment").and_then(|node| node.attribute("startTime")?.parse().ok());
    start.unwrap_or(0.0)
}

/// Model exchange, and true if a flag of it is set.
fn exchange(root: Node, directional: &str) -> Option<Exchange> {
    child(root, "ModelExchange").map(|node| Exchange {
        model_identifier: attribute(node, "modelIdentifier").unwrap_or_default(),
        directional: matches!(node.attribute(directional), Some("true" | "1")),
    })
}

/// A place, which the file counts from 1.
fn place(node: Node, name: &str, count: usize) -> Result<usize, String> {
    let text = node.attribute(name).unwrap_or_default();
    let index = text.parse().ok().filter(|index| (1..=count).contains(index));
    let wrong = || format!("modelDescription.xml: {name} = \"{text}\": must be the index of one of {count} variables");
    index.map(|index| index - 1).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description(structure: &str) -> String {
        format!(
            "<fmiModelDescription fmiVersion='2.0'><ModelVariables><ScalarVariable name='x'><Real/></ScalarVariable>\
             <ScalarVariable name='der(x)'><Real derivative='1'/></ScalarVariable></ModelVariables>\
             <ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
        )
    }

    #[test]
    fn a_state_is_what_a_derivative_derives() {
        let xml = description("<Outputs><Unknown index='1'/></Outputs><Derivatives><Unknown index='2'/></Derivatives>");
        let structure = ModelStructure::read(&xml).unwrap();
        assert_eq!((structure.states, structure.outputs), (vec![(0, 1)], vec![0]));
        assert_eq!(structure.exchange, None);
    }

    #[test]
    fn an_index_of_no_variable_is_refused() {
        for wrong in ["index='0'", "index='3'", "index='-1'", ""] {
            let xml = description(&format!("<Derivatives><Unknown {wrong}/></Derivatives>"));
            assert!(ModelStructure::read(&xml).unwrap_err().contains("must be the index of one of 2 variables"));
        }
        let no_derivative = description("<Derivatives><Unknown index='1'/></Derivatives>");
        assert!(ModelStructure::read(&no_derivative).unwrap_err().contains("derivative"));
    }
}
