//! The states of an FMU, as its modelDescription.xml declares them.

use roxmltree::Node;

use crate::model_description::xml;
use crate::model_description::{attribute, child, elements};

/// Which variables are states, derivatives and outputs: by their places among the variables.
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
    /// Model exchange, where the FMU is for it.
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
    /// What is missing or wrong.
    pub fn read(xml: &str) -> Result<Self, String> {
        let document = xml::parse(xml).map_err(|error| format!("modelDescription.xml: {error}"))?;
        let root = document.root_element();
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
        let start = child(root, "DefaultExperiment").and_then(|node| node.attribute("startTime")?.parse().ok());
        let exchange = child(root, "ModelExchange").map(|node| Exchange {
            model_identifier: attribute(node, "modelIdentifier").unwrap_or_default(),
            directional: matches!(node.attribute("providesDirectionalDerivative"), Some("true" | "1")),
        });
        Ok(ModelStructure {
            states: unknowns("Derivatives").map(|derivative| state_of(derivative?)).collect::<Result<_, String>>()?,
            indicators: root.attribute("numberOfEventIndicators").and_then(|text| text.parse().ok()).unwrap_or(0),
            outputs: unknowns("Outputs").collect::<Result<_, _>>()?,
            start_time: start.unwrap_or(0.0),
            exchange,
        })
    }
}

/// A place that is counted from 1 in the file.
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
            "<fmiModelDescription><ModelVariables><ScalarVariable name='x'><Real/></ScalarVariable>\
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
