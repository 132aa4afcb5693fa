//! The part of a controller's recorded equations that its outputs need, where some parameters stay variables.

use std::collections::BTreeSet;

use super::common::Common;
use super::constants::{self, Constant};
use super::live::Live;
use super::parameters::{calibrated, calls_from_sample_to_sample, prepared};
use super::{Fallback, Options};
use crate::error::Invalid;
use crate::fmi2::source;
use crate::model::{Block, Model};
use crate::recording::{Binary, Comparison, Leaf, Method, Node, Note, Operation, Recording, Tape};
use crate::system::{Causality, Element, SamplingClock, Section, Variable, Variables};

/// Names in the interface of all controllers. A call sets whether the controller is in command; it is no input of a
/// step.
pub(super) const ENABLED: &str = "enabled";
pub(super) const U_MANUAL: &str = "u_manual";
pub(super) const CONTROL: &str = "u";
pub(super) const LIMITS: [&str; 2] = ["u_min", "u_max"];

/// Sections that follow from parameters; those that a step continues with; those that an evaluation writes.
const FROM_PARAMETERS: [Section; 2] = [Section::Parameter, Section::Prepared];
const CONTINUED: [Section; 3] = [Section::State, Section::Discrete, Section::Memory];
pub(super) const EVALUATED: [Section; 3] = [Section::Connected, Section::Signal, Section::Derivative];
/// Bits of a status that outputs may have.
pub(super) const MOST_FLAGS: usize = 24;

/// Places of the block, each with its new value.
pub(super) type Places = Vec<(usize, Node)>;

/// Methods that change states and discrete values, or refuse.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    pub evaluate: Recording,
    /// The constants of a step, and the evaluation, where they are given: for the state equation, and for signals, whose constants
    /// aren't given unless [`Law::evaluates_once`].
    pub constants: Recording,
    pub rates: Recording,
    pub signals: Recording,
    pub indicators: Recording,
    pub start: Recording,
    pub relate: Recording,
    pub parameters_changed: Recording,
    pub check: Recording,
    /// An event that is no sample, and a sample.
    pub event: Recording,
    pub sample: Option<Recording>,
    pub completed: Recording,
}

/// A law that is written.
#[derive(Debug)]
pub(super) struct Law<'a> {
    pub model: &'a Model,
    /// Time between calls, s.
    pub period: f64,
    pub substeps: u32,
    pub fallback: Fallback,
    /// Calls from sample to sample; 0 where it isn't sampled.
    pub every: u32,
    /// The values that it begins with, prepared.
    pub start: Block,
    /// The names of all reals and integers, and the sources of the equations of reals.
    pub real_names: Vec<String>,
    pub integer_names: Vec<String>,
    pub sources: Vec<&'static str>,
    /// Flags of the reals and integers that stay variables: parameters and what follows from them.
    variable_reals: Vec<bool>,
    variable_integers: Vec<bool>,
    clock: Option<SamplingClock<usize>>,
    /// Reals and integers that an evaluation could write and doesn't: they stay as they begin.
    never_written: Live,
    pub recorded: Recorded,
    /// Flags of the reals and integers that the outputs need.
    pub live: Live,
    pub constants: Vec<Constant>,
    /// Results that the start and an event share.
    pub common: Option<Common>,
    /// True if signals are evaluated at the end of a step only, where its constants are known.
    pub evaluates_once: bool,
    /// Operations that signals then have in common with the state equation.
    pub shared: usize,
    /// Event indicators that can change sides and have an effect, and whether they do so within a step.
    pub indicators: Vec<usize>,
    pub events_within: bool,
    /// True if an equation reads time.
    pub reads_time: bool,
}

impl<'a> Law<'a> {
    /// A model's law.
    ///
    /// # Errors
    /// Options that don't fit it, and what C for targets can't do.
    pub fn of(model: &'a Model, options: &Options) -> Result<Self, Invalid> {
        model.check_recorded()?;
        let variables = model.variables();
        let (start, period) = prepared(model, options)?;
        let mut clocks = variables.clocks();
        let clock = clocks.next();
        if clocks.next().is_some() {
            let allowed = "can't be exported for a target: it has several clocks. Export its parts one by one";
            return Err(Invalid::new("model", &model.description().model, allowed));
        }
        let every = clock.map_or(Ok(0), |clock| calls_from_sample_to_sample(model, &start, &clock, period))?;
        let (variable_reals, variable_integers) = calibrated(model, options)?;
        let mut law = Law {
            model,
            period,
            substeps: options.substeps,
            fallback: options.fallback,
            every,
            real_names: source::names(variables, true),
            integer_names: source::names(variables, false),
            sources: source::sources(variables, start.reals.len()),
            start,
            variable_reals,
            variable_integers,
            clock,
            never_written: never_written(model),
            recorded: Recorded::default(),
            live: Live::default(),
            constants: Vec::new(),
            common: None,
            evaluates_once: false,
            shared: 0,
            indicators: Vec::new(),
            events_within: false,
            reads_time: false,
        };
        law.record();
        law.check_time_events()?;
        law.find_live();
        law.find_indicators()?;
        law.check_emitted()?;
        law.evaluates_once = constants::evaluates_once(&law);
        (law.constants, [law.recorded.constants, law.recorded.rates, law.recorded.signals]) = constants::split(&law);
        law.shared = constants::shared(&law);
        law.reads_time =
            law.all().into_iter().any(|(recording, nodes)| leaves(recording, &nodes).contains(&Leaf::Time));
        Ok(law)
    }

    pub fn variables(&self) -> &'a Variables {
        self.model.variables()
    }

    /// The number that a real value is throughout, where it is one.
    pub fn constant(&self, place: usize) -> Option<f64> {
        let variables = self.variables();
        if let Some(clock) = &self.clock {
            if place == clock.start || place == clock.shift {
                return Some(0.0);
            }
            if place == clock.period {
                return Some(self.period * f64::from(self.every));
            }
        }
        let is_fixed = is_in(&FROM_PARAMETERS, |section| variables.reals(section), place);
        (is_fixed && !self.variable_reals[place] || self.never_written.reals[place]).then(|| self.start.reals[place])
    }

    /// The same of an integer.
    fn constant_integer(&self, place: usize) -> Option<i32> {
        let variables = self.variables();
        if variables.stepped() == Some(place) {
            return Some(1);
        }
        let is_fixed = is_in(&FROM_PARAMETERS, |section| variables.integers(section), place);
        (is_fixed && !self.variable_integers[place] || self.never_written.integers[place])
            .then(|| self.start.integers[place])
    }

    /// True if a real value counts samples.
    pub fn counts_samples(&self, place: usize) -> bool {
        self.clock.is_some_and(|clock| clock.count == place)
    }

    /// The number in place of a leaf: structure (0, 1, −1). Other constants have names in the text.
    fn folded(&self, leaf: Leaf) -> Option<f64> {
        match leaf {
            Leaf::Real(place) => self.constant(place as usize).filter(|value| [0.0, 1.0, -1.0].contains(value)),
            Leaf::Integer(place) => self.constant_integer(place as usize).map(f64::from),
            _ => None,
        }
    }

    /// The value of a state or a discrete variable before the start sets it.
    fn started(&self, leaf: Leaf) -> Option<f64> {
        let variables = self.variables();
        match leaf {
            Leaf::Real(place) => {
                let place = place as usize;
                is_in(&CONTINUED, |section| variables.reals(section), place).then(|| self.start.reals[place])
            }
            Leaf::Integer(place) => {
                let place = place as usize;
                let is_one = is_in(&CONTINUED, |section| variables.integers(section), place);
                is_one.then(|| f64::from(self.start.integers[place]))
            }
            _ => None,
        }
    }

    fn record(&mut self) {
        let of = |method| self.recorded_as(method, &|_, _| None);
        let idle = |tape: &Tape, node: Node| self.is_due(tape, node).then_some(false);
        let due = |tape: &Tape, node: Node| self.is_due(tape, node).then_some(true);
        let recorded = Recorded {
            evaluate: of(Method::Evaluate),
            constants: Recording::default(),
            rates: Recording::default(),
            signals: Recording::default(),
            indicators: of(Method::Indicators),
            start: of(Method::Start),
            relate: of(Method::Relate),
            parameters_changed: of(Method::ParametersChanged),
            check: of(Method::Check),
            event: self.recorded_as(Method::Event, &idle),
            sample: (self.every > 0).then(|| self.recorded_as(Method::Event, &due)),
            completed: of(Method::StepCompleted),
        };
        self.recorded = recorded;
    }

    fn recorded_as(&self, method: Method, decided: &dyn Fn(&Tape, Node) -> Option<bool>) -> Recording {
        let layout = self.variables().layout();
        let known = |leaf| self.folded(leaf).or_else(|| self.started(leaf).filter(|_| method == Method::Start));
        let recording = Recording::of_known(self.model.system(), method, &layout, &known);
        let known = self.known(&recording.tape);
        recording.simplified(&|tape, node| {
            if self.is_reached(tape, node) {
                return Some(true);
            }
            let is_condition = matches!(
                tape.operation(node),
                Operation::Compare(..) | Operation::Not(_) | Operation::And(..) | Operation::Or(..)
            );
            decided(tape, node).or_else(|| known[node.index()].filter(|_| is_condition).map(|value| value != 0.0))
        })
    }

    /// The values of operations that follow from constants only.
    fn known(&self, tape: &Tape) -> Vec<Option<f64>> {
        let mut known: Vec<Option<f64>> = Vec::with_capacity(tape.operations().len());
        for operation in tape.operations() {
            let of = |node: Node| known[node.index()];
            let value = match operation {
                Operation::Leaf(Leaf::Real(place)) => self.constant(*place as usize),
                Operation::Leaf(Leaf::Integer(place)) => self.constant_integer(*place as usize).map(f64::from),
                Operation::Leaf(Leaf::Step) => Some(self.period),
                Operation::Leaf(_) | Operation::Iterate { .. } | Operation::Part(..) | Operation::Carried(_) => None,
                _ if operation.operands().all(|operand| of(operand).is_some()) => {
                    operation.value(|node| of(node).unwrap_or(f64::NAN))
                }
                _ => None,
            };
            known.push(value);
        }
        known
    }

    /// True for a condition that all numbers of samples fulfil: a first sample that is awaited is this one.
    fn is_reached(&self, tape: &Tape, node: Node) -> bool {
        let Operation::Compare(Comparison::AtMost, least, count) = tape.operation(node) else { return false };
        let is_count = |node: Node| {
            self.clock.is_some_and(|clock| *tape.operation(node) == Operation::Leaf(Leaf::Real(clock.count as u32)))
        };
        let begins = match tape.operation(*count) {
            Operation::Binary(Binary::Add, of, further) if is_count(*of) => tape.constant(*further),
            _ => is_count(*count).then_some(0.0),
        };
        begins.zip(tape.constant(*least)).is_some_and(|(begins, least)| least <= begins)
    }

    /// True for the condition of a due sample: that time has reached what follows from the number of samples.
    fn is_due(&self, tape: &Tape, node: Node) -> bool {
        let Operation::Compare(Comparison::AtMost | Comparison::Below, next, time) = tape.operation(node) else {
            return false;
        };
        let Some(clock) = self.clock else { return false };
        let counts = |leaf| leaf == Leaf::Real(clock.count as u32);
        *tape.operation(*time) == Operation::Leaf(Leaf::Time) && !tape.dependence(&[*next], counts)[0].is_empty()
    }

    /// Refuses events at times that only the equations know.
    fn check_time_events(&self) -> Result<(), Invalid> {
        let next = self.recorded_as(Method::NextTimeEvent, &|_, _| None);
        let counts = |leaf| self.clock.is_some_and(|clock| leaf == Leaf::Real(clock.count as u32));
        let is_known = |node: &Node| {
            next.tape.constant(*node) == Some(f64::INFINITY) || !next.tape.dependence(&[*node], counts)[0].is_empty()
        };
        if next.results.iter().all(is_known) {
            return Ok(());
        }
        let allowed = "can't be exported for a target: it has events at times that aren't its samples. `export --source` \
                       writes C with all events";
        Err(Invalid::new("model", &self.model.description().model, allowed))
    }

    /// Refuses what has no text in C: random numbers, more flags than a status has bits.
    fn check_emitted(&self) -> Result<(), Invalid> {
        let refuse = |reason: &str| Err(Invalid::new("model", &self.model.description().model, reason));
        let draws = |(recording, nodes): (&Recording, Vec<Node>)| {
            let needed = recording.tape.needed(&nodes);
            let operations = recording.tape.operations().iter().zip(needed);
            operations.filter(|(_, needed)| *needed).any(|(one, _)| matches!(one, Operation::Opaque(..)))
        };
        if self.all().into_iter().any(draws) {
            return refuse("can't be exported for a target: it draws random numbers");
        }
        if self.flags().len() > MOST_FLAGS {
            return refuse(
                "can't be exported for a target: a status has bits for 24 Boolean and Integer outputs at most",
            );
        }
        Ok(())
    }

    /// Live states and discrete values that a method changes: real places, integer places, each with its new value.
    pub fn changed(&self, recording: &Recording) -> (Places, Places) {
        let variables = self.variables();
        let is_same = |node: Node, leaf| *recording.tape.operation(node) == Operation::Leaf(leaf);
        let reals = CONTINUED.iter().flat_map(|&section| variables.reals(section)).filter(|&place| {
            self.live.reals[place]
                && !self.counts_samples(place)
                && !is_same(recording.reals[place], Leaf::Real(place as u32))
        });
        let integers = CONTINUED.iter().flat_map(|&section| variables.integers(section)).filter(|&place| {
            self.live.integers[place] && !is_same(recording.integers[place], Leaf::Integer(place as u32))
        });
        (
            reals.map(|place| (place, recording.reals[place])).collect(),
            integers.map(|place| (place, recording.integers[place])).collect(),
        )
    }

    /// Conditions under which a method refuses, with the reasons; numbers in these are left out.
    pub fn refusals(&self, recording: &Recording) -> Vec<(Node, String)> {
        let reason = |note: &Note| match note {
            Note::Refusal { condition, reason } => {
                let text = self.variables().named(&reason.to_string());
                let mut pieces = text.split("{node ");
                let first = pieces.next().unwrap_or_default().to_owned();
                let behind = |piece: &str| piece.split_once('}').map_or(String::new(), |(_, rest)| rest.to_owned());
                Some((*condition, pieces.fold(first, |start, piece| start + "..." + &behind(piece))))
            }
            Note::Message { .. } => None,
        };
        recording.tape.notes().iter().filter_map(reason).collect()
    }

    /// The state equation: live states, by their places, and their rates.
    pub fn rates(&self) -> Places {
        let variables = self.variables();
        let (first, rate) = (variables.reals(Section::State).start, variables.reals(Section::Derivative).start);
        let states = variables.reals(Section::State).filter(|&place| self.live.reals[place]);
        states.map(|place| (place, self.recorded.evaluate.reals[rate + place - first])).collect()
    }

    /// Signals that something besides the state equation reads: outputs, and what other methods read.
    pub fn signals(&self) -> Places {
        let places = EVALUATED.iter().flat_map(|&section| self.variables().reals(section));
        places
            .filter(|&place| self.live.reals[place])
            .map(|place| (place, self.recorded.evaluate.reals[place]))
            .collect()
    }

    /// Whole signals that are no real numbers.
    pub fn whole_signals(&self) -> Places {
        let places = EVALUATED.iter().flat_map(|&section| self.variables().integers(section));
        let live = places.filter(|&place| self.live.integers[place]);
        live.map(|place| (place, self.recorded.evaluate.integers[place])).collect()
    }

    /// Real outputs that a step gives: those that follow from the equations, not what a law keeps account of.
    pub fn outputs(&self) -> Vec<Element<'a>> {
        let is_output = |y: &Element| {
            y.variable.is_real()
                && y.variable.causality == Causality::Output
                && matches!(y.variable.section, Section::Signal | Section::State)
        };
        self.variables().visible().filter(is_output).collect()
    }

    /// Outputs that are a bit of a step's status.
    pub fn flags(&self) -> Vec<Element<'a>> {
        let is_flag = |y: &Element| !y.variable.is_real() && y.variable.causality == Causality::Output;
        self.variables().visible().filter(is_flag).collect()
    }

    /// Inputs of a step.
    pub fn inputs(&self) -> Vec<Element<'a>> {
        let is_input = |u: &Element| u.variable.causality == Causality::Input && !self.is_manual(u.variable);
        self.variables().visible().filter(is_input).collect()
    }

    /// True for inputs by which a person takes command.
    pub fn is_manual(&self, variable: &Variable) -> bool {
        let is = |name: &str| variable.name == name;
        let has_both = [ENABLED, U_MANUAL].iter().all(|name| self.variables().iter().any(|v| v.name == *name));
        variable.section == Section::Input && has_both && (is(ENABLED) || is(U_MANUAL))
    }

    /// Parameters that stay variables and that something reads.
    pub fn parameters(&self) -> Vec<Element<'a>> {
        let variables = self.variables();
        let is_one = |p: &Element| {
            let place = variables.index(*p);
            let (is_variable, is_live) = if p.variable.is_real() {
                (self.variable_reals[place], self.live.reals[place])
            } else {
                (self.variable_integers[place], self.live.integers[place])
            };
            p.variable.section == Section::Parameter && is_variable && is_live
        };
        variables.visible().filter(is_one).collect()
    }

    /// Values that follow from parameters that stay variables, by their places, and their nodes.
    pub fn prepared(&self) -> Places {
        let places = self.variables().reals(Section::Prepared);
        let of = |place: usize| (place, self.recorded.relate.reals[place]);
        places.filter(|&place| self.variable_reals[place] && self.live.reals[place]).map(of).collect()
    }

    /// All that is written, as the nodes of recordings.
    pub fn all(&self) -> Vec<(&Recording, Vec<Node>)> {
        let nodes = |of: Places| of.into_iter().map(|(_, node)| node).collect::<Vec<_>>();
        let conditions =
            |of: &Recording| self.refusals(of).into_iter().map(|(condition, _)| condition).collect::<Vec<_>>();
        let mut all = vec![(
            &self.recorded.evaluate,
            [self.rates(), self.signals(), self.whole_signals()].into_iter().flat_map(nodes).collect(),
        )];
        let changing = [
            Some(&self.recorded.start),
            Some(&self.recorded.parameters_changed),
            Some(&self.recorded.event),
            self.recorded.sample.as_ref(),
            Some(&self.recorded.completed),
            Some(&self.recorded.check),
        ];
        for recording in changing.into_iter().flatten() {
            let (reals, integers) = self.changed(recording);
            all.push((recording, [nodes(reals), nodes(integers), conditions(recording)].concat()));
        }
        all.push((&self.recorded.relate, [nodes(self.prepared()), conditions(&self.recorded.relate)].concat()));
        let results = &self.recorded.indicators.results;
        all.push((&self.recorded.indicators, self.indicators.iter().map(|&k| results[k]).collect()));
        all
    }
}

/// Values of the sections that an evaluation writes, which it doesn't write.
fn never_written(model: &Model) -> Live {
    let variables = model.variables();
    let recording = Recording::of(model.system(), Method::Evaluate, &variables.layout());
    let is = |node: Node, leaf| *recording.tape.operation(node) == Operation::Leaf(leaf);
    let mut never = Live { reals: vec![false; recording.reals.len()], integers: vec![false; recording.integers.len()] };
    for section in EVALUATED {
        for place in variables.reals(section) {
            never.reals[place] = is(recording.reals[place], Leaf::Real(place as u32));
        }
        for place in variables.integers(section) {
            never.integers[place] = is(recording.integers[place], Leaf::Integer(place as u32));
        }
    }
    never
}

/// True if a place is in one of some sections, whose places are found by a function.
pub(super) fn is_in(sections: &[Section], places: impl Fn(Section) -> std::ops::Range<usize>, place: usize) -> bool {
    sections.iter().any(|&section| places(section).contains(&place))
}

/// Leaves that nodes read.
pub(super) fn leaves(recording: &Recording, nodes: &[Node]) -> BTreeSet<Leaf> {
    let needed = recording.tape.needed(nodes);
    let leaf = |(place, operation): (usize, &Operation)| match operation {
        Operation::Leaf(leaf) if needed[place] => Some(*leaf),
        _ => None,
    };
    recording.tape.operations().iter().enumerate().filter_map(leaf).collect()
}
