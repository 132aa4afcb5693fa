//! An instance in model exchange: the master integrates, and asks for values at its own times, states and inputs. Its events are those of
//! Event Mode in co-simulation, too.

use super::Execution;
use crate::error::{Invalid, StepError};
use crate::integrator::{Workspace, check_divergence};
use crate::system::{Handle, Section, Values};

/// Result of an update of the discrete variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// True if an event was handled or parameters were taken over, so that outputs may have jumped.
    pub changed: bool,
    /// True if parameters were taken over.
    pub parameters_taken_over: bool,
    /// True if states have jumped since the event began.
    pub states_changed: bool,
    /// The next event that is known in advance, s.
    pub next_time_event: Option<f64>,
}

impl Execution {
    /// Goes on in model exchange from the values that were just initialised. What is taken from inputs at the start
    /// was taken there.
    ///
    /// # Errors
    /// When the equations don't hold there; nothing is changed.
    pub fn begin_model_exchange(&mut self) -> Result<(), StepError> {
        self.check()?;
        let (t, controls) = (self.time(), self.model.controls());
        let (started, completed) = (controls.started, controls.completed);
        self.point().put(started, true);
        self.point()[completed] = t;
        self.begin_event();
        Ok(())
    }

    /// Begins an event: from here on it is noted whether states jump. Integer and Boolean inputs that waited for it are
    /// in force.
    pub fn begin_event(&mut self) {
        let (jumped, waits) = (self.model.controls().states_jumped, self.model.controls().integer_inputs_wait);
        self.point().put(jumped, false);
        if self.values().get(waits) {
            self.point().put(waits, false);
            self.changed();
        }
    }

    /// Sets an Integer or Boolean input, by its place in the block, between events: it waits for the next one, since
    /// within a step of the master's integrator nothing may jump.
    pub fn set_integer_input_between_events(&mut self, place: usize, value: i32) {
        let waits = self.model.controls().integer_inputs_wait;
        if !self.values().get(waits) {
            self.keep_integer_inputs();
        }
        self.block.integers[place] = value;
        let inputs = self.model.variables().integers(Section::Input);
        let in_force = self.copied_integers(self.model.controls().last_integer_inputs, Section::Input);
        let differ = self.block.integers[inputs] != self.block.integers[in_force];
        self.point().put(waits, differ);
    }

    /// The continuous states.
    pub fn states(&self) -> &[f64] {
        &self.block.reals[self.model.variables().reals(Section::State)]
    }

    /// Sets the continuous states.
    pub fn set_states(&mut self, states: &[f64]) {
        let range = self.model.variables().reals(Section::State);
        self.block.reals[range].copy_from_slice(states);
        self.changed();
    }

    /// Sets the continuous states at these places.
    pub fn set_states_at(&mut self, places: &[usize], states: &[f64]) {
        let first = self.model.variables().reals(Section::State).start;
        places.iter().zip(states).for_each(|(place, &state)| self.block.reals[first + place] = state);
        self.changed();
    }

    /// Magnitudes of the continuous states.
    pub fn nominals(&self) -> &[f64] {
        self.model.nominals()
    }

    /// Brings signals and derivatives to the present time, states and inputs, where these have changed.
    pub fn evaluate(&mut self) {
        if !self.fresh {
            let t = self.time();
            self.with_valid_parameters(|execution| execution.problem().evaluate(t));
            self.fresh = true;
        }
    }

    /// The system's objection to the present time, states and inputs, if any.
    pub fn unsound(&mut self) -> Option<Invalid> {
        let mut found = Ok(());
        self.with_valid_parameters(|execution| found = execution.check());
        found.err()
    }

    /// The derivatives of the states, evaluated.
    pub fn derivatives(&mut self) -> &[f64] {
        self.evaluate();
        &self.block.reals[self.model.variables().reals(Section::Derivative)]
    }

    /// The event indicators, evaluated.
    pub fn event_indicators(&mut self) -> &[f64] {
        self.evaluate();
        self.find_indicators()
    }

    /// The event indicators of the values as they are.
    pub fn find_indicators(&mut self) -> &[f64] {
        let (t, mut z) = (self.time(), std::mem::take(&mut self.event_indicators));
        self.with_valid_parameters(|execution| {
            execution.model.equations().event_indicators(t, &execution.values(), &mut z)
        });
        self.event_indicators = z;
        &self.event_indicators
    }

    /// The event indicators as they were found last.
    pub fn known_indicators(&self) -> &[f64] {
        &self.event_indicators
    }

    /// True if parameters were set that aren't in force yet.
    pub fn parameters_wait(&self) -> bool {
        self.values().get(self.model.controls().parameters_set)
    }

    /// Computes with the last valid parameters: those that wait to be taken over may contradict each other, and what
    /// is prepared from them isn't. Integer inputs that wait for an event aren't in force either.
    fn with_valid_parameters<T>(&mut self, compute: impl FnOnce(&mut Self) -> T) -> T {
        let wait = self.parameters_wait();
        if wait {
            self.swap_parameters();
        }
        let computed = self.with_integer_inputs_in_force(compute);
        if wait {
            self.swap_parameters();
        }
        computed
    }

    fn with_integer_inputs_in_force<T>(&mut self, compute: impl FnOnce(&mut Self) -> T) -> T {
        let waits = self.model.controls().integer_inputs_wait;
        if !self.values().get(waits) {
            return compute(self);
        }
        self.swap_integer_inputs();
        self.point().put(waits, false);
        let computed = compute(self);
        self.swap_integer_inputs();
        self.point().put(waits, true);
        computed
    }

    fn swap_integer_inputs(&mut self) {
        let set = self.model.variables().integers(Section::Input);
        let in_force = self.copied_integers(self.model.controls().last_integer_inputs, Section::Input);
        let (before, after) = self.block.integers.split_at_mut(in_force.start);
        before[set].swap_with_slice(&mut after[..in_force.len()]);
    }

    fn swap_parameters(&mut self) {
        let (variables, controls) = (self.model.variables(), self.model.controls());
        if let Some(valid) = controls.valid_reals {
            let (set, in_force) = (variables.reals(Section::Parameter), variables.reals(Section::Memory).start);
            let (before, memory) = self.block.reals.split_at_mut(in_force);
            before[set].swap_with_slice(&mut memory[valid.span().range()]);
        }
        let (set, in_force) = (variables.integers(Section::Parameter), self.valid_integers());
        let (before, after) = self.block.integers.split_at_mut(in_force.start);
        before[set].swap_with_slice(&mut after[..in_force.len()]);
    }

    /// Takes over the parameters that were set, all or none, and handles the events that the present time, states and
    /// inputs have brought.
    ///
    /// # Errors
    /// [`StepError::Parameters`] when they are refused: the last valid ones are in force again. Else why the event
    /// can't be handled: everything is as before, parameters that wait to be taken over included.
    pub fn update_discrete(&mut self) -> Result<Update, StepError> {
        self.working(Execution::update_discrete_with)
    }

    fn update_discrete_with(&mut self, workspace: &mut Workspace) -> Result<Update, StepError> {
        workspace.keep(&self.block.reals, &self.block.integers);
        let waiting = self.log.len();
        self.changed();
        let taken_over = self.commit_parameters().map_err(StepError::Parameters)?;
        // Not every master sets inputs in Initialization Mode: what is taken from them at the start is taken in the first Event Mode, too.
        let starts = self.integrates && !self.values().get(self.model.controls().started);
        let begun = if starts { self.initialise_states(workspace) } else { Ok(()) };
        let events = begun.and_then(|()| self.handle_events(workspace)).inspect_err(|_| {
            workspace.bring_back(&mut self.block.reals, &mut self.block.integers);
            self.log.truncate(waiting);
            self.fresh = false;
        })?;
        let (states, jumped) = (self.model.variables().reals(Section::State), self.model.controls().states_jumped);
        if self.block.reals[states.clone()] != workspace.reals[states] {
            self.point().put(jumped, true);
        }
        Ok(Update {
            changed: events || taken_over,
            parameters_taken_over: taken_over,
            states_changed: self.values().get(jumped),
            next_time_event: self.next_time_event(),
        })
    }

    fn handle_events(&mut self, workspace: &mut Workspace) -> Result<bool, StepError> {
        let (t, settings, slack) = (self.time(), self.settings(), self.event_slack());
        self.recall_indicators(workspace);
        let any = workspace.driver.events_at(&mut self.problem(), (t, slack), &settings)?;
        self.keep_indicators(workspace);
        self.fresh = true;
        self.check_point()?;
        Ok(any)
    }

    /// Ends an event: an indicator that it left at exactly zero is from now on on the side to which it leaves.
    pub fn end_event(&mut self) {
        self.evaluate();
        let (t, settings) = (self.time(), self.settings());
        self.working(|execution, workspace| {
            execution.recall_indicators(workspace);
            workspace.driver.sides_of_zeros(&mut execution.problem(), t, t + 1.0, &settings);
            execution.keep_indicators(workspace);
        });
    }

    /// Time at which the last step of the master's integrator was completed, s.
    pub fn completed(&self) -> f64 {
        self.values()[self.model.controls().completed]
    }

    /// Takes note of a completed step of the master's integrator. Returns true if it ends at an event, or inputs wait
    /// for one.
    ///
    /// # Errors
    /// When the equations don't hold there, or a value has grown beyond any use or is no number.
    pub fn complete_step(&mut self) -> Result<bool, StepError> {
        let inputs_wait = self.values().get(self.model.controls().integer_inputs_wait);
        let note = |execution: &mut Self| execution.working(Execution::note_step);
        let ends_at_event = self.with_integer_inputs_in_force(note)?;
        Ok(ends_at_event || inputs_wait)
    }

    fn note_step(&mut self, workspace: &mut Workspace) -> Result<bool, StepError> {
        self.evaluate();
        self.check().map_err(StepError::Unsound)?;
        self.check_point()?;
        let noticed = self.notify_step(workspace);
        let t = self.time();
        self.recall_indicators(workspace);
        let pending = workspace.driver.event_pending(&self.problem(), t);
        self.keep_indicators(workspace);
        Ok(noticed || pending)
    }

    /// Notifies the system that a step is completed; true if that is an event.
    ///
    /// By the standard, discrete variables change in Event Mode only. What a system changes here counts steps and
    /// remembers warnings, which equations don't read. Restarting the master's integrator after each step for that
    /// would be absurd. So it is an event only if the equations give other values.
    fn notify_step(&mut self, workspace: &mut Workspace) -> bool {
        let (t, step, completed) = (self.time(), self.time() - self.completed(), self.model.controls().completed);
        self.point()[completed] = t;
        if step <= 0.0 {
            return false;
        }
        workspace.keep(&self.block.reals, &self.block.integers);
        self.model.equations().step_completed(t, step, &mut self.block.point(&self.model, &mut self.log));
        if self.block.reals == workspace.reals && self.block.integers == workspace.integers {
            return false;
        }
        self.changed();
        self.evaluate();
        self.equations_differ(workspace)
    }

    /// True if the equations give other values than those stored.
    fn equations_differ(&self, before_step: &Workspace) -> bool {
        let variables = self.model.variables();
        let before = Values::new(&before_step.reals, &before_step.integers, variables.offsets());
        let next = |values: &Values<f64>| self.model.equations().next_time_event(values);
        let sections = [Section::State, Section::Signal, Section::Derivative].map(|section| variables.reals(section));
        sections.into_iter().any(|range| self.block.reals[range.clone()] != before_step.reals[range])
            || next(&self.values()) != next(&before)
    }

    /// Refuses a point at which the master's integrator has arrived with values beyond any use.
    fn check_point(&mut self) -> Result<(), StepError> {
        let (t, limit) = (self.time(), self.settings().divergence_limit);
        check_divergence(&mut self.problem(), t, limit)?;
        self.check_values(t, limit)
    }
}
