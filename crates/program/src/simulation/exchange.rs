//! A master for model exchange: integrates the equations of an FMU, and finds its events.

use super::inputs::{Inputs, Side};
use crate::error::Error;
use crate::fmu::{Event, Instance, Value};
use crate::integrator::tableau::{E, STAGES, TABLEAU};

/// Shortest step, as a part of the time, or of 1 s.
const SHORTEST: f64 = 1e-13;
/// Safety factor of the next step, and the limits of its change.
const SAFETY: f64 = 0.9;
const FACTORS: (f64, f64) = (0.2, 5.0);
/// Factor after a step at whose points the FMU's equations have no value.
const AFTER_REFUSAL: f64 = 0.25;
/// Bisections of a step that locate an event in it.
const BISECTIONS: usize = 46;
/// Interval of close events, as a part of the time, or of 1 s, and the most of them.
const CLOSE: f64 = 1e-10;
const MOST_CLOSE: usize = 100;

/// A unit that is being integrated.
pub(super) struct Exchange<'a> {
    instance: Instance,
    inputs: Option<&'a Inputs>,
    tolerance: f64,
    nominals: Vec<f64>,
    time: f64,
    states: Vec<f64>,
    indicators: Vec<f64>,
    next_event: Option<f64>,
    /// The step to try next, s; 0 if unknown.
    step: f64,
    /// Time of the last event, s, and number of close events before it.
    last_event: f64,
    close: usize,
}

impl<'a> Exchange<'a> {
    /// Begins with an instance that has just left Initialization Mode.
    pub fn begin(
        instance: Instance,
        inputs: Option<&'a Inputs>,
        (states, indicators): (usize, usize),
        tolerance: f64,
        time: f64,
    ) -> Result<Self, Error> {
        let next_event = instance.finish_event()?.next;
        Ok(Exchange {
            nominals: if states > 0 { instance.nominals(states)? } else { Vec::new() },
            states: if states > 0 { instance.states(states)? } else { Vec::new() },
            indicators: if indicators > 0 { instance.event_indicators(indicators)? } else { Vec::new() },
            instance,
            inputs,
            tolerance,
            time,
            next_event,
            step: 0.0,
            last_event: f64::NEG_INFINITY,
            close: 0,
        })
    }

    /// The FMU, at the present time and states.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    /// The unit, when all is done.
    pub fn into_instance(self) -> Instance {
        self.instance
    }

    /// Integrates until a time.
    pub fn advance(&mut self, to: f64) -> Result<(), Error> {
        let shortest = SHORTEST * to.abs().max(1.0);
        while to - self.time > shortest {
            let input = self.inputs.and_then(|inputs| inputs.next_time(self.time));
            let end = [Some(to), self.next_event, input].into_iter().flatten().fold(to, f64::min);
            let crossed = if end - self.time > shortest {
                self.step(end, shortest)?
            } else {
                self.time = end.max(self.time);
                self.put((self.time, Side::Before), &self.states.clone())?;
                false
            };
            let is_due = |time: Option<f64>, now: f64| time.is_some_and(|time| time - now <= shortest);
            let wants = self.instance.completed_step()?;
            if crossed || wants || is_due(self.next_event, self.time) || is_due(input, self.time) {
                self.event(&[])?;
            }
        }
        self.put((self.time, Side::After), &self.states.clone())
    }

    /// Makes a step until `end` at most, or until an event indicator changes its sign. Returns true if one did.
    fn step(&mut self, end: f64, shortest: f64) -> Result<bool, Error> {
        let way = end - self.time;
        let mut step = if self.step > 0.0 { self.step.min(way) } else { way.min(1e-3 * way.max(1.0)) };
        loop {
            // No crumb is left over.
            let tried = if way - step < 0.1 * step { way } else { step };
            match self.attempt(tried) {
                Ok((after, error)) if error <= 1.0 => {
                    let factor = if error > 0.0 { SAFETY * error.powf(-0.2) } else { FACTORS.1 };
                    self.step = tried * factor.clamp(FACTORS.0, FACTORS.1);
                    return self.accept(tried, after);
                }
                Ok((_, error)) => step = tried * (SAFETY * error.powf(-0.2)).clamp(FACTORS.0, SAFETY),
                // Only after a discarded call, or NaN, may another step be tried.
                Err(failure) if !self.instance.may_try_again() || tried * AFTER_REFUSAL < shortest => {
                    return Err(failure);
                }
                Err(_) => step = tried * AFTER_REFUSAL,
            }
            // NaN ends the search for a step, too.
            if step.is_nan() || step < shortest {
                let message = format!(
                    "no integration step reaches the relative tolerance {:e}. The equations may be singular at this \
                     time",
                    self.tolerance
                );
                return Err(self.failed("fmi2GetDerivatives", message));
            }
        }
    }

    /// Goes to the end of a step, or to the first sign change of an event indicator in it.
    fn accept(&mut self, step: f64, after: Vec<f64>) -> Result<bool, Error> {
        let start = self.time;
        self.put((start + step, Side::Before), &after)?;
        if !self.crosses()? {
            (self.time, self.states) = (start + step, after);
            self.look()?;
            return Ok(false);
        }
        let (mut none, mut some, mut found) = (0.0, step, after);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (none + some);
            let (between, _) = self.attempt(middle)?;
            self.put((start + middle, Side::Before), &between)?;
            if self.crosses()? {
                (some, found) = (middle, between);
            } else {
                none = middle;
            }
        }
        (self.time, self.states) = (start + some, found);
        self.put((self.time, Side::Before), &self.states.clone())?;
        Ok(true)
    }

    fn failed(&self, function: &'static str, message: String) -> Error {
        Error::Unit { unit: self.instance.name().to_owned(), function, time: self.time, message }
    }

    /// True if the sign of an indicator at the present point differs from the last one.
    fn crosses(&self) -> Result<bool, Error> {
        if self.indicators.is_empty() {
            return Ok(false);
        }
        let now = self.instance.event_indicators(self.indicators.len())?;
        Ok(now.iter().zip(&self.indicators).any(|(now, before)| (*now > 0.0) != (*before > 0.0)))
    }

    fn look(&mut self) -> Result<(), Error> {
        if !self.indicators.is_empty() {
            self.indicators = self.instance.event_indicators(self.indicators.len())?;
        }
        Ok(())
    }

    /// Handles an event at the present point, at which variables get values.
    pub fn event(&mut self, changes: &[(u32, Value)]) -> Result<(), Error> {
        let is_close = self.time - self.last_event <= CLOSE * self.time.abs().max(1.0);
        self.close = if is_close { self.close + 1 } else { 0 };
        self.last_event = self.time;
        if self.close > MOST_CLOSE {
            let message = format!("too many events, {MOST_CLOSE} at one time");
            return Err(self.failed("fmi2NewDiscreteStates", message));
        }
        self.instance.begin_event()?;
        if let Some(inputs) = self.inputs {
            inputs.set(&self.instance, self.time)?;
        }
        changes.iter().try_for_each(|(reference, value)| self.instance.set_start(*reference, value))?;
        let Event { next, states_changed, nominals_changed } = self.instance.finish_event()?;
        self.next_event = next;
        if nominals_changed && !self.nominals.is_empty() {
            self.nominals = self.instance.nominals(self.nominals.len())?;
        }
        if states_changed && !self.states.is_empty() {
            self.states = self.instance.states(self.states.len())?;
        }
        self.step = 0.0;
        self.look()
    }

    /// Sets a time, its inputs, and states.
    fn put(&mut self, (time, side): (f64, Side), states: &[f64]) -> Result<(), Error> {
        self.instance.set_time(time)?;
        if let Some(inputs) = self.inputs {
            inputs.set_continuous(&self.instance, time, side)?;
        }
        if states.is_empty() { Ok(()) } else { self.instance.set_states(states) }
    }

    /// The states after a step of Dormand and Prince's method, and the error in parts of the tolerated one.
    fn attempt(&mut self, step: f64) -> Result<(Vec<f64>, f64), Error> {
        let (start, before) = (self.time, self.states.clone());
        if before.is_empty() {
            return Ok((before, 0.0));
        }
        let mut rates: Vec<Vec<f64>> = Vec::with_capacity(STAGES);
        let mut after = before.clone();
        for (node, weights) in TABLEAU {
            after.copy_from_slice(&before);
            for (weight, rate) in weights.iter().zip(&rates) {
                after.iter_mut().zip(rate).for_each(|(x, rate)| *x += step * weight * rate);
            }
            // An input that jumps at the end of a step jumps after it.
            let side = if node < 1.0 { Side::After } else { Side::Before };
            self.put((start + node * step, side), &after)?;
            rates.push(self.instance.state_derivatives(before.len())?);
        }
        // The last stage is at the end of the step.
        let mut worst = 0.0;
        for i in 0..before.len() {
            let error: f64 = E.iter().zip(&rates).map(|(weight, rate)| step * weight * rate[i]).sum();
            let size = self.nominals[i].abs().max(before[i].abs()).max(after[i].abs());
            let scaled = error.abs() / (self.tolerance * size);
            if scaled > worst || scaled.is_nan() {
                worst = scaled;
            }
        }
        Ok((after, worst))
    }
}
