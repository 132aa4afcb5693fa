//! unit.h: sizes and places.

use std::fmt::Write;
use std::ops::Range;

use super::Unit;
use super::fmi3::Tables;
use super::message::quoted;
use crate::fmi2::calls::Interface;
use crate::fmi2::model_description::{guid, guid_text};
use crate::fmi2::snapshot;
use crate::model::Standard;
use crate::recording::{Method, Note, Operation};
use crate::system::{Section, Span, Variables};

/// The version of what the runtime asks of a unit.
const RUNTIME: u32 = 2;

/// Sections, with their names in C: where they begin, and how many there are.
const SECTIONS: [(Section, &str, &str); Section::COUNT] = [
    (Section::Parameter, "PARAMETER", "PARAMETERS"),
    (Section::Prepared, "PREPARED", "PREPARED"),
    (Section::Input, "INPUT", "INPUTS"),
    (Section::State, "STATE", "STATES"),
    (Section::Discrete, "DISCRETE", "DISCRETES"),
    (Section::Connected, "CONNECTED", "CONNECTED"),
    (Section::Signal, "SIGNAL", "SIGNALS"),
    (Section::Derivative, "RATE", "RATES"),
    (Section::Memory, "MEMORY", "MEMORY"),
];

/// The whole file.
pub fn write(unit: &Unit) -> String {
    let (model, variables) = (unit.model, unit.model.variables());
    let mut text =
        format!("/* {}: sizes and places. Generated; the runtime is the same for all units. */\n\n", name(unit));
    let mut define = |name: &str, value: &dyn std::fmt::Display| _ = writeln!(text, "#define {name} {value}");
    let guid = guid(model);
    let standard = if model.description().standard() == Standard::Fmi3 { 3 } else { 2 };
    define("UNIT_RUNTIME", &RUNTIME);
    define("UNIT_FMI", &standard);
    define("UNIT_NAME", &quoted(name(unit)));
    define("UNIT_GUID", &quoted(&guid_text(guid)));
    define("UNIT_IDENTITY", &identities(guid));
    define("UNIT_REALS", &variables.reals(Section::Memory).end);
    define("UNIT_INTEGERS", &variables.integers(Section::Memory).end);
    for (section, first, number) in SECTIONS {
        let Range { start, end } = variables.reals(section);
        define(&format!("FIRST_{first}"), &start);
        define(&format!("UNIT_{number}"), &(end - start));
    }
    for (section, first, number) in SECTIONS {
        let Range { start, end } = variables.integers(section);
        define(&format!("FIRST_INTEGER_{first}"), &start);
        define(&format!("UNIT_INTEGER_{number}"), &(end - start));
    }
    define("UNIT_INDICATORS", &variables.indicators().len());
    define("UNIT_IS_OPEN", &u8::from(variables.is_open()));
    define("UNIT_HAS_TIME_EVENTS", &u8::from(has_time_events(unit)));
    define("UNIT_OUTPUTS", &variables.controlled().count());
    define("UNIT_CATEGORIES", &unit.categories.len());
    let (messages, values) = message_sizes(unit);
    define("UNIT_MOST_MESSAGES", &messages);
    define("UNIT_MOST_VALUES", &values);
    let columns = model.sparsity().columns();
    define("UNIT_NONZEROS", &columns.iter().map(Vec::len).sum::<usize>());
    let filled = model.sparsity().pattern().map(|pattern| pattern.rows().map(|(left, right)| left.len() + right.len()));
    define("UNIT_SPARSE", &u8::from(filled.is_some()));
    define("UNIT_FILLED", &filled.map_or(0, Iterator::sum::<usize>));
    if standard == 3 {
        Tables::of(unit).sizes().into_iter().for_each(|(name, size)| define(name, &size));
    }
    for (name, place) in places(unit) {
        define(&format!("AT_{name}"), &place.map_or(-1, |place| place as i64));
    }
    text
}

fn name<'a>(unit: &'a Unit) -> &'a str {
    &unit.model.description().name
}

/// Marks of the FMU's own saved states, one per interface.
fn identities(guid: [u8; 16]) -> String {
    let bytes =
        |interface| snapshot::identity(guid, interface, "source").map(|byte| format!("0x{byte:02x}")).join(", ");
    format!("{{ {{ {} }}, {{ {} }} }}", bytes(Interface::ModelExchange), bytes(Interface::CoSimulation))
}

fn has_time_events(unit: &Unit) -> bool {
    let next = unit.record(Method::NextTimeEvent);
    let is_never = |operation: &Operation| *operation == Operation::Constant(f64::INFINITY.to_bits());
    !next.results.iter().all(|node| is_never(next.tape.operation(*node)))
}

/// The most messages that a method may leave, and the most numbers in one.
fn message_sizes(unit: &Unit) -> (usize, usize) {
    let mut most = (1, 1);
    for method in Method::ALL {
        let recording = unit.record(method);
        let notes = recording.tape.notes();
        let messages = notes.iter().filter(|note| matches!(note, Note::Message { .. })).count();
        let values = notes.iter().map(|note| unit.format_of(note).numbers.len()).max().unwrap_or_default();
        most = (most.0.max(messages), most.1.max(values));
    }
    most
}

/// The places of what every unit has.
fn places(unit: &Unit) -> Vec<(&'static str, Option<usize>)> {
    let variables = unit.model.variables();
    let controls = unit.model.controls();
    let mut places: Vec<(&'static str, Option<usize>)> =
        controls.reals().into_iter().map(|(name, span)| (name, span.map(|span| real(variables, span)))).collect();
    places.extend(
        controls
            .integers()
            .into_iter()
            .map(|(name, place)| (name, place.map(|(section, place)| variables.integers(section).start + place))),
    );
    places.push(("STEPPED", variables.stepped()));
    places
}

fn real(variables: &Variables, span: Span) -> usize {
    variables.reals(span.section).start + span.start
}
