//! The equations of a law as C functions, one for each method.

use super::common;
use super::constants::Constant;
use super::driver::{Driver, Writes};
use super::functions::{Head, Structs, Written, access, function, rolled};
use super::law::Law;
use crate::fmi2::source::expression::Kind;
use crate::recording::{Node, Operation, Recording};
use crate::system::Section;

/// All of them.
pub(super) fn write(law: &Law, structs: &Structs, driver: &Driver) -> String {
    [
        prepare(law, structs),
        evaluations(law, structs, driver),
        common(law, structs),
        changes(law, structs, driver),
        sides(law, structs, driver),
    ]
    .concat()
}

/// Values that follow from parameters.
fn prepare(law: &Law, structs: &Structs) -> String {
    if structs.parameters.is_empty() {
        return String::new();
    }
    let written: Vec<Written> = law
        .prepared()
        .into_iter()
        .filter_map(|(place, node)| Some(written(law, access(structs, place, true, "p")?, place, node)))
        .collect();
    let r = if structs.prepared.is_empty() { "" } else { ", §_prepared *r" };
    let head = Head {
        what: "What follows from parameters; not 0 where they don't fit together: the number of the relation.",
        declaration: format!("static int §_prepare(const §_parameters *p{r})"),
        parameters: "p",
        asked: None,
    };
    function(law, structs, &head, &law.recorded.relate, &written, &law.refusals(&law.recorded.relate))
}

fn written(law: &Law, to: String, place: usize, node: Node) -> Written {
    Written { to, node, kind: Kind::Real, name: Some(law.real_names[place].clone()), source: law.sources[place] }
}

fn written_whole(law: &Law, to: String, place: usize, node: Node) -> Written {
    Written { to, node, kind: Kind::Whole, name: Some(law.integer_names[place].clone()), source: "" }
}

/// Signals, and the state equation.
fn evaluations(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let mut text = String::new();
    let signals = signals(law, structs);
    let with_rates = law.evaluates_with_rates();
    if driver.has_states {
        text += &constants(law, structs, driver);
        let (what, asked) = if with_rates {
            let what = "The state equation, and the output equation where signals are asked for: both need the same.";
            (what, Some(("y", &signals[..])))
        } else {
            ("The state equation: rates of the states.", None)
        };
        let declaration = format!("static void §_rates({})", driver.declared(law, Writes::Rates));
        let head = Head { what, declaration, parameters: "", asked };
        text += &function(law, structs, &head, &law.recorded.rates, &rates(law, structs), &[]);
    }
    if driver.has_signals && !with_rates {
        let head = Head {
            what: "The output equation: outputs, and other signals that are read.",
            declaration: format!("static void §_evaluate({})", driver.declared(law, Writes::Signals)),
            parameters: "",
            asked: None,
        };
        text += &function(law, structs, &head, &law.recorded.signals, &signals, &[]);
    }
    text
}

/// Signals that are read, and their places.
pub(super) fn signals(law: &Law, structs: &Structs) -> Vec<Written> {
    let real = |(place, node)| Some(written(law, access(structs, place, true, "")?, place, node));
    let whole = |(place, node)| Some(written_whole(law, access(structs, place, false, "")?, place, node));
    let reals = law.signals().into_iter().filter_map(real);
    reals.chain(law.whole_signals().into_iter().filter_map(whole)).collect()
}

/// Rates of the states, and their places.
pub(super) fn rates(law: &Law, structs: &Structs) -> Vec<Written> {
    let variables = law.variables();
    let (first, rate) = (variables.reals(Section::State).start, variables.reals(Section::Derivative).start);
    let one = |(place, node): (usize, Node)| {
        Some(Written {
            to: format!("dx->{}", structs.states.access(place, true)?),
            node,
            kind: Kind::Real,
            name: Some(format!("d_{}", law.real_names[place])),
            source: law.sources[rate + place - first],
        })
    };
    law.rates().into_iter().filter_map(one).collect()
}

/// Rates, and signals that are computed with them.
pub(super) fn with_rates(law: &Law, structs: &Structs) -> Vec<Written> {
    let others = if law.evaluates_with_rates() { signals(law, structs) } else { Vec::new() };
    rates(law, structs).into_iter().chain(others).collect()
}

/// Constants of a step that loops of the state equation read one a lane.
pub(super) fn constants_by_lanes(law: &Law, structs: &Structs) -> Vec<Vec<usize>> {
    let all = with_rates(law, structs);
    let written: Vec<&Written> = all.iter().collect();
    let wanted: Vec<Node> = written.iter().map(|one| one.node).collect();
    rolled(law, structs, "", &law.recorded.rates, (&wanted, &written)).constants()
}

/// The constants of a step, and their places.
pub(super) fn of_step(law: &Law) -> Vec<Written> {
    let of = |one: &Constant| Written {
        to: format!("c->{}", one.name),
        node: one.node,
        kind: one.kind,
        name: None,
        source: "",
    };
    law.constants.iter().map(of).collect()
}

/// The function of the constants of a step.
fn constants(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let all = of_step(law);
    if all.is_empty() {
        return String::new();
    }
    let head = Head {
        what: "What the state equation reads that is the same throughout a step.",
        declaration: format!("static void §_find_constants({})", driver.declared(law, Writes::Constants)),
        parameters: "",
        asked: None,
    };
    function(law, structs, &head, &law.recorded.constants, &all, &[])
}

/// The function of what the start and an event have in common.
fn common(law: &Law, structs: &Structs) -> String {
    let Some(common) = &law.common else { return String::new() };
    let of = |(number, &node): (usize, &Node)| Written {
        to: format!("{}[{number}]", common::VALUES),
        node,
        kind: Kind::Real,
        name: None,
        source: "",
    };
    let written: Vec<Written> = common.results.iter().enumerate().map(of).collect();
    let inputs = if structs.inputs.is_empty() { "" } else { "const §_inputs *in, " };
    let head = Head {
        what: "What the start and an event have in common.",
        declaration: format!("ONCE static void {}(const § *self, {inputs}real *{})", common::NAME, common::VALUES),
        parameters: "",
        asked: None,
    };
    function(law, structs, &head, &common.recording, &written, &[])
}

/// States and discrete values that a method changes, and their places.
pub(super) fn changed(law: &Law, structs: &Structs, recording: &Recording) -> Vec<Written> {
    let (reals, integers) = law.changed(recording);
    let real = |(place, node)| Some(written(law, access(structs, place, true, "")?, place, node));
    let whole = |(place, node)| Some(written_whole(law, access(structs, place, false, "")?, place, node));
    reals.into_iter().filter_map(real).chain(integers.into_iter().filter_map(whole)).collect()
}

/// Methods that start, change and refuse.
fn changes(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let recorded = &law.recorded;
    let mut text = String::new();
    let mut one = |name: &str, what: &str, recording: &Recording, refuses: bool| {
        // Before the start all is zero.
        let is_zero = |one: &Written| name == "start" && recording.tape.constant(one.node) == Some(0.0);
        let mut all = changed(law, structs, recording);
        all.retain(|one| !is_zero(one));
        let refusals = if refuses { law.refusals(recording) } else { Vec::new() };
        let writes = if all.is_empty() { Writes::Nothing } else { Writes::State };
        let head = Head {
            what,
            declaration: format!(
                "static {} §_{name}({})",
                if refuses { "int" } else { "void" },
                driver.declared(law, writes)
            ),
            parameters: "",
            asked: None,
        };
        text += &function(law, structs, &head, recording, &all, &refusals);
    };
    one(
        "start",
        "States and discrete values at the start; not 0 where there is none from these inputs.",
        &recorded.start,
        true,
    );
    if driver.has_changes {
        one("changed", "What changes with parameters.", &recorded.parameters_changed, false);
    }
    if driver.has_events {
        one("event", "An event.", &recorded.event, false);
    }
    if let Some(sample) = &recorded.sample {
        one("sample", "A sample.", sample, false);
    }
    if !law.refusals(&recorded.check).is_empty() {
        one("check", "Not 0 where the equations have no solution.", &recorded.check, true);
    }
    let (reals, integers) = law.changed(&recorded.completed);
    if !(reals.is_empty() && integers.is_empty()) {
        one("completed", "The end of a step.", &recorded.completed, false);
    }
    text
}

/// Sides of the event indicators.
fn sides(law: &Law, structs: &Structs, driver: &Driver) -> String {
    if !driver.has_events {
        return String::new();
    }
    let indicators = &law.recorded.indicators;
    let results = || law.indicators.iter().map(|&number| indicators.results[number]);
    // An indicator that is one of two numbers is a condition.
    let condition = |node: Node| match indicators.tape.operation(node) {
        Operation::Select(of, yes, no) => {
            let (yes, no) = indicators.tape.constant(*yes).zip(indicators.tape.constant(*no))?;
            (yes > 0.0 && no < 0.0).then_some(*of)
        }
        _ => None,
    };
    let conditions: Option<Vec<Node>> = results().map(condition).collect();
    let (kind, to) = if conditions.is_some() { (Kind::Whole, "bool *above") } else { (Kind::Real, "real *z") };
    let array = to.rsplit('*').next().unwrap_or_default();
    let nodes = conditions.unwrap_or_else(|| results().collect());
    let one = |(k, node)| Written { to: format!("{array}[{k}]"), node, kind, name: None, source: "" };
    let all: Vec<Written> = nodes.into_iter().enumerate().map(one).collect();
    let head = Head {
        what: "Event indicators: a change of sign is an event.",
        declaration: format!("static void §_indicators({}, {to})", driver.declared(law, Writes::Nothing)),
        parameters: "",
        asked: None,
    };
    let many = law.indicators.len();
    let side = match kind {
        Kind::Real => "z[k] < R(0.0) ? bit : z[k] > R(0.0) ? UINT32_C(0) : (d->indicator_sides & bit)",
        Kind::Whole => "above[k] ? UINT32_C(0) : bit",
    };
    function(law, structs, &head, indicators, &all, &[])
        + &format!(
            "/* Bits of those that are negative; an indicator that is 0 stays on its side. */\nstatic uint32_t §_sides({})\n{{\n    \
             {}[{many}];\n    uint32_t sides = 0;\n    §_indicators({}, {array});\n    for (int k = 0; k < {many}; k++) {{\n        \
             const uint32_t bit = UINT32_C(1) << k;\n        sides |= {side};\n    }}\n    return sides;\n}}\n\n",
            driver.declared(law, Writes::Nothing),
            to.replace('*', ""),
            driver.called(law, Writes::Nothing, "x", "t")
        )
}
