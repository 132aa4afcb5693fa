//! Functions of model exchange for an instance (FMI 2.0.4, section 3.2).

use super::calls::{Answer, Refused};
use super::calls::{Function, Phase};
use super::instance::{Instance, hand_out};
use super::stepping::COMMUNICATION_POINT_SLACK;
use super::types::{Boolean, EventInfo, FALSE, Status};
use crate::error::{Number, StepError};
use crate::system::Section;

impl Instance {
    /// fmi2EnterEventMode
    pub fn enter_event_mode(&mut self) {
        self.execution.begin_event();
        self.phase = Phase::Event;
    }

    /// fmi2NewDiscreteStates
    ///
    /// # Errors
    /// When parameters are refused (the last valid ones are in force again), or events don't end (values as before, and
    /// the instance in error).
    pub fn new_discrete_states(&mut self) -> Answer<EventInfo> {
        let time = self.execution.time();
        let update = self.execution.update_discrete().map_err(|error| {
            // Parameters are refused as any argument is: the instance can go on.
            if !matches!(error, StepError::Parameters(_)) {
                self.phase = Phase::Error;
            }
            Refused(format!("{} at t = {} s: {error}", self.called(Function::NewDiscreteStates), Number(time)))
        })?;
        self.log_taken_over(update.parameters_taken_over, time);
        Ok(EventInfo {
            // Other units may answer to outputs that have jumped; their answer is another update's.
            new_discrete_states_needed: Boolean::from(update.changed),
            terminate_simulation: FALSE,
            nominals_changed: FALSE,
            values_changed: Boolean::from(update.states_changed),
            next_event_time_defined: Boolean::from(update.next_time_event.is_some()),
            next_event_time: update.next_time_event.unwrap_or(0.0),
        })
    }

    /// fmi2EnterContinuousTimeMode
    ///
    /// # Errors
    /// While parameters wait to be taken over.
    pub fn enter_continuous_time_mode(&mut self) -> Answer {
        self.end_event(Function::EnterContinuousTimeMode, Phase::ContinuousTime)
    }

    pub(crate) fn end_event(&mut self, function: Function, next: Phase) -> Answer {
        if self.execution.parameters_wait() {
            let [enter, update] = [function, Function::NewDiscreteStates].map(|function| self.called(function));
            return Err(Refused(format!("{enter}: parameters were set; {update} takes them over first")));
        }
        self.execution.end_event();
        if next == Phase::StepComplete {
            self.execution.begin_step_mode();
        }
        self.phase = next;
        Ok(())
    }

    /// fmi2CompletedIntegratorStep. Returns true if Event Mode is to be entered.
    ///
    /// # Errors
    /// When a value has grown beyond any use or is no number, which leaves the instance in error, or beyond the stop time.
    pub fn completed_integrator_step(&mut self) -> Answer<bool> {
        let (name, time) = (self.called(Function::CompletedIntegratorStep), self.execution.time());
        let slack = COMMUNICATION_POINT_SLACK * (time - self.execution.completed()).abs();
        if let Some(stop) = self.stop_time.filter(|stop| time > stop + slack) {
            return Err(Refused(format!(
                "{name}: t = {} s is beyond stopTime = {} s, which {} was given",
                Number(time),
                Number(stop),
                self.called(Function::SetupExperiment)
            )));
        }
        self.execution.complete_step().map_err(|error| {
            self.phase = Phase::Error;
            Refused(format!("{name}: {error}"))
        })
    }

    /// fmi2SetTime
    ///
    /// # Errors
    /// When it isn't finite.
    pub fn set_time(&mut self, time: f64) -> Answer {
        if !time.is_finite() {
            let name = self.called(Function::SetTime);
            return Err(Refused(format!("{name}: time = {} must be a finite number", Number(time))));
        }
        self.execution.set_time(time);
        Ok(())
    }

    /// fmi2SetContinuousStates
    ///
    /// # Errors
    /// When one isn't finite, or their number is wrong; nothing is changed.
    pub fn set_continuous_states(&mut self, states: &[f64]) -> Answer {
        let function = Function::SetContinuousStates;
        self.check_count(function, states.len(), self.execution.states().len(), "continuous states")?;
        if let Some(number) = states.iter().position(|state| !state.is_finite()) {
            let (name, value) = (self.real_name(Section::State, number), states[number]);
            return Err(Refused(format!(
                "{}: `{name}` = {} must be a finite number",
                self.called(function),
                Number(value)
            )));
        }
        if self.unit.order_of_states.is_empty() {
            self.execution.set_states(states);
        } else {
            self.execution.set_states_at(&self.unit.order_of_states, states);
        }
        Ok(())
    }

    /// fmi2GetContinuousStates; fmi2Discard where one is no number.
    ///
    /// # Errors
    /// When their number is wrong, or nothing can start from what is set.
    pub fn get_continuous_states(&mut self, states: &mut [f64]) -> Answer<Status> {
        let function = Function::GetContinuousStates;
        self.check_count(function, states.len(), self.execution.states().len(), "continuous states")?;
        self.evaluate(function)?;
        let broken = hand_out(in_order(&self.unit.order_of_states, self.execution.states()), states);
        Ok(broken.map_or(Status::Ok, |(place, value)| {
            let what = format!("`{}`", self.real_name(Section::State, place));
            self.not_finite(function, &what, value)
        }))
    }

    /// fmi2GetNominalsOfContinuousStates
    ///
    /// # Errors
    /// When their number is wrong.
    pub fn get_nominals(&mut self, nominals: &mut [f64]) -> Answer<Status> {
        let function = Function::GetNominalsOfContinuousStates;
        self.check_count(function, nominals.len(), self.execution.nominals().len(), "continuous states")?;
        let broken = hand_out(in_order(&self.unit.order_of_states, self.execution.nominals()), nominals);
        Ok(broken.map_or(Status::Ok, |(place, value)| {
            let what = format!("the nominal value of `{}`", self.real_name(Section::State, place));
            self.not_finite(function, &what, value)
        }))
    }

    /// fmi2GetDerivatives; fmi2Discard where one is no number.
    ///
    /// # Errors
    /// When their number is wrong.
    pub fn get_derivatives(&mut self, derivatives: &mut [f64]) -> Answer<Status> {
        let function = Function::GetDerivatives;
        self.check_count(function, derivatives.len(), self.execution.states().len(), "continuous states")?;
        self.evaluate(function)?;
        let broken = hand_out(in_order(&self.unit.order_of_states, self.execution.derivatives()), derivatives);
        Ok(broken.map_or(Status::Ok, |(place, value)| {
            let what = format!("`{}`", self.real_name(Section::Derivative, place));
            self.not_finite(function, &what, value)
        }))
    }

    /// fmi2GetEventIndicators; fmi2Discard where one is no number.
    ///
    /// # Errors
    /// When their number is wrong, or nothing can start from what is set.
    pub fn get_event_indicators(&mut self, indicators: &mut [f64]) -> Answer<Status> {
        let function = Function::GetEventIndicators;
        let expected = self.execution.model().variables().indicators().len();
        self.check_count(function, indicators.len(), expected, "event indicators")?;
        self.evaluate(function)?;
        let broken = hand_out(self.execution.event_indicators().iter().copied(), indicators);
        Ok(broken.map_or(Status::Ok, |(place, value)| {
            self.not_finite(function, &format!("event indicator {}", place + 1), value)
        }))
    }

    fn check_count(&self, function: Function, given: usize, expected: usize, what: &str) -> Answer {
        if given == expected {
            return Ok(());
        }
        Err(Refused(format!("{}: {given} {what}; this FMU has {expected}", self.called(function))))
    }

    /// Place of a state by its number in the master's order.
    fn place_of_state(&self, number: usize) -> usize {
        self.unit.order_of_states.get(number).copied().unwrap_or(number)
    }

    /// Name of a state, or of its derivative, by its number in the master's order.
    fn real_name(&self, section: Section, number: usize) -> String {
        let place = self.place_of_state(number);
        let element = self.execution.model().variables().real_at(section, place);
        element.map_or(String::new(), |element| element.name())
    }
}

/// Numbers of the states in a master's order, which is the places of these; none where it is that in which they are stored.
fn in_order<'a>(order: &'a [usize], numbers: &'a [f64]) -> impl Iterator<Item = f64> + Clone + 'a {
    (0..numbers.len()).map(|number| numbers[order.get(number).copied().unwrap_or(number)])
}
