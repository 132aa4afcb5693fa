//! Checks modelDescription.xml of FMI 3.0 as far as a run needs it.

use std::collections::{HashMap, HashSet};

use super::Interfaces;
use super::experiment::{USUAL_STEPS, interface};
use super::findings::{At, Findings, Lines};
use crate::fmi2::calls::Standard;
use crate::model_description::{ModelDescription, ModelStructure, Variable, xml};

/// The version of the standard; FMI 2.0 if missing, as its checks report that.
pub(super) fn standard(text: &str) -> Standard {
    let document = xml::parse(text).ok();
    let version = document.as_ref().and_then(|document| document.root_element().attribute("fmiVersion"));
    if version.is_some_and(|version| version.trim().starts_with("3.")) { Standard::Fmi3 } else { Standard::Fmi2 }
}

/// Checks a modelDescription.xml; returns its interfaces, if they can be read.
pub(super) fn check_description(text: &str, findings: &mut Findings) -> Option<Interfaces> {
    let read = ModelDescription::read(text).and_then(|read| Ok((read, ModelStructure::read(text)?)));
    let (description, structure) = match read {
        Ok(read) => read,
        Err(reason) => {
            let advice =
                "correct modelDescription.xml, or export the FMU for co-simulation or model exchange without clocks";
            findings.error(At::nowhere(), reason, "", advice);
            return None;
        }
    };
    let mut names = HashMap::new();
    for (place, variable) in description.variables.iter().enumerate() {
        if names.insert(variable.name.as_str(), place).is_some() {
            let what = "another variable already has this name";
            findings.error(At::named(None, &variable.name), what, "", "give each variable a unique name");
        }
        check_variable(variable, findings);
    }
    interfaces(text, &description, &structure)
}

fn check_variable(variable: &Variable, findings: &mut Findings) {
    let at = || At::named(None, &variable.name);
    let needs = matches!(variable.causality.as_str(), "parameter" | "structuralParameter" | "input")
        || variable.variability == "constant";
    if needs && variable.start.is_none() {
        let what = format!("there is no start value, but causality = \"{}\" requires one", variable.causality);
        findings.error(at(), what, "", "give it a start value");
    }
    if variable.variability == "continuous" && variable.kind != "Real" {
        let what = format!("variability = \"continuous\", but the type is {}", variable.kind);
        findings.error(at(), what, "", "only Float32 and Float64 can be continuous");
    }
    let (least, most) = variable.bounds();
    let start = variable.start.as_deref().and_then(|text| text.parse::<f64>().ok());
    if least > most {
        findings.error(at(), format!("min = {least} is above max = {most}"), "", "swap them");
    } else if let Some(start) = start.filter(|start| *start < least || *start > most) {
        let what = format!("start = {start} is outside its limits, {least} … {most}");
        findings.error(at(), what, "", "use a start value within them");
    }
}

fn interfaces(text: &str, description: &ModelDescription, structure: &ModelStructure) -> Option<Interfaces> {
    let (document, lines) = (xml::parse(text).ok()?, Lines::of(text));
    let interface = |name| interface(document.root_element(), name, &lines);
    let start = description.start_time.unwrap_or(0.0);
    let stop = description.stop_time.unwrap_or(start + 1.0);
    Some(Interfaces {
        exchange: interface("ModelExchange"),
        co_simulation: interface("CoSimulation"),
        states: structure.states.len(),
        state_places: structure.states.iter().map(|(state, _)| *state).collect::<HashSet<_>>(),
        start,
        stop,
        step: description.step.unwrap_or((stop - start) / USUAL_STEPS),
    })
}
