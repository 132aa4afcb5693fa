//! The driver of a controller in C: one step of it.

use std::fmt::Write;

use super::Fallback;
use super::functions::{Structs, limits_of_control};
use super::header::flags;
use super::law::{Law, Recorded, leaves};
use super::members::{Member, each};
use super::repeated::{Run, runs};
use super::runge_kutta;
use crate::recording::{Leaf, Node, Recording};
use crate::system::{Data, Section};

/// Tasks of a controller's driver.
#[derive(Debug)]
pub(super) struct Driver {
    /// Members of the discrete part in addition to variables.
    pub counters: Vec<String>,
    pub has_discrete: bool,
    pub has_states: bool,
    pub has_signals: bool,
    pub has_inputs: bool,
    /// True if a refused step gives the last outputs.
    pub holds: bool,
    pub counts_steps: bool,
    pub has_events: bool,
    /// True if a calibration changes states or discrete values.
    pub has_changes: bool,
    pub counts_samples: bool,
    /// Functions that read signals: these are computed before.
    reads: Reads,
}

/// True for functions that read signals.
#[derive(Debug)]
struct Reads {
    indicators: bool,
    event: bool,
    sample: bool,
    changed: bool,
}

impl Reads {
    fn of(law: &Law, structs: &Structs) -> Self {
        let reads = |recording: &Recording, nodes: &[Node]| {
            leaves(recording, nodes).iter().any(|leaf| match *leaf {
                Leaf::Real(place) => structs.signals.access(place as usize, true).is_some(),
                Leaf::Integer(place) => structs.signals.access(place as usize, false).is_some(),
                _ => false,
            })
        };
        let changes = |recording: &Recording| {
            let (reals, integers) = law.changed(recording);
            let nodes: Vec<Node> = reals.into_iter().chain(integers).map(|(_, node)| node).collect();
            reads(recording, &nodes)
        };
        let Recorded { indicators, event, sample, parameters_changed, .. } = &law.recorded;
        let results: Vec<Node> = law.indicators.iter().map(|&k| indicators.results[k]).collect();
        Reads {
            indicators: reads(indicators, &results),
            event: changes(event),
            sample: sample.as_ref().is_some_and(changes),
            changed: changes(parameters_changed),
        }
    }
}

impl Driver {
    pub fn of(law: &Law, structs: &Structs) -> Self {
        let clock = law.variables().clocks().next();
        let counts_samples = law.every > 0 && clock.is_some_and(|clock| law.live.reals[clock.count]);
        let has_events = !law.indicators.is_empty();
        let mut counters = Vec::new();
        let mut counter = |is: bool, text: &str| {
            if is {
                counters.push(text.to_owned());
            }
        };
        counter(counts_samples, "uint64_t samples_taken;");
        counter(law.every > 1, "uint32_t calls_since_sample;");
        counter(has_events, "uint32_t indicator_sides; /* a bit each */");
        let (reals, integers) = law.changed(&law.recorded.parameters_changed);
        Driver {
            has_discrete: !structs.discrete.is_empty() || !counters.is_empty(),
            has_states: !structs.states.is_empty(),
            has_signals: !structs.signals.is_empty(),
            has_inputs: !structs.inputs.is_empty(),
            holds: law.fallback == Fallback::Hold,
            counts_steps: law.reads_time,
            has_events,
            has_changes: !(structs.parameters.is_empty() || reals.is_empty() && integers.is_empty()),
            counts_samples,
            counters,
            reads: Reads::of(law, structs),
        }
    }

    /// Calls of the functions of sides and of signals in a step without an event, where it takes a sample.
    pub fn calls(&self, law: &Law) -> [u64; 2] {
        let within = if law.events_within && self.has_states { u64::from(law.substeps) } else { 0 };
        let sides = if self.has_events { 1 + within + u64::from(law.every > 0) } else { 0 };
        [sides, 1 + u64::from(self.reads.sample) + if self.reads.indicators { sides } else { 0 }]
    }

    /// The line that computes signals, where something reads them.
    fn evaluate(&self, law: &Law, is_read: bool) -> String {
        if self.has_signals && is_read {
            let called = self.called(law, Writes::Signals, "x", "t");
            if law.evaluates_with_rates() {
                format!("    §_states dx;\n    §_rates({called}, &dx);\n")
            } else {
                format!("    §_evaluate({called});\n")
            }
        } else {
            String::new()
        }
    }

    /// The line that finds the sides of indicators anew.
    fn find_sides(&self, law: &Law) -> String {
        let called = self.called(law, Writes::Nothing, "x", "t");
        self.evaluate(law, self.reads.indicators) + &format!("    d->indicator_sides = §_sides({called});\n")
    }

    /// Parameters of a function of the equations: those that there are, of which some may be written.
    pub fn parameters(&self, law: &Law, writes: Writes) -> Vec<(String, &'static str)> {
        let mut all = vec![("const § *self".to_owned(), "self")];
        let mut one = |is: bool, written: bool, kind: &str, name: &'static str| {
            if is {
                all.push((format!("{}§_{kind} *{name}", if written { "" } else { "const " }), name));
            }
        };
        let changes = writes == Writes::State;
        one(self.has_states && writes != Writes::Constants, changes, "states", "x");
        one(self.has_discrete, changes, "discrete", "d");
        one(self.has_inputs, false, "inputs", "in");
        let of_rates = matches!(writes, Writes::Rates | Writes::Constants);
        let evaluates = writes == Writes::Signals || writes == Writes::Rates && law.evaluates_with_rates();
        one(self.has_signals && (!of_rates || evaluates), evaluates, "signals", "y");
        let reads_constants = of_rates || writes == Writes::Signals && law.evaluates_once;
        one(reads_constants && !law.constants.is_empty(), writes == Writes::Constants, "constants", "c");
        if law.reads_time && writes != Writes::Constants {
            all.push(("real t".to_owned(), "t"));
        }
        if writes == Writes::Rates {
            all.push(("§_states *dx".to_owned(), "dx"));
        }
        all
    }

    pub fn declared(&self, law: &Law, writes: Writes) -> String {
        self.parameters(law, writes).into_iter().map(|(text, _)| text).collect::<Vec<_>>().join(", ")
    }

    /// The same in a call, with these pointers. Only rates need no signals.
    pub fn called(&self, law: &Law, writes: Writes, x: &str, t: &str) -> String {
        let of = |name: &'static str| match name {
            "x" => x,
            "t" => t,
            "c" if writes == Writes::Signals => "&c",
            "y" if writes == Writes::Rates => "NULL",
            other => other,
        };
        self.parameters(law, writes).into_iter().map(|(_, name)| of(name)).collect::<Vec<_>>().join(", ")
    }
}

/// Values that a function of the equations writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Writes {
    Nothing,
    Signals,
    /// The constants of a step.
    Constants,
    Rates,
    State,
}

/// The functions of the driver.
pub(super) fn write(law: &Law, structs: &Structs, driver: &Driver) -> String {
    [
        soundness(law, structs, driver),
        settle(law, driver),
        runge_kutta::write(law, structs, driver),
        advance(law, structs, driver),
        checks(structs),
    ]
    .concat()
}

/// The check of states and outputs.
fn soundness(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let of_states = each(&structs.states.list, &["sound = sound && F(fabs)(x->@) <= R(1e12);"]);
    let outputs: String = sound_outputs(law, structs);
    format!(
        "/* True if states and outputs are numbers, and not beyond any use. */\nstatic bool §_is_sound({})\n{{\n    bool sound = \
         true;\n{of_states}{outputs}    return sound;\n}}\n\n",
        [driver.has_states.then_some("const §_states *x"), (!outputs.is_empty()).then_some("const §_outputs *out")]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(", ")
    )
}

fn sound_outputs(law: &Law, structs: &Structs) -> String {
    let of_states: Vec<bool> = structs.outputs.list.iter().map(|member| is_state(law, member)).collect();
    let others = structs.outputs.list.iter().zip(of_states).filter(|(_, is_state)| !is_state);
    each(others.map(|(member, _)| member), &["sound = sound && F(fabs)(out->@) <= R(1e12);"])
}

fn is_state(law: &Law, member: &Member) -> bool {
    law.variables().find(&member.elements[0]).is_some_and(|element| element.variable.section == Section::State)
}

/// Events where something has changed sides.
fn settle(law: &Law, driver: &Driver) -> String {
    if !driver.has_events {
        return String::new();
    }
    let y = if driver.has_signals { declared_with_signals(driver, law) } else { driver.declared(law, Writes::State) };
    let before = indented(&driver.evaluate(law, driver.reads.indicators));
    let between = indented(&driver.evaluate(law, driver.reads.event && !driver.reads.indicators));
    format!(
        "/* Handles events until nothing changes sides; their number, -1 where that doesn't end. */\nstatic int \
         §_settle({y})\n{{\n    for (int k = 0; k < 8; k++) {{\n{before}        const uint32_t sides = §_sides({});\n        if \
         (sides == d->indicator_sides) {{\n            return k;\n        }}\n        d->indicator_sides = \
         sides;\n{between}        §_event({});\n    }}\n    return -1;\n}}\n\n",
        driver.called(law, Writes::Nothing, "x", "t"),
        driver.called(law, Writes::State, "x", "t")
    )
}

/// Parameters of a function that changes states and evaluates signals.
pub(super) fn declared_with_signals(driver: &Driver, law: &Law) -> String {
    driver.declared(law, Writes::State).replace("const §_signals *y", "§_signals *y")
}

/// One step of a copy of the states.
fn advance(law: &Law, structs: &Structs, driver: &Driver) -> String {
    let state = |name: &str| format!("§_{name}({})", driver.called(law, Writes::State, "x", "t"));
    let refuses =
        |call: &str, bit: &str| format!("    if ({call} != 0) {{\n        return §_REFUSED | §_{bit};\n    }}\n");
    let mut text = String::new();
    if law.reads_time {
        text += &format!("    real t = (real)self->steps * R({:?});\n", law.period);
    }
    let mut start = format!("    if (!self->started) {{\n{}", indented(&refuses(&state("start"), "INVALID")));
    if driver.has_events {
        start += &indented(&driver.find_sides(law));
    }
    text += &(start + "    }\n");
    if driver.has_changes {
        let evaluate = indented(&driver.evaluate(law, driver.reads.changed));
        text += &format!("    if (self->calibrated) {{\n{evaluate}        {};\n    }}\n", state("changed"));
    }
    if driver.has_events {
        text += &format!("    if ({} < 0) {{\n        return §_REFUSED | §_INVALID;\n    }}\n", state("settle"));
    }
    if driver.has_states {
        let constants = if law.constants.is_empty() { "" } else { ", &c" };
        if !law.constants.is_empty() {
            text += "    §_constants c;\n";
        }
        let called = driver.called(law, Writes::State, "x", "t");
        text += &refuses(&format!("§_integrate({called}{constants})"), "INVALID");
    }
    if law.reads_time {
        text += &format!("    t = (real)(self->steps + 1) * R({:?});\n", law.period);
    }
    if law.every > 0 {
        text += &sampling(law, driver);
    }
    text += &driver.evaluate(law, true);
    if !law.refusals(&law.recorded.check).is_empty() {
        let called = driver.called(law, Writes::Nothing, "x", "t");
        text += &refuses(&format!("§_check({called})"), "INVALID");
    }
    let (reals, integers) = law.changed(&law.recorded.completed);
    if !(reals.is_empty() && integers.is_empty()) {
        text += &format!("    {};\n", state("completed"));
    }
    text += &given(structs);
    let out = (!sound_outputs(law, structs).is_empty()).then_some("out");
    let sound = driver.has_states.then_some("x").into_iter().chain(out).collect::<Vec<_>>().join(", ");
    text += &format!("    if (!§_is_sound({sound})) {{\n        return §_REFUSED | §_DIVERGED;\n    }}\n");
    text += &bits(law, structs);
    let declared =
        if driver.has_signals { declared_with_signals(driver, law) } else { driver.declared(law, Writes::State) };
    let declared = declared.strip_suffix(", real t").unwrap_or(&declared);
    format!(
        "/* Takes a step of a copy of the states, and gives outputs. */\nstatic §_status §_advance({declared}, §_outputs *out)\n{{\n    §_status status = 0;\n{text}    return status;\n}}\n\n"
    )
}

/// Lines, one level further in.
pub(super) fn indented(lines: &str) -> String {
    lines.lines().map(|line| format!("    {line}\n")).collect()
}

/// A sample, in every call or in every n-th call.
fn sampling(law: &Law, driver: &Driver) -> String {
    let mut sample = driver.evaluate(law, driver.reads.sample);
    sample += &format!("    §_sample({});\n", driver.called(law, Writes::State, "x", "t"));
    if driver.counts_samples {
        sample += "    d->samples_taken++;\n";
    }
    if driver.has_events {
        sample += &driver.find_sides(law);
    }
    if law.every == 1 {
        return sample;
    }
    let every = law.every;
    format!(
        "    d->calls_since_sample++;\n    if (d->calls_since_sample >= {every}) {{\n        d->calls_since_sample = 0;\n{}    }}\n",
        indented(&sample)
    )
}

/// Outputs from signals and states.
fn given(structs: &Structs) -> String {
    let from = |place: usize| {
        let signal = structs.signals.access(place, true).map(|access| format!("y->{access}"));
        signal.or_else(|| structs.states.access(place, true).map(|access| format!("x->{access}")))
    };
    let line = |(to, place): (&String, usize)| Some(format!("    out->{to} = {};\n", from(place)?));
    structs.outputs.reals().filter_map(line).collect()
}

/// Bits of the status of a step that was taken.
fn bits(law: &Law, structs: &Structs) -> String {
    let mut text = String::new();
    let at = |place: usize| structs.signals.access(place, true).map(|access| format!("y->{access}"));
    let differ = |pairs: Vec<&(usize, usize)>| -> Vec<String> {
        let texts = pairs.into_iter().map(|(before, output)| Some(format!("{} != {}", at(*before)?, at(*output)?)));
        texts.flatten().collect()
    };
    let (pairs, outputs) = (law.limited(), structs.outputs.reals().collect::<Vec<_>>());
    let (of_outputs, others): (Vec<_>, Vec<_>) =
        pairs.iter().partition(|(_, output)| outputs.iter().any(|(_, place)| place == output));
    let mut cut = differ(others);
    for (to, place) in outputs {
        let limits = law.control(place).map_or([None, None], |k| limits_of_control(law, structs, k));
        let beyond = limits.into_iter().zip(["<=", ">="]);
        let mut all = differ(of_outputs.iter().filter(|(_, output)| *output == place).copied().collect());
        all.extend(beyond.filter_map(|(limit, beyond)| Some(format!("out->{to} {beyond} {}", limit?))));
        cut.extend((!all.is_empty()).then(|| all.join(" || ")));
    }
    for Run { text: cut, elements } in runs(&cut) {
        let line = format!("    if ({cut}) {{\n        status |= §_LIMITED;\n    }}\n");
        text += &elements.map_or(line.clone(), |elements| looped(elements, &line));
    }
    for (flag, (name, ..)) in law.flags().into_iter().zip(flags(law)) {
        let place = law.variables().index(flag);
        let discrete = structs.discrete.access(place, false).map(|access| format!("d->{access}"));
        let found = discrete.or_else(|| structs.signals.access(place, false).map(|access| format!("y->{access}")));
        if let Some(found) = found {
            let is = if matches!(flag.variable.data, Data::Boolean { .. }) { found } else { format!("{found} != 0") };
            let _ = write!(text, "    if ({is}) {{\n        status |= §_{name};\n    }}\n");
        }
    }
    text
}

/// Lines, once for each of these elements `i`.
fn looped((first, end): (usize, usize), lines: &str) -> String {
    format!("    for (int i = {first}; i < {end}; i++) {{\n{}    }}\n", indented(lines))
}

/// Checks that inputs are numbers.
fn checks(structs: &Structs) -> String {
    let mut text = String::new();
    for (members, name, of) in [(&structs.inputs, "inputs", "in"), (&structs.manual, "manual", "manual")] {
        let reals = members.list.iter().filter(|member| member.is_real);
        let reals = each(reals, &[&format!("sound = sound && isfinite({of}->@);")]);
        if !members.is_empty() {
            let unused = if reals.is_empty() { format!("    (void){of};\n") } else { String::new() };
            let _ = write!(
                text,
                "/* True if these are numbers. */\nstatic bool §_{name}_are_numbers(const §_{name} *{of})\n{{\n    bool sound = \
                 true;\n{unused}{reals}    return sound;\n}}\n\n"
            );
        }
    }
    text
}
