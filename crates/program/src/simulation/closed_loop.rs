//! The master: steps components together, and passes outputs to inputs.

use super::ahead::Ahead;
use super::changes::{Change, Coming, Place};
use super::port::Ports;
use super::recording::Recording;
use super::settling::Settling;
use crate::error::Error;
use crate::fmu::{Common, Instance, Messages};
use crate::model_description::Affine;
use crate::model_description::Variable;
use crate::report::number;
use crate::structure::{Order, Settings};

/// The most exchanges at one communication point.
const EVENT_ITERATIONS: usize = 100;
/// The most messages of a component in a recording; further ones are counted, and the last is recorded.
const MOST_MESSAGES: usize = 100;

/// A component with its outputs and inputs.
#[derive(Debug)]
struct WiredUnit {
    instance: Instance,
    outputs: Ports,
    inputs: Ports,
    logged: LoggedMessages,
    /// True if it was instantiated for Event Mode.
    by_events: bool,
}

/// Messages of a component.
#[derive(Debug, Default)]
pub(super) struct LoggedMessages {
    count: usize,
    last: String,
    /// Messages of calls that succeeded.
    details: Vec<String>,
}

impl LoggedMessages {
    /// Adds messages to the warnings of a run: the first hundred of the component.
    pub fn keep(&mut self, unit: &str, messages: &Messages, warnings: &mut Vec<String>) {
        if messages.count() == 0 && messages.details().is_empty() {
            return;
        }
        for text in messages.iter() {
            self.last = format!("{unit}: {text}");
            if self.count < MOST_MESSAGES {
                warnings.push(self.last.clone());
            }
            self.count += 1;
        }
        self.count += messages.count() - messages.iter().count();
        self.details.extend(messages.details().iter().map(|text| format!("{unit}: {text}")));
    }

    /// Adds the number of further messages, the last of them, and the messages of calls that succeeded.
    pub fn end(self, unit: &str, Recording { warnings, details, .. }: &mut Recording) {
        details.extend(self.details);
        if self.count > MOST_MESSAGES {
            if self.count > MOST_MESSAGES + 1 {
                warnings.push(format!("{unit}: {} more messages", self.count - MOST_MESSAGES - 1));
            }
            warnings.push(self.last);
        }
    }
}

/// A loop whose components are instantiated and connected.
#[derive(Debug)]
pub struct ClosedLoop {
    units: Vec<WiredUnit>,
    names: Vec<String>,
    /// Units of measurement of the signals, in the order of their names.
    measures: Vec<String>,
    row: Vec<f64>,
    notes: Vec<String>,
    /// True if there is an algebraic loop.
    circular: bool,
    /// Values that variables get while it runs.
    changes: Vec<Change>,
    order: Order,
}

impl ClosedLoop {
    /// A loop without units.
    pub(super) fn empty(notes: Vec<String>, circular: bool, changes: Vec<Change>, order: Order) -> Self {
        let (units, names, measures, row) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        ClosedLoop { units, names, measures, row, notes, circular, changes, order }
    }

    /// Adds a component, with or without Event Mode. Its variables at these places are recorded, under their names with
    /// a prefix.
    pub(super) fn add(&mut self, instance: Instance, prefix: &str, recorded: &[usize], by_events: bool) {
        let mut outputs = Ports::default();
        for place in recorded {
            let variable = &instance.description().variables[*place];
            outputs.add(variable, self.row.len(), Affine::IDENTITY);
            self.row.push(0.0);
            self.names.push(format!("{prefix}{}", variable.name));
            self.measures.push(variable.unit.clone().unwrap_or_default());
        }
        let (inputs, logged) = (Ports::default(), LoggedMessages::default());
        self.units.push(WiredUnit { instance, outputs, inputs, logged, by_events });
    }

    /// Number of its signals.
    pub(super) fn width(&self) -> usize {
        self.row.len()
    }

    /// Connects the signal at a place of the row to an input of a component.
    pub(super) fn connect(&mut self, unit: usize, input: &Variable, place: usize, conversion: Affine) {
        self.units[unit].inputs.add(input, place, conversion);
    }

    /// Compiles equations for the parameters that its first component has in common with that of another loop when
    /// both are initialised, with this start and stop time; none if that isn't possible.
    pub(super) fn compile_common(mut self, mut other: Self, (start, stop): (f64, f64)) -> Option<Common> {
        let begun = self.initialise(start, stop).is_ok() && other.initialise(start, stop).is_ok();
        let (one, another) = (self.units.first()?, other.units.first()?);
        let common = begun.then(|| one.instance.compile_common(&another.instance)).flatten();
        let _ = [self, other].map(|closed| closed.free(&mut Recording::default(), Ok(())));
        common
    }

    /// Names of its signals.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Runs the loop without recording it. `watch` gets the time and all signals, in the order of their names, at every
    /// communication point, and may end the run by returning false. Further changes are set at the first point that
    /// isn't before them.
    ///
    /// # Errors
    /// When a component fails.
    pub fn watch(
        mut self,
        settings: Settings,
        changes: &[Change],
        mut watch: impl FnMut(f64, &[f64]) -> bool,
    ) -> Result<(), Error> {
        let mut recording = Recording::default();
        let result = self.run_into(&mut recording, settings, changes, |_, time, row| watch(time, row));
        self.free(&mut recording, result)
    }

    /// Runs the loop. `progress` gets the time, and may end the run by returning false.
    ///
    /// # Errors
    /// When a component fails, together with what was recorded until then.
    pub fn run(
        self,
        settings: Settings,
        mut progress: impl FnMut(f64) -> bool,
    ) -> Result<Recording, (Error, Box<Recording>)> {
        let start = settings.start_time;
        self.run_while(settings, |time, _| time == start || progress(time))
    }

    /// Runs the loop. `goes_on` gets the time and all signals, in the order of their names, at every communication
    /// point, the first included, and may end the run by returning false.
    ///
    /// # Errors
    /// When a component fails, together with what was recorded until then.
    pub fn run_while(
        self,
        settings: Settings,
        goes_on: impl FnMut(f64, &[f64]) -> bool,
    ) -> Result<Recording, (Error, Box<Recording>)> {
        self.record(settings, usize::MAX, |_| true, goes_on)
    }

    /// Runs the loop in blocks, for runs that are too long for the memory. Whenever a recording has so many values and
    /// there is a further point, `take` must empty it of its points. It may end the run by returning false.
    ///
    /// # Errors
    /// When a component fails, together with what was recorded until then and not taken.
    pub fn run_in_blocks(
        self,
        settings: Settings,
        values: usize,
        take: impl FnMut(&mut Recording) -> bool,
        mut progress: impl FnMut(f64) -> bool,
    ) -> Result<Recording, (Error, Box<Recording>)> {
        let start = settings.start_time;
        self.record(settings, values, take, |time, _| time == start || progress(time))
    }

    fn record(
        mut self,
        settings: Settings,
        values: usize,
        mut take: impl FnMut(&mut Recording) -> bool,
        mut goes_on: impl FnMut(f64, &[f64]) -> bool,
    ) -> Result<Recording, (Error, Box<Recording>)> {
        let columns = vec![Vec::new(); self.names.len()];
        let (names, measures, warnings) = (self.names.clone(), self.measures.clone(), self.notes.clone());
        let mut recording = Recording { names, measures, columns, warnings, ..Recording::default() };
        let result = self.run_into(&mut recording, settings, &[], |recording, time, row| {
            if recording.values() >= values && !take(recording) {
                return false;
            }
            recording.push(time, row);
            goes_on(time, row)
        });
        match self.free(&mut recording, result) {
            Ok(()) => Ok(recording),
            Err(error) => Err((error, Box::new(recording))),
        }
    }

    /// Frees all components, also after a failure. The first failure is returned, further ones are warnings.
    fn free(self, recording: &mut Recording, mut result: Result<(), Error>) -> Result<(), Error> {
        for unit in self.units {
            let WiredUnit { instance, mut logged, .. } = unit;
            let name = instance.name().to_owned();
            logged.keep(&name, &instance.messages(), &mut recording.warnings);
            match instance.free() {
                Ok(messages) => logged.keep(&name, &messages, &mut recording.warnings),
                Err(error) if result.is_ok() => result = Err(error),
                Err(error) => recording.warnings.push(error.to_string()),
            }
            logged.end(&name, recording);
        }
        result
    }

    /// Adds messages to the recording; `watch` adds the rest.
    fn run_into(
        &mut self,
        recording: &mut Recording,
        settings: Settings,
        changes: &[Change],
        mut watch: impl FnMut(&mut Recording, f64, &[f64]) -> bool,
    ) -> Result<(), Error> {
        let (Settings { start_time, stop_time, .. }, order) = (settings, self.order);
        recording.warnings.extend(self.initialise(start_time, stop_time)?);
        let (mut goes_on, mut is_warned) = (watch(recording, start_time, &self.row), false);
        let (mut coming, mut ahead) = (Coming::new(&self.changes, changes), self.ahead());
        for (k, (time, next)) in settings.points().enumerate() {
            if !goes_on {
                break;
            }
            let due = coming.due(settings, k);
            self.change(&due, order, time)?;
            // Start values, and what was set, are taken over in a step of its own.
            let taken = match ahead.as_mut().filter(|_| k > 0 && due.is_empty()) {
                Some(ahead) => ahead.step(&mut self.units[0].instance, coming.unchanged(settings, k), &mut self.row)?,
                None => false,
            };
            if !taken {
                let unsettled = self.step(order, time, next)?;
                recording.warnings.extend(unsettled.filter(|_| !std::mem::replace(&mut is_warned, true)));
            }
            for WiredUnit { instance, logged, .. } in &mut self.units {
                logged.keep(instance.name(), &instance.messages(), &mut recording.warnings);
            }
            goes_on = watch(recording, next, &self.row);
        }
        self.units.iter().try_for_each(|unit| unit.instance.terminate())
    }

    /// Applies changes that are due at a communication point.
    fn change(&mut self, due: &[Change], order: Order, time: f64) -> Result<(), Error> {
        if due.is_empty() {
            return Ok(());
        }
        // Effects of a change are exchanged at the same point.
        if order == Order::EventMode {
            self.begin_event()?;
        }
        for Change { place: Place { unit, variable }, value, .. } in due {
            let instance = &self.units[*unit].instance;
            instance.set_start(instance.description().variables[*variable].reference, value)?;
        }
        if order == Order::EventMode { self.exchange(Some(time)).map(drop) } else { Ok(()) }
    }

    /// Steps that can be taken in one go, if it is a single component that nothing is connected to.
    fn ahead(&self) -> Option<Ahead> {
        let [WiredUnit { outputs, inputs, by_events: false, .. }] = &self.units[..] else { return None };
        inputs.is_empty().then(|| Ahead::of(outputs.references()))
    }

    /// Takes one step. Returns a message if values don't converge in Event Mode.
    fn step(&mut self, order: Order, time: f64, next: f64) -> Result<Option<String>, Error> {
        match order {
            Order::GaussSeidel => self.step_in_turn(time, next).map(|()| None),
            Order::Jacobi => self.step_together(time, next).map(|()| None),
            Order::EventMode => {
                self.step_in_turn(time, next)?;
                self.event(next)
            }
        }
    }

    fn step_in_turn(&mut self, time: f64, next: f64) -> Result<(), Error> {
        self.units.iter_mut().try_for_each(|unit| {
            unit.take(&self.row)?;
            unit.instance.do_step(time, next - time)?;
            unit.give(&mut self.row)
        })
    }

    fn step_together(&mut self, time: f64, next: f64) -> Result<(), Error> {
        self.units.iter_mut().try_for_each(|unit| unit.take(&self.row))?;
        self.units.iter_mut().try_for_each(|unit| unit.instance.do_step(time, next - time))?;
        self.units.iter_mut().try_for_each(|unit| unit.give(&mut self.row))
    }

    fn begin_event(&mut self) -> Result<(), Error> {
        self.units.iter().filter(|unit| unit.by_events).try_for_each(|unit| unit.instance.begin_event())
    }

    /// Handles the event of a communication point for components with Event Mode.
    fn event(&mut self, time: f64) -> Result<Option<String>, Error> {
        self.begin_event()?;
        self.exchange(Some(time))
    }

    /// Exchanges values in Event Mode, and updates discrete states in the order of the components, until nothing
    /// changes. Then all components are ready for a step.
    fn exchange(&mut self, time: Option<f64>) -> Result<Option<String>, Error> {
        let unsettled = self.hand_on(time)?;
        for _ in 0..EVENT_ITERATIONS {
            let before = self.row.clone();
            for unit in &mut self.units {
                unit.take(&self.row)?;
                if unit.by_events {
                    unit.instance.update()?;
                }
                unit.give(&mut self.row)?;
            }
            if unsettled.is_some() || same_bits(&before, &self.row) {
                break;
            }
        }
        self.units.iter().filter(|unit| unit.by_events).try_for_each(|unit| unit.instance.enter_step_mode())?;
        Ok(unsettled)
    }

    /// Initialises all components. Returns a message if values don't converge.
    fn initialise(&mut self, start: f64, stop: f64) -> Result<Option<String>, Error> {
        self.units.iter_mut().try_for_each(|unit| unit.instance.enter_initialization(start, stop))?;
        let unsettled = self.hand_on(None)?;
        self.units.iter().try_for_each(|unit| unit.instance.exit_initialization())?;
        if self.units.iter().any(|unit| unit.by_events) {
            self.exchange(None)?;
        }
        Ok(unsettled)
    }

    /// Passes outputs on until they no longer change, at most once for each component: by then every value has reached
    /// all of them. Values of an algebraic loop are iterated further; a message is returned if they don't converge.
    fn hand_on(&mut self, time: Option<f64>) -> Result<Option<String>, Error> {
        let (mut before, mut rounds) = (Vec::new(), 0);
        while rounds < self.units.len() && !same_bits(&before, &self.row) {
            before.clone_from(&self.row);
            self.go_round()?;
            rounds += 1;
        }
        if self.circular { self.settle(time) } else { Ok(None) }
    }

    fn go_round(&mut self) -> Result<(), Error> {
        self.units.iter_mut().try_for_each(|unit| {
            unit.take(&self.row)?;
            unit.give(&mut self.row)
        })
    }

    /// Iterates the algebraic loop until its values converge. If they don't, the values of the first rounds are used,
    /// and the message names the signal that changes most.
    fn settle(&mut self, time: Option<f64>) -> Result<Option<String>, Error> {
        let first = self.row.clone();
        let mut settling = Settling::new(&first);
        while settling.goes_on() {
            self.go_round()?;
            if settling.next(&self.row) {
                return Ok(None);
            }
        }
        let (place, change) = settling.moves_most();
        let when = time.map_or_else(|| "initialisation".to_owned(), |time| format!("event at {time} s"));
        let (signal, change, rounds) = (&self.names[place], number(change), self.units.len());
        let message = format!(
            "{when}: the values of the algebraic loop don't converge. `{signal}` still changed by {change} \
             in iteration {}; the run goes on with the values of iteration {rounds}",
            rounds + settling.rounds()
        );
        self.row = first;
        self.units.iter_mut().try_for_each(|unit| unit.take(&self.row))?;
        Ok(Some(message))
    }
}

/// True if rows are the same to the last bit, NaN included.
fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl WiredUnit {
    fn take(&mut self, row: &[f64]) -> Result<(), Error> {
        self.inputs.take(&self.instance, row)
    }

    fn give(&mut self, row: &mut [f64]) -> Result<(), Error> {
        self.outputs.give(&self.instance, row)
    }
}
