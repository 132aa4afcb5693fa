//! The equations of a unit as C functions, one for each of the system's methods.

use std::collections::HashMap;

use super::Unit;
use super::blocks::Wanted;
use super::expression::{Expression, Kind};
use super::function::{Function, framed};
use super::message::{MessageFormat, quoted};
use super::names::Names;
use crate::recording::{Leaf, Method, Node, Note, Operation, Recording, Tape};
use crate::system::Section;

/// A C function: what it does, and its declaration.
pub(super) struct Head {
    pub what: &'static str,
    pub declaration: &'static str,
}

/// Destination of a computed value.
pub(super) struct Target {
    pub node: Node,
    /// C text of its assignment, up to the value.
    pub place: String,
    pub kind: Kind,
    /// The variable that it is.
    pub variable: Option<String>,
    /// Source of its equation; empty if none is given.
    pub source: &'static str,
}

impl Target {
    /// A result, to be written so.
    pub fn result(place: String, node: Node) -> Self {
        Target::of(place, node, Kind::Real, None)
    }

    /// A value of this kind, of a variable.
    pub fn of(place: String, node: Node, kind: Kind, variable: Option<String>) -> Self {
        Target { node, place, kind, variable, source: "" }
    }
}

/// Sections that an evaluation writes: signals, and rates too.
pub(super) const SIGNALS: [Section; 2] = [Section::Connected, Section::Signal];
pub(super) const SIGNALS_AND_RATES: [Section; 3] = [Section::Connected, Section::Signal, Section::Derivative];
/// Sections that the start writes; the rest follows when it is evaluated.
const STARTED: [Section; 4] = [Section::Prepared, Section::State, Section::Discrete, Section::Memory];
/// Sections that other methods may write: signals too, if they evaluate them.
const ANY: [Section; 7] = [
    Section::Prepared,
    Section::State,
    Section::Discrete,
    Section::Memory,
    Section::Connected,
    Section::Signal,
    Section::Derivative,
];

/// Methods that change values, log and refuse.
pub(super) static METHODS: [(Method, Head); 6] = [
    (
        Method::Relate,
        Head {
            what: "What follows from parameters, and the relations that they must keep.",
            declaration: "static void unit_prepare(real *v, int *n, Log *messages)",
        },
    ),
    (
        Method::Start,
        Head {
            what: "The start: states and discrete variables.",
            declaration: "static void unit_initialise(real t, real *v, int *n, Log *messages)",
        },
    ),
    (
        Method::ParametersChanged,
        Head {
            what: "What happens when tunable parameters have changed.",
            declaration: "static void unit_parameters_changed(real t, real *v, int *n, Log *messages)",
        },
    ),
    (
        Method::Check,
        Head {
            what: "Whether the equations hold where the unit stands.",
            declaration: "static void unit_check(real t, real *v, int *n, Log *messages)",
        },
    ),
    (
        Method::Event,
        Head {
            what: "An event, of time or of the indicators that crossed zero.",
            declaration: "static void unit_event(real t, const unsigned char *crossed, real *v, int *n, Log *messages)",
        },
    ),
    (
        Method::StepCompleted,
        Head {
            what: "The end of a communication step.",
            declaration: "static void unit_step_completed(real t, real step, real *v, int *n, Log *messages)",
        },
    ),
];

/// All of them.
pub(super) fn write(unit: &Unit) -> String {
    let evaluate = unit.record(Method::Evaluate);
    let head = |what, declaration| Head { what, declaration };
    let outputs = head(
        "The output equation: connected values, outputs and other signals.",
        "static void unit_outputs(real t, real *v, const int *n)",
    );
    let both = head(
        "The output equation and the state equation: signals, and the rates of the states.",
        "static void unit_evaluate(real t, real *v, const int *n)",
    );
    let mut text = function(unit, &outputs, &evaluate.tape, &unit.changed(&evaluate, &SIGNALS), &[]);
    text += &function(unit, &both, &evaluate.tape, &unit.changed(&evaluate, &SIGNALS_AND_RATES), &[]);
    for (method, head) in &METHODS {
        let recording = unit.record(*method);
        let sections = if *method == Method::Start { &STARTED[..] } else { &ANY };
        text += &function(unit, head, &recording.tape, &unit.changed(&recording, sections), recording.tape.notes());
    }
    text + &of_events(unit, &unit.record(Method::NextTimeEvent), &unit.record(Method::Indicators))
}

/// The functions by which events are found: the next time event, and the indicators if there are some.
pub(super) fn of_events(unit: &Unit, next: &Recording, indicators: &Recording) -> String {
    let targets: Vec<_> = next.results.iter().map(|node| Target::result("return".to_owned(), *node)).collect();
    let of_next = Head {
        what: "The time of the next event that is known in advance.",
        declaration: "static real unit_next_time_event(const real *v, const int *n)",
    };
    let text = function(unit, &of_next, &next.tape, &targets, &[]);
    if unit.model.variables().indicators().is_empty() {
        return text;
    }
    let results = indicators.results.iter().enumerate();
    let targets: Vec<_> = results.map(|(k, node)| Target::result(format!("z[{k}] ="), *node)).collect();
    let of_indicators = Head {
        what: "The event indicators: a change of sign is an event.",
        declaration: "static void unit_event_indicators(real t, const real *v, const int *n, real *z)",
    };
    text + &function(unit, &of_indicators, &indicators.tape, &targets, &[])
}

/// A function that computes nodes of a tape, logs and refuses as noted, and writes its results.
pub(super) fn function(unit: &Unit, head: &Head, tape: &Tape, targets: &[Target], notes: &[Note]) -> String {
    let mut names = Names::default();
    let mut function = Function::new(&mut names, "int");
    let messages: Vec<(Node, MessageFormat)> =
        notes.iter().map(|note| (note.condition(), unit.format_of(note))).collect();
    let of_notes =
        messages.iter().flat_map(|(condition, messages)| std::iter::once(*condition).chain(messages.numbers.clone()));
    let wanted: Vec<Node> = targets.iter().map(|target| target.node).chain(of_notes).collect();
    let given = read(unit, tape, &wanted, &mut function);
    let variables: HashMap<Node, &String> =
        targets.iter().rev().filter_map(|target| Some((target.node, target.variable.as_ref()?))).collect();
    let named = |node: Node| variables.get(&node).map(|name| (*name).clone());
    // Numbers of a message are computed under the message's condition.
    let when_logged = messages.iter().flat_map(|(condition, messages)| {
        std::iter::once((*condition, None)).chain(messages.numbers.iter().map(|&number| (number, Some(*condition))))
    });
    let wanted: Vec<Wanted> = targets.iter().map(|target| (target.node, None)).chain(when_logged).collect();
    let of = |operation: &Operation| match operation {
        Operation::Leaf(leaf) => given[leaf].clone(),
        _ => Expression::number(f64::NAN),
    };
    let found = function.compute(tape.operations(), &wanted, &named, &of);
    let mut numbers = found[targets.len()..].iter();
    for (note, (_, messages)) in notes.iter().zip(&messages) {
        let condition = function.tested(numbers.next().expect("each note has a condition"));
        let values: Vec<String> =
            numbers.by_ref().take(messages.numbers.len()).map(|value| value.real().text).collect();
        log(unit, note, messages, &condition, &values, &mut function);
    }
    for (target, found) in targets.iter().zip(&found) {
        let value = if target.kind == Kind::Real { found.real() } else { found.whole() };
        function.line(&format!("{} {};", target.place, value.text));
        if !target.source.is_empty() {
            function.comment(target.source);
        }
    }
    framed((head.what, head.declaration), &function.lines())
}

/// Reads the leaves that the wanted nodes depend on into names.
fn read(unit: &Unit, tape: &Tape, wanted: &[Node], function: &mut Function) -> HashMap<Leaf, Expression> {
    let needed = tape.needed(wanted);
    let leaf = |(place, operation): (usize, &Operation)| match operation {
        Operation::Leaf(leaf) if needed[place] => Some(*leaf),
        _ => None,
    };
    let mut leaves: Vec<Leaf> = tape.operations().iter().enumerate().filter_map(leaf).collect();
    leaves.sort_unstable();
    let mut expression = |leaf| match leaf {
        Leaf::Time => Expression::atom("t", Kind::Real),
        Leaf::Step => Expression::atom("step", Kind::Real),
        Leaf::TimeChange => Expression::atom("dt", Kind::Real),
        Leaf::Real(place) => function.read("v", place as usize, Kind::Real, unit.real_name(place as usize)),
        Leaf::Integer(place) => function.read("n", place as usize, Kind::Whole, unit.integer_name(place as usize)),
        Leaf::Crossed(indicator) => Expression::atom(format!("crossed[{indicator}]"), Kind::Whole),
        Leaf::Change(place) => {
            let name = format!("d_{}", unit.real_name(place as usize));
            function.read("d", place as usize, Kind::Real, &name)
        }
        Leaf::Slope(input) => Expression::atom(format!("(slopes == NULL ? R(0.0) : slopes[{input}])"), Kind::Real),
    };
    leaves.into_iter().map(|leaf| (leaf, expression(leaf))).collect()
}

/// Writes a message or a refusal under a condition.
fn log(unit: &Unit, note: &Note, message: &MessageFormat, condition: &str, values: &[String], function: &mut Function) {
    let given = match note {
        Note::Message { category, .. } => format!("log_text(messages, {}, ", unit.category(category)),
        Note::Refusal { .. } => "refuse(messages, ".to_owned(),
    };
    function.line(&format!("if ({condition}) {{"));
    let array = if values.is_empty() { "NULL" } else { "values" };
    if !values.is_empty() {
        function.line(&format!("    const real values[] = {{ {} }};", values.join(", ")));
    }
    function.whole_line(&format!("    {given}{}, {array}, {});", quoted(&message.text), values.len()));
    function.line("}");
}
