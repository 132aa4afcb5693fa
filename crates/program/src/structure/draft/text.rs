//! The text of a drafted structure, as a person would write it.

use std::collections::BTreeSet;

use super::smooth_start::{Starts, steps};
use super::wiring::Input;
use super::{Draft, Role, Signal};
use crate::model_description::Affine;
use crate::model_description::Variable;

const HEAD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon""#;

/// Largest numbers of curves in a diagram and of names in a title.
const MOST_CURVES: usize = 12;
const MOST_NAMED: usize = 4;

/// A controlled output with its reference.
type Pair = (Signal, Signal);

/// The text of a SystemStructure.ssd.
pub fn structure(draft: &Draft) -> String {
    let name = attribute(&draft.name);
    let mut lines = vec![format!("{HEAD} name=\"{name}\" version=\"1.0\">")];
    let described = attribute(&format!("Loop of {}", draft.names.join(", ")));
    lines.push(format!("  <ssd:System name=\"loop\" description=\"{described}\">"));
    lines.push("    <ssd:Elements>".to_owned());
    lines.extend((0..draft.units.len()).flat_map(|unit| component(draft, unit)));
    lines.push("    </ssd:Elements>".to_owned());
    lines.push("    <ssd:Connections>".to_owned());
    lines.extend(draft.wires.inputs.iter().flat_map(|(signal, input)| wire(draft, *signal, input)));
    let unneeded = draft.unneeded();
    if !unneeded.is_empty() {
        lines.push(format!("      <!-- no connection needed: {} -->", comment(&unneeded.join(", "))));
    }
    lines.extend(["    </ssd:Connections>", "  </ssd:System>"].map(str::to_owned));
    lines.push(format!("  <ssd:DefaultExperiment startTime=\"0.0\" stopTime=\"{:?}\">", draft.stop_time));
    lines.push("    <ssd:Annotations>".to_owned());
    lines.push("      <ssc:Annotation type=\"adaptive-fmu.closed-loop\">".to_owned());
    lines.extend(closed_loop(draft).into_iter().map(|line| format!("        {line}")));
    lines.push("      </ssc:Annotation>".to_owned());
    lines.push("    </ssd:Annotations>".to_owned());
    lines.push("  </ssd:DefaultExperiment>".to_owned());
    lines.push("</ssd:SystemStructureDescription>".to_owned());
    lines.join("\n") + "\n"
}

/// A component with the connectors that connections need, also those that are offered in comments.
fn component(draft: &Draft, unit: usize) -> Vec<String> {
    let mut needed = BTreeSet::new();
    for (signal, input) in &draft.wires.inputs {
        match input {
            Input::Connected { from, .. } => needed.extend([*signal, *from]),
            Input::Open { offered, .. } => needed.extend(offered.iter().chain([signal])),
            Input::Unneeded => {}
        }
    }
    let (name, source) = (attribute(&draft.names[unit]), attribute(&draft.units[unit].source));
    let start = format!("<ssd:Component name=\"{name}\" type=\"application/x-fmu-sharedlibrary\" source=\"{source}\"");
    let own: Vec<_> = needed.into_iter().filter(|signal| signal.0 == unit).collect();
    let starts = draft.starts.iter().find(|starts| starts.unit == unit);
    if own.is_empty() && starts.is_none() {
        return vec![format!("      {start}/>")];
    }
    let mut lines = vec![format!("      {start}>"), "        <ssd:Connectors>".to_owned()];
    for signal in own {
        let Variable { name, causality, kind, .. } = draft.variable(signal);
        let start = format!("          <ssd:Connector name=\"{}\" kind=\"{causality}\"", attribute(name));
        // An enumeration's type would have to be defined there too.
        lines.push(match kind.as_str() {
            "Enumeration" => format!("{start}/>"),
            kind => format!("{start}><ssc:{kind}/></ssd:Connector>"),
        });
    }
    lines.push("        </ssd:Connectors>".to_owned());
    lines.extend(starts.into_iter().flat_map(bindings).map(|line| format!("        {line}")));
    lines.push("      </ssd:Component>".to_owned());
    lines
}

/// Start values of a component.
fn bindings(starts: &Starts) -> Vec<String> {
    let set = "<ssv:ParameterSet xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\" name=\"loop\" \
               version=\"1.0\">";
    let mut lines = vec![format!("<!-- {} -->", comment(&starts.why)), "<ssd:ParameterBindings>".to_owned()];
    lines.extend(["  <ssd:ParameterBinding>", "    <ssd:ParameterValues>"].map(str::to_owned));
    lines.extend([format!("      {set}"), "        <ssv:Parameters>".to_owned()]);
    lines.extend(starts.values.iter().map(|(name, value)| {
        let name = attribute(name);
        format!("          <ssv:Parameter name=\"{name}\"><ssv:Real value=\"{value:?}\"/></ssv:Parameter>")
    }));
    lines.extend(["        </ssv:Parameters>", "      </ssv:ParameterSet>"].map(str::to_owned));
    lines.extend(["    </ssd:ParameterValues>", "  </ssd:ParameterBinding>"].map(str::to_owned));
    lines.push("</ssd:ParameterBindings>".to_owned());
    lines
}

/// An input's connection, or a comment on what to decide.
fn wire(draft: &Draft, to: Signal, input: &Input) -> Vec<String> {
    let shown = draft.shown(to);
    match input {
        Input::Unneeded => Vec::new(),
        Input::Connected { from, why } => {
            let line = why.as_ref().map(|why| {
                let text = format!("{} goes to {shown}: {why}", draft.shown(*from));
                format!("      <!-- {} -->", comment(&text))
            });
            line.into_iter().chain([format!("      {}", connection(draft, *from, to))]).collect()
        }
        Input::Open { reason, offered } => {
            let Variable { start, unit, .. } = draft.variable(to);
            let unit = unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
            let start = start.as_ref().map_or(String::new(), |start| format!(", {start}{unit}"));
            let advice = if offered.is_empty() { "" } else { " Until you take one of these, it" };
            let advice = if advice.is_empty() { " It" } else { advice };
            let text = format!("TO DECIDE: {shown}: {reason}.{advice} keeps its start value{start}.");
            let candidates = offered.iter().map(|from| format!("      <!-- {} -->", connection(draft, *from, to)));
            std::iter::once(format!("      <!-- {} -->", comment(&text))).chain(candidates).collect()
        }
    }
}

fn connection(draft: &Draft, from: Signal, to: Signal) -> String {
    let element = |signal: Signal| attribute(&draft.names[signal.0]);
    let connector = |signal: Signal| attribute(&draft.variable(signal).name);
    format!(
        "<ssd:Connection startElement=\"{}\" startConnector=\"{}\" endElement=\"{}\" endConnector=\"{}\"/>",
        element(from),
        connector(from),
        element(to),
        connector(to)
    )
}

/// Settings, metrics and plots of the loop.
fn closed_loop(draft: &Draft) -> Vec<String> {
    let pairs = pairs(draft);
    let controls = controls(draft);
    let mut lines = vec![format!("<ClosedLoop name=\"{}\">", attribute(&draft.name))];
    lines.push(format!("  <Master step=\"{:?}\" order=\"gauss-seidel\"/>", draft.step));
    if pairs.is_empty() {
        lines.push("  <!-- TO DECIDE: which signal follows which reference? Example of a metric: -->".to_owned());
        lines.push(
            "  <!-- <Metric label=\"rms error\" statistic=\"rms\" of=\"plant.y\" minus=\"reference.r\"/> -->"
                .to_owned(),
        );
    } else {
        lines.push(
            "  <!-- from=\"1.5\": start of the evaluation in s; limit=\"0.1\": largest value that passes -->"
                .to_owned(),
        );
    }
    for (output, reference) in &pairs {
        let (name, minus) = (&draft.variable(*output).name, &draft.variable(*reference).name);
        let statistics: &[&str] = if steps(draft, reference.0) { &["rms"] } else { &["max", "rms"] };
        for &statistic in statistics {
            let label = match statistic {
                "max" => format!("max |{name} - {minus}|{}", in_unit(draft, *output)),
                _ => format!("rms ({name} - {minus}){}", in_unit(draft, *output)),
            };
            lines.push(format!(
                "  <Metric label=\"{}\" statistic=\"{statistic}\" of=\"{}\" minus=\"{}\"/>",
                attribute(&label),
                attribute(&draft.shown(*output)),
                attribute(&draft.shown(*reference))
            ));
        }
    }
    for control in &controls {
        let label = format!("max |{}|{}", draft.variable(*control).name, in_unit(draft, *control));
        let (label, of) = (attribute(&label), attribute(&draft.shown(*control)));
        lines.push(format!("  <Metric label=\"{label}\" statistic=\"max\" of=\"{of}\"/>"));
    }
    lines.extend(plots(draft, &pairs));
    lines.push("</ClosedLoop>".to_owned());
    lines
}

fn in_unit(draft: &Draft, signal: Signal) -> String {
    let unit = draft.variable(signal).unit.as_ref().filter(|unit| *unit != "1");
    unit.map_or(String::new(), |unit| format!(", {unit}"))
}

/// The outputs that are to follow references, found by their names: `speed` by `speed_reference`, `y[1]` by `r[1]`.
fn pairs(draft: &Draft) -> Vec<Pair> {
    let referred = |(from, to): (Signal, Signal)| {
        (draft.roles[from.0] == Role::Reference && draft.roles[to.0] == Role::Controller).then_some(from)
    };
    let references: BTreeSet<Signal> = draft.connections().filter_map(referred).collect();
    let pair = |reference: Signal| {
        let name = &draft.variable(reference).name;
        let wanted = match (name.strip_suffix("_reference").or(name.strip_suffix("_ref")), name.strip_prefix("r[")) {
            (Some(base), _) => [base.to_owned(), format!("{base}_output")],
            (_, Some(index)) => [format!("y[{index}"), format!("y_output[{index}")],
            _ => return None,
        };
        let output = wanted.iter().find_map(|name| output_of_a_plant(draft, name))?;
        let measures = [output, reference].map(|signal| draft.variable(signal).measure.as_deref());
        let [Some(one), Some(another)] = measures else { return Some((output, reference)) };
        let same = one.to(another) == Some(Affine::IDENTITY) && one.dimension == another.dimension;
        same.then_some((output, reference))
    };
    references.into_iter().filter_map(pair).collect()
}

/// The only output of a name that plants have.
fn output_of_a_plant(draft: &Draft, name: &str) -> Option<Signal> {
    let plants = (0..draft.units.len()).filter(|&unit| draft.roles[unit] == Role::Plant);
    let output = |unit: usize| {
        let place = draft.units[unit].description.place(name)?;
        let variable = draft.variable((unit, place));
        (variable.causality == "output" && variable.kind == "Real").then_some((unit, place))
    };
    let mut found = plants.filter_map(output);
    found.next().filter(|_| found.next().is_none())
}

/// Signals from controllers to other components.
fn controls(draft: &Draft) -> Vec<Signal> {
    let of_controllers = draft
        .connections()
        .map(|(from, _)| from)
        .filter(|from| draft.roles[from.0] == Role::Controller && draft.variable(*from).kind == "Real");
    of_controllers.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Each controlled output with its reference; then what else is connected, by its unit of measurement.
fn plots(draft: &Draft, pairs: &[Pair]) -> Vec<String> {
    let mut diagrams: Vec<(String, Vec<Signal>)> = Vec::new();
    for (output, reference) in pairs {
        let title = format!("{} and its reference{}", draft.variable(*output).name, in_unit(draft, *output));
        diagrams.push((title, vec![*reference, *output]));
    }
    let shown: BTreeSet<Signal> = pairs.iter().flat_map(|(output, reference)| [*output, *reference]).collect();
    let rest: BTreeSet<Signal> =
        draft.connections().map(|(from, _)| from).filter(|from| !shown.contains(from)).collect();
    // True for controls, and the unit of measurement.
    type Group<'a> = (bool, Option<&'a String>);
    let mut groups: Vec<(Group, Vec<Signal>)> = Vec::new();
    for signal in rest {
        let group = (draft.roles[signal.0] == Role::Controller, draft.variable(signal).unit.as_ref());
        match groups.iter_mut().find(|(known, signals)| *known == group && signals.len() < MOST_CURVES) {
            Some((_, signals)) => signals.push(signal),
            None => groups.push((group, vec![signal])),
        }
    }
    // Controls come first.
    groups.sort_by_key(|((is_control, _), _)| !is_control);
    for (_, signals) in groups {
        let names: Vec<_> =
            signals.iter().take(MOST_NAMED).map(|&signal| draft.variable(signal).name.as_str()).collect();
        let more = if signals.len() > MOST_NAMED { ", …" } else { "" };
        diagrams.push((format!("{}{more}{}", names.join(", "), in_unit(draft, signals[0])), signals));
    }
    diagrams.iter().map(|(title, signals)| plot(draft, title, signals)).collect()
}

fn plot(draft: &Draft, title: &str, signals: &[Signal]) -> String {
    let names: Vec<_> = signals.iter().map(|&signal| draft.shown(signal)).collect();
    let (shown, left): (Vec<_>, Vec<_>) = names.into_iter().partition(|name| !name.contains(char::is_whitespace));
    if shown.is_empty() {
        return format!("  <!-- {} can't be plotted: spaces separate names there -->", comment(&left.join(", ")));
    }
    format!("  <Plot title=\"{}\" signals=\"{}\"/>", attribute(title), attribute(&shown.join(" ")))
}

/// A text in an attribute, also within a comment, which two hyphens would end.
fn attribute(text: &str) -> String {
    crate::drawing::escaped(text)
        .replace("--", "-&#45;")
        .replace('\t', "&#9;")
        .replace('\n', "&#10;")
        .replace('\r', "&#13;")
}

/// A text in a comment.
fn comment(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut text = text.replace("--", "- -");
    if text.ends_with('-') {
        text.push(' ');
    }
    text.replace("--", "- -")
}
