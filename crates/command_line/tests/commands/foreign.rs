//! Units of other tools: FMUs that are built of a C source in `tests/foreign` and a description, and loops of them.

use std::path::{Path, PathBuf};
use std::process::Command;

use adaptive_fmu::exporter::{Platform, write_entries};
use common::at_top;

/// Writes `NAME.fmu` into a folder, from a C source in `tests/foreign` and a modelDescription.xml.
pub fn fmu(folder: &Path, name: &str, source: &str, description: &str) -> PathBuf {
    let sources = at_top("tests/foreign");
    let library = folder.join(format!("{name}.library"));
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-O1", "-w", "-fvisibility=hidden"]).arg("-o").arg(&library);
    let built = cc.arg(sources.join(source)).status().expect("a C compiler");
    assert!(built.success(), "{source}");
    let binary = std::fs::read(&library).unwrap();
    std::fs::remove_file(&library).unwrap();
    let place = Platform::own().binary(name);
    let file = folder.join(format!("{name}.fmu"));
    write_entries(&file, &[("modelDescription.xml", description.as_bytes()), (&place, &binary)]).unwrap();
    file
}

/// A description for co-simulation; `inner` is what follows the interface: units, variables, structure.
pub fn description(name: &str, inner: &str) -> String {
    format!(
        "<?xml version='1.0'?>\n<fmiModelDescription fmiVersion='2.0' modelName='{name}' guid='{name}'>\
         <CoSimulation modelIdentifier='{name}'/>{inner}</fmiModelDescription>"
    )
}

/// `<ModelVariables>` of Real inputs, outputs and parameters, by name and attributes of their type; their value
/// references count from 0.
pub fn variables(list: &[(&str, &str, &str)]) -> String {
    let variable = |(reference, (name, causality, attributes)): (usize, &(&str, &str, &str))| {
        let start = if *causality == "output" || attributes.contains("start=") { "" } else { "start='0'" };
        let variability = if *causality == "parameter" { "variability='fixed'" } else { "" };
        format!(
            "<ScalarVariable name='{name}' valueReference='{reference}' causality='{causality}' {variability}>\
             <Real {start} {attributes}/></ScalarVariable>"
        )
    };
    format!("<ModelVariables>{}</ModelVariables>", list.iter().enumerate().map(variable).collect::<String>())
}

/// A SystemStructure.ssd of units (name, source), and connections `unit.output` → `unit.input`; connectors follow from
/// these. `rest` is what stands after the system.
pub fn structure(units: &[(&str, &str)], connections: &[(&str, &str)], rest: &str) -> String {
    let connectors = |unit: &str| {
        let of = |signal: &str, kind: &str| {
            let name = signal.strip_prefix(unit)?.strip_prefix('.')?;
            Some(format!("<ssd:Connector name='{name}' kind='{kind}'/>"))
        };
        let mut all: Vec<_> =
            connections.iter().flat_map(|(from, to)| [of(from, "output"), of(to, "input")]).flatten().collect();
        all.sort();
        all.dedup();
        all.concat()
    };
    let component = |(name, source): &(&str, &str)| {
        let connectors = connectors(name);
        format!(
            "<ssd:Component name='{name}' source='{source}'><ssd:Connectors>{connectors}</ssd:Connectors></ssd:Component>"
        )
    };
    let connection = |(from, to): &(&str, &str)| {
        let ((a, b), (c, d)) = (from.split_once('.').unwrap(), to.split_once('.').unwrap());
        format!("\n<ssd:Connection startElement='{a}' startConnector='{b}' endElement='{c}' endConnector='{d}'/>")
    };
    let components: String = units.iter().map(component).collect();
    let connections: String = connections.iter().map(connection).collect();
    format!(
        "<ssd:SystemStructureDescription xmlns:ssd='http://ssp-standard.org/SSP1/SystemStructureDescription' \
         xmlns:ssc='http://ssp-standard.org/SSP1/SystemStructureCommon' name='foreign' version='1.0'>\
         <ssd:System name='system'><ssd:Elements>{components}</ssd:Elements>\
         <ssd:Connections>{connections}</ssd:Connections></ssd:System>{rest}</ssd:SystemStructureDescription>"
    )
}

/// `<DefaultExperiment>` with this project's annotation.
pub fn experiment(stop: f64, step: f64, order: &str) -> String {
    format!(
        "<ssd:DefaultExperiment stopTime='{stop}'><ssd:Annotations>\
         <ssc:Annotation type='adaptive-fmu.closed-loop'><ClosedLoop><Master step='{step}' order='{order}'/></ClosedLoop>\
         </ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>"
    )
}
