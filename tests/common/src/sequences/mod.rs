//! Any functions in any order with any arguments, against the standard's state machine.
//!
//! What holds of every call, whatever was called before: it comes back; it is refused where the standard forbids it or
//! an argument is wrong, with one message that names it, and leaves the instance bit for bit as it was; where it is
//! right, values read back, numbers are numbers, and time is where the steps led. What the master is to blame for is
//! left out: pointers that lead nowhere, and two threads in one instance.

mod catalog;
mod dice;
mod progress;
mod saved;
mod tally;
mod values;

use std::time::Instant;

use adaptive_fmu::fmi2::types::*;

use super::{DISCARD, ERROR, OK, Unit, standard};
use catalog::Catalog;
use dice::Dice;
use saved::Saved;
pub use tally::Tally;

/// Frequent functions of each phase; any other is called, too.
const USUAL: [(char, &[&str]); 8] = [
    ('I', &["fmi2EnterInitializationMode", "fmi2SetReal", "fmi2SetupExperiment", "fmi2SetInteger", "fmi2SetBoolean"]),
    ('M', &["fmi2ExitInitializationMode", "fmi2ExitInitializationMode", "fmi2SetReal", "fmi2GetReal", "fmi2Reset"]),
    (
        'S',
        &[
            "fmi2DoStep",
            "fmi2DoStep",
            "fmi2DoStep",
            "fmi2SetReal",
            "fmi2GetReal",
            "fmi2SetRealInputDerivatives",
            "fmi2GetFMUstate",
        ],
    ),
    (
        'V',
        &[
            "fmi2NewDiscreteStates",
            "fmi2EnterContinuousTimeMode",
            "fmi2SetReal",
            "fmi2GetReal",
            "fmi2SetTime",
            "fmi2GetFMUstate",
        ],
    ),
    (
        'C',
        &[
            "fmi2SetTime",
            "fmi2SetContinuousStates",
            "fmi2GetDerivatives",
            "fmi2CompletedIntegratorStep",
            "fmi2CompletedIntegratorStep",
            "fmi2EnterEventMode",
            "fmi2SetReal",
            "fmi2GetReal",
        ],
    ),
    ('F', &["fmi2SetFMUstate", "fmi2SetFMUstate", "fmi2Reset", "fmi2GetReal"]),
    ('T', &["fmi2SetFMUstate", "fmi2SetFMUstate", "fmi2Reset", "fmi2GetReal"]),
    ('E', &["fmi2SetFMUstate", "fmi2SetFMUstate", "fmi2Reset", "fmi2GetReal"]),
];

/// Functions that take bytes of a state.
const STATES: [&str; 3] = ["fmi2DeSerializeFMUstate", "fmi2SetFMUstate", "fmi2GetFMUstate"];

/// Correctness of a call's arguments, as far as the standard and the modelDescription.xml determine it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arguments {
    Right,
    Wrong,
    /// A matter of rounding.
    Unclear,
}

impl Arguments {
    fn of(right: bool) -> Self {
        if right { Arguments::Right } else { Arguments::Wrong }
    }
}

/// State of an instance after the calls so far.
#[derive(Debug, Clone, PartialEq)]
struct Mark {
    phase: char,
    time: f64,
    stop: Option<f64>,
    /// True if tunable parameters were set at the present event.
    waiting: bool,
    /// Everything that a continuation depends on.
    fingerprint: Vec<u8>,
}

/// An FMU with which sequences of calls are made, each by an instance of its own.
pub struct Subject {
    text: String,
    kind: i32,
    catalog: Catalog,
    /// Another instance of it, which others' states are restored in.
    twin: Unit,
    /// A saved state of that one.
    foreign: FmuState,
    /// States of other FMUs and of the other interface, as bytes.
    strangers: Vec<Vec<u8>>,
}

impl Subject {
    pub fn new(text: &str, kind: i32) -> Self {
        let made = |text: &str, kind| Unit::made(adaptive_fmu::library::REGISTRY, text, kind);
        let twin = made(text, kind);
        let other_interface = made(text, MODEL_EXCHANGE + CO_SIMULATION - kind).fingerprint();
        let others = ["Actuator", "Sensor"].iter().filter(|name| **name != twin.model.description().name);
        let others = others.map(|name| made(&super::description(name), kind).fingerprint());
        let strangers = others.chain([other_interface]).collect();
        Subject {
            text: text.to_owned(),
            kind,
            catalog: Catalog::new(&twin.model),
            foreign: twin.save(),
            strangers,
            twin,
        }
    }

    /// Makes a sequence of calls with a new instance; each number is a call.
    pub fn calls(&self, calls: &[u128], tally: &mut Tally) {
        let unit = Unit::made(adaptive_fmu::library::REGISTRY, &self.text, self.kind);
        let fingerprint = unit.fingerprint();
        let start = Mark { phase: 'I', time: 0.0, stop: None, waiting: false, fingerprint };
        let mut sequence = Sequence {
            subject: self,
            unit: &unit,
            start: start.clone(),
            now: start,
            component: unit.component,
            saved: Vec::new(),
            freed: Vec::new(),
            calls: Vec::new(),
            tally,
        };
        for &call in calls {
            sequence.any(Dice(call));
        }
    }
}

/// A sequence of calls that goes on.
struct Sequence<'a> {
    subject: &'a Subject,
    unit: &'a Unit,
    start: Mark,
    now: Mark,
    /// The instance, or NULL.
    component: Component,
    saved: Vec<Saved>,
    freed: Vec<FmuState>,
    /// The calls so far, for the message of a failure.
    calls: Vec<String>,
    tally: &'a mut Tally,
}

impl Sequence<'_> {
    /// Calls any function.
    fn any(&mut self, mut dice: Dice) {
        let usual = USUAL.iter().find(|(phase, _)| *phase == self.now.phase).map_or(&[][..], |(_, names)| names);
        let name = match dice.below(20) {
            0..=13 => dice.pick(usual),
            14..=17 => dice.pick(&standard::FUNCTIONS).0,
            18 => dice.pick(&STATES),
            _ => return self.continue_twice(),
        };
        self.component = if dice.one_in(50) { std::ptr::null_mut() } else { self.unit.component };
        let dice = &mut dice;
        let rest = name.strip_prefix("fmi2").unwrap_or_default();
        match rest {
            "GetRealOutputDerivatives" | "SetRealInputDerivatives" => self.first_derivatives(name, dice),
            "GetRealStatus" | "GetBooleanStatus" | "GetStatus" | "GetIntegerStatus" | "GetStringStatus" => {
                self.status(name, dice);
            }
            "GetReal" | "GetInteger" | "GetBoolean" => self.get(name, dice),
            "SetReal" | "SetInteger" | "SetBoolean" => self.set(name, dice),
            "GetString" | "SetString" => self.strings(name, dice),
            "GetDirectionalDerivative" => self.directional_derivative(dice),
            "GetContinuousStates"
            | "GetDerivatives"
            | "GetEventIndicators"
            | "GetNominalsOfContinuousStates"
            | "SetContinuousStates" => self.all_states(name, dice),
            _ if rest.contains("FMUstate") => self.states(name, dice),
            _ => self.progress(name, dice),
        }
    }

    /// Makes one call and checks what holds of all: the answer to go on with, unless it had to be refused.
    fn call(
        &mut self,
        name: &'static str,
        arguments: Arguments,
        arguments_text: String,
        call: impl FnOnce(Component) -> Status,
    ) -> Option<Status> {
        self.unit.messages();
        let begun = Instant::now();
        let status = call(self.component);
        let took = begun.elapsed();
        let null = if self.component.is_null() { " of NULL" } else { "" };
        self.calls
            .push(format!("{} {name}({arguments_text}){null} -> {status:?} at {} s", self.now.phase, self.now.time));
        self.tally.add(name, status, took, || format!("{}: {}", self.subject.catalog.name, self.calls.join("\n")));
        self.check_messages(name, status);
        let fingerprint = self.unit.fingerprint();
        let unchanged = fingerprint == self.now.fingerprint;
        let allowed = standard::phases(name, self.subject.kind).contains(self.now.phase);
        if !allowed || self.component.is_null() || arguments == Arguments::Wrong {
            self.expect(status == ERROR, "is refused");
            self.expect(unchanged, "a refused call changes nothing");
            return None;
        }
        let reads = (name.contains("Get") || name.contains("erialize")) && (self.stands() || name.contains("FMUstate"));
        if name == "fmi2SetDebugLogging" || name == "fmi2FreeFMUstate" || reads {
            self.expect(unchanged, "what only reads changes nothing");
        }
        let wary = arguments == Arguments::Unclear || self.may_fail(name);
        self.expect(wary || status != ERROR, "right arguments are accepted");
        let before = std::mem::replace(&mut self.now.fingerprint, fingerprint);
        if status == ERROR && self.now.phase == 'M' {
            // What is calculated is calculated anew when it is next asked for.
            self.expect_as_before(&before, |entry| !entry.calculated());
        }
        Some(status)
    }

    /// True if what is calculated changes with steps only: in co-simulation once it is initialised.
    fn stands(&self) -> bool {
        self.subject.kind == CO_SIMULATION && self.now.phase != 'M'
    }

    /// True if a call may fail for what was set before it.
    fn may_fail(&self, name: &str) -> bool {
        let ends = ["fmi2ExitInitializationMode", "fmi2DoStep", "fmi2NewDiscreteStates", "fmi2CompletedIntegratorStep"];
        ends.contains(&name) || name == "fmi2EnterContinuousTimeMode" || self.now.phase == 'M' && name.contains("Get")
    }

    fn check_messages(&mut self, name: &str, status: Status) {
        let messages = self.unit.messages();
        for (_, _, text) in &messages {
            let one_line = crate::is_plain_format(text) && !text.contains('\n') && !text.is_empty();
            self.expect(one_line, &format!("a message is a line, and a format without arguments: {text}"));
            self.expect(!text.contains("internal fault"), text);
        }
        let errors: Vec<_> = messages.iter().filter(|(status, ..)| *status == ERROR as i32).collect();
        if status == ERROR && !self.component.is_null() {
            self.expect(
                errors.len() == 1 && errors[0].2.starts_with(name),
                &format!("one error by name: {messages:?}"),
            );
        } else {
            self.expect(errors.is_empty(), &format!("no error is told of: {messages:?}"));
        }
    }

    /// True if the instance is still good for what its phase allows, after a call that failed; else it is in error.
    fn note_whether_it_failed_for_good(&mut self) {
        let none = std::ptr::null();
        let alive =
            unsafe { adaptive_fmu_library::fmi2_functions::fmi2SetReal(self.unit.component, none, 0, none.cast()) };
        if alive != OK {
            self.now.phase = 'E';
        }
    }

    /// Values of an FMU after a state, without any that must be computed.
    fn read(&self, unit: &Unit, wanted: impl Fn(&catalog::Entry) -> bool) -> (Status, Vec<u64>) {
        let references: Vec<u32> =
            self.subject.catalog.reals.iter().filter(|e| wanted(e)).map(|e| e.reference).collect();
        let mut values = vec![0.0; references.len()];
        let status = unit.get_reals(&references, &mut values);
        (status, values.into_iter().map(f64::to_bits).collect())
    }

    /// Asserts that values are as they were before a call that failed.
    fn expect_as_before(&self, before: &[u8], wanted: impl Fn(&catalog::Entry) -> bool + Copy) {
        let twin = self.twin_in(before);
        let same = self.read(self.unit, wanted) == self.read(twin, wanted);
        self.expect(same, "values are as before a call that failed");
    }

    /// The other instance, brought to a state by its bytes.
    fn twin_in(&self, state: &[u8]) -> &Unit {
        let twin = &self.subject.twin;
        let (status, saved) = twin.deserialise(state);
        self.expect(status == OK && twin.restore(saved) == OK && twin.free(saved) == OK, "a state fits its twin");
        twin
    }

    /// Goes on, back, on again, and on in another instance: each time alike, bit for bit.
    fn continue_twice(&mut self) {
        self.calls.push(format!("{} goes on, back, and on again", self.now.phase));
        let state = self.unit.save();
        let first = self.go_on(self.unit);
        self.expect(self.unit.restore(state) == OK && self.unit.free(state) == OK, "a saved state is restored");
        self.expect(self.unit.fingerprint() == self.now.fingerprint, "a restored state is the one that was saved");
        let twin = self.twin_in(&self.now.fingerprint);
        self.expect(twin.fingerprint() == self.now.fingerprint, "a state is the same in another instance");
        self.expect(self.go_on(twin) == first, "an instance goes on alike");
        self.tally.continued += 1;
    }

    /// A few calls that fit where the instance is; all answers.
    fn go_on(&self, unit: &Unit) -> (Vec<Status>, Vec<u64>, Vec<u8>) {
        use adaptive_fmu_library::fmi2_functions::*;
        let c = unit.component;
        let mut dx = vec![7.0; self.subject.catalog.states];
        let (mut answers, t, h) = (Vec::new(), self.now.time, 1e-4);
        if self.now.phase == 'I' {
            answers.push(unsafe { fmi2EnterInitializationMode(c) });
        }
        if "IM".contains(self.now.phase) {
            answers.push(unit.exit());
        }
        if self.subject.kind == CO_SIMULATION {
            answers.extend([unit.step(t, h), unit.step(t + h, h)]);
        } else {
            let update = || unit.try_new_discrete_states().map_or_else(|status| status, |_| OK);
            answers.extend([update(), update(), unit.enter_continuous_time_mode(), unit.set_time(t + h)]);
            answers.extend([unit.try_derivatives(&mut dx), unit.try_completed_step(&mut 0)]);
        }
        let (status, values) = self.read(unit, |_| true);
        answers.push(status);
        (answers, dx.into_iter().map(f64::to_bits).chain(values).collect(), unit.fingerprint())
    }

    #[track_caller]
    fn expect(&self, holds: bool, what: &str) {
        let Subject { catalog, kind, .. } = self.subject;
        let interface = if *kind == CO_SIMULATION { "co-simulation" } else { "model exchange" };
        assert!(holds, "{} in {interface}: {what}\n{}", catalog.name, self.calls.join("\n"));
    }

    fn expect_finite(&self, values: &[f64]) {
        self.expect(values.iter().all(|value| value.is_finite()), &format!("numbers are given: {values:?}"));
    }
}
